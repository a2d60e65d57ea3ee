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

/// What a model answers to an event, as the instrument reports it.
pub(super) fn curves(
    model: &ComposedModel,
    parameters: &[f64],
    event: &PreparedEvent,
) -> Result<Curves, SimulationError> {
    let own = at_operating_point(model, parameters, event).0;
    let response = model.simulate(&own, &[], &drive(event, &event.input, &event.chain))?;
    let measured = reported(event, model, parameters, &response);
    let (active, reactive) = measured.into_iter().map(|[p, q]| (p, q)).unzip();
    let mut curves = Curves { active, reactive };
    curves.shift_to(event);
    Ok(curves)
}

impl EventModel for ComposedLoad {
    fn curves(&self, event: &PreparedEvent) -> Result<Curves, SimulationError> {
        curves(&self.model, &self.parameters, event)
    }

    fn without_value(&self, event: &PreparedEvent) -> Option<IdentificationError> {
        self.fails_in(event, None)
    }
}
