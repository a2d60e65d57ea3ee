//! How the reactive coefficients of a load go with its Q0/P0 from event to event.
//!
//! The coefficients are relative to P0 (10). A load that draws more Q at one event than at another draws it with
//! something: with its static part as a whole, whose shares (11) stay, or with capacitors,
//!
//! ```text
//! shares stay:   d_z = Q_Z r + Kpm/x,   d_i = Q_I r,   r = Q_ZIP0/P0     (1)
//! capacitors:    d_z = d + Q0/P0,       d_i constant                     (2)
//! ```
//!
//! so in either case `d_z` and `d_i` are lines over Q0/P0, of the load behind it where there is a feeder or generation
//! ([`SiteReference`]). Their slopes are estimated from what single events say of
//! the two coefficients, by regression with a prior between (1) and (2); the scatter about the lines is
//! estimated with them, by the greatest likelihood over a grid, as slopes are worth what it lets them be.
//! `docs/decisions/0053-reactive-power-goes-with-q0.md` has what it brings.

use nalgebra::{Matrix2, Matrix4, Matrix4x2, Vector2, Vector4};

use super::{
    ParameterEstimate,
    between_events::{EventQ, event_q},
    fit::FitSolution,
    identify::median_operating_point,
    intake::{PreparedEvent, SiteReference},
    joint_problem::ProblemOptions,
};

/// Slopes of `d_z` and `d_i` where the events say nothing of them ...
const PRIOR_MEAN: [f64; 2] = [0.7, 0.2];
/// ... and their standard deviations.
const PRIOR_DEVIATION: [f64; 2] = [0.4, 0.4];
/// Scatter about the lines that is tried, over the spread of the composition that fits assume.
const SCATTERS: [f64; 9] = [0.05, 0.1, 0.2, 0.35, 0.6, 1.0, 2.0, 4.0, 8.0];
/// Fewest events between which there is a trend.
const EVENTS_MIN: usize = 2;

/// Names of a trend's numbers in parameter sets.
const NAMES: [&str; 5] = [
    "Q0_over_P0",
    "d_z_by_Q0_over_P0",
    "d_i_by_Q0_over_P0",
    "site_V0",
    "site_P0",
];
const MEANINGS: [&str; 5] = [
    "Q0/P0 at which d_z and d_i hold",
    "change of d_z per change of Q0/P0 from event to event",
    "change of d_i per change of Q0/P0 from event to event",
    "V0 at which the coefficients hold",
    "P0 at which the coefficients hold",
];

/// Lines of `d_z` and `d_i` over Q0/P0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReactiveTrend {
    /// Q0/P0 at which the coefficients of the site hold.
    pub ratio: f64,
    /// Changes of `d_z` and `d_i` (of P0) per change of Q0/P0.
    pub slopes: [f64; 2],
    /// V0 and P0 of the site, pu, at which they hold; none in what earlier versions stored.
    pub site: Option<[f64; 2]>,
    /// Their standard errors; none for a trend that was stored.
    pub standard_errors: Option<[f64; 2]>,
}

