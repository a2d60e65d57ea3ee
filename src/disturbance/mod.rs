//! Finding disturbances in a stream of samples, cutting them out as windows, and judging whether
//! a window can teach anything about the load.

pub mod detector;
pub mod recording;
pub mod screening;
pub mod window;

pub use detector::{Detector, DetectorOptions, DetectorState, VoltageReference};
pub use recording::window_of_recording;
pub use screening::{ScreeningOptions, screen};
pub use window::{Closing, Screening, ScreeningReason, Trigger, Window, window_id};

#[cfg(test)]
mod test_data;
