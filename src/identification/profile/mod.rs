//! Profile likelihood: how far one quantity can be moved while everything else gives way.
//!
//! Along a quantity `q` all other unknowns are optimised again,
//!
//! ```text
//! rise(c) = 2 (min F over q = c  -  min F) / f                  (1)
//! root(c) = sign(c - estimate) sqrt(rise(c))                    (2)
//! ```
//!
//! and the values with `rise` below a quantile of the chi-square distribution with one degree of
//! freedom are the confidence interval. Unlike a standard error it follows curved valleys, bounds and
//! the null direction: on the latter the reactance on the motor's own base is an unknown too, so the
//! profile of T0' is flat over its valley and rises beyond it. `f` is the calibration of the variance
//! of `q` (`precision`). Source: Raue et al., Bioinformatics 25 (2009), section 2; signed root: Bates
//! and Watts (1988), section 6.1.2.

mod constrained;
mod limits;
mod site;
mod target;

pub use site::{ProfileError, SiteProfile, profile_site};
pub use target::{UnknownQuantity, names};

use nalgebra::DVector;

use super::{
    estimates::coordinates_of,
    fit::FitSolution,
    intake::PreparedEvent,
    joint_problem::{JointProblem, ProblemOptions},
    precision::Precision,
    quantities::parameters_at,
    valley::Valley,
};
use crate::load_model::LoadBase;
use constrained::{Constrained, Found};
use target::Target;

/// Confidence levels and their quantiles of the chi-square distribution with one degree of freedom.
pub const LEVELS: [(f64, f64); 2] = [(0.68, 0.988_946), (0.95, 3.841_459)];

/// Settings of a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProfileOptions {
    /// Points on each side of the estimate at most. Default 40; 4 to 1000.
    pub points_max: usize,
    /// Wanted distance of neighbouring points in the signed root. Default 0.4; 0.05 to 1.
    pub step: f64,
    /// Signed root at which a side ends. Default 2.6: beyond the 95 % level, for the plot.
    pub root_max: f64,
}

impl Default for ProfileOptions {
    fn default() -> Self {
        Self {
            points_max: 40,
            step: 0.4,
            root_max: 2.6,
        }
    }
}

/// One point of a profile.
#[derive(Clone, Debug, PartialEq)]
pub struct ProfilePoint {
    /// Value of the quantity.
    pub value: f64,
    /// Rise (1); negative where the other unknowns led to a better solution than the fit's.
    pub rise: f64,
    /// The eight coordinates there.
    pub coordinates: Vec<f64>,
    /// Reactance on the motor's own base there.
    pub x_motor_base: f64,
}

impl ProfilePoint {
    /// Square root of the rise without its sign.
    #[must_use]
    pub fn root(&self) -> f64 {
        self.rise.max(0.0).sqrt()
    }
}

/// One end of a confidence interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// The rise reaches the level here.
    Reached(f64),
    /// A bound of the quantity or of the unknowns ends the profile here, below the level.
    Bound(f64),
    /// The profile was not followed further than this.
    Open(f64),
}

impl Limit {
    /// The value, whatever ended the interval there.
    #[must_use]
    pub const fn value(&self) -> f64 {
        match self {
            Self::Reached(value) | Self::Bound(value) | Self::Open(value) => *value,
        }
    }
}

/// A confidence interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConfidenceInterval {
    /// Confidence level.
    pub level: f64,
    /// Lower end.
    pub lower: Limit,
    /// Upper end.
    pub upper: Limit,
}

/// The profile of one quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Name.
    pub name: String,
    /// What it is, in words.
    pub meaning: String,
    /// Unit, `"1"` when dimensionless.
    pub unit: String,
    /// Value at the solution.
    pub estimate: f64,
    /// Standard error for comparison; along the null direction at a fixed reactance.
    pub standard_error: f64,
    /// Points in order of value.
    pub points: Vec<ProfilePoint>,
    /// Confidence intervals in the order of [`LEVELS`].
    pub intervals: Vec<ConfidenceInterval>,
    /// Calibration of the variance: `f` of (1).
    pub variance_factor: f64,
    /// Largest fall below the fit's solution met on the way, as a negative rise; 0 when none.
    pub fall: f64,
}

/// What a profile rests on.
#[derive(Clone, Copy, Debug)]
pub struct ProfileInput<'a> {
    /// The solution.
    pub solution: &'a FitSolution,
    /// Its calibrated precision.
    pub precision: &'a Precision,
    /// The events it was fitted on, jumps aligned.
    pub events: &'a [PreparedEvent],
    /// Settings of the joint problem.
    pub problem: &'a ProblemOptions,
    /// Operating point and nominal frequency.
    pub base: LoadBase,
}

