//! CSV site folders: `site.json` and one `event_*.csv` per disturbance, for offline work, replay,
//! tests and examples.
//!
//! Rows are put on the time grid by their time stamp. A bad row, an empty cell, a NaN and a gap are
//! missing samples, never interpolated; what was found is counted in [`Intake`].

mod error;
mod onset;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use error::Error;
pub use onset::{onset, window};
pub use read::{FolderEvent, Intake, Note, SiteFolder, load_events};
pub use write::write;
