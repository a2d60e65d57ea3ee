//! The quotient gradient system (6)-(7): from anywhere to a feasible point.

use nalgebra::{Cholesky, DVector};

use super::slack_form::{FEASIBLE, SlackForm};

const STEPS_MAX: usize = 200;
const SHORTENINGS_MAX: u32 = 25;
/// Beyond this duration a step is a Gauss-Newton step, and 1/h only keeps it defined where the
/// Jacobian loses rank.
const DURATION_MAX: f64 = 1e12;

/// Integrates
///
/// ```text
/// x' = -J_H(x)' H(x)                                                           (6)
/// ```
///
/// from `x`, down its energy `E(x) = |H(x)|^2 / 2` (7), to a stable equilibrium. Returns it when it
/// is feasible (`E = 0`, to rounding); none when the equilibrium lies where the constraints
/// contradict each other, or where a constraint does not exist.
///
/// The linearly implicit Euler rule, `(I/h + J'J) dx = -J'H`, follows the stiff system with growing
/// steps and becomes the Gauss-Newton method near the equilibrium.
pub(super) fn integrate(form: &SlackForm<'_>, mut x: DVector<f64>) -> Option<DVector<f64>> {
    let mut h = form.values(&x)?;
    let mut duration = 1.0;
    for _ in 0..STEPS_MAX {
        // Two orders below what is asked for, where rounding allows it.
        if h.amax() <= 0.01 * FEASIBLE {
            break;
        }
        let Some((next, h_next, lasted)) = step(form, &x, &h, duration) else {
            break;
        };
        (x, h, duration) = (next, h_next, (lasted * 10.0).min(DURATION_MAX));
    }
    (h.amax() <= FEASIBLE).then_some(x)
}

/// The energy (7) that is left at `p` with the best slacks: half the squared violations. Exactly 0
/// where `p` is feasible.
pub(super) fn energy(form: &SlackForm<'_>, p: &DVector<f64>) -> Option<f64> {
    let h = form.own_values(p)?;
    let squared_violation = |(i, h): (usize, &f64)| {
        let is_satisfied = h.abs() <= FEASIBLE || (i >= form.equalities() && *h < 0.0);
        if is_satisfied { 0.0 } else { h * h }
    };
    Some(0.5 * h.iter().enumerate().map(squared_violation).sum::<f64>())
}

/// One step that lowers the energy, at most `duration` long; none at an equilibrium.
fn step(
    form: &SlackForm<'_>,
    x: &DVector<f64>,
    h: &DVector<f64>,
    mut duration: f64,
) -> Option<(DVector<f64>, DVector<f64>, f64)> {
    let jacobian = form.jacobian(x)?;
    let slope = jacobian.tr_mul(h);
    // An equilibrium with energy left: infeasible.
    if slope.norm() <= 1e-9 * h.norm() {
        return None;
    }
    let normal = jacobian.tr_mul(&jacobian);
    for _ in 0..SHORTENINGS_MAX {
        let mut matrix = normal.clone();
        for i in 0..matrix.nrows() {
            matrix[(i, i)] += 1.0 / duration;
        }
        let next = Cholesky::new(matrix).map(|factor| x - factor.solve(&slope));
        if let Some(next) = next
            && let Some(h_next) = form.values(&next)
            && h_next.norm() < h.norm()
        {
            return Some((next, h_next, duration));
        }
        duration *= 0.1;
    }
    None
}
