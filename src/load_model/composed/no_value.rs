//! Which effect of a model has no finite value.

use super::{ComposedModel, Drive};
use crate::load_model::effect::NoValue;

impl ComposedModel {
    /// The effect that has no finite value with these parameters, and where; asked for when a simulation has failed with
    /// [`SimulationError::NotFinite`](super::SimulationError::NotFinite). None where no effect says so of itself.
    #[must_use]
    pub fn no_value(
        &self,
        parameters: &[f64],
        drive: &Drive<'_>,
    ) -> Option<(&'static str, NoValue)> {
        self.effects.iter().find_map(|(effect, places)| {
            let own: Option<Vec<f64>> =
                places.iter().map(|&i| parameters.get(i).copied()).collect();
            let found = effect.no_value(&own?, drive)?;
            Some((effect.declaration().name, found))
        })
    }
}
