//! Finding disturbances in a stream of samples, cutting them out as windows, and judging whether
//! a window can teach anything about the load.

pub mod detector;
pub mod window;

pub use detector::{Detector, DetectorOptions, DetectorState, VoltageReference};
pub use window::{Closing, Screening, ScreeningReason, Trigger, Window, window_id};
pub mod stub;
pub use stub::*;
