//! Where the coefficients of a site hold.

/// The operating point at which the coefficients of a site hold, and how reactive ones go from there with Q0/P0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SiteReference {
    /// Voltage, pu.
    pub v0_pu: f64,
    /// Active power, pu.
    pub p0_pu: f64,
    /// Q0/P0.
    pub ratio: f64,
    /// Changes of `d_z` and `d_i` (of P0) per change of Q0/P0.
    pub slopes: [f64; 2],
}
