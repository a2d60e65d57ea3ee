//! Order of arrival, gaps, restarts, bad data.

use proptest::prelude::*;

use super::*;
use crate::measurement::{Quality, Sample};

const START_NS: i64 = 1_770_000_000_000_000_000;
const RATE_FPS: f64 = 50.0;
const PERIOD_NS: i64 = 20_000_000;

fn site() -> Site {
    Site {
        name: "here".to_owned(),
        s_base_mva: 100.0,
        v_base_kv: 110.0,
        nominal_hz: 50.0,
    }
}

fn concentrator() -> Concentrator {
    Concentrator::new(&site(), ConcentratorOptions::default())
}

/// `count` samples of some channels from grid point `first` on; every value tells where it belongs.
fn batch(stream: &str, channels: &[Channel], first: i64, count: usize) -> SampleBatch {
    let value =
        |channel: Channel, k: usize| first as f64 + k as f64 + f64::from(channel as u8) / 8.0;
    SampleBatch {
        site: "here".to_owned(),
        stream: stream.to_owned(),
        sequence: None,
        start_ns: START_NS + first * PERIOD_NS,
        rate_fps: RATE_FPS,
        channels: channels
            .iter()
            .map(|c| (*c, (0..count).map(|k| value(*c, k)).collect()))
            .collect(),
        quality: vec![Quality::GOOD; count],
    }
}

const REQUIRED: [Channel; 4] = [
    Channel::VoltagePu,
    Channel::FrequencyHz,
    Channel::ActivePu,
    Channel::ReactivePu,
];

fn whole(first: i64, count: usize) -> SampleBatch {
    batch("pmu", &Channel::ALL, first, count)
}

/// Pushes all, flushes, and returns the runs joined where they continue.
fn runs_of(concentrator: &mut Concentrator, batches: &[SampleBatch]) -> (Vec<Run>, PushReport) {
    let mut total = PushReport::default();
    let mut runs: Vec<Run> = Vec::new();
    let mut keep = |released: Vec<Run>| {
        for run in released {
            match runs.last_mut() {
                Some(last) if !run.restarted => last.samples.extend(run.samples),
                _ => runs.push(run),
            }
        }
    };
    for batch in batches {
        total += concentrator.push(batch);
        keep(concentrator.drain());
    }
    keep(concentrator.flush());
    (runs, total)
}

/// The samples with every bit of every value, so that NaN compares.
fn bits(runs: &[Run]) -> Vec<(i64, [u64; 6], u32)> {
    runs.iter()
        .flat_map(|run| &run.samples)
        .map(|s| {
            (
                s.time_ns,
                Channel::ALL.map(|c| s.value(c).to_bits()),
                s.quality.0,
            )
        })
        .collect()
}

fn indices(run: &Run) -> Vec<i64> {
    run.samples
        .iter()
        .map(|s: &Sample| (s.time_ns - START_NS) / PERIOD_NS)
        .collect()
}

#[test]
fn complete_samples_are_released_at_once_after_the_first_lag_time() {
    let mut concentrator = concentrator();
    concentrator.push(&whole(0, 50));
    assert!(concentrator.drain().is_empty());
    concentrator.push(&whole(50, 1));
    assert_eq!(concentrator.drain()[0].samples.len(), 51);
    concentrator.push(&whole(51, 1));
    let run = concentrator.drain().remove(0);
    assert!(!run.restarted);
    assert_eq!(indices(&run), [51]);
    assert_eq!(concentrator.pending(), 0);
}

#[test]
fn channels_of_two_streams_meet_in_one_sample() {
    let mut concentrator = concentrator();
    let voltage = [Channel::VoltagePu, Channel::FrequencyHz, Channel::AngleRad];
    let power = [Channel::ActivePu, Channel::ReactivePu];
    for k in 0..20 {
        concentrator.push(&batch("bus", &voltage, k * 10, 10));
        if k > 0 {
            concentrator.push(&batch("feeder", &power, (k - 1) * 10, 10));
        }
    }
    let run = concentrator.drain().remove(0);
    assert_eq!(run.samples.len(), 190, "the last 10 wait for the feeder");
    assert!(run.samples.iter().all(Sample::usable));
    assert_eq!((run.missing, run.incomplete), (0, 0));
}

