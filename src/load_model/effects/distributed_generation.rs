//! Generation behind the load: its controls in a dip, momentary cessation, and trips.
//!
//! What a feeder draws is its load less its photovoltaic generation. Inverters feed constant power as
//! long as their current allows; many cease to feed below a voltage and return after a delay with a
//! ramp; others are switched off and stay off for minutes.
//!
//! Missing, it leaves a *rise* of P after the fault that ramps down over seconds, or stays; where the
//! inverters ride through, a rise in the dip alone. The same site at night shows nothing.
//!
//! With `G` the generation over P0, `o` the share of it that a switch takes off, `i_o` and `i_c` the currents
//! of that share and of the rest over that before the event, `cut(v)` 1 above `V_mc` and falling straight to
//! 0 at `V_mc - s`:
//!
//! ```text
//! T_i di_o/dt = min(1/v, I_max) - i_o                                               (1)
//! T_i di_c/dt = (1 - w) min(1/v, I_max) - i_c                                       (2)
//! w  = max(w_now, w_deepest (1 - ramp((t - t_back - T_d)/T_r)))                     (3)
//! w_now = 1 - cut(v) where v < V_mc has lasted T_mc, otherwise 0                    (4)
//! g  = open(v < V_mc for T_mc, T_o, T_s)                                            (5)
//! dP = G P0^-e (o (1 - (1 - g) v i_o) + (1 - o) (1 - v i_c)),   dQ = -t dP             (6)
//! ```
//!
//! `ramp(y)` runs straight from 0 to 1, `w_deepest` is the largest `w_now` since everything was on. `t_back` is
//! the time when the voltage was back, for each inverter at its own voltage within the span: 0.01 pu above the
//! lowest one since everything was on, at most at `V_mc`. Where delay and ramp are short the current follows the
//! voltage down and up. `open` picks up when the voltage has been low for `T_mc`; then the contacts
//! part after `T_o`, all of them within `T_s`, also when the voltage is back by then. Inverters of this
//! kind run at a power factor near 1; `t` is what they and their transformers take of reactive power, per
//! active power fed. Generation does not follow the load: between events it may be a share of P0
//! (`e = 0`) or stay the same (`e = 1`, `G` is then its power in pu of the site's base): then what is measured is less of
//! a larger part of the load, and the coefficients of the load, which are shares of P0, go with `1 + G P0^-e`. Not
//! included: trips by the frequency (`frequency_trip`).
//!
//! Source: logic of PVD1 (limit, then a linear cut that follows the voltage, then the lag of the current: as in ANDES 2.0)
//! and `DER_A` in the WECC composite load model (values Vt0 .88, Vl1 .49, Tvl0 .16 s, filters .02 s not verified);
//! constant power within a current limit is how grid-following inverters are controlled.

use super::{
    lag::lag,
    relay::{self, SwitchTimes},
};
use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{
            Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Reference, State,
        },
    },
    numerics::{
        Elementary,
        elementary::{at_least, at_most, larger, smaller},
    },
};

/// Generation behind the load.
#[derive(Clone, Copy, Debug)]
pub(super) struct DistributedGeneration;

/// Inverters return when the voltage is this much above the lowest one, pu: at the lowest one itself they do not.
const ABOVE_LOWEST_PU: f64 = 0.01;
/// Weight (0 to 1) of being below that voltage from which on the return starts anew.
const WELL_BELOW: f64 = 0.99;

const fn state(name: &'static str, unit: &'static str) -> State {
    State { name, unit }
}

const DECLARATION: Declaration = Declaration {
    name: "distributed_generation",
    title: "Generation behind the load that stops in a dip",
    kind: Kind::Physics,
    version: 4,
    parameters: &[
        Parameter::one_sided(["share", "G", "1"], [0.2, 1.0, 0.02]),
        Parameter::shape(["voltage", "V_mc", "pu"], [0.4, 0.75, 0.94], 0.12)
            .with_reference(Reference::Voltage)
            .with_resolution(relay::VOLTAGE_RESOLUTION_PU),
        Parameter::shape(["span", "s", "pu"], [0.02, 0.05, 0.4], 0.1)
            .with_reference(Reference::Voltage),
        Parameter::positive_shape(["delay_s", "T_mc", "s"], [0.003, 0.02, 0.5], 0.8),
        Parameter::positive_shape(["return_delay_s", "T_d", "s"], [0.002, 0.1, 10.0], 1.5),
        Parameter::positive_shape(["ramp_s", "T_r", "s"], [0.01, 1.0, 1000.0], 2.0),
        Parameter::shape(["staying_off", "o", "1"], [0.0, 0.1, 1.0], 0.5),
        Parameter::positive_shape(["opening_s", "T_o", "s"], [0.001, 0.03, 0.3], 1.0),
        Parameter::positive_shape(["opening_spread_s", "T_s", "s"], [0.004, 0.02, 0.15], 0.8),
        Parameter::shape(["current_limit", "I_max", "1"], [1.0, 1.1, 2.0], 0.15),
        Parameter::positive_shape(["current_lag_s", "T_i", "s"], [0.002, 0.02, 0.2], 0.7),
        Parameter::shape(["reactive_ratio", "t", "1"], [-0.3, 0.0, 0.3], 0.05),
        Parameter::shape(["load_exponent", "e", "1"], [0.0, 1.0, 1.0], 0.5),
    ],
    states: &[
        state("timer", "s"),
        state("picked_up", "1"),
        state("since_pick_up", "s"),
        state("open", "1"),
        state("deepest_cut", "1"),
        state("since_return_of_voltage", "s"),
        state("current_of_switched", "1"),
        state("current_of_ceasing", "1"),
    ],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &["exponential_recovery", "single_phase_ac_stall"],
    needs: Needs {
        voltage_below: Some(0.9),
        window_s: 8.0,
        separating_event: "the same dip by day and by night",
        ..Needs::A_DIP
    },
    source: "WECC PVD1 and DER_A models (logic from memory, values not verified)",
};

