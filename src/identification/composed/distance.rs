//! How far an event is from what a fit foretells of it.
//!
//! What a fit foretells is as open as the events behind it have left its parameters. With the covariance `Sigma` of the
//! event's rows around the model, their derivatives `J` by the free parameters and the covariance `C` of these,
//!
//! ```text
//! d^2 = r' (Sigma + J C J')^-1 r = min_dx (r - J dx)' Sigma^-1 (r - J dx) + dx' C^-1 dx       (1)
//! ```
//!
//! is by how much the weighted squares of all events would rise by it at least, were the model fitted to it as well: as
//! far as the model is linear between the two fits. It is not in an effect's shapes, such as a delay that the events leave
//! open, so that (1) is taken from each of them as far to either side as its events are followed as well, too, and the
//! least of it counts. A threshold acts or does not: it has no column in `J`, which at a dip near it would let a relay take
//! off as much as one likes.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::{
    covariance::EventCovariance,
    fit::{ComposedFit, RISE_OF_LEFT, follows_as_well, squares},
    model::curves,
    rows::{EventRows, Scatter, random_effects},
};
use crate::{
    identification::{evaluate::Curves, intake::PreparedEvent},
    load_model::{composed::ComposedModel, effect::Parameter, effects},
};

/// Half the width of a uniform distribution, in its standard deviations.
const END: f64 = 1.732;
/// Shares of the way there that are tried, the farthest first.
const WAYS: [f64; 4] = [1.0, 0.75, 0.5, 0.25];

/// What events leave open of the shapes of one part of a fit to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Open {
    /// Where among the free parameters its threshold is.
    threshold: Option<usize>,
    /// The fit's parameters with one shape elsewhere.
    elsewhere: Vec<Vec<f64>>,
}

impl Open {
    /// Of the part `effect` of a fit to these events.
    #[must_use]
    pub fn of(
        events: &[PreparedEvent],
        fit: &ComposedFit,
        effect: &str,
        scatter: &Scatter,
    ) -> Self {
        let threshold = threshold(fit, effect);
        let left: f64 = fit.squares.iter().sum();
        let followed = |parameters: &Vec<f64>| {
            let squares = squares(events, &fit.model, parameters, scatter);
            squares.is_some_and(|own| follows_as_well(own.iter().sum(), left, RISE_OF_LEFT))
        };
        let mut elsewhere = Vec::new();
        for (place, &index) in fit.free.iter().enumerate() {
            let parameter = &fit.model.parameters()[index];
            let declared: &Parameter = &parameter.declaration;
            if parameter.effect != Some(effect) || declared.is_amplitude() {
                continue;
            }
            let Some(deviation) = fit.standard_error(index) else {
                continue;
            };
            for side in [-END, END] {
                let at = |way: &f64| {
                    let mut parameters = fit.parameters.clone();
                    let moved = parameters[index] + way * side * deviation;
                    parameters[index] = moved.clamp(declared.lower, declared.upper);
                    parameters
                };
                let mut ways = WAYS.iter().map(at);
                if threshold == Some(place) {
                    // What acts in part acts otherwise on the way, too.
                    elsewhere.extend(ways.filter(followed));
                } else {
                    elsewhere.extend(ways.find(followed));
                }
            }
        }
        Self {
            threshold,
            elsewhere,
        }
    }
}

/// What a fit foretells of an event.
#[derive(Debug)]
pub struct Foretold<'a> {
    fit: &'a ComposedFit,
    open: &'a Open,
    rows: EventRows<'a>,
    /// What was measured less the fit's answer.
    residual: DVector<f64>,
    /// `Sigma + J C J'`.
    covariance: EventCovariance,
}

