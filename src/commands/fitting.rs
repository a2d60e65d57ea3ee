//! What `identify` and `compare` share: the options of a fit, and the fit of a site folder.

use std::time::{Duration, Instant};

use crate::{
    adapters::recordings::site_folder::{self, SiteFolder},
    disturbance::{ScreeningOptions, Window, screen},
    identification::{self, Identification, IdentificationError, IdentificationOptions, Split},
};

/// Options of a fit.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct FitArgs {
    /// Parts of the model.
    #[arg(long, value_name = "A+B", default_value = "zip+induction_motor")]
    pub structure: String,
    /// Events to fit, by name; default: all that are not held out.
    #[arg(long, value_name = "EVENT,...", value_delimiter = ',')]
    pub train: Vec<String>,
    /// Events to hold out, by name; default: a third, or none with --train.
    #[arg(long, value_name = "EVENT,...", value_delimiter = ',')]
    pub hold_out: Vec<String>,
}

impl FitArgs {
    /// The settings these options stand for.
    #[must_use]
    pub fn options(&self) -> IdentificationOptions {
        let named = !(self.train.is_empty() && self.hold_out.is_empty());
        let default = IdentificationOptions::default();
        if !named {
            return default;
        }
        let split = Split::Named {
            fitted: self.train.clone(),
            held_out: self.hold_out.clone(),
        };
        IdentificationOptions { split, ..default }
    }

    fn parts(&self) -> Vec<String> {
        self.structure
            .split('+')
            .map(|part| part.trim().to_owned())
            .collect()
    }
}

/// The events of a folder that screening lets pass, and those it refuses with the reason.
#[derive(Debug)]
pub(super) struct ScreenedWindows {
    /// Windows that bear the names of their files.
    pub usable: Vec<Window>,
    /// Event and why it is not used.
    pub refused: Vec<(String, String)>,
}

/// Cuts and screens every event of a folder, as the daemon does.
#[must_use]
pub(super) fn screened(folder: &SiteFolder) -> ScreenedWindows {
    let mut windows = ScreenedWindows {
        usable: Vec::new(),
        refused: Vec::new(),
    };
    for event in &folder.events {
        let window = Window {
            id: event.name.clone(),
            ..site_folder::window(&folder.site, &event.record)
        };
        let verdict = screen(&window, &ScreeningOptions::default());
        if verdict.usable() {
            windows.usable.push(window);
        } else {
            let reasons: Vec<String> = verdict.refusals.iter().map(ToString::to_string).collect();
            windows.refused.push((window.id, reasons.join("; ")));
        }
    }
    windows
}

/// Fits the usable windows, with a spinner on a terminal; the cost carries the wall-clock time.
///
/// # Errors
///
/// See [`IdentificationError`].
#[allow(
    clippy::disallowed_methods,
    reason = "a command is where wall-clock time is measured"
)]
pub(super) fn identify(
    args: &FitArgs,
    folder: &SiteFolder,
    windows: &ScreenedWindows,
    options: &IdentificationOptions,
) -> Result<Identification, IdentificationError> {
    let spinner = indicatif::ProgressBar::new_spinner();
    spinner.set_message(format!("identifying from {} events", windows.usable.len()));
    spinner.enable_steady_tick(Duration::from_millis(120));
    let begun = Instant::now();
    let found = identification::identify(
        &folder.site,
        &windows.usable,
        &args.parts(),
        options,
        &|| false,
    );
    spinner.finish_and_clear();
    let mut found = found.map_err(|error| with_screened(error, &windows.refused))?;
    found.cost.seconds = begun.elapsed().as_secs_f64();
    found.refused.extend(windows.refused.iter().cloned());
    found.refused.sort();
    Ok(found)
}

fn with_screened(error: IdentificationError, screened: &[(String, String)]) -> IdentificationError {
    match error {
        IdentificationError::NoUsableEvent { mut refused } => {
            refused.extend(screened.iter().cloned());
            IdentificationError::NoUsableEvent { refused }
        }
        other => other,
    }
}
