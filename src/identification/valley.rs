//! The null direction: what P and Q leave open of a motor, as intervals.
//!
//! With `x` the reactance X on the base of the motor's own initial power, `G = 1/x' - 1/x` and
//! `alpha = x/(x' T0')`, P and Q depend on `alpha`, `G` and on `d_z`, which holds the static share
//! `Q_Z` together with the motor's `Kpm/x`. Moving `x` at constant `alpha`, `G`, `d_z`, `d_i`
//!
//! ```text
//! 1/x'  = G + 1/x                                               (1)
//! T0'   = (1 + G x) / alpha                                     (2)
//! Q_ZIP0/P0 = Q0/P0 - Kpm (1/x + G (1 - a0))                    (3)
//! Q_Z   = (d_z - Kpm/x) P0/Q_ZIP0,  Q_I = d_i P0/Q_ZIP0         (4)
//! ```
//!
//! changes neither. What ends the valley are the boxes of T0', X and X' and the plausible range of
//! `x`; the shares of Q have a box only where the paper's (14) is asked for.

use std::ops::RangeInclusive;

use super::quantities::{PARAMETERS, Quantity, X_MOTOR_BASE, X_MOTOR_BASE_RANGE};
use crate::load_model::ZipImParameters;

/// Steps of the scan along the valley; its ends are refined by bisection.
const STEPS: u32 = 100;
/// Halvings of a step: to 1e-12 of the range.
const HALVINGS: u32 = 34;
/// The paper's box (14) for X, `Q_Z` and the constant-power share `Q_q`.
const PAPER_REACTANCE: RangeInclusive<f64> = 0.001..=4.0;
const PAPER_REACTIVE_SHARE: RangeInclusive<f64> = 0.1..=0.9;
const PAPER_REACTIVE_POWER_SHARE: RangeInclusive<f64> = 0.1..=4.0;

/// The part of the null direction that the boxes admit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Valley {
    /// Least and largest reactance on the motor's own base.
    pub(super) reactance: (f64, f64),
    /// The reactance that stands for the valley.
    representative: f64,
    /// Whether every box was kept; false where they contradict each other and the plausible range
    /// of the reactance stands alone.
    pub(super) within_boxes: bool,
}

impl Valley {
    /// The admissible part of the valley whose parameters `at` gives for a reactance on the motor's
    /// own base. `paper_box` adds the paper's narrower box for X and its boxes for the shares of Q.
    pub(super) fn new(at: impl Fn(f64) -> ZipImParameters, paper_box: bool) -> Self {
        let (from, to) = X_MOTOR_BASE_RANGE;
        let admissible = |x: f64| is_admissible(&at(x), paper_box);
        let node = |i: u32| from + (to - from) * f64::from(i) / f64::from(STEPS);
        let inside: Vec<u32> = (0..=STEPS).filter(|&i| admissible(node(i))).collect();
        let (Some(&first), Some(&last)) = (inside.first(), inside.last()) else {
            return Self {
                reactance: (from, to),
                representative: X_MOTOR_BASE,
                within_boxes: false,
            };
        };
        let refine = |mut inner: f64, mut outer: f64| {
            for _ in 0..HALVINGS {
                let middle = 0.5 * (inner + outer);
                if admissible(middle) {
                    inner = middle;
                } else {
                    outer = middle;
                }
            }
            inner
        };
        let low = if first == 0 {
            from
        } else {
            refine(node(first), node(first - 1))
        };
        let high = if last == STEPS {
            to
        } else {
            refine(node(last), node(last + 1))
        };
        let conventional = X_MOTOR_BASE.clamp(low, high);
        let nodes = inside.iter().map(|&i| node(i));
        let in_bounds = std::iter::once(conventional)
            .chain(nodes)
            .filter(|&x| has_reactive_shares_in_bounds(&at(x)));
        let away = |x: &f64| (x - conventional).abs();
        let nearest = in_bounds.min_by(|a, b| away(a).total_cmp(&away(b)));
        Self {
            reactance: (low, high),
            representative: nearest.unwrap_or(conventional),
            within_boxes: true,
        }
    }

