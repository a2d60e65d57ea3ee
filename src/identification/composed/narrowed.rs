//! The last fit of a structure: what varies from event to event as narrow as the events allow.
//!
//! A fit that lets the composition of each event vary widely hardly pays when all events deviate to
//! the same side, so its shared parameters, which are published and by which errors are quoted, may
//! lie anywhere within that spread. Begun narrowly, the shared parameters explain what they can, and
//! the spread is widened only where the events then still disagree (decision 0034).

use super::{
    band::bands,
    coordinates::Coordinates,
    covariance::EventCovariance,
    fit::{ComposedFit, ComposedFitOptions, Place, fit_rows, squares},
    quoted::{self, Quoted},
    rows::{EventRows, Scatter},
};
use crate::{identification::intake::PreparedEvent, load_model::effect::Role};

/// Shares of the assumed spread, narrowest first.
const SHARES: [f64; 5] = [0.062_5, 0.125, 0.25, 0.5, 1.0];
/// A fit that leaves more than this per row does not follow the events: nothing is gained by moving it.
const FOLLOWED: f64 = 4.0;
/// Likelihoods that differ by less than this share of the weighted squares that are left are not told
/// apart: what is left is not independent from sample to sample.
const TOLD_SHARE_OF_LEFT: f64 = 0.03;

/// A fit whose events may differ more is not taken where it leaves so many times what the narrowest leaves, once
/// no event differs from another.
const SHARED: f64 = 4.0;

