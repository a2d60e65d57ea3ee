//! The projected gradient system (8) on a constraint surface.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::{quotient_gradient, slack_form::SlackForm, tangent::Tangent};
use crate::numerics::{Expansion, objective::Counted};

/// Times a step is halved before the infeasible point is corrected (section 5: "several attempts").
const HALVINGS_MAX: u32 = 8;
/// Largest `|H_i|` a step may leave behind before it counts as infeasible; in widths of the box.
const DRIFT_MAX: f64 = 0.02;

/// A feasible point and the objective around its `p`.
pub(super) struct Feasible {
    pub(super) x: DVector<f64>,
    pub(super) expansion: Expansion,
}

/// Integrates
///
/// ```text
/// x' = -P_H(x) grad f(x)                                                       (8)
/// ```
///
/// from the feasible point `x` for at most `steps` steps, or until `recognises` knows where it leads;
/// none when the objective does not exist there. Linearly implicit Euler on the tangent space, `(I/h + P B P) dx = -P grad f` with `B` the
/// Hessian of the Lagrangian; the first step is `length` long, then h doubles. A step that leaves
/// the constraint surface too far, leads to where the objective does not exist, or upwards, is
/// halved; when that does not help, the infeasible point is corrected by the quotient gradient
/// system and the integration goes on from there (section 5).
pub(super) fn integrate(
    form: &SlackForm<'_>,
    counted: &mut Counted<'_>,
    x: DVector<f64>,
    (steps, length): (usize, f64),
    recognises: &dyn Fn(&DVector<f64>, &Expansion) -> bool,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Feasible> {
    let expansion = counted.expansion(&form.parameters_of(&x))?;
    let mut at = Feasible { x, expansion };
    let mut duration: Option<f64> = None;
    for _ in 0..steps {
        if recognises(&form.parameters_of(&at.x), &at.expansion) {
            break;
        }
        let Some(field) = Field::new(form, &at) else {
            break;
        };
        let first = length / field.descent.norm();
        let mut lasts = duration.unwrap_or(first);
        if !lasts.is_finite() {
            break;
        }
        let mut next = None;
        for halvings in 0..=HALVINGS_MAX {
            if cancel() {
                return Some(at);
            }
            let drift_max = if halvings < HALVINGS_MAX {
                DRIFT_MAX
            } else {
                f64::INFINITY
            };
            next = field.step(lasts).and_then(|step| {
                let trial = &at.x + step;
                corrected(form, counted, trial, drift_max, at.expansion.value)
            });
            if next.is_some() {
                break;
            }
            lasts *= 0.5;
        }
        let Some(next) = next else {
            break;
        };
        at = next;
        duration = Some(lasts * 2.0);
    }
    Some(at)
}

/// `x` brought back onto the constraint surface; none when it is too far away or not lower.
fn corrected(
    form: &SlackForm<'_>,
    counted: &mut Counted<'_>,
    x: DVector<f64>,
    drift_max: f64,
    value_max: f64,
) -> Option<Feasible> {
    if form.values(&x)?.amax() > drift_max {
        return None;
    }
    let x = quotient_gradient::integrate(form, x)?;
    let expansion = counted.expansion(&form.parameters_of(&x))?;
    (expansion.value <= value_max).then_some(Feasible { x, expansion })
}

/// The right-hand side of (8) at a point, with what an implicit step needs.
struct Field {
    descent: DVector<f64>,
    curvature: DMatrix<f64>,
}

impl Field {
    fn new(form: &SlackForm<'_>, at: &Feasible) -> Option<Self> {
        let tangent = Tangent::new(&form.jacobian(&at.x)?);
        let gradient = with_slacks(&at.expansion.gradient, at.x.len());
        let curvature = lagrangian_hessian(form, at, &tangent)?;
        Some(Self {
            descent: -tangent.project(&gradient), // (8)
            curvature: tangent.project_matrix(&curvature),
        })
    }

    fn step(&self, duration: f64) -> Option<DVector<f64>> {
        let mut matrix = self.curvature.clone();
        for i in 0..matrix.nrows() {
            matrix[(i, i)] += 1.0 / duration;
        }
        Some(Cholesky::new(matrix)?.solve(&self.descent))
    }
}

/// Hessian of `f + lambda'H` at a feasible point, with respect to `x = [p, s]`: the objective's and
/// the constraints' curvature for `p`, `2 lambda_j` for the slacks.
pub(super) fn lagrangian_hessian(
    form: &SlackForm<'_>,
    at: &Feasible,
    tangent: &Tangent,
) -> Option<DMatrix<f64>> {
    let (n, fixed) = (form.parameters(), form.equalities());
    let multipliers = tangent.multipliers(&with_slacks(&at.expansion.gradient, at.x.len()));
    let block =
        &at.expansion.curvature + form.curvature(&form.parameters_of(&at.x), &multipliers)?;
    let mut hessian = DMatrix::zeros(at.x.len(), at.x.len());
    hessian.view_mut((0, 0), (n, n)).copy_from(&block);
    for (i, multiplier) in (n..).zip(&multipliers[fixed..]) {
        hessian[(i, i)] = 2.0 * multiplier;
    }
    Some(hessian)
}

/// `[gradient, 0]`: the objective does not depend on the slacks.
fn with_slacks(gradient: &DVector<f64>, length: usize) -> DVector<f64> {
    gradient.clone().resize_vertically(length, 0.0)
}
