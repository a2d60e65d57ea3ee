//! Single-phase air conditioners that stall.
//!
//! The compressors of residential air conditioners stop within two cycles when the voltage falls to
//! about 60 %, and stay stalled when it is back: a locked rotor draws several times its normal power
//! until its thermal relay opens, seconds later.
//!
//! Missing, it leaves P and Q far above their old values after clearing, by two to four times the share,
//! that decay over 5 to 20 s. Fault-induced delayed voltage recovery is made of it.
//!
//! With `F` the share of P0, `s` the stalled part of it, `b` the part of that which has restarted and
//! `k` the part that its thermal relay has left on, per unit of the group's own initial power:
//!
//! ```text
//! run:    p = 1,                      q = q_r + 6 ((v - .86)^2 - .14^2)     v > .86          (1)
//!         p = 1 + 12 (.86 - v)^3.2,   q = q_r - 6 .14^2 + 11 (.86 - v)^2.5  below            (2)
//!         but never more than (3)
//! stall:  p = G v^2,  q = B v^2                                                             (3)
//! s = latch(v < V_st for T_st),  b = r latch(v > V_rs for T_rs), until they stall again      (4)
//! T_th dh/dt = G v^2 - h,   k = 1 - (h - h_1)/h_s within 0..1                                (5)
//! dP = F ((1 - s + s b) p_run (1 + K_pf df) + s (1 - b) k p_stall - 1), dQ likewise with K_qf (6)
//! ```
//!
//! The -1 in (6) takes the share out of the constant-power part of the static load.
//!
//! The running curves are fixed: recordings do not determine them; their voltages are shares of V0. Below the voltage
//! where it meets (3) the running curve is that of a motor which has stopped.
//!
//! Source: motor D of the WECC composite load model: Kq1 6, Nq1 2, Kp2 12, Np2 3.2, Kq2 11, Nq2 2.5, Vbrk .86, Rstall
//! .124, Xstall .114, Tstall .033, Vstall .55-.65, Vrst .9-.95, Trst .3-.4, Th1t .7-1.3, Th2t 1.9-4.3, Tth 10-15 s (all from
//! memory, not verified), `CmpKpf` 1 and `CmpKqf` -3.3 (likewise); a `q_r` of .25 is a power factor of .97. Not included:
//! contactors (`contactor_dropout`), undervoltage relays.

use super::{lag::lag, relay};
use crate::{
    load_model::{
        MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{
            Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Reference, State,
        },
    },
    numerics::{
        Elementary,
        elementary::{at_least, at_most, power, smaller},
    },
};

/// Single-phase air conditioners that stall.
#[derive(Clone, Copy, Debug)]
pub(super) struct SinglePhaseAcStall;

const BREAK_VOLTAGE: f64 = 0.86;
/// A fit in which less than this share restarts may have given it up before anything else was right: without it
/// nothing tells the voltage at which it would. It is tried once more with this share ...
const RESTARTS_MIN: f64 = 0.02;
const RESTARTING: f64 = 0.15;
/// ... at these voltages, pu.
const RESTARTED_AT_PU: [f64; 3] = [0.85, 0.89, 0.93];

const fn state(name: &'static str, unit: &'static str) -> State {
    State { name, unit }
}

const DECLARATION: Declaration = Declaration {
    name: "single_phase_ac_stall",
    title: "Single-phase air conditioners that stall",
    kind: Kind::Physics,
    version: 6,
    parameters: &[
        Parameter::one_sided(["share", "F", "1"], [0.15, 0.6, 0.02]),
        Parameter::shape(["stall_voltage", "V_st", "pu"], [0.4, 0.62, 0.8], 0.06)
            .with_reference(Reference::Voltage)
            .with_resolution(relay::VOLTAGE_RESOLUTION_PU),
        Parameter::positive_shape(["stall_time_s", "T_st", "s"], [0.008, 0.035, 0.3], 0.6)
            .with_resolution(relay::TIME_RESOLUTION_S),
        Parameter::positive_shape(["stalled_conductance", "G", "1"], [2.0, 4.4, 8.0], 0.3)
            .with_reference(Reference::GroupAdmittance),
        Parameter::positive_shape(["stalled_susceptance", "B", "1"], [2.0, 4.0, 8.0], 0.3)
            .with_reference(Reference::GroupAdmittance),
        Parameter::positive_shape(["thermal_time_s", "T_th", "s"], [1.0, 10.0, 60.0], 0.8),
        Parameter::shape(["restarting_share", "r", "1"], [0.0, 0.1, 1.0], 0.3),
        Parameter::shape(["restart_voltage", "V_rs", "pu"], [0.8, 0.92, 0.98], 0.04)
            .with_reference(Reference::Voltage)
            .with_resolution(relay::RETURN_RESOLUTION_PU),
        Parameter::positive_shape(["restart_time_s", "T_rs", "s"], [0.05, 0.35, 2.0], 0.4)
            .with_resolution(relay::TIME_RESOLUTION_S),
        Parameter::positive_shape(["first_trip_heat", "h_1", "1"], [0.3, 0.9, 3.0], 0.4),
        Parameter::positive_shape(["trip_heat_span", "h_s", "1"], [0.3, 1.4, 5.0], 0.4),
        Parameter::shape(["reactive_ratio", "q_r", "1"], [0.0, 0.25, 0.8], 0.05),
        Parameter::shape(["frequency_active", "K_pf", "1"], [-2.0, 1.0, 3.0], 0.7),
        Parameter::shape(["frequency_reactive", "K_qf", "1"], [-6.0, -3.3, 3.0], 2.0),
    ],
    states: &[
        state("stall_timer", "s"),
        state("stalled", "1"),
        state("restart_timer", "s"),
        state("restarted", "1"),
        state("heat", "1"),
    ],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &[
        "distributed_generation",
        "exponential_recovery",
        "motor_undervoltage_trip",
    ],
    needs: Needs {
        voltage_below: Some(0.75),
        window_s: 20.0,
        separating_event: "dips on both sides of 60 % of the voltage, recorded for 20 to 30 s",
        ..Needs::A_DIP
    },
    source: "WECC composite load model, motor D (from memory, not verified)",
};

