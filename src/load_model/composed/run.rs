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
struct Simulation<'r, 'a, S> {
    drive: &'r Drive<'r>,
    time_s: &'r [f64],
    rest: Rest<S>,
    linear: [S; LinearCoefficients::COUNT],
    places: Places<'r, 'a, S>,
    network: Option<Network<S>>,
    /// Whether the load sees another phasor than the measured one.
    coupled: bool,
    frequency: Vec<S>,
}

/// What moves during a pass.
#[derive(Clone)]
struct Now<S> {
    motor: MotorState<S>,
    effects: Vec<S>,
    /// Phasor at the load over the measured one.
    ratio: [S; 2],
}

/// An output instant, or somewhere before the next.
#[derive(Clone, Copy)]
struct Moment<S> {
    index: usize,
    /// Frequency deviation, pu.
    deviation: S,
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
        static_constant: [
            -(linear[0] + linear[1] + linear[2]) + 1.0,
            -(linear[0] * motor.rest_power[1] + linear[3] + linear[4]) + drive.reactive_at_rest,
        ],
        synchronous_speed_rad_s: drive.terminal.synchronous_speed_rad_s,
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
    let pass = Simulation {
        drive,
        time_s: &grid.time_s,
        network: feeder.map(|f| Network::new(&f, drive.reactive_at_rest, linear[0], &rest.motor)),
        rest,
        linear,
        places: Places {
            gain: acting(Place::Gain).collect(),
            motor_active: acting(Place::MotorActivePower).collect(),
            power: acting(Place::Power).collect(),
            states: acting(Place::States).collect(),
        },
        coupled: [Place::Gain, Place::Feeder]
            .iter()
            .any(|place| acting(*place).next().is_some()),
        frequency,
    };
    let start = Now {
        motor: motor.rest,
        effects: states,
        ratio: [S::constant(1.0), S::constant(0.0)],
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

impl<S: Pass> Simulation<'_, '_, S> {
    fn integrate(
        &self,
        grid: &Grid,
        mut now: Now<S>,
        rate: f64,
    ) -> Result<Output<S>, SimulationError> {
        let mut output: Output<S> = [0, 1].map(|_| Vec::with_capacity(grid.time_s.len()));
        let terminal = self.drive.terminal;
        for sample in 0..terminal.sample_count() {
            self.emit(grid, &mut now, &mut output)?;
            if sample + 1 == terminal.sample_count() {
                break;
            }
            let (substeps, outputs) = grid.substeps(terminal, sample, rate);
            let duration_s = terminal.sample_interval_s / substeps as f64;
            for j in 0..substeps {
                let u = grid.phasors(terminal, sample, j, substeps);
                let index = output[0].len() - 1;
                if self.coupled {
                    // Substeps since the last output and per output interval.
                    let each = substeps / outputs;
                    let share = |j: usize| (j % each) as f64 / each as f64;
                    let from = self.moment(index, share(j));
                    let to = self.moment(index, share(j) + 1.0 / each as f64);
                    self.advance_coupled(&mut now, u, duration_s, [from, to])?;
                } else {
                    self.advance_bare(&mut now, u, duration_s, index);
                }
                if j + 1 < substeps && ((j + 1) * outputs).is_multiple_of(substeps) {
                    self.emit(grid, &mut now, &mut output)?;
                }
            }
        }
        Ok(output)
    }

    /// The moment `share` of the way from an output instant to the next.
    fn moment(&self, index: usize, share: f64) -> Moment<S> {
        let here = self.frequency[index];
        let next = self.frequency.get(index + 1).map_or(here, |f| *f);
        Moment {
            index,
            deviation: here + (next - here) * share,
        }
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

    /// A step in which the phasor at the load is not the measured one. Behind a feeder it depends on
    /// the load: one step with the ratio of the two held finds the ratio at the end, and a second one
    /// lets the ratio go straight there.
    fn advance_coupled(
        &self,
        now: &mut Now<S>,
        u: [[f64; 2]; 3],
        duration_s: f64,
        [from, to]: [Moment<S>; 2],
    ) -> Result<(), SimulationError> {
        let measured = u.map(|u| u.map(S::constant));
        let (first, last) = if self.network.is_some() {
            let first = now.ratio;
            let mut trial = now.clone();
            self.advance_with(&mut trial, measured, [first; 3], duration_s, from.index);
            (first, self.ratio(&trial, measured[2], to)?)
        } else {
            (self.gain(now, from), self.gain(now, to))
        };
        let middle = complex::sum(first, last).map(|part| part * 0.5);
        let ratios = [first, middle, last];
        self.advance_with(now, measured, ratios, duration_s, from.index);
        now.ratio = last;
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
    fn ratio(&self, now: &Now<S>, u: [S; 2], at: Moment<S>) -> Result<[S; 2], SimulationError> {
        // Below this the phasor has no direction to turn.
        const MODULUS_MIN: f64 = 1e-6;
        let gain = self.gain(now, at);
        let Some(network) = &self.network else {
            return Ok(gain);
        };
        if complex::modulus(u).value() < MODULUS_MIN {
            return Ok(now.ratio);
        }
        let sent = complex::product(u, gain);
        let guess = complex::product(u, now.ratio);
        let own = network
            .load_phasor(sent, guess, |own| self.load_power(now, own, at))
            .ok_or(SimulationError::NoLoadVoltage { output: at.index })?;
        Ok(complex::quotient(own, u))
    }

    /// What tap changers and the like make of the phasor.
    fn gain(&self, now: &Now<S>, at: Moment<S>) -> [S; 2] {
        let none = [S::constant(1.0), S::constant(0.0)];
        self.places.gain.iter().fold(none, |product, e| {
            let own = e.own(&now.effects);
            let gain = e
                .equations
                .gain(&e.parameters, own, at.deviation, &self.rest);
            complex::product(product, gain)
        })
    }

    fn emit(
        &self,
        grid: &Grid,
        now: &mut Now<S>,
        output: &mut Output<S>,
    ) -> Result<(), SimulationError> {
        let index = output[0].len();
        let at = self.moment(index, 0.0);
        let u = grid.phasor[index].map(S::constant);
        let [active, reactive] = if self.coupled {
            now.ratio = self.ratio(now, u, at)?;
            let own = complex::product(u, now.ratio);
            let load = self.load_power(now, own, at);
            self.network.as_ref().map_or(load, |network| {
                network.power(complex::product(u, self.gain(now, at)), own, load)
            })
        } else {
            let voltage = S::constant(grid.voltage[index]);
            let motor = self.rest.motor.power(&now.motor, grid.phasor[index]);
            self.power(now, u, voltage, motor, at)
        };
        output[0].push(active);
        output[1].push(reactive);
        Ok(())
    }

    /// Power over P0 of a load that sees `own`, as if it were at the measured bus.
    fn load_power(&self, now: &Now<S>, own: [S; 2], at: Moment<S>) -> [S; 2] {
        let motor = self.rest.motor.power(&now.motor, own);
        self.power(now, own, complex::modulus(own), motor, at)
    }

    fn power(
        &self,
        now: &Now<S>,
        phasor: [S; 2],
        voltage: S,
        motor: [S; 2],
        moment: Moment<S>,
    ) -> [S; 2] {
        let [share, c_z, c_i, d_z, d_i] = self.linear;
        let deviation = moment.deviation;
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
        let mut reactive = share * (motor[1] - self.rest.motor.rest_power[1])
            + (d_z * square + d_i * line)
            + self.rest.reactive;
        if !self.places.power.is_empty() {
            let at = Instant {
                time_s: self.time_s[moment.index],
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
