//! What `diagnose` and `improve` share: their options, progress, and the parts of a diagnosis in the
//! terminal.

mod limits;

pub(super) use limits::print_limits;

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
    time::Duration,
};

use indicatif::{ProgressBar, ProgressStyle};

use super::{
    misuse::{self, MayBeMisuse, Misuse, names_no_event},
    source::{Events, SourceArgs, SourceError, parts_of},
    target,
};
use crate::{
    adapters::{
        report::{NamedFigure, ReportError},
        wire::DocumentError,
    },
    diagnosis::{
        Candidate, Channel, Diagnosis, DiagnosisOptions, EventFailure, EventSets, EventSplit,
        Progress, Segment, Status, StructureErrors, misfit_root_floor,
    },
    identification::{ErrorSummary, IdentificationError},
    load_model::{Structure, effect::Kind},
};

/// Options of a diagnosis.
#[derive(Clone, Debug, clap::Args)]
pub struct DiagnosisArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub source: SourceArgs,
    /// Parts of the model. Default: with --store those that the site is to have, with --config those
    /// configured, otherwise `zip+induction_motor`.
    #[arg(long, value_name = "A+B")]
    pub structure: Option<String>,
    /// Events to fit, by name; those in neither list stay untouched, and the error quoted comes
    /// from them. Default: chosen by depth.
    #[arg(long, value_name = "EVENT,...", value_delimiter = ',')]
    pub train: Vec<String>,
    /// Events that decide whether an effect is declared, by name.
    #[arg(long, value_name = "EVENT,...", value_delimiter = ',')]
    pub hold_out: Vec<String>,
    /// Prints one JSON document.
    #[arg(long)]
    pub json: bool,
    /// Writes one self-contained HTML page.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Writes the figures of that page into this directory, an SVG file each.
    #[arg(long, value_name = "DIR")]
    pub svg: Option<PathBuf>,
}

