//! Identification from end to end on sites whose truth is known: made by the truth simulator, which
//! shares no code with the estimator, and the bundled site of an independent simulator.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a test helper that fails should fail the test"
)]

use loadmodeld::{
    adapters::{bundled, recordings::site_folder, wire::v1::encode_parameter_set},
    disturbance::{Closing, Trigger, Window},
    identification::{
        Identification, IdentificationError, IdentificationOptions, VerdictStatus, compare,
        edge_timing::align,
        fit_aligned, identify,
        intake::{PreparedEvent, prepare},
        joint_problem::PAPER_SHARES,
    },
    measurement::{Quality, Record, Sample, Site},
    truth::{self, EventKind, StudyShape, study_site},
};

fn structure() -> Vec<String> {
    vec!["zip".to_owned(), "induction_motor".to_owned()]
}

fn site() -> Site {
    Site {
        name: "test".to_owned(),
        s_base_mva: 200.0,
        v_base_kv: 23.0,
        nominal_hz: 60.0,
    }
}

fn windows_of(records: &[Record], site: &Site) -> Vec<Window> {
    records
        .iter()
        .zip(1..)
        .map(|(record, number)| Window {
            id: format!("event_{number:02}"),
            ..site_folder::window(site, record)
        })
        .collect()
}

fn bundled_windows(name: &str) -> (Site, Vec<Window>) {
    let parent = tempfile::tempdir().unwrap();
    let bundle = bundled::sites()
        .into_iter()
        .find(|s| s.name == name)
        .unwrap();
    let folder = site_folder::load_events(&bundle.extract_to(parent.path()).unwrap()).unwrap();
    let records: Vec<Record> = folder.events.iter().map(|e| e.record.clone()).collect();
    let windows = windows_of(&records, &folder.site);
    (folder.site, windows)
}

fn run(site: &Site, windows: &[Window]) -> Result<Identification, IdentificationError> {
    identify(
        site,
        windows,
        &structure(),
        &IdentificationOptions::default(),
        &|| false,
    )
}

fn parameter(found: &Identification, name: &str) -> f64 {
    found
        .set
        .parameters
        .iter()
        .chain(&found.set.derived)
        .find(|p| p.name == name)
        .unwrap()
        .value
}

#[test]
fn the_parameters_of_a_noiseless_unfiltered_site_are_recovered() {
    let mut options = truth::SiteOptions::new(site(), 11);
    options.events = 5;
    options.noise = 0.0;
    options.filter_cycles = 0.0;
    options.level_spread = 0.0;
    options.composition_spread = 0.0;
    options.bad_samples = false;
    let made = truth::generate(&options, &mut |_| ()).unwrap();
    let found = run(
        &made.options.site,
        &windows_of(&made.records, &made.options.site),
    )
    .unwrap();
    let held_out = found.set.held_out.as_ref().unwrap();
    let told = format!("{:#?}", found.set.parameters);
    assert_eq!(
        found.set.verdict.status,
        VerdictStatus::Pass,
        "{:?}",
        found.set.verdict.reasons
    );
    assert!(
        held_out.eps_p_percent < 0.1,
        "eps_P held out {}",
        held_out.eps_p_percent
    );
    let kpm = parameter(&found, "Kpm");
    // The motor share of the truth's base case; 5 %: cubic reconstruction between 60 samples/s.
    assert!(
        (kpm - options.motor_share).abs() < 0.05 * options.motor_share,
        "{told}"
    );
}

#[test]
fn a_site_of_an_independent_simulator_passes_and_says_what_is_not_determined() {
    let (site, windows) = bundled_windows("site-02");
    let found = run(&site, &windows).unwrap();
    let held_out = found.set.held_out.as_ref().unwrap();
    assert_eq!(
        found.set.verdict.status,
        VerdictStatus::Pass,
        "{:?}",
        found.set.verdict.reasons
    );
    // Measured 1.2; the noise floor would be 1.
    assert!(
        held_out.error_to_noise_away_from_edges < 1.5,
        "{held_out:#?}"
    );
    // The simulator's motor share is 0.45.
    assert!((parameter(&found, "Kpm") - 0.45).abs() < 0.045);
    for p in &found.set.parameters {
        if let Some((low, high)) = p.interval {
            assert!(!p.identifiable && p.standard_error.is_none());
            assert!(
                low <= p.value && p.value <= high,
                "{} outside its valley",
                p.name
            );
        }
    }
    let curves = compare(&found.set, &windows, &IdentificationOptions::default()).unwrap();
    let event = &curves[0];
    let used = event.errors.event_eps_p_percent;
    assert!(used < 1.0 && event.active_model_pu.len() == event.time_s.len());
}

