//! Any two effects of the catalogue can be in one model, and that model can be fitted.

use loadmodeld::{
    disturbance::Window,
    identification::{
        composed::{ComposedFitOptions, fit},
        intake::{IntakeOptions, PreparedEvent, prepare},
    },
    load_model::{
        Structure, composed::ComposedModel, effect::Role, effects, structure::StructureError,
    },
};

/// Of minus twice the logarithm of the posterior: what a fit with renewed covariances may end above one of a
/// single step. Rounds end when one gains less than a thousandth of the objective, here 0.5.
const SETTLED: f64 = 0.1;

/// The two deepest events of a site in which nothing is hidden.
fn events() -> Vec<PreparedEvent> {
    let (_, windows) = super::site(&[], 1);
    let mut events: Vec<PreparedEvent> = windows
        .iter()
        .filter_map(|window: &Window| prepare(window, &IntakeOptions::default()).ok())
        .collect();
    events.sort_by(|a, b| a.lowest_voltage.total_cmp(&b.lowest_voltage));
    events.truncate(2);
    events
}

/// Every effect a little present: a pair of large ones need not have a steady state.
fn start(model: &ComposedModel) -> Vec<f64> {
    let declared = model.parameters().iter().map(|p| p.declaration);
    let little = |p: loadmodeld::load_model::effect::Parameter| match p.role {
        Role::OneSidedAmplitude { meaningful } | Role::TwoSidedAmplitude { meaningful } => {
            p.neutral + meaningful.min(0.1 * (p.upper - p.neutral))
        }
        _ => p.typical,
    };
    declared.map(little).collect()
}

#[test]
fn any_two_effects_can_be_fitted_together() {
    let events = events();
    assert_eq!(events.len(), 2);
    let options = ComposedFitOptions::default();
    let mut at_start = options;
    (at_start.rounds_max, at_start.local.evaluations_max) = (1, 1);
    let all = effects::catalogue().iter();
    let names: Vec<&str> = all.map(|e| e.declaration().name).collect();
    let (mut fitted, mut improved, mut excluded, mut lost) = (0, 0, 0, Vec::new());
    for (k, one) in names.iter().enumerate() {
        for other in &names[k + 1..] {
            let structure = match Structure::zip_im().with(one).unwrap().with(other) {
                Err(StructureError::Excluded { .. }) => {
                    excluded += 1;
                    continue;
                }
                other => other.unwrap(),
            };
            let model = ComposedModel::new(&structure);
            let free: Vec<usize> = (0..model.parameters().len()).collect();
            let from = start(&model);
            let run = |options: &ComposedFitOptions| {
                let found = fit(&events, &model, &from, &free, options, &|| false);
                let found = found.unwrap_or_else(|| panic!("{one} + {other}: no fit"));
                found.minus_twice_log_posterior()
            };
            let (before, after) = (run(&at_start), run(&options));
            improved += usize::from(after < before);
            // Not for NaN, either.
            let kept = after < before + SETTLED;
            if !kept {
                lost.push(format!("{one} + {other}: {before} to {after}"));
            }
            fitted += 1;
        }
    }
    println!("{fitted} pairs fitted, {improved} better than begun, {excluded} exclude each other");
    assert!(lost.is_empty(), "{lost:#?}");
    assert!(fitted > 10 * excluded, "{fitted} {excluded}");
    // Of the little that was put in, nothing is true: nearly every fit has something to gain.
    assert!(10 * improved > 9 * fitted, "{improved} of {fitted}");
}