    /// The reactance that stands for the valley: the conventional one, or the end nearest to it. Where the static
    /// reactive power is next to zero there and its shares are beyond their bounds, the nearest step at which they are
    /// not, if there is one.
    pub(super) fn representative(&self) -> f64 {
        self.representative
    }

    /// Range of a quantity along the valley. Where the static reactive power passes through zero on
    /// the way its shares pass through infinity: nothing can be said of them.
    pub(super) fn interval(
        &self,
        quantity: &Quantity,
        at: impl Fn(f64) -> ZipImParameters,
    ) -> (f64, f64) {
        let (from, to) = self.reactance;
        let node = |i: u32| at(from + (to - from) * f64::from(i) / f64::from(STEPS));
        let positive = |p: &ZipImParameters| p.q_zip0_pu > 0.0;
        if is_reactive_share(quantity)
            && (0..=STEPS).any(|i| positive(&node(i)) != positive(&at(from)))
        {
            return quantity.bounds;
        }
        // Every quantity is monotone along the valley between two signs of Q_ZIP0, so the ends of
        // the scan are the ends of the interval.
        let values = (0..=STEPS).map(|i| (quantity.value)(&node(i)));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(v), high.max(v))
        })
    }
}

fn has_reactive_shares_in_bounds(p: &ZipImParameters) -> bool {
    let shares = PARAMETERS.iter().filter(|q| is_reactive_share(q));
    shares
        .map(|q| ((q.value)(p), q.bounds))
        .all(|(value, (low, high))| (low..=high).contains(&value))
}

fn is_reactive_share(quantity: &Quantity) -> bool {
    ["Qz", "Qi", "Qq"].contains(&quantity.name)
}

