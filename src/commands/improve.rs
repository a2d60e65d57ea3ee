//! `loadmodeld improve`: diagnose, add what is missing, refit, until nothing more is.

use std::{
    io::{self, Write},
    time::Instant,
};

use super::diagnosing::{self, DiagnosingError, DiagnosisArgs};
use crate::{
    adapters::{report, wire::v1::ImprovementV1},
    diagnosis::{self, Change, Improvement, ImprovementStep},
    identification::ErrorSummary,
};

/// Adds what is missing and shows the error fall.
///
/// Goes round: diagnose, add what is missing, refit, drop what became superfluous, until the model
/// is adequate or nothing more may be claimed. With --add or --remove only these changes.
#[derive(Clone, Debug, clap::Args)]
pub struct ImproveArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub common: DiagnosisArgs,
    /// Adds these effects, separated by commas, and no other; may be given several times.
    #[arg(long = "add", value_name = "EFFECT,...", value_delimiter = ',')]
    pub add: Vec<String>,
    /// Removes these effects, separated by commas, from the structure first; may be given several times.
    #[arg(long = "remove", value_name = "EFFECT,...", value_delimiter = ',')]
    pub remove: Vec<String>,
}

/// Improves and prints.
///
/// # Errors
///
/// When the events cannot be read, nothing can be fitted, or the result cannot be written.
#[allow(
    clippy::disallowed_methods,
    reason = "a command is where wall-clock time is measured"
)]
pub fn run(args: &ImproveArgs, out: &mut dyn Write) -> Result<(), DiagnosingError> {
    args.common.check(&args.add, &args.remove)?;
    let events = args.common.source.events()?;
    let structure = args.common.parts(&events, &args.add, &args.remove)?;
    let change = change(args);
    let args = &args.common;
    let options = args.options(&events)?;
    let bar = diagnosing::bar();
    let begun = Instant::now();
    let done = diagnosis::improve(
        &events.site,
        &events.usable,
        &structure,
        &change,
        &options,
        &|progress| diagnosing::show(&bar, progress),
        &|| false,
    );
    bar.finish_and_clear();
    let mut done = done?;
    let seconds = begun.elapsed().as_secs_f64();
    diagnosing::with_screened(&mut done.last, &events);
    if args.json {
        writeln!(out, "{}", ImprovementV1::new(&done)?.to_json()?)?;
    } else {
        for note in &events.notes {
            writeln!(out, "note: {note}")?;
        }
        print(&done, seconds, out)?;
    }
    args.write_report(
        || report::render_improvement(&done, env!("CARGO_PKG_VERSION")),
        out,
    )?;
    args.write_figures(|| report::improvement_figures(&done))
}

fn change(args: &ImproveArgs) -> Change {
    if args.add.is_empty() && args.remove.is_empty() {
        return Change::UntilAdequate;
    }
    Change::ByHand {
        add: args.add.clone(),
        remove: args.remove.clone(),
    }
}

fn print(done: &Improvement, seconds: f64, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "site {}, structure {}",
        done.site,
        done.last.structure.join(" + ")
    )?;
    diagnosing::print_answer(&done.last, out)?;
    diagnosing::print_events(&done.last, out)?;
    print_staircase(done, out)?;
    print_notes(done, out)?;
    diagnosing::print_failures(&done.last, out)?;
    diagnosing::print_effects(&done.last, out)?;
    diagnosing::print_candidates(&done.last, out)?;
    diagnosing::print_limits(&done.last, out)?;
    writeln!(out, "\n{seconds:.2} s")
}

/// Columns of the bars.
const BAR: usize = 36;

/// Step after step with its error over noise as a bar, the noise floor as a line through all bars.
fn print_staircase(done: &Improvement, out: &mut dyn Write) -> io::Result<()> {
    let words: Vec<String> = (done.steps.iter().enumerate())
        .map(|(k, step)| report::step_in_words(step, k == 0))
        .collect();
    let width = words
        .iter()
        .map(|w| w.chars().count())
        .max()
        .unwrap_or(0)
        .max(5);
    let scale = Scale::new(done);
    let last = done.steps.last();
    let set = last.map_or("fitted", |step| step.errors.quoted_set());
    writeln!(
        out,
        "\n{:width$}  {:>7} {:>7} {:>9} {:>10} {:>9}  error over noise, {set}, logarithmic; | a perfect model",
        "step", "fitted", "gate", "untouched", "parameters", "delta BIC"
    )?;
    let number = |summary: Option<&ErrorSummary>| {
        summary.map_or_else(|| "-".to_owned(), |s| format!("{:.2}", s.error_to_noise))
    };
    for (words, step) in words.iter().zip(&done.steps) {
        let errors = &step.errors;
        writeln!(
            out,
            "{words:width$}  {:>7} {:>7} {:>9} {:>10} {:>9.0}  {}",
            number(Some(&errors.fit)),
            number(errors.gate.as_ref()),
            number(errors.untouched.as_ref()),
            step.parameter_count,
            step.delta_bic,
            scale.bar(quoted(step))
        )?;
    }
    diagnosing::print_origin_of_errors(&done.last.events, out)?;
    print_reasons(done, out)
}

