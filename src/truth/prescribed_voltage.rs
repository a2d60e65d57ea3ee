//! A composite load at a voltage that is given, not made by a network: problems whose input is known
//! exactly, for studies of the estimator alone.

use super::{
    IntegratorOptions, MotorCircuit, Phasor, TruthError, Zip,
    integrator::Integrator,
    load::{Load, Part, Supply, Terminal},
    parts::{Motor, StaticLoad},
};

/// Motors that share a circuit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorGroup {
    /// Circuit and loading.
    pub circuit: MotorCircuit,
    /// Active power before the event, pu of the load base.
    pub active_pu: f64,
}

/// A load and its operating point.
#[derive(Clone, Debug, PartialEq)]
pub struct CompositeLoad {
    /// Motors.
    pub motors: Vec<MotorGroup>,
    /// Shares of the rest.
    pub zip: Zip,
    /// All power drawn before the event, pu of the load base.
    pub initial: Phasor,
    /// Nominal frequency, Hz.
    pub nominal_hz: f64,
}

/// Voltage on a uniform grid, a straight line between neighbours; the first is the voltage at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrescribedVoltage<'a> {
    /// Phasors in the frame of the nominal frequency, pu.
    pub phasors: &'a [Phasor],
    /// Distance of neighbours, s.
    pub interval_s: f64,
}

/// What a load draws.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadResponse {
    /// Complex power at the instants asked for, pu of the load base.
    pub power: Vec<Phasor>,
    /// Lowest speed of any motor over its nominal speed; 1 without motors. Below 0 a motor that
    /// stalled has been turned backwards by its constant torque, which no drive does.
    pub lowest_speed_pu: f64,
}

/// Power drawn at every `stride`-th point of the grid, the first included.
///
/// Cost: at least one step of Dormand and Prince's method per interval of the grid.
///
/// # Errors
///
/// [`TruthError::OptionOutOfRange`] for an empty grid or a stride of 0,
/// [`TruthError::NoEquilibrium`] when a motor cannot carry its power at the first voltage,
/// [`TruthError::StepTooSmall`].
pub fn respond(
    load: &CompositeLoad,
    voltage: &PrescribedVoltage<'_>,
    stride: usize,
    options: IntegratorOptions,
) -> Result<LoadResponse, TruthError> {
    let Some(&first) = voltage.phasors.first().filter(|_| stride > 0) else {
        return Err(TruthError::OptionOutOfRange {
            option: "grid points and stride",
            given: 0.0,
            required: "at least 1",
        });
    };
    let parts = load.parts(first)?;
    let nominal_rad_s = load.nominal_rad_s();
    let mut state = parts.initial_state();
    let mut integrator = Integrator::new(options, state.len());
    let mut response = LoadResponse {
        power: vec![drawn(&parts, 0.0, first, &state)],
        lowest_speed_pu: 1.0,
    };
    for (k, ends) in voltage.phasors.windows(2).enumerate() {
        let (from_s, to_s) = (
            k as f64 * voltage.interval_s,
            (k + 1) as f64 * voltage.interval_s,
        );
        integrator.advance((from_s, to_s), &mut state, &mut |time_s, state, slope| {
            let share = (time_s - from_s) / voltage.interval_s;
            let voltage = ends[0] + (ends[1] - ends[0]) * share;
            parts.derivatives(Terminal { time_s, voltage }, state, slope);
            Ok(())
        })?;
        // States of a motor: flux, its angle, speed.
        let speeds = state.chunks_exact(3).map(|motor| motor[2] / nominal_rad_s);
        response.lowest_speed_pu = speeds.fold(response.lowest_speed_pu, f64::min);
        if (k + 1).is_multiple_of(stride) {
            response.power.push(drawn(&parts, to_s, ends[1], &state));
        }
    }
    Ok(response)
}

fn drawn(load: &Load, time_s: f64, voltage: Phasor, state: &[f64]) -> Phasor {
    voltage * load.current(Terminal { time_s, voltage }, state).conj()
}

impl CompositeLoad {
    fn nominal_rad_s(&self) -> f64 {
        std::f64::consts::TAU * self.nominal_hz
    }

    /// The parts at rest: motors first, static load with what they leave.
    fn parts(&self, voltage: Phasor) -> Result<Load, TruthError> {
        let mut parts: Vec<Box<dyn Part + Send>> = Vec::new();
        let mut rest = self.initial;
        for group in &self.motors {
            let motor = Motor::at_operating_point(
                group.circuit,
                group.active_pu,
                voltage,
                self.nominal_rad_s(),
            )?;
            let at_rest = Terminal {
                time_s: 0.0,
                voltage,
            };
            rest -= voltage * motor.current(at_rest, &motor.initial_state()).conj();
            parts.push(Box::new(motor));
        }
        parts.push(Box::new(StaticLoad::plain(self.zip, voltage, rest)));
        Ok(Load {
            supply: Supply::NONE,
            parts,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load() -> CompositeLoad {
        CompositeLoad {
            motors: vec![MotorGroup {
                circuit: MotorCircuit::default(),
                active_pu: 0.4,
            }],
            zip: Zip {
                active_impedance: 0.4,
                active_current: 0.4,
                reactive_impedance: 0.8,
                reactive_current: 0.1,
            },
            initial: Phasor::new(0.9, 0.3),
            nominal_hz: 60.0,
        }
    }

    fn run(phasors: &[Phasor], interval_s: f64, stride: usize) -> LoadResponse {
        let voltage = PrescribedVoltage {
            phasors,
            interval_s,
        };
        respond(&load(), &voltage, stride, IntegratorOptions::default()).unwrap()
    }

    #[test]
    fn a_constant_voltage_leaves_the_power_where_it_was() {
        let response = run(&[Phasor::from_polar(0.98, 0.1); 201], 5e-3, 50);
        assert_eq!(response.power.len(), 5);
        for power in &response.power {
            assert!((power - Phasor::new(0.9, 0.3)).norm() < 1e-9, "{power}");
        }
        assert!(response.lowest_speed_pu > 0.97 && response.lowest_speed_pu < 1.0);
    }

    #[test]
    fn a_finer_grid_of_the_same_straight_lines_changes_nothing() {
        let corner = |t: f64| match t {
            t if t < 0.1 => 1.0,
            t if t < 0.15 => 1.0 - 8.0 * (t - 0.1),
            _ => 0.6,
        };
        let grid = |n: usize| -> Vec<Phasor> {
            (0..=n)
                .map(|k| Phasor::new(corner(0.3 * k as f64 / n as f64), 0.0))
                .collect()
        };
        let coarse = run(&grid(60), 0.005, 60).power[1];
        let fine = run(&grid(240), 0.001_25, 240).power[1];
        assert!((coarse - fine).norm() < 1e-8, "{coarse} {fine}");
        assert!((coarse - Phasor::new(0.9, 0.3)).norm() > 0.05, "{coarse}");
    }

    #[test]
    fn an_empty_grid_is_refused() {
        let voltage = PrescribedVoltage {
            phasors: &[],
            interval_s: 1e-3,
        };
        let error = respond(&load(), &voltage, 1, IntegratorOptions::default()).unwrap_err();
        assert!(matches!(error, TruthError::OptionOutOfRange { .. }));
    }
}
