//! Measurements in and parameter sets out over zenoh.

pub mod options;

pub use options::{Mode, ZenohOptions};
