//! `loadmodeld compare`: model against measurement, as a table, a page, or JSON.

mod side;

use std::{
    fs,
    io::{self, Write},
    path::PathBuf,
};

use self::side::{Asked, Side};
use super::{
    fitting::FitArgs,
    misuse::{self, MayBeMisuse, Misuse, names_no_event},
    source::{Events, SourceArgs, SourceError, parts_of},
    target,
};
use crate::{
    adapters::{
        report::{self, Report, ReportError},
        store::StoreError,
        wire::{DocumentError, v1::ComparisonsV1},
    },
    identification::{
        Comparison, ErrorSummary, EventErrors, IdentificationError, Judgement, ParameterSet,
        Verdict, VerdictStatus,
    },
};

/// Holds a model against the measurements of a site folder.
///
/// With --parameters the set of that file, otherwise one that is identified first; with --with any
/// set or structure, or two of them side by side. Prints a table of errors and writes one
/// self-contained HTML report.
#[derive(Clone, Debug, clap::Args)]
pub struct CompareArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub source: SourceArgs,
    /// Parameter set (JSON); without it the parameters are identified from the folder.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["structure", "train", "hold_out", "paper_box"])]
    pub parameters: Option<PathBuf>,
    /// Another parameter set (JSON) to draw beside it.
    #[arg(long, value_name = "FILE")]
    pub against: Option<PathBuf>,
    /// What to hold against the measurements, given once or twice: a structure such as
    /// `zip+induction_motor`, which is identified; a parameter set (JSON); or with --store the
    /// version of a set.
    #[arg(long = "with", value_name = "A", conflicts_with_all = ["parameters", "against", "structure"])]
    pub with: Vec<String>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options bring their own help")]
    pub fit: FitArgs,
    /// The HTML report to write.
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    pub report: PathBuf,
    /// Prints one JSON document with every sample instead of the table.
    #[arg(long)]
    pub json: bool,
}

