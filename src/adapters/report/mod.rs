//! One self-contained HTML file that shows a model against its measurements: verdict, parameters,
//! errors, and per event the curves, the residuals and the noise they are judged by.
//!
//! The file names no other host, runs no script, follows the reader's light or dark setting, and
//! every figure carries a description and the data it was drawn from. Everything that comes from
//! data is escaped on its way in.

pub(in crate::adapters) mod axis;
pub(in crate::adapters) mod decimate;
mod diagnosis;
mod diagnosis_tables;
mod document;
mod effect_picture;
mod event;
mod failure_figures;
mod figure;
mod figures;
mod improvement;
mod labels;
mod ladder_words;
pub(in crate::adapters) mod number;
mod overview;
mod page;
mod profile;
mod search_figures;
mod sentence;
mod staircase;
mod tables;

#[cfg(test)]
pub(crate) mod diagnosis_fixture;
#[cfg(test)]
pub(crate) mod fixture;

pub use diagnosis::render_diagnosis;
pub use document::{Report, Rival, Search, render};
pub use effect_picture::{PictureError, effect_residuals};
pub use figure::ReportError;
pub use figures::{NamedFigure, diagnosis_figures, improvement_figures};
pub use improvement::render_improvement;
pub use profile::profile_svg;
pub use search_figures::{along_directions, tiers};
pub use staircase::step_in_words;
