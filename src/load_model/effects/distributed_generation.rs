//! Generation behind the load that stops during the dip.
//!
//! What a feeder draws is its load less its photovoltaic generation. Inverters cease to feed below a
//! voltage and return after a delay with a ramp; older ones trip and stay off for minutes.
//!
//! Missing, it leaves a *rise* of P after the fault that ramps down over seconds, or stays; the
//! same site at night shows nothing.
//!
//! With `G` the generation over P0, `l` the share of it that is off:
//!
//! ```text
//! l  = latch(V < V_mc for T_mc) (1 - (1 - o) ramp((t - t_back - T_d)/T_r))          (1)
//! dP = G l                                                                        (2)
//! ```
//!
//! `t_back` is the time when the voltage was back, `ramp(y)` runs straight from 0 to 1, `o` is the share
//! that stays off. Below `V_mc` again, what has returned is off at once. No reactive power: inverters
//! of this kind run at power factor 1. Not included: frequency trip, current limit while on.
//!
//! Source: logic of PVD1 and `DER_A` in the WECC composite load model (values Vt0 .88, Vl1 .49, Tvl0 .16 s
//! not verified). A ramp of 1000 s means no return within any window.

use super::relay;
use crate::{
    load_model::{
        MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, State},
    },
    numerics::{
        Elementary,
        elementary::{at_least, at_most},
    },
};

/// Generation behind the load.
#[derive(Clone, Copy, Debug)]
pub(super) struct DistributedGeneration;

const DECLARATION: Declaration = Declaration {
    name: "distributed_generation",
    title: "Generation behind the load that stops in a dip",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::one_sided(["share", "G", "1"], [0.2, 1.0, 0.02]),
        Parameter::shape(["voltage", "V_mc", "1"], [0.4, 0.75, 0.94], 0.12),
        Parameter::positive_shape(["delay_s", "T_mc", "s"], [0.003, 0.02, 0.5], 0.8),
        Parameter::positive_shape(["return_delay_s", "T_d", "s"], [0.01, 0.1, 10.0], 1.5),
        Parameter::positive_shape(["ramp_s", "T_r", "s"], [0.1, 2.0, 1000.0], 2.0),
        Parameter::shape(["staying_off", "o", "1"], [0.0, 0.1, 1.0], 0.3),
    ],
    states: &[
        State {
            name: "timer",
            unit: "s",
        },
        State {
            name: "off",
            unit: "1",
        },
        State {
            name: "since_return_of_voltage",
            unit: "s",
        },
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

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        let mut points = Vec::new();
        for voltage in [0.6, 0.68, 0.76, 0.84, 0.9] {
            for ramp_s in [0.5, 4.0, 1000.0] {
                points.push(vec![voltage, 0.02, 0.05, ramp_s, 0.0]);
            }
        }
        points
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0]
    }
}

impl<S: Elementary> Equations<S> for DistributedGeneration {
    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let low = step.voltage.map(|v| relay::below(v, p[1]));
        let [timer, off, since] = x else { return };
        relay::latch([timer, off], low, p[2], step.duration_s);
        if off.value() > 0.0 {
            // A voltage well below the threshold starts the return anew.
            const WELL_BELOW: f64 = 0.99;
            if low[2].value() > WELL_BELOW {
                *since = S::constant(0.0);
            } else {
                let high = -relay::mean(low) + 1.0;
                *since = *since + high * step.duration_s;
            }
        }
    }

    fn power(&self, p: &[S], x: &[S], _at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let ramp = at_most(at_least((x[2] - p[3]) / p[4], 0.0), 1.0);
        let returned = (-p[5] + 1.0) * ramp;
        let off = x[1] * (-returned + 1.0); // (1)
        [p[0] * off, S::constant(0.0)] // (2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_way_up_the_ramp_half_of_it_is_back() {
        // G = 0.2, all off, no share stays off, 0.1 s + 1 s of a ramp of 2 s: dP = 0.2 x 0.5.
        let p = [0.2, 0.75, 0.02, 0.1, 2.0, 0.0];
        let ramp = at_most(at_least((1.1_f64 - p[3]) / p[4], 0.0), 1.0);
        assert!((p[0] * (1.0 - ramp) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn power_rises_after_the_dip_and_comes_back() {
        use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};
        let dip = |t: f64| [if (0.5..0.6).contains(&t) { 0.6 } else { 1.0 }, 0.0];
        let input = lasting(4.0, dip, &[0.5, 0.6]);
        let structure = Structure::zip_im().with("distributed_generation").unwrap();
        let model = ComposedModel::new(&structure);
        let mut p = model.typical();
        p[8..].copy_from_slice(&[0.2, 0.75, 0.02, 0.1, 2.0, 0.25]);
        let drive = Drive {
            terminal: &input,
            frequency_deviation: &[],
            reactive_at_rest: 0.3,
        };
        let with = model.simulate(&p, &[], &drive).unwrap().active;
        let without = model
            .simulate(&model.neutral(), &[], &drive)
            .unwrap()
            .active;
        // 0.65 s: all off. 1.7 s: 1 s up the ramp, 0.2 (1 - 0.75 x 0.5) = 0.125. 4 s: 0.2 x 0.25.
        for (k, expected) in [(39, 0.2), (102, 0.125), (240, 0.05)] {
            assert!((with[k] - without[k] - expected).abs() < 1e-3, "{k}");
        }
    }
}
