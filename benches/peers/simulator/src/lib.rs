//! The objective of a single-event fit behind a C interface, so that every optimiser of the bench
//! minimises the same function by the same simulator.
//!
//! The program's pure modules are compiled in by path: this crate builds in seconds and needs no
//! runtime. It is the only place of the repository with `unsafe`, for the pointers of the interface.

extern crate self as loadmodeld;

#[path = "../../../../src/disturbance/mod.rs"]
#[allow(dead_code, unused_imports, reason = "a part of the program")]
pub mod disturbance;
#[path = "../../../../src/identification/mod.rs"]
#[allow(dead_code, unused_imports, reason = "a part of the program")]
pub mod identification;
#[path = "../../../../src/load_model/mod.rs"]
pub mod load_model;
#[path = "../../../../src/measurement/mod.rs"]
pub mod measurement;
#[path = "../../../../src/numerics/mod.rs"]
pub mod numerics;
#[path = "../../../../src/truth/mod.rs"]
pub mod truth;

#[path = "../../../clock.rs"]
#[allow(dead_code, reason = "the benches use the rest")]
mod clock;
mod interface;
mod paper_form;
#[path = "../../../problems/mod.rs"]
#[allow(dead_code, reason = "the study uses the rest")]
mod problems;
mod reduced_form;
