//! Blocks for definite-time relays: a smooth condition, a timer, a latch, a switch with its own time.
//!
//! A relay as it is built compares, waits and switches, each without a slope; a model of it has no
//! derivative with respect to its settings. A thousand relays at a substation have as many
//! settings, so each of the three is spread a little, and only a little: a first-order lag in place
//! of a definite time would let the load go while the voltage is still above the threshold.

use crate::{
    load_model::effect::Parameter,
    numerics::{
        Scalar,
        elementary::{larger, smaller, smooth_step},
    },
};

/// Half width of the spread of a voltage threshold, pu. Chosen; small against the step between the
/// depths of any two events, large against the noise of a voltage.
pub(in crate::load_model) const VOLTAGE_SPREAD_PU: f64 = 0.008;

/// The same of a voltage to which it returns, pu: stalled motors let it creep there, and it stays within a
/// wider spread for seconds.
const RETURN_SPREAD_PU: f64 = 0.004;

/// Time over which a block switches after its delay, s: breakers of a group take 1 to 5 ms longer or
/// shorter.
const SWITCHING_S: f64 = 0.004;

/// Standard deviation of a relay's voltage where the load's has no spread: it may lie anywhere in that of the
/// model, uniformly, `VOLTAGE_SPREAD_PU / sqrt 3`.
pub(super) const VOLTAGE_RESOLUTION_PU: f64 = 0.0046;

/// The same of a voltage to which it returns: `RETURN_SPREAD_PU / sqrt 3`.
pub(super) const RETURN_RESOLUTION_PU: f64 = 0.0023;

/// The same of a delay, in the time over which a block switches: `SWITCHING_S / sqrt 12`.
pub(super) const TIME_RESOLUTION_S: f64 = 0.0012;

/// The same of a delay after which motors are switched. Behind an instrument's filter a switching shows smeared over
/// `h` (a nominal cycle of 17 to 20 ms) to both sides, which the model applies near jumps of the voltage and for 0.2 s after them; what was
/// switched meanwhile changes at the rate `alpha` of the motor's flux (30 1/s), which moves the middle of
/// the smear by `h^2/6 alpha`, 1.4 ms. With [`TIME_RESOLUTION_S`].
pub(super) const MOTOR_TIME_RESOLUTION_S: f64 = 0.0018;

impl Parameter {
    /// The same, leaving open by itself what a relay of the model does.
    #[must_use]
    pub(super) const fn with_resolution(self, resolution: f64) -> Self {
        Self { resolution, ..self }
    }
}

/// Exactly 1 where the voltage is well below the threshold, exactly 0 where it is well above.
pub(in crate::load_model) fn below<S: Scalar>(voltage: S, threshold: S) -> S {
    smooth_step((threshold - voltage) * (0.5 / VOLTAGE_SPREAD_PU) + 0.5)
}

/// Exactly 1 where the voltage is well above a threshold to which it returns, exactly 0 where it is well below.
pub(super) fn returned<S: Scalar>(voltage: S, threshold: S) -> S {
    smooth_step((voltage - threshold) * (0.5 / RETURN_SPREAD_PU) + 0.5)
}

/// The mean of a condition over a step, from its start, middle and end.
pub(in crate::load_model) fn mean<S: Scalar>(condition: [S; 3]) -> S {
    (condition[0] + condition[1] * 4.0 + condition[2]) * (1.0 / 6.0)
}

/// Runs a timer while its condition holds and resets it when the condition has gone.
pub(in crate::load_model) fn run_timer<S: Scalar>(
    timer: &mut S,
    condition: [S; 3],
    duration_s: f64,
) {
    if condition[2].value() > 0.0 {
        *timer = *timer + mean(condition) * duration_s;
    } else {
        *timer = S::constant(0.0);
    }
}

/// Share of a group that has switched when its timer shows `timer`.
pub(in crate::load_model) fn switched<S: Scalar>(timer: S, delay_s: S) -> S {
    smooth_step((timer - delay_s) * (1.0 / SWITCHING_S))
}

/// A definite-time relay with memory: `state` holds its timer and the share that has switched,
/// which never falls by itself.
pub(in crate::load_model) fn latch<S: Scalar>(
    state: [&mut S; 2],
    condition: [S; 3],
    delay_s: S,
    duration_s: f64,
) {
    let [timer, latched] = state;
    run_timer(timer, condition, duration_s);
    *latched = larger(*latched, switched(*timer, delay_s));
}

/// Times of a relay and of the switch it opens, s.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::struct_field_names, reason = "units come last")]
pub(super) struct SwitchTimes<S> {
    /// How long the condition must hold before the relay picks up.
    pub(super) pick_up_s: S,
    /// From there until the first contact parts, whatever the voltage does meanwhile.
    pub(super) opening_s: S,
    /// From the first contact of the group to the last.
    pub(super) spread_s: S,
}

