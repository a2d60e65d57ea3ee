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
    truth::Effect,
};

/// Calls of the objective per pair: enough to show that a step is found and lowers it.
const EVALUATIONS: u64 = 3;

/// Two short dips of one site in which a block disconnects itself.
fn events() -> Vec<PreparedEvent> {
    let (_, windows) = super::site(&[Effect::SelfDisconnection], 3);
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
    let mut options = ComposedFitOptions {
        rounds_max: 1,
        ..ComposedFitOptions::default()
    };
    options.local.evaluations_max = EVALUATIONS;
    let at_start = ComposedFitOptions {
        local: loadmodeld::numerics::local_solver::Options {
            evaluations_max: 1,
            ..options.local
        },
        ..options
    };
    let names: Vec<&str> = effects::catalogue()
        .iter()
        .map(|e| e.declaration().name)
        .collect();
    let (mut fitted, mut excluded) = (0, 0);
    for (k, one) in names.iter().enumerate() {
        for other in &names[k + 1..] {
            let structure = Structure::zip_im().with(one).unwrap().with(other);
            let structure = match structure {
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
                fit(&events, &model, &from, &free, options, &|| false)
            };
            let before = run(&at_start).unwrap_or_else(|| panic!("{one} + {other}: no start"));
            let after = run(&options).unwrap_or_else(|| panic!("{one} + {other}: no fit"));
            assert!(
                after.objective < before.objective && after.objective.is_finite(),
                "{one} + {other}: {} to {}",
                before.objective,
                after.objective
            );
            fitted += 1;
        }
    }
    println!("{fitted} pairs fitted, {excluded} exclude each other");
    assert!(fitted > 10 * excluded, "{fitted} {excluded}");
}
