//! A description of what is missing, as a file, fitted: the error falls. A process of its own, because
//! effects are registered once.
#![allow(
    clippy::unwrap_used,
    reason = "a test helper that fails should fail the test"
)]

use loadmodeld::{
    adapters::recordings::site_folder,
    diagnosis::unexplained::describe,
    disturbance::Window,
    identification::{
        composed::{ComposedFit, ComposedFitOptions, ComposedLoad, extend, fit},
        evaluate::{Curves, EventModel},
        intake::{IntakeOptions, PreparedEvent, prepare},
    },
    load_model::{Structure, composed::ComposedModel, effects, user_effects::EffectFile},
    truth::{Effect, StudyShape, study_site},
};

fn events() -> Vec<PreparedEvent> {
    let shape = StudyShape {
        effects: vec![Effect::SelfDisconnection],
        events: 6,
        duration_s: 5.0,
        bad_samples: false,
        ..StudyShape::default()
    };
    let site = study_site(1, 0, &shape).unwrap();
    let windows = site.records.iter().zip(1..).map(|(record, number)| Window {
        id: format!("event_{number:02}"),
        ..site_folder::window(&site.options.site, record)
    });
    windows
        .map(|w| prepare(&w, &IntakeOptions::default()).unwrap())
        .collect()
}

fn plain_fit(events: &[PreparedEvent]) -> ComposedFit {
    let model = ComposedModel::new(&Structure::zip_im());
    let free: Vec<usize> = (0..model.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    fit(events, &model, &model.typical(), &free, &options, &|| false).unwrap()
}

#[test]
fn the_file_made_from_a_residual_is_fitted_and_the_error_falls() {
    let events = events();
    let plain = plain_fit(&events);
    let load = ComposedLoad {
        structure: Structure::zip_im(),
        model: plain.model.clone(),
        parameters: plain.parameters.clone(),
    };
    let curves: Vec<Curves> = events.iter().map(|e| load.curves(e).unwrap()).collect();
    let found = describe(&events, &curves).unwrap();
    assert!(found.terms[0].formula.contains("latch"), "{found:?}");
    let file = EffectFile::parse(&found.effect_file.unwrap()).unwrap();
    let name = file.name().to_owned();
    effects::register(vec![file]).unwrap();
    let options = ComposedFitOptions::default();
    let extended = extend(
        &events,
        &Structure::zip_im(),
        &[&plain],
        &name,
        &options,
        &|| false,
    )
    .unwrap();
    let extended = extended.fit.unwrap();
    let (before, after) = (plain.chi_square_per_row(), extended.chi_square_per_row());
    println!("squares per row over noise: {before:.1} before, {after:.2} with the file");
    assert!(after < 0.1 * before, "{before} {after}");
}