#[test]
fn a_stored_set_follows_the_reactive_power_of_the_event_that_it_is_compared_with() {
    let (site, windows) = bundled_windows("site-02");
    let found = run(&site, &windows).unwrap();
    let steeper = 0.5;
    let mut changed = found.set.clone();
    let slope = (changed.derived.iter_mut()).find(|d| d.name == "d_z_by_Q0_over_P0");
    slope.unwrap().value += steeper;
    let options = IdentificationOptions::default();
    let [as_fitted, as_changed] =
        [&found.set, &changed].map(|set| compare(set, &windows, &options).unwrap());
    let usual = parameter(&found, "Q0_over_P0");
    let mut shown = 0;
    for ((one, other), window) in as_fitted.iter().zip(&as_changed).zip(&windows) {
        let event = prepare(window, &options.intake).unwrap();
        assert_eq!(event.id, one.event);
        // Where P and Q tell more about the instants of jumps, each set moves them for itself.
        if event.instants_open() {
            continue;
        }
        let more = steeper * (event.q0_pu - usual * event.p0_pu);
        for k in 0..one.time_s.len() {
            let v = one.voltage_pu[k] / event.v0_pu;
            if one.near_edge[k] || !v.is_finite() {
                continue;
            }
            let expected = more * (v * v - 1.0);
            let found = other.reactive_model_pu[k] - one.reactive_model_pu[k];
            // Models see the voltage between samples, a fit of it, not the noisy samples themselves.
            let tolerance = 0.01 * more.abs() + 0.05 * expected.abs();
            assert!((found - expected).abs() <= tolerance, "{found} {expected}");
            shown += usize::from(expected.abs() > 2.0 * tolerance);
        }
    }
    assert!(shown > 100, "{shown} samples show the slope");
}

#[test]
fn the_papers_box_holds_for_the_shares_of_static_power() {
    let (site, windows) = bundled_windows("site-02");
    let mut options = IdentificationOptions::default();
    options.problem.static_shares = Some(PAPER_SHARES);
    let found = identify(&site, &windows[..4], &structure(), &options, &|| false).unwrap();
    let told = format!("{:#?}", found.set.parameters);
    for name in ["Pz", "Pp"] {
        let share = parameter(&found, name);
        assert!((0.1 - 1e-6..=0.9 + 1e-6).contains(&share), "{name}: {told}");
    }
    assert!(parameter(&found, "Kpm") >= 0.1, "{told}");
}

#[test]
fn the_same_windows_give_the_same_bytes_in_any_order_and_on_any_thread() {
    let (site, mut windows) = bundled_windows("site-02");
    windows.truncate(4);
    let bytes =
        |windows: &[Window]| encode_parameter_set(&run(&site, windows).unwrap().set).unwrap();
    let first = bytes(&windows);
    windows.reverse();
    let threads: Vec<String> = std::thread::scope(|scope| {
        let jobs: Vec<_> = (0..3).map(|_| scope.spawn(|| bytes(&windows))).collect();
        jobs.into_iter().map(|job| job.join().unwrap()).collect()
    });
    assert!(threads.iter().all(|t| *t == first));
}

fn record(samples: usize, value: impl Fn(usize) -> Sample) -> Window {
    let record = Record {
        start_ns: 0,
        rate_fps: 60.0,
        nominal_hz: 60.0,
        samples: (0..samples).map(value).collect(),
    };
    Window {
        id: "absurd".to_owned(),
        site: "test".to_owned(),
        onset: samples / 5,
        record,
        triggers: vec![Trigger::Recording],
        closing: Closing::RecordingEnded,
    }
}

fn sample(k: usize, voltage_pu: f64, active_pu: f64, reactive_pu: f64) -> Sample {
    Sample {
        time_ns: i64::try_from(k).unwrap() * 16_666_667,
        voltage_pu,
        angle_rad: 0.0,
        frequency_hz: 60.0,
        active_pu,
        reactive_pu,
        negative_sequence_ratio: f64::NAN,
        quality: Quality::GOOD,
    }
}

