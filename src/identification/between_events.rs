//! Whether several events of a site say more about the null direction than one.
//!
//! P and Q of event `e` determine, besides the motor's coordinates, its coefficients `d_z` and `d_i` of
//! Q. The reactance `x` on the motor's own base enters `d_z` alone, as `Kpm/x`. A joint fit whose `d_z`
//! is the same unknown in every event has the null direction whatever Q0, P0 and V0 do. It ends only
//! where an assumption ties the events' `d_z` together in another way:
//!
//! ```text
//! shares:  d_z = Q_Z r + Kpm/x,  d_i = Q_I r,  r = Q0/P0 - Kpm (1/x + G (1 - a0))     (1)
//! rating:  d_z = z + w V0^2/P0,  d_i constant,  w = 1/X in pu of the load base        (2)
//! ```
//!
//! (1) holds where the static load keeps its shares `Q_Z`, `Q_I` while its Q0 varies, (2) where the same
//! motors run, at a constant rating, beside a static load that follows P0. Neither can be seen from
//! one event, and each makes a figure of `x` out of nothing where it is wrong: capacitors that are
//! switched vary Q0 and `d_z` alike, which (1) takes for a motor. So the estimates here are offered
//! beside the published interval, with the test whether the events obey the assumption, and never
//! replace it (`docs/identifiability.md` has the measured figures).

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use super::{
    fit::FitSolution,
    intake::PreparedEvent,
    joint_problem::{JointProblem, LINEAR, OUTER, ProblemOptions},
};

/// What is taken to be the same at every event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tie {
    /// (1): the static load's shares of its own Q.
    SharesOfStaticQ,
    /// (2): the motors' rating.
    MotorRating,
}

/// The reciprocal reactance on the motor's own base that an assumption implies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiedReactance {
    /// The assumption.
    pub tie: Tie,
    /// Estimate of `1/x` at the median operating point.
    pub reciprocal: f64,
    /// Its standard error, from the events' scatter where that is larger than assumed.
    pub standard_error: f64,
    /// Sum of squared deviations of the events' `d_z`, `d_i` from the assumption, in units of their
    /// variances.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub freedom: f64,
}

impl TiedReactance {
    /// Whether it says more than the plausible range of 1 to 6: two standard errors fit in it.
    #[must_use]
    pub fn is_informative(&self) -> bool {
        2.0 * self.standard_error < 1.0 - 1.0 / 6.0
    }
}

/// What P and Q of one event say of its reactive coefficients.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct EventQ {
    /// Q0/P0.
    pub(super) ratio: f64,
    /// V0^2/P0.
    pub(super) squared_voltage_per_power: f64,
    /// `d_z`, `d_i`.
    pub(super) coefficients: Vector2<f64>,
    /// What the event's noise leaves of them.
    pub(super) variance: Matrix2<f64>,
}

/// Range of `1/x` that is searched.
const RECIPROCAL: (f64, f64) = (0.02, 2.0);
/// Points of that search.
const POINTS: u32 = 400;

/// Estimates under each assumption, at the joint solution. Empty for fewer than three events.
#[must_use]
pub fn tied_reactances(
    solution: &FitSolution,
    events: &[PreparedEvent],
    options: &ProblemOptions,
) -> Vec<TiedReactance> {
    let [.., z, i] = options.composition_spread;
    let spread = Matrix2::from_diagonal(&Vector2::new(z.powi(2), i.powi(2)));
    let with_spread = |seen: EventQ| EventQ {
        variance: seen.variance + spread,
        ..seen
    };
    let seen: Vec<EventQ> = events
        .iter()
        .filter_map(|event| event_q(solution, event, options).map(with_spread))
        .collect();
    if seen.len() < 3 {
        return Vec::new();
    }
    let kappa = solution.found.local.x[2];
    let share = solution.point.linear[0];
    // G (1 - a0) with G = 2/kappa and a0 = (1 + sqrt(1 - kappa^2))/2.
    let leakage = (1.0 - (1.0 - kappa * kappa).max(0.0).sqrt()) / kappa;
    [shares(&seen, share, leakage), rating(&seen, share)]
        .into_iter()
        .flatten()
        .collect()
}

