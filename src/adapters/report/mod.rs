//! One self-contained HTML file that shows a model against its measurements: verdict, parameters,
//! errors, and per event the curves, the residuals and the noise they are judged by.
//!
//! The file names no other host, runs no script, follows the reader's light or dark setting, and
//! every figure carries a description and the data it was drawn from. Everything that comes from
//! data is escaped on its way in.

pub(in crate::adapters) mod decimate;
mod document;
mod event;
mod figure;
pub(in crate::adapters) mod number;
mod overview;
mod profile;
mod search_figures;
mod sentence;
mod tables;

#[cfg(test)]
pub(crate) mod fixture;

pub use document::{Report, Rival, Search, render};
pub use figure::ReportError;
pub use profile::profile_svg;
pub use search_figures::{along_directions, tiers};
pub use tables::role;
