//! The order of the end.

use super::{
    fits::{end_of, ended},
    support::stored_windows,
    *,
};

#[test]
fn an_open_window_is_stored_before_the_service_stops() {
    let mut bench = Bench::new();
    let _ = bench.apply(Event::BatchDecoded(Bench::dip(0)));
    let _ = bench.apply(Event::NothingToClaim);
    let begin = bench.apply(Event::StopRequested);
    assert!(matches!(begin[..], [Command::StopIntake]), "{begin:?}");
    let flush = bench.apply(Event::IntakeStopped);
    let window = stored_windows(&flush).remove(0);
    assert!(!stops(&flush));
    let id = || window.id.clone();
    let mut steps = bench.apply(Event::WindowStored {
        window: id(),
        known: false,
    });
    assert!(!stops(&steps));
    steps = bench.apply(Event::ScreeningStored { window: id() });
    for command in &steps {
        if let Command::Queue { work, .. } = command {
            let work = work.clone();
            assert!(!stops(
                &bench.apply(Event::WorkQueued { work, known: false })
            ));
        }
    }
    assert!(!stops(&bench.apply(Event::EventAnnounced { window: id() })));
    assert!(stops(
        &bench.apply(Event::AnnouncementMarked { window: id() })
    ));
}

#[test]
fn nothing_is_claimed_while_the_service_stops() {
    let mut bench = Bench::new();
    let claim = bench.apply(Event::Tick);
    assert!(claim.iter().any(|c| matches!(c, Command::Claim { .. })));
    let _ = bench.apply(Event::StopRequested);
    assert!(
        !stops(&bench.apply(Event::IntakeStopped)),
        "a claim is on its way"
    );
    let late = bench.claim(5, WorkKind::Event);
    assert_eq!(end_of(&late), Some(&WorkEnd::Release));
    let end = bench.apply(Event::WorkEnded {
        job: 5,
        parked: false,
    });
    assert!(stops(&end));
}

#[test]
fn a_fit_that_ends_within_half_the_grace_is_kept() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Event);
    let _ = bench.apply(Event::StopRequested);
    let _ = bench.apply(Event::IntakeStopped);
    bench.pass(5 * SECOND_NS);
    let commands = bench.apply(ended(1, FitEnd::Fitted(fitted())));
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::StoreFit { .. }))
    );
}

#[test]
fn a_fit_that_does_not_is_cancelled_and_given_back() {
    let mut bench = Bench::new();
    let _ = bench.claim(1, WorkKind::Event);
    let _ = bench.apply(Event::NothingToClaim);
    let _ = bench.apply(Event::StopRequested);
    let _ = bench.apply(Event::IntakeStopped);
    bench.pass(10 * SECOND_NS);
    let commands = bench.apply(Event::Tick);
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::CancelFit { job: 1 }))
    );
    let commands = bench.apply(ended(1, FitEnd::Cancelled));
    assert_eq!(end_of(&commands), Some(&WorkEnd::Release));
    assert!(stops(&bench.apply(Event::WorkEnded {
        job: 1,
        parked: false
    })));
}

#[test]
fn the_service_stops_at_the_end_of_the_grace_and_counts_what_it_lost() {
    let mut bench = Bench::new();
    let _ = bench.apply(Event::BatchDecoded(Bench::dip(0)));
    let _ = bench.apply(Event::StopRequested);
    let _ = bench.apply(Event::IntakeStopped);
    bench.pass(21 * SECOND_NS);
    assert!(stops(&bench.apply(Event::Tick)));
    assert!((bench.metric(&catalogue::WINDOWS_DROPPED, &[]) - 1.0).abs() < f64::EPSILON);
}

fn stops(commands: &[Command]) -> bool {
    commands.iter().any(|c| matches!(c, Command::Stop))
}
