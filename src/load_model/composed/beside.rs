//! Derivatives beside a motor whose course is known: what a power relay or a recovering load adds can be
//! looked at for many of its shapes without integrating the motor again.

use std::sync::Arc;

use super::{
    ComposedModel, Drive, MotorDescription, SimulationError, at_rest::describe, grid::Grid,
    kept::Kept, run::Course,
};
use crate::{
    load_model::effect::{LANES, Place, Sensitivity},
    numerics::Scalar,
};

/// The course of a model's motor in one event.
#[derive(Clone, Debug)]
pub struct MotorCourse {
    description: MotorDescription<f64>,
    /// Parameters of what motors see of the frequency, and of the static load's lag.
    beside: Vec<f64>,
    grid: Arc<Grid>,
    kept: Kept,
}

/// Derivatives of active and of reactive power, a series per wanted parameter.
pub type DerivativeColumns = [Vec<Vec<f64>>; 2];

impl ComposedModel {
    /// The course of the motor where derivatives with respect to the `wanted` parameters are asked for;
    /// `None` where the load sees another phasor than the measured one, so that all depends on all.
    ///
    /// # Errors
    ///
    /// As [`Self::simulate`].
    pub fn motor_course(
        &self,
        parameters: &[f64],
        wanted: &[usize],
        drive: &Drive<'_>,
    ) -> Result<Option<MotorCourse>, SimulationError> {
        self.check(parameters, wanted, drive)?;
        let acting = self.acting(parameters, wanted);
        if !self.sees_the_measured_phasor(&acting) {
            return Ok(None);
        }
        let grid = drive.shared();
        let mut kept = Kept::new(true);
        let course = Course::Integrate(&mut kept);
        self.pass::<f64>(drive, &grid, |i| parameters[i], &acting, course)?;
        Ok(Some(MotorCourse {
            description: self.described(parameters, &acting, drive),
            beside: self.of_course(&acting).map(|i| parameters[i]).collect(),
            grid,
            kept,
        }))
    }

    /// The lowest voltage that the load sees in one event, over that at rest; `None` where it sees the measured phasor.
    ///
    /// # Errors
    ///
    /// As [`Self::simulate`].
    pub fn lowest_voltage_at_load(
        &self,
        parameters: &[f64],
        drive: &Drive<'_>,
    ) -> Result<Option<f64>, SimulationError> {
        self.check(parameters, &[], drive)?;
        let acting = self.acting(parameters, &[]);
        if self.sees_the_measured_phasor(&acting) {
            return Ok(None);
        }
        let mut kept = Kept::new(false);
        let course = Course::Integrate(&mut kept);
        self.pass::<f64>(drive, &drive.shared(), |i| parameters[i], &acting, course)?;
        Ok(Some(kept.lowest_voltage))
    }

    /// The derivatives that [`Self::simulate`] gives (to the accuracy of the integration, whose steps follow
    /// the fastest state of all), at a fraction of its cost. `None`
    /// where the motor would not take this course, or one of the `wanted` parameters acts on states.
    ///
    /// # Errors
    ///
    /// As [`Self::simulate`].
    pub fn derivatives_beside(
        &self,
        motor: &MotorCourse,
        parameters: &[f64],
        wanted: &[usize],
        drive: &Drive<'_>,
    ) -> Result<Option<DerivativeColumns>, SimulationError> {
        self.check(parameters, wanted, drive)?;
        let acting = self.acting(parameters, wanted);
        let beside = wanted.iter().all(|w| self.is_beside_the_states(*w));
        if !beside
            || !self.sees_the_measured_phasor(&acting)
            || self.described(parameters, &acting, drive) != motor.description
            || !self
                .of_course(&acting)
                .map(|i| parameters[i])
                .eq(motor.beside.iter().copied())
        {
            return Ok(None);
        }
        let mut kept = motor.kept.clone();
        kept.forget_effects();
        let course = Course::EffectsAlone(&mut kept);
        self.pass::<f64>(drive, &motor.grid, |i| parameters[i], &acting, course)?;
        let mut columns: DerivativeColumns = [0, 1].map(|_| Vec::with_capacity(wanted.len()));
        for lanes in wanted.chunks(LANES) {
            let course = Course::Replay(&kept);
            let at = (drive, motor.grid.as_ref());
            let found = self.sensitive(at, parameters, lanes, &acting, course)?;
            for (columns, own) in columns.iter_mut().zip(found.columns) {
                columns.extend(own);
            }
        }
        Ok(Some(columns))
    }

    /// Whether the motor depends on a parameter, where the load sees the measured phasor.
    pub(super) fn acts_on_motor(
        &self,
        parameters: &[f64],
        acting: &[usize],
        index: usize,
        drive: &Drive<'_>,
    ) -> bool {
        let variable = |i: usize| {
            let value = parameters[i];
            if i == index {
                Sensitivity::variable(value, 0)
            } else {
                Sensitivity::constant(value)
            }
        };
        let (motor, active) = self.parts(variable, acting);
        let described = describe(drive, motor, &active);
        described.map(|x| x.derivative(0)) != described.map(|_| 0.0)
            || self.of_course(acting).any(|i| i == index)
    }

