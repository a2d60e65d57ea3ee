//! A composed model with its parameters, as the rest of the identification sees any fitted model.

use super::{
    operating_point::at_operating_point,
    rows::{drive, reported},
};
use crate::{
    identification::{
        IdentificationError,
        evaluate::{Curves, EventModel},
        intake::PreparedEvent,
    },
    load_model::{
        Structure,
        composed::{ComposedModel, SimulationError},
    },
};

/// A composed model whose parameters are known.
#[derive(Clone, Debug)]
pub struct ComposedLoad {
    /// The parts.
    pub structure: Structure,
    /// The model.
    pub model: ComposedModel,
    /// Every parameter, in the model's order.
    pub parameters: Vec<f64>,
}

impl EventModel for ComposedLoad {
    fn curves(&self, event: &PreparedEvent) -> Result<Curves, SimulationError> {
        let own = at_operating_point(&self.model, &self.parameters, event).0;
        let response = self
            .model
            .simulate(&own, &[], &drive(event, &event.input, &event.chain))?;
        let measured = reported(event, &self.model, &self.parameters, &response);
        let (active, reactive) = measured.into_iter().map(|[p, q]| (p, q)).unzip();
        let mut curves = Curves { active, reactive };
        curves.shift_to(event);
        Ok(curves)
    }

    fn without_value(&self, event: &PreparedEvent) -> Option<IdentificationError> {
        self.fails_in(event, None)
    }
}
