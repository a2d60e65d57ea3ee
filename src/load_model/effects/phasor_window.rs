//! A phasor window longer than the one the measurement chain accounts for.
//!
//! A phasor is a mean over some cycles. Where the instrument's window is longer than assumed, P and Q
//! around the edges are means of what the model says.
//!
//! Missing, it leaves a residual at the edges that begins *before* the dip, and the voltage that drives the
//! model is not what the load saw.
//!
//! The width is not fitted: the voltages show it by themselves. A fault begins and ends within a
//! millisecond, so the samples that a jump is spread over are the window's. Where the jumps of all events
//! are explained by one window longer than those of the standard (a triangle over two nominal cycles at
//! most), a diagnosis says so before it tries any effect of the load; in a structure with this effect
//! every event is then seen through it, the voltage taken apart and the model's P and Q put together
//! again by the same window, and a note of the set tells its width. Where the jumps are those of the
//! standard, this effect is acquitted and not tried.
//!
//! What (1) adds is a rest: a further mean behind the window that was recognised, or in its place where
//! the voltages have no jumps that tell one. With the share `w` of a mean over `+-h` in the window, acting on the phasors of voltage and current:
//!
//! ```text
//! V_m = (1 - w) V + w mean(V),   I_m = (1 - w) I + w mean(I)           (1)
//! P + jQ = V_m conj(I_m)                                              (2)
//! ```
//!
//! `w = 1` is a plain mean. The share is the amplitude because it enters linearly: a window length has no
//! slope at zero, and no test could see it from there.
//!
//! Source: IEEE C37.118.1 leaves the window to the maker; (1) is a two-parameter family chosen here (no
//! comparison with an instrument).

use super::series::Curve;
use crate::{
    load_model::{
        MotorCoordinates,
        composed::{Series, complex},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place},
    },
    numerics::Elementary,
};

/// A longer phasor window.
#[derive(Clone, Copy, Debug)]
pub(super) struct PhasorWindow;

const DECLARATION: Declaration = Declaration {
    name: "phasor_window",
    title: "Longer phasor window than assumed",
    kind: Kind::Instrument,
    version: 2,
    parameters: &[
        Parameter::one_sided(["share", "w", "1"], [0.5, 1.0, 0.1]),
        Parameter::positive_shape(["half_width_s", "h", "s"], [0.004, 0.02, 0.1], 0.7),
    ],
    states: &[],
    acts_on: &[Place::Measurement],
    excludes: &[],
    resembles: &["time_skew", "double_cage_rotor"],
    needs: Needs {
        rate_fps: 50.0,
        separating_event: "an edge steeper than a frame",
        ..Needs::A_DIP
    },
    source: "IEEE C37.118.1 leaves the window open; the family of windows is chosen here (not verified \
             on an instrument)",
};

impl Declared for PhasorWindow {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        [0.01, 0.02, 0.04].map(|h| vec![h]).to_vec()
    }
}

impl<S: Elementary> Equations<S> for PhasorWindow {
    fn measure(&self, p: &[S], series: &mut Series<'_, S>) {
        // A dead bus has no phasor to speak of.
        const SQUARE_MIN: f64 = 1e-6;
        let u = |k: usize| series.phasor[k].map(S::constant);
        let current = |k: usize| {
            let scale = 1.0 / complex::square(series.phasor[k]).max(SQUARE_MIN);
            let power = [series.active[k], -series.reactive[k]];
            complex::product(power, u(k)).map(|part| part * scale)
        };
        let count = series.time_s.len();
        let currents: Vec<[S; 2]> = (0..count).map(current).collect();
        let smoothed = |values: Vec<S>| -> Vec<S> {
            let curve = Curve::new(series.time_s, series.jump, &values);
            let times = series.time_s.iter().zip(&values);
            times
                .map(|(t, value)| {
                    let mean = curve.mean(-p[1] + *t, p[1] + *t);
                    *value + p[0] * (mean - *value) // (1)
                })
                .collect()
        };
        let part = |of: &dyn Fn(usize) -> [S; 2], i: usize| (0..count).map(|k| of(k)[i]).collect();
        let [v_re, v_im] = [0, 1].map(|i| smoothed(part(&u, i)));
        let [i_re, i_im] = [0, 1].map(|i| smoothed(part(&|k| currents[k], i)));
        for k in 0..count {
            let power = complex::product([v_re[k], v_im[k]], [i_re[k], -i_im[k]]);
            [series.active[k], series.reactive[k]] = power; // (2)
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::a_dip};

    #[test]
    fn the_residual_begins_before_the_dip_and_nothing_else_moves() {
        let input = a_dip(0.6, 0.0);
        let model = ComposedModel::new(&Structure::zip_im().with("phasor_window").unwrap());
        let drive = Drive::new(&input, &[], 0.3);
        let with = model.simulate(&model.typical(), &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        let apart = |k: usize| (with.active[k] - without.active[k]).abs();
        // Half width 20 ms, samples of 16.7 ms: sample 29, 17 ms before the edge, is touched.
        let times = input.output_points();
        let index = |sample: usize| times.iter().position(|p| *p == sample * 16).unwrap();
        assert!(apart(index(29)) > 1e-3);
        assert!(apart(index(27)) < 1e-12);
    }
}
