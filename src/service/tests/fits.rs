//! From a claimed job to a decision.

use super::*;

#[test]
fn a_joint_fit_is_stored_decided_on_and_published_in_this_order() {
    let mut bench = Bench::new();
    let run = bench.claim(1, WorkKind::Site);
    assert!(run.iter().any(|c| matches!(c, Command::RunFit(_))));
    let store = bench.apply(ended(1, FitEnd::Fitted(fitted())));
    assert!(matches!(store[0], Command::StoreFit { .. }), "{store:?}");
    let commit = bench.apply(Event::FitStored { job: 1, fit: 9 });
    let decision = commit.iter().find_map(|c| match c {
        Command::CommitDecision {
            fit: 9, decision, ..
        } => Some(decision),
        _ => None,
    });
    assert!(
        matches!(decision, Some(Decision::Publish { .. })),
        "{commit:?}"
    );
    let publish = bench.apply(Event::DecisionCommitted {
        job: 1,
        version: Some(1),
        known: false,
    });
    assert!(
        publish
            .iter()
            .any(|c| matches!(c, Command::LoadBacklog(BacklogPart::Unpublished)))
    );
    assert_eq!(
        end_of(&publish),
        Some(&WorkEnd::Complete {
            outcome: "publish as version 1: first validated set of the site".to_owned()
        })
    );
    assert!((bench.metric(&catalogue::FITS, &["north", "pass"]) - 1.0).abs() < f64::EPSILON);
}

#[test]
fn a_set_that_was_decided_on_while_stopping_is_published_before_the_end() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Site);
    let _ = bench.apply(Event::NothingToClaim);
    let _ = bench.apply(ended(1, FitEnd::Fitted(fitted())));
    let _ = bench.apply(Event::StopRequested);
    let _ = bench.apply(Event::IntakeStopped);
    let _ = bench.apply(Event::FitStored { job: 1, fit: 9 });
    let version = Some(1);
    let mut steps = vec![
        Event::DecisionCommitted {
            job: 1,
            version,
            known: false,
        },
        Event::WorkEnded {
            job: 1,
            parked: false,
        },
    ];
    let site = || "north".to_owned();
    let set = PendingDocument {
        kind: DocumentKind::Set,
        site: site(),
        version: 1,
        document: "{}".to_owned(),
    };
    let backlog = Backlog {
        unpublished: vec![set],
        ..Backlog::default()
    };
    steps.push(Event::BacklogLoaded(BacklogPart::Unpublished, backlog));
    steps.push(published(site(), 1));
    for step in steps {
        let commands = bench.apply(step);
        assert!(
            !commands.iter().any(|c| matches!(c, Command::Stop)),
            "{commands:?}"
        );
    }
    let last = bench.apply(Event::PublicationMarked {
        kind: DocumentKind::Set,
        site: site(),
        version: 1,
    });
    assert!(matches!(last[..], [Command::Stop]), "{last:?}");
}

#[test]
fn the_fit_of_one_event_is_stored_and_not_decided_on() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Event);
    let _ = bench.apply(ended(1, FitEnd::Fitted(fitted())));
    let commands = bench.apply(Event::FitStored { job: 1, fit: 9 });
    assert!(matches!(end_of(&commands), Some(WorkEnd::Complete { .. })));
    assert!(
        !commands
            .iter()
            .any(|c| matches!(c, Command::CommitDecision { .. }))
    );
}

#[test]
fn a_fit_on_record_is_decided_on_without_another() {
    let candidate = Arc::new(Candidate {
        set: fitted().identification.set.clone(),
        in_force: None,
    });
    for again in [false, true] {
        let mut bench = Bench::new();
        let _ = bench.claim(1, WorkKind::Site);
        let candidate = Arc::clone(&candidate);
        let commands = bench.apply(ended(
            1,
            FitEnd::Known {
                fit: 4,
                candidate,
                again,
            },
        ));
        let Command::CommitDecision {
            fit: 4, decision, ..
        } = &commands[0]
        else {
            panic!("{commands:?}");
        };
        let said = decision
            .reason()
            .contains("were fitted with this structure before");
        assert_eq!(said, again, "{decision:?}");
    }
}

#[test]
fn a_finished_fit_survives_a_store_that_refuses_it() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Site);
    let _ = bench.apply(ended(1, FitEnd::Fitted(fitted())));
    for _ in 0..5 {
        let _ = bench.apply(Event::WorkStepFailed {
            job: 1,
            failure: failure(),
        });
        bench.pass(10 * SECOND_NS);
        let commands = bench.apply(Event::Tick);
        assert!(
            commands
                .iter()
                .any(|c| matches!(c, Command::StoreFit { .. })),
            "{commands:?}"
        );
    }
}

