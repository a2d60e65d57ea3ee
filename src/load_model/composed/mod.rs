//! A load model composed of ZIP, motor and any effects, simulated over any terminal input.
//!
//! With `v = |u|`, all relative to P0 and V0 of the event:
//!
//! ```text
//! P/P0 = 1     + K (p - 1)   + c_z (v^2 - 1) + c_i (v - 1) + sum of the effects' active power
//! Q/P0 = Q0/P0 + K (q - q_0) + d_z (v^2 - 1) + d_i (v - 1) + sum of the effects' reactive power
//! ```
//!
//! which is the plain model of `zip_im` when there is no effect. That has a faster and more exact path of its own
//! (`induction_motor`); this one is general. Both agree to 1e-4 of P0 (tested).

mod active;
mod at_rest;
mod base;
mod beside;
pub(super) mod complex;
mod context;
mod feeder;
mod grid;
mod kept;
mod motor;
mod motor_step;
mod no_value;
mod places;
mod run;
mod runge_kutta;
mod series;
mod static_lag;

#[cfg(test)]
pub(super) mod contract;
#[cfg(test)]
mod manual;
#[cfg(test)]
mod tests;

use std::sync::Arc;

pub use base::{BASE, BASE_PARAMETERS};
pub use beside::{DerivativeColumns, MotorCourse};
pub use context::{FrequencyCourse, Instant, Rest, Seen, Series, Step};
pub use feeder::{AtLoad, Feeder};
pub use grid::Grid;
pub use motor::{Motor, MotorDescription, MotorState};

use super::{
    Infeasible, LinearCoefficients, MotorCoordinates, Structure, TerminalInput,
    effect::{Effect, LANES, PairSensitivity, Parameter, Place, Role},
    effects::STATIC_LAG,
};
use crate::numerics::{Scalar, Sensitivities};
use active::{Active, Pass};
use feeder::PROBES;
use kept::Kept;
use run::{Course, Output};

/// What drives a composed model in one event.
#[derive(Clone, Copy, Debug)]
pub struct Drive<'a> {
    /// The phasor.
    pub terminal: &'a TerminalInput,
    /// Frequency less that before the event over nominal, at every output instant; empty when unknown (then 0).
    pub frequency_deviation: &'a [f64],
    /// `Q0/P0`.
    pub reactive_at_rest: f64,
    /// How exactly the states are integrated.
    pub accuracy: Accuracy,
    /// What all simulations of this input to this accuracy share; made anew where it is not at hand.
    pub grid: Option<&'a Arc<Grid>>,
    /// Whether how late an instrument is ([`ComposedModel::delay`]) is left to whoever knows what else it does.
    pub leaves_delay: bool,
    /// How reactive coefficients go with what a load behind a feeder draws; `None` where they do not.
    pub at_load: Option<AtLoad>,
}

impl<'a> Drive<'a> {
    /// With full accuracy.
    #[must_use]
    pub fn new(
        terminal: &'a TerminalInput,
        frequency_deviation: &'a [f64],
        reactive_at_rest: f64,
    ) -> Self {
        Self {
            terminal,
            frequency_deviation,
            reactive_at_rest,
            accuracy: Accuracy::Full,
            grid: None,
            leaves_delay: false,
            at_load: None,
        }
    }

    /// What simulations share.
    fn shared(&self) -> Arc<Grid> {
        let new = || Arc::new(Grid::new(self.terminal, self.accuracy));
        self.grid.cloned().unwrap_or_else(new)
    }
}

/// How exactly states are integrated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Accuracy {
    /// To 1e-4 of P0 at worst (measured by a test).
    #[default]
    Full,
    /// To 5e-3 of P0 at worst (near pull-out), about what measurements scatter: for searches far from the data,
    /// whose end is fitted again in full.
    Rough,
}

/// Power over P0 at the output instants of [`TerminalInput::output_points`], and its derivatives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Response {
    /// Active power.
    pub active: Vec<f64>,
    /// Reactive power.
    pub reactive: Vec<f64>,
    /// For each wanted parameter, in the order asked for, the derivative of the active power.
    pub active_derivatives: Vec<Vec<f64>>,
    /// The same of the reactive power.
    pub reactive_derivatives: Vec<Vec<f64>>,
}