    /// The parameters of what motors see of the frequency, where that is not what was measured, and of the lag of the
    /// static load: with those of the motor's description all on which the course of the motor and of the lag depends.
    fn of_course(&self, acting: &[usize]) -> impl Iterator<Item = usize> + '_ {
        let at = |e: usize, place: Place| self.effects[e].0.declaration().acts_on(place);
        let acting: Vec<usize> = acting.to_vec();
        let any = acting.iter().any(|&e| at(e, Place::MotorFrequency));
        let of = move |e: &usize| {
            any && (at(*e, Place::MotorFrequency) || at(*e, Place::Frequency))
                || at(*e, Place::StaticLag)
        };
        (acting.into_iter().filter(of)).flat_map(|e| self.effects[e].1.iter().copied())
    }

    /// Whether nothing lies between what is measured and the load.
    pub(super) fn sees_the_measured_phasor(&self, acting: &[usize]) -> bool {
        let others = [Place::Feeder, Place::Gain, Place::Taps];
        let acts = |e: &usize| {
            let declaration = self.effects[*e].0.declaration();
            others.iter().any(|place| declaration.acts_on(*place))
        };
        !acting.iter().any(acts)
    }

    fn described(
        &self,
        parameters: &[f64],
        acting: &[usize],
        drive: &Drive<'_>,
    ) -> MotorDescription<f64> {
        let (motor, active) = self.parts(|i| parameters[i], acting);
        describe(drive, motor, &active)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{
        ComposedModel, Drive, Structure,
        composed::{ModelParameter, contract::a_dip},
        effects::catalogue,
    };

    #[test]
    fn what_is_added_beside_a_known_motor_is_what_a_simulation_gives() {
        let served = agreeing(&Structure::zip_im());
        assert!(served >= 8, "{served} effects");
    }

    #[test]
    fn motors_may_see_another_frequency_than_is_measured() {
        let structure = Structure::zip_im().with("frequency_scaled_power").unwrap();
        let served = agreeing(&structure);
        assert!(served >= 8, "{served} effects");
    }

    #[test]
    fn behind_a_feeder_the_load_sees_what_the_current_leaves() {
        let input = a_dip(0.62, 0.1);
        let deviation = vec![0.0; input.output_count()];
        let reactive_at_rest = 0.3;
        let drive = Drive::new(&input, &deviation, reactive_at_rest);
        let plain = ComposedModel::new(&Structure::zip_im());
        let lowest = |model: &ComposedModel, parameters: &[f64]| {
            model.lowest_voltage_at_load(parameters, &drive).unwrap()
        };
        assert_eq!(lowest(&plain, &plain.typical()), None);

        let structure = Structure::zip_im().with("feeder_impedance").unwrap();
        let model = ComposedModel::new(&structure);
        let mut parameters = model.typical();
        let [r, x] = [0.03, 0.1];
        for (name, value) in [("resistance", r), ("reactance", x)] {
            let place = model.index(&format!("feeder_impedance.{name}")).unwrap();
            parameters[place] = value;
        }
        let run = model.simulate(&parameters, &[], &drive).unwrap();
        // (1) of `feeder` from what the measured bus gives: u - Z conj((P + jQ)/u), over the same at rest.
        let behind = |[re, im]: [f64; 2], p: f64, q: f64| {
            let square = re * re + im * im;
            let current = [(p * re + q * im) / square, (p * im - q * re) / square];
            let load = [
                re - r * current[0] + x * current[1],
                im - r * current[1] - x * current[0],
            ];
            load[0].hypot(load[1])
        };
        let phasors = drive.shared().phasor.clone();
        let powers = run.active.iter().zip(&run.reactive);
        let seen = phasors.iter().zip(powers);
        let expected = seen
            .map(|(u, (p, q))| behind(*u, *p, *q))
            .fold(f64::INFINITY, f64::min);
        let expected = expected / behind([1.0, 0.0], 1.0, reactive_at_rest);
        let found = lowest(&model, &parameters).unwrap();
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        assert!((found - 0.62).abs() > 0.005, "{found}");
    }

    /// The number of effects that are served beside the motor of `structure`, each as a simulation has it.
    fn agreeing(structure: &Structure) -> usize {
        let input = a_dip(0.62, 0.1);
        let deviation = vec![-2e-3; input.output_count()];
        let drive = Drive::new(&input, &deviation, 0.3);
        let mut served = 0;
        for effect in catalogue() {
            let name = effect.declaration().name;
            let Ok(with) = structure.with(name) else {
                continue;
            };
            let model = ComposedModel::new(&with);
            let mut parameters = model.typical();
            for (value, p) in parameters.iter_mut().zip(model.parameters()) {
                if p.effect == Some(name) {
                    *value = p.declaration.neutral;
                }
            }
            let own = |p: &ModelParameter| p.effect == Some(name);
            let amplitudes: Vec<usize> = (0..parameters.len())
                .filter(|i| {
                    let p = &model.parameters()[*i];
                    own(p) && p.declaration.is_amplitude()
                })
                .collect();
            let course = model
                .motor_course(&parameters, &amplitudes, &drive)
                .unwrap();
            // The shapes of the first grid point, not those of the course.
            let motor = crate::load_model::MotorCoordinates {
                alpha_per_s: parameters[0].exp(),
                nu_per_s2: parameters[1].exp(),
                kappa: parameters[2],
            };
            let mut moved = parameters.clone();
            let shapes = (0..parameters.len()).filter(|i| {
                let p = &model.parameters()[*i];
                own(p) && !p.declaration.is_amplitude()
            });
            for (index, value) in shapes.zip(&effect.nuisance_grid(&motor)[0]) {
                moved[index] = *value;
            }
            let simulated = model.simulate(&moved, &amplitudes, &drive).unwrap();
            let Some(course) = course else { continue };
            let beside = model.derivatives_beside(&course, &moved, &amplitudes, &drive);
            let Some([active, reactive]) = beside.unwrap() else {
                continue;
            };
            served += 1;
            let pairs = [
                (active, simulated.active_derivatives),
                (reactive, simulated.reactive_derivatives),
            ];
            for (found, expected) in pairs {
                for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
                    assert!(
                        (found - expected).abs() < 1e-4 * (1.0 + expected.abs()),
                        "{name}: {found} {expected}"
                    );
                }
            }
        }
        served
    }
}
