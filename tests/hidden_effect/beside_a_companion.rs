//! Effects that show beside the stator resistance only.

use super::{improved_on, plain, windows};
use loadmodeld::{
    diagnosis::DiagnosisOptions,
    identification::{IdentificationOptions, identify},
    load_model::effects,
    measurement::Site,
    truth::{Effect, HiddenEffect, SiteOptions, generate},
};

fn site() -> Site {
    Site {
        name: "beside".to_owned(),
        s_base_mva: 200.0,
        v_base_kv: 23.0,
        nominal_hz: 60.0,
    }
}

fn riding_through(seed: u64) -> HiddenEffect {
    let mut hidden = HiddenEffect::drawn(Effect::DistributedGeneration, seed);
    hidden.set("behaviour", "ride_through").unwrap();
    hidden.set("share", "0.3").unwrap();
    hidden
}

#[test]
fn what_a_resistance_hides_is_found_whichever_is_named_first() {
    let seed = 3334;
    let resistance = HiddenEffect::drawn(Effect::StatorResistance, seed);
    let truth = SiteOptions {
        noise: 6e-4,
        composition_spread: 2e-3,
        ..SiteOptions::varied(site(), seed)
            .hiding(vec![riding_through(seed), resistance])
            .leaving_room()
    };
    let made = generate(&truth, &mut |_| ()).unwrap();
    let effects = ["distributed_generation", "stator_resistance"].map(str::to_owned);
    let structure = [plain(), effects.to_vec()].concat();
    let options = IdentificationOptions::default();
    let found = identify(&site(), &windows(&made), &structure, &options, &|| false).unwrap();
    let mut all = found.set.parameters.iter();
    let share = all.find(|p| p.name == "distributed_generation.share");
    let share = share.unwrap().value;
    // 0.004 where the generation is added first.
    assert!((0.24..0.36).contains(&share), "{share}");
    let error = found.set.fit.error_to_noise;
    assert!(error < 1.15, "{error}");
}

#[test]
fn what_is_found_beside_a_resistance_brings_it_along() {
    let seed = 3321;
    let mut truth = SiteOptions {
        noise: 6e-4,
        composition_spread: 2e-3,
        bad_samples: false,
        ..SiteOptions::varied(site(), seed)
            .hiding(vec![riding_through(seed)])
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
    assert!(errors[1] < 0.8 * errors[0], "{errors:?}");
}
