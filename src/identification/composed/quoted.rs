//! The covariance that is quoted with a fit: its curvature where that is a poor guide to the errors, corrected.
//!
//! The derivative of a response by a voltage at which something lets go is that of the few samples in which it
//! lets go at this very voltage; a little farther the objective is as flat as the other parameters make it, or a
//! further dip is reached. A covariance from such derivatives states how well the corner of the objective is known in
//! which a fit has ended. Here the column of a setting is a difference quotient over its own standard error,
//!
//! ```text
//! J_i = (f(x + s_i e_i) - f(x - s_i e_i)) / (2 s_i),   s_i = sqrt(A^-1_ii),   A = J' S^-1 J + P        (1)
//! ```
//!
//! found by a few rounds from the derivative's (`S` noise and what varies from event to event, `P` the priors). A
//! threshold that was put in the middle of an interval in which nothing changes keeps the variance of that interval,
//! where the other parameters, free, do not widen it. The beginning of a band is held, and the variance of where it
//! may be added (`band`).
//!
//! Residuals are no independent samples: they last where the model or the voltage behind it errs. With the score of
//! every half second `b` of every event,
//!
//! ```text
//! s_b = (J - v(J))_b' (S^-1 r)_b,   H = A^-1 (sum_b s_b s_b') A^-1,   V_ii = max(A^-1_ii, H_ii)       (2)
//! ```
//!
//! where `v` is the part of a column that what varies from event to event takes up: of that the assumed
//! spread says how large it may be.
//!
//! What is published is fitted under another spread `N` between the events than the one `S` by which its errors are stated,
//! so that a few events may decide what all were to say. With `B = J' N^-1 J + P`,
//!
//! ```text
//! W = B^-1 (J' N^-1 S N^-1 J + P) B^-1,   V_ii = max(A^-1_ii, H_ii, W_ii)                               (3)
//! ```
//!
//! Source: (2) is the sandwich with clusters of Liang and Zeger (Biometrika 73, 1986), the clusters being pieces
//! of time as in Newey and West (Econometrica 55, 1987).

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{
    band::Bands,
    coordinates::Coordinates,
    covariance::EventCovariance,
    fit::{ComposedFit, ComposedFitOptions},
    relay_walk::is_setting,
    rows::{EventRows, Scatter, random_effects},
};
use crate::load_model::effect::Scale;

/// Rounds of (1) at most.
const ROUNDS_MAX: usize = 3;
/// A standard error that a round changes by less than this share has settled.
const SETTLED: f64 = 0.2;
/// Least distance: of a voltage, pu, half of what a relay of the model is spread over to each side; of a
/// logarithm of a time.
const VOLTAGE_LEAST: f64 = 0.004;
const TIME_LEAST: f64 = 0.02;
/// Greatest distance of both: farther away it is another solution. Chosen; insensitive between half and twice.
const VOLTAGE_MOST: f64 = 0.03;
const TIME_MOST: f64 = 0.5;
/// A setting known no better than to this share of its prior's deviation is the prior's.
const OPEN: f64 = 0.7;
/// A threshold whose variance the others, free, raise by less than this factor lies between two dips.
const ALONE: f64 = 2.0;
/// A setting whose columns to both sides differ by more than this factor in size has a cliff on one of them.
const CLIFF: f64 = 5.0;
/// Length of the pieces of (2): that over which residuals are taken to be correlated elsewhere too.
const PIECE_S: f64 = 0.5;

/// The covariance of a fit as it is quoted.
pub(super) struct Quoted {
    /// Places among the free parameters, ascending, of thresholds that stay where they are: between two dips, whatever the others are, and
    /// at the mean of where a band may begin.
    pub(super) staying: Vec<usize>,
    inverse: DMatrix<f64>,
    /// Roots of the variances over those of `inverse`.
    factors: Vec<f64>,
    /// What bands leave open.
    open: DMatrix<f64>,
    slopes: Vec<f64>,
    /// `P`.
    priors: DVector<f64>,
    events: Vec<At>,
}

