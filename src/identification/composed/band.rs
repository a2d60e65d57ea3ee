//! The voltage at which a band begins in which devices let go one after the other.
//!
//! Dips lie above the band and below it, and what happens inside shows for a few samples while the voltage passes
//! through. Where it begins trades with its width, with the share and with the delays, so that the objective hardly changes
//! over a tenth of the voltage and rises like a wall where the next dip is reached: no curvature says that. Here the voltage
//! is held at one place after the other, everything else is fitted again, and what is known of it is taken from all of them,
//!
//! ```text
//! w_k = exp(-(l_k - min l) / (2 T)),   V = sum w_k V_k / sum w_k                                       (1)
//! cov = E[cov(x | V)] + cov(E[x | V]) = A_-V^-1 + sum w_k (x_k - x)(x_k - x)' / sum w_k                (2)
//! ```
//!
//! with `l_k` minus twice the logarithm of the posterior there, `T` the misfit per row where that is above 1 (residuals last),
//! `x_k` all unknowns of that fit, `x` their mean, and `A_-V` the curvature with the voltage held.
//!
//! Source: (2) is the law of total covariance.

use nalgebra::{DMatrix, DVector};

use super::{
    coordinates::Coordinates,
    fit::{ComposedFit, ComposedFitOptions, fit_rows},
    rows::EventRows,
};
use crate::{load_model::effects, numerics::local_solver};

/// Distance between places, pu; what lies between two is as likely as they are.
const STEP: f64 = 0.02;
/// Places at most to each side.
const STEPS_MAX: usize = 8;
/// The likelihood falls by `exp(-9/2)` on the way to the last place.
const FALL: f64 = 9.0;
/// Calls of the objective at most for one place.
const EVALUATIONS_MAX: u64 = 12;
/// A fit of a place ends when a step promises less than this share of the objective: a tenth of a unit.
const DECREASE_RELATIVE: f64 = 3e-5;

/// Where bands begin, as far as the events say.
pub(super) struct Bands {
    /// The fit with their voltages at the mean of (1), everything else fitted.
    pub(super) fit: ComposedFit,
    /// Places of these voltages among what is free.
    pub(super) places: Vec<usize>,
    /// Second part of (2) for each, by the unknowns.
    pub(super) spreads: Vec<DMatrix<f64>>,
}

/// The bands of the fit's effects whose beginning the events leave open by more than [`STEP`], one after the other.
pub(super) fn bands(
    rows: &[EventRows<'_>],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Bands {
    let mut found = Bands {
        fit: fit.clone(),
        places: Vec::new(),
        spreads: Vec::new(),
    };
    let settings = ComposedFitOptions {
        rounds_max: 1,
        local: local_solver::Options {
            evaluations_max: EVALUATIONS_MAX,
            decrease_relative: DECREASE_RELATIVE,
            ..options.local
        },
        ..*options
    };
    for [voltage, width] in ends(fit) {
        let walk = Walk {
            rows,
            fit: &found.fit,
            index: voltage,
            width,
            options: &settings,
            cancel,
        };
        let Some((place, at, spread)) = walk.mean() else {
            continue;
        };
        found.fit = at;
        found.places.push(place);
        found.spreads.push(spread);
    }
    found
}

/// The beginning and the width of every band that is free.
fn ends(fit: &ComposedFit) -> Vec<[usize; 2]> {
    let ends = |name: &str| {
        let effect = effects::find(name)?;
        let [voltage, width] = effect
            .band()?
            .map(|own| fit.model.index(&format!("{name}.{own}")));
        let both = [voltage?, width?];
        (both.iter().all(|i| fit.free.contains(i))).then_some(both)
    };
    fit.model.effect_names().filter_map(ends).collect()
}

/// The walk along the beginning of one band.
struct Walk<'a> {
    rows: &'a [EventRows<'a>],
    fit: &'a ComposedFit,
    index: usize,
    width: usize,
    options: &'a ComposedFitOptions,
    cancel: &'a (dyn Fn() -> bool + Sync),
}