/// Why a composed model gives no response.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// No steady state to start from.
    #[error(transparent)]
    Infeasible(#[from] Infeasible),
    /// The network has no solution at some instant: the voltage at the load collapses.
    #[error("no voltage at the load solves the network after output instant {output}")]
    NoLoadVoltage {
        /// Index of the output instant before it.
        output: usize,
    },
    /// A power or its derivative is not a number.
    #[error("the power or its derivative at output instant {output} is not finite")]
    NotFinite {
        /// Index of the output instant.
        output: usize,
    },
    /// Wrong number of parameters.
    #[error("{found} parameters given, the structure has {expected}")]
    ParameterCount {
        /// Expected number.
        expected: usize,
        /// Number given.
        found: usize,
    },
    /// Derivatives with respect to a parameter that is not there.
    #[error("derivatives wanted with respect to parameter {index} of {count}")]
    NoSuchParameter {
        /// The index.
        index: usize,
        /// Number of parameters.
        count: usize,
    },
    /// The frequency deviation does not belong to the terminal input.
    #[error("{found} frequency deviations given for {expected} output instants")]
    FrequencyCount {
        /// Number of output instants.
        expected: usize,
        /// Number given.
        found: usize,
    },
}

/// A parameter of a composed model.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelParameter {
    /// `name` of a base or shared parameter, `effect.name` of an effect's own.
    pub name: String,
    /// The effect it belongs to; `None` for base and shared parameters.
    pub effect: Option<&'static str>,
    /// Its declaration.
    pub declaration: Parameter,
}

/// A composed model: a structure with its parameter vector.
#[derive(Clone, Debug)]
pub struct ComposedModel {
    parameters: Arc<[ModelParameter]>,
    /// The effects and where their parameters are in the vector.
    effects: Vec<(&'static dyn Effect, Vec<usize>)>,
}

impl ComposedModel {
    /// The model of a structure. The vector holds [`BASE`] and then the parameters of the effects in
    /// the order of the structure; a shared one where it first appears. The lag of the static load comes last.
    #[must_use]
    pub fn new(structure: &Structure) -> Self {
        let mut parameters: Vec<ModelParameter> = BASE
            .iter()
            .map(|declaration| ModelParameter {
                name: declaration.name.to_owned(),
                effect: None,
                declaration: structure.ranges().applied(declaration.name, *declaration),
            })
            .collect();
        let mut effects = Vec::new();
        for effect in structure.effects() {
            let own = effect.declaration();
            let places = own.parameters.iter().map(|p| {
                let shared = p.role == Role::Shared;
                let known = parameters.iter().position(|k| k.name == p.name);
                if let (true, Some(index)) = (shared, known) {
                    return index;
                }
                let name = if shared {
                    p.name.to_owned()
                } else {
                    format!("{}.{}", own.name, p.name)
                };
                parameters.push(ModelParameter {
                    effect: (!shared).then_some(own.name),
                    declaration: structure.ranges().applied(&name, *p),
                    name,
                });
                parameters.len() - 1
            });
            effects.push((effect, places.collect()));
        }
        let (effect, declaration) = STATIC_LAG;
        effects.push((effect, vec![parameters.len()]));
        parameters.push(ModelParameter {
            name: declaration.name.to_owned(),
            effect: None,
            declaration: structure.ranges().applied(declaration.name, declaration),
        });
        Self {
            parameters: parameters.into(),
            effects,
        }
    }

    /// Names of the effects, in the order of the structure.
    pub fn effect_names(&self) -> impl Iterator<Item = &'static str> + '_ {
        let named = self.effects.len().saturating_sub(1);
        let effects = self.effects.iter().take(named);
        effects.map(|(effect, _)| effect.declaration().name)
    }

    /// Where the delay, in s, of an instrument that reports P and Q late is in the vector.
    #[must_use]
    pub fn delay(&self) -> Option<usize> {
        let mut effects = self.effects.iter();
        effects.find_map(|(effect, places)| {
            let name = effect.delay()?;
            let declared = &effect.declaration().parameters;
            let own = declared.iter().position(|p| p.name == name)?;
            places.get(own).copied()
        })
    }