/// A definite-time relay and the switch it opens: `state` holds the relay's timer, the share that
/// has picked up, the time since then, and the share that is open, which never falls by itself. The
/// switch opens also where the condition has gone by then: a breaker told to open does not stop
/// half-way.
pub(super) fn open<S: Scalar>(
    state: [&mut S; 4],
    condition: [S; 3],
    times: SwitchTimes<S>,
    duration_s: f64,
) {
    let [timer, picked_up, since, opened] = state;
    let before = *picked_up;
    latch([timer, picked_up], condition, times.pick_up_s, duration_s);
    part(before, *picked_up, since, opened, times, duration_s);
}

/// Lets the contacts of what has picked up part: `before` and `picked_up` are the shares at both ends of the step.
fn part<S: Scalar>(
    before: S,
    picked_up: S,
    since: &mut S,
    opened: &mut S,
    times: SwitchTimes<S>,
    duration_s: f64,
) {
    *since = *since + (before + picked_up) * (0.5 * duration_s);
    if since.value() > 0.0 {
        *opened = smooth_step((*since - times.opening_s) / times.spread_s);
    }
}

/// [`open`] at the dip `number` only, counted from 1, at most the third: `counted` holds the shares that past dips have picked
/// up at least once and at least twice. Relays differ by their settings alone, so what a shorter dip picks up a longer one
/// does too, and those that have picked up `number` times are as many as in the dip that comes `number`-th by its length.
pub(super) fn open_at_dip<S: Scalar>(
    number: f64,
    state: [&mut S; 4],
    counted: [&mut S; 2],
    condition: [S; 3],
    times: SwitchTimes<S>,
    duration_s: f64,
) {
    if number < 1.5 {
        open(state, condition, times, duration_s);
        return;
    }
    let ([timer, picked_up, since, opened], [once, twice]) = (state, counted);
    let (before, in_dip) = (*picked_up, switched(*timer, times.pick_up_s));
    run_timer(timer, condition, duration_s);
    let earlier = if number < 2.5 { *once } else { *twice };
    let now = switched(*timer, times.pick_up_s);
    *picked_up = larger(*picked_up, smaller(earlier, now));
    part(before, *picked_up, since, opened, times, duration_s);
    if timer.value() <= 0.0 && in_dip.value() > 0.0 {
        *twice = larger(*twice, smaller(*once, in_dip));
        *once = larger(*once, in_dip);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_switch_opens_after_the_dip_that_made_its_relay_pick_up() {
        let times = SwitchTimes {
            pick_up_s: 0.02,
            opening_s: 0.05,
            spread_s: 0.01,
        };
        let [mut timer, mut picked_up, mut since, mut opened] = [0.0; 4];
        let mut half_open_at = None;
        for k in 0..200 {
            let voltage = if (50..80).contains(&k) { 0.5 } else { 1.0 };
            let state = [&mut timer, &mut picked_up, &mut since, &mut opened];
            open(state, [below(voltage, 0.7); 3], times, 0.001);
            if opened >= 0.5 && half_open_at.is_none() {
                half_open_at = Some(k);
            }
        }
        // 50 ms, 20 ms and half of 4 ms until the relay, 50 ms and half of 10 ms: 127 ms.
        assert!(
            half_open_at.is_some_and(|k| (125..=128).contains(&k)),
            "{half_open_at:?}"
        );
        assert!((opened - 1.0).abs() < 1e-15);
    }

    #[test]
    fn a_relay_switches_after_its_delay_and_stays() {
        let (mut timer, mut latched) = (0.0, 0.0);
        let step_s = 0.001;
        let mut switched_at = None;
        for k in 0..200 {
            let voltage = if (50..120).contains(&k) { 0.5 } else { 1.0 };
            let condition = [below(voltage, 0.7); 3];
            latch([&mut timer, &mut latched], condition, 0.04, step_s);
            if latched >= 1.0 && switched_at.is_none() {
                switched_at = Some(k);
            }
        }
        // 50 ms, 40 ms of delay, 4 ms of switching.
        assert!(
            switched_at.is_some_and(|k| (92..=95).contains(&k)),
            "{switched_at:?}"
        );
        assert!(latched >= 1.0 && timer.abs() < 1e-15);
    }

    #[test]
    fn a_dip_shorter_than_the_delay_leaves_no_trace() {
        let (mut timer, mut latched) = (0.0, 0.0);
        for k in 0..100 {
            let voltage = if (50..80).contains(&k) { 0.5 } else { 1.0 };
            let condition = [below(voltage, 0.7); 3];
            latch([&mut timer, &mut latched], condition, 0.04, 0.001);
        }
        assert!(latched.abs() < 1e-15 && timer.abs() < 1e-15);
    }

    #[test]
    fn conditions_are_exact_away_from_the_threshold() {
        assert_eq!(below(0.95_f64, 0.9).to_bits(), 0.0_f64.to_bits());
        assert_eq!(below(0.85_f64, 0.9).to_bits(), 1.0_f64.to_bits());
        assert!((below(0.9_f64, 0.9) - 0.5).abs() < 1e-12);
    }
}