impl Quoted {
    /// The covariance with (3): that of an estimate made under the spread `weighed`, with the bands that this is of; `None`
    /// where it cannot be found.
    pub(super) fn of_estimate(
        &self,
        rows: &[EventRows<'_>],
        bands: &Bands,
        weighed: &Scatter,
    ) -> Option<DMatrix<f64>> {
        let (model, parameters) = (&bands.fit.model, bands.fit.parameters.as_slice());
        let random = random_effects(model, parameters, weighed);
        let count = self.slopes.len();
        let mut curvature = DMatrix::from_diagonal(&self.priors);
        let mut scores = curvature.clone();
        for (event, at) in rows.iter().zip(&self.events) {
            let given = (&at.rows, at.wanted.as_slice());
            let weights = event.covariance_of(given, &random, (model, parameters))?;
            let mut columns = at.columns.clone();
            for (mut column, slope) in columns.column_iter_mut().zip(&self.slopes) {
                column *= *slope;
            }
            curvature += weights.gram(&columns);
            scores += at.covariance.spread_of(&weights.solved_columns(&columns));
        }
        let inverse = without(&curvature, &self.staying)?;
        let spread = &inverse * scores * &inverse;
        let factor = |i: usize| {
            let ratio = spread[(i, i)] / self.inverse[(i, i)];
            self.factors[i].max(ratio.max(0.0).sqrt())
        };
        Some(self.stated(&(0..count).map(factor).collect::<Vec<f64>>()))
    }

    fn stated(&self, factors: &[f64]) -> DMatrix<f64> {
        DMatrix::from_fn(factors.len(), factors.len(), |i, j| {
            let unknown = factors[i] * self.inverse[(i, j)] * factors[j] + self.open[(i, j)];
            self.slopes[i] * unknown * self.slopes[j]
        })
    }
}

/// The covariance of a fit corrected by (1) and (2), with what its bands leave open; `None` where it has none, or none can
/// be found.
pub(super) fn quoted(
    rows: &[EventRows<'_>],
    bands: &Bands,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Quoted> {
    let fit = &bands.fit;
    let stated = fit.covariance.as_ref()?;
    let coordinates = Coordinates::new(&fit.model, &fit.parameters, &fit.free);
    let mut search = Search {
        rows,
        fit,
        slopes: coordinates.slopes(&fit.parameters),
        x: coordinates.unknowns(&fit.parameters),
        coordinates,
        events: Vec::new(),
        held: &bands.places,
        cancel,
    };
    let deviations: Vec<f64> = (0..fit.free.len())
        .map(|place| stated[(place, place)].sqrt() / search.slopes[place])
        .collect();
    search.events = search.linearised(options)?;
    let settings = search.settings(&deviations);
    let (curvature, inverse) = search.settle(&settings, &deviations)?;
    let mut factors = search.persistence(&inverse);
    let mut staying = bands.places.clone();
    for place in centred(fit) {
        if staying.contains(&place) {
            continue;
        }
        if curvature[(place, place)] * inverse[(place, place)] < ALONE {
            factors[place] = deviations[place] * curvature[(place, place)].sqrt();
            staying.push(place);
        }
    }
    staying.sort_unstable();
    let open = bands
        .spreads
        .iter()
        .fold(0.0 * &inverse, |sum, own| sum + own);
    let (_, _, priors) = search.coordinates.prior(&search.x);
    Some(Quoted {
        staying,
        inverse,
        factors,
        open,
        priors,
        slopes: search.slopes,
        events: search.events,
    })
}

/// Places of thresholds that were put in the middle of where they may lie, all else held: the covariance has the
/// width of that interval, and nothing that others share.
fn centred(fit: &ComposedFit) -> Vec<usize> {
    let Some(covariance) = fit.covariance.as_ref().filter(|c| c.ncols() > 1) else {
        return Vec::new();
    };
    let shared = |i: usize, j: usize| i != j && covariance[(i, j)].abs() > 0.0;
    let alone = |i: &usize| !(0..covariance.ncols()).any(|j| shared(*i, j));
    let setting = |i: &usize| is_setting(&fit.model.parameters()[fit.free[*i]]);
    let all = 0..fit.free.len();
    all.filter(setting).filter(alone).collect()
}

/// A setting: its place among the unknowns, and between which distances its difference is taken.
#[derive(Clone, Copy)]
struct Setting {
    place: usize,
    least: f64,
    most: f64,
}

/// An event at the fit: derivative columns by the free parameters, what is left, and its covariance.
struct At {
    /// Derivative columns of the parameters `wanted`, and the residual.
    rows: DMatrix<f64>,
    wanted: Vec<usize>,
    columns: DMatrix<f64>,
    residual: DVector<f64>,
    covariance: EventCovariance,
}

struct Search<'a> {
    rows: &'a [EventRows<'a>],
    fit: &'a ComposedFit,
    coordinates: Coordinates,
    slopes: Vec<f64>,
    x: DVector<f64>,
    events: Vec<At>,
    /// Places of unknowns that are held.
    held: &'a [usize],
    cancel: &'a (dyn Fn() -> bool + Sync),
}

impl Search<'_> {
    /// The settings that the data determine, by the deviations of the unknowns.
    fn settings(&self, deviations: &[f64]) -> Vec<Setting> {
        let parameters = self.fit.model.parameters();
        let both = self.fit.free.iter().zip(deviations).enumerate();
        both.filter_map(|(place, (index, deviation))| {
            let parameter = &parameters[*index];
            let prior = &parameter.declaration.prior;
            let free = !self.held.contains(&place);
            let determined = free && is_setting(parameter) && *deviation < OPEN * prior.deviation;
            let (least, most) = match prior.scale {
                Scale::Linear => (VOLTAGE_LEAST, VOLTAGE_MOST),
                Scale::Logarithmic => (TIME_LEAST, TIME_MOST),
            };
            determined.then_some(Setting { place, least, most })
        })
        .collect()
    }

