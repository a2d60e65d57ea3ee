//! One pass over the input with one scalar: states by fixed steps, power at the output instants,
//! then the instrument.

use super::{
    Drive, Feeder, Instant, MotorDescription, Rest, Series, SimulationError, Step, complex,
    feeder::Network,
    grid::Grid,
    motor::{Motor, MotorState},
};
use crate::{
    load_model::{
        LinearCoefficients, MotorCoordinates,
        effect::{Declaration, Effect, Equations, Place, Sensitivity},
    },
    numerics::Elementary,
};

/// The two scalars of a simulation.
pub(super) trait Pass: Elementary + 'static {
    fn equations(effect: &dyn Effect) -> &dyn Equations<Self>;
}

impl Pass for f64 {
    fn equations(effect: &dyn Effect) -> &dyn Equations<Self> {
        effect.plain()
    }
}

impl Pass for Sensitivity {
    fn equations(effect: &dyn Effect) -> &dyn Equations<Self> {
        effect.with_sensitivities()
    }
}

/// An effect that takes part in a pass.
pub(super) struct Active<'a, S> {
    declaration: &'static Declaration,
    equations: &'a dyn Equations<S>,
    parameters: Vec<S>,
    first_state: usize,
}

impl<'a, S: Pass> Active<'a, S> {
    /// With its parameters; its states come after `first_state` others.
    pub(super) fn new(effect: &'a dyn Effect, parameters: Vec<S>, first_state: usize) -> Self {
        Self {
            declaration: effect.declaration(),
            equations: S::equations(effect),
            parameters,
            first_state,
        }
    }

    /// One past the last of its states.
    pub(super) fn end(&self) -> usize {
        self.first_state + self.declaration.states.len()
    }

    fn own<'s>(&self, states: &'s [S]) -> &'s [S] {
        states.get(self.first_state..self.end()).unwrap_or(&[])
    }
}

/// The effects of a pass by the place where they act.
struct Places<'r, 'a, S> {
    gain: Vec<&'r Active<'a, S>>,
    motor_active: Vec<&'r Active<'a, S>>,
    power: Vec<&'r Active<'a, S>>,
    states: Vec<&'r Active<'a, S>>,
}

/// All that stays the same during a pass.
struct Pass1<'r, 'a, S> {
    drive: &'r Drive<'r>,
    rest: Rest<S>,
    linear: [S; LinearCoefficients::COUNT],
    places: Places<'r, 'a, S>,
    network: Option<Network<S>>,
    frequency: Vec<S>,
    slope_rest: S,
}

/// What moves during a pass.
#[derive(Clone)]
struct Now<S> {
    motor: MotorState<S>,
    effects: Vec<S>,
}

/// Active and reactive power over P0 at the output instants.
pub(super) type Output<S> = [Vec<S>; 2];