impl Walk<'_> {
    /// The place of the voltage, the fit at its mean, and the second part of (2); `None` where the next place to neither
    /// side is about as likely.
    fn mean(&self) -> Option<(usize, ComposedFit, DMatrix<f64>)> {
        let place = self.fit.free.iter().position(|i| *i == self.index)?;
        let walked = self.walked()?;
        if walked.len() < 2 {
            return None;
        }
        let temperature = self.fit.chi_square_per_row().max(1.0);
        let least = lowest(&walked);
        let weight = |fit: &ComposedFit| {
            (-0.5 * (fit.minus_twice_log_posterior() - least) / temperature).exp()
        };
        let sum: f64 = walked.iter().map(weight).sum();
        let coordinates = Coordinates::new(&self.fit.model, &self.fit.parameters, &self.fit.free);
        let weighted: Vec<(f64, DVector<f64>)> = (walked.iter())
            .map(|fit| (weight(fit) / sum, coordinates.unknowns(&fit.parameters)))
            .collect();
        let count = self.fit.free.len();
        let zero = DVector::zeros(count);
        let mean = (weighted.iter()).fold(zero, |mean, (weight, x)| mean + *weight * x);
        let mut spread = DMatrix::zeros(count, count);
        for (weight, x) in &weighted {
            let away = x - &mean;
            spread += *weight * &away * away.transpose();
        }
        spread[(place, place)] += STEP * STEP / 12.0;
        let distance = |fit: &&ComposedFit| (fit.parameters[self.index] - mean[place]).abs();
        let nearest = (walked.iter()).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let mut at = self.held_at(mean[place], &nearest.parameters)?;
        at.free.clone_from(&self.fit.free);
        at.covariance.clone_from(&self.fit.covariance);
        Some((place, at, spread))
    }

    /// Fits at places to both sides, as far as they are about as likely as the best one.
    fn walked(&self) -> Option<Vec<ComposedFit>> {
        let most = FALL * self.fit.chi_square_per_row().max(1.0);
        let begun = self.held_at(self.fit.parameters[self.index], &self.fit.parameters)?;
        let declared = self.fit.model.parameters()[self.index].declaration;
        let mut walked = vec![begun.clone()];
        for direction in [-STEP, STEP] {
            let mut from = begun.parameters.clone();
            for _ in 0..STEPS_MAX {
                let next = from[self.index] + direction;
                if !(declared.lower..=declared.upper).contains(&next) {
                    break;
                }
                let Some(fit) = self.held_at(next, &from) else {
                    break;
                };
                if fit.minus_twice_log_posterior() > lowest(&walked) + most {
                    break;
                }
                from.clone_from(&fit.parameters);
                walked.push(fit);
            }
        }
        let least = lowest(&walked);
        walked.retain(|fit| fit.minus_twice_log_posterior() <= least + most);
        Some(walked)
    }

    /// Everything else fitted from `start` with the band beginning at `voltage`; it ends there where it ended before.
    fn held_at(&self, voltage: f64, start: &[f64]) -> Option<ComposedFit> {
        let mut start = start.to_vec();
        let declared = self.fit.model.parameters()[self.width].declaration;
        let wider = start[self.width] + voltage - start[self.index];
        start[self.width] = wider.clamp(declared.lower, declared.upper);
        start[self.index] = voltage;
        let others = self.fit.free.iter().copied();
        let free: Vec<usize> = others.filter(|i| *i != self.index).collect();
        let (model, options) = (&self.fit.model, self.options);
        fit_rows(self.rows, model, &start, &free, options, self.cancel)
    }
}

fn lowest(fits: &[ComposedFit]) -> f64 {
    let posteriors = fits.iter().map(ComposedFit::minus_twice_log_posterior);
    posteriors.fold(f64::INFINITY, f64::min)
}