#[test]
fn no_more_jobs_are_claimed_than_there_are_workers() {
    let mut bench = Bench::new();
    let mut claims = 0;
    for job in 1..10 {
        let commands = bench.apply(Event::Tick);
        if commands.iter().any(|c| matches!(c, Command::Claim { .. })) {
            claims += 1;
            let _ = bench.claim(job, WorkKind::Event);
        }
        bench.pass(2 * SECOND_NS);
    }
    // The tick asks for one, and each answer that leaves a worker free asks for the next.
    assert!(claims <= 2 && bench.state.fits_running() <= 2, "{claims}");
}

#[test]
fn a_fit_over_its_budget_is_cancelled_and_counts_as_failed() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Event);
    bench.pass(901 * SECOND_NS);
    let commands = bench.apply(Event::Tick);
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::CancelFit { job: 1 }))
    );
    let commands = bench.apply(ended(1, FitEnd::Cancelled));
    assert!(
        matches!(end_of(&commands), Some(WorkEnd::Fail { .. })),
        "{commands:?}"
    );
    assert!((bench.metric(&catalogue::FITS_INTERRUPTED, &["budget"]) - 1.0).abs() < f64::EPSILON);
}

#[test]
fn a_panic_in_a_fit_is_a_failed_job() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Event);
    let message = "index out of bounds".to_owned();
    let commands = bench.apply(ended(1, FitEnd::Panicked { message }));
    assert!(
        matches!(end_of(&commands), Some(WorkEnd::Fail { .. })),
        "{commands:?}"
    );
    let _ = bench.apply(Event::WorkEnded {
        job: 1,
        parked: true,
    });
    assert!((bench.metric(&catalogue::FITS_INTERRUPTED, &["panic"]) - 1.0).abs() < f64::EPSILON);
    assert!((bench.metric(&catalogue::JOBS_PARKED, &[]) - 1.0).abs() < f64::EPSILON);
}

#[test]
fn data_without_a_set_end_the_job_for_good() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Event);
    let reason = "no event can be fitted".to_owned();
    let commands = bench.apply(ended(1, FitEnd::NoSet { reason }));
    assert!(
        matches!(end_of(&commands), Some(WorkEnd::Complete { .. })),
        "{commands:?}"
    );
    assert!((bench.metric(&catalogue::FITS, &["north", "error"]) - 1.0).abs() < f64::EPSILON);
}

#[test]
fn leases_are_extended_and_a_lost_one_ends_the_work() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Event);
    bench.pass(20 * SECOND_NS);
    let commands = bench.apply(Event::Tick);
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::Heartbeat { .. }))
    );
    let commands = bench.apply(Event::LeaseAnswered {
        job: 1,
        held: false,
    });
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::CancelFit { job: 1 }))
    );
    let commands = bench.apply(ended(1, FitEnd::Fitted(fitted())));
    assert!(
        !commands
            .iter()
            .any(|c| matches!(c, Command::StoreFit { .. })),
        "{commands:?}"
    );
    assert_eq!(bench.state.fits_running(), 0);
}

#[test]
fn two_joint_fits_of_a_site_run_one_after_the_other() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Site);
    let second = bench.claim(2, WorkKind::Site);
    assert!(!second.iter().any(|c| matches!(c, Command::RunFit(_))));
    let reason = String::new();
    let _ = bench.apply(ended(1, FitEnd::NoSet { reason }));
    let _ = bench.apply(Event::WorkEnded {
        job: 1,
        parked: false,
    });
    let commands = bench.apply(Event::Tick);
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::RunFit(claimed) if claimed.job() == 2))
    );
}

#[test]
fn a_candidate_that_cannot_be_judged_is_not_published() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Site);
    let mut fit = fitted().as_ref().clone();
    fit.identification.set.verdict = verdict(VerdictStatus::CannotJudge);
    let _ = bench.apply(ended(1, FitEnd::Fitted(Arc::new(fit))));
    let commands = bench.apply(Event::FitStored { job: 1, fit: 9 });
    let rejected = commands.iter().any(|c| {
        matches!(
            c,
            Command::CommitDecision {
                decision: Decision::Reject { .. },
                ..
            }
        )
    });
    assert!(rejected, "{commands:?}");
}

pub(super) fn ended(job: i64, end: FitEnd) -> Event {
    Event::FitEnded { job, end }
}

pub(super) fn end_of(commands: &[Command]) -> Option<&WorkEnd> {
    commands.iter().find_map(|c| match c {
        Command::EndWork { end, .. } => Some(end),
        _ => None,
    })
}
