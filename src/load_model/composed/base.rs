//! The parameters every composed model has: those of ZIP and motor.

use crate::load_model::effect::{Parameter, Prior, Reference, Role, Scale};

/// Number of base parameters.
pub const BASE_PARAMETERS: usize = 8;

const fn base(
    [name, symbol, unit]: [&'static str; 3],
    [lower, typical, upper]: [f64; 3],
    [centre, deviation]: [f64; 2],
) -> Parameter {
    Parameter {
        name,
        symbol,
        unit,
        lower,
        upper,
        neutral: typical,
        typical,
        prior: Prior {
            centre,
            deviation,
            scale: Scale::Linear,
        },
        role: Role::Base,
        reference: Reference::Anywhere,
        resolution: 0.0,
    }
}

const LN_HALF: f64 = -std::f64::consts::LN_2;
const LN_300: f64 = 5.703_782_474_656_201;
const LN_400000: f64 = 12.899_219_826_090_12;
const UNKNOWN: [f64; 2] = [0.0, f64::INFINITY];

/// Base parameters in the order of the model's vector: `ln alpha`, `ln nu`, `kappa`, and the linear
/// coefficients of [`LinearCoefficients`](crate::load_model::LinearCoefficients). The bounds are
/// those of the joint problem of `identification`, the priors on the static coefficients too; but `nu` reaches ten times
/// as far, H of some milliseconds: a load may be motors of next to no inertia (decision 0072). With `x'` in
/// it `kappa` falls with V0^2 and `nu` rises with it; `alpha` has no impedance in it.
pub const BASE: [Parameter; BASE_PARAMETERS] = [
    base(
        ["ln_alpha", "ln alpha", "1"],
        [LN_HALF, 3.5, LN_300],
        UNKNOWN,
    ),
    base(["ln_nu", "ln nu", "1"], [LN_HALF, 7.0, LN_400000], UNKNOWN)
        .with_reference(Reference::LogarithmOfGroupAdmittance),
    base(["kappa", "kappa", "1"], [0.01, 0.36, 0.995], UNKNOWN)
        .with_reference(Reference::GroupImpedance),
    base(["motor_share", "K", "1"], [0.02, 0.4, 0.95], UNKNOWN),
    base(
        ["active_quadratic", "c_z", "1"],
        [-0.4, 0.2, 1.2],
        [0.2, 1.0],
    ),
    base(["active_linear", "c_i", "1"], [-0.8, 0.2, 1.4], [0.2, 1.0]),
    base(
        ["reactive_quadratic", "d_z", "1"],
        [-1.5, 0.4, 2.0],
        [0.2, 1.0],
    ),
    base(
        ["reactive_linear", "d_i", "1"],
        [-2.0, 0.1, 2.5],
        [0.2, 1.0],
    ),
];
