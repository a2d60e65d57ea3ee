//! Finding disturbances in a stream of samples, cutting them out as windows, and judging whether
//! a window can teach anything about the load.

pub mod window;

pub use window::{Closing, Screening, ScreeningReason, Trigger, Window};
