//! The last fit of a structure: what varies from event to event as narrow as the events allow.
//!
//! A fit that lets the composition of each event vary widely hardly pays when all events deviate to
//! the same side, so its shared parameters, which are published and by which errors are quoted, may
//! lie anywhere within that spread. Begun narrowly, the shared parameters explain what they can, and
//! the spread is widened only where the events then still disagree (decision 0034).

use super::{
    band::bands,
    fit::{ComposedFit, ComposedFitOptions, fit_rows, squares},
    quoted::{self, Quoted},
    rows::{EventRows, Scatter},
    spread::{NARROWEST, Spreads},
};
use crate::{identification::intake::PreparedEvent, load_model::effect::Role};

/// A fit that leaves more than this per row does not follow the events: nothing is gained by moving it.
const FOLLOWED: f64 = 4.0;
/// A fit whose events may differ more is not taken where it leaves so many times what the narrowest leaves, once
/// no event differs from another.
const SHARED: f64 = 4.0;

/// `fit` moved to where the events agree best on the shared parameters, with no more spread
/// than the events need there, at most that of `options`. As it was where it does not follow the
/// events, or where no fit of narrower spread is found.
///
/// Its covariance is not that of the narrowest spread: few events that happen to agree do not show how much the composition
/// varies, and errors stated as if it did not vary are too small (decision 0048). It is that of the spread which the events
/// show (`spread`, decision 0110), for an estimate that was made under another one, corrected where its curvature
/// is a poor guide to errors (decision 0059). A threshold that lies between two dips stays in their
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
    let spreads = |fit: &ComposedFit| Spreads::new(&rows, fit, options, cancel);
    let shown = spreads(fit).map_or([1.0; 2], |spreads| spreads.shown());
    let stated = ComposedFitOptions {
        scatter: options.scatter.times(shown),
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
        let narrowest = again(&begun, NARROWEST)?;
        let shares = spreads(&narrowest)?.sufficient()?;
        if shares == NARROWEST {
            return Some((narrowest, shares));
        }
        let widened = again(&narrowest, shares);
        let shared = widened.filter(|widened| is_shared(events, [&narrowest, widened], options));
        Some(shared.map_or((narrowest, NARROWEST), |widened| (widened, shares)))
    };
    let (mut moved, shares) = moved().unwrap_or_else(|| (fit.clone(), [1.0; 2]));
    moved.free.clone_from(&fit.free);
    if fit.covariance.is_some() {
        let weighed = options.scatter.times(shares);
        let covariance = quoted.and_then(|quoted| quoted.of_estimate(&rows, &bands, &weighed));
        moved.covariance = covariance.or_else(|| fit.covariance.clone());
    }
    moved
}

/// The spread between events that these show under the parameters of a fit, at most that of `options`: the narrowest that
/// [`narrowed`] would take. `None` where they cannot be simulated.
#[must_use]
pub fn sufficient_scatter(
    events: &[PreparedEvent],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Scatter> {
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    let shares = Spreads::new(&rows, fit, options, cancel)?.sufficient()?;
    Some(options.scatter.times(shares))
}

/// Whether the second fit, whose events may differ more, is for all of them together about as good as the first
/// is: if not, it describes events with shares of their own and none with those that are published.
pub(super) fn is_shared(
    events: &[PreparedEvent],
    [narrowest, widened]: [&ComposedFit; 2],
    options: &ComposedFitOptions,
) -> bool {
    let [narrowest, widened] = [narrowest, widened].map(|fit| left_of_alike(events, fit, options));
    let most = narrowest.map_or(f64::INFINITY, |narrowest| SHARED * narrowest);
    widened.is_some_and(|widened| widened <= most)
}

/// Weighted squares that `fit` leaves of all events, per row, none of them differing from another. `None` where one cannot
/// be simulated.
#[must_use]
pub fn left_of_alike(
    events: &[PreparedEvent],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
) -> Option<f64> {
    let alike = options.scatter.times([0.0; 2]);
    let squares = squares(events, &fit.model, &fit.parameters, &alike)?;
    let rows: usize = events.iter().map(PreparedEvent::rows).sum();
    Some(squares.iter().sum::<f64>() / rows.max(1) as f64)
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
