//! Output instants and substeps of one input.

use super::Accuracy;
use crate::load_model::{TerminalInput, terminal::DENSE_POINTS};

/// Fewest substeps per sample and longest of the Runge-Kutta steps, `rate * step <= this` (measured by a
/// test of `composed`).
const FULL: (usize, f64) = (2, 0.5);
const ROUGH: (usize, f64) = (1, 1.5);
/// Substeps per sample at most.
const SUBSTEPS_MAX: usize = 256;

/// What the passes over one input share.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Output instants, s.
    pub(super) time_s: Vec<f64>,
    /// Measured phasor at the output instants.
    pub(super) phasor: Vec<[f64; 2]>,
    /// Its modulus.
    pub(super) voltage: Vec<f64>,
    /// Whether the phasor jumps between an output instant and the next.
    pub(super) jump: Vec<bool>,
    accuracy: Accuracy,
}

impl Grid {
    /// Of an input, for states integrated to an accuracy.
    #[must_use]
    pub fn new(terminal: &TerminalInput, accuracy: Accuracy) -> Self {
        let points = terminal.output_points();
        let fine_s = terminal.sample_interval_s / terminal.points_per_sample as f64;
        let phasor: Vec<[f64; 2]> = points
            .iter()
            .map(|&i| [terminal.real[i], terminal.imaginary[i]])
            .collect();
        let jumps = |i: &usize| terminal.jumps.get(i / terminal.points_per_sample) == Some(&true);
        Self {
            time_s: points.iter().map(|&i| i as f64 * fine_s).collect(),
            voltage: phasor
                .iter()
                .map(|[re, im]| (re * re + im * im).sqrt())
                .collect(),
            phasor,
            jump: points.iter().map(jumps).collect(),
            accuracy,
        }
    }

    /// Substeps between a sample and the next, a power of two, and the output instants among them.
    pub(super) fn substeps(
        &self,
        terminal: &TerminalInput,
        sample: usize,
        rate_per_s: f64,
    ) -> (usize, usize) {
        let (mut substeps, longest) = match self.accuracy {
            Accuracy::Full => FULL,
            Accuracy::Rough => ROUGH,
        };
        let interval_s = terminal.sample_interval_s;
        while substeps < SUBSTEPS_MAX && rate_per_s * interval_s / substeps as f64 > longest {
            substeps *= 2;
        }
        if terminal.jumps[sample] {
            substeps = substeps.max(terminal.points_per_sample);
        }
        if terminal.dense[sample] {
            return (substeps.max(DENSE_POINTS), DENSE_POINTS);
        }
        (substeps, 1)
    }

    /// The phasor at the start, in the middle and at the end of a substep.
    #[allow(
        clippy::unused_self,
        reason = "kept beside what else belongs to the grid"
    )]
    pub(super) fn phasors(
        &self,
        terminal: &TerminalInput,
        sample: usize,
        j: usize,
        substeps: usize,
    ) -> [[f64; 2]; 3] {
        let points = terminal.points_per_sample;
        let origin = sample * points;
        if points.is_multiple_of(2 * substeps) {
            let half = points / (2 * substeps);
            let at = |i: usize| [terminal.real[i], terminal.imaginary[i]];
            let left = origin + 2 * j * half;
            return [at(left), at(left + half), at(left + 2 * half)];
        }
        let half = points as f64 / (2 * substeps) as f64;
        [0, 1, 2].map(|i| between(terminal, origin, (2 * j + i) as f64 * half))
    }
}

/// The phasor `ahead` fine grid points after `origin`, linear between grid points.
fn between(terminal: &TerminalInput, origin: usize, ahead: f64) -> [f64; 2] {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at least 0 and at most the points of a sample"
    )]
    let whole = ahead as usize;
    let below = (origin + whole).min(terminal.real.len() - 1);
    let above = (below + 1).min(terminal.real.len() - 1);
    let share = ahead - whole as f64;
    [&terminal.real, &terminal.imaginary].map(|x| x[below] + share * (x[above] - x[below]))
}