/// Why there is no diagnosis.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DiagnosingError {
    /// The command was used wrongly.
    #[error(transparent)]
    Misuse(#[from] Misuse),
    /// The events.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The fit.
    #[error(transparent)]
    Identification(#[from] IdentificationError),
    /// The page could not be drawn.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// The page could not be written.
    #[error("cannot write the report to {}: {source}", .path.display())]
    WriteReport {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A figure could not be written.
    #[error("cannot write the figure {}: {source}", .path.display())]
    WriteFigure {
        /// The file or directory.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The JSON document could not be made.
    #[error(transparent)]
    Document(#[from] DocumentError),
    /// The terminal or pipe.
    #[error("cannot write the result: {0}")]
    Output(#[from] io::Error),
}

impl MayBeMisuse for DiagnosingError {
    fn is_misuse(&self) -> bool {
        match self {
            Self::Misuse(_) => true,
            Self::Identification(error) => names_no_event(error),
            _ => false,
        }
    }
}

impl DiagnosisArgs {
    /// Refuses what cannot be and targets that cannot be written, before anything is read.
    ///
    /// # Errors
    ///
    /// [`DiagnosingError::Misuse`], [`DiagnosingError::WriteReport`], [`DiagnosingError::WriteFigure`].
    pub(super) fn check(&self, add: &[String], remove: &[String]) -> Result<(), DiagnosingError> {
        misuse::no_event_twice(&self.train, &self.hold_out)?;
        if let Some(asked) = &self.structure {
            misuse::no_impossible_change(&parts_of(asked), add, remove)?;
        } else if self.source.store.is_none() && self.source.config.is_none() {
            misuse::no_impossible_change(&Structure::zip_im().names(), add, remove)?;
        }
        if let Some(path) = &self.report {
            target::can_be_written(path).map_err(|source| DiagnosingError::WriteReport {
                path: path.clone(),
                source,
            })?;
        }
        if let Some(path) = &self.svg {
            target::can_take_files(path).map_err(|source| DiagnosingError::WriteFigure {
                path: path.clone(),
                source,
            })?;
        }
        Ok(())
    }

    /// The parts of the model by name, which can be changed so.
    ///
    /// # Errors
    ///
    /// [`Misuse`] where they cannot.
    pub(super) fn parts(
        &self,
        events: &Events,
        add: &[String],
        remove: &[String],
    ) -> Result<Vec<String>, Misuse> {
        let parts = events.parts(self.structure.as_deref())?;
        misuse::no_impossible_change(&parts, add, remove)?;
        Ok(parts)
    }

    /// The settings these options stand for.
    ///
    /// # Errors
    ///
    /// [`IdentificationError::UnknownEvent`] for a name that is not among the usable events.
    pub(super) fn options(&self, events: &Events) -> Result<DiagnosisOptions, IdentificationError> {
        let names: Vec<&str> = events.usable.iter().map(|w| w.id.as_str()).collect();
        for event in self.train.iter().chain(&self.hold_out) {
            if !names.contains(&event.as_str()) {
                return Err(IdentificationError::UnknownEvent {
                    event: event.clone(),
                    usable: names.join(", "),
                });
            }
        }
        if self.train.is_empty() && self.hold_out.is_empty() {
            return Ok(events.diagnosis.clone());
        }
        let unnamed = names
            .into_iter()
            .map(str::to_owned)
            .filter(|name| !self.train.contains(name) && !self.hold_out.contains(name));
        let untouched = if self.train.is_empty() {
            // What is not held out is fitted.
            Vec::new()
        } else {
            unnamed.collect()
        };
        Ok(DiagnosisOptions {
            split: EventSplit::Named {
                gate: self.hold_out.clone(),
                untouched,
            },
            ..events.diagnosis.clone()
        })
    }

    /// Writes the page where one was asked for, and says where it went where that is no JSON.
    ///
    /// # Errors
    ///
    /// [`DiagnosingError::Report`], [`DiagnosingError::WriteReport`], [`DiagnosingError::Output`].
    pub(super) fn write_report(
        &self,
        page: impl FnOnce() -> Result<String, ReportError>,
        out: &mut dyn Write,
    ) -> Result<(), DiagnosingError> {
        let Some(path) = &self.report else {
            return Ok(());
        };
        fs::write(path, page()?).map_err(|source| DiagnosingError::WriteReport {
            path: path.clone(),
            source,
        })?;
        if !self.json {
            writeln!(out, "report {}", path.display())?;
        }
        Ok(())
    }
}

impl DiagnosisArgs {
    /// Writes the figures where they were asked for.
    ///
    /// # Errors
    ///
    /// [`DiagnosingError::Report`], [`DiagnosingError::WriteFigure`].
    pub(super) fn write_figures(
        &self,
        figures: impl FnOnce() -> Result<Vec<NamedFigure>, ReportError>,
    ) -> Result<(), DiagnosingError> {
        let Some(directory) = &self.svg else {
            return Ok(());
        };
        let failed = |path: &Path| {
            let path = path.to_owned();
            |source| DiagnosingError::WriteFigure { path, source }
        };
        fs::create_dir_all(directory).map_err(failed(directory))?;
        for figure in figures()? {
            let path = directory.join(figure.name).with_extension("svg");
            fs::write(&path, figure.svg).map_err(failed(&path))?;
        }
        Ok(())
    }
}

/// A bar on stderr; nothing where that is no terminal.
pub(super) fn bar() -> ProgressBar {
    let bar = ProgressBar::new(1);
    if let Ok(style) = ProgressStyle::with_template("{spinner} {bar:24} {pos}/{len} {msg}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(120));
    bar
}

/// Moves the bar.
pub(super) fn show(bar: &ProgressBar, progress: Progress) {
    bar.set_length(progress.of as u64);
    bar.set_position(progress.done as u64);
    bar.set_message(progress.what);
}

/// Adds what screening refused to the events that were refused.
pub(super) fn with_screened(diagnosis: &mut Diagnosis, events: &Events) {
    let refused = &mut diagnosis.events.refused;
    refused.extend(events.refused.iter().cloned());
    refused.sort();
}

/// The answer with its reasons.
pub(super) fn print_answer(diagnosis: &Diagnosis, out: &mut dyn Write) -> io::Result<()> {
    let words = match diagnosis.status {
        Status::Adequate => "adequate",
        Status::MissingEffect => "missing effect",
        Status::InstrumentSuspect => "instrument suspect",
        Status::UnknownEffect => "unknown effect",
        Status::CannotJudge => "cannot judge",
    };
    writeln!(out, "{words}: {}", diagnosis.summary)?;
    for reason in &diagnosis.reasons {
        writeln!(out, "  {reason}")?;
    }
    Ok(())
}

/// Which events served for what.
pub(super) fn print_events(diagnosis: &Diagnosis, out: &mut dyn Write) -> io::Result<()> {
    let events = &diagnosis.events;
    for (words, names) in [
        ("fitted", &events.fit),
        ("gate", &events.gate),
        ("untouched", &events.untouched),
    ] {
        if !names.is_empty() {
            writeln!(out, "{words} {}", names.join(" "))?;
        }
    }
    for (event, reason) in &events.refused {
        writeln!(out, "not used {event}: {reason}")?;
    }
    Ok(())
}

/// Which fit the errors on sets of events come from; nothing where there is no gate.
pub(super) fn print_origin_of_errors(events: &EventSets, out: &mut dyn Write) -> io::Result<()> {
    if events.gate.is_empty() {
        return Ok(());
    }
    let untouched = if events.untouched.is_empty() {
        ""
    } else {
        "; untouched: of the fit to both"
    };
    writeln!(
        out,
        "fitted and gate: of a fit without the gate's events{untouched}"
    )
}

/// Errors of a structure on the three sets of events.
pub(super) fn print_errors(
    errors: &StructureErrors,
    noise_floor: f64,
    out: &mut dyn Write,
) -> io::Result<()> {
    writeln!(
        out,
        "\n{:10} {:>14} {:>12} {:>12}",
        "errors", "over noise", "of P, %", "of Q, %"
    )?;
    let row = |words: &str, summary: Option<&ErrorSummary>, out: &mut dyn Write| match summary {
        Some(summary) => writeln!(
            out,
            "{words:10} {:>14.2} {:>12.3} {:>12.3}",
            summary.error_to_noise, summary.eps_p_percent, summary.eps_q_percent
        ),
        None => Ok(()),
    };
    row("fitted", Some(&errors.fit), out)?;
    row("gate", errors.gate.as_ref(), out)?;
    row("untouched", errors.untouched.as_ref(), out)?;
    writeln!(out, "{:10} {noise_floor:>14.2}", "perfect")
}

/// Where the model fails, by event and by segment.
pub(super) fn print_failures(diagnosis: &Diagnosis, out: &mut dyn Write) -> io::Result<()> {
    let names = diagnosis.failures.iter().map(|f| f.event.chars().count());
    let width = names.max().unwrap_or(0).max("event".len());
    writeln!(
        out,
        "\n{:width$}  lowest V  root misfit  where the model fails",
        "event"
    )?;
    for failure in by_severity(&diagnosis.failures) {
        writeln!(
            out,
            "{:width$}  {:>8.3}  {:>11.2}  {}",
            failure.event, failure.lowest_voltage, failure.error_to_noise, failure.sentence
        )?;
    }
    print_segments(diagnosis, out)
}

/// Deepest first: a rung of the severity ladder a line.
fn by_severity(failures: &[EventFailure]) -> Vec<&EventFailure> {
    let mut sorted: Vec<&EventFailure> = failures.iter().collect();
    sorted.sort_by(|a, b| a.lowest_voltage.total_cmp(&b.lowest_voltage));
    sorted
}

fn print_segments(diagnosis: &Diagnosis, out: &mut dyn Write) -> io::Result<()> {
    if diagnosis.segments.is_empty() {
        return Ok(());
    }
    writeln!(
        out,
        "\n{:16} {:>12} {:>12} {:>12} {:>12}",
        "residual", "P, % of P0", "over noise", "Q, % of P0", "over noise"
    )?;
    let of = |segment: Segment, channel: Channel| {
        let found =
            (diagnosis.segments.iter()).find(|r| r.segment == segment && r.channel == channel);
        found.map_or_else(
            || format!("{:>12} {:>12}", "-", "-"),
            |r| format!("{:>12.3} {:>12.2}", 100.0 * r.rms_pu, r.to_noise),
        )
    };
    for segment in [
        Segment::Before,
        Segment::During,
        Segment::EarlyRecovery,
        Segment::Late,
        Segment::After,
    ] {
        writeln!(
            out,
            "{:16} {} {}",
            segment.name().replace('_', " "),
            of(segment, Channel::Active),
            of(segment, Channel::Reactive)
        )?;
    }
    Ok(())
}

/// What the effects that the structure has already are worth.
pub(super) fn print_effects(diagnosis: &Diagnosis, out: &mut dyn Write) -> io::Result<()> {
    let effects = &diagnosis.effects;
    if effects.is_empty() {
        return Ok(());
    }
    let names = effects.iter().map(|worth| worth.effect.chars().count());
    let width = names.max().unwrap_or(0).max("without".len());
    writeln!(
        out,
        "\n{:width$} {:>10} {:>22}",
        "without", "delta BIC", "untouched, over noise"
    )?;
    for worth in effects {
        let error = worth.untouched_without;
        writeln!(
            out,
            "{:width$} {:>10.0} {:>22}{}",
            worth.effect,
            worth.delta_bic_without,
            error.map_or_else(|| "-".to_owned(), |error| format!("{error:.2}")),
            if worth.is_superfluous {
                "  not needed: improve --remove takes it out"
            } else {
                ""
            }
        )?;
    }
    Ok(())
}

/// The rivals, and what would separate them.
pub(super) fn print_candidates(diagnosis: &Diagnosis, out: &mut dyn Write) -> io::Result<()> {
    if diagnosis.candidates.is_empty() {
        return Ok(());
    }
    let names = diagnosis
        .candidates
        .iter()
        .map(|c| c.effect.chars().count());
    let width = names.max().unwrap_or(0).max("candidate".len());
    // Before and after are roots of the misfit per sample, which have a floor of their own.
    writeln!(
        out,
        "\n{:width$}  {:10} {:>8} {:>9} {:>17}",
        "", "", "", "", "root of misfit"
    )?;
    writeln!(
        out,
        "{:width$}  {:10} {:>8} {:>9} {:>8} {:>8} {:>8}",
        "candidate", "kind", "share, %", "delta BIC", "before", "after", "gain, %"
    )?;
    let (screened_out, tried): (Vec<_>, Vec<_>) =
        (diagnosis.candidates.iter()).partition(|c| c.is_screened_out());
    for candidate in tried {
        print_candidate(candidate, width, out)?;
    }
    writeln!(
        out,
        "{:width$}  {:10} {:>8} {:>9} {:>8} {:>8.2}",
        "perfect",
        "",
        "",
        "",
        "",
        misfit_root_floor()
    )?;
    if !screened_out.is_empty() {
        let names: Vec<&str> = screened_out.iter().map(|c| c.effect.as_str()).collect();
        writeln!(
            out,
            "of {} more the linear screen finds too little in the residuals: {}",
            names.len(),
            names.join(", ")
        )?;
    }
    let among = |c: &&Candidate| diagnosis.answer_set.contains(&c.effect);
    match diagnosis.answer_set.as_slice() {
        [] => writeln!(out, "answer: none of them is declared")?,
        [one] => writeln!(out, "answer: {one}")?,
        several => writeln!(out, "answer, not to be told apart: {}", several.join(", "))?,
    }
    let separate = diagnosis.candidates.iter().filter(among);
    if let Some(words) = separate.map(|c| &c.would_separate).find(|w| !w.is_empty()) {
        writeln!(out, "what would separate them: {words}")?;
    }
    Ok(())
}

fn print_candidate(candidate: &Candidate, width: usize, out: &mut dyn Write) -> io::Result<()> {
    let kind = match candidate.kind {
        Kind::Physics => "physics",
        Kind::Instrument => "instrument",
    };
    let number = |value: Option<f64>, decimals: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.decimals$}"))
    };
    let mark = if candidate.declared { "  declared" } else { "" };
    let reasons = match candidate.refused.as_slice() {
        [] => String::new(),
        reasons => format!("  {}", reasons.join("; ")),
    };
    writeln!(
        out,
        "{:width$}  {kind:10} {:>8.0} {:>9} {:>8} {:>8} {:>8}{mark}{reasons}",
        candidate.effect,
        100.0 * candidate.score_share,
        number(candidate.delta_bic, 0),
        number(candidate.held_out_error_before, 2),
        number(candidate.held_out_error_after, 2),
        number(candidate.share_of_best_gain.map(|share| 100.0 * share), 0),
    )
}