    /// Where the lag of the static load is in the vector.
    #[must_use]
    pub fn static_lag(&self) -> usize {
        self.parameters.len() - 1
    }

    /// The parameters, in order.
    #[must_use]
    pub fn parameters(&self) -> &[ModelParameter] {
        &self.parameters
    }

    /// Where a parameter is in the vector.
    #[must_use]
    pub fn index(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|p| p.name == name)
    }

    /// The vector in which every effect is absent and everything else typical.
    #[must_use]
    pub fn neutral(&self) -> Vec<f64> {
        self.parameters
            .iter()
            .map(|p| p.declaration.neutral)
            .collect()
    }

    /// The vector of typical values.
    #[must_use]
    pub fn typical(&self) -> Vec<f64> {
        self.parameters
            .iter()
            .map(|p| p.declaration.typical)
            .collect()
    }

    /// A vector on the base of an event with this operating point, as [`simulate`](Self::simulate) wants it, and the
    /// derivative of each entry with respect to the declared one.
    #[must_use]
    pub fn on_event_base(&self, declared: &[f64], v0_pu: f64, p0_pu: f64) -> (Vec<f64>, Vec<f64>) {
        let of = |(p, value): (&ModelParameter, &f64)| {
            p.declaration.reference.on_event_base(*value, v0_pu, p0_pu)
        };
        self.parameters.iter().zip(declared).map(of).unzip()
    }