#[test]
fn a_site_without_angle_and_negative_sequence_does_not_wait_for_them() {
    let mut concentrator = concentrator();
    concentrator.push(&batch("pmu", &REQUIRED, 0, 60));
    let run = concentrator.drain().remove(0);
    assert_eq!(run.samples.len(), 60);
    assert!(run.samples[0].usable() && run.samples[0].angle_rad.is_nan());
}

#[test]
fn what_never_comes_is_released_as_missing_when_the_lag_time_is_over() {
    let mut concentrator = concentrator();
    concentrator.push(&whole(0, 60));
    assert_eq!(concentrator.drain()[0].samples.len(), 60);
    concentrator.push(&whole(63, 48));
    assert!(
        concentrator.drain().is_empty(),
        "60 to 62 may still come: 110 is newer than 60 by exactly the lag time"
    );
    concentrator.push(&whole(111, 1));
    let run = concentrator.drain().remove(0);
    assert_eq!(
        run.samples[0].quality,
        Quality::MISSING,
        "60 is overdue, 61 is not"
    );
    assert_eq!(run.samples.len(), 1);
    let late = concentrator.push(&whole(60, 2));
    assert_eq!((late.late, late.accepted, late.out_of_order), (1, 1, 1));
}

#[test]
fn what_comes_twice_is_a_duplicate_before_and_after_its_release() {
    let mut concentrator = concentrator();
    concentrator.push(&whole(0, 40));
    assert_eq!(concentrator.push(&whole(30, 10)).duplicate, 10);
    concentrator.push(&whole(40, 40));
    assert_eq!(concentrator.drain()[0].samples.len(), 80);
    let again = concentrator.push(&whole(70, 10));
    assert_eq!((again.duplicate, again.late, again.accepted), (10, 0, 0));
}

#[test]
fn a_usable_value_replaces_an_unusable_one_but_not_the_other_way_round() {
    let mut stale = whole(0, 10);
    stale.quality = vec![Quality::STALE; 10];
    for order in [[stale.clone(), whole(0, 10)], [whole(0, 10), stale]] {
        let (runs, _) = runs_of(&mut concentrator(), &order);
        assert!(runs[0].samples.iter().all(Sample::usable));
    }
}

#[test]
fn bad_samples_are_kept_with_their_flags_and_counted() {
    let mut batch = whole(0, 4);
    batch.quality[1] = Quality::DATA_INVALID;
    batch.quality[2] = Quality::NOT_SYNCHRONISED;
    batch.channels[0].1[3] = f64::INFINITY;
    let (runs, total) = runs_of(&mut concentrator(), &[batch]);
    assert_eq!(total.bad_quality, 2);
    let usable: Vec<_> = runs[0].samples.iter().map(Sample::usable).collect();
    assert_eq!(usable, [true, false, true, false]);
    assert_eq!(runs[0].samples[3].quality, Quality::NOT_FINITE);
    assert!(runs[0].samples[3].voltage_pu.is_nan());
}

#[test]
fn a_long_gap_and_a_step_back_start_a_new_grid() {
    let batches = [whole(0, 10), whole(1000, 10), whole(200, 10)];
    let (runs, total) = runs_of(&mut concentrator(), &batches);
    assert_eq!(runs.len(), 3);
    assert!(runs.iter().all(|run| run.restarted));
    assert_eq!(indices(&runs[2])[0], 200);
    assert_eq!(total.restarts, 2);
    assert_eq!(total.restart, Some(Restart::Backward { gap_s: 16.18 }));
}

