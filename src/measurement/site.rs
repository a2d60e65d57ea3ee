//! What is measured: a load at a substation and the base of its per-unit values.

/// A load and its base.
#[derive(Clone, Debug, PartialEq)]
pub struct Site {
    /// Name, one chunk of a key expression: no `/`, `*`, `$`, `?`, `#` and no space.
    pub name: String,
    /// Power base, MVA.
    pub s_base_mva: f64,
    /// Voltage base, line to line, kV.
    pub v_base_kv: f64,
    /// Nominal frequency, Hz.
    pub nominal_hz: f64,
}