impl Declared for DistributedGeneration {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn threshold(&self) -> Option<&'static str> {
        Some("voltage")
    }

    fn pick_up(&self) -> Option<&'static str> {
        Some("delay_s")
    }

    fn parting(&self) -> Option<[&'static str; 2]> {
        Some(["opening_s", "opening_spread_s"])
    }

    fn span(&self) -> Option<&'static str> {
        Some("span")
    }

    fn band(&self) -> Option<[&'static str; 2]> {
        // The switch of (5) picks up at this voltage, too.
        None
    }

    fn load_exponent(&self) -> Option<[&'static str; 2]> {
        Some(["share", "load_exponent"])
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        let at = |[span, delay_s, return_delay_s, ramp_s]: [f64; 4], [off, opening_s]: [f64; 2]| {
            let cut = [0.75, span, delay_s, return_delay_s, ramp_s, off];
            let rest = [opening_s, 0.02, 1.1, 0.02, 0.0, 1.0];
            cut.into_iter().chain(rest).collect()
        };
        vec![
            // Switched off, soon and late.
            at([0.02, 0.02, 0.1, 1.0], [1.0, 0.003]),
            at([0.02, 0.02, 0.1, 1.0], [1.0, 0.05]),
            // Only after a longer dip.
            at([0.02, 0.07, 0.1, 1.0], [1.0, 0.003]),
            at([0.02, 0.16, 0.1, 1.0], [1.0, 0.003]),
            // Ceasing, back soon and slowly.
            at([0.02, 0.02, 0.1, 0.3], [0.0, 0.03]),
            at([0.02, 0.02, 0.1, 3.0], [0.0, 0.03]),
            // Following the voltage.
            at([0.2, 0.003, 0.004, 0.02], [0.0, 0.03]),
        ]
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0]
    }
}

/// `cut(v)`.
fn cut<S: Elementary>(voltage: S, p: &[S]) -> S {
    at_least(at_most((voltage - p[1]) / p[2] + 1.0, 1.0), 0.0)
}

/// The voltage above which inverters return that have ceased at a cut of `deepest`: clearly above the lowest one.
fn back_above<S: Elementary>(deepest: S, p: &[S]) -> S {
    smaller(p[1] - p[2] * deepest + ABOVE_LOWEST_PU, p[1])
}

/// The current at a voltage for constant power within the limit.
fn wanted<S: Elementary>(voltage: S, p: &[S]) -> S {
    const VOLTAGE_MIN: f64 = 0.05;
    smaller(S::constant(1.0) / at_least(voltage, VOLTAGE_MIN), p[9])
}

/// (3)
fn ceased<S: Elementary>(now: S, deepest: S, since_s: S, p: &[S]) -> S {
    larger(now, deepest * (-ramp(since_s, p) + 1.0))
}

fn ramp<S: Elementary>(since_s: S, p: &[S]) -> S {
    at_most(at_least((since_s - p[4]) / p[5], 0.0), 1.0)
}