/// What a reader should know of the values of the last step.
fn print_notes(done: &Improvement, out: &mut dyn Write) -> io::Result<()> {
    let last = done.steps.last();
    for note in last.into_iter().flat_map(|step| &step.set.notes) {
        writeln!(out, "note: {note}")?;
    }
    Ok(())
}

/// What each diagnosis on the way said: a step may be taken although the error on the gate rises.
fn print_reasons(done: &Improvement, out: &mut dyn Write) -> io::Result<()> {
    for diagnosis in &done.diagnoses {
        let structure = diagnosis.structure.join(" + ");
        writeln!(out, "  {structure}: {}", diagnosis.reasons.join("; "))?;
    }
    Ok(())
}

fn quoted(step: &ImprovementStep) -> f64 {
    step.errors.quoted().error_to_noise
}

/// Errors over noise to columns, by their logarithms.
struct Scale {
    /// Error at the left end.
    from: f64,
    /// Error at the right end.
    to: f64,
    floor: f64,
}

impl Scale {
    fn new(done: &Improvement) -> Self {
        let floor = done.last.noise_floor;
        let most = done.steps.iter().map(quoted).fold(2.0 * floor, f64::max);
        Self {
            from: 0.5 * floor,
            to: most,
            floor,
        }
    }

    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped in the same expression"
    )]
    fn column(&self, error: f64) -> usize {
        let share = (error / self.from).ln() / (self.to / self.from).ln();
        (share * BAR as f64).round().clamp(0.0, BAR as f64) as usize
    }

    fn bar(&self, error: f64) -> String {
        let (end, floor) = (self.column(error), self.column(self.floor));
        let cell = |column: usize| match column {
            column if column == floor => '|',
            column if column < end => '#',
            _ => ' ',
        };
        let bar: String = (0..=BAR).map(cell).collect();
        bar.trim_end().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::adapters::report::diagnosis_fixture;
    use crate::commands::misuse::MayBeMisuse;

    #[derive(Parser)]
    struct Program {
        #[command(flatten)]
        args: ImproveArgs,
    }

    fn asked(words: &[&str]) -> Result<Change, DiagnosingError> {
        let words = ["improve", "dir"].into_iter().chain(words.iter().copied());
        let args = Program::try_parse_from(words).unwrap().args;
        args.common.check(&args.add, &args.remove)?;
        Ok(change(&args))
    }

    #[test]
    fn the_staircase_has_a_bar_for_each_step_and_the_floor_in_each() {
        let mut out = Vec::new();
        let mut done = diagnosis_fixture::improvement();
        let last = done.steps.last_mut().unwrap();
        last.set
            .notes
            .push("one and two describe much the same".to_owned());
        print(&done, 1.5, &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert!(
            text.contains("\nnote: one and two describe much the same\n"),
            "{text}"
        );
        let bars: Vec<&str> = text.lines().filter(|line| line.contains("##")).collect();
        assert_eq!(bars.len(), 2, "{text}");
        assert!(bars[0].starts_with("start") && bars[1].starts_with("+ electronic_load_dropout"));
        assert_eq!(bars[0].find('|'), bars[1].find('|'), "{text}");
        assert!(bars[0].len() > bars[1].len(), "{text}");
        let reasons = &diagnosis_fixture::improvement().diagnoses[0].reasons;
        assert!(
            text.contains(&format!(": {}", reasons.join("; "))),
            "{text}"
        );
    }

    #[test]
    fn changes_by_hand_are_only_these() {
        assert_eq!(asked(&[]).unwrap(), Change::UntilAdequate);
        let by_hand = asked(&["--add", "saturation", "--add", "second_motor"]).unwrap();
        let expected = Change::ByHand {
            add: vec!["saturation".to_owned(), "second_motor".to_owned()],
            remove: Vec::new(),
        };
        assert_eq!(by_hand, expected);
        let separated = asked(&["--add", "saturation,second_motor"]).unwrap();
        assert_eq!(separated, expected);
        let error = asked(&["--remove", "saturation"]).unwrap_err().to_string();
        assert!(
            error.contains("`saturation` cannot be removed: the structure is zip"),
            "{error}"
        );
        let error = asked(&["--report", "/proc/x.html"]).unwrap_err();
        assert!(!error.is_misuse(), "{error}");
        let error = error.to_string();
        assert!(
            error.contains("/proc/x.html: ") && error.contains("os error"),
            "{error}"
        );
        let error = asked(&["--train", "e,f", "--hold-out", "f"]).unwrap_err();
        assert!(error.is_misuse(), "{error}");
    }
}
