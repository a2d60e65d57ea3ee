//! An effect that is worth nothing without the stator resistance beside which it was found.

use super::{improved_on, windows};
use loadmodeld::{
    diagnosis::DiagnosisOptions,
    load_model::effects,
    measurement::Site,
    truth::{Effect, HiddenEffect, SiteOptions, generate},
};

#[test]
fn what_is_found_beside_a_resistance_brings_it_along() {
    let site = Site {
        name: "beside".to_owned(),
        s_base_mva: 200.0,
        v_base_kv: 23.0,
        nominal_hz: 60.0,
    };
    let seed = 3321;
    let mut hidden = HiddenEffect::drawn(Effect::DistributedGeneration, seed);
    hidden.set("behaviour", "ride_through").unwrap();
    hidden.set("share", "0.3").unwrap();
    let mut truth = SiteOptions {
        noise: 4e-4,
        composition_spread: 2e-3,
        bad_samples: false,
        ..SiteOptions::varied(site, seed)
            .hiding(vec![hidden])
            .leaving_room()
    };
    truth.motor.stator_resistance = 0.015;
    let made = generate(&truth, &mut |_| ()).unwrap();
    let both = ["stator_resistance", "distributed_generation"];
    let all = effects::catalogue().iter().map(|e| e.declaration().name);
    let options = DiagnosisOptions {
        excluded: all
            .filter(|name| !both.contains(name))
            .map(str::to_owned)
            .collect(),
        ..DiagnosisOptions::default()
    };
    let found = improved_on(&made.options.site, &windows(&made), &options);
    let first = &found.diagnoses[0].answer_set;
    assert_eq!(first[0], "distributed_generation");
    let added: Vec<&str> = found
        .steps
        .iter()
        .filter_map(|s| s.added.as_deref())
        .collect();
    let told: Vec<_> = found
        .steps
        .iter()
        .map(|s| (&s.reason, s.delta_bic))
        .collect();
    assert_eq!(added, both, "{told:?}");
    assert!(told[1].0.contains("worth nothing without it"), "{told:?}");
    assert!(told[2].1 < told[1].1, "{told:?}");
    let untouched = |step: usize| found.steps[step].errors.untouched.as_ref().unwrap();
    let errors = [0, 2].map(|step| untouched(step).error_to_noise);
    assert!(errors[1] < 0.7 * errors[0], "{errors:?}");
}