/// `d_z`, `d_i` of one event with the motor's coordinates held.
pub(super) fn event_q(
    solution: &FitSolution,
    event: &PreparedEvent,
    options: &ProblemOptions,
) -> Option<EventQ> {
    let alone = ProblemOptions {
        composition_spread: [0.0; LINEAR],
        static_prior_deviation: f64::INFINITY,
        ..*options
    };
    let never = || false;
    let problem = JointProblem::new(std::slice::from_ref(event), alone, &never);
    let linear = solution.point.linear;
    let at = problem.expansion_at(&solution.found.local.x, &linear)?;
    let block = at
        .curvature
        .view((OUTER, OUTER), (LINEAR, LINEAR))
        .into_owned();
    let covariance = block.pseudo_inverse(1e-12 * at.curvature.amax()).ok()?;
    let moved = -&covariance * at.gradient.rows(OUTER, LINEAR);
    let [z, i] = event.reactive_offset;
    Some(EventQ {
        ratio: event.q0_pu / event.p0_pu,
        squared_voltage_per_power: event.v0_pu.powi(2) / event.p0_pu,
        coefficients: Vector2::new(linear[3] + moved[3] + z, linear[4] + moved[4] + i),
        variance: covariance.fixed_view::<2, 2>(3, 3).into_owned(),
    })
}

/// Weighted least squares of the events' coefficients on `columns`; value at the minimum, estimate and
/// covariance. `offset` is subtracted from `d_z`.
fn regression(
    seen: &[EventQ],
    offset: f64,
    columns: impl Fn(&EventQ) -> DMatrix<f64>,
) -> Option<(f64, DVector<f64>, DMatrix<f64>)> {
    let size = columns(seen.first()?).ncols();
    let (mut normal, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
    let mut square = 0.0;
    for event in seen {
        let precision = event.variance.try_inverse()?;
        let a = columns(event);
        let y = event.coefficients - Vector2::new(offset, 0.0);
        normal += a.transpose() * precision * &a;
        right += a.transpose() * precision * y;
        square += (y.transpose() * precision * y)[0];
    }
    let covariance = normal.try_inverse()?;
    let estimate = &covariance * &right;
    Some((square - right.dot(&estimate), estimate, covariance))
}

/// (1): linear in the shares for a given `1/x`, which is searched.
fn shares(seen: &[EventQ], share: f64, leakage: f64) -> Option<TiedReactance> {
    let value = |y: f64| {
        let found = regression(seen, share * y, |event| {
            let rest = event.ratio - share * (y + leakage);
            DMatrix::from_row_slice(2, 2, &[rest, 0.0, 0.0, rest])
        });
        found.map_or(f64::INFINITY, |(square, ..)| square)
    };
    let node =
        |i: u32| RECIPROCAL.0 + (RECIPROCAL.1 - RECIPROCAL.0) * f64::from(i) / f64::from(POINTS);
    let scan: Vec<(f64, f64)> = (0..=POINTS).map(|i| (node(i), value(node(i)))).collect();
    let best = scan.iter().copied().fold(
        (f64::NAN, f64::INFINITY),
        |a, b| if b.1 < a.1 { b } else { a },
    );
    let freedom = 2.0 * seen.len() as f64 - 3.0;
    let scale = (best.1 / freedom).max(1.0);
    // Half the width of the region in which the sum of squares rises by one.
    let inside = scan.iter().filter(|(_, s)| *s <= best.1 + scale);
    let (low, high) = inside.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (y, _)| {
        (l.min(*y), h.max(*y))
    });
    best.1.is_finite().then(|| TiedReactance {
        tie: Tie::SharesOfStaticQ,
        reciprocal: best.0,
        standard_error: (0.5 * (high - low)).max(node(1) - node(0)),
        chi_square: best.1,
        freedom,
    })
}