impl ReactiveTrend {
    /// The trend between events at the joint solution of them all; none (slopes of zero) for a single event.
    #[must_use]
    pub fn between(
        solution: &FitSolution,
        events: &[PreparedEvent],
        options: &ProblemOptions,
    ) -> Self {
        let at = median_operating_point(events);
        let ratio = at.q0_pu / at.p0_pu;
        let site = Some([at.v0_pu, at.p0_pu]);
        let seen: Vec<EventQ> = events
            .iter()
            .filter_map(|event| event_q(solution, event, options))
            .collect();
        if seen.len() < EVENTS_MIN {
            return Self {
                ratio,
                site,
                ..Self::default()
            };
        }
        let spread = [options.composition_spread[3], options.composition_spread[4]];
        let best = (SCATTERS.iter())
            .filter_map(|scatter| regression(&seen, ratio, spread.map(|s| scatter * s)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let (slopes, errors) = best.map_or((PRIOR_MEAN, PRIOR_DEVIATION), |(_, found)| found);
        Self {
            ratio,
            slopes,
            site,
            standard_errors: Some(errors),
        }
    }

    /// The event with its reactive coefficients on these lines.
    #[must_use]
    pub fn applied_to(&self, event: &PreparedEvent) -> PreparedEvent {
        let change = event.q0_pu / event.p0_pu - self.ratio;
        let mut own = event.clone();
        own.reactive_offset = self.slopes.map(|slope| slope * change);
        own.site = self.site.map(|[v0_pu, p0_pu]| SiteReference {
            v0_pu,
            p0_pu,
            ratio: self.ratio,
            slopes: self.slopes,
        });
        own
    }

    /// Its numbers with their names, in a fixed order.
    pub fn values(&self) -> impl Iterator<Item = (&'static str, f64)> + use<> {
        let [z, i] = self.slopes;
        let numbers = [self.ratio, z, i]
            .into_iter()
            .chain(self.site.into_iter().flatten());
        NAMES.into_iter().zip(numbers)
    }

    /// From numbers by name; no trend where one is missing, as in what earlier versions stored.
    pub(super) fn from_values(value: impl Fn(&str) -> Option<f64>) -> Self {
        let [ratio, z, i, v0_pu, p0_pu] = NAMES.map(|name| value(name).filter(|v| v.is_finite()));
        match (ratio, z, i) {
            (Some(ratio), Some(z), Some(i)) => Self {
                ratio,
                slopes: [z, i],
                site: v0_pu.zip(p0_pu).map(|(v0_pu, p0_pu)| [v0_pu, p0_pu]),
                standard_errors: None,
            },
            _ => Self::default(),
        }
    }

    /// As derived quantities of a parameter set; none of a single event, which shows no trend. The events determine a slope where they leave less than half of what
    /// was known of it before.
    pub(super) fn estimates(&self) -> impl Iterator<Item = ParameterEstimate> {
        let error = |slope: usize| {
            let error = self.standard_errors.map(|errors| errors[slope]);
            error.filter(|error| *error < 0.5 * PRIOR_DEVIATION[slope])
        };
        let told = [
            (true, None),
            (error(0).is_some(), error(0)),
            (error(1).is_some(), error(1)),
            (true, None),
            (true, None),
        ];
        let named = self.values().zip(MEANINGS).zip(told);
        let shown = named.filter(|_| self.standard_errors.is_some());
        shown.map(
            |(((name, value), meaning), (identifiable, standard_error))| ParameterEstimate {
                name: name.to_owned(),
                meaning: meaning.to_owned(),
                value,
                unit: if NAMES[3..].contains(&name) {
                    "pu"
                } else {
                    "1"
                }
                .to_owned(),
                lower: f64::NEG_INFINITY,
                upper: f64::INFINITY,
                standard_error,
                at_bound: false,
                identifiable,
                interval: None,
            },
        )
    }
}

/// Slopes and their standard errors.
type Slopes = ([f64; 2], [f64; 2]);

/// Minus twice the log likelihood (but for constants) of the events' coefficients on two lines with this scatter about
/// them, slopes and levels integrated out, and the slopes.
fn regression(seen: &[EventQ], ratio: f64, scatter: [f64; 2]) -> Option<(f64, Slopes)> {
    let mean = Vector4::new(0.0, 0.0, PRIOR_MEAN[0], PRIOR_MEAN[1]);
    let prior = PRIOR_DEVIATION.map(|deviation: f64| deviation.powi(-2));
    // Levels are free.
    let mut normal = Matrix4::from_diagonal(&Vector4::new(0.0, 0.0, prior[0], prior[1]));
    let mut right = normal * mean;
    let mut value = mean.dot(&right);
    for event in seen {
        let change = event.ratio - ratio;
        let variance = event.variance
            + Matrix2::from_diagonal(&Vector2::new(scatter[0].powi(2), scatter[1].powi(2)));
        let precision = variance.try_inverse()?;
        let rows = Matrix4x2::new(1.0, 0.0, 0.0, 1.0, change, 0.0, 0.0, change);
        normal += rows * precision * rows.transpose();
        right += rows * precision * event.coefficients;
        value += event.coefficients.dot(&(precision * event.coefficients));
        value += variance.determinant().ln();
    }
    let found = normal.cholesky()?.solve(&right);
    // With the levels and slopes integrated out the scatter is not taken for smaller than it is.
    value += normal.determinant().ln() - right.dot(&found);
    let covariance = normal.try_inverse()?;
    let errors = [2, 3].map(|i| covariance[(i, i)].sqrt());
    (value.is_finite()).then_some((value, ([found[2], found[3]], errors)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn events(coefficients: impl Fn(f64, usize) -> (f64, f64)) -> Vec<EventQ> {
        (0..9)
            .map(|e| {
                let ratio = 0.30 + 0.005 * ((7 * e) % 9) as f64;
                let (square, line) = coefficients(ratio, e);
                EventQ {
                    ratio,
                    squared_voltage_per_power: 1.0,
                    coefficients: Vector2::new(square, line),
                    variance: Matrix2::from_diagonal_element(1e-6),
                }
            })
            .collect()
    }

    fn slopes(seen: &[EventQ]) -> Slopes {
        let found = SCATTERS
            .iter()
            .filter_map(|s| regression(seen, 0.32, [0.02 * s; 2]));
        found.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap().1
    }

    #[test]
    fn lines_are_found_where_events_lie_on_them() {
        for [z, i] in [[0.9, 0.05], [1.0, 0.0], [0.0, 0.0]] {
            let seen = events(|ratio, _| (0.4 + z * ratio, 0.1 + i * ratio));
            let (found, errors) = slopes(&seen);
            for ((found, true_slope), error) in found.iter().zip([z, i]).zip(errors) {
                assert!((found - true_slope).abs() < 0.05, "{found} {true_slope}");
                assert!(error < 0.05, "{error}");
            }
        }
    }

    #[test]
    fn scatter_leaves_the_prior() {
        let wild = |_: f64, e: usize| {
            let sign = if e.is_multiple_of(2) { 1.0 } else { -1.0 };
            (0.4 + 0.1 * sign, 0.1 - 0.1 * sign)
        };
        let (found, errors) = slopes(&events(wild));
        for ((found, mean), error) in found.iter().zip(PRIOR_MEAN).zip(errors) {
            assert!((found - mean).abs() < 0.2, "{found}");
            assert!(error > 0.3, "{error}");
        }
    }

    #[test]
    fn a_trend_comes_back_from_its_names() {
        let trend = ReactiveTrend {
            ratio: 0.3,
            slopes: [0.8, 0.1],
            site: Some([1.01, 0.9]),
            standard_errors: None,
        };
        let value = |name: &str| trend.values().find(|v| v.0 == name).map(|v| v.1);
        assert_eq!(ReactiveTrend::from_values(value), trend);
        // Earlier versions stored the first three.
        let earlier = |name: &str| value(name).filter(|_| NAMES[..3].contains(&name));
        let without_site = ReactiveTrend {
            site: None,
            ..trend
        };
        assert_eq!(ReactiveTrend::from_values(earlier), without_site);
        assert_eq!(
            ReactiveTrend::from_values(|_| None),
            ReactiveTrend::default()
        );
    }
}
