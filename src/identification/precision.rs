//! How well the data determine the eight coordinates: covariance, rank, condition, and how far the
//! noise model can be believed.
//!
//! The Gauss-Newton matrix `A` counts every sample as independent and the model as right. Neither
//! holds: phasors of overlapping windows are correlated, edges are followed imperfectly, motors run
//! a little differently from event to event. What all of these have in common is that the events
//! disagree about the parameters by more than `A` allows. With the gradients `s_e` of the events at
//! the joint solution,
//!
//! ```text
//! V = A^-1 (sum s_e s_e') A^-1                                  (1)  sandwich, events as clusters
//! E = A^-1 (A - sum A_e A^-1 A_e) A^-1                          (2)  its mean where A is right
//! r_i = V_ii / E_ii                                             (3)
//! ```
//!
//! `r_i` is the variance of coordinate `i` over the one that `A` promises. A handful of events gives
//! a rough figure, so each `r_i` is pulled towards the mean over its group (motor coordinates; shares),
//! which counts for `PRIOR_FREEDOM` degrees of freedom, and never counts below 1. One event alone
//! has nobody to disagree with: there the effective number of samples follows from the
//! autocorrelation of the residuals, `n / (1 + 2 sum rho_k)`. Coverage measured:
//! `docs/identifiability.md`. Sources: sandwich with clusters: Liang and
//! Zeger, Biometrika 73 (1986); division by the expectation under the model: Bell and `McCaffrey`,
//! Survey Methodology 28 (2002); moderation of variances: Smyth (2004).

use nalgebra::{DMatrix, DVector};

use super::{
    fit::FitSolution,
    intake::PreparedEvent,
    joint_problem::{JointProblem, LINEAR, OUTER, ProblemOptions, outer_bounds},
};

/// Unknowns that P and Q determine.
pub(super) const SIZE: usize = OUTER + LINEAR;
/// Degrees of freedom that the mean over a group of coordinates counts for.
const PRIOR_FREEDOM: f64 = 4.0;
/// Below this share of the largest eigenvalue rounding of the Gram sums decides.
const EIGENVALUE_SHARE: f64 = 1e-10;

/// An autocorrelation below this is noise of its own estimate.
const CORRELATION_LEAST: f64 = 0.05;
/// Longest time over which residuals are taken to be correlated, s.
const CORRELATION_TIME_MAX_S: f64 = 0.5;

/// Covariance of the coordinates of a solution and what it rests on.
#[derive(Clone, Debug, PartialEq)]
pub struct Precision {
    /// Covariance of outer and linear unknowns; zero rows for those on a bound.
    pub covariance: DMatrix<f64>,
    /// Rank of the information matrix scaled to a unit diagonal.
    pub rank: usize,
    /// Largest over smallest non-zero singular value of the scaled sensitivities.
    pub condition: f64,
    /// Standard error of each coordinate over the one of independent samples and a right model.
    pub inflation: [f64; SIZE],
    /// Events whose disagreement the inflation was taken from; 0 or 1: none could be.
    pub events: usize,
}

impl Precision {
    /// The noise model alone, its variances times `scale`.
    #[must_use]
    pub fn of_noise(solution: &FitSolution, scale: f64) -> Self {
        let held = held(solution);
        let free: Vec<usize> = (0..SIZE).filter(|&i| !held[i]).collect();
        if free.is_empty() {
            // Every unknown on a bound: the data determine nothing.
            return Self {
                covariance: DMatrix::from_element(SIZE, SIZE, f64::NAN),
                rank: 0,
                condition: f64::INFINITY,
                inflation: [scale.sqrt(); SIZE],
                events: 0,
            };
        }
        let (inverse, rank, condition) = inverse(&solution.point.information, &free);
        Self {
            covariance: inverse * scale,
            rank,
            condition,
            inflation: [scale.sqrt(); SIZE],
            events: 0,
        }
    }

    /// The noise model corrected by how much the events disagree, or, of one event, by the
    /// correlation of its residuals and `reduced_chi_square` where that is above 1.
    #[must_use]
    pub fn calibrated(
        solution: &FitSolution,
        events: &[PreparedEvent],
        options: &ProblemOptions,
        reduced_chi_square: f64,
    ) -> Self {
        let mut precision = Self::of_noise(solution, 1.0);
        let variance = if let Some(found) = disagreement(solution, events, options) {
            precision.events = events.len();
            found.moderated().map(|ratio| ratio.max(1.0))
        } else {
            let per_sample = samples_per_independent_one(solution, events);
            [reduced_chi_square.max(1.0) * per_sample; SIZE]
        };
        precision.inflation = variance.map(f64::sqrt);
        for i in 0..SIZE {
            for j in 0..SIZE {
                precision.covariance[(i, j)] *= precision.inflation[i] * precision.inflation[j];
            }
        }
        precision
    }
}

impl Disagreement {
    /// Ratios pulled towards the mean of their group.
    fn moderated(&self) -> [f64; SIZE] {
        std::array::from_fn(|i| {
            let group = if i < OUTER { 0..OUTER } else { OUTER..SIZE };
            let freedom: f64 = group.clone().map(|j| self.freedom[j]).sum();
            if freedom <= 0.0 {
                return 1.0;
            }
            let mean = group.map(|j| self.freedom[j] * self.ratio[j]).sum::<f64>() / freedom;
            (PRIOR_FREEDOM * mean + self.freedom[i] * self.ratio[i])
                / (PRIOR_FREEDOM + self.freedom[i])
        })
    }
}