#[test]
fn a_stream_far_away_in_time_does_not_disturb_the_others() {
    let mut concentrator = concentrator();
    let hour = 3600 * 50;
    let mut total = PushReport::default();
    for k in 0..100 {
        total += concentrator.push(&whole(k * 10, 10));
        total += concentrator.push(&batch("astray", &REQUIRED, hour + k * 10, 10));
    }
    assert_eq!((total.restarts, total.off_grid), (0, 1000));
    assert_eq!(concentrator.drain()[0].samples.len(), 1000);
}

#[test]
fn when_all_streams_have_moved_in_time_the_grid_follows() {
    let mut concentrator = concentrator();
    let power = [Channel::ActivePu, Channel::ReactivePu];
    let mut total = PushReport::default();
    for k in (0..10).chain(1000..1020) {
        total += concentrator.push(&batch("bus", &Channel::ALL[..3], k * 10, 10));
        total += concentrator.push(&batch("feeder", &power, k * 10, 10));
    }
    assert_eq!(total.restarts, 1);
    assert!(total.off_grid <= 100, "{total:?}");
    let runs = concentrator.flush();
    assert_eq!(runs.len(), 2);
    assert!(runs[1].samples.iter().all(Sample::usable));
}

#[test]
fn a_stream_that_changes_its_rate_starts_a_new_grid_unless_the_rate_is_configured() {
    let mut faster = whole(10, 10);
    faster.rate_fps = 100.0;
    let batches = [whole(0, 10), faster];
    let (runs, total) = runs_of(&mut concentrator(), &batches);
    assert_eq!(
        total.restart,
        Some(Restart::OffGrid { rate_fps: 100.0 }),
        "{total:?}"
    );
    assert!((runs[1].rate_fps - 100.0).abs() < 1e-9);
    let options = ConcentratorOptions {
        rate_fps: Some(RATE_FPS),
        ..ConcentratorOptions::default()
    };
    let (runs, total) = runs_of(&mut Concentrator::new(&site(), options), &batches);
    assert_eq!((runs.len(), total.off_grid, total.restarts), (1, 10, 0));
}

#[test]
fn a_drifting_clock_loses_a_second_and_starts_a_new_grid() {
    let mut concentrator = concentrator();
    let mut total = PushReport::default();
    // 400 ppm fast: a quarter of a period is reached after 12.5 s.
    for k in 0..100 {
        let mut drifting = whole(k * 10, 10);
        drifting.start_ns += k * 10 * PERIOD_NS / 2500;
        total += concentrator.push(&drifting);
    }
    assert_eq!(total.restarts, 1);
    assert!((40..=60).contains(&total.off_grid), "{total:?}");
    assert_eq!(total.accepted + total.off_grid, 1000);
}

#[test]
fn lost_batches_are_counted_from_the_running_number() {
    let numbered = |number: u64| SampleBatch {
        sequence: Some(number),
        ..whole(i64::try_from(number).unwrap() * 10, 10)
    };
    let batches = [0, 1, 4, 3].map(numbered);
    let (_, total) = runs_of(&mut concentrator(), &batches);
    assert_eq!((total.lost_batches, total.found_batches), (2, 1));
}

#[test]
fn a_batch_that_was_waited_for_is_late_however_late_it_comes() {
    let numbered = |number: u64| SampleBatch {
        sequence: Some(number),
        ..whole(i64::try_from(number).unwrap() * 10, 10)
    };
    let batches = (0..=1200)
        .filter(|k| *k != 1000)
        .chain([1000, 1201])
        .map(numbered);
    let (_, total) = runs_of(&mut concentrator(), &batches.collect::<Vec<_>>());
    assert_eq!(
        (total.restarts, total.late, total.found_batches),
        (0, 10, 1)
    );
    // One that was not is another recording.
    let batches = (0..=1200).chain([1000]).map(numbered).collect::<Vec<_>>();
    let (_, total) = runs_of(&mut concentrator(), &batches);
    assert_eq!((total.restarts, total.late), (1, 0));
}