/// Follows the profile of the quantity `name`. `progress` is told the number of points after each;
/// `cancel` is asked between simulations and ends the profile where it is.
///
/// Cost: some five evaluations of the joint problem with sensitivities per point, some twenty points.
///
/// # Errors
///
/// [`UnknownQuantity`] with the names there are.
pub fn profile(
    input: &ProfileInput<'_>,
    name: &str,
    options: &ProfileOptions,
    progress: &(dyn Fn(usize) + Sync),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Profile, UnknownQuantity> {
    let target = Target::named(name, input.problem)?;
    let coordinates = coordinates_of(input.solution);
    let paper_box = input.problem.static_shares.is_some();
    let valley = Valley::new(|x| parameters_at(&coordinates, x, &input.base), paper_box);
    let mut start = DVector::from_vec(coordinates);
    start = start.push(valley.representative());
    let problem = JointProblem::new(input.events, *input.problem, cancel);
    let slope = target.gradient(&start, &input.base);
    let scale = Scale::new(&slope, input.precision, &target);
    let constrained = Constrained::new(&problem, &target, input.base, &scale, valley.reactance);
    let mut path = Path {
        constrained: &constrained,
        scale: &scale,
        bounds: target.bounds(),
        lowest: input.solution.point.objective,
        found: vec![Found {
            value: target.value(&start, &input.base),
            objective: input.solution.point.objective,
            at: start,
        }],
        options,
        progress,
        cancel,
    };
    let below = path.side(-1.0);
    let above = path.side(1.0);
    let intervals = LEVELS
        .iter()
        .map(|&(level, quantile)| ConfidenceInterval {
            level,
            lower: path.limit(-1.0, quantile.sqrt(), below),
            upper: path.limit(1.0, quantile.sqrt(), above),
        })
        .collect();
    let estimate = path.found[0].value;
    let mut points: Vec<ProfilePoint> = path.found.iter().map(|f| path.point(f)).collect();
    points.sort_by(|a, b| a.value.total_cmp(&b.value));
    let fall = points.iter().map(|p| p.rise).fold(0.0, f64::min);
    Ok(Profile {
        name: target.name().to_owned(),
        meaning: target.meaning().to_owned(),
        unit: target.unit().to_owned(),
        estimate,
        standard_error: scale.standard_error,
        points,
        intervals,
        variance_factor: scale.variance_factor,
        fall,
    })
}

/// Sizes along the quantity.
#[derive(Clone, Copy, Debug)]
struct Scale {
    /// Calibrated standard error, or a twentieth of the bounds where there is none.
    standard_error: f64,
    /// Calibrated variance over that of the noise model.
    variance_factor: f64,
    /// Longest step.
    step_max: f64,
}

impl Scale {
    fn new(slope: &DVector<f64>, precision: &Precision, target: &Target) -> Self {
        let (low, high) = target.bounds();
        let width = high - low;
        let variance = |by: &dyn Fn(usize) -> f64| {
            let mut sum = 0.0;
            for i in 0..precision.covariance.nrows() {
                for j in 0..precision.covariance.ncols() {
                    sum += slope[i] * slope[j] * precision.covariance[(i, j)] / (by(i) * by(j));
                }
            }
            sum
        };
        let calibrated = variance(&|_| 1.0);
        let plain = variance(&|i| precision.inflation[i]);
        let ratio = calibrated / plain;
        let determined = calibrated.is_finite() && calibrated > 0.0;
        Self {
            standard_error: if determined {
                calibrated.sqrt()
            } else {
                width / 20.0
            },
            variance_factor: if ratio.is_finite() && ratio > 0.0 {
                ratio
            } else {
                1.0
            },
            step_max: width / 8.0,
        }
    }
}

/// Why a side of a profile ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// The signed root went beyond what was asked for.
    RootReached,
    /// A bound of the quantity or of the unknowns.
    Bound,
    /// Too many points, or cancelled.
    Stopped,
}

/// The points found so far and how to find more; the first one is the estimate.
struct Path<'a> {
    constrained: &'a Constrained<'a>,
    scale: &'a Scale,
    bounds: (f64, f64),
    lowest: f64,
    found: Vec<Found>,
    options: &'a ProfileOptions,
    progress: &'a (dyn Fn(usize) + Sync),
    cancel: &'a (dyn Fn() -> bool + Sync),
}

impl Path<'_> {
    fn point(&self, found: &Found) -> ProfilePoint {
        let last = found.at.len() - 1;
        ProfilePoint {
            value: found.value,
            rise: 2.0 * (found.objective - self.lowest) / self.scale.variance_factor,
            coordinates: found.at.iter().take(last).copied().collect(),
            x_motor_base: found.at[last],
        }
    }

    fn root(&self, found: &Found) -> f64 {
        self.point(found).root()
    }

    /// Walks from the estimate in one direction; steps are chosen so that the root grows by about
    /// the wanted distance.
    fn side(&mut self, sign: f64) -> End {
        let mut at = self.found[0].clone();
        let mut step = self.options.step * self.scale.standard_error;
        for _ in 0..self.options.points_max {
            if (self.cancel)() {
                return End::Stopped;
            }
            let wanted = (at.value + sign * step).clamp(self.bounds.0, self.bounds.1);
            let room = (wanted - at.value).abs();
            if room < 1e-6 * self.scale.standard_error {
                return End::Bound;
            }
            let Some(next) = self.constrained.solve(&at, wanted) else {
                return if (self.cancel)() {
                    End::Stopped
                } else {
                    End::Bound
                };
            };
            let arrived = (next.value - wanted).abs() < 0.1 * room;
            let grown = (self.root(&next) - self.root(&at)).abs();
            if grown > 3.0 * self.options.step && step > 1e-3 * self.scale.standard_error {
                // Too far to be followed: the same way in shorter steps.
                step *= 0.3;
                continue;
            }
            at = next.clone();
            self.found.push(next);
            (self.progress)(self.found.len());
            if self.root(&at) >= self.options.root_max {
                return End::RootReached;
            }
            if !arrived {
                return End::Bound;
            }
            let factor = (self.options.step / grown.max(1e-6)).clamp(0.4, 2.0);
            step = (step * factor).min(self.scale.step_max);
        }
        End::Stopped
    }
}