impl<S: Elementary> Equations<S> for DistributedGeneration {
    fn initialise(&self, _p: &[S], _rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        x[6..].fill(S::constant(1.0));
        Ok(())
    }

    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let duration_s = step.duration_s;
        let low = step.voltage.map(|v| relay::below(v, p[1]));
        let [
            timer,
            picked_up,
            since_pick_up,
            opened,
            deepest,
            since,
            switched,
            ceasing,
        ] = x
        else {
            return;
        };
        let depth = step.voltage.map(|v| -cut(v, p) + 1.0);
        let before = relay::switched(*timer, p[3]) * depth[0];
        let ceased_before = ceased(before, *deepest, *since, p);
        let times = SwitchTimes {
            pick_up_s: p[3],
            opening_s: p[7],
            spread_s: p[8],
        };
        let relay = [&mut *timer, picked_up, since_pick_up, opened];
        relay::open(relay, low, times, duration_s); // (5)
        let after = relay::switched(*timer, p[3]) * depth[2]; // (4)
        *deepest = larger(*deepest, after);
        if deepest.value() > 0.0 {
            let back = back_above(*deepest, p);
            let away = step.voltage.map(|v| relay::below(v, back));
            if away[2].value() > WELL_BELOW {
                *since = S::constant(0.0);
            } else {
                *since = *since + (-relay::mean(away) + 1.0) * duration_s;
            }
            if ramp(*since, p).value() >= 1.0 && low[2].value() <= 0.0 {
                *deepest = S::constant(0.0);
                *since = S::constant(0.0);
            }
        }
        let ceased_after = ceased(after, *deepest, *since, p);
        let wanted = [0, 2].map(|i| wanted(step.voltage[i], p));
        *switched = lag(*switched, wanted, p[10], duration_s); // (1)
        let ordered = [
            (-ceased_before + 1.0) * wanted[0],
            (-ceased_after + 1.0) * wanted[1],
        ];
        *ceasing = lag(*ceasing, ordered, p[10], duration_s); // (2)
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let switched = -((-x[3] + 1.0) * at.voltage * x[6]) + 1.0;
        let ceasing = -(at.voltage * x[7]) + 1.0;
        let lost = p[6] * switched + (-p[6] + 1.0) * ceasing;
        let active = p[0] * lost;
        [active, -(p[11] * active)] // (6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    #[test]
    fn a_dip_within_the_span_takes_a_part_and_the_limit_bounds_the_rest() {
        // V_mc = 0.8, s = 0.2: at 0.65 the share (0.65 - 0.6)/0.2 = 0.25 is on. Constant power at 0.95
        // takes 1/0.95 of the current, at 0.65 the limit.
        let p = [
            0.2, 0.8, 0.2, 0.02, 0.1, 2.0, 0.0, 0.03, 0.02, 1.1, 0.02, 0.0, 0.0_f64,
        ];
        assert!((cut(0.65, &p) - 0.25).abs() < 1e-12);
        assert!((wanted(0.95, &p) - 1.0 / 0.95).abs() < 1e-12);
        assert!((wanted(0.65, &p) - 1.1).abs() < 1e-12);
        // 0.1 s + 1 s of a ramp of 2 s.
        assert!((ramp(1.1, &p) - 0.5).abs() < 1e-12);
    }

    /// What generation with these parameters no longer feeds, over P0, at 60 samples per second.
    fn lost(
        voltage: impl Fn(f64) -> f64,
        lasts_s: f64,
        jumps_s: &[f64],
        values: [f64; 13],
    ) -> Vec<f64> {
        let input = lasting(lasts_s, |t| [voltage(t), 0.0], jumps_s);
        let structure = Structure::zip_im().with("distributed_generation").unwrap();
        let model = ComposedModel::new(&structure);
        let mut p = model.typical();
        p[8..21].copy_from_slice(&values);
        let drive = Drive::new(&input, &[], 0.3);
        let active = |p: &[f64]| model.simulate(p, &[], &drive).unwrap().active;
        let both = active(&p).into_iter().zip(active(&model.neutral()));
        both.map(|(with, without)| with - without).collect()
    }

    #[test]
    fn without_delay_the_current_follows_the_voltage_up_as_well() {
        // Down to 0.62, half a second at 0.7, then back; V_mc = 0.8, s = 0.2.
        let voltage = |t: f64| match t {
            t if (0.5..0.7).contains(&t) => 0.62,
            t if (0.7..1.2).contains(&t) => 0.7,
            _ => 1.0,
        };
        // 0.65 and 1.15 s.
        let lost_at = |[delay_s, ramp_s]: [f64; 2]| {
            let values = [
                0.2, 0.8, 0.2, 0.003, delay_s, ramp_s, 0.0, 0.003, 0.004, 2.0, 0.002, 0.0, 0.0,
            ];
            let lost = lost(voltage, 2.0, &[0.5, 0.7, 1.2], values);
            [39, 69].map(|k| lost[k])
        };
        // At 0.62 a tenth is on, at 0.7 half of it.
        let [down, up] = lost_at([0.002, 0.01]);
        assert!((down - 0.2 * 0.9).abs() < 2e-3, "{down}");
        assert!((up - 0.2 * 0.5).abs() < 2e-3, "{up}");
        // Who waits for a second is still away.
        let [_, waiting] = lost_at([1.0, 0.01]);
        assert!((waiting - 0.2 * 0.9).abs() < 2e-3, "{waiting}");
    }

    #[test]
    fn power_rises_after_the_dip_and_comes_back() {
        let dip = |t: f64| if (0.5..0.6).contains(&t) { 0.6 } else { 1.0 };
        let values = [
            0.2, 0.75, 0.02, 0.02, 0.1, 2.0, 0.25, 0.003, 0.004, 1.1, 0.01, 0.0, 0.0,
        ];
        let lost = lost(dip, 4.0, &[0.5, 0.6], values);
        // 0.65 s: all off. 1.7 s: 1 s up the ramp, 0.2 (1 - 0.75 x 0.5) = 0.125. 4 s: 0.2 x 0.25.
        for (k, expected) in [(39, 0.2), (102, 0.125), (240, 0.05)] {
            assert!((lost[k] - expected).abs() < 1e-3, "{k}");
        }
    }
}