fn is_admissible(p: &ZipImParameters, paper_box: bool) -> bool {
    let boxes = PARAMETERS
        .iter()
        .filter(|q| ["T0_prime", "X", "X_prime"].contains(&q.name));
    let mut inside = boxes
        .map(|q| ((q.value)(p), q.bounds))
        .all(|(value, (low, high))| (low..=high).contains(&value));
    if paper_box {
        inside &= PAPER_REACTANCE.contains(&p.x_pu)
            && PAPER_REACTIVE_SHARE.contains(&p.q_shares[0])
            && PAPER_REACTIVE_POWER_SHARE.contains(&p.q_shares[2]);
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        identification::quantities::{DERIVED, parameters_at},
        load_model::LoadBase,
    };

    const BASE: LoadBase = LoadBase {
        v0_pu: 0.98,
        p0_pu: 0.9,
        q0_pu: 0.45,
        nominal_hz: 60.0,
    };
    const COORDINATES: [f64; 8] = [3.4, 7.1, 0.42, 0.5, 0.2, 0.15, 0.6, 0.05];

    fn at(x: f64) -> ZipImParameters {
        parameters_at(&COORDINATES, x, &BASE)
    }

    #[test]
    fn intervals_agree_with_brute_force_over_the_papers_parameters() {
        // Independent of the conversion: X and T0' on a grid, X' from G, and the point kept where
        // alpha is met to the grid's width; equations (1), (2) of this file and the definitions of
        // alpha and G on the load base, with the base V0^2/(Kpm P0).
        let [ln_alpha, _, kappa, share, ..] = COORDINATES;
        let to_load_base = BASE.v0_pu.powi(2) / (share * BASE.p0_pu);
        let g = 2.0 / kappa;
        let (mut t0, mut x_prime) = ((f64::MAX, f64::MIN), (f64::MAX, f64::MIN));
        for i in 0..=500 {
            let x = (1.0 + 5.0 * f64::from(i) / 500.0) * to_load_base;
            if x > 20.0 {
                continue;
            }
            let reciprocal = g / to_load_base + 1.0 / x;
            for k in 1..=4000 {
                let time = 0.001 * f64::from(k);
                let alpha = x * reciprocal / time;
                if (alpha - ln_alpha.exp()).abs() < alpha * 0.0006 / time {
                    t0 = (t0.0.min(time), t0.1.max(time));
                    x_prime = (
                        x_prime.0.min(1.0 / reciprocal),
                        x_prime.1.max(1.0 / reciprocal),
                    );
                }
            }
        }
        let valley = Valley::new(at, false);
        let interval = |name: &str| {
            let quantity = PARAMETERS.iter().find(|q| q.name == name).unwrap();
            valley.interval(quantity, at)
        };
        let close = |a: (f64, f64), b: (f64, f64), by: f64| {
            assert!(
                (a.0 - b.0).abs() < by && (a.1 - b.1).abs() < by,
                "{a:?} {b:?}"
            );
        };
        assert!(valley.within_boxes);
        close(interval("T0_prime"), t0, 0.002);
        close(interval("X_prime"), x_prime, 0.002);
        close(interval("X"), (to_load_base, 6.0 * to_load_base), 1e-9);
    }

    #[test]
    fn the_representative_has_its_shares_of_q_within_bounds() {
        // By (3) with kappa 0.42 and Kpm 0.5, Q_ZIP0 is zero at the conventional reactance for this Q0.
        let motor = |x: f64| 0.5 * (1.0 / x + 1.0 / 0.42 * (1.0 - (1.0_f64 - 0.42 * 0.42).sqrt()));
        let base = |above: f64| LoadBase {
            q0_pu: BASE.p0_pu * (motor(X_MOTOR_BASE) + above),
            ..BASE
        };
        let shares_at = |above: f64| {
            let at = |x: f64| parameters_at(&COORDINATES, x, &base(above));
            let valley = Valley::new(at, false);
            (
                valley.representative(),
                at(valley.representative()).q_shares,
            )
        };
        let (x, shares) = shares_at(1e-4);
        assert!((x - X_MOTOR_BASE).abs() < 0.5, "{x}");
        assert!(shares.iter().all(|share| share.abs() <= 20.0), "{shares:?}");
        let conventional = parameters_at(&COORDINATES, X_MOTOR_BASE, &base(1e-4));
        assert!(conventional.q_shares.iter().any(|share| share.abs() > 1e3));
        assert!((shares_at(0.2).0 - X_MOTOR_BASE).abs() < 1e-15);
    }

    #[test]
    fn the_boxes_end_the_valley_where_they_bind() {
        // alpha = e^0.9 = 2.46: T0' = (1 + G x)/alpha reaches 4 s at x = (4 alpha - 1)/G = 1.856.
        let slow = |x: f64| {
            let mut coordinates = COORDINATES;
            coordinates[0] = 0.9;
            parameters_at(&coordinates, x, &BASE)
        };
        let valley = Valley::new(slow, false);
        let expected = (4.0 * 0.9_f64.exp() - 1.0) * 0.42 / 2.0;
        assert!((valley.reactance.1 - expected).abs() < 1e-9);
        assert!((valley.representative() - expected).abs() < 1e-9);
        let quantity = PARAMETERS.iter().find(|q| q.name == "T0_prime").unwrap();
        assert!((valley.interval(quantity, slow).1 - 4.0).abs() < 1e-8);
        // With the paper's X <= 4 pu: x <= 4 * 0.45 / 0.9604.
        // With the paper's X <= 4 pu: x <= 4 * 0.45 / 0.9604, where Q_Z is 0.18 and Q_q 0.4.
        let reactive = [3.4, 7.1, 0.42, 0.5, 0.2, 0.15, 0.3, 0.05];
        let valley = Valley::new(|x| parameters_at(&reactive, x, &BASE), true);
        assert!(valley.within_boxes);
        assert!((valley.reactance.1 - 4.0 * 0.45 / 0.9604).abs() < 1e-9);
        let stuck = |x: f64| parameters_at(&[-3.0, 7.1, 0.42, 0.5, 0.2, 0.15, 0.6, 0.05], x, &BASE);
        assert!(!Valley::new(stuck, false).within_boxes);
    }

    #[test]
    fn quantities_are_marked_as_in_the_valley_exactly_when_they_move_along_it() {
        for quantity in PARAMETERS.iter().chain(DERIVED) {
            let (a, b) = ((quantity.value)(&at(2.0)), (quantity.value)(&at(4.0)));
            let moves = (a - b).abs() > 1e-9 * a.abs().max(1.0);
            assert_eq!(moves, quantity.in_valley, "{}", quantity.name);
        }
    }
}