/// `fit` moved to where the events agree best on the shared parameters, with no more spread
/// than the events need there, at most that of `options`. As it was where it does not follow the
/// events, or where no fit of narrower spread is found.
///
/// Its covariance stays that of `fit`: few events that happen to agree do not show how much the composition
/// varies, and errors stated as if it did not vary are too small (decision 0048), corrected where its curvature is a
/// poor guide to errors (decision 0059). Effects' shares, which single events determine, are taken to vary as they
/// are seen to (decision 0088). A threshold that lies between two dips stays in their
/// middle, where `fit` has it: nothing else draws it anywhere. So does the beginning of a band of voltages at the mean of
/// where it may be (decision 0096).
#[must_use]
pub fn narrowed(
    events: &[PreparedEvent],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> ComposedFit {
    if fit.chi_square_per_row() > FOLLOWED {
        return fit.clone();
    }
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    let shown = shown_spread_of_effects(&rows, fit, options, cancel);
    let stated = ComposedFitOptions {
        scatter: options.scatter.times([1.0, shown.unwrap_or(1.0)]),
        ..*options
    };
    let bands = bands(&rows, fit, &stated, cancel);
    let quoted = quoted::quoted(&rows, &bands, &stated, cancel);
    let begun = held(&bands.fit, quoted.as_ref());
    // A relay's settings have corners at which a step along all parameters at once goes nowhere.
    let smooth = without_shapes(&begun);
    let again = |from: &ComposedFit, shares: [f64; 2]| {
        let options = ComposedFitOptions {
            scatter: options.scatter.times(shares),
            ..*options
        };
        let of = |start: &[f64], free: &[usize]| {
            fit_rows(&rows, &from.model, start, free, &options, cancel)
        };
        if smooth == from.free {
            return of(&from.parameters, &from.free);
        }
        let eased = of(&from.parameters, &smooth)?;
        of(&eased.parameters, &from.free)
    };
    let moved = || {
        let narrowest = again(&begun, [SHARES[0]; 2])?;
        let shares = sufficient_shares(&rows, &narrowest, options, cancel)?;
        if shares == [SHARES[0]; 2] {
            return Some(narrowest);
        }
        let widened = again(&narrowest, shares);
        let shared = widened.filter(|widened| is_shared(events, [&narrowest, widened], options));
        Some(shared.unwrap_or(narrowest))
    };
    let mut moved = moved().unwrap_or_else(|| fit.clone());
    moved.free.clone_from(&fit.free);
    if fit.covariance.is_some() {
        let covariance = quoted.map(|quoted| quoted.covariance);
        moved.covariance = covariance.or_else(|| fit.covariance.clone());
    }
    moved
}

/// The spread between events that these show under the parameters of a fit, at most that of `options`: the narrowest that
/// [`narrowed`] would take. `None` where they cannot be simulated.
#[must_use]
pub fn shown_scatter(
    events: &[PreparedEvent],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Scatter> {
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    let shares = sufficient_shares(&rows, fit, options, cancel)?;
    Some(options.scatter.times(shares))
}

/// Whether the second fit, whose events may differ more, is for all of them together about as good as the first
/// is: if not, it describes events with shares of their own and none with those that are published.
pub(super) fn is_shared(
    events: &[PreparedEvent],
    [narrowest, widened]: [&ComposedFit; 2],
    options: &ComposedFitOptions,
) -> bool {
    let alike = options.scatter.times([0.0; 2]);
    let left = |fit: &ComposedFit| {
        let squares = squares(events, &fit.model, &fit.parameters, &alike)?;
        Some(squares.iter().sum::<f64>())
    };
    let most = left(narrowest).map_or(f64::INFINITY, |narrowest| SHARED * narrowest);
    left(widened).is_some_and(|widened| widened <= most)
}

/// `fit` with the thresholds not free that stay where it has them.
fn held(fit: &ComposedFit, quoted: Option<&Quoted>) -> ComposedFit {
    let mut held = fit.clone();
    let places = quoted.map_or(&[][..], |quoted| &quoted.staying);
    for place in places.iter().rev() {
        held.free.remove(*place);
    }
    held
}

/// What is free in a fit but for the shapes of effects.
fn without_shapes(fit: &ComposedFit) -> Vec<usize> {
    let parameters = fit.model.parameters();
    let free = fit.free.iter().copied();
    free.filter(|&i| parameters[i].declaration.role != Role::Shape)
        .collect()
}

/// The narrowest shares of the spreads under which the events are about as likely as under the best ones,
/// with the parameters of `fit`.
fn sufficient_shares(
    rows: &[EventRows<'_>],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<[f64; 2]> {
    let all = SHARES.iter().flat_map(|c| SHARES.iter().map(|e| [*c, *e]));
    let tried = likelihoods(rows, fit, options, all, cancel)?;
    let by_likelihood = |a: &&Likelihood, b: &&Likelihood| {
        a.minus_twice_logarithm.total_cmp(&b.minus_twice_logarithm)
    };
    let best = tried.iter().min_by(by_likelihood)?;
    let most = best.minus_twice_logarithm + TOLD_SHARE_OF_LEFT * best.squares;
    let enough = tried.iter().find(|t| t.minus_twice_logarithm <= most)?;
    Some(enough.shares)
}

/// The share of the spread of effects' shares that the events show: the root of the mean of its square, every share
/// weighted with its likelihood (and so all alike where no event says anything of it).
fn shown_spread_of_effects(
    rows: &[EventRows<'_>],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<f64> {
    let all = SHARES.iter().map(|effects| [1.0, *effects]);
    let tried = likelihoods(rows, fit, options, all, cancel)?;
    // What is left is not independent from sample to sample.
    let persistence = fit.chi_square_per_row().max(1.0);
    let least = (tried.iter()).fold(f64::INFINITY, |least, t| t.minus_twice_logarithm.min(least));
    let weight = |t: &Likelihood| (-0.5 * (t.minus_twice_logarithm - least) / persistence).exp();
    let all: f64 = tried.iter().map(weight).sum();
    let squares = tried.iter().map(|t| weight(t) * t.shares[1].powi(2));
    Some((squares.sum::<f64>() / all).sqrt())
}

/// How likely the events are under shares of the spreads, with the parameters of `fit`.
fn likelihoods(
    rows: &[EventRows<'_>],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    shares: impl Iterator<Item = [f64; 2]>,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<Likelihood>> {
    let coordinates = Coordinates::new(&fit.model, &fit.parameters, &fit.free);
    let x = coordinates.unknowns(&fit.parameters);
    let mut known = None;
    let mut tried: Vec<Likelihood> = Vec::new();
    for shares in shares {
        let scatter = options.scatter.times(shares);
        let place = Place {
            rows,
            model: &fit.model,
            coordinates: &coordinates,
            scatter: &scatter,
            cancel,
        };
        let problem = place.problem(&x, known)?;
        let squares: f64 = problem.known_squares()?.iter().sum();
        let determinants = problem
            .covariances
            .iter()
            .map(EventCovariance::log_determinant);
        tried.push(Likelihood {
            shares,
            minus_twice_logarithm: squares + determinants.sum::<f64>(),
            squares,
        });
        known = problem.into_lowest();
    }
    Some(tried)
}

/// How well a pair of shares explains the events.
struct Likelihood {
    shares: [f64; 2],
    minus_twice_logarithm: f64,
    squares: f64,
}
