//! Sets of events that change when a diagnosis finds that they do not serve: an untouched event at the edge of a relay, one
//! that a model called adequate does not follow, and one that nothing explains.

use super::{
    SyntheticSite, options, plain, quoted_errors, windows, with_by_hand, write_a_weight_on_a_spring,
};
use loadmodeld::{
    diagnosis::{Status, diagnose},
    disturbance::Window,
    identification::{IdentificationOptions, identify},
    truth::{Effect, StudyShape, generate, study_site},
};

/// So many events of four seconds with little noise.
fn shape(effect: Effect, events: usize, noise: f64) -> StudyShape {
    StudyShape {
        effects: vec![effect],
        events,
        duration_s: 4.0,
        rate_fps: 60.0,
        noise,
        composition_spread: 5e-3,
        bad_samples: false,
        ..StudyShape::default()
    }
}

fn lowest_pu(window: &Window) -> f64 {
    let voltages = window.record.samples.iter().map(|sample| sample.voltage_pu);
    voltages.fold(f64::INFINITY, f64::min)
}

/// In the middle between the lowest voltages of an event and of the next milder one, pu.
fn above(made: &SyntheticSite, event: &str) -> f64 {
    let windows = windows(made);
    let own = lowest_pu(windows.iter().find(|window| window.id == event).unwrap());
    let milder = windows.iter().map(lowest_pu).filter(|lowest| *lowest > own);
    0.5 * (own + milder.fold(f64::INFINITY, f64::min))
}

#[test]
fn an_untouched_event_at_the_edge_of_a_relay_decides_and_another_is_quoted() {
    let effect = Effect::SelfDisconnection;
    let mut made = study_site(11, 1, &shape(effect, 10, 5e-4)).unwrap();
    let before = with_by_hand(&made, &[]).last.events;
    let edge = before.untouched.first().unwrap();
    made = with_relay_above(&made, edge);
    let found = with_by_hand(&made, &[effect.name()]);
    let after = &found.last.events;
    let told = (&before, after, &found.last.reasons);
    assert!(after.gate.contains(edge), "{told:?}");
    let instead: Vec<&String> = (after.untouched.iter())
        .filter(|event| !before.untouched.contains(event))
        .collect();
    assert_eq!(instead.len(), 1, "{told:?}");
    assert!(before.gate.contains(instead[0]), "{told:?}");
    let says =
        |reason: &String| reason.starts_with(edge.as_str()) && reason.contains(effect.name());
    assert!(found.last.reasons.iter().any(says), "{told:?}");
    // Every step is quoted on the same events.
    for step in &found.steps {
        let quoted = step.errors.untouched.as_ref().unwrap();
        let mut events = quoted.events.iter();
        assert!(events.all(|e| after.untouched.contains(&e.event)));
    }
    let errors = quoted_errors(&found);
    assert!(errors[1] < 0.5 * errors[0], "{errors:?}");
}

/// The truth with its relay between the lowest voltages of an event and of the next milder one.
fn with_relay_above(made: &SyntheticSite, event: &str) -> SyntheticSite {
    let mut truth = made.options.clone();
    let voltage = above(made, event);
    truth.effects[0]
        .set("threshold_pu", &voltage.to_string())
        .unwrap();
    generate(&truth, &mut |_| ()).unwrap()
}

#[test]
fn a_held_out_event_at_the_edge_of_a_relay_is_fitted_and_another_held_out() {
    let effect = Effect::SelfDisconnection;
    let made = study_site(11, 1, &shape(effect, 10, 5e-4)).unwrap();
    let identified = |made: &SyntheticSite, effects: &[&str]| {
        let names = effects.iter().map(|&name| name.to_owned());
        let structure: Vec<String> = plain().into_iter().chain(names).collect();
        let site = &made.options.site;
        let mut options = IdentificationOptions::default();
        options.search.explored_below_per_row = 0.0;
        identify(site, &windows(made), &structure, &options, &|| false)
            .unwrap()
            .set
    };
    // With the relay elsewhere the voltages are others, and so may be what is held out.
    let with_relay_at = |edge: &String| {
        let made = with_relay_above(&made, edge);
        let held_out = identified(&made, &[]).held_out_events;
        held_out
            .contains(edge)
            .then(|| (made, held_out, edge.clone()))
    };
    let held_out = identified(&made, &[]).held_out_events;
    let (made, before, edge) = held_out.iter().find_map(with_relay_at).unwrap();
    let after = identified(&made, &[effect.name()]);
    let told = (&before, &after.held_out_events, &after.notes);
    assert!(after.fitted_events.contains(&edge), "{told:?}");
    let came = (after.held_out_events.iter()).filter(|event| !before.contains(event));
    assert_eq!(came.count(), 1, "{told:?}");
    assert_eq!(before.len(), after.held_out_events.len(), "{told:?}");
    let says = |note: &String| note.starts_with(edge.as_str()) && note.contains(effect.name());
    assert!(after.notes.iter().any(says), "{told:?}");
    let errors = after.held_out.unwrap().error_to_noise;
    assert!(errors < 2.0, "{errors} {told:?}");
}