/// A dip of 20 % between samples 60 and 66.
fn dip(k: usize) -> f64 {
    if (60..66).contains(&k) { 0.8 } else { 1.0 }
}

#[test]
fn absurd_windows_are_refused_with_the_reason() {
    let noise = |k: usize| f64::from(u32::try_from(k * 7919 % 101).unwrap()) / 50.0 - 1.0;
    let cases = [
        (
            "constant voltage",
            record(300, |k| sample(k, 1.0, 1.0, 0.3)),
            "nothing to learn",
        ),
        (
            "three samples",
            record(3, |k| sample(k, dip(k), 1.0, 0.3)),
            "3 usable samples",
        ),
        (
            "zeros",
            record(300, |k| sample(k, 0.0, 0.0, 0.0)),
            "voltage before the event is 0",
        ),
        (
            "no power",
            record(300, |k| sample(k, dip(k), 0.0, 0.0)),
            "not a load",
        ),
        (
            "generation",
            record(300, |k| sample(k, dip(k), -0.5 * dip(k), 0.1)),
            "not a load",
        ),
        (
            "noise",
            record(300, |k| sample(k, dip(k), 0.2 + noise(k), 0.1)),
            "not a load",
        ),
        (
            "bad samples",
            record(300, |k| Sample {
                quality: Quality::DATA_INVALID,
                ..sample(k, 1.0, 1.0, 0.3)
            }),
            "0 usable samples",
        ),
        (
            "nan",
            record(300, |k| sample(k, f64::NAN, 1.0, 0.3)),
            "0 usable samples",
        ),
    ];
    for (name, window, expected) in cases {
        let error = run(&site(), &[window]).unwrap_err();
        assert!(
            matches!(error, IdentificationError::NoUsableEvent { .. }),
            "{name}: {error}"
        );
        assert!(error.to_string().contains(expected), "{name}: {error}");
    }
}

#[test]
fn a_fit_with_every_unknown_on_a_bound_is_reported_and_determines_nothing() {
    // This event hides an effect the model has not: it drives the unknowns onto their bounds.
    let (site, windows) = bundled_windows("demo");
    let found = run(&site, &windows[2..3]).unwrap();
    assert_eq!(found.set.verdict.status, VerdictStatus::CannotJudge);
    assert!(found.set.parameters.iter().all(|p| p.value.is_finite()));
    assert!(!found.solutions.is_empty());
}

#[test]
fn events_that_nothing_describes_or_that_do_not_tell_motors_apart_are_not_searched_for_long() {
    let (site, windows) = bundled_windows("demo");
    let found = run(&site, &windows).unwrap();
    let notes = &found.set.notes;
    assert!(
        notes.iter().any(|n| n.contains("no solution describes")),
        "{notes:?}"
    );
    // Four in five of them are those of one scan of 9408 cells.
    assert!(found.cost.simulations < 120_000, "{:?}", found.cost);
    // Constant power, exactly: the least share of any motor that hardly moves leaves next to nothing.
    let shallow = |k: usize| 1.0 - 0.2 * (1.0 - dip(k));
    let constant = record(600, |k| sample(k, shallow(k), 0.9, 0.3));
    let found = run(&site, &[constant]).unwrap();
    assert!(found.cost.simulations < 10_000, "{:?}", found.cost);
    let notes = &found.set.notes;
    assert!(
        notes.iter().any(|n| n.contains("tell motors apart")),
        "{notes:?}"
    );
}

#[test]
fn an_event_that_no_start_describes_is_not_explored_where_that_is_asked() {
    let (site, windows) = bundled_windows("demo");
    let mut options = IdentificationOptions::default();
    options.search.explored_below_per_row = 100.0;
    let of =
        |windows: &[Window]| identify(&site, windows, &structure(), &options, &|| false).unwrap();
    let note = "nothing else was explored";
    let told = |found: &Identification| found.set.notes.iter().any(|n| n.contains(note));
    // Half of the load leaves in the first event; the last is mild.
    let undescribed = of(&windows[..1]);
    assert!(told(&undescribed), "{:?}", undescribed.set.notes);
    assert!(undescribed.directions.is_empty() && undescribed.cost.simulations < 10_000);
    let described = of(&windows[7..8]);
    assert!(!told(&described) && !described.directions.is_empty());
}

