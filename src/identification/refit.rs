//! A fitted structure by itself: enough to simulate it again, without errors or verdict.

use super::{
    IdentificationError, ReactiveTrend,
    composed::{ComposedFit, ComposedLoad},
};
use crate::load_model::{
    Structure,
    composed::{ComposedModel, ModelParameter},
    effect::{Declared, Role},
    effects,
};

/// A structure with a value for every parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedStructure {
    /// The parts.
    pub structure: Vec<String>,
    /// Every parameter of the model by its name, as the model declares it, and the numbers of the
    /// [`ReactiveTrend`] it was fitted with.
    pub values: Vec<(String, f64)>,
}

impl FittedStructure {
    /// What a fit found.
    #[must_use]
    pub fn of(fit: &ComposedFit, trend: &ReactiveTrend) -> Self {
        let mut structure = Structure::zip_im().names();
        structure.extend(fit.model.effect_names().map(str::to_owned));
        let parameters = fit.model.parameters().iter().zip(&fit.parameters);
        let values = parameters.map(|(parameter, value)| (parameter.name.clone(), *value));
        let trend = trend.values();
        let values = values.chain(trend.map(|(name, value)| (name.to_owned(), value)));
        Self {
            structure,
            values: values.collect(),
        }
    }

    /// The trend of its reactive coefficients.
    pub(super) fn trend(&self) -> ReactiveTrend {
        ReactiveTrend::from_values(|name| {
            let found = self.values.iter().find(|(known, _)| known == name);
            found.map(|(_, value)| *value)
        })
    }

    /// The model.
    ///
    /// [`IdentificationError::Structure`] when its parts are not known (any more),
    /// [`IdentificationError::IncompleteSet`] when a parameter has no value.
    pub(super) fn load(&self) -> Result<ComposedLoad, IdentificationError> {
        let structure = Structure::parse(&self.structure)?;
        let model = ComposedModel::new(&structure);
        let value = |(index, parameter): (usize, &ModelParameter)| {
            let found = (self.values.iter()).find(|(known, _)| *known == parameter.name);
            found
                .map(|(_, value)| *value)
                .filter(|value| value.is_finite())
                .or_else(|| in_earlier_sets(&model, index))
                .ok_or_else(|| IdentificationError::IncompleteSet {
                    name: parameter.name.clone(),
                })
        };
        let parameters = model.parameters().iter().enumerate().map(value);
        let parameters = parameters.collect::<Result<_, _>>()?;
        Ok(ComposedLoad {
            structure,
            model,
            parameters,
        })
    }
}

/// The value of a parameter that sets of earlier versions do not have: a lag, counts, and what goes with Q0/P0.
pub(super) fn in_earlier_sets(model: &ComposedModel, index: usize) -> Option<f64> {
    let parameter = &model.parameters()[index];
    let effect = parameter.effect.and_then(effects::find);
    let by_ratio = effect.and_then(Declared::by_reactive_ratio) == Some(parameter.declaration.name);
    let earlier =
        parameter.declaration.role == Role::Count || by_ratio || index == model.static_lag();
    earlier.then_some(parameter.declaration.typical)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn typical(structure: &[&str]) -> FittedStructure {
        let parsed = Structure::parse(structure).unwrap();
        let model = ComposedModel::new(&parsed);
        let names = model.parameters().iter().map(|p| p.name.clone());
        FittedStructure {
            structure: parsed.names(),
            values: names.zip(model.typical()).collect(),
        }
    }

    #[test]
    fn a_fitted_structure_becomes_its_model_again() {
        let fitted = typical(&["zip", "induction_motor", "second_motor"]);
        let load = fitted.load().unwrap();
        assert_eq!(load.parameters, load.model.typical());
    }

    #[test]
    fn a_set_of_earlier_versions_has_no_lag_of_the_static_load() {
        let mut fitted = typical(&["zip", "induction_motor", "second_motor"]);
        let (name, _) = fitted.values.pop().unwrap();
        assert_eq!(name, "static_lag_s");
        let load = fitted.load().unwrap();
        assert_eq!(load.parameters[load.model.static_lag()].to_bits(), 0);
    }

    #[test]
    fn what_sets_of_earlier_versions_do_not_have_is_as_it_was_then() {
        let later = [
            ("self_disconnection", "dips", 1.0),
            ("motor_undervoltage_trip", "capacitors_by_q0_over_p0", 0.0),
        ];
        for (effect, own, expected) in later {
            let mut fitted = typical(&["zip", "induction_motor", effect]);
            let name = format!("{effect}.{own}");
            fitted.values.retain(|(known, _)| *known != name);
            let load = fitted.load().unwrap();
            let at = load.model.index(&name).unwrap();
            assert!((load.parameters[at] - expected).abs() < 1e-15, "{name}");
        }
    }

    #[test]
    fn a_parameter_without_a_value_is_an_error_with_its_name() {
        let mut fitted = typical(&["zip", "induction_motor"]);
        let (name, _) = fitted.values.remove(0);
        let error = fitted.load().unwrap_err();
        assert_eq!(error, IdentificationError::IncompleteSet { name });
    }
}
