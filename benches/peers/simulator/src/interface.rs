//! The C interface. Every function takes the handle of `simulator_open`; points and results are
//! arrays of doubles of the lengths named, matrices row by row. Objectives that do not exist are
//! infinite.

use std::slice;

use loadmodeld::{
    identification::{
        fit::{SearchOptions, fit},
        intake::PreparedEvent,
        joint_problem::{JointProblem, OUTER, ProblemOptions, outer_bounds},
    },
    numerics::Objective,
};
use nalgebra::{DMatrix, DVector};

use crate::{clock, paper_form, problems, reduced_form};

/// A problem in memory.
pub struct Handle {
    event: PreparedEvent,
    options: ProblemOptions,
    /// P and Q residuals.
    residuals: usize,
}

const NEVER: &(dyn Fn() -> bool + Sync) = &|| false;

impl Handle {
    fn joint(&self) -> JointProblem<'_> {
        JointProblem::new(slice::from_ref(&self.event), self.options, NEVER)
    }
}

/// Problem `index` of `seed`, to be closed by [`simulator_close`].
#[unsafe(no_mangle)]
pub extern "C" fn simulator_open(seed: u64, index: u64) -> *mut Handle {
    let index = usize::try_from(index).unwrap_or(usize::MAX);
    let event = problems::problem(seed, index).event;
    let residuals = 2 * event.len();
    let options = problems::plain_objective();
    Box::into_raw(Box::new(Handle {
        event,
        options,
        residuals,
    }))
}

/// Frees a problem.
///
/// # Safety
///
/// `handle` comes from [`simulator_open`] and is not used afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn simulator_close(handle: *mut Handle) {
    // SAFETY: by contract the pointer came out of `Box::into_raw` and is given back once.
    drop(unsafe { Box::from_raw(handle) });
}

/// Number of residuals.
///
/// # Safety
///
/// `handle` is open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn simulator_residual_count(handle: *const Handle) -> u64 {
    // SAFETY: by contract.
    unsafe { &*handle }.residuals as u64
}

/// Bounds of the form of 3 or 9 unknowns.
///
/// # Safety
///
/// `lower` and `upper` hold `unknowns` doubles.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn simulator_bounds(unknowns: u64, lower: *mut f64, upper: *mut f64) {
    // SAFETY: by contract.
    unsafe {
        if unknowns == OUTER as u64 {
            let bounds = outer_bounds();
            copy(bounds.lower.as_slice(), lower);
            copy(bounds.upper.as_slice(), upper);
        } else {
            copy(&paper_form::BOUNDS[0], lower);
            copy(&paper_form::BOUNDS[1], upper);
        }
    }
}

/// Half the sum of squares of the reduced form (3 unknowns).
///
/// # Safety
///
/// `handle` is open, `x` holds 3 doubles.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn simulator_reduced_value(handle: *const Handle, x: *const f64) -> f64 {
    // SAFETY: by contract.
    let (handle, x) = unsafe { (&*handle, slice::from_raw_parts(x, OUTER)) };
    let value = handle.joint().value(&DVector::from_column_slice(x));
    value.unwrap_or(f64::INFINITY)
}

/// Value, gradient (3) and Gauss-Newton curvature (3 x 3) of the reduced form.
///
/// # Safety
///
/// `handle` is open, the arrays have these lengths.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn simulator_reduced_expansion(
    handle: *const Handle,
    x: *const f64,
    gradient: *mut f64,
    curvature: *mut f64,
) -> f64 {
    // SAFETY: by contract.
    let (handle, x) = unsafe { (&*handle, slice::from_raw_parts(x, OUTER)) };
    let joint = handle.joint();
    let Some(at) = joint.expansion(&DVector::from_column_slice(x)) else {
        return f64::INFINITY;
    };
    // SAFETY: by contract.
    unsafe {
        copy(at.gradient.as_slice(), gradient);
        copy(at.curvature.as_slice(), curvature); // symmetric
    }
    at.value
}

