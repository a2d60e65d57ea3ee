//! The projected gradient system (8) on a box.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::numerics::{Bounds, Expansion, side_by_side::Ask};

/// Times a step may be halved before the integration stops where it is.
const HALVINGS_MAX: u32 = 8;

/// Integrates `x' = -P grad f(x)` from `x` for at most `steps` steps, or until `recognises` knows where
/// it leads, and returns where it ends; none when the objective does not exist at `x`.
///
/// On a box the projection `P` drops the components that would leave it. The method is the linearly
/// implicit Euler rule, `(I/h + H) s = -grad f`: like the system itself it cannot leave a basin by
/// a long step, and unlike the explicit rule it is not held up by stiffness. The first step is
/// `length` long along the gradient; from then on h doubles, and is halved instead where the
/// objective does not exist or would rise (section 5).
pub(super) async fn integrate<A: Ask>(
    asking: &mut A,
    bounds: &Bounds,
    mut x: DVector<f64>,
    (steps, length): (usize, f64),
    recognises: &dyn Fn(&DVector<f64>, &Expansion) -> bool,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<(DVector<f64>, Expansion)> {
    let mut at = asking.expansion(&x).await?;
    let mut duration = length / projected(&at.gradient, &x, bounds).norm();
    for _ in 0..steps {
        if recognises(&x, &at) {
            break;
        }
        let gradient = projected(&at.gradient, &x, bounds);
        let mut halvings = 0;
        let next = loop {
            if halvings > HALVINGS_MAX || !duration.is_finite() || cancel() {
                return Some((x, at));
            }
            let step = implicit_euler_step(&gradient, &at.curvature, duration);
            let trial = step.map(|step| bounds.clamped(&(&x + step)));
            let expansion = match &trial {
                Some(trial) => asking.expansion(trial).await,
                None => None,
            };
            match (trial, expansion) {
                (Some(trial), Some(expansion)) if expansion.value <= at.value => {
                    break (trial, expansion);
                }
                _ => duration *= 0.5,
            }
            halvings += 1;
        };
        (x, at) = next;
        duration *= 2.0;
    }
    Some((x, at))
}

/// `(I/h + H) s = -g` on the coordinates where the projected gradient is not 0; none where the
/// matrix is not positive definite.
fn implicit_euler_step(
    gradient: &DVector<f64>,
    curvature: &DMatrix<f64>,
    duration: f64,
) -> Option<DVector<f64>> {
    let moving: Vec<usize> = (0..gradient.len())
        .filter(|&i| gradient[i].abs() > 0.0)
        .collect();
    let matrix = DMatrix::from_fn(moving.len(), moving.len(), |row, column| {
        let shift = if row == column { 1.0 / duration } else { 0.0 };
        curvature[(moving[row], moving[column])] + shift
    });
    let right = DVector::from_fn(moving.len(), |row, _| -gradient[moving[row]]);
    let solved = Cholesky::new(matrix)?.solve(&right);
    let mut step = DVector::zeros(gradient.len());
    for (row, &i) in moving.iter().enumerate() {
        step[i] = solved[row];
    }
    Some(step)
}

/// The gradient without the components whose descent leaves the box.
fn projected(gradient: &DVector<f64>, x: &DVector<f64>, bounds: &Bounds) -> DVector<f64> {
    DVector::from_fn(x.len(), |i, _| {
        let leaves = (x[i] <= bounds.lower[i] && gradient[i] > 0.0)
            || (x[i] >= bounds.upper[i] && gradient[i] < 0.0);
        if leaves { 0.0 } else { gradient[i] }
    })
}