/// Why nothing could be compared.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// The command was used wrongly.
    #[error(transparent)]
    Misuse(#[from] Misuse),
    /// The events.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// More than two sides.
    #[error("--with may be given twice at most, not {given} times")]
    TooMany {
        /// How often it was given.
        given: usize,
    },
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The store holds no such version.
    #[error("there is no version {version} of `{site}` in the store")]
    NoVersion {
        /// Site.
        site: String,
        /// Version.
        version: u64,
    },
    /// A parameter file cannot be read.
    #[error("cannot read parameters from {}: {source}", .path.display())]
    ReadParameters {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A parameter file is not what it should be.
    #[error("{}: {source}", .path.display())]
    Parameters {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: DocumentError,
    },
    /// The fit or the simulation.
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
    /// The JSON document could not be made.
    #[error(transparent)]
    Document(#[from] DocumentError),
    /// The JSON document could not be written.
    #[error("cannot write the result as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// The terminal or pipe.
    #[error("cannot write the result: {0}")]
    Output(#[from] io::Error),
}

impl MayBeMisuse for CompareError {
    fn is_misuse(&self) -> bool {
        match self {
            Self::Misuse(_) | Self::TooMany { .. } => true,
            Self::Identification(error) => names_no_event(error),
            _ => false,
        }
    }
}

/// Compares, prints table or JSON, writes the report.
///
/// # Errors
///
/// See [`CompareError`].
pub fn run(args: &CompareArgs, out: &mut dyn Write) -> Result<(), CompareError> {
    args.fit.check()?;
    let (first, second) = asked(args)?;
    for asked in [Some(&first), second.as_ref()].into_iter().flatten() {
        if let Asked::Structure(Some(parts)) = asked {
            misuse::no_impossible_change(&parts_of(parts), &[], &[])?;
        }
    }
    let report_error = |source| CompareError::WriteReport {
        path: args.report.clone(),
        source,
    };
    target::can_be_written(&args.report).map_err(report_error)?;
    let events = args.source.events()?;
    let options = args.fit.options(&events.identification);
    let store = args.source.store.as_deref();
    let side = |asked: &Asked| Side::new(asked, store, &events, &options);
    let first = side(&first)?;
    let second = second.as_ref().map(side).transpose()?;
    let left_out = left_out(&events, &first);
    let page = report::render(&Report {
        set: first.set(),
        comparisons: &first.comparisons,
        judgement: &first.judgement,
        published: first.published(),
        rival: second.as_ref().map(Side::as_rival),
        search: first.search(),
        left_out: &left_out,
    })?;
    if args.json {
        let mut document = document(&first)?;
        if let Some(second) = &second {
            document.against = Some(Box::new(self::document(second)?));
        }
        serde_json::to_writer(&mut *out, &document)?;
        writeln!(out)?;
    } else {
        print_side(&first, &left_out, out)?;
        if let Some(second) = &second {
            writeln!(out, "\nheld against {}", second.label)?;
            print_side(second, &[], out)?;
        }
    }
    fs::write(&args.report, page).map_err(report_error)?;
    if !args.json {
        writeln!(out, "report {}", args.report.display())?;
    }
    Ok(())
}

fn document(side: &Side) -> Result<ComparisonsV1, DocumentError> {
    ComparisonsV1::new(side.set(), &side.comparisons, &side.judgement)
}

/// What to hold against the measurements, and what beside it.
fn asked(args: &CompareArgs) -> Result<(Asked, Option<Asked>), CompareError> {
    let has_store = args.source.store.is_some();
    let parse = |words: &String| Asked::parse(words, has_store);
    match args.with.as_slice() {
        [] => {
            let first = match &args.parameters {
                Some(path) => Asked::File(path.clone()),
                None => Asked::Structure(args.fit.structure.clone()),
            };
            Ok((first, args.against.clone().map(Asked::File)))
        }
        [first] => Ok((parse(first), None)),
        [first, second] => Ok((parse(first), Some(parse(second)))),
        more => Err(CompareError::TooMany { given: more.len() }),
    }
}

/// Events that are not in the comparison, with the reason.
fn left_out(events: &Events, side: &Side) -> Vec<(String, String)> {
    let notes = events
        .notes
        .iter()
        .map(|note| ("note".to_owned(), note.clone()));
    let reason = |event: &str| {
        let known = side.refused().iter().find(|(name, _)| name == event);
        known.map_or("it cannot be simulated", |(_, reason)| reason.as_str())
    };
    let missing = events
        .usable
        .iter()
        .filter(|window| side.comparisons.iter().all(|c| c.event != window.id))
        .map(|window| (window.id.clone(), reason(&window.id).to_owned()));
    notes
        .chain(missing)
        .chain(events.refused.iter().cloned())
        .collect()
}

fn print_side(side: &Side, left_out: &[(String, String)], out: &mut dyn Write) -> io::Result<()> {
    let judgement = &side.judgement;
    print_table(side.set(), &side.comparisons, judgement, left_out, out)?;
    print_verdict(judgement, side.published(), out)
}

fn print_table(
    set: &ParameterSet,
    comparisons: &[Comparison],
    judgement: &Judgement,
    left_out: &[(String, String)],
    out: &mut dyn Write,
) -> io::Result<()> {
    let widest = comparisons.iter().map(|c| c.event.chars().count()).max();
    let width = widest.unwrap_or(0).max("held-out events".len());
    writeln!(
        out,
        "site {}, structure {}",
        set.site,
        set.structure.join(" + ")
    )?;
    writeln!(
        out,
        "{:width$}  {:8} {:>7} {:>15} {:>15} {:>15} {:>19}",
        "", "", "lowest", "error of P, %", "error of Q, %", "skill over ZIP", "residual over noise",
    )?;
    writeln!(
        out,
        "{:width$}  {:8} {:>7} {:>7} {:>7} {:>7} {:>7} {:>7} {:>7} {:>8} {:>10}",
        "event", "role", "V", "window", "event", "window", "event", "P", "Q", "all", "off edges",
    )?;
    for comparison in comparisons {
        let role = judgement.role(&comparison.event);
        print_row(&comparison.event, role, &comparison.errors, width, out)?;
    }
    for (label, summary) in [
        ("fitted events", &judgement.fitted),
        ("held-out events", &judgement.held_out),
        ("other events", &judgement.others),
    ] {
        if let Some(summary) = summary {
            print_summary(label, summary, width, out)?;
        }
    }
    for (event, reason) in left_out {
        writeln!(out, "left out: {event}: {reason}")?;
    }
    Ok(())
}

fn print_row(
    event: &str,
    role: &str,
    errors: &EventErrors,
    width: usize,
    out: &mut dyn Write,
) -> io::Result<()> {
    writeln!(
        out,
        "{event:width$}  {role:8} {:>7.3} {:>7.3} {:>7.3} {:>7.3} {:>7.3} {:>7.3} {:>7.3} {:>8.2} {:>10.2}",
        errors.lowest_voltage,
        errors.eps_p_percent,
        errors.event_eps_p_percent,
        errors.eps_q_percent,
        errors.event_eps_q_percent,
        errors.skill_p,
        errors.skill_q,
        errors.error_to_noise,
        errors.error_to_noise_away_from_edges,
    )
}

fn print_summary(
    label: &str,
    summary: &ErrorSummary,
    width: usize,
    out: &mut dyn Write,
) -> io::Result<()> {
    writeln!(
        out,
        "{label:width$}  {:8} {:>7} {:>7.3} {:>7} {:>7.3} {:>7} {:>7} {:>7} {:>8.2} {:>10.2}",
        "",
        "",
        summary.eps_p_percent,
        "",
        summary.eps_q_percent,
        "",
        "",
        "",
        summary.error_to_noise,
        summary.error_to_noise_away_from_edges,
    )
}

/// What these events show, and apart from it what the set was published with.
fn print_verdict(
    judgement: &Judgement,
    published: Option<&Verdict>,
    out: &mut dyn Write,
) -> io::Result<()> {
    for warning in &judgement.warnings {
        writeln!(out, "warning: {warning}")?;
    }
    let words = if published.is_some() {
        "verdict on these events"
    } else {
        "verdict"
    };
    for (words, verdict) in [
        (words, Some(&judgement.verdict)),
        ("as published", published),
    ] {
        let Some(verdict) = verdict else { continue };
        writeln!(out, "{words}: {}", in_words(verdict.status))?;
        for reason in &verdict.reasons {
            writeln!(out, "  {reason}")?;
        }
    }
    Ok(())
}

const fn in_words(status: VerdictStatus) -> &'static str {
    match status {
        VerdictStatus::Pass => "pass",
        VerdictStatus::Fail => "fail",
        VerdictStatus::CannotJudge => "cannot judge",
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::{
        adapters::{bundled, report::fixture},
        disturbance::Trigger,
        identification::{IdentificationOptions, Split},
    };

    #[derive(Parser)]
    struct Program {
        #[command(flatten)]
        args: CompareArgs,
    }

    fn parsed(words: &[&str]) -> Result<CompareArgs, clap::Error> {
        let words = std::iter::once("compare").chain(words.iter().copied());
        Program::try_parse_from(words).map(|program| program.args)
    }

    #[test]
    fn columns_of_the_table_line_up() {
        let set = fixture::parameter_set();
        let comparisons = [
            fixture::comparison("event_01", 0.9),
            fixture::comparison("event_03", 0.5),
        ];
        let left_out = [("event_04".to_owned(), "no power".to_owned())];
        let mut out = Vec::new();
        let judgement = fixture::judgement();
        print_table(&set, &comparisons, &judgement, &left_out, &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        let lines: Vec<_> = text.lines().collect();
        let ends: Vec<_> = lines[1..7]
            .iter()
            .map(|line| line.chars().count())
            .collect();
        assert!(ends.iter().all(|end| *end == ends[0]), "{ends:?}\n{text}");
        assert!(
            lines[4].starts_with("event_03         held out   0.500"),
            "{text}"
        );
        assert!(text.contains("left out: event_04: no power"));
        assert!(lines[6].starts_with("held-out events"), "{text}");
    }

    #[test]
    fn a_set_of_another_site_is_judged_by_what_it_shows_here() {
        let parent = tempfile::tempdir().unwrap();
        let site = |index: usize| {
            let folder = bundled::sites()[index].extract_to(parent.path()).unwrap();
            folder.display().to_string()
        };
        let (own, other) = (site(2), site(3));
        let report = parent.path().join("r.html").display().to_string();
        let json = |words: &[&str]| {
            let words = [words, &["--report", &report, "--json"]].concat();
            let mut out = Vec::new();
            run(&parsed(&words).unwrap(), &mut out).unwrap();
            serde_json::from_slice::<serde_json::Value>(&out).unwrap()
        };
        let found = json(&[&own]);
        let (set, here) = (&found["set"], &found["here"]);
        assert_eq!(here["verdict"], set["verdict"]);
        let file = parent.path().join("set.json").display().to_string();
        fs::write(&file, set.to_string()).unwrap();
        // On the events of its own fit it shows what it was published with.
        let again = json(&[&own, "--parameters", &file]);
        assert_eq!(again["here"]["verdict"]["status"], set["verdict"]["status"]);
        assert_eq!(again["here"]["warnings"], serde_json::json!([]));
        let elsewhere = json(&[&other, "--parameters", &file]);
        let here = &elsewhere["here"];
        assert_ne!(here["site"], elsewhere["set"]["site"]);
        assert_eq!(here["verdict"]["status"], "fail", "{}", here["verdict"]);
        assert!(here["fitted"].is_null() && here["held_out"].is_null());
        let warned = here["warnings"][0].as_str().unwrap();
        assert!(warned.contains("is one of site"), "{warned}");
    }

    #[test]
    fn lists_of_events_choose_the_split() {
        let args = parsed(&["dir", "--train", "a,b", "--hold-out", "c"]).unwrap();
        let expected = Split::Named {
            fitted: vec!["a".to_owned(), "b".to_owned()],
            held_out: vec!["c".to_owned()],
        };
        assert_eq!(
            args.fit.options(&IdentificationOptions::default()).split,
            expected
        );
        let args = parsed(&["dir"]).unwrap();
        assert_eq!(
            args.fit.options(&IdentificationOptions::default()),
            IdentificationOptions::default()
        );
    }

    #[test]
    fn windows_bear_the_names_of_their_files() {
        let parent = tempfile::tempdir().unwrap();
        let site = &bundled::sites()[0];
        let source = SourceArgs {
            site: site.extract_to(parent.path()).unwrap(),
            store: None,
            config: None,
        };
        let windows = source.events().unwrap().usable;
        assert_eq!(windows[0].id, "event_01");
        assert!(windows.iter().all(|w| w.triggers == [Trigger::Recording]));
    }

    #[test]
    fn a_given_set_excludes_what_only_a_fit_needs() {
        assert!(parsed(&["dir", "--parameters", "p.json", "--train", "a"]).is_err());
        assert!(parsed(&["dir", "--parameters", "p.json", "--structure", "zip"]).is_err());
        assert!(parsed(&["dir", "--parameters", "p.json", "--against", "q.json"]).is_ok());
        assert!(parsed(&["dir", "--with", "zip", "--structure", "zip"]).is_err());
    }

    #[test]
    fn any_two_may_stand_side_by_side() {
        let of = |words: &[&str]| asked(&parsed(words).unwrap());
        assert_eq!(of(&["dir"]).unwrap(), (Asked::Structure(None), None));
        let plain = || Asked::Structure(Some("zip+induction_motor".to_owned()));
        let (first, second) =
            of(&["dir", "--with", "zip+induction_motor", "--with", "q.json"]).unwrap();
        assert_eq!(
            (first, second),
            (plain(), Some(Asked::File("q.json".into())))
        );
        let error = of(&["dir", "--with", "a", "--with", "b", "--with", "c"]).unwrap_err();
        assert!(error.to_string().contains("not 3 times"), "{error}");
    }

    #[test]
    fn a_parameter_file_that_is_none_is_named_in_the_error() {
        let parent = tempfile::tempdir().unwrap();
        let folder = bundled::sites()[0].extract_to(parent.path()).unwrap();
        let file = parent.path().join("p.json");
        fs::write(&file, "{}").unwrap();
        let folder = folder.display().to_string();
        for (name, expected) in [
            ("p.json", "p.json: "),
            ("none.json", "cannot read parameters"),
        ] {
            let path = parent.path().join(name).display().to_string();
            let args = parsed(&[&folder, "--parameters", &path]).unwrap();
            let error = run(&args, &mut Vec::new()).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains(name), "{error}");
        }
    }

    #[test]
    fn a_folder_that_is_none_is_an_error() {
        let args = parsed(&["no-such-folder"]).unwrap();
        let error = run(&args, &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("no-such-folder"), "{error}");
    }
}
