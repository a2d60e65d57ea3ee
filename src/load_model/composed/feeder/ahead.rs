//! Where the phasor at a load behind a feeder goes in the next step.
//!
//! It depends on the states at the end of the step, which depend on it. It moves as smoothly as the states do, so
//! that its way through the next step is that of the polynomial through where it is and where it was at the beginning
//! of the last two steps,
//!
//! ```text
//! r(t) = r_0 + t r[0, 1] + t (t + h_1) r[0, 1, 2]                    (1)
//! ```
//!
//! with divided differences over the lengths `h_1` of the last step and `h_2` of the one before. At the end of the step it
//! is solved for once. After a jump, and where the steps grow longer, there is no such way.

use super::super::complex;
use crate::numerics::Scalar;

/// A step may be so many times as long as the one before it.
const LONGER_MAX: f64 = 2.001;

/// The ratio of the phasors at the beginning of a step, and how long that was, s.
#[derive(Clone, Copy, Debug)]
struct Passed<S> {
    ratio: [S; 2],
    duration_s: f64,
}

/// The last two steps since the last jump, the later one first.
#[derive(Clone, Copy, Debug)]
pub(in crate::load_model::composed) struct Way<S>([Option<Passed<S>>; 2]);

impl<S: Scalar> Way<S> {
    /// Nothing known.
    pub(in crate::load_model::composed) const UNKNOWN: Self = Self([None; 2]);

    /// Adds a step that began at `ratio`.
    pub(in crate::load_model::composed) fn add(&mut self, ratio: [S; 2], duration_s: f64) {
        let step = Passed { ratio, duration_s };
        self.0 = [Some(step), self.0[0]];
    }

    /// (1) in the middle and at the end of the next step, from `ratio`; none where too little is known.
    pub(in crate::load_model::composed) fn ahead(
        &self,
        ratio: [S; 2],
        duration_s: f64,
    ) -> Option<[[S; 2]; 2]> {
        let last = self.0[0].filter(|last| duration_s <= LONGER_MAX * last.duration_s)?;
        let slope = |from: [S; 2], to: [S; 2], over_s: f64| {
            complex::difference(to, from).map(|part| part * over_s.recip())
        };
        let first = slope(last.ratio, ratio, last.duration_s);
        let bend = self.0[1].map(|earlier| {
            let before = slope(earlier.ratio, last.ratio, earlier.duration_s);
            slope(before, first, last.duration_s + earlier.duration_s)
        });
        let at = |t: f64| {
            let line = complex::sum(ratio, first.map(|part| part * t));
            bend.map_or(line, |bend| {
                complex::sum(line, bend.map(|part| part * (t * (t + last.duration_s))))
            })
        };
        Some([at(0.5 * duration_s), at(duration_s)])
    }
}

#[cfg(test)]
mod tests {
    use super::Way;

    #[test]
    fn a_parabola_is_gone_on_with_whatever_the_steps() {
        let parabola = |t: f64| [1.0 - 0.3 * t + 0.7 * t * t, 0.1 + 2.0 * t - 5.0 * t * t];
        let mut way = Way::UNKNOWN;
        way.add(parabola(0.2), 0.05);
        way.add(parabola(0.25), 0.1);
        let ahead = way.ahead(parabola(0.35), 0.08).unwrap();
        for (found, t) in ahead.iter().zip([0.39, 0.43]) {
            let expected = parabola(t);
            assert!((found[0] - expected[0]).abs() < 1e-12, "{t}");
            assert!((found[1] - expected[1]).abs() < 1e-12, "{t}");
        }
    }

    #[test]
    fn nothing_is_foreseen_without_a_step_or_far_ahead() {
        let mut way = Way::UNKNOWN;
        assert!(way.ahead([1.0, 0.0], 0.01).is_none());
        way.add([1.0, 0.0], 0.01);
        let line = way.ahead([1.1, 0.2], 0.01).unwrap();
        for (found, expected) in line.iter().zip([[1.15, 0.3], [1.2, 0.4]]) {
            assert!((found[0] - expected[0]).abs() < 1e-12);
            assert!((found[1] - expected[1]).abs() < 1e-12);
        }
        assert!(way.ahead([1.1, 0.2], 0.04).is_none());
    }
}
