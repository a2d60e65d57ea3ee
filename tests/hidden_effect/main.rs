//! Sites with a hidden effect: the plain model is rejected, the right effect is named, the error on
//! events that were not fitted falls; and nothing is named where nothing is hidden.
//!
//! One small site for each kind of effect, made by the truth simulator, and as candidates one effect of
//! each kind, so that an unoptimised build is through in time; how often the answers are right over
//! many sites and the whole catalogue is measured by `examples/diagnosis_study`
//! (`docs/diagnosis-rates.md`).
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test that cannot make its site should fail"
)]

mod beside_a_companion;
mod catalogue;
mod changed_sets;
mod closer;
mod longer_windows;
mod pairs;

use loadmodeld::{
    adapters::recordings::site_folder,
    diagnosis::{Change, Diagnosis, DiagnosisOptions, Improvement, Status, diagnose, improve},
    disturbance::{ScreeningOptions, Window, screen},
    load_model::{effects, user_effects::EffectFile},
    measurement::Site,
    truth::{Effect, StudyShape, SyntheticSite, study_site},
};

/// What a site has besides what is hidden; naming it is right.
const BESIDES: [&str; 1] = ["stator_resistance"];

/// One effect of each kind.
const CANDIDATES: [&str; 7] = [
    "stator_resistance",
    "second_motor",
    "static_frequency_dependence",
    "exponential_recovery",
    "self_disconnection",
    "feeder_impedance",
    "time_skew",
];

fn options() -> DiagnosisOptions {
    let all = effects::catalogue().iter().map(|e| e.declaration().name);
    let others = all.filter(|name| !CANDIDATES.contains(name));
    DiagnosisOptions {
        excluded: others.map(str::to_owned).collect(),
        refits_max: 4,
        ..DiagnosisOptions::default()
    }
}

fn site(effects: &[Effect], number: u64) -> (Site, Vec<Window>) {
    let shape = StudyShape {
        effects: effects.to_vec(),
        events: 5,
        duration_s: 5.0,
        rate_fps: 30.0,
        ..StudyShape::default()
    };
    let made = study_site(7, number, &shape).unwrap();
    (made.options.site.clone(), windows(&made))
}

fn windows(made: &SyntheticSite) -> Vec<Window> {
    let numbered = made.records.iter().zip(1..);
    let windows = numbered.map(|(record, number)| Window {
        id: format!("event_{number:02}"),
        ..site_folder::window(&made.options.site, record)
    });
    windows
        .filter(|window| screen(window, &ScreeningOptions::default()).usable())
        .collect()
}

fn plain() -> Vec<String> {
    ["zip", "induction_motor"].map(str::to_owned).to_vec()
}

fn diagnosed(effects: &[Effect], number: u64) -> Diagnosis {
    let (site, windows) = site(effects, number);
    diagnose(&site, &windows, &plain(), &options(), &|_| (), &|| false).unwrap()
}

/// Whatever diagnosis after diagnosis adds.
fn improved(effects: &[Effect], number: u64) -> Improvement {
    let (site, windows) = site(effects, number);
    improved_on(&site, &windows, &options())
}

fn improved_on(site: &Site, windows: &[Window], options: &DiagnosisOptions) -> Improvement {
    let change = Change::UntilAdequate;
    let found = improve(site, windows, &plain(), &change, options, &|_| (), &|| {
        false
    });
    found.unwrap()
}

/// Effects added by hand, nothing sought.
fn with_by_hand(made: &SyntheticSite, add: &[&str]) -> Improvement {
    let change = Change::ByHand {
        add: add.iter().map(|&name| name.to_owned()).collect(),
        remove: Vec::new(),
    };
    let all = effects::catalogue().iter();
    let options = DiagnosisOptions {
        excluded: all.map(|e| e.declaration().name.to_owned()).collect(),
        ..DiagnosisOptions::default()
    };
    let (site, windows) = (&made.options.site, windows(made));
    let found = improve(
        site,
        &windows,
        &plain(),
        &change,
        &options,
        &|_| (),
        &|| false,
    );
    found.unwrap()
}

