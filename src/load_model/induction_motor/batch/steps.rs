//! An input cut into the steps that lanes take together.

use super::super::{
    input_pieces::{Piece, for_each_piece},
    taylor::input_beyond,
};
use crate::load_model::{TerminalInput, terminal::DENSE_POINTS};

/// One step that all lanes take together.
#[derive(Debug)]
pub(super) struct Step {
    pub(super) part: Part,
    /// The phasor at the output instant at the end of this step, if there is one.
    pub(super) output: Option<[f64; 2]>,
}

/// What a step needs to know of the input.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    pub(super) piece: Piece,
    pub(super) duration_s: f64,
    /// What the input still adds beyond orders 4, 6 and 8.
    pub(super) beyond: [f64; 3],
}

impl Part {
    #[inline(always)]
    fn new(piece: Piece, duration_s: f64) -> Self {
        Self {
            beyond: [4, 6, 8].map(|order: usize| input_beyond(&piece, order)),
            piece,
            duration_s,
        }
    }

    #[inline(always)]
    pub(super) fn left_half(&self) -> Self {
        Self::new(self.piece.shortened(2), 0.5 * self.duration_s)
    }

    /// The part of the same length that follows.
    #[inline(always)]
    pub(super) fn following(&self) -> Self {
        Self::new(self.piece.next(), self.duration_s)
    }
}

/// The steps of the whole input for motors that take `parts` per sample.
pub(super) fn steps(input: &TerminalInput, parts: usize) -> Vec<Step> {
    let samples = input.sample_count();
    let mut steps = Vec::with_capacity(samples * parts);
    let fine_s = input.sample_interval_s / input.points_per_sample as f64;
    let longest_s = input.sample_interval_s / parts as f64;
    let apart = input.points_per_sample / DENSE_POINTS;
    for sample in 0..samples.saturating_sub(1) {
        let origin = sample * input.points_per_sample;
        let dense = input.dense[sample];
        for_each_piece(input, sample, |piece, start, length| {
            let shares = if dense { (length / apart).max(1) } else { 1 };
            let mut share = if shares == 1 {
                *piece
            } else {
                piece.shortened(shares)
            };
            for i in 0..shares {
                halve(
                    &share,
                    fine_s * (length / shares) as f64,
                    longest_s,
                    &mut steps,
                );
                let end = start + (i + 1) * (length / shares) - origin;
                let at_sample = end == input.points_per_sample;
                if let Some(last) = steps.last_mut()
                    && (at_sample || dense && end.is_multiple_of(apart))
                {
                    last.output = Some(input.point(origin + end));
                }
                if i + 1 < shares {
                    share = share.next();
                }
            }
        });
    }
    steps
}

fn halve(piece: &Piece, duration_s: f64, longest_s: f64, steps: &mut Vec<Step>) {
    if duration_s <= longest_s * (1.0 + 1e-12) {
        steps.push(Step {
            part: Part::new(*piece, duration_s),
            output: None,
        });
        return;
    }
    let left = piece.shortened(2);
    halve(&left, 0.5 * duration_s, longest_s, steps);
    halve(&left.next(), 0.5 * duration_s, longest_s, steps);
}
