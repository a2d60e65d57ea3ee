//! `loadmodeld solutions`: every local solution of a fit, how each was found, and in pictures.

use std::{
    collections::BTreeSet,
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

use super::{
    fitting::{self, FitArgs},
    misuse::{MayBeMisuse, Misuse, names_no_event},
    source::{SourceArgs, SourceError},
    target,
};
use crate::{
    adapters::{
        report::{self, ReportError},
        wire::{
            DocumentError,
            v1::{SolutionsV1, ended_name},
        },
    },
    identification::{
        DirectionOutcome, DirectionRecord, Identification, IdentificationError,
        scan_comparison::{ScanCheck, ScanComparison},
    },
};

/// Fits, and tells every local solution, every search direction and its outcome.
#[derive(Clone, Debug, clap::Args)]
pub struct SolutionsArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub source: SourceArgs,
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub fit: FitArgs,
    /// Fits this event alone; default: the joint fit that identify makes.
    #[arg(long, value_name = "EVENT", conflicts_with_all = ["train", "hold_out"])]
    pub event: Option<String>,
    /// Holds the solutions against a scan of the search space.
    #[arg(long, value_enum, default_value_t = Check::Off)]
    pub check: Check,
    /// Prints one JSON document, with the objective along every direction.
    #[arg(long, conflicts_with = "csv")]
    pub json: bool,
    /// Prints the table of directions as CSV.
    #[arg(long)]
    pub csv: bool,
    /// Draws the objective along the directions and the graph of tiers into this directory.
    #[arg(long, value_name = "DIR")]
    pub svg: Option<PathBuf>,
}

/// How finely the search is checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Check {
    /// Not at all.
    #[default]
    Off,
    /// 12 x 16 x 8 cells.
    Coarse,
    /// 28 x 28 x 12 cells.
    Dense,
}

/// Why there are no solutions to tell.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SolutionsError {
    /// The command was used wrongly.
    #[error(transparent)]
    Misuse(#[from] Misuse),
    /// The events.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The fit.
    #[error(transparent)]
    Identification(#[from] IdentificationError),
    /// The JSON document could not be made.
    #[error(transparent)]
    Document(#[from] DocumentError),
    /// A picture could not be drawn.
    #[error(transparent)]
    Picture(#[from] ReportError),
    /// A picture could not be written.
    #[error("cannot write {}: {source}", .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The terminal or pipe.
    #[error("cannot write the result: {0}")]
    Output(#[from] io::Error),
}

impl MayBeMisuse for SolutionsError {
    fn is_misuse(&self) -> bool {
        match self {
            Self::Misuse(_) => true,
            Self::Identification(error) => names_no_event(error),
            _ => false,
        }
    }
}

/// Fits and prints.
///
/// # Errors
///
/// See [`SolutionsError`].
pub fn run(args: &SolutionsArgs, out: &mut dyn Write) -> Result<(), SolutionsError> {
    args.fit.check()?;
    if let Some(directory) = &args.svg {
        target::can_take_files(directory).map_err(|source| SolutionsError::File {
            path: directory.clone(),
            source,
        })?;
    }
    let events = args.source.events()?;
    let structure = events.parts(args.fit.structure.as_deref())?;
    let mut fit = args.fit.clone();
    fit.train.extend(args.event.clone());
    let mut options = fit.options(&events.identification);
    options.search.check = match args.check {
        Check::Off => ScanCheck::Off,
        Check::Coarse => ScanCheck::Coarse,
        Check::Dense => ScanCheck::Dense,
    };
    let found = fitting::identify(&events, &structure, &options)?;
    if args.json {
        writeln!(out, "{}", SolutionsV1::new(&found).to_json()?)?;
    } else if args.csv {
        write_csv(&found, out)?;
    } else {
        print(&found, out)?;
    }
    match &args.svg {
        Some(directory) => draw(&found, directory),
        None => Ok(()),
    }
}

fn print(found: &Identification, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "site {}, fitted {}",
        found.set.site,
        found.set.fitted_events.join(" ")
    )?;
    super::identify::print_solutions(found, out)?;
    super::identify::print_directions(found, out)?;
    writeln!(out, "\nthe search ended: {}", ended_name(found.ended))?;
    if let Some(scan) = &found.scan {
        print_scan(scan, out)?;
    }
    writeln!(
        out,
        "{} simulations, {} with sensitivities, {:.2} s",
        found.cost.simulations, found.cost.sensitivity_simulations, found.cost.seconds
    )
}

/// The check against a scan: what both found, and what only one of them did.
pub(super) fn print_scan(scan: &ScanComparison, out: &mut dyn Write) -> io::Result<()> {
    let [a, b, c] = scan.cells;
    writeln!(
        out,
        "\nscan of {a} x {b} x {c} cells, minima within {} times the lowest objective",
        scan.within
    )?;
    for minimum in &scan.minima {
        let who = minimum.solution.map_or_else(
            || "missed by the search".to_owned(),
            |id| format!("solution {id}"),
        );
        let [ln_alpha, ln_nu, kappa] = minimum.coordinates;
        writeln!(
            out,
            "  {:>13.2}  ln_alpha {ln_alpha:.3}, ln_nu {ln_nu:.3}, kappa {kappa:.3}  {who}",
            minimum.objective
        )?;
    }
    for id in &scan.only_search {
        writeln!(out, "  solution {id} is not among the scan's minima")?;
    }
    Ok(())
}

fn write_csv(found: &Identification, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "from,direction,label,outcome,solution,exit_distance,at_distance"
    )?;
    for record in &found.directions {
        let (outcome, solution, at_distance) = row(record);
        let number = |value: Option<f64>| value.map_or_else(String::new, |v| format!("{v:.6}"));
        writeln!(
            out,
            "{},{},{},{outcome},{},{},{}",
            record.from,
            record.direction,
            record.label,
            solution.map_or_else(String::new, |id| id.to_string()),
            number(record.exit_distance),
            number(at_distance),
        )?;
    }
    Ok(())
}

const fn row(record: &DirectionRecord) -> (&'static str, Option<usize>, Option<f64>) {
    match record.outcome {
        DirectionOutcome::NewSolution(id) => ("new_solution", Some(id), None),
        DirectionOutcome::KnownSolution(id) => ("known_solution", Some(id), None),
        DirectionOutcome::NoExitPoint {
            at_distance,
            diverged,
        } => {
            let word = if diverged {
                "infinite"
            } else {
                "no_exit_point"
            };
            (word, None, Some(at_distance))
        }
        DirectionOutcome::LocalSolverInfeasible => ("local_solver_infeasible", None, None),
    }
}

fn draw(found: &Identification, directory: &Path) -> Result<(), SolutionsError> {
    let file = |path: PathBuf, text: String| {
        fs::write(&path, text).map_err(|source| SolutionsError::File { path, source })
    };
    fs::create_dir_all(directory).map_err(|source| SolutionsError::File {
        path: directory.to_path_buf(),
        source,
    })?;
    let explored: BTreeSet<usize> = found.directions.iter().map(|record| record.from).collect();
    for from in explored {
        let svg = report::along_directions(from, &found.directions)?;
        file(directory.join(format!("directions-from-{from}.svg")), svg)?;
    }
    let svg = report::tiers(&found.solutions, &found.directions)?;
    file(directory.join("tiers.svg"), svg)
}
