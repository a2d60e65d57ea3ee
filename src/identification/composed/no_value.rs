//! What of a model has no finite value in an event, asked for when that could not be simulated.

use super::{
    fit::ComposedFit, model::ComposedLoad, operating_point::at_operating_point, rows::drive,
};
use crate::{
    identification::{IdentificationError, intake::PreparedEvent},
    load_model::{
        Structure,
        composed::{ComposedModel, Drive, SimulationError},
        effect::NoValue,
    },
};

/// Why `effect` cannot be added to a fit of `structure`: the first event in which it has no finite value with typical
/// shapes. None where that is not why.
#[must_use]
pub fn without_value(
    events: &[PreparedEvent],
    structure: &Structure,
    fit: &ComposedFit,
    effect: &str,
) -> Option<IdentificationError> {
    let structure = structure.with(effect).ok()?;
    let model = ComposedModel::new(&structure);
    let value = |name: &str| {
        let index = fit.model.index(name)?;
        fit.parameters.get(index).copied()
    };
    let own = model.parameters().iter();
    let parameters = own
        .map(|p| value(&p.name).unwrap_or(p.declaration.neutral))
        .collect();
    let load = ComposedLoad {
        structure,
        model,
        parameters,
    };
    let fails = |event| load.fails_in(event, Some(effect.trim()));
    events.iter().find_map(fails)
}

impl ComposedLoad {
    /// Which effect has no finite value in an event, as an error. `suspect` is to blame where none of its expressions is
    /// found to be.
    pub(super) fn fails_in(
        &self,
        event: &PreparedEvent,
        suspect: Option<&str>,
    ) -> Option<IdentificationError> {
        let own = at_operating_point(&self.model, &self.parameters, event).0;
        let drive = drive(event, &event.input, &event.chain);
        let amplitudes: Vec<usize> = (self.model.parameters().iter().enumerate())
            .filter(|(_, p)| p.effect.is_some() && p.declaration.is_amplitude())
            .map(|(index, _)| index)
            .collect();
        let simulated = self.model.simulate(&own, &amplitudes, &drive);
        let Err(SimulationError::NotFinite { output }) = simulated else {
            return None;
        };
        let found = self.model.no_value(&own, &drive);
        let (effect, no_value) = found
            .map(|(effect, no_value)| (effect.to_owned(), no_value))
            .or_else(|| Some((suspect?.to_owned(), at_output(&drive, output)?)))?;
        Some(IdentificationError::NoValue {
            effect,
            event: event.id.clone(),
            what: no_value.what,
            voltage: no_value.voltage,
            time_s: no_value.time_s,
        })
    }
}

/// What is known where no expression is found: when.
fn at_output(drive: &Drive<'_>, output: usize) -> Option<NoValue> {
    let terminal = drive.terminal;
    let place = *terminal.output_points().get(output)?;
    let (re, im) = (terminal.real.get(place)?, terminal.imaginary.get(place)?);
    let fine_s = terminal.sample_interval_s / terminal.points_per_sample.max(1) as f64;
    Some(NoValue {
        what: "the power that it adds, or a derivative of it".to_owned(),
        voltage: re.hypot(*im),
        time_s: place as f64 * fine_s,
    })
}
