//! The product of the service: a set of parameters with everything needed to judge and use it.

use super::{ErrorSummary, Verdict};

/// One estimated parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterEstimate {
    /// Name: the paper's symbol in ASCII for the ZIP-IM parameters (`M`, `T0_prime`, `X`,
    /// `X_prime`, `Kpm`, `Pz`, `Pi`, `Pp`, `Qz`, `Qi`, `Qq`), `effect.parameter` for an effect.
    pub name: String,
    /// What it is, in words.
    pub meaning: String,
    /// Value in `unit`.
    pub value: f64,
    /// Unit, `"1"` when dimensionless.
    pub unit: String,
    /// Lower bound of the search.
    pub lower: f64,
    /// Upper bound of the search.
    pub upper: f64,
    /// Standard error in `unit`; none where the data do not determine the parameter.
    pub standard_error: Option<f64>,
    /// Whether the estimate lies on a bound.
    pub at_bound: bool,
    /// Whether the data determine this parameter by itself.
    pub identifiable: bool,
    /// Values that describe the data as well (the valley of the null direction), where not
    /// identifiable.
    pub interval: Option<(f64, f64)>,
}

/// Base values of a parameter set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bases {
    /// Power base, MVA.
    pub s_base_mva: f64,
    /// Voltage base, line to line, kV.
    pub v_base_kv: f64,
    /// Nominal frequency, Hz.
    pub nominal_hz: f64,
}

/// The operating point to which load-base parameters refer (medians over the fitted events).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OperatingPoint {
    /// Pre-event voltage, pu.
    pub v0_pu: f64,
    /// Pre-event active power, pu.
    pub p0_pu: f64,
    /// Pre-event reactive power, pu.
    pub q0_pu: f64,
}

/// A versioned set of parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterSet {
    /// Site.
    pub site: String,
    /// Version, counted per site from 1; 0 until the service has assigned one.
    pub version: u64,
    /// Names of the parts of the model, `["zip", "induction_motor", ...effects]`.
    pub structure: Vec<String>,
    /// Version of each part's equations, in the order of `structure`.
    pub structure_versions: Vec<u32>,
    /// The parameters, in the order of the paper's (11), then effects.
    pub parameters: Vec<ParameterEstimate>,
    /// Quantities computed from the parameters in a study engineer's units (H, motor-base
    /// reactances, slip) and the identifiable coordinates.
    pub derived: Vec<ParameterEstimate>,
    /// Base values.
    pub bases: Bases,
    /// Operating point.
    pub operating_point: OperatingPoint,
    /// Events the set was fitted on.
    pub fitted_events: Vec<String>,
    /// Events held out.
    pub held_out_events: Vec<String>,
    /// Errors on the fitted events.
    pub fit: ErrorSummary,
    /// Errors on the held-out events; none when there were none.
    pub held_out: Option<ErrorSummary>,
    /// Verdict of validation.
    pub verdict: Verdict,
    /// Rank of the sensitivity matrix and its condition number.
    pub rank: usize,
    /// Largest over smallest non-zero singular value of the scaled sensitivity matrix.
    pub condition: f64,
    /// Standard error of each of the eight coordinates over what independent samples and a right
    /// model would give, in the order ln alpha, ln nu, kappa, Kpm, `c_z`, `c_i`, `d_z`, `d_i`; empty for
    /// a set of a version that did not correct.
    pub inflation: Vec<f64>,
    /// What a reader should know of single values: implausible ones, open directions, samples set
    /// aside.
    pub notes: Vec<String>,
    /// Version of the program that made the set.
    pub software_version: String,
}
