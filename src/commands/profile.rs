//! `loadmodeld profile`: how far a parameter can be moved while everything else gives way.

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
    time::Duration,
};

use super::{
    fitting::FitArgs,
    misuse::{MayBeMisuse, Misuse, names_no_event},
    source::{SourceArgs, SourceError},
    target,
};
use crate::{
    adapters::{
        report::{self, ReportError},
        wire::{DocumentError, v1::SiteProfileV1},
    },
    identification::{
        Profile, ProfileOptions, SiteProfile,
        profile::{Limit, ProfileError, profile_site},
    },
};

/// Fits a site and follows the profile likelihood of parameters: confidence intervals at 68 and 95 %.
#[derive(Clone, Debug, clap::Args)]
pub struct ProfileArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub source: SourceArgs,
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub fit: FitArgs,
    /// Parameters, units or coordinates by their names in a parameter set; `H` is the inertia constant.
    #[arg(
        long = "parameter",
        value_name = "NAME,...",
        value_delimiter = ',',
        required = true
    )]
    pub parameters: Vec<String>,
    /// Draws the profile into this SVG file; of several parameters, each with its name before the
    /// ending.
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// Prints one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Why there is no profile.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProfileCommandError {
    /// The command was used wrongly.
    #[error(transparent)]
    Misuse(#[from] Misuse),
    /// The events.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The fit or the quantity.
    #[error(transparent)]
    Profile(#[from] ProfileError),
    /// The JSON document could not be made.
    #[error(transparent)]
    Document(#[from] DocumentError),
    /// The figure could not be drawn.
    #[error(transparent)]
    Figure(#[from] ReportError),
    /// The figure could not be written.
    #[error("{}: {source}", .path.display())]
    File {
        /// Path.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The terminal or pipe.
    #[error("cannot write the result: {0}")]
    Output(#[from] io::Error),
}

impl MayBeMisuse for ProfileCommandError {
    fn is_misuse(&self) -> bool {
        match self {
            Self::Misuse(_) => true,
            Self::Profile(ProfileError::Identification(error)) => names_no_event(error),
            _ => false,
        }
    }
}

/// Profiles and prints.
///
/// # Errors
///
/// See [`ProfileCommandError`].
pub fn run(args: &ProfileArgs, out: &mut dyn Write) -> Result<(), ProfileCommandError> {
    args.fit.check()?;
    if let (Some(path), [_]) = (&args.svg, args.parameters.as_slice()) {
        target::can_be_written(path).map_err(|source| ProfileCommandError::File {
            path: path.clone(),
            source,
        })?;
    }
    let events = args.source.events()?;
    let structure = events.parts(args.fit.structure.as_deref())?;
    let options = args.fit.options(&events.identification);
    let spinner = indicatif::ProgressBar::new_spinner();
    spinner.set_message(format!("fitting {} events", events.usable.len()));
    spinner.enable_steady_tick(Duration::from_millis(120));
    let found = profile_site(
        &events.site,
        &events.usable,
        &structure,
        &args.parameters,
        (&options, &ProfileOptions::default()),
        &|name, points| spinner.set_message(format!("{name}: {points} points")),
        &|| false,
    );
    spinner.finish_and_clear();
    let found = found?;
    if args.json {
        writeln!(out, "{}", SiteProfileV1::from(&found).to_json()?)?;
    } else {
        print_all(&found, &events.notes, out)?;
    }
    if let Some(path) = &args.svg {
        for profile in &found.profiles {
            let path = figure_path(path, profile, found.profiles.len() > 1);
            let figure = report::profile_svg(profile)?;
            fs::write(&path, figure).map_err(|source| ProfileCommandError::File {
                path: path.clone(),
                source,
            })?;
        }
    }
    Ok(())
}

fn print_all(found: &SiteProfile, notes: &[String], out: &mut dyn Write) -> io::Result<()> {
    for note in notes {
        writeln!(out, "note: {note}")?;
    }
    writeln!(
        out,
        "site {}, fitted {}",
        found.site,
        found.events.join(" ")
    )?;
    for profile in &found.profiles {
        print(profile, out)?;
    }
    Ok(())
}

fn figure_path(path: &Path, profile: &Profile, several: bool) -> PathBuf {
    if several {
        path.with_extension(format!("{}.svg", profile.name))
    } else {
        path.to_path_buf()
    }
}

fn print(profile: &Profile, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "\n{}: {} ({})\n  estimate {:.5}, standard error {:.5}",
        profile.name, profile.meaning, profile.unit, profile.estimate, profile.standard_error
    )?;
    for interval in &profile.intervals {
        writeln!(
            out,
            "  {:.0} % confidence: {} to {}",
            100.0 * interval.level,
            limit(interval.lower),
            limit(interval.upper)
        )?;
    }
    if profile.fall < -0.1 {
        writeln!(
            out,
            "  a better solution than the fit's was met on the way (rise {:.2})",
            profile.fall
        )?;
    }
    Ok(())
}

fn limit(limit: Limit) -> String {
    match limit {
        Limit::Reached(value) => format!("{value:.5}"),
        Limit::Bound(value) => format!("{value:.5} (a bound, not the data)"),
        Limit::Open(value) => format!("beyond {value:.5}"),
    }
}
