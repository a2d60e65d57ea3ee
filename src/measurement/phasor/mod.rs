//! From sampled waveforms to positive-sequence phasors: the one-cycle filter of `docs/phasors.md`.
//!
//! [`records`] turns three-phase voltages and currents into per-unit [`Record`]s on a grid; a gap
//! between pieces of a recording stays a gap.
//!
//! [`Record`]: crate::measurement::Record

mod convert;
mod filter;
mod sequence;

pub use convert::{Error, Settings, join, records, sequences_at};
pub use filter::{Complex, one_cycle_phasor};
pub use sequence::{Connection, SequencePhasors, Waveforms};