#[test]
fn an_untouched_event_that_contradicts_an_adequate_model_decides_and_another_is_quoted() {
    // It swings as none of the others.
    contradicts(write_a_weight_on_a_spring);
}

#[test]
fn a_composition_that_no_other_event_has_contradicts_an_adequate_model() {
    // Within what is assumed at first, and far from what the others show.
    let told = contradicts(|window| take_another_load(window, 0.95));
    assert!(told.contains("it would take a composition"), "{told}");
}

/// Why an untouched event decides after a change, where nothing is hidden.
fn contradicts(change: impl Fn(&mut Window)) -> String {
    let none_hidden = StudyShape {
        effects: Vec::new(),
        ..shape(Effect::SelfDisconnection, 10, 1e-3)
    };
    let made = study_site(11, 1, &none_hidden).unwrap();
    let (site, options) = (&made.options.site, options());
    let diagnosed = |windows: &[Window]| {
        diagnose(site, windows, &plain(), &options, &|_| (), &|| false).unwrap()
    };
    let mut windows = windows(&made);
    let before = diagnosed(&windows);
    let told = (&before.summary, &before.events, &before.reasons);
    assert_eq!(before.status, Status::Adequate, "{told:?}");
    let other = before.events.untouched.first().unwrap();
    let changed = windows.iter_mut().find(|window| window.id == *other);
    change(changed.unwrap());
    let after = diagnosed(&windows);
    let told = (&after.summary, &after.events, &after.reasons);
    assert!(!after.events.untouched.contains(other), "{told:?}");
    let instead = after.events.untouched.iter();
    let instead = instead.filter(|event| before.events.gate.contains(event));
    assert_eq!(instead.count(), 1, "{told:?}");
    let begins = format!("{other} is not followed by the model that follows the others");
    let reason = (after.reasons.iter()).find(|reason| reason.starts_with(&begins));
    reason.unwrap_or_else(|| panic!("{told:?}")).clone()
}

/// So much of what the load does is left, as if there were less of it beside what does not change.
fn take_another_load(window: &mut Window, share: f64) {
    let samples = &mut window.record.samples;
    let (active, reactive) = (samples[0].active_pu, samples[0].reactive_pu);
    for sample in samples {
        sample.active_pu = share * sample.active_pu + (1.0 - share) * active;
        sample.reactive_pu = share * sample.reactive_pu + (1.0 - share) * reactive;
    }
}

#[test]
fn an_event_that_nothing_explains_is_set_apart_where_the_others_are_explained() {
    // Swings of its own, as none of the others.
    let told = deepest_set_apart(write_a_weight_on_a_spring);
    assert!(
        told.contains("every effect of the catalogue leaves"),
        "{told}"
    );
}

#[test]
fn an_event_that_takes_another_load_is_set_apart_where_the_others_are_explained() {
    let told = deepest_set_apart(|window| take_another_load(window, 0.5));
    assert!(told.contains("composition"), "{told}");
}

/// Why the deepest of some events is set apart after a change, where all show the same effect, which is named.
fn deepest_set_apart(change: impl Fn(&mut Window)) -> String {
    let effect = Effect::ExponentialRecovery;
    let made = study_site(7, 0, &shape(effect, 6, 2e-4)).unwrap();
    let mut windows = windows(&made);
    let (site, options) = (&made.options.site, options());
    let by_depth = |a: &&mut Window, b: &&mut Window| lowest_pu(a).total_cmp(&lowest_pu(b));
    let deepest = windows.iter_mut().min_by(by_depth).unwrap();
    let event = deepest.id.clone();
    change(deepest);
    let found = diagnose(site, &windows, &plain(), &options, &|_| (), &|| false).unwrap();
    let told = (&found.summary, &found.reasons, &found.events);
    assert_eq!(found.status, Status::MissingEffect, "{told:?}");
    assert_eq!(
        found.answer_set.first().map(String::as_str),
        Some(effect.name()),
        "{told:?}"
    );
    let refused = &found.events.refused;
    assert!(refused.len() == 1 && refused[0].0 == event, "{told:?}");
    let begins = format!("{event} is set apart: ");
    let reason = (found.reasons.iter()).find(|reason| reason.starts_with(&begins));
    reason.unwrap_or_else(|| panic!("{told:?}")).clone()
}
