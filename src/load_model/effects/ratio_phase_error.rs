//! Phase error of the instrument transformers.
//!
//! An angle between the errors of voltage and current transformer mixes P and Q: half a degree puts
//! .9 % of P into Q.
//!
//! Missing, it leaves a residual in Q in step with P. An error of the ratio alone is absorbed by the
//! scaling to P0 exactly and cannot be seen.
//!
//! With `e` the angle by which the measured current lags too much, for the deviations from rest:
//!
//! ```text
//! P - P0 = dP* cos e - dQ* sin e            (1)
//! Q - Q0 = dP* sin e + dQ* cos e            (2)
//! ```
//!
//! Source: S = V conj(I) with a turned current; IEC 61869-2 allows current transformers of class 0.5 30 minutes of arc at
//! the rated current and 45 at a fifth of it, those of class 1 60 and 90 (26 mrad); IEC 61869-3 allows voltage
//! transformers of class 1 40 (12 mrad; not verified). The prior takes such limits for two to three deviations.

use crate::{
    load_model::{
        composed::Series,
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Prior, Scale},
    },
    numerics::Elementary,
};

/// Phase error of the instrument transformers.
#[derive(Clone, Copy, Debug)]
pub(super) struct RatioPhaseError;

const DECLARATION: Declaration = Declaration {
    name: "ratio_phase_error",
    title: "Phase error of the instrument transformers",
    kind: Kind::Instrument,
    version: 1,
    parameters: &[Parameter {
        prior: Prior {
            centre: 0.0,
            deviation: 0.01,
            scale: Scale::Linear,
        },
        ..Parameter::two_sided(["angle_rad", "e", "rad"], [-0.1, 0.02, 0.1, 0.01])
    }],
    states: &[],
    acts_on: &[Place::Measurement],
    excludes: &[],
    resembles: &["static_frequency_dependence"],
    needs: Needs {
        separating_event: "events with large changes of P at little change of V",
        ..Needs::A_DIP
    },
    source: "S = V conj(I); phase displacement in the classes of IEC 61869-2 and 61869-3",
};

impl Declared for RatioPhaseError {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for RatioPhaseError {
    fn measure(&self, p: &[S], series: &mut Series<'_, S>) {
        let [sine, cosine] = p[0].sin_cos();
        let q0 = series.reactive_at_rest;
        for (p, q) in series.active.iter_mut().zip(series.reactive.iter_mut()) {
            let (dp, dq) = (*p + -1.0, *q + -q0);
            *p = dp * cosine - dq * sine + 1.0; // (1)
            *q = dp * sine + dq * cosine + q0; // (2)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_degree_puts_nine_thousandths_of_p_into_q() {
        let (mut active, mut reactive) = (vec![0.5], vec![0.3]);
        let mut series = Series {
            time_s: &[0.0],
            jump: &[false],
            phasor: &[[0.7, 0.0]],
            reactive_at_rest: 0.3,
            active: &mut active,
            reactive: &mut reactive,
        };
        // sin(0.5 degrees) = 0.0087265: dQ = -0.5 x 0.0087265.
        RatioPhaseError.measure(&[0.5_f64.to_radians()], &mut series);
        assert!((reactive[0] - 0.3 + 0.004_363_27).abs() < 1e-8);
    }
}