/// (2): linear in z, w and `d_i`.
fn rating(seen: &[EventQ], share: f64) -> Option<TiedReactance> {
    let (square, estimate, covariance) = regression(seen, 0.0, |event| {
        let w = event.squared_voltage_per_power;
        DMatrix::from_row_slice(2, 3, &[1.0, w, 0.0, 0.0, 0.0, 1.0])
    })?;
    let mut points: Vec<f64> = seen.iter().map(|e| e.squared_voltage_per_power).collect();
    points.sort_by(f64::total_cmp);
    // 1/x = w V0^2 / (Kpm P0) at the median operating point.
    let to_own_base = points[points.len() / 2] / share;
    let freedom = 2.0 * seen.len() as f64 - 3.0;
    let scale = (square / freedom).max(1.0);
    Some(TiedReactance {
        tie: Tie::MotorRating,
        reciprocal: estimate[1] * to_own_base,
        standard_error: (covariance[(1, 1)] * scale).sqrt() * to_own_base,
        chi_square: square,
        freedom,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHARE: f64 = 0.45;
    const LEAKAGE: f64 = 0.2;

    /// Events with Q0/P0 from 0.35 to 0.65 and P0 from 0.7 to 1.1; `coefficients` of ratio and
    /// `V0^2/P0`.
    fn events(coefficients: impl Fn(f64, f64) -> (f64, f64)) -> Vec<EventQ> {
        (0..8)
            .map(|e| {
                let ratio = 0.35 + 0.3 * f64::from(e) / 7.0;
                let w = 1.0 / (0.7 + 0.4 * f64::from((3 * e) % 8) / 7.0);
                let (square, line) = coefficients(ratio, w);
                EventQ {
                    ratio,
                    squared_voltage_per_power: w,
                    coefficients: Vector2::new(square, line),
                    variance: Matrix2::from_diagonal_element(1e-4),
                }
            })
            .collect()
    }

    #[test]
    fn constant_shares_of_static_q_reveal_the_reactance_when_q_varies() {
        let reciprocal = 0.35;
        let seen = events(|ratio, _| {
            let rest = ratio - SHARE * (reciprocal + LEAKAGE);
            (0.6 * rest + SHARE * reciprocal, 0.2 * rest)
        });
        let found = shares(&seen, SHARE, LEAKAGE).unwrap();
        assert!((found.reciprocal - reciprocal).abs() < 0.005, "{found:?}");
        // The grid of 1/x is 0.005 wide: the misfit half a step away is below 0.1.
        assert!(found.chi_square < 0.1 && found.freedom > 12.9);
        assert!(found.is_informative());
    }

    #[test]
    fn a_constant_rating_reveals_the_reactance_when_p_varies() {
        // w = 0.2 pu of the load base; the median of V0^2/P0 is 1.141.
        let seen = events(|_, w| (0.3 + 0.2 * w, 0.05));
        let found = rating(&seen, SHARE).unwrap();
        let mut points: Vec<f64> = seen.iter().map(|e| e.squared_voltage_per_power).collect();
        points.sort_by(f64::total_cmp);
        assert!((found.reciprocal - 0.2 * points[4] / SHARE).abs() < 1e-9);
    }

    #[test]
    fn switched_capacitors_break_the_assumption_of_constant_shares_visibly_or_mislead() {
        // The same load, Q0 varied by a capacitor: d_z moves with Q0 one to one, d_i stays.
        let truth = 0.35;
        let rest = 0.5 - SHARE * (truth + LEAKAGE);
        let seen = events(|ratio, _| (0.6 * rest + SHARE * truth + (ratio - 0.5), 0.2 * rest));
        let found = shares(&seen, SHARE, LEAKAGE).unwrap();
        let far = (found.reciprocal - truth).abs() > 3.0 * 0.05;
        assert!(far || found.chi_square > 3.0 * found.freedom, "{found:?}");
    }

    #[test]
    fn the_same_coefficients_at_every_event_determine_nothing() {
        let mut seen = events(|_, _| (0.5, 0.05));
        for event in &mut seen {
            event.ratio = 0.5;
            event.squared_voltage_per_power = 1.1;
        }
        // The same regressors at every event: the program refuses or says that nothing is known.
        assert!(rating(&seen, SHARE).is_none_or(|found| !found.is_informative()));
        assert!(shares(&seen, SHARE, LEAKAGE).is_none_or(|found| !found.is_informative()));
    }
}