/// Residual over noise, step by step.
fn quoted_errors(found: &Improvement) -> Vec<f64> {
    let steps = found.steps.iter();
    steps.map(|s| s.errors.quoted().error_to_noise).collect()
}

/// The effect is in the answer set, first or with its equals, and lowers the error at the gate.
fn named(effect: Effect, number: u64) {
    let found = diagnosed(&[effect], number);
    assert_eq!(
        found.status,
        Status::MissingEffect,
        "{}: {:?}",
        found.summary,
        found.reasons
    );
    assert!(
        found.answer_set.iter().any(|e| e == effect.name()),
        "{}: {:?}",
        effect.name(),
        found.answer_set
    );
    let candidate = found
        .candidates
        .iter()
        .find(|c| c.effect == effect.name())
        .unwrap();
    assert!(
        candidate.held_out_error_after < candidate.held_out_error_before,
        "{candidate:?}"
    );
}

#[test]
fn nothing_is_named_where_nothing_is_hidden() {
    let found = diagnosed(&[], 1);
    let others: Vec<_> = found
        .answer_set
        .iter()
        .filter(|e| !BESIDES.contains(&e.as_str()))
        .collect();
    assert!(others.is_empty(), "{others:?}: {:?}", found.reasons);
    assert_ne!(found.status, Status::UnknownEffect, "{:?}", found.reasons);
}

#[test]
fn a_load_that_leaves_for_a_while_now_and_then_is_unknown_however_small_the_misfit() {
    let (site, mut windows) = site(&[], 1);
    for window in windows.iter_mut().step_by(2) {
        let before = window.record.samples[0].active_pu;
        // From one second after the onset, for 0.3 s.
        for sample in &mut window.record.samples[window.onset + 30..window.onset + 39] {
            sample.active_pu -= 0.015 * before;
        }
    }
    let found = diagnose(&site, &windows, &plain(), &options(), &|_| (), &|| false).unwrap();
    assert_eq!(found.status, Status::UnknownEffect, "{:?}", found.reasons);
    let told = |event: &str| found.reasons.iter().any(|r| r.starts_with(event));
    assert!(told("event_01") && !told("event_02"), "{:?}", found.reasons);
}

#[test]
fn a_load_with_an_oscillation_of_its_own_is_unknown_and_its_form_is_told() {
    let (site, mut windows) = site(&[], 1);
    for window in &mut windows {
        write_a_weight_on_a_spring(window);
    }
    let found = diagnose(&site, &windows, &plain(), &options(), &|_| (), &|| false).unwrap();
    assert_eq!(found.status, Status::UnknownEffect, "{:?}", found.reasons);
    let form = found.unexplained.unwrap().general_form.unwrap();
    assert_eq!(form.name, "general_second_order", "{:?}", found.reasons);
    let value = |own: &str| {
        let of_name = form.parameters.iter().find(|p| p.name.ends_with(own));
        of_name.unwrap().value
    };
    assert!(
        (value("natural_frequency") / SPRING_RAD_S - 1.0).abs() < 0.1,
        "{form:?}"
    );
    assert!(
        (value("active_gain") / SPRING_GAIN - 1.0).abs() < 0.2,
        "{form:?}"
    );
    assert!(form.misfit_after < 0.2 * form.misfit_before, "{form:?}");
    assert!(EffectFile::parse(&form.effect_file).is_ok());
}

const SPRING_RAD_S: f64 = 7.0;
const SPRING_GAIN: f64 = 0.2;

/// P that follows the voltage like a weight on a spring, by small steps of its own.
fn write_a_weight_on_a_spring(window: &mut Window) {
    const PARTS: usize = 50;
    let h = 1.0 / (window.record.rate_fps * PARTS as f64);
    let first = window.record.samples[0];
    let (mut x, mut speed) = (1.0, 0.0);
    for sample in &mut window.record.samples {
        let v = sample.voltage_pu / first.voltage_pu;
        for _ in 0..PARTS {
            speed += h * SPRING_RAD_S * (SPRING_RAD_S * (v - x) - 0.3 * speed);
            x += h * speed;
        }
        sample.active_pu += SPRING_GAIN * (x - v) * first.active_pu;
    }
}

