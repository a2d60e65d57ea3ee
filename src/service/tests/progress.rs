//! What passes while nothing is taken in is counted: gaps, silences, and the time without a service.

use super::*;
use crate::measurement::Progress;

/// The progress that a bench asks to be kept.
fn kept(commands: &[Command]) -> Option<(String, Progress)> {
    let mut progress = commands.iter().filter_map(|c| match c {
        Command::KeepProgress(progress) => progress.first().cloned(),
        _ => None,
    });
    progress.next()
}

fn samples(bench: &Bench, outcome: &str) -> f64 {
    bench.metric(&catalogue::SAMPLES, &["north", outcome])
}

#[test]
fn instants_that_pass_between_two_runs_of_the_service_are_counted() {
    let mut first = Bench::new();
    let _ = first.apply(Event::BatchDecoded(Bench::dip(0)));
    let progress = kept(&first.apply(Event::Tick)).unwrap();
    assert!(
        kept(&first.apply(Event::Tick)).is_none(),
        "the store is at it"
    );
    let _ = first.apply(Event::ProgressKept(Ok(())));
    first.pass(2 * SECOND_NS);
    assert!(kept(&first.apply(Event::Tick)).is_none(), "nothing new");

    // It is killed; the next run hears the stream again 30 s after its 10 s of samples had begun.
    let mut second = Bench::new();
    second.state = second.state.resuming(vec![progress]);
    let _ = second.apply(Event::BatchDecoded(Bench::dip(30)));
    assert!((samples(&second, "skipped") - 20.0 * 50.0).abs() < 0.5);
    let steps = |kind: &str| second.metric(&catalogue::TIME_STEPS, &["north", kind]);
    assert!((steps("restart") - 1.0).abs() < 0.5);
}

#[test]
fn progress_that_the_store_did_not_keep_is_asked_for_again() {
    let mut bench = Bench::new();
    let _ = bench.apply(Event::BatchDecoded(Bench::dip(0)));
    let asked = kept(&bench.apply(Event::Tick)).unwrap();
    let _ = bench.apply(Event::ProgressKept(Err(failure())));
    assert!(kept(&bench.apply(Event::Tick)).is_none(), "after a pause");
    bench.pass(ServiceOptions::default().store_retry_ns);
    // Nothing has come since: it is the same again, and once kept it is not asked for any more.
    assert_eq!(kept(&bench.apply(Event::Tick)), Some(asked));
    let _ = bench.apply(Event::ProgressKept(Ok(())));
    bench.pass(2 * SECOND_NS);
    assert!(kept(&bench.apply(Event::Tick)).is_none());
}

#[test]
fn a_run_that_hears_the_next_sample_has_missed_nothing() {
    let mut first = Bench::new();
    let _ = first.apply(Event::BatchDecoded(Bench::dip(0)));
    let progress = kept(&first.apply(Event::Tick)).unwrap();
    let mut second = Bench::new();
    second.state = second.state.resuming(vec![progress]);
    let _ = second.apply(Event::BatchDecoded(Bench::dip(10)));
    assert!(samples(&second, "skipped").abs() < 0.5);
    assert!(
        second
            .metric(&catalogue::TIME_STEPS, &["north", "restart"])
            .abs()
            < 0.5
    );
}

#[test]
fn steps_of_time_are_counted_by_kind_with_what_they_passed_over() {
    let mut bench = Bench::new();
    for shift_s in [0, 100, 20] {
        let _ = bench.apply(Event::BatchDecoded(Bench::dip(shift_s)));
    }
    let mut faster = Bench::dip(30);
    faster.rate_fps = 25.0;
    let _ = bench.apply(Event::BatchDecoded(faster));
    let steps = |kind: &str| bench.metric(&catalogue::TIME_STEPS, &["north", kind]);
    let counted = ["forward", "backward", "rate", "grid", "restart"].map(steps);
    assert_eq!(
        counted.map(|n| format!("{n:.0}")),
        ["1", "1", "1", "0", "0"]
    );
    assert!((samples(&bench, "skipped") - 90.0 * 50.0).abs() < 0.5);
}

#[test]
fn a_jump_between_recordings_is_one_step_and_not_the_months_between() {
    const DAY_S: i64 = 86_400;
    let steps = |bench: &Bench| {
        ["forward", "jump"].map(|kind| bench.metric(&catalogue::TIME_STEPS, &["north", kind]))
    };
    let mut replayed = Bench::new();
    for shift_s in [0, 60 * DAY_S, 120 * DAY_S] {
        let _ = replayed.apply(Event::BatchDecoded(Bench::dip(shift_s)));
        replayed.pass(20 * SECOND_NS);
        let _ = replayed.apply(Event::Tick);
    }
    assert_eq!(steps(&replayed).map(|n| format!("{n:.0}")), ["0", "2"]);
    assert!(samples(&replayed, "skipped").abs() < 0.5);

    // A source that was away for as long as its stamps say has left every instant out.
    let mut away = Bench::new();
    let _ = away.apply(Event::BatchDecoded(Bench::dip(0)));
    away.pass(DAY_S * SECOND_NS);
    let _ = away.apply(Event::Tick);
    let _ = away.apply(Event::BatchDecoded(Bench::dip(DAY_S)));
    assert_eq!(steps(&away).map(|n| format!("{n:.0}")), ["1", "0"]);
    let expected = (DAY_S - 10) as f64 * 50.0;
    assert!((samples(&away, "skipped") - expected).abs() < 0.5);
}

#[test]
fn silence_is_counted_with_what_it_leaves_missing() {
    let mut bench = Bench::new();
    let mut first = Bench::dip(0);
    first.quality[3] = Quality::DATA_INVALID;
    first.quality[4] = Quality::NOT_SYNCHRONISED;
    let _ = bench.apply(Event::BatchDecoded(first));
    // Half a second is missing before the next batch; less than the lag time has come behind it.
    let mut second = Bench::dip(10);
    second.start_ns += SECOND_NS / 2;
    for (_, values) in &mut second.channels {
        values.truncate(5);
    }
    second.quality.truncate(5);
    let _ = bench.apply(Event::BatchDecoded(second));
    bench.pass(10 * SECOND_NS);
    let _ = bench.apply(Event::Tick);
    assert!((bench.metric(&catalogue::SILENCES, &["north"]) - 1.0).abs() < 0.5);
    let counted =
        ["missing", "skipped", "invalid", "unsynchronised", "stale"].map(|o| samples(&bench, o));
    assert_eq!(
        counted.map(|n| format!("{n:.0}")),
        ["25", "0", "1", "1", "0"]
    );
}