#[test]
fn a_load_without_reactive_power_is_fitted() {
    let window = record(600, |k| sample(k, dip(k), dip(k) * dip(k), 0.0));
    // Without noise and without a motor every motor of the least share fits: the search would use up
    // its whole budget, which is minutes in an unoptimised build.
    let mut options = IdentificationOptions::default();
    options.search.trust_tech.evaluations_max = 300;
    let found = identify(&site(), &[window], &structure(), &options, &|| false).unwrap();
    assert_eq!(found.set.verdict.status, VerdictStatus::CannotJudge);
    assert!(
        found.set.fit.eps_p_percent < 1.0,
        "{}",
        found.set.fit.eps_p_percent
    );
}

#[test]
fn an_unknown_part_of_a_structure_is_named() {
    let parts = ["zip".to_owned(), "warp_drive".to_owned()];
    let error = identify(
        &site(),
        &[],
        &parts,
        &IdentificationOptions::default(),
        &|| false,
    )
    .unwrap_err();
    assert!(error.to_string().contains("warp_drive"), "{error}");
}

#[test]
fn a_cancelled_fit_says_so() {
    let (site, windows) = bundled_windows("site-02");
    let options = IdentificationOptions::default();
    let error = identify(&site, &windows[..2], &structure(), &options, &|| true).unwrap_err();
    assert_eq!(error, IdentificationError::Cancelled);
}

#[test]
fn power_tells_of_instants_what_the_one_voltage_that_holds_a_jump_leaves_open() {
    // 30 frames/s behind a window of two cycles: one sample, or parts of two, hold each jump.
    let shape = StudyShape {
        effects: Vec::new(),
        noise: 0.0005,
        rate_fps: 30.0,
        events: 8,
        composition_spread: 0.005,
        ..StudyShape::default()
    };
    let made = study_site(4242, 99_001, &shape).unwrap();
    let options = IdentificationOptions::default();
    let (mut events, mut instants) = (Vec::new(), Vec::new());
    for (record, truth) in made.records.iter().zip(&made.truth) {
        let window = site_folder::window(&made.options.site, record);
        let Ok(event) = prepare(&window, &options.intake) else {
            continue;
        };
        let plan = &truth.plan;
        let cleared = plan.onset_s + plan.cycles / made.options.site.nominal_hz;
        // Plain faults: inception and clearing.
        if plan.kind == EventKind::Fault && event.edges.len() == 2 {
            instants.push([plan.onset_s, cleared].map(|s| s * shape.rate_fps));
            events.push(event);
        }
    }
    assert!(events.len() >= 3, "{} faults", events.len());
    let aligned =
        fit_aligned(events, options.problem, &options.search.sketch(), &|| false).unwrap();
    let events = aligned.events;
    let model = &aligned.found.solutions[0].model;
    let near_edges = |event: &PreparedEvent| -> f64 {
        let curves = model.simulate(event).unwrap();
        let square = |k: usize| {
            let active = (curves.active[k] - event.active[k]) / event.active_noise;
            let reactive = (curves.reactive[k] - event.reactive[k]) / event.reactive_noise;
            active.powi(2) + reactive.powi(2)
        };
        let near = (0..event.len()).filter(|&k| event.near_edge[k] && event.used[k]);
        near.map(square).sum()
    };
    let late = |event: &PreparedEvent, truth: &[f64; 2]| -> f64 {
        let pairs = event.edges.iter().zip(truth);
        pairs.map(|(edge, t)| (edge.position - t).abs()).sum()
    };
    let aligned: Vec<PreparedEvent> = events.iter().map(|e| align(model, e)).collect();
    let total = |events: &[PreparedEvent]| -> (f64, f64) {
        let left = events.iter().map(near_edges).sum();
        (
            left,
            events.iter().zip(&instants).map(|(e, t)| late(e, t)).sum(),
        )
    };
    let (before, after) = (total(&events), total(&aligned));
    assert!(after.0 < 0.5 * before.0, "{before:?}, {after:?}");
    assert!(after.1 < 0.75 * before.1, "{before:?}, {after:?}");
}
