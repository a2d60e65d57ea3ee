//! What is as small as the variation between events that is assumed at first, and is named where they vary less.

use super::{plain, windows};
use loadmodeld::{
    diagnosis::{DiagnosisOptions, Status, diagnose},
    truth::{Effect, StudyShape, study_site},
};

#[test]
fn what_the_assumed_variation_takes_in_is_named_where_the_events_vary_less() {
    let effect = Effect::Saturation;
    let shape = StudyShape {
        effects: vec![effect],
        events: 6,
        duration_s: 5.0,
        rate_fps: 60.0,
        noise: 5e-4,
        composition_spread: 2e-3,
        ..StudyShape::default()
    };
    let made = study_site(7, 4, &shape).unwrap();
    let options = DiagnosisOptions::default();
    let (site, windows) = (&made.options.site, windows(&made));
    let found = diagnose(site, &windows, &plain(), &options, &|_| (), &|| false).unwrap();
    let reasons = &found.reasons;
    assert_eq!(found.status, Status::MissingEffect, "{reasons:?}");
    assert_eq!(found.answer_set, [effect.name()], "{reasons:?}");
    let told = |words: &str| reasons.iter().any(|reason| reason.contains(words));
    assert!(told("6 % of what is assumed at first"), "{reasons:?}");
    assert!(told("both no more than the noise may"), "{reasons:?}");
}
