//! The command line.

pub mod check_config;
pub mod compare;
mod fitting;
pub mod generate;
pub mod identify;
pub mod inspect;

use std::process::ExitCode;

/// Parses the command line and runs the command.
#[must_use]
pub fn main() -> ExitCode {
    ExitCode::SUCCESS
}