/// `1 + 2 sum rho_k` of the weighted residuals of P and Q, over lags up to the first one that is
/// not correlated any more; at least 1.
fn samples_per_independent_one(solution: &FitSolution, events: &[PreparedEvent]) -> f64 {
    let mut longest = 1.0_f64;
    for event in events {
        let Ok(curves) = solution.model.simulate(event) else {
            continue;
        };
        let channel = |measured: &[f64], modelled: &[f64], deviation: &[f64]| {
            let residual = |k: usize| {
                let used = if event.used[k] { 1.0 } else { 0.0 };
                used * (measured[k] - modelled[k]) / deviation[k]
            };
            let series: Vec<f64> = (0..event.len()).map(residual).collect();
            correlation_sum(&series, event.rate_fps * CORRELATION_TIME_MAX_S)
        };
        longest = longest
            .max(channel(
                &event.active,
                &curves.active,
                &event.active_deviation,
            ))
            .max(channel(
                &event.reactive,
                &curves.reactive,
                &event.reactive_deviation,
            ));
    }
    longest
}

fn correlation_sum(series: &[f64], lag_max: f64) -> f64 {
    let product = |lag: usize| -> f64 {
        let shifted = series.iter().skip(lag);
        series.iter().zip(shifted).map(|(a, b)| a * b).sum()
    };
    let power = product(0);
    let mut sum = 1.0;
    let mut lag = 1;
    while power > 0.0 && (lag as f64) <= lag_max && lag < series.len() {
        let correlation = product(lag) / power;
        if correlation < CORRELATION_LEAST {
            break;
        }
        sum += 2.0 * correlation;
        lag += 1;
    }
    sum
}

/// The pieces of (1) to (3) for the free coordinates.
#[derive(Clone, Debug)]
pub struct Disagreement {
    /// Ratios (3); 1 for held coordinates.
    pub ratio: [f64; SIZE],
    /// Degrees of freedom of each.
    pub freedom: [f64; SIZE],
}

/// Compares the events' gradients at the joint solution with what the noise model allows. `None` for
/// fewer than two events, or where an event cannot be simulated.
#[must_use]
pub fn disagreement(
    solution: &FitSolution,
    events: &[PreparedEvent],
    options: &ProblemOptions,
) -> Option<Disagreement> {
    if events.len() < 2 {
        return None;
    }
    let held = held(solution);
    let free: Vec<usize> = (0..SIZE).filter(|&i| !held[i]).collect();
    let (inverse, rank, _) = inverse(&solution.point.information, &free);
    if rank < free.len() {
        return None;
    }
    // The prior belongs to no event.
    let without_prior = ProblemOptions {
        static_prior_deviation: f64::INFINITY,
        ..*options
    };
    let never = || false;
    let (mut between, mut within) = (DMatrix::zeros(SIZE, SIZE), DMatrix::zeros(SIZE, SIZE));
    let mut shares = vec![[0.0; SIZE]; events.len()];
    for (event, share) in events.iter().zip(&mut shares) {
        let alone = JointProblem::new(std::slice::from_ref(event), without_prior, &never);
        let at = alone.expansion_at(&solution.found.local.x, &solution.point.linear)?;
        let step: DVector<f64> = &inverse * &at.gradient;
        between += &step * step.transpose();
        let lever = &inverse * &at.curvature;
        within += &lever * &lever * &inverse;
        let spread = &lever * &inverse;
        for (i, share) in share.iter_mut().enumerate() {
            *share = spread[(i, i)];
        }
    }
    let mut found = Disagreement {
        ratio: [1.0; SIZE],
        freedom: [0.0; SIZE],
    };
    for &i in &free {
        let expected = inverse[(i, i)] - within[(i, i)];
        let total: f64 = shares.iter().map(|s| s[i]).sum();
        let squares: f64 = shares.iter().map(|s| s[i] * s[i]).sum();
        if expected > 1e-6 * inverse[(i, i)] && squares > 0.0 {
            found.ratio[i] = between[(i, i)] / expected;
            found.freedom[i] = (total * total / squares - 1.0).max(0.0);
        }
    }
    Some(found)
}

/// Inverse of the free block in a matrix of full size, its rank and condition. A direction that the
/// data leave open has an infinite variance.
fn inverse(information: &DMatrix<f64>, free: &[usize]) -> (DMatrix<f64>, usize, f64) {
    let deviation: Vec<f64> = free
        .iter()
        .map(|&i| information[(i, i)].max(1e-300).sqrt())
        .collect();
    let scaled = DMatrix::from_fn(free.len(), free.len(), |i, j| {
        information[(free[i], free[j])] / (deviation[i] * deviation[j])
    });
    let eigen = scaled.symmetric_eigen();
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let known = |e: f64| e > EIGENVALUE_SHARE * largest;
    let kept = || eigen.eigenvalues.iter().copied().filter(|&e| known(e));
    let smallest = kept().fold(f64::INFINITY, f64::min);
    let mut inverse = DMatrix::zeros(SIZE, SIZE);
    for (&e, vector) in (eigen.eigenvalues.iter()).zip(eigen.eigenvectors.column_iter()) {
        let variance = if known(e) { 1.0 / e } else { f64::INFINITY };
        for i in 0..free.len() {
            for j in 0..free.len() {
                let product = vector[i] * vector[j];
                if product != 0.0 {
                    inverse[(free[i], free[j])] +=
                        variance * product / (deviation[i] * deviation[j]);
                }
            }
        }
    }
    (inverse, kept().count(), (largest / smallest).sqrt())
}

/// Which coordinates lie on a bound.
pub(super) fn held(solution: &FitSolution) -> Vec<bool> {
    let bounds = outer_bounds();
    let x = &solution.found.local.x;
    let spans = bounds.spans();
    (0..OUTER)
        .map(|i| {
            let close = 1e-9 * spans[i];
            x[i] - bounds.lower[i] <= close || bounds.upper[i] - x[i] <= close
        })
        .chain(solution.point.linear_at_bound)
        .collect()
}
