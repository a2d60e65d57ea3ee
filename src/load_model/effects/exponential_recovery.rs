//! Exponential recovery: after a voltage step the load drops at once, then climbs back.
//!
//! Thermostats, tap changers further down and speed controllers restore the consumption over seconds
//! to minutes.
//!
//! Missing, it leaves a residual in P, often in Q too, that decays with one time constant after the
//! voltage has settled at another level. A short dip shows next to nothing of it; a sustained change
//! of 1 to 2 % over two to three time constants is needed.
//!
//! With `z` the voltage seen through a lag, 1 at rest:
//!
//! ```text
//! T dz/dt = v - z                           (1)
//! dP = k_p (v - z),   dQ = k_q (v - z)      (2)
//! ```
//!
//! This is the exponential recovery load `T x' = -x + v^a_s - v^a_t`, `P = x + v^a_t` of Karlsson and Hill,
//! linear in `v - 1`, with `k_p = a_t - a_s` over P0 (positive: it drops and recovers); its steady part
//! belongs to the ZIP part. Valid while the voltage stays within about 10 %; far below, a short dip
//! hardly moves `z`, so that (2) acts as part of the static load.
//!
//! Source: Karlsson and Hill, IEEE Trans. Power Syst. 9(1), 1994 (from memory); the same equations in
//! PowerDynamics.jl `ExponentialRecoveryLoad.jl` (verified). Values T 60-300 s, `a_s` 0-.4, `a_t` 1.5-2.3 not
//! verified.

use super::lag::lagged_voltage;
use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, State},
    },
    numerics::Elementary,
};

/// Exponential recovery.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExponentialRecovery;

const DECLARATION: Declaration = Declaration {
    name: "exponential_recovery",
    title: "Exponential recovery after a change of voltage",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::two_sided(["active_gain", "k_p", "1"], [-2.0, 0.8, 2.0, 0.1]),
        Parameter::two_sided(["reactive_gain", "k_q", "1"], [-3.0, 0.8, 3.0, 0.15]),
        Parameter::positive_shape(["time_constant_s", "T", "s"], [0.15, 4.0, 300.0], 1.5),
    ],
    states: &[State {
        name: "lagged_voltage",
        unit: "1",
    }],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &[
        "static_frequency_dependence",
        "tap_changer",
        "motor_undervoltage_trip",
    ],
    needs: Needs {
        window_s: 20.0,
        voltage_below: Some(0.99),
        separating_event: "a sustained change of voltage of 1 to 2 %, without a change of frequency",
        ..Needs::A_DIP
    },
    source: "Karlsson and Hill 1994 (not verified); PowerDynamics.jl ExponentialRecoveryLoad.jl \
             (equations verified)",
};

impl Declared for ExponentialRecovery {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        [0.3, 0.8, 2.0, 6.0, 30.0].map(|t| vec![t]).to_vec()
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0, 1]
    }
}

impl<S: Elementary> Equations<S> for ExponentialRecovery {
    fn initialise(&self, _p: &[S], _rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        x[0] = S::constant(1.0);
        Ok(())
    }

    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        x[0] = lagged_voltage(x[0], step, p[2]); // (1)
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let apart = at.voltage - x[0];
        [p[0] * apart, p[1] * apart] // (2)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    #[test]
    fn a_step_of_voltage_recovers_with_the_time_constant() {
        // v from 1 to 0.98 at 0.5 s: dP = k (v - z) = -0.02 k e^(-(t - 0.5)/T).
        let step = |t: f64| [if t < 0.5 { 1.0 } else { 0.98 }, 0.0];
        let input = lasting(4.0, step, &[0.5]);
        let structure = Structure::zip_im().with("exponential_recovery").unwrap();
        let model = ComposedModel::new(&structure);
        let mut p = model.neutral();
        p[8] = 1.0;
        p[10] = 1.2;
        let drive = Drive::new(&input, &[], 0.3);
        let with = model.simulate(&p, &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        for (k, t) in [(60, 1.0_f64), (120, 2.0), (240, 4.0)] {
            let expected = -0.02 * (-(t - 0.5) / 1.2).exp();
            let found = with.active[k] - without.active[k];
            // The jump lies within one fine grid interval of 1 ms: 0.02 x 1e-3/1.2.
            assert!((found - expected).abs() < 2e-5, "{found} {expected}");
        }
    }
}
