//! From a window of raw samples to an event that can be fitted: bad samples at weight zero, the
//! operating point before the event, a smooth complex terminal voltage, weights.
//!
//! Voltage and angle are measurements too: their noise enters the motor multiplied by `Kpm / X'`.
//! They are smoothed as far as the data allow, between jumps and behind the instrument's filter
//! (`voltage`, `jumps`, `stiffness`).

mod edges;
mod frequency;
mod gaps;
mod jumps;
mod longer_window;
mod operating_point;
mod prepare;
mod series;
mod site_reference;
mod spikes;
mod stiffness;
mod voltage;
mod weights;

pub use edges::Edge;
pub use longer_window::longer_window;
pub use prepare::{Elsewhere, IntakeOptions, KnownTerminal, LONGER_WINDOW, PreparedEvent, prepare};
pub use site_reference::SiteReference;
pub use weights::local_motion;

use crate::disturbance::ScreeningReason;

/// Why a window cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Unusable {
    /// Fewer samples than a fit needs.
    #[error("{usable} usable samples; {required} are needed")]
    TooFewSamples {
        /// Usable samples.
        usable: usize,
        /// Samples required.
        required: usize,
    },
    /// The voltage before the event is zero or absurd.
    #[error("voltage before the event is {voltage_pu} pu")]
    NoVoltage {
        /// Mean voltage before the event, pu.
        voltage_pu: f64,
    },
    /// The power before the event is zero, negative, or drowned in noise.
    #[error(
        "active power before the event is {active_pu:?} pu with noise {noise_pu:?} pu: not a load"
    )]
    NoLoad {
        /// Mean active power before the event, pu.
        active_pu: f64,
        /// Standard deviation of its noise, pu.
        noise_pu: f64,
    },
    /// The voltage never moves by more than its noise.
    #[error("voltage moves by {change} of its pre-event value only: nothing to learn from")]
    NoDisturbance {
        /// Largest change of the complex voltage, relative.
        change: f64,
    },
    /// Screening refused the window.
    #[error("refused by screening: {0:?}")]
    Screened(Vec<ScreeningReason>),
}
