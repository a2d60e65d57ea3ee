//! From batches to stored, screened and announced windows.

use super::{support::stored_windows, *};

#[test]
fn a_window_is_stored_before_anything_else_happens_to_it() {
    let mut bench = Bench::new();
    let commands = bench.feed_dip(0);
    let windows = stored_windows(&commands);
    assert_eq!(windows.len(), 1);
    assert_eq!(windows[0].closing, Closing::StreamSilent);
    assert!(
        !commands.iter().any(|c| matches!(
            c,
            Command::StoreScreening { .. } | Command::Announce { .. } | Command::Queue { .. }
        )),
        "{commands:?}"
    );
    let next = bench.apply(stored(&windows[0]));
    assert!(
        matches!(next[0], Command::StoreScreening { .. }),
        "{next:?}"
    );
}

#[test]
fn a_usable_window_is_announced_and_queued_for_itself_and_for_its_site() {
    let mut bench = Bench::new();
    let window = bench.window();
    let _ = bench.feed_dip(0);
    let _ = bench.apply(stored(&window));
    let commands = bench.apply(Event::ScreeningStored {
        window: window.id.clone(),
    });
    let queued: Vec<&Work> = commands
        .iter()
        .filter_map(|c| match c {
            Command::Queue { work, .. } => Some(work),
            _ => None,
        })
        .collect();
    assert_eq!(
        queued,
        [&Work::event("north", &window.id), &Work::site("north")]
    );
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::Announce { .. }))
    );
    let told = bench.apply(Event::EventAnnounced {
        window: window.id.clone(),
    });
    assert!(matches!(told[0], Command::MarkAnnounced { .. }));
}

#[test]
fn a_refused_window_is_announced_and_not_fitted() {
    let mut bench = Bench::new();
    let window = Arc::new(bench.window());
    let screening = Screening {
        refusals: vec![ScreeningReason::NoPower { active_pu: 0.0 }],
        marks: Vec::new(),
    };
    let commands = bench.apply(Event::BacklogLoaded(
        BacklogPart::WindowsAndUnpublished,
        Backlog {
            unannounced: vec![(window, screening)],
            ..Backlog::default()
        },
    ));
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::Announce { .. }))
    );
    assert!(!commands.iter().any(|c| matches!(c, Command::Queue { .. })));
}

#[test]
fn a_window_that_the_store_knows_is_left_alone() {
    let mut bench = Bench::new();
    let window = stored_windows(&bench.feed_dip(0)).remove(0);
    let commands = bench.apply(Event::WindowStored {
        window: window.id,
        known: true,
    });
    assert!(
        !commands
            .iter()
            .any(|c| matches!(c, Command::StoreScreening { .. }))
    );
    assert!(bench.metric(&catalogue::WINDOWS, &["north"]).abs() < f64::EPSILON);
}

#[test]
fn a_store_that_refuses_is_probed_with_the_oldest_window_until_it_takes_it() {
    let mut bench = Bench::new();
    let first = stored_windows(&bench.feed_dip(0)).remove(0);
    let _ = bench.apply(not_stored(&first));
    let second = bench.feed_dip(100);
    assert_eq!(
        ids(&stored_windows(&second)),
        [&first.id],
        "the probe, and nothing new"
    );
    let _ = bench.apply(not_stored(&first));
    bench.pass(10 * SECOND_NS);
    let probe = bench.apply(Event::Tick);
    assert_eq!(ids(&stored_windows(&probe)), [&first.id]);
    let rest = bench.apply(stored(&first));
    assert_eq!(
        stored_windows(&rest).len(),
        1,
        "the store is back: the other one follows"
    );
}

#[test]
fn a_full_spool_drops_the_oldest_window_and_counts_it() {
    let mut bench = Bench::new();
    let first = stored_windows(&bench.feed_dip(0)).remove(0);
    let _ = bench.apply(not_stored(&first));
    for k in 1..=3 {
        let _ = bench.feed_dip(100 * k);
    }
    assert!((bench.metric(&catalogue::WINDOWS_DROPPED, &[]) - 1.0).abs() < f64::EPSILON);
    assert!((bench.metric(&catalogue::WINDOWS_SPOOLED, &[]) - 3.0).abs() < f64::EPSILON);
}

