//! The command line.

pub mod compare;
pub mod check_config;
pub mod generate;
pub mod inspect;

use std::process::ExitCode;

/// Parses the command line and runs the command.
#[must_use]
pub fn main() -> ExitCode {
    ExitCode::SUCCESS
}
