//! The core, fed with events.

use std::sync::Arc;

use super::{
    AskedDocument, Backlog, BacklogPart, Candidate, Claimed, Command, Diagnosed, DocumentKind,
    Event, Failure, FitEnd, Fitted, Lease, PendingDocument, ServiceOptions, SiteOptions, State,
    Work, WorkEnd, WorkKind,
};
use crate::{
    disturbance::{Closing, DetectorOptions, Screening, ScreeningOptions, ScreeningReason, Window},
    identification::{
        Bases, Cost, Decision, ErrorSummary, Identification, OperatingPoint, ParameterSet, Verdict,
        VerdictStatus,
    },
    measurement::{Channel, ConcentratorOptions, Quality, SampleBatch, Site},
    telemetry::{Metrics, catalogue},
};

mod diagnoses;
mod fits;
mod progress;
mod shutdown;
mod support;
mod windows;

use support::{Bench, SECOND_NS, failure, fitted, verdict};

fn published(site: String, version: u64) -> Event {
    Event::Published {
        kind: DocumentKind::Set,
        site,
        version,
    }
}

#[test]
fn the_first_tick_looks_for_what_was_left_behind() {
    let mut bench = Bench::new();
    let commands = bench.apply(Event::Tick);
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::LoadBacklog(BacklogPart::Everything)))
    );
    let again = bench.apply(Event::Tick);
    assert!(!again.iter().any(|c| matches!(c, Command::LoadBacklog(_))));
}

#[test]
fn a_look_that_failed_is_repeated_in_full() {
    let mut bench = Bench::new();
    let _ = bench.apply(Event::Tick);
    let _ = bench.apply(Event::BacklogFailed(BacklogPart::Everything, failure()));
    bench.pass(10 * SECOND_NS);
    let commands = bench.apply(Event::Tick);
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::LoadBacklog(BacklogPart::Everything)))
    );
}

#[test]
fn what_was_left_behind_is_taken_up_once() {
    let mut bench = Bench::new();
    let window = Arc::new(bench.window());
    let set = PendingDocument {
        kind: DocumentKind::Set,
        site: "north".to_owned(),
        version: 2,
        document: "{}".to_owned(),
    };
    let backlog = || Backlog {
        unscreened: vec![Arc::clone(&window)],
        usable: vec![("north".to_owned(), vec!["old".to_owned()])],
        unpublished: vec![set.clone()],
        ..Backlog::default()
    };
    let first = bench.apply(Event::BacklogLoaded(BacklogPart::Everything, backlog()));
    let second = bench.apply(Event::BacklogLoaded(BacklogPart::Everything, backlog()));
    let count = |commands: &[Command], test: fn(&Command) -> bool| {
        commands.iter().filter(|c| test(c)).count()
    };
    let screenings = |c: &Command| matches!(c, Command::StoreScreening { .. });
    let publications = |c: &Command| matches!(c, Command::Publish(_));
    assert_eq!(
        (count(&first, screenings), count(&second, screenings)),
        (1, 0)
    );
    assert_eq!(
        (count(&first, publications), count(&second, publications)),
        (1, 0)
    );
    let queued = |c: &Command| matches!(c, Command::Queue { .. });
    assert_eq!(count(&first, queued), 3, "event, site, diagnosis");
}

#[test]
fn a_set_that_is_on_its_key_is_not_put_there_again_when_the_store_could_not_be_told() {
    let mut bench = Bench::new();
    let _ = bench.apply(Event::BacklogLoaded(
        BacklogPart::Unpublished,
        Backlog {
            unpublished: vec![PendingDocument {
                kind: DocumentKind::Set,
                site: "north".to_owned(),
                version: 1,
                document: "{}".to_owned(),
            }],
            ..Backlog::default()
        },
    ));
    let named = || ("north".to_owned(), 1);
    let (site, version) = named();
    let told = bench.apply(published(site, version));
    assert!(
        told.iter()
            .any(|c| matches!(c, Command::MarkPublished { version: 1, .. }))
    );
    let (site, version) = named();
    let _ = bench.apply(Event::PublicationFailed {
        kind: DocumentKind::Set,
        site,
        version,
        failure: failure(),
    });
    bench.pass(10 * SECOND_NS);
    let repeated = bench.apply(Event::Tick);
    assert!(
        repeated
            .iter()
            .any(|c| matches!(c, Command::MarkPublished { version: 1, .. }))
    );
    assert!(!repeated.iter().any(|c| matches!(c, Command::Publish(_))));
    assert!((bench.metric(&catalogue::SETS_PUBLISHED, &["north"]) - 1.0).abs() < f64::EPSILON);
}

#[test]
fn a_question_without_sense_is_refused_and_counted() {
    let mut bench = Bench::new();
    let commands = bench.apply(Event::DocumentAsked {
        question: 7,
        selector: "p?version=x".to_owned(),
        asked: Err("the version `x` is not a number".to_owned()),
    });
    assert!(matches!(&commands[0], Command::Refuse { question: 7, .. }));
    assert!((bench.metric(&catalogue::QUERIES, &["malformed"]) - 1.0).abs() < f64::EPSILON);
}

#[test]
fn questions_beyond_the_bound_are_refused() {
    let mut bench = Bench::new();
    let mut refused = 0;
    for question in 0..300 {
        let commands = bench.apply(Event::DocumentAsked {
            question,
            selector: String::new(),
            asked: Ok(AskedDocument {
                kind: DocumentKind::Set,
                site: "north".to_owned(),
                version: None,
            }),
        });
        refused += commands
            .iter()
            .filter(|c| matches!(c, Command::Refuse { .. }))
            .count();
    }
    assert_eq!(refused, 300 - 256);
}

#[test]
fn a_site_makes_as_many_series_as_the_documentation_says() {
    let mut per_site = 0;
    for metric in catalogue::CATALOGUE
        .iter()
        .filter(|m| m.labels.contains(&"site"))
    {
        per_site += match metric.labels {
            ["site", "outcome"] => 12,
            ["site", "kind"] => 6,
            // Of each stream that is configured, besides.
            ["site", "stream", "outcome"] => 0,
            ["site", "verdict" | "channel"] => 2,
            ["site", "result" | "decision"] => 4,
            ["site"] => 1,
            other => panic!("{}: count the values of {other:?} here", metric.name),
        };
    }
    assert!(per_site <= 43, "{per_site}");
}