#[test]
fn a_slow_store_is_given_one_window_and_the_others_wait_within_the_bound() {
    let mut bench = Bench::new();
    let given = |commands: &[Command]| stored_windows(commands);
    let first = given(&bench.feed_dip(0)).remove(0);
    // It does not answer. Intake goes on, three windows have room, and the oldest that waits is dropped.
    for k in 1..=3 {
        let commands = bench.feed_dip(100 * k);
        assert!(given(&commands).is_empty(), "{commands:?}");
    }
    let metric = |bench: &Bench, metric| bench.metric(metric, &[]);
    assert!((metric(&bench, &catalogue::WINDOWS_SPOOLED) - 3.0).abs() < 0.5);
    assert!((metric(&bench, &catalogue::WINDOWS_DROPPED) - 1.0).abs() < 0.5);
    assert!((bench.metric(&catalogue::SAMPLES, &["north", "accepted"]) - 2000.0).abs() < 0.5);
    let measurements = |commands: &[Command]| {
        let measured = |c: &&Command| matches!(c, Command::MeasureStore);
        commands.iter().filter(measured).count()
    };
    bench.pass(100 * SECOND_NS);
    assert_eq!(
        measurements(&bench.apply(Event::Tick)),
        0,
        "one is asked for already"
    );
    let mut window = first;
    for left in [2, 1] {
        let next = given(&bench.apply(stored(&window)));
        assert_eq!(next.len(), 1);
        assert!((metric(&bench, &catalogue::WINDOWS_SPOOLED) - f64::from(left)).abs() < 0.5);
        window = next[0].clone();
    }
    assert!(given(&bench.apply(stored(&window))).is_empty());
    assert!(metric(&bench, &catalogue::WINDOWS_SPOOLED).abs() < 0.5);
    assert!((bench.metric(&catalogue::WINDOWS, &["north"]) - 3.0).abs() < 0.5);
}

#[test]
fn a_step_that_failed_after_storage_is_left_to_the_next_look() {
    let mut bench = Bench::new();
    let window = bench.window();
    let _ = bench.feed_dip(0);
    let _ = bench.apply(stored(&window));
    let _ = bench.apply(Event::WindowStepFailed {
        window: window.id.clone(),
        failure: failure(),
    });
    bench.pass(10 * SECOND_NS);
    let commands = bench.apply(Event::Tick);
    let _ = bench.apply(Event::BacklogLoaded(
        BacklogPart::Everything,
        Backlog::default(),
    ));
    assert!(
        commands
            .iter()
            .any(|c| matches!(c, Command::LoadBacklog(_)))
            || {
                bench.pass(10 * SECOND_NS);
                let next = bench.apply(Event::Tick);
                next.iter()
                    .any(|c| matches!(c, Command::LoadBacklog(BacklogPart::Everything)))
            }
    );
    let taken = bench.apply(Event::BacklogLoaded(
        BacklogPart::Everything,
        Backlog {
            unscreened: vec![Arc::new(window)],
            ..Backlog::default()
        },
    ));
    assert!(
        taken
            .iter()
            .any(|c| matches!(c, Command::StoreScreening { .. }))
    );
}

#[test]
fn the_same_dip_twice_is_one_window() {
    let mut bench = Bench::new();
    let _ = bench.apply(Event::BatchDecoded(Bench::dip(0)));
    let _ = bench.apply(Event::BatchDecoded(Bench::dip(0)));
    bench.pass(10 * SECOND_NS);
    let commands = bench.apply(Event::Tick);
    assert_eq!(stored_windows(&commands).len(), 1);
    // What was released already is late the second time, what still waited is a duplicate.
    let again = ["duplicate", "late"].map(|o| bench.metric(&catalogue::SAMPLES, &["north", o]));
    assert!(
        (again[0] + again[1] - 500.0).abs() < f64::EPSILON,
        "{again:?}"
    );
}

#[test]
fn a_batch_of_an_unknown_site_is_counted_under_no_site() {
    let mut bench = Bench::new();
    let batch = SampleBatch {
        site: "nowhere".to_owned(),
        ..Bench::dip(0)
    };
    let _ = bench.apply(Event::BatchDecoded(batch));
    let labels = ["measurement", "unknown_site"];
    assert!((bench.metric(&catalogue::PAYLOADS_REFUSED, &labels) - 1.0).abs() < f64::EPSILON);
    assert!(bench.metric(&catalogue::BATCHES, &["nowhere"]).abs() < f64::EPSILON);
}

#[test]
fn a_burst_of_events_postpones_the_joint_fit_only_so_far() {
    let mut bench = Bench::new();
    let settle_ns = ServiceOptions::default().settle_ns;
    let begun_ns = bench.now_ns;
    let mut due = Vec::new();
    for _ in 0..40 {
        let backlog = Backlog {
            usable: vec![("north".to_owned(), vec!["a".to_owned()])],
            ..Backlog::default()
        };
        let commands = bench.apply(Event::BacklogLoaded(BacklogPart::Everything, backlog));
        due.extend(commands.iter().filter_map(|c| match c {
            Command::Queue { work, due_ns } if work.kind == WorkKind::Site => Some(*due_ns),
            _ => None,
        }));
        bench.pass(settle_ns / 2);
    }
    assert_eq!(due.first(), Some(&(begun_ns + settle_ns)));
    assert_eq!(due.last(), Some(&(begun_ns + 10 * settle_ns)));
}

fn stored(window: &Window) -> Event {
    Event::WindowStored {
        window: window.id.clone(),
        known: false,
    }
}

fn not_stored(window: &Window) -> Event {
    Event::WindowNotStored {
        window: window.id.clone(),
        failure: failure(),
    }
}

fn ids(windows: &[Window]) -> Vec<&String> {
    windows.iter().map(|w| &w.id).collect()
}