#[test]
fn malformed_batches_are_refused_with_the_reason() {
    let mut concentrator = concentrator();
    let refusal = |concentrator: &mut Concentrator, change: &dyn Fn(&mut SampleBatch)| {
        let mut batch = whole(0, 3);
        change(&mut batch);
        let report = concentrator.push(&batch);
        assert_eq!((report.accepted, report.refused_batches), (0, 1));
        report.refusal.unwrap().label()
    };
    let other = refusal(&mut concentrator, &|b| b.site = "there".to_owned());
    assert_eq!(other, "other_site");
    let short = refusal(&mut concentrator, &|b| b.channels[1].1.truncate(2));
    assert_eq!(short, "length_mismatch");
    let empty = refusal(&mut concentrator, &|b| b.quality.clear());
    assert_eq!(empty, "empty");
    let rate = refusal(&mut concentrator, &|b| b.rate_fps = f64::NAN);
    assert_eq!(rate, "bad_rate");
    let time = refusal(&mut concentrator, &|b| b.start_ns = i64::MAX);
    assert_eq!(time, "bad_time");
    assert!(concentrator.flush().is_empty());
}

#[test]
fn what_nobody_fetches_is_bounded_and_counted() {
    let mut concentrator = concentrator();
    let mut total = PushReport::default();
    for k in 0..110 {
        total += concentrator.push(&whole(k * 1000, 1000));
    }
    assert_eq!(total.accepted, OUTBOX_SAMPLES_MAX as u64);
    assert_eq!(total.overflow, 10_000);
}

#[test]
fn no_settings_and_no_batch_can_make_it_panic() {
    let options = ConcentratorOptions {
        lag_s: f64::NAN,
        gap_restart_s: -1.0,
        rate_fps: Some(0.0),
        expected: vec![Channel::AngleRad],
        grid_tolerance_share: f64::INFINITY,
        off_grid_restart_s: f64::NEG_INFINITY,
    };
    let (runs, _) = runs_of(&mut Concentrator::new(&site(), options), &[whole(0, 200)]);
    assert_eq!(runs[0].samples.len(), 200);
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 48,
        rng_seed: prop::test_runner::RngSeed::Fixed(20_261_121),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// Batches of two streams of 0.1 s, each delayed by up to 0.7 s and some delivered twice:
    /// within the lag time of 1 s, so nothing may differ from the orderly delivery.
    #[test]
    fn order_and_repetition_within_the_lag_time_change_no_bit(
        delays in prop::collection::vec((0..7_u32, prop::option::of(0..7_u32)), 80),
        lost in prop::collection::vec(prop::bool::weighted(0.1), 80),
    ) {
        let voltage = &Channel::ALL[..3];
        let power = &Channel::ALL[3..];
        let orderly: Vec<SampleBatch> = (0_i64..)
            .zip(&lost)
            .filter(|(_, lost)| !**lost)
            .map(|(k, _)| {
                let first = k / 2 * 5;
                if k % 2 == 0 {
                    batch("bus", voltage, first, 5)
                } else {
                    batch("feeder", power, first, 5)
                }
            })
            .collect();
        let mut arrivals: Vec<(i64, usize)> = Vec::new();
        for (k, batch) in orderly.iter().enumerate() {
            let (delay, again) = delays[k];
            arrivals.push((batch.start_ns + i64::from(delay) * 5 * PERIOD_NS, k));
            if let Some(delay) = again {
                arrivals.push((batch.start_ns + i64::from(delay) * 5 * PERIOD_NS, k));
            }
        }
        arrivals.sort_unstable();
        let shuffled: Vec<SampleBatch> =
            arrivals.iter().map(|(_, k)| orderly[*k].clone()).collect();

        let (expected, _) = runs_of(&mut concentrator(), &orderly);
        let (got, total) = runs_of(&mut concentrator(), &shuffled);
        // The first instants may be missing altogether when their batches are lost.
        prop_assert_eq!(bits(&got), bits(&expected));
        prop_assert_eq!(total.late, 0);
        prop_assert_eq!(total.restarts, 0);
        prop_assert_eq!(total.accepted + total.duplicate, total.received);
    }
}