    /// Simulates, with exact derivatives with respect to the `wanted` parameters (indices into the
    /// vector, any order). The values do not depend on what is wanted. Cost: an integration with
    /// [`Sensitivity`](super::effect::Sensitivity) for every [`LANES`] wanted parameters that act on states (all of them behind a
    /// feeder, [`LANES`] less two the first time; without the motor where none of them acts on it), an evaluation at the output instants for every [`LANES`]
    /// others; one with `f64` where none acts on states.
    ///
    /// An effect whose amplitudes are all neutral takes no part in the values; where one of its amplitudes is wanted the
    /// derivatives are those of a model in which it takes part, that by the amplitude the one-sided one.
    ///
    /// # Errors
    ///
    /// See [`SimulationError`].
    pub fn simulate(
        &self,
        parameters: &[f64],
        wanted: &[usize],
        drive: &Drive<'_>,
    ) -> Result<Response, SimulationError> {
        self.check(parameters, wanted, drive)?;
        let grid = drive.shared();
        let (present, acting) = (
            self.acting(parameters, &[]),
            self.acting(parameters, wanted),
        );
        let Lanes {
            network,
            inside,
            beside,
            motors,
        } = self.lanes(parameters, wanted, &acting, drive);
        let plain = |effects: &[usize], kept: &mut Kept| {
            let course = Course::Integrate(kept);
            self.pass::<f64>(drive, &grid, |i| parameters[i], effects, course)
        };
        let mut columns = vec![[Vec::new(), Vec::new()]; wanted.len()];
        let mut sensitive = |lanes: &[usize], course: Course<'_>| {
            let by: Vec<usize> = lanes.iter().map(|w| wanted[*w]).collect();
            let found = self.sensitive((drive, &grid), parameters, &by, &acting, course)?;
            let [active, reactive] = found.columns;
            for ((&place, p), q) in lanes.iter().zip(active).zip(reactive) {
                columns[place] = [p, q];
            }
            Ok::<_, SimulationError>(found.values)
        };
        let mut values = None;
        if present != acting || wanted.is_empty() {
            values = Some(plain(&present, &mut Kept::default())?);
        }
        let mut kept = Kept::new(!beside.is_empty() || motors < inside.len());
        // Values first where they help the derivatives, or are all that these need.
        let helps = network || motors == 0;
        if helps && !wanted.is_empty() {
            let found = plain(&acting, &mut kept)?;
            values.get_or_insert(found);
        }
        for (number, lanes) in inside.iter().enumerate() {
            let course = if number < motors {
                Course::Integrate(&mut kept)
            } else {
                Course::BesideMotor(&mut kept)
            };
            let found = sensitive(lanes, course)?;
            values.get_or_insert(found);
        }
        for lanes in beside.chunks(LANES) {
            sensitive(lanes, Course::Replay(&kept))?;
        }
        let [active, reactive] = values.unwrap_or_default();
        let (active_derivatives, reactive_derivatives) =
            columns.into_iter().map(|[p, q]| (p, q)).unzip();
        Ok(Response {
            active,
            reactive,
            active_derivatives,
            reactive_derivatives,
        })
    }

    /// How derivatives by the `wanted` parameters share passes.
    fn lanes(
        &self,
        parameters: &[f64],
        wanted: &[usize],
        acting: &[usize],
        drive: &Drive<'_>,
    ) -> Lanes {
        let network = self.is_behind_feeder(acting);
        let (mut beside, inside): (Vec<usize>, Vec<usize>) =
            (0..wanted.len()).partition(|&w| !network && self.is_beside_the_states(wanted[w]));
        if network {
            // The first pass carries derivatives of its own.
            let (first, others) = inside.split_at(inside.len().min(LANES - PROBES));
            let first = (!first.is_empty()).then(|| first.to_vec());
            let inside: Vec<Vec<usize>> = (first
                .into_iter()
                .chain(others.chunks(LANES).map(<[usize]>::to_vec)))
            .collect();
            return Lanes {
                network,
                motors: inside.len(),
                inside,
                beside,
            };
        }
        // Passes without a lane that acts on the motor take its course from those with one.
        let measured = self.sees_the_measured_phasor(acting);
        let apart =
            |w: usize| measured && !self.acts_on_motor(parameters, acting, wanted[w], drive);
        let (mut lanes, others): (Vec<usize>, Vec<usize>) =
            inside.iter().partition(|w| !apart(**w));
        let motors = lanes.len().div_ceil(LANES);
        lanes.extend(others);
        // What an integration can carry at no cost, where that saves an evaluation.
        let spare = lanes.len().next_multiple_of(LANES) - lanes.len();
        let left = beside.len().saturating_sub(spare);
        if left.div_ceil(LANES) < beside.len().div_ceil(LANES) {
            lanes.extend(beside.split_off(left));
        }
        Lanes {
            network,
            inside: lanes.chunks(LANES).map(<[usize]>::to_vec).collect(),
            beside,
            motors,
        }
    }

    /// The effects that take part where derivatives by the `wanted` parameters are asked for, as indices.
    fn acting(&self, parameters: &[f64], wanted: &[usize]) -> Vec<usize> {
        let acts = |e: &usize| {
            let (effect, places) = &self.effects[*e];
            let own: Vec<f64> = places.iter().map(|&i| parameters[i]).collect();
            let amplitude_wanted = places
                .iter()
                .any(|i| wanted.contains(i) && self.parameters[*i].declaration.is_amplitude());
            amplitude_wanted || !effect.declaration().is_neutral(&own)
        };
        (0..self.effects.len()).filter(acts).collect()
    }

    fn is_behind_feeder(&self, acting: &[usize]) -> bool {
        let mut acting = acting.iter();
        acting.any(|&e| self.effects[e].0.declaration().acts_on(Place::Feeder))
    }

    /// Whether no state depends on a parameter while the load sees the measured phasor.
    fn is_beside_the_states(&self, index: usize) -> bool {
        let parameter = &self.parameters[index];
        if parameter.declaration.role == Role::Base {
            return index >= BASE_PARAMETERS - LinearCoefficients::COUNT;
        }
        let owner =
            |(e, _): &&(&'static dyn Effect, _)| parameter.effect == Some(e.declaration().name);
        self.effects
            .iter()
            .find(owner)
            .is_some_and(|(effect, places)| {
                let own = effect.beside_the_states();
                own.into_iter().any(|i| places.get(i) == Some(&index))
            })
    }

    fn check(
        &self,
        parameters: &[f64],
        wanted: &[usize],
        drive: &Drive<'_>,
    ) -> Result<(), SimulationError> {
        let count = self.parameters.len();
        if parameters.len() != count {
            return Err(SimulationError::ParameterCount {
                expected: count,
                found: parameters.len(),
            });
        }
        if let Some(&index) = wanted.iter().find(|w| **w >= count) {
            return Err(SimulationError::NoSuchParameter { index, count });
        }
        let (expected, found) = (
            drive.terminal.output_count(),
            drive.frequency_deviation.len(),
        );
        if found != 0 && found != expected {
            return Err(SimulationError::FrequencyCount { expected, found });
        }
        Ok(())
    }

    /// A pass with derivatives by the parameters `by`, at most [`LANES`] of them; a few are carried by
    /// narrower numbers.
    fn sensitive(
        &self,
        at: (&Drive<'_>, &Grid),
        parameters: &[f64],
        by: &[usize],
        acting: &[usize],
        course: Course<'_>,
    ) -> Result<Sensitive, SimulationError> {
        // Behind a feeder the first pass carries derivatives of its own.
        let alone = match &course {
            Course::Integrate(kept) if self.is_behind_feeder(acting) => kept.knows_slopes(),
            _ => true,
        };
        if alone && by.len() <= PairSensitivity::COUNT {
            self.sensitive_in::<1>(at, parameters, by, acting, course)
        } else {
            self.sensitive_in::<{ LANES / 2 }>(at, parameters, by, acting, course)
        }
    }

    fn sensitive_in<const PAIRS: usize>(
        &self,
        (drive, grid): (&Drive<'_>, &Grid),
        parameters: &[f64],
        by: &[usize],
        acting: &[usize],
        course: Course<'_>,
    ) -> Result<Sensitive, SimulationError>
    where
        Sensitivities<PAIRS>: Pass,
    {
        let variable = |i: usize| match by.iter().position(|w| *w == i) {
            Some(lane) => Sensitivities::<PAIRS>::variable(parameters[i], lane),
            None => Sensitivities::<PAIRS>::constant(parameters[i]),
        };
        let found = self.pass(drive, grid, variable, acting, course)?;
        let columns: DerivativeColumns = [0, 1].map(|channel| {
            let column = |lane: usize| found[channel].iter().map(|y| y.derivative(lane)).collect();
            (0..by.len()).map(column).collect()
        });
        let infinite = |column: &Vec<f64>| column.iter().position(|d| !d.is_finite());
        if let Some(output) = columns.iter().flatten().find_map(infinite) {
            return Err(SimulationError::NotFinite { output });
        }
        Ok(Sensitive {
            values: found.map(|series| series.iter().map(|y| y.value).collect()),
            columns,
        })
    }

    fn pass<S: Pass>(
        &self,
        drive: &Drive<'_>,
        grid: &Grid,
        value: impl Fn(usize) -> S,
        effects: &[usize],
        course: Course<'_>,
    ) -> Result<Output<S>, SimulationError> {
        let (motor, active) = self.parts(&value, effects);
        let linear: [S; LinearCoefficients::COUNT] = std::array::from_fn(|i| value(3 + i));
        run::run(drive, grid, motor, linear, &active, course)
    }

    /// The motor and the effects with their parameters.
    fn parts<S: Pass>(
        &self,
        value: impl Fn(usize) -> S,
        effects: &[usize],
    ) -> (MotorCoordinates<S>, Vec<Active<'_, S>>) {
        let mut active: Vec<Active<'_, S>> = Vec::new();
        for &e in effects {
            let (effect, places) = &self.effects[e];
            let first_state = active.last().map_or(0, Active::end);
            let values = places.iter().map(|&i| value(i)).collect();
            active.push(Active::new(*effect, values, first_state));
        }
        let motor = MotorCoordinates {
            alpha_per_s: value(0).exp(),
            nu_per_s2: value(1).exp(),
            kappa: value(2),
        };
        (motor, active)
    }
}

/// How wanted derivatives, as places in the list of the wanted ones, share passes.
struct Lanes {
    /// Whether the load is behind a feeder.
    network: bool,
    /// By integration, one after the other, those that act on the motor first.
    inside: Vec<Vec<usize>>,
    /// By an evaluation at the output instants.
    beside: Vec<usize>,
    /// Integrations with a derivative that acts on the motor.
    motors: usize,
}

/// What a pass with derivatives gives: values, and a series of derivatives per parameter.
struct Sensitive {
    values: Output<f64>,
    columns: DerivativeColumns,
}