/// Residuals and their Jacobian (residuals x 3) of the reduced form; 0 when they exist.
///
/// # Safety
///
/// `handle` is open, the arrays have these lengths.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn simulator_reduced_residuals(
    handle: *const Handle,
    x: *const f64,
    residuals: *mut f64,
    jacobian: *mut f64,
) -> i32 {
    // SAFETY: by contract.
    let (handle, x) = unsafe { (&*handle, slice::from_raw_parts(x, OUTER)) };
    let found = reduced_form::residuals_and_jacobian(&handle.event, &handle.options, x);
    let Some(found) = found else {
        return 1;
    };
    // SAFETY: by contract.
    unsafe { copy_both(&found, residuals, jacobian) };
    0
}

/// Half the sum of squares of the paper's form (9 unknowns).
///
/// # Safety
///
/// `handle` is open, `theta` holds 9 doubles.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn simulator_paper_value(handle: *const Handle, theta: *const f64) -> f64 {
    // SAFETY: by contract.
    let (handle, theta) = unsafe {
        (
            &*handle,
            slice::from_raw_parts(theta, paper_form::PARAMETERS),
        )
    };
    paper_form::value(&handle.event, theta).unwrap_or(f64::INFINITY)
}

/// Residuals and Jacobian (residuals x 9) of the paper's form; 0 when they exist, 1 where `X' < X` or
/// (13) is violated, 2 where the simulation is not finite.
///
/// # Safety
///
/// `handle` is open, the arrays have these lengths.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn simulator_paper_residuals(
    handle: *const Handle,
    theta: *const f64,
    residuals: *mut f64,
    jacobian: *mut f64,
) -> i32 {
    // SAFETY: by contract.
    let (handle, theta) = unsafe {
        (
            &*handle,
            slice::from_raw_parts(theta, paper_form::PARAMETERS),
        )
    };
    match paper_form::residuals_and_jacobian(&handle.event, theta) {
        Ok(found) => {
            // SAFETY: by contract.
            unsafe { copy_both(&found, residuals, jacobian) };
            0
        }
        Err(paper_form::Undefined::Infeasible) => 1,
        Err(paper_form::Undefined::NotFinite) => 2,
    }
}

/// The program's own fit of the reduced form: best point (3) and `[plain simulations, simulations with
/// sensitivities, CPU seconds, solutions]`; its objective.
///
/// # Safety
///
/// `handle` is open, `x` holds 3 doubles, `cost` 4.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn simulator_fit(handle: *const Handle, x: *mut f64, cost: *mut f64) -> f64 {
    // SAFETY: by contract.
    let handle = unsafe { &*handle };
    let started = clock::cpu_seconds();
    let found = fit(
        slice::from_ref(&handle.event),
        handle.options,
        &SearchOptions::default(),
        NEVER,
    );
    let spent_s = clock::cpu_seconds() - started;
    let Some((found, best)) = found.as_ref().and_then(|f| Some((f, f.solutions.first()?))) else {
        return f64::INFINITY;
    };
    let costs = [
        found.cost.simulations as f64,
        found.cost.sensitivity_simulations as f64,
        spent_s,
        found.solutions.len() as f64,
    ];
    // SAFETY: by contract.
    unsafe {
        copy(best.found.local.x.as_slice(), x);
        copy(&costs, cost);
    }
    best.point.objective
}

unsafe fn copy_both(
    (values, slopes): &(DVector<f64>, DMatrix<f64>),
    residuals: *mut f64,
    jacobian: *mut f64,
) {
    // SAFETY: the callers' contract gives both arrays their lengths.
    unsafe {
        copy(values.as_slice(), residuals);
        copy(slopes.transpose().as_slice(), jacobian); // row by row
    }
}

unsafe fn copy(from: &[f64], to: *mut f64) {
    // SAFETY: the callers' contract gives `to` the length of `from`.
    unsafe { slice::from_raw_parts_mut(to, from.len()) }.copy_from_slice(from);
}
