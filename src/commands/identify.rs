//! `loadmodeld identify`: fit a site folder, list every solution, validate.

use std::io::{self, Write};

use super::{
    fitting::{self, FitArgs},
    misuse::{MayBeMisuse, Misuse, names_no_event},
    source::{SourceArgs, SourceError},
};
use crate::{
    adapters::wire::{DocumentError, v1::IdentificationV1},
    identification::{
        DirectionOutcome, ErrorSummary, Identification, IdentificationError, ParameterEstimate,
        VerdictStatus,
    },
};

/// Fits the model to the events of a site folder, lists all solutions, validates on held-out events.
#[derive(Clone, Debug, clap::Args)]
pub struct IdentifyArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub source: SourceArgs,
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub fit: FitArgs,
    /// Lists every search direction as well.
    #[arg(long)]
    pub directions: bool,
    /// Prints one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Why nothing was identified.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
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
    /// The terminal or pipe.
    #[error("cannot write the result: {0}")]
    Output(#[from] io::Error),
}

impl MayBeMisuse for IdentifyError {
    fn is_misuse(&self) -> bool {
        match self {
            Self::Misuse(_) => true,
            Self::Identification(error) => names_no_event(error),
            _ => false,
        }
    }
}

/// Identifies and prints.
///
/// # Errors
///
/// See [`IdentifyError`].
pub fn run(args: &IdentifyArgs, out: &mut dyn Write) -> Result<(), IdentifyError> {
    args.fit.check()?;
    let events = args.source.events()?;
    let structure = events.parts(args.fit.structure.as_deref())?;
    let options = args.fit.options(&events.identification);
    let found = fitting::identify(&events, &structure, &options)?;
    if args.json {
        writeln!(out, "{}", IdentificationV1::new(&found)?.to_json()?)?;
        return Ok(());
    }
    for note in &events.notes {
        writeln!(out, "note: {note}")?;
    }
    print(&found, args.directions, out)?;
    Ok(())
}

fn print(found: &Identification, directions: bool, out: &mut dyn Write) -> io::Result<()> {
    let set = &found.set;
    writeln!(
        out,
        "site {}, structure {}",
        set.site,
        set.structure.join(" + ")
    )?;
    writeln!(out, "fitted {}", set.fitted_events.join(" "))?;
    writeln!(out, "held out {}", set.held_out_events.join(" "))?;
    for (event, reason) in &found.refused {
        writeln!(out, "not used {event}: {reason}")?;
    }
    writeln!(
        out,
        "\nparameter                value  std error  valley                unit"
    )?;
    for parameter in &set.parameters {
        print_parameter(parameter, out)?;
    }
    writeln!(
        out,
        "in a study engineer's units, and what the data determine"
    )?;
    for parameter in &set.derived {
        print_parameter(parameter, out)?;
    }
    writeln!(
        out,
        "rank {} of 8, condition {:.0}\n",
        set.rank, set.condition
    )?;
    for note in &set.notes {
        writeln!(out, "note: {note}")?;
    }
    print_errors("fit", &set.fit, out)?;
    if let Some(held_out) = &set.held_out {
        print_errors("held out", held_out, out)?;
    }
    let verdict = match set.verdict.status {
        VerdictStatus::Pass => "pass",
        VerdictStatus::Fail => "fail",
        VerdictStatus::CannotJudge => "cannot judge",
    };
    writeln!(out, "verdict: {verdict}")?;
    for reason in &set.verdict.reasons {
        writeln!(out, "  {reason}")?;
    }
    print_solutions(found, out)?;
    if directions {
        print_directions(found, out)?;
    }
    writeln!(
        out,
        "\n{} simulations, {} with sensitivities, {:.2} s",
        found.cost.simulations, found.cost.sensitivity_simulations, found.cost.seconds
    )
}

fn print_parameter(parameter: &ParameterEstimate, out: &mut dyn Write) -> io::Result<()> {
    let error = parameter
        .standard_error
        .map_or_else(|| "-".to_owned(), |e| format!("{e:.5}"));
    let valley = parameter
        .interval
        .map_or_else(String::new, |(low, high)| format!("{low:.4} .. {high:.4}"));
    let bound = if parameter.at_bound {
        "  at its bound"
    } else {
        ""
    };
    writeln!(
        out,
        "{:20} {:>9.5}  {error:>9}  {valley:20}  {}{bound}",
        parameter.name, parameter.value, parameter.unit
    )
}

fn print_errors(label: &str, errors: &ErrorSummary, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "{label:9} error of P {:.3} %, of Q {:.3} %; residual over noise {:.2}, away from edges {:.2}",
        errors.eps_p_percent,
        errors.eps_q_percent,
        errors.error_to_noise,
        errors.error_to_noise_away_from_edges
    )
}

pub(super) fn print_solutions(found: &Identification, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "\n{} local solutions, best first",
        found.solutions.len()
    )?;
    writeln!(out, "  no tier  from direction     objective  coordinates")?;
    for solution in &found.solutions {
        let from = solution
            .found_from
            .map_or_else(|| "start".to_owned(), |id| id.to_string());
        let direction = solution
            .direction
            .map_or_else(String::new, |d| d.to_string());
        let values: Vec<String> = solution
            .coordinates
            .iter()
            .map(|(name, value)| format!("{name} {value:.3}"))
            .collect();
        writeln!(
            out,
            "{:>4} {:>4} {from:>5} {direction:>9} {:>13.2}  {}",
            solution.id,
            solution.tier,
            solution.objective,
            values.join(", ")
        )?;
    }
    Ok(())
}

pub(super) fn print_directions(found: &Identification, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "\nsearch directions (the paper's Table 2)")?;
    for record in &found.directions {
        let outcome = match record.outcome {
            DirectionOutcome::NewSolution(id) => format!("new solution {id}"),
            DirectionOutcome::KnownSolution(id) => format!("known solution {id}"),
            DirectionOutcome::NoExitPoint { diverged: true, .. } => "inf".to_owned(),
            DirectionOutcome::NoExitPoint { .. } => "no exit point up to the bounds".to_owned(),
            DirectionOutcome::LocalSolverInfeasible => "local solver infeasible".to_owned(),
        };
        writeln!(
            out,
            "  from {:>3}, direction {:>3} ({}): {outcome}",
            record.from, record.direction, record.label
        )?;
    }
    Ok(())
}
