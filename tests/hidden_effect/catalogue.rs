//! One small site for every effect that shows in one: it is named first, among those that resemble it and one of each
//! other kind, and lowers the error of the held-out events.
//!
//! Not here: `low_voltage_conversion` and `frequency_tracking`, which leave less than the noise in sites of this size;
//! `phasor_window` is in `longer_windows`.

use super::{plain, windows};
use loadmodeld::{
    diagnosis::{Diagnosis, DiagnosisOptions, Status, diagnose},
    load_model::effects,
    truth::{Effect, StudyShape, SyntheticSite, generate, study_site},
};

/// One effect of each kind.
const KINDS: [&str; 6] = [
    "stator_resistance",
    "second_motor",
    "static_frequency_dependence",
    "exponential_recovery",
    "self_disconnection",
    "time_skew",
];

/// Five events of five seconds.
fn brief(rate_fps: f64) -> StudyShape {
    StudyShape {
        events: 5,
        duration_s: 5.0,
        rate_fps,
        noise: 5e-4,
        composition_spread: 5e-3,
        ..StudyShape::default()
    }
}

/// Events of twelve seconds, for what is slow.
fn lasting(events: usize) -> StudyShape {
    StudyShape {
        events,
        duration_s: 12.0,
        ..brief(30.0)
    }
}

fn is_named(effect: Effect, number: u64, shape: &StudyShape) {
    let shape = StudyShape {
        effects: vec![effect],
        ..shape.clone()
    };
    is_named_at(effect, &study_site(7, number, &shape).unwrap());
}

/// The diagnosis of a site, which names the effect first.
fn is_named_at(effect: Effect, made: &SyntheticSite) -> Diagnosis {
    let site = &made.options.site;
    let windows = windows(made);
    let resembles = effects::find(effect.name())
        .unwrap()
        .declaration()
        .resembles;
    let is_tried =
        |name: &str| name == effect.name() || resembles.contains(&name) || KINDS.contains(&name);
    let all = effects::catalogue().iter().map(|e| e.declaration().name);
    let options = DiagnosisOptions {
        excluded: all
            .filter(|name| !is_tried(name))
            .map(str::to_owned)
            .collect(),
        refits_max: 4,
        ..DiagnosisOptions::default()
    };
    let found = diagnose(site, &windows, &plain(), &options, &|_| (), &|| false).unwrap();
    let told = (&found.summary, &found.reasons, &found.answer_set);
    let claims = matches!(
        found.status,
        Status::MissingEffect | Status::InstrumentSuspect
    );
    assert!(claims, "{told:?}");
    let first = found.answer_set.first().map(String::as_str);
    assert_eq!(first, Some(effect.name()), "{told:?}");
    let candidate = (found.candidates.iter()).find(|c| c.effect == effect.name());
    let candidate = candidate.unwrap();
    assert!(
        candidate.held_out_error_after < candidate.held_out_error_before,
        "{candidate:?}"
    );
    found
}

#[test]
fn supplies_that_leave_at_the_second_dip() {
    let effect = Effect::SelfDisconnection;
    let shape = StudyShape {
        effects: vec![effect],
        ..brief(60.0)
    };
    let mut options = study_site(7, 0, &shape).unwrap().options;
    options.effects[0].set("dips", "2").unwrap();
    let found = is_named_at(effect, &generate(&options, &mut |_| ()).unwrap());
    let candidate = (found.candidates.iter()).find(|c| c.effect == effect.name());
    let estimates = &candidate.unwrap().parameters;
    let dips = estimates
        .iter()
        .find(|p| p.name == "self_disconnection.dips");
    let dips = dips.unwrap();
    assert!(
        (dips.value - 2.0).abs() < 1e-15 && dips.identifiable,
        "{dips:?}"
    );
}

/// Next to nothing shows of the saturation of ordinary motors: these are at it already at normal voltage.
#[test]
fn motors_that_saturate() {
    let effect = Effect::Saturation;
    let shape = StudyShape {
        effects: vec![effect],
        events: 6,
        noise: 1e-4,
        ..brief(60.0)
    };
    let mut options = study_site(7, 0, &shape).unwrap().options;
    for (parameter, value) in [("at_1_0", "1.5"), ("at_1_2", "5")] {
        options.effects[0].set(parameter, value).unwrap();
    }
    is_named_at(effect, &generate(&options, &mut |_| ()).unwrap());
}

#[test]
fn the_resistance_of_a_stator() {
    is_named(Effect::StatorResistance, 1, &brief(60.0));
}

#[test]
fn motors_that_trip_and_come_back() {
    is_named(Effect::MotorUndervoltageTrip, 0, &lasting(5));
}

#[test]
fn electronics_that_drop_out() {
    is_named(Effect::ElectronicLoadDropout, 1, &brief(60.0));
}

#[test]
fn a_load_that_recovers() {
    is_named(Effect::ExponentialRecovery, 0, &lasting(5));
}

#[test]
fn generation_that_the_frequency_switches_off() {
    is_named(Effect::FrequencyTrip, 1, &lasting(6));
}

#[test]
fn generation_behind_the_meter() {
    is_named(Effect::DistributedGeneration, 1, &brief(30.0));
}

#[test]
fn a_feeder_before_the_load() {
    is_named(Effect::FeederImpedance, 2, &brief(30.0));
}

#[test]
fn rotors_with_two_cages() {
    is_named(Effect::DoubleCageRotor, 0, &brief(60.0));
}

#[test]
fn a_tap_changer() {
    is_named(Effect::TapChanger, 3, &lasting(5));
}

#[test]
fn air_conditioners_that_stall() {
    is_named(Effect::SinglePhaseAcStall, 1, &lasting(5));
}

#[test]
fn lamps_that_go_out() {
    is_named(Effect::DischargeLighting, 0, &brief(30.0));
}

#[test]
fn contactors_that_open() {
    is_named(Effect::ContactorDropout, 1, &brief(30.0));
}

#[test]
fn a_load_that_changes_by_itself() {
    is_named(Effect::LoadRamp, 0, &lasting(5));
}

#[test]
fn instruments_that_turn_the_phase() {
    is_named(Effect::RatioPhaseError, 0, &brief(60.0));
}

#[test]
fn a_load_that_depends_on_the_frequency() {
    is_named(Effect::StaticFrequencyDependence, 1, &lasting(12));
}

#[test]
fn drives_whose_torque_depends_on_the_speed() {
    is_named(Effect::SpeedDependentTorque, 0, &lasting(12));
}

#[test]
fn motors_at_another_frequency() {
    is_named(Effect::FrequencyScaledPower, 0, &lasting(12));
}
