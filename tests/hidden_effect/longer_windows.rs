//! Phasor windows longer than those of the standard: recognised in the voltages, blamed on the instrument, accounted for.

use super::{improved_on, plain, quoted_errors, windows};
use loadmodeld::{
    diagnosis::{
        Change, DiagnosisOptions, Improvement, ImprovementStep, Status, diagnose, improve,
    },
    identification::{WindowShape, intake::longer_window},
    load_model::effects,
    truth::{Effect, HiddenEffect, StudyShape, SyntheticSite, generate, study_site},
};

const WINDOW: &str = "phasor_window";

/// A site whose phasors are triangles over so many cycles, besides what else it hides.
fn made(cycles: &str, rate_fps: f64, besides: &[Effect]) -> SyntheticSite {
    let shape = StudyShape {
        events: 5,
        duration_s: 5.0,
        rate_fps,
        noise: 5e-4,
        composition_spread: 5e-3,
        effects: besides.to_vec(),
        ..StudyShape::default()
    };
    let mut options = study_site(7, 1, &shape).unwrap().options;
    let mut hidden = HiddenEffect::drawn(Effect::PhasorWindow, 1);
    hidden.set("cycles", cycles).unwrap();
    options.effects.push(hidden);
    generate(&options, &mut |_| ()).unwrap()
}

/// The candidates of the other tests, and the window.
fn options() -> DiagnosisOptions {
    let mut options = super::options();
    options.excluded.retain(|name| name != WINDOW);
    options
}

fn improved(made: &SyntheticSite) -> Improvement {
    improved_on(&made.options.site, &windows(made), &options())
}

#[test]
fn their_width_is_recognised() {
    for (cycles, rate_fps) in [("4", 60.0), ("6", 60.0), ("5", 120.0)] {
        let found = longer_window(&windows(&made(cycles, rate_fps, &[]))).unwrap();
        let wanted: f64 = cycles.parse().unwrap();
        assert!(
            (found.cycles() - wanted).abs() < 0.5 && found.shape == WindowShape::Triangle,
            "{found:?} for {cycles} at {rate_fps}"
        );
    }
}

#[test]
fn windows_of_the_standard_are_none() {
    for (cycles, rate_fps) in [("2", 60.0), ("2", 120.0), ("1", 60.0)] {
        let found = longer_window(&windows(&made(cycles, rate_fps, &[])));
        assert_eq!(found, None, "{cycles} at {rate_fps}");
    }
    assert_eq!(longer_window(&[]), None);
}

#[test]
fn the_instrument_is_blamed_and_no_effect_of_the_load() {
    let made = made("6", 60.0, &[]);
    let site = &made.options.site;
    let found = diagnose(
        site,
        &windows(&made),
        &plain(),
        &options(),
        &|_| (),
        &|| false,
    );
    let found = found.unwrap();
    assert_eq!(
        found.status,
        Status::InstrumentSuspect,
        "{:?}",
        found.reasons
    );
    assert_eq!(found.answer_set, [WINDOW]);
    assert!(
        found.summary.contains("nominal cycles"),
        "{}",
        found.summary
    );
    let done = improved(&made);
    let added: Vec<_> = (done.steps.iter())
        .filter_map(|s| s.added.as_deref())
        .collect();
    assert_eq!(added.first(), Some(&WINDOW), "{added:?}");
    let errors = quoted_errors(&done);
    assert!(errors.last() < errors.first(), "{errors:?}");
    let notes = &done.steps[1].set.notes;
    assert!(
        notes.iter().any(|n| n.contains("phasor window")),
        "{notes:?}"
    );
}

#[test]
fn taken_out_by_hand_events_are_seen_as_before() {
    let made = made("6", 60.0, &[]);
    let change = |add: &[&str], remove: &[&str]| Change::ByHand {
        add: add.iter().map(|&name| name.to_owned()).collect(),
        remove: remove.iter().map(|&name| name.to_owned()).collect(),
    };
    let all = effects::catalogue().iter();
    let options = DiagnosisOptions {
        excluded: (all.map(|e| e.declaration().name.to_owned()))
            .filter(|name| name != WINDOW)
            .collect(),
        ..DiagnosisOptions::default()
    };
    let changed = |structure: &[String], change: &Change| {
        let (site, windows) = (&made.options.site, windows(&made));
        let done = improve(
            site,
            &windows,
            structure,
            change,
            &options,
            &|_| (),
            &|| false,
        );
        let steps = done.unwrap().steps;
        assert_eq!(steps.len(), 2);
        steps
    };
    let added = changed(&plain(), &change(&[WINDOW], &[]));
    let removed = changed(&added[1].structure, &change(&[], &[WINDOW]));
    assert_eq!(removed[1].dropped, [WINDOW]);
    assert_eq!(removed[1].structure, added[0].structure);
    let accounted_for = |step: &ImprovementStep| {
        let notes = &step.set.notes;
        notes.iter().any(|note| note.contains("phasor window"))
    };
    let seen = [&added[0], &added[1], &removed[0], &removed[1]].map(accounted_for);
    assert_eq!(seen, [false, true, true, false]);
}

#[test]
fn what_the_load_hides_besides_is_found_behind_them() {
    let made = made("5", 60.0, &[Effect::SelfDisconnection]);
    let done = improved(&made);
    let added: Vec<_> = (done.steps.iter())
        .filter_map(|s| s.added.as_deref())
        .collect();
    assert_eq!(
        added.get(..2),
        Some(&[WINDOW, "self_disconnection"][..]),
        "{added:?}"
    );
    let errors = quoted_errors(&done);
    assert!(errors.last() < errors.first(), "{errors:?}");
}