#[test]
fn a_load_that_disconnects_itself_is_named() {
    named(Effect::SelfDisconnection, 3);
}

#[test]
fn a_second_motor_is_named() {
    named(Effect::SecondMotor, 2);
}

#[test]
fn a_late_channel_is_blamed_on_the_instrument() {
    let found = diagnosed(&[Effect::TimeSkew], 2);
    assert_eq!(
        found.status,
        Status::InstrumentSuspect,
        "{}: {:?}",
        found.summary,
        found.reasons
    );
    assert_eq!(found.answer_set[0], "time_skew");
}

#[test]
fn adding_what_is_missing_lowers_the_error_step_by_step() {
    let found = improved(&[Effect::ExponentialRecovery], 2);
    let added: Vec<_> = found
        .steps
        .iter()
        .filter_map(|s| s.added.as_deref())
        .collect();
    assert!(
        added.contains(&"exponential_recovery"),
        "{added:?}: {:?}",
        found.last.reasons
    );
    let errors = quoted_errors(&found);
    assert!(errors[errors.len() - 1] < errors[0], "{errors:?}");
}

#[test]
fn two_hidden_effects_are_added_one_after_the_other() {
    // The dips that nothing disconnects in show the recovery, but after the load that is gone only.
    let effects = [Effect::ExponentialRecovery, Effect::SelfDisconnection];
    let found = improved(&effects, 7);
    let last = found.steps.last().unwrap();
    for effect in effects {
        assert!(
            last.structure.iter().any(|name| name == effect.name()),
            "{:?}: {:?}",
            last.structure,
            found.last.reasons
        );
    }
    let errors = quoted_errors(&found);
    // Down to what the noise leaves, from several times that.
    let (first, last) = (errors[0], errors[errors.len() - 1]);
    assert!(last < 1.1 && 3.0 * last < first, "{errors:?}");
}

#[test]
fn the_same_events_give_the_same_diagnosis_in_any_order_and_on_any_number_of_threads() {
    let (site, mut windows) = site(&[], 4);
    let options = options();
    let judge = |windows: &[Window]| {
        diagnose(&site, windows, &plain(), &options, &|_| (), &|| false).unwrap()
    };
    let forward = judge(&windows);
    windows.reverse();
    let one_thread = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let backward = one_thread.install(|| judge(&windows));
    assert_eq!(format!("{forward:?}"), format!("{backward:?}"));
}

#[test]
fn a_gating_event_in_which_the_plain_model_stalls_is_fitted_instead() {
    // Fitted without one of these events the plain motor is so near its pull-out that it has no steady
    // state at that event's lower voltage.
    let number = Effect::ALL
        .iter()
        .position(|e| *e == Effect::DischargeLighting);
    let shape = StudyShape {
        effects: vec![Effect::DischargeLighting],
        events: 12,
        noise: 0.0005,
        rate_fps: 60.0,
        composition_spread: 0.005,
        ..StudyShape::default()
    };
    let made = study_site(9019, 1000 * number.unwrap() as u64 + 1, &shape).unwrap();
    let windows = windows(&made);
    let found = with_by_hand(&made, &[]);
    assert_eq!(found.last.status, Status::UnknownEffect);
    let events = &found.last.events;
    let all = events.fit.len() + events.gate.len() + events.untouched.len();
    assert_eq!(all, windows.len(), "{events:?}");
    assert!(quoted_errors(&found)[0] > 10.0);
}

#[test]
fn events_that_cannot_be_judged_are_said_and_do_not_fail() {
    let (site, windows) = site(&[], 1);
    let options = options();
    let none = diagnose(&site, &[], &plain(), &options, &|_| (), &|| false).unwrap();
    assert_eq!(none.status, Status::CannotJudge);
    let one = diagnose(&site, &windows[..1], &plain(), &options, &|_| (), &|| false).unwrap();
    assert!(one.answer_set.is_empty() || one.status != Status::CannotJudge);
    let wrong = vec!["zip".to_owned(), "no_such_effect".to_owned()];
    assert!(diagnose(&site, &windows, &wrong, &options, &|_| (), &|| false).is_err());
}