impl Declared for SinglePhaseAcStall {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn threshold(&self) -> Option<&'static str> {
        Some("stall_voltage")
    }

    fn pick_up(&self) -> Option<&'static str> {
        Some("stall_time_s")
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        [5.0, 15.0]
            .map(|thermal_s| {
                vec![
                    0.62, 0.035, 4.4, 4.0, thermal_s, 0.1, 0.92, 0.35, 0.9, 1.4, 0.25, 1.0, -3.3,
                ]
            })
            .to_vec()
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0, 4, 6, 11, 12, 13]
    }

    fn mistaken_for(&self, values: &[f64]) -> Vec<Vec<f64>> {
        if values[6] > RESTARTS_MIN {
            return Vec::new();
        }
        let restarting = |voltage: f64| {
            let mut others = values.to_vec();
            others[6..9].copy_from_slice(&[RESTARTING, voltage, 0.35]);
            others
        };
        RESTARTED_AT_PU.map(restarting).to_vec()
    }
}

/// (1), (2); `stalled` is the power of stopped motors at 1 pu, `at_rest` the reactive one of running motors.
fn running<S: Elementary>(v: S, stalled: [S; 2], at_rest: S) -> [S; 2] {
    let floor = at_rest + -6.0 * (1.0 - BREAK_VOLTAGE) * (1.0 - BREAK_VOLTAGE);
    if v.value() > BREAK_VOLTAGE {
        let above = v + -BREAK_VOLTAGE;
        // Written around the voltage at rest, so that it is exact there.
        let excess = (v + -1.0) * (above + (1.0 - BREAK_VOLTAGE)) * 6.0;
        return [S::constant(1.0), excess + at_rest];
    }
    // The powers' slopes at zero do not exist.
    let under = at_least(-v + BREAK_VOLTAGE, 1e-9);
    let slowing = [
        power(under, S::constant(3.2)) * 12.0 + 1.0,
        power(under, S::constant(2.5)) * 11.0 + floor,
    ];
    [0, 1].map(|i| smaller(slowing[i], stalled[i] * (v * v)))
}

/// Part that the thermal relays have left on (5).
fn left_on<S: Elementary>(heat: S, p: &[S]) -> S {
    let tripped = (heat - p[9]) / p[10];
    -at_most(at_least(tripped, 0.0), 1.0) + 1.0
}

