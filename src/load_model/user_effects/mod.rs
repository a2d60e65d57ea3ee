//! Effects that a user writes in a TOML file: the format, its expressions, and their way into the
//! catalogue. The manual is `docs/adding-an-effect.md`.
//!
//! Nothing of a file is executed: an expression becomes a list of at most 512 operations that is
//! evaluated from front to back. Every size is bounded (file 64 kB, expression 2 kB, nesting 32, 12
//! parameters, 8 states); a division by zero or an overflow ends a simulation with
//! [`SimulationError::NotFinite`](super::SimulationError::NotFinite).

mod check;
mod compile;
mod course;
mod declared;
mod document;
mod effect;
mod file;
mod functions;
mod lexer;
mod parser;
mod problem;
mod program;
mod together;
mod unit;
mod written;

#[cfg(test)]
mod hostile;
#[cfg(test)]
mod tests;

pub use document::FILE_BYTES_MAX;
pub use file::EffectFile;
pub use problem::{Problem, nearest};
pub use together::conflicts;
