//! From a decision to a diagnosis, and from a change by a person to a fit.

use super::{fits::ended, *};
use crate::diagnosis::{Diagnosis, DiagnosisCost, EventSets, Status, StructureErrors};

fn diagnosed() -> Arc<Diagnosed> {
    Arc::new(Diagnosed {
        diagnosis: Diagnosis {
            site: "north".to_owned(),
            structure: vec!["zip".to_owned(), "induction_motor".to_owned()],
            status: Status::MissingEffect,
            summary: "stator_resistance is missing".to_owned(),
            reasons: Vec::new(),
            events: EventSets::default(),
            baseline: StructureErrors::default(),
            noise_floor: 1.0,
            segments: Vec::new(),
            failures: Vec::new(),
            effects: Vec::new(),
            candidates: Vec::new(),
            answer_set: vec!["stator_resistance".to_owned()],
            untestable: Vec::new(),
            unexplained: None,
            model: None,
            cost: DiagnosisCost::default(),
        },
        error_after: Some(1.2),
        inputs_hash: "hash".to_owned(),
    })
}

fn queued(commands: &[Command]) -> Vec<(Work, i64)> {
    let queued = commands.iter().filter_map(|c| match c {
        Command::Queue { work, due_ns } => Some((work.clone(), *due_ns)),
        _ => None,
    });
    queued.collect()
}

fn decided(bench: &mut Bench, version: Option<u64>) -> Vec<Command> {
    let _ = bench.claim(1, WorkKind::Site);
    let _ = bench.apply(ended(1, FitEnd::Fitted(fitted())));
    let _ = bench.apply(Event::FitStored { job: 1, fit: 9 });
    bench.apply(Event::DecisionCommitted {
        job: 1,
        version,
        known: false,
    })
}

#[test]
fn a_site_is_diagnosed_after_its_joint_fit_was_decided_on_whatever_the_decision() {
    for version in [Some(1), None] {
        let mut bench = Bench::new();
        let commands = decided(&mut bench, version);
        let expected = [(Work::diagnosis("north"), bench.now_ns)];
        assert_eq!(queued(&commands), expected, "{version:?}");
    }
}

#[test]
fn nothing_is_diagnosed_where_that_is_switched_off() {
    let mut bench = Bench::with(ServiceOptions {
        diagnose: false,
        ..ServiceOptions::default()
    });
    let commands = decided(&mut bench, Some(1));
    assert!(queued(&commands).is_empty(), "{commands:?}");
}

#[test]
fn a_diagnosis_is_stored_counted_and_published() {
    let mut bench = Bench::new();
    let run = bench.claim(1, WorkKind::Diagnosis);
    assert!(run.iter().any(|c| matches!(c, Command::RunFit(_))));
    let store = bench.apply(ended(1, FitEnd::Diagnosed(diagnosed())));
    assert!(matches!(store[..], [Command::StoreDiagnosis { .. }, ..]));
    let commands = bench.apply(Event::DiagnosisStored {
        job: 1,
        version: 3,
        known: false,
    });
    let loads = |c: &Command| matches!(c, Command::LoadBacklog(BacklogPart::Unpublished));
    assert!(commands.iter().any(loads), "{commands:?}");
    let done = WorkEnd::Complete {
        outcome: "diagnosis 3: missing_effect: stator_resistance is missing".to_owned(),
    };
    assert_eq!(fits::end_of(&commands), Some(&done));
    let one = |bench: &Bench, metric, label: &str| {
        assert!((bench.metric(metric, &[label]) - 1.0).abs() < f64::EPSILON);
    };
    one(&bench, &catalogue::DIAGNOSES, "missing_effect");
    one(&bench, &catalogue::DIAGNOSED_EFFECTS, "stator_resistance");
    one(&bench, &catalogue::DIAGNOSIS_ERROR_TO_NOISE, "before");
    one(&bench, &catalogue::DIAGNOSIS_ERROR_TO_NOISE, "after");
}

#[test]
fn two_diagnoses_of_a_site_run_one_after_the_other_and_beside_a_fit() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Diagnosis);
    let second = bench.claim(2, WorkKind::Diagnosis);
    assert!(!second.iter().any(|c| matches!(c, Command::RunFit(_))));
    let fit = bench.claim(3, WorkKind::Site);
    assert!(fit.iter().any(|c| matches!(c, Command::RunFit(_))));
}

#[test]
fn a_diagnosis_that_cannot_be_made_is_counted_and_ends() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Diagnosis);
    let reason = "no event can be fitted".to_owned();
    let commands = bench.apply(ended(1, FitEnd::NoSet { reason }));
    assert!(matches!(
        fits::end_of(&commands),
        Some(WorkEnd::Complete { .. })
    ));
    assert!((bench.metric(&catalogue::DIAGNOSES, &["error"]) - 1.0).abs() < f64::EPSILON);
    assert!(bench.metric(&catalogue::FITS, &["north", "error"]).abs() < f64::EPSILON);
}

#[test]
fn a_changed_structure_is_fitted_without_waiting_for_quiet() {
    let mut bench = Bench::new();
    let commands = bench.apply(Event::StructureChanged {
        site: "north".to_owned(),
        structure: vec!["zip".to_owned(), "induction_motor".to_owned()],
        origin: "http",
        actor: "engineer".to_owned(),
    });
    let expected = [(Work::site("north"), bench.now_ns)];
    assert_eq!(queued(&commands), expected);
    assert!(!bench.state.at_rest(), "the job is on its way");
    let told = Backlog {
        restructured: vec!["north".to_owned()],
        ..Backlog::default()
    };
    let part = BacklogPart::WindowsAndUnpublished;
    let commands = bench.apply(Event::BacklogLoaded(part, told));
    assert_eq!(queued(&commands), expected, "nobody told the service");
}

#[test]
fn a_set_that_a_person_makes_count_is_published() {
    let mut bench = Bench::new();
    let commands = bench.apply(Event::SetsChanged {
        site: "north".to_owned(),
        action: "roll_back",
        version: Some(1),
        actor: "engineer".to_owned(),
    });
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::LoadBacklog(BacklogPart::Unpublished)))
    );
    assert!((bench.metric(&catalogue::SET_ACTIONS, &["roll_back"]) - 1.0).abs() < f64::EPSILON);
}

#[test]
fn a_diagnosis_that_counts_again_is_published() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Diagnosis);
    let commands = bench.apply(ended(
        1,
        FitEnd::DiagnosedBefore {
            earlier: 4,
            version: 7,
        },
    ));
    let loads = |c: &Command| matches!(c, Command::LoadBacklog(BacklogPart::Unpublished));
    assert!(commands.iter().any(loads), "{commands:?}");
    let done = WorkEnd::Complete {
        outcome: "diagnosis 7: as 4".to_owned(),
    };
    assert_eq!(fits::end_of(&commands), Some(&done));
}