impl<S: Elementary> Equations<S> for SinglePhaseAcStall {
    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let low = step.voltage.map(|v| relay::below(v, p[1]));
        let high = step.voltage.map(|v| relay::returned(v, p[7]));
        let [stall_timer, stalled, restart_timer, restarted, heat] = x else {
            return;
        };
        relay::latch([stall_timer, stalled], low, p[2], step.duration_s); // (4)
        if stalled.value() > 0.0 {
            // Those that run again stall again.
            let running = -relay::switched(*stall_timer, p[2]) + 1.0;
            *restarted = smaller(*restarted, running);
            relay::latch([restart_timer, restarted], high, p[8], step.duration_s);
            let [from, _, to] = step.voltage.map(|v| p[3] * (v * v));
            *heat = lag(*heat, [from, to], p[5], step.duration_s); // (5)
        }
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let v = at.voltage;
        let [p_run, q_run] = running(v, [p[3], p[4]], p[11]);
        let (stalled, back) = (x[1], p[6] * x[3]);
        let locked = stalled * (-back + 1.0);
        let run = -locked + 1.0;
        let hot = locked * left_on(x[4], p) * (v * v);
        let df = at.frequency_deviation;
        let active = run * (p_run * (p[12] * df + 1.0)) + hot * p[3];
        let reactive = run * (q_run * (p[13] * df + 1.0)) + hot * p[4];
        [p[0] * (active + -1.0), p[0] * (reactive - p[11])] // (6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    const MOTOR: MotorCoordinates<f64> = MotorCoordinates {
        alpha_per_s: 10.0,
        nu_per_s2: 500.0,
        kappa: 0.5,
    };

    #[test]
    fn the_running_curve_is_continuous_and_exact_at_rest() {
        let running = |v: f64| running(v, [4.4, 4.0], 0.25);
        assert_eq!(running(1.0)[1].to_bits(), 0.25_f64.to_bits());
        let [above, below] = [running(BREAK_VOLTAGE + 1e-9), running(BREAK_VOLTAGE - 1e-9)];
        assert!((above[0] - below[0]).abs() < 1e-9 && (above[1] - below[1]).abs() < 1e-9);
        // v = 0.66: 12 x 0.2^3.2 = 12 x 0.0057981 = 0.069577.
        assert!((running(0.66)[0] - 1.069_577).abs() < 1e-5);
        // v = 0.4: 12 x 0.46^3.2 = 1.0, and one for rest; stopped 4.4 x 0.16 = 0.704.
        assert!((running(0.4)[0] - 0.704).abs() < 1e-12);
    }

    #[test]
    fn a_restart_that_a_fit_has_given_up_is_tried_again() {
        let mut values = SinglePhaseAcStall.nuisance_grid(&MOTOR).remove(0);
        values.insert(0, 0.15);
        assert!(SinglePhaseAcStall.mistaken_for(&values).is_empty());
        values[6] = 0.0;
        let others = SinglePhaseAcStall.mistaken_for(&values);
        assert_eq!(others.len(), RESTARTED_AT_PU.len());
        for (other, voltage) in others.iter().zip(RESTARTED_AT_PU) {
            assert_eq!(other[6..9], [RESTARTING, voltage, 0.35]);
            assert_eq!((&other[..6], &other[9..]), (&values[..6], &values[9..]));
        }
    }

    #[test]
    fn those_that_have_restarted_stall_again_in_another_dip() {
        let low = |t: f64| (0.5..0.6).contains(&t) || (2.0..2.1).contains(&t);
        let dips = |t: f64| [if low(t) { 0.5 } else { 1.0 }, 0.0];
        let input = lasting(4.0, dips, &[0.5, 0.6, 2.0, 2.1]);
        let model = ComposedModel::new(&Structure::zip_im().with("single_phase_ac_stall").unwrap());
        let mut p = model.typical();
        // Half of them restart after 0.35 s; relays that are far from opening.
        p[8..20].copy_from_slice(&[
            0.1, 0.62, 0.035, 4.4, 4.0, 60.0, 0.5, 0.92, 0.35, 3.0, 1.2, 0.25,
        ]);
        let drive = Drive::new(&input, &[], 0.3);
        let with = model.simulate(&p, &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        // 0.1 (4.4 - 1) = 0.34 while all stand, half of it once half of them run: at 0.8, 1.5, 2.3 and 3 s.
        for (k, expected) in [(48, 0.34), (90, 0.17), (138, 0.34), (180, 0.17)] {
            let more = with.active[k] - without.active[k];
            assert!((more - expected).abs() < 1e-3, "{k}: {more}");
        }
    }

    #[test]
    fn running_air_conditioners_follow_the_frequency() {
        let model = ComposedModel::new(&Structure::zip_im().with("single_phase_ac_stall").unwrap());
        let input = lasting(1.0, |_| [1.0, 0.0], &[]);
        let course = vec![-0.01; 61];
        let drive = Drive::new(&input, &course, 0.3);
        let mut p = model.typical();
        p[8] = 0.2;
        let with = model.simulate(&p, &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        let k = with.active.len() - 1;
        // 0.2 x 1 x -0.01; 0.2 x 0.25 x -3.3 x -0.01.
        assert!((with.active[k] - without.active[k] + 0.002).abs() < 1e-12);
        assert!((with.reactive[k] - without.reactive[k] - 0.001_65).abs() < 1e-12);
    }

    #[test]
    fn stalled_air_conditioners_draw_their_locked_rotor_power_until_the_relays_open() {
        let dip = |t: f64| [if (0.5..0.6).contains(&t) { 0.5 } else { 1.0 }, 0.0];
        let input = lasting(10.0, dip, &[0.5, 0.6]);
        let model = ComposedModel::new(&Structure::zip_im().with("single_phase_ac_stall").unwrap());
        let mut p = model.typical();
        p[8..20].copy_from_slice(&[
            0.1, 0.62, 0.035, 4.4, 4.0, 5.0, 0.0, 0.92, 0.35, 0.7, 1.2, 0.25,
        ]);
        let drive = Drive::new(&input, &[], 0.3);
        let with = model.simulate(&p, &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        // Soon after: 0.1 (4.4 - 1) = 0.34 in P, 0.1 (4 - 0.25) = 0.375 in Q.
        let k = 42;
        assert!((with.active[k] - without.active[k] - 0.34).abs() < 1e-3);
        assert!((with.reactive[k] - without.reactive[k] - 0.375).abs() < 1e-3);
        // 4.4 (1 - e^(-t/5)) = 1.9 at t = 2.83 s: all have tripped long before the end.
        let last = with.active.len() - 1;
        assert!((with.active[last] - without.active[last] + 0.1).abs() < 1e-3);
    }
}