impl<'a> Foretold<'a> {
    /// Of an event, whose P and Q do not matter. `None` where the fit has no covariance, or no response in the event.
    #[must_use]
    pub fn new(
        event: &'a PreparedEvent,
        fit: &'a ComposedFit,
        open: &'a Open,
        scatter: &Scatter,
    ) -> Option<Self> {
        let rows = EventRows::new(event);
        let (model, at) = (&fit.model, &fit.parameters);
        let random = random_effects(model, at, scatter);
        // What varies may be fixed.
        let fixed = (random.iter().map(|(index, _)| *index)).filter(|i| !fit.free.contains(i));
        let wanted: Vec<usize> = fit.free.iter().copied().chain(fixed).collect();
        let expanded = rows.expanded(model, at, &wanted).ok()?;
        let mut directions = open_directions(fit.covariance.as_ref()?)?;
        if let Some(place) = open.threshold {
            directions.row_mut(place).fill(0.0);
        }
        let own = rows.random_columns((&expanded, &wanted), &random, (model, at))?;
        let varying = own.ncols();
        let mut columns = own.resize_horizontally(varying + directions.ncols(), 0.0);
        columns
            .columns_mut(varying, directions.ncols())
            .copy_from(&(expanded.columns(0, fit.free.len()) * directions));
        Some(Self {
            residual: expanded.column(wanted.len()).into_owned(),
            covariance: rows.weighed(&columns)?,
            fit,
            open,
            rows,
        })
    }

    /// `d^2` of another load's answer to the event.
    #[must_use]
    pub fn distance(&self, answer: &Curves) -> Option<f64> {
        let answer = self.rows.of_samples(&answer.active, &answer.reactive);
        let moved = answer - self.rows.measured();
        let elsewhere = (self.open.elsewhere.iter())
            .filter_map(|parameters| self.rows.residual(&self.fit.model, parameters).ok());
        let squares = std::iter::once(self.residual.clone())
            .chain(elsewhere)
            .map(|residual| self.covariance.square(&(residual + &moved)))
            .min_by(f64::total_cmp)?;
        squares.is_finite().then_some(squares)
    }
}

/// What a model with these parameters answers to an event. `None` where it has no response in it.
#[must_use]
pub fn answer(event: &PreparedEvent, model: &ComposedModel, parameters: &[f64]) -> Option<Curves> {
    curves(model, parameters, event).ok()
}

/// Columns `B` with `B B' = C`, the covariance `C` taken by its correlations, so that units do not matter.
fn open_directions(covariance: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    if covariance.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let deviations = covariance
        .diagonal()
        .map(|variance| variance.max(0.0).sqrt());
    let scaled = |i: usize, j: usize| {
        let scale = deviations[i] * deviations[j];
        if scale > 0.0 {
            covariance[(i, j)] / scale
        } else {
            0.0
        }
    };
    let size = covariance.nrows();
    let correlations = DMatrix::from_fn(size, size, scaled);
    let SymmetricEigen {
        eigenvectors: mut columns,
        eigenvalues,
    } = SymmetricEigen::new(correlations);
    for (mut column, value) in columns.column_iter_mut().zip(&eigenvalues) {
        column *= value.max(0.0).sqrt();
        column.component_mul_assign(&deviations);
    }
    Some(columns)
}

/// Where among the free parameters the threshold of an effect is.
fn threshold(fit: &ComposedFit, effect: &str) -> Option<usize> {
    let name = effects::find(effect)?.threshold()?;
    let index = fit.model.index(&format!("{effect}.{name}"))?;
    fit.free.iter().position(|free| *free == index)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_have_the_covariance_whatever_the_units() {
        let root =
            DMatrix::from_row_slice(3, 3, &[1e-4, 0.0, 0.0, 30.0, 20.0, 0.0, 0.1, -0.2, 0.0]);
        let covariance = &root * root.transpose();
        let columns = open_directions(&covariance).unwrap();
        let again = &columns * columns.transpose();
        for (found, expected) in again.iter().zip(covariance.iter()) {
            assert!((found - expected).abs() <= 1e-12 * expected.abs().max(1e-12));
        }
        let unknown = DMatrix::from_element(2, 2, f64::NAN);
        assert!(open_directions(&unknown).is_none());
    }
}