    fn linearised(&self, options: &ComposedFitOptions) -> Option<Vec<At>> {
        let (model, parameters) = (&self.fit.model, &self.fit.parameters);
        let random = random_effects(model, parameters, &options.scatter);
        let count = self.fit.free.len();
        let mut wanted = self.fit.free.clone();
        for (index, _) in &random {
            if !wanted.contains(index) {
                wanted.push(*index);
            }
        }
        let at = |event: &EventRows<'_>| {
            if (self.cancel)() {
                return None;
            }
            let rows = event.expanded(model, parameters, &wanted).ok()?;
            Some(At {
                covariance: event.covariance_of((&rows, &wanted), &random, (model, parameters))?,
                columns: rows.columns(0, count).into_owned(),
                residual: rows.column(wanted.len()).into_owned(),
                wanted: wanted.clone(),
                rows,
            })
        };
        self.rows.par_iter().map(at).collect()
    }

    /// Rounds of (1): the curvature in the unknowns, and its inverse.
    fn settle(
        &mut self,
        settings: &[Setting],
        deviations: &[f64],
    ) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
        let mut deviations = deviations.to_vec();
        let mut open = settings.to_vec();
        let mut found = None;
        for _ in 0..ROUNDS_MAX {
            for setting in &open {
                let distance = deviations[setting.place].clamp(setting.least, setting.most);
                self.replace(setting.place, distance)?;
            }
            let curvature = self.curvature()?;
            let inverse = without(&curvature, self.held)?;
            open.retain(|s| {
                let [before, now] = [deviations[s.place], inverse[(s.place, s.place)].sqrt()]
                    .map(|distance| distance.clamp(s.least, s.most));
                (now - before).abs() > SETTLED * before
            });
            for setting in settings {
                deviations[setting.place] = inverse[(setting.place, setting.place)].sqrt();
            }
            found = Some((curvature, inverse));
            if open.is_empty() {
                break;
            }
        }
        found
    }

    /// Puts the difference over `distance` to both sides, as far as the bounds allow, in place of a column; that to one
    /// side where there is a cliff on the other, which bounds where the parameter may be and says nothing of how far.
    fn replace(&mut self, place: usize, distance: f64) -> Option<()> {
        let bounds = self.coordinates.bounds();
        let side = |sign: f64| {
            let mut x = self.x.clone();
            let moved = x[place] + sign * distance;
            x[place] = moved.clamp(bounds.lower[place], bounds.upper[place]);
            (x[place], self.coordinates.parameters(&x))
        };
        let ((low, below), (high, above)) = (side(-1.0), side(1.0));
        if low >= high {
            return Some(());
        }
        let (here, slope) = (self.x[place], self.slopes[place]);
        let difference = |(event, at): (&EventRows<'_>, &At)| {
            if (self.cancel)() {
                return None;
            }
            let left = |parameters: &[f64]| event.residual(&self.fit.model, parameters).ok();
            let (below, above) = (left(&below)?, left(&above)?);
            let over =
                |x: f64, difference: DVector<f64>| (x > 0.0).then(|| difference / (slope * x));
            let sides = [
                over(here - low, &below - &at.residual),
                over(high - here, &at.residual - &above),
            ];
            let squares = sides.each_ref().map(|side| {
                let side = side.as_ref();
                side.map_or(f64::INFINITY, |column| at.covariance.square(column))
            });
            let both = (below - above) / (slope * (high - low));
            Some((both, sides, squares))
        };
        let found: Vec<_> = (self.rows.par_iter().zip(&self.events))
            .map(difference)
            .collect::<Option<_>>()?;
        let square = |side: usize| found.iter().map(|(_, _, squares)| squares[side]).sum();
        let squares: [f64; 2] = [square(0), square(1)];
        let smooth = (0..2).find(|side| squares[*side] * CLIFF * CLIFF < squares[1 - *side]);
        let columns = found.into_iter().map(|(both, mut sides, _)| {
            let one = smooth.and_then(|side| sides[side].take());
            one.unwrap_or(both)
        });
        let columns: Vec<DVector<f64>> = columns.collect();
        for (event, column) in self.events.iter_mut().zip(&columns) {
            event.columns.set_column(place, column);
        }
        Some(())
    }

    fn curvature(&self) -> Option<DMatrix<f64>> {
        let grams = self.events.iter().map(|at| at.covariance.gram(&at.columns));
        let sum = grams.reduce(|sum, gram| sum + gram)?;
        let (_, _, precision) = self.coordinates.prior(&self.x);
        Some(DMatrix::from_fn(self.x.len(), self.x.len(), |i, j| {
            let own = if i == j { precision[i] } else { 0.0 };
            self.slopes[i] * sum[(i, j)] * self.slopes[j] + own
        }))
    }

    /// Root of (2) over the variance without it, of every unknown.
    fn persistence(&self, inverse: &DMatrix<f64>) -> Vec<f64> {
        let count = self.x.len();
        let mut scores = DMatrix::<f64>::zeros(count, count);
        for (rows, at) in self.rows.iter().zip(&self.events) {
            let weighted = at.covariance.solved(&at.residual);
            let pieces = rows.pieces(PIECE_S);
            let last = pieces.iter().copied().max().unwrap_or(0);
            let mut sums = DMatrix::<f64>::zeros(count, last + 1);
            for (i, slope) in self.slopes.iter().enumerate() {
                let column: DVector<f64> = at.columns.column(i).into_owned();
                let own = &column - at.covariance.varying(&column);
                for (row, piece) in pieces.iter().enumerate() {
                    sums[(i, *piece)] += slope * own[row] * weighted[row];
                }
            }
            scores += &sums * sums.transpose();
        }
        let spread = inverse * scores * inverse;
        // What is held has no variance here: 0/0 is no ratio, and the greater is 1.
        let ratio = |i: usize| (spread[(i, i)] / inverse[(i, i)]).max(1.0).sqrt();
        (0..count).map(ratio).collect()
    }
}

/// The inverse of the curvature by all that is not held; zero by what is.
fn without(curvature: &DMatrix<f64>, held: &[usize]) -> Option<DMatrix<f64>> {
    let mut others = curvature.clone();
    for place in held {
        others.row_mut(*place).fill(0.0);
        others.column_mut(*place).fill(0.0);
        others[(*place, *place)] = 1.0;
    }
    let mut inverse = others.cholesky()?.inverse();
    for place in held {
        inverse[(*place, *place)] = 0.0;
    }
    Some(inverse)
}
