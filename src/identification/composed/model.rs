//! A composed model with its parameters, as the rest of the identification sees any fitted model.

use super::rows::drive;
use crate::{
    identification::{
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
        let (own, _) = self
            .model
            .on_event_base(&self.parameters, event.v0_pu, event.p0_pu);
        let response = self.model.simulate(&own, &[], &drive(event))?;
        let measured = event.chain.measured(&response.active, &response.reactive);
        let (active, reactive) = measured.into_iter().map(|[p, q]| (p, q)).unzip();
        let mut curves = Curves { active, reactive };
        curves.shift_to(event);
        Ok(curves)
    }
}
