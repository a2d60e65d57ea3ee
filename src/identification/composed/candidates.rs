//! Which of the candidates that a screen found refits start from.

use super::screening::Candidate;

/// Candidates that leave more than this multiple of what the best one leaves are not refitted.
const LEFT_MAX: f64 = 1.5;
/// Candidates whose gains differ by less than this share, and whose amplitudes do too, are one.
const ALIKE: f64 = 1e-3;
/// Least gain of a candidate worth a refit: two standard errors of one amplitude.
const GAIN_MIN: f64 = 4.0;
/// Least part of the effect that the fitted model must not be able to mimic.
const VISIBILITY_MIN: f64 = 1e-4;

/// Whether a candidate is worth a refit.
pub(super) fn promises(candidate: &Candidate) -> bool {
    candidate.score.gain > GAIN_MIN && candidate.score.visibility > VISIBILITY_MIN
}

/// At most so many `starts`: the best candidate of every origin first, for what is left of a bad fit by a linear
/// extrapolation and what is left of a good one do not compare, then others that are not one and the same.
pub(super) fn distinct(
    mut sorted: Vec<(usize, Candidate)>,
    starts: usize,
) -> Vec<(usize, Candidate)> {
    let mut chosen: Vec<(usize, Candidate)> = Vec::new();
    let limit = (sorted.first()).map_or(f64::INFINITY, |(_, best)| LEFT_MAX * best.left);
    let mut seen: Vec<usize> = Vec::new();
    let mut first = |number: usize| {
        let new = !seen.contains(&number);
        if new {
            seen.push(number);
        }
        new
    };
    let (firsts, others): (Vec<_>, Vec<_>) =
        sorted.drain(..).partition(|(number, _)| first(*number));
    let others = others.into_iter().filter(|(_, c)| c.left <= limit);
    for (number, candidate) in firsts.into_iter().chain(others) {
        let near = |a: f64, b: f64| (a - b).abs() <= ALIKE * a.abs().max(b.abs());
        let alike = |(other, known): &(usize, Candidate)| {
            let pairs = (known.score.amplitudes.iter()).zip(&candidate.score.amplitudes);
            *other == number
                && near(known.score.gain, candidate.score.gain)
                && pairs.fold(true, |all, (a, b)| all && near(*a, *b))
        };
        if chosen.len() < starts && !chosen.iter().any(alike) {
            chosen.push((number, candidate));
        }
    }
    chosen
}
