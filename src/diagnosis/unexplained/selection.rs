//! How many terms are kept: as many as help on events that neither chose nor fitted them.
//!
//! A motor that was fitted to what it cannot follow is a wrong motor, and what it does wrong in the
//! first cycles is larger than many an effect. So terms are first sought beside all lags that a motor
//! of other parameters could add, which are free then; only when that does not describe what is left
//! do these lags count as terms themselves.

use super::{
    pursuit::{TERMS_MAX, coefficients, pursue, squares},
    rows::Rows,
    term::Term,
};

/// Folds of the cross-validation.
const FOLDS: usize = 5;
/// A further term must take this share off what is left above the noise, on events left out.
const SHARE_MIN: f64 = 0.05;
/// The same on the fitted events where there is no event to leave out.
const SHARE_MIN_ONE_EVENT: f64 = 0.2;
/// A channel in which a term takes less than this share of its gain is left out.
const CHANNEL_MIN: f64 = 0.03;

/// A term that is kept.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Chosen {
    pub(super) term: usize,
    /// Lowest and highest threshold that do as well.
    pub(super) thresholds: Option<[f64; 2]>,
    /// Coefficients of P and Q; exactly zero where a channel does not show it.
    pub(super) coefficients: [f64; 2],
    /// Shares of the squares that it takes off.
    pub(super) shares: [f64; 2],
    /// Largest power it adds in any event, pu of P0, for the larger coefficient.
    pub(super) largest_pu: f64,
}

/// The sparse description.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Description {
    pub(super) chosen: Vec<Chosen>,
    /// Squares per row before any term.
    pub(super) squares_per_row: f64,
    /// Share of the squares above noise that the terms take off on events left out; none with one
    /// event.
    pub(super) held_out_share: Option<f64>,
}

/// Share of what is left above the noise, on events left out, that terms beside free lags must take off
/// for these lags to stay free.
const CONVINCING: f64 = 0.3;

pub(super) fn select(rows: &Rows, terms: &[Term]) -> Description {
    let beside_motor = select_from(&rows.with_free(terms, &Term::is_like_a_motor), terms);
    let share = beside_motor.held_out_share.unwrap_or(1.0);
    if !beside_motor.chosen.is_empty() && share > CONVINCING {
        return beside_motor;
    }
    let all = select_from(rows, terms);
    if all.chosen.is_empty() && !beside_motor.chosen.is_empty() {
        return beside_motor;
    }
    all
}

fn select_from(rows: &Rows, terms: &[Term]) -> Description {
    let path = pursue(rows, terms);
    let left_out = (rows.events() > 1).then(|| left_out_squares(rows, terms));
    let noise = 2.0 * rows.count() as f64;
    let (kept, held_out_share) = match &left_out {
        Some(squares) => (
            helpful(squares, noise).min(path.steps.len()),
            Some(share(squares, noise)),
        ),
        None => (one_event(&path.steps, path.squares, noise), None),
    };
    let indices: Vec<usize> = path.steps[..kept].iter().map(|s| s.term).collect();
    let fitted = [0, 1].map(|c| coefficients(rows, c, &indices));
    let chosen = path.steps[..kept].iter().enumerate().map(|(k, step)| {
        let gain = step.gains[0] + step.gains[1];
        let shown = [0, 1].map(|c: usize| step.gains[c] > CHANNEL_MIN * gain);
        let own = [0, 1].map(|c: usize| {
            if shown[c] {
                fitted[c][rows.free[c].len() + k]
            } else {
                0.0
            }
        });
        let largest = rows.largest[step.term]
            .iter()
            .fold(0.0_f64, |m, x| m.max(*x));
        Chosen {
            term: step.term,
            thresholds: step.thresholds,
            coefficients: own,
            shares: [0, 1].map(|c: usize| step.gains[c] / path.squares.max(f64::MIN_POSITIVE)),
            largest_pu: largest * own[0].abs().max(own[1].abs()),
        }
    });
    Description {
        chosen: chosen.collect(),
        squares_per_row: path.squares / noise.max(1.0),
        held_out_share,
    }
}

/// Squares on the events left out with 0, 1, ... terms, terms chosen and fitted without them. Only
/// the free columns, which the model would refit, follow these events.
fn left_out_squares(rows: &Rows, terms: &[Term]) -> [f64; TERMS_MAX + 1] {
    let folds = FOLDS.min(rows.events());
    let mut sums = [0.0; TERMS_MAX + 1];
    for fold in 0..folds {
        let train = rows.of_events(&|e| e % folds != fold);
        let test = rows.of_events(&|e| e % folds == fold);
        let path = pursue(&train, terms);
        for (count, sum) in sums.iter_mut().enumerate() {
            let kept = count.min(path.steps.len());
            let chosen: Vec<usize> = path.steps[..kept].iter().map(|s| s.term).collect();
            for channel in 0..2 {
                let fitted = coefficients(&train, channel, &chosen);
                *sum += squares(
                    &test,
                    channel,
                    &chosen,
                    &fitted[train.free[channel].len()..],
                );
            }
        }
    }
    sums
}

/// As many terms as take enough off, one after the other.
fn helpful(squares: &[f64; TERMS_MAX + 1], noise: f64) -> usize {
    let mut kept = 0;
    for count in 1..squares.len() {
        let above = (squares[kept] - noise).max(0.0);
        let gain = squares[kept] - squares[count];
        if gain > SHARE_MIN * above && gain > price(noise) {
            kept = count;
        }
    }
    kept
}

/// What chance may gain on events left out: it mostly loses there.
fn price(noise: f64) -> f64 {
    noise.max(2.0).ln()
}

fn share(squares: &[f64; TERMS_MAX + 1], noise: f64) -> f64 {
    let kept = helpful(squares, noise);
    let above = (squares[0] - noise).max(f64::MIN_POSITIVE);
    ((squares[0] - squares[kept]) / above).clamp(0.0, 1.0)
}

fn one_event(steps: &[super::pursuit::Step], squares: f64, noise: f64) -> usize {
    let mut left = squares;
    let mut kept = 0;
    for step in steps {
        let gain = step.gains[0] + step.gains[1];
        if gain < SHARE_MIN_ONE_EVENT * (left - noise) || gain < 2.0 * step.price {
            break;
        }
        left -= gain;
        kept += 1;
    }
    kept
}
