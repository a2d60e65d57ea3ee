//! loadmodeld turns PMU and disturbance-recorder streams into proven load models.
//!
//! The path, in function names: `decode -> Concentrator::push -> Detector::push -> identify ->
//! validate -> decide -> encode`. `docs/architecture.md` holds the picture and the table of who may
//! import whom; `tests/architecture.rs` keeps it true.

pub mod adapters;
pub mod commands;
pub mod config;
pub mod daemon;
pub mod diagnosis;
pub mod disturbance;
pub mod identification;
pub mod load_model;
pub mod measurement;
pub mod numerics;
pub mod service;
pub mod telemetry;
pub mod truth;
