//! Models that are fitted already, simulated on windows: curves side by side, and errors.

use super::{
    Comparison, ErrorSummary, IdentificationError, IdentificationOptions, OperatingPoint,
    ParameterSet, ReactiveTrend,
    comparison::compare_event,
    composed::ComposedLoad,
    edge_timing::align,
    estimates,
    evaluate::{EventModel, FittedModel, StaticModel, errors},
    identify::prepare_all,
    intake::{IntakeOptions, PreparedEvent},
    joint_problem::OUTER,
    refit::{FittedStructure, in_earlier_sets},
};
use crate::{
    disturbance::Window,
    load_model::{
        LinearCoefficients, MotorCoordinates, Structure,
        composed::{ComposedModel, ModelParameter},
    },
};

/// Simulates a parameter set on each window that can be used.
///
/// # Errors
///
/// [`IdentificationError::NoUsableEvent`] when no window can be simulated.
pub fn compare(
    set: &ParameterSet,
    windows: &[Window],
    options: &IdentificationOptions,
) -> Result<Vec<Comparison>, IdentificationError> {
    let intake = options.intake.for_parts(&set.structure);
    compare_model(model_of(set)?.as_ref(), &trend_of(set), windows, &intake)
}

/// As [`compare`], of a structure with values.
///
/// # Errors
///
/// As [`compare`].
pub fn compare_fitted(
    fitted: &FittedStructure,
    windows: &[Window],
    options: &IdentificationOptions,
) -> Result<Vec<Comparison>, IdentificationError> {
    let intake = options.intake.for_parts(&fitted.structure);
    compare_model(&fitted.load()?, &fitted.trend(), windows, &intake)
}

fn compare_model(
    model: &dyn EventModel,
    trend: &ReactiveTrend,
    windows: &[Window],
    intake: &IntakeOptions,
) -> Result<Vec<Comparison>, IdentificationError> {
    let events = prepared(model, trend, windows, intake)?;
    let reference = StaticModel::fit(&events);
    let summary = errors(model, &reference, &events).map_err(|_| no_response(model, &events))?;
    let mut list = Vec::with_capacity(events.len());
    for (event, errors) in events.iter().zip(summary.events) {
        let curves = model.curves(event);
        let curves = curves.map_err(|_| no_response(model, [event]))?;
        let Some(window) = windows.iter().find(|w| w.id == event.id) else {
            continue;
        };
        list.push(compare_event(window, event, &curves, errors));
    }
    Ok(list)
}

fn prepared(
    model: &dyn EventModel,
    trend: &ReactiveTrend,
    windows: &[Window],
    intake: &IntakeOptions,
) -> Result<Vec<PreparedEvent>, IdentificationError> {
    let (events, refused) = prepare_all(windows, intake);
    if events.is_empty() {
        return Err(IdentificationError::NoUsableEvent { refused });
    }
    let on_trend = |e| align(model, &trend.applied_to(e));
    Ok(events.iter().map(on_trend).collect())
}

/// Errors of a stored set on some windows, as used to hold the set in force against a candidate.
///
/// # Errors
///
/// As [`compare`].
pub fn errors_on(
    set: &ParameterSet,
    windows: &[Window],
    options: &IdentificationOptions,
) -> Result<ErrorSummary, IdentificationError> {
    let intake = options.intake.for_parts(&set.structure);
    errors_of(model_of(set)?.as_ref(), &trend_of(set), windows, &intake)
}

/// As [`errors_on`], of a structure with values.
///
/// # Errors
///
/// As [`compare`].
pub fn errors_of_fitted(
    fitted: &FittedStructure,
    windows: &[Window],
    options: &IdentificationOptions,
) -> Result<ErrorSummary, IdentificationError> {
    let intake = options.intake.for_parts(&fitted.structure);
    errors_of(&fitted.load()?, &fitted.trend(), windows, &intake)
}

fn errors_of(
    model: &dyn EventModel,
    trend: &ReactiveTrend,
    windows: &[Window],
    intake: &IntakeOptions,
) -> Result<ErrorSummary, IdentificationError> {
    let events = prepared(model, trend, windows, intake)?;
    let found = errors(model, &StaticModel::fit(&events), &events);
    found.map_err(|_| no_response(model, &events))
}

/// Why a model cannot be simulated on events.
pub(super) fn no_response<'e>(
    model: &dyn EventModel,
    events: impl IntoIterator<Item = &'e PreparedEvent>,
) -> IdentificationError {
    let named = events
        .into_iter()
        .find_map(|event| model.without_value(event));
    named.unwrap_or(IdentificationError::NoSolution)
}

/// The trend that a set was fitted with.
pub(super) fn trend_of(set: &ParameterSet) -> ReactiveTrend {
    ReactiveTrend::from_values(|name| {
        let found = set.derived.iter().find(|d| d.name == name);
        found.map(|d| d.value)
    })
}

/// The model of a stored set, from its coordinates.
pub(super) fn model_of(set: &ParameterSet) -> Result<Box<dyn EventModel>, IdentificationError> {
    let coordinate = |name: &str| {
        let wanted = format!("coordinate_{name}");
        let found = set.derived.iter().find(|d| d.name == wanted);
        found
            .map(|d| d.value)
            .filter(|v| v.is_finite())
            .ok_or(IdentificationError::IncompleteSet { name: wanted })
    };
    let base = estimates::coordinate_names()
        .into_iter()
        .map(coordinate)
        .collect::<Result<Vec<f64>, _>>()?;
    let structure = Structure::parse(&set.structure)?;
    if structure != structure.plain_part() {
        return Ok(Box::new(composed_of(set, structure, &base)?));
    }
    let linear = std::array::from_fn(|i| base[OUTER + i]);
    Ok(Box::new(FittedModel {
        motor: MotorCoordinates {
            alpha_per_s: base[0].exp(),
            nu_per_s2: base[1].exp(),
            kappa: base[2],
        },
        linear: LinearCoefficients::from_array(linear),
    }))
}

/// The model of a set with effects: their parameters are among the set's.
fn composed_of(
    set: &ParameterSet,
    structure: Structure,
    base: &[f64],
) -> Result<ComposedLoad, IdentificationError> {
    let model = ComposedModel::new(&structure);
    let own = |(index, parameter): (usize, &ModelParameter)| {
        let found = set.parameters.iter().find(|p| p.name == parameter.name);
        let name = parameter.name.clone();
        found
            .map(|p| p.value)
            .filter(|v| v.is_finite())
            .or_else(|| in_earlier_sets(&model, index))
            .ok_or(IdentificationError::IncompleteSet { name })
    };
    let all = model.parameters().iter().enumerate();
    let effects = all.skip(base.len()).map(own);
    let values: Vec<f64> = effects.collect::<Result<_, _>>()?;
    // The set's coordinates are those of its operating point.
    let OperatingPoint { v0_pu, p0_pu, .. } = set.operating_point;
    let declared = |(p, own): (&ModelParameter, &f64)| {
        let reference = p.declaration.reference;
        reference.declared(*own, v0_pu, p0_pu)
    };
    let declared = model.parameters().iter().zip(base).map(declared);
    let parameters = declared.chain(values).collect();
    Ok(ComposedLoad {
        structure,
        model,
        parameters,
    })
}