/// Simulates with the base parameters (motor coordinates and linear coefficients) and effects.
pub(super) fn run<S: Pass>(
    drive: &Drive<'_>,
    grid: &Grid,
    motor: MotorCoordinates<S>,
    linear: [S; LinearCoefficients::COUNT],
    effects: &[Active<'_, S>],
) -> Result<Output<S>, SimulationError> {
    let acting = |place: Place| effects.iter().filter(move |e| e.declaration.acts_on(place));
    let mut description = MotorDescription::new(motor, drive.terminal.synchronous_speed_rad_s);
    for e in acting(Place::Motor) {
        e.equations.motor(&e.parameters, &mut description);
    }
    let motor = Motor::new(&description)?;
    let rest = Rest {
        reactive: drive.reactive_at_rest,
        motor_share: linear[0],
        motor,
        sample_interval_s: drive.terminal.sample_interval_s,
    };
    let mut frequency: Vec<S> = frequency_series(drive, grid);
    for e in acting(Place::Frequency) {
        e.equations
            .frequency(&e.parameters, &grid.time_s, &mut frequency);
    }
    let feeder: Option<Feeder<S>> = acting(Place::Feeder)
        .next()
        .map(|e| e.equations.feeder(&e.parameters));
    let mut states = vec![S::constant(0.0); effects.last().map_or(0, Active::end)];
    for e in acting(Place::States) {
        let own = states.get_mut(e.first_state..e.end()).unwrap_or(&mut []);
        e.equations.initialise(&e.parameters, &rest, own)?;
    }
    let rate = acting(Place::States)
        .map(|e| e.equations.rate_per_s(&e.parameters))
        .fold(motor.rate_per_s(), f64::max);
    let pass = Pass1 {
        drive,
        slope_rest: motor.rest_power[1],
        network: feeder.map(|f| Network::new(&f, drive.reactive_at_rest, linear[0], &rest.motor)),
        rest,
        linear,
        places: Places {
            gain: acting(Place::Gain).collect(),
            motor_active: acting(Place::MotorActivePower).collect(),
            power: acting(Place::Power).collect(),
            states: acting(Place::States).collect(),
        },
        frequency,
    };
    let start = Now {
        motor: motor.rest,
        effects: states,
    };
    let mut output = pass.integrate(grid, start, rate)?;
    let [active, reactive] = &mut output;
    let mut series = Series {
        time_s: &grid.time_s,
        jump: &grid.jump,
        phasor: &grid.phasor,
        reactive_at_rest: drive.reactive_at_rest,
        active,
        reactive,
    };
    for e in acting(Place::Measurement) {
        e.equations.measure(&e.parameters, &mut series);
    }
    match output.iter().flatten().position(|y| !y.value().is_finite()) {
        None => Ok(output),
        Some(index) => Err(SimulationError::NotFinite {
            output: index % grid.time_s.len(),
        }),
    }
}

fn frequency_series<S: Elementary>(drive: &Drive<'_>, grid: &Grid) -> Vec<S> {
    if drive.frequency_deviation.is_empty() {
        return vec![S::constant(0.0); grid.time_s.len()];
    }
    drive
        .frequency_deviation
        .iter()
        .map(|f| S::constant(*f))
        .collect()
}

impl<S: Pass> Pass1<'_, '_, S> {
    fn integrate(
        &self,
        grid: &Grid,
        mut now: Now<S>,
        rate: f64,
    ) -> Result<Output<S>, SimulationError> {
        let mut output: Output<S> = [0, 1].map(|_| Vec::with_capacity(grid.time_s.len()));
        let bare = self.network.is_none() && self.places.gain.is_empty();
        let terminal = self.drive.terminal;
        for sample in 0..terminal.sample_count() {
            self.emit(grid, &now, &mut output)?;
            if sample + 1 == terminal.sample_count() {
                break;
            }
            let (substeps, outputs) = grid.substeps(terminal, sample, rate);
            let duration_s = terminal.sample_interval_s / substeps as f64;
            for j in 0..substeps {
                let u = grid.phasors(terminal, sample, j, substeps);
                let index = output[0].len() - 1;
                if bare {
                    self.advance_bare(&mut now, u, duration_s, index);
                } else {
                    self.advance_coupled(&mut now, u, duration_s, index)?;
                }
                if j + 1 < substeps && ((j + 1) * outputs).is_multiple_of(substeps) {
                    self.emit(grid, &now, &mut output)?;
                }
            }
        }
        Ok(output)
    }

    /// A step in which the load sees the measured phasor.
    fn advance_bare(&self, now: &mut Now<S>, u: [[f64; 2]; 3], duration_s: f64, index: usize) {
        if !self.places.states.is_empty() {
            let phasor = u.map(|u| u.map(S::constant));
            let voltage = u.map(|[re, im]| S::constant((re * re + im * im).sqrt()));
            self.advance_effects(now, phasor, voltage, duration_s, index);
        }
        now.motor = self.rest.motor.step(&now.motor, u, duration_s);
    }

    fn advance_effects(
        &self,
        now: &mut Now<S>,
        phasor: [[S; 2]; 3],
        voltage: [S; 3],
        duration_s: f64,
        index: usize,
    ) {
        let step = Step {
            duration_s,
            phasor,
            voltage,
            frequency_deviation: self.frequency[index],
        };
        for e in &self.places.states {
            if let Some(own) = now.effects.get_mut(e.first_state..e.end()) {
                e.equations.advance(&e.parameters, own, &step, &self.rest);
            }
        }
    }

    /// A step in which the phasor at the load depends on the load: once with the ratio of the two
    /// held, to find the ratio at the end, and once with the ratio going straight there.
    fn advance_coupled(
        &self,
        now: &mut Now<S>,
        u: [[f64; 2]; 3],
        duration_s: f64,
        index: usize,
    ) -> Result<(), SimulationError> {
        let measured = u.map(|u| u.map(S::constant));
        let first = self.ratio(now, measured[0], index)?;
        let mut trial = now.clone();
        self.advance_with(&mut trial, measured, [first; 3], duration_s, index);
        let last = self.ratio(&trial, measured[2], index)?;
        let middle = complex::sum(first, last).map(|part| part * 0.5);
        self.advance_with(now, measured, [first, middle, last], duration_s, index);
        Ok(())
    }

    fn advance_with(
        &self,
        now: &mut Now<S>,
        measured: [[S; 2]; 3],
        ratio: [[S; 2]; 3],
        duration_s: f64,
        index: usize,
    ) {
        let phasor = [0, 1, 2].map(|i| complex::product(measured[i], ratio[i]));
        let voltage = phasor.map(complex::modulus);
        self.advance_effects(now, phasor, voltage, duration_s, index);
        now.motor = self.rest.motor.step(&now.motor, phasor, duration_s);
    }

    /// Phasor at the load over the measured one.
    fn ratio(&self, now: &Now<S>, u: [S; 2], index: usize) -> Result<[S; 2], SimulationError> {
        // Below this the phasor has no direction to turn.
        const MODULUS_MIN: f64 = 1e-6;
        if complex::modulus(u).value() < MODULUS_MIN {
            return Ok([S::constant(1.0), S::constant(0.0)]);
        }
        let own = self.load_phasor(now, u, index)?;
        Ok(complex::quotient(own, u))
    }

    fn load_phasor(
        &self,
        now: &Now<S>,
        u: [S; 2],
        index: usize,
    ) -> Result<[S; 2], SimulationError> {
        let sent = self.sent(now, u, index);
        let Some(network) = &self.network else {
            return Ok(sent);
        };
        network
            .load_phasor(sent, sent, |own| self.load_power(now, own, index, 0.0))
            .ok_or(SimulationError::NoLoadVoltage { output: index })
    }

    /// The phasor after tap changer and the like.
    fn sent(&self, now: &Now<S>, u: [S; 2], index: usize) -> [S; 2] {
        self.places.gain.iter().fold(u, |u, e| {
            let own = e.own(&now.effects);
            let gain = e.equations.gain(&e.parameters, own, self.frequency[index]);
            complex::product(u, gain)
        })
    }

    fn emit(
        &self,
        grid: &Grid,
        now: &Now<S>,
        output: &mut Output<S>,
    ) -> Result<(), SimulationError> {
        let index = output[0].len();
        let u = grid.phasor[index].map(S::constant);
        let time_s = grid.time_s[index];
        let [active, reactive] = if self.network.is_none() && self.places.gain.is_empty() {
            let voltage = S::constant(grid.voltage[index]);
            let motor = self.rest.motor.power(&now.motor, grid.phasor[index]);
            self.power(now, u, voltage, motor, index, time_s)
        } else {
            let own = self.load_phasor(now, u, index)?;
            let load = self.load_power(now, own, index, time_s);
            match &self.network {
                None => load,
                Some(network) => network.power(self.sent(now, u, index), own, load),
            }
        };
        output[0].push(active);
        output[1].push(reactive);
        Ok(())
    }

    /// Power over P0 of a load that sees `own`, as if it were at the measured bus.
    fn load_power(&self, now: &Now<S>, own: [S; 2], index: usize, time_s: f64) -> [S; 2] {
        let motor = self.rest.motor.power(&now.motor, own);
        self.power(now, own, complex::modulus(own), motor, index, time_s)
    }

    fn power(
        &self,
        now: &Now<S>,
        phasor: [S; 2],
        voltage: S,
        motor: [S; 2],
        index: usize,
        time_s: f64,
    ) -> [S; 2] {
        let [share, c_z, c_i, d_z, d_i] = self.linear;
        let deviation = self.frequency[index];
        let factor = self
            .places
            .motor_active
            .iter()
            .map(|e| e.equations.motor_active_factor(&e.parameters, deviation))
            .reduce(|x, y| x * y);
        let motor_active = factor.map_or(motor[0], |f| motor[0] * f);
        let square = voltage * voltage + -1.0;
        let line = voltage + -1.0;
        let from_voltage = c_z * square + c_i * line;
        let excess = motor_active - self.rest.motor.rest_power[0];
        let mut active = share * excess + from_voltage + 1.0;
        let mut reactive =
            share * (motor[1] - self.slope_rest) + (d_z * square + d_i * line) + self.rest.reactive;
        if !self.places.power.is_empty() {
            let at = Instant {
                time_s,
                phasor,
                voltage,
                frequency_deviation: deviation,
                motor: [
                    motor_active,
                    motor[1] + self.rest.motor.susceptance * voltage * voltage,
                ],
                motor_active_factor: factor.unwrap_or(S::constant(1.0)),
                static_active: from_voltage + 1.0 - share,
            };
            for e in &self.places.power {
                let own = e.own(&now.effects);
                let [p, q] = e.equations.power(&e.parameters, own, &at, &self.rest);
                active = active + p;
                reactive = reactive + q;
            }
        }
        [active, reactive]
    }
}
