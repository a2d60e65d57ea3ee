//! `loadmodeld diagnose`: where a model fails, and which effect is missing.

use std::{io::Write, time::Instant};

use super::diagnosing::{self, DiagnosingError, DiagnosisArgs};
use crate::{
    adapters::{report, wire::v1::DiagnosisV1},
    diagnosis::{self, Diagnosis},
};

/// Says where the model fails and which effect is missing.
///
/// Fits the structure to the events of a site, tells where it fails, tries every effect of the
/// catalogue on top of it, and says what may be claimed.
#[derive(Clone, Debug, clap::Args)]
pub struct DiagnoseArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub common: DiagnosisArgs,
}

/// Diagnoses and prints.
///
/// # Errors
///
/// When the events cannot be read, nothing can be fitted, or the result cannot be written.
#[allow(
    clippy::disallowed_methods,
    reason = "a command is where wall-clock time is measured"
)]
pub fn run(args: &DiagnoseArgs, out: &mut dyn Write) -> Result<(), DiagnosingError> {
    let args = &args.common;
    args.check(&[], &[])?;
    let events = args.source.events()?;
    let structure = args.parts(&events, &[], &[])?;
    let options = args.options(&events)?;
    let bar = diagnosing::bar();
    let begun = Instant::now();
    let found = diagnosis::diagnose(
        &events.site,
        &events.usable,
        &structure,
        &options,
        &|progress| diagnosing::show(&bar, progress),
        &|| false,
    );
    bar.finish_and_clear();
    let mut found = found?;
    found.cost.seconds = begun.elapsed().as_secs_f64();
    diagnosing::with_screened(&mut found, &events);
    if args.json {
        // Nothing stored: a diagnosis of the command line has no version.
        writeln!(out, "{}", DiagnosisV1::new(&found, 0).to_json()?)?;
    } else {
        for note in &events.notes {
            writeln!(out, "note: {note}")?;
        }
        print(&found, out)?;
    }
    args.write_report(
        || report::render_diagnosis(&found, env!("CARGO_PKG_VERSION")),
        out,
    )?;
    args.write_figures(|| report::diagnosis_figures(&found))
}

fn print(found: &Diagnosis, out: &mut dyn Write) -> std::io::Result<()> {
    writeln!(
        out,
        "site {}, structure {}",
        found.site,
        found.structure.join(" + ")
    )?;
    diagnosing::print_answer(found, out)?;
    diagnosing::print_events(found, out)?;
    diagnosing::print_errors(&found.baseline, found.noise_floor, out)?;
    diagnosing::print_origin_of_errors(&found.events, out)?;
    diagnosing::print_failures(found, out)?;
    diagnosing::print_effects(found, out)?;
    diagnosing::print_candidates(found, out)?;
    diagnosing::print_limits(found, out)?;
    writeln!(
        out,
        "\n{} simulations, {} effects refitted, {:.2} s",
        found.cost.simulations, found.cost.refits, found.cost.seconds
    )
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::{adapters::report::diagnosis_fixture, diagnosis::EventSplit};

    #[derive(Parser)]
    struct Program {
        #[command(flatten)]
        args: DiagnoseArgs,
    }

    #[test]
    fn the_terminal_says_answer_failures_rivals_and_limits() {
        let mut out = Vec::new();
        print(&diagnosis_fixture::diagnosis(), &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        for words in [
            "missing effect: A load that drops out",
            "gate event_02 event_04",
            "event_06     0.550",
            "s after the clearing P is",
            "early recovery",
            "not needed: improve --remove",
            "answer, not to be told apart: electronic_load_dropout, self_disconnection",
            "saturation: share shows from 0.400 on, and 0.020 would matter",
            "    dp = \"a*v\"",
        ] {
            assert!(text.contains(words), "{words}:\n{text}");
        }
    }

    #[test]
    fn events_in_neither_list_stay_untouched() {
        let parent = tempfile::tempdir().unwrap();
        let folder = crate::adapters::bundled::sites()[0]
            .extract_to(parent.path())
            .unwrap();
        let folder = folder.display().to_string();
        let parse = |words: &[&str]| {
            let words = ["diagnose", &folder]
                .into_iter()
                .chain(words.iter().copied());
            Program::try_parse_from(words).unwrap().args.common
        };
        let args = parse(&["--train", "event_01", "--hold-out", "event_02"]);
        let events = args.source.events().unwrap();
        let EventSplit::Named { gate, untouched } = args.options(&events).unwrap().split else {
            panic!("named");
        };
        assert_eq!(gate, ["event_02"]);
        assert_eq!(untouched.len(), events.usable.len() - 2);
        let error = parse(&["--hold-out", "event_99"])
            .options(&events)
            .unwrap_err();
        assert!(error.to_string().contains("event_99"), "{error}");
    }
}
