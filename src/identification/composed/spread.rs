//! How much of what may vary from event to event does vary, by the likelihood of the events.
//!
//! Composition of the load and shares of effects vary by a share each of what is assumed, `c = [c_1, c_2]`. With the
//! covariance `S(c)` of the events' rows at a fit, and what is left there, `r`,
//!
//! ```text
//! l(c) = sum_e r' S^-1 r + ln det S                                                                    (1)
//! m(c) = l(c) + ln det A,   A = sum_e J' S^-1 J + P                                                    (2)
//! c_i^2 = sum_c w c_i^2 / sum_c w,   w = exp(-(m(c) - min m) / (2 T))                                  (3)
//! ```
//!
//! with the derivatives `J` by what is free, its priors `P`, and `T` the misfit per row where that is above 1: what is left
//! is not independent from sample to sample. The second term of (2) is what the fit has spent of the events on its parameters.
//! It is not moved to where it would be best under `S(c)`, which is to the disadvantage of narrow spreads.
//!
//! Source: (2) is the restricted likelihood of Patterson and Thompson (Biometrika 58, 1971) but for that.

use nalgebra::{DMatrix, DVector};

use super::{
    coordinates::Coordinates,
    covariance::Products,
    fit::{ComposedFit, ComposedFitOptions, Place},
    operating_point::LINEAR_COUNT,
    rows::{EventRows, Scatter, random_effects},
};

/// Shares of the assumed spread, narrowest first.
const SHARES: [f64; 5] = [0.062_5, 0.125, 0.25, 0.5, 1.0];
/// The least shares of both.
pub(super) const NARROWEST: [f64; 2] = [SHARES[0]; 2];
/// Likelihoods that differ by less than this share of the weighted squares that are left are not told
/// apart: what is left is not independent from sample to sample.
const TOLD_SHARE_OF_LEFT: f64 = 0.03;

/// Spreads narrower than `assumed`, the narrowest first.
#[must_use]
pub fn narrower_than(assumed: &Scatter) -> [Scatter; SHARES.len() - 1] {
    std::array::from_fn(|i| assumed.times([SHARES[i]; 2]))
}

/// How likely the events are under every pair of shares, that of the composition varying slowest.
pub(super) struct Spreads {
    tried: Vec<Likelihood>,
    /// `T`.
    persistence: f64,
}

impl Spreads {
    /// With the parameters of `fit`. `None` where they cannot be simulated.
    pub(super) fn new(
        rows: &[EventRows<'_>],
        fit: &ComposedFit,
        options: &ComposedFitOptions,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        Some(Self {
            tried: likelihoods(rows, fit, options, cancel)?,
            persistence: fit.chi_square_per_row().max(1.0),
        })
    }

    /// The narrowest shares under which the events are about as likely (1) as under the best ones.
    pub(super) fn sufficient(&self) -> Option<[f64; 2]> {
        let by_likelihood = |a: &&Likelihood, b: &&Likelihood| {
            a.minus_twice_logarithm.total_cmp(&b.minus_twice_logarithm)
        };
        let best = self.tried.iter().min_by(by_likelihood)?;
        let most = best.minus_twice_logarithm + TOLD_SHARE_OF_LEFT * best.squares;
        let enough = self
            .tried
            .iter()
            .find(|t| t.minus_twice_logarithm <= most)?;
        Some(enough.shares)
    }

    /// The shares that the events show (3): all alike likely where no event says anything of them.
    pub(super) fn shown(&self) -> [f64; 2] {
        let restricted = self.tried.iter().map(|t| t.restricted);
        let least = restricted.fold(f64::INFINITY, f64::min);
        let weight = |t: &Likelihood| (-0.5 * (t.restricted - least) / self.persistence).exp();
        let all: f64 = self.tried.iter().map(weight).sum();
        let mean = |which: usize| {
            let squares = (self.tried.iter()).map(|t| weight(t) * t.shares[which].powi(2));
            (squares.sum::<f64>() / all).sqrt()
        };
        [mean(0), mean(1)]
    }
}

/// How well a pair of shares explains the events.
struct Likelihood {
    shares: [f64; 2],
    /// (1).
    minus_twice_logarithm: f64,
    /// (2).
    restricted: f64,
    squares: f64,
}

fn likelihoods(
    rows: &[EventRows<'_>],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<Likelihood>> {
    let coordinates = Coordinates::new(&fit.model, &fit.parameters, &fit.free);
    let x = coordinates.unknowns(&fit.parameters);
    let place = Place {
        rows,
        model: &fit.model,
        coordinates: &coordinates,
        scatter: &options.scatter,
        cancel,
    };
    let varying = random_effects(&fit.model, &fit.parameters, &options.scatter).len();
    let events = Events {
        products: place.problem(&x, None)?.products()?,
        slopes: coordinates.slopes(&fit.parameters),
        precisions: coordinates.prior(&x).2,
        varying,
    };
    let pairs = SHARES.iter().flat_map(|c| SHARES.iter().map(|e| [*c, *e]));
    pairs.map(|shares| events.likelihood(shares)).collect()
}

/// All that likelihoods need of the events.
struct Events {
    /// Of derivative columns and, last, what is left.
    products: Vec<Products>,
    slopes: Vec<f64>,
    precisions: DVector<f64>,
    /// So many random effects vary from event to event, those of the composition first; others are of the measurement.
    varying: usize,
}

impl Events {
    fn likelihood(&self, shares: [f64; 2]) -> Option<Likelihood> {
        let times = |effect: usize| match effect {
            composition if composition < LINEAR_COUNT => shares[0],
            share if share < self.varying => shares[1],
            _ => 1.0,
        };
        let count = self.slopes.len();
        let mut sum = DMatrix::zeros(count + 1, count + 1);
        let mut minus_twice_logarithm = 0.0;
        for event in &self.products {
            let (gram, log_determinant) = event.scaled(times)?;
            sum += gram;
            minus_twice_logarithm += log_determinant;
        }
        let squares = sum[(count, count)];
        minus_twice_logarithm += squares;
        let curvature = DMatrix::from_fn(count, count, |i, j| {
            let own = if i == j { self.precisions[i] } else { 0.0 };
            self.slopes[i] * sum[(i, j)] * self.slopes[j] + own
        });
        let root: f64 = (curvature.cholesky()?.l_dirty().diagonal().iter())
            .map(|d| d.ln())
            .sum();
        Some(Likelihood {
            shares,
            minus_twice_logarithm,
            restricted: minus_twice_logarithm + 2.0 * root,
            squares,
        })
    }
}
