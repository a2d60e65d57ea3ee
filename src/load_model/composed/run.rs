//! One pass over the input with one scalar: states by fixed steps, power at the output instants,
//! then the instrument.

mod now;

pub(super) use now::Now;

use super::{
    Drive, Instant, Rest, SimulationError, Step,
    active::{Active, Pass},
    at_rest::{at_load, at_rest},
    complex,
    feeder::{Network, Solution, Way},
    grid::Grid,
    kept::Kept,
    places::{Acting, Places, product},
    series::{View, frequency_series, measure, seen},
    static_lag::StaticLag,
};
use crate::load_model::{LinearCoefficients, MotorCoordinates, effect::Place};

/// How a pass comes to its states.
pub(super) enum Course<'k> {
    /// By integration, which takes from the passes before what it needs, and adds what those after it
    /// may need.
    Integrate(&'k mut Kept),
    /// The motor as it was in a pass before, the effects by integration: for derivatives by what does not
    /// act on the motor, where the load sees the measured phasor.
    BesideMotor(&'k mut Kept),
    /// The same for the states of the effects alone, no power asked for: they are kept.
    EffectsAlone(&'k mut Kept),
    /// As they were in a pass before: for derivatives by what does not act on them.
    Replay(&'k Kept),
}

/// What of a model an integration goes through.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    All,
    /// All but the motor, whose states at the output instants are kept.
    Beside,
    /// The states of the effects, without the power.
    Effects,
}

/// All that stays the same during a pass.
struct Simulation<'r, 'a, S> {
    drive: &'r Drive<'r>,
    time_s: &'r [f64],
    rest: Rest<S>,
    linear: [S; LinearCoefficients::COUNT],
    places: Places<'r, 'a, S>,
    network: Option<Network<S>>,
    lag: Option<StaticLag<S>>,
    /// Whether the load sees another phasor than the measured one.
    coupled: bool,
    frequency: Vec<S>,
    /// Solutions at the load that a pass before has found, in order.
    known: Vec<Solution>,
    /// What motors see of the frequency; none where it is what was measured.
    seen: Option<Vec<View<S>>>,
}

/// An output instant, or somewhere before the next.
#[derive(Clone, Copy)]
struct Moment<S> {
    index: usize,
    /// How far it is to the next, 0 to 1.
    share: f64,
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
    course: Course<'_>,
) -> Result<Output<S>, SimulationError> {
    let linear = at_load(drive, linear, effects);
    let rest = at_rest(drive, motor, linear, effects)?;
    let mut acting = Vec::with_capacity(effects.len());
    for effect in effects {
        let own_motor = effect.equations.own_motor(&effect.parameters, &rest)?;
        let rest = Rest { own_motor, ..rest };
        acting.push(Acting { effect, rest });
    }
    let at = |place: Place| acting.iter().filter(move |e| e.acts_on(place));
    let mut frequency: Vec<S> = frequency_series(drive, grid);
    for e in at(Place::Frequency) {
        e.equations()
            .frequency(e.parameters(), &grid.time_s, &mut frequency);
    }
    let network = at(Place::Feeder).next().map(|e| {
        let feeder = e.equations().feeder(e.parameters());
        Network::new(&feeder, drive.reactive_at_rest, linear[0], &rest.motor)
    });
    let mut states = vec![S::constant(0.0); effects.last().map_or(0, Active::end)];
    for e in at(Place::States) {
        let own = e.effect.first_state..e.effect.end();
        let own = states.get_mut(own).unwrap_or(&mut []);
        e.equations().initialise(e.parameters(), &e.rest, own)?;
    }
    let mut simulation = Simulation {
        drive,
        time_s: &grid.time_s,
        coupled: network.is_some() || at(Place::Gain).chain(at(Place::Taps)).next().is_some(),
        network,
        lag: at(Place::StaticLag).next().map(StaticLag::new),
        seen: seen(drive, grid, &frequency, effects),
        rest,
        linear,
        places: Places {
            gain: at(Place::Gain).collect(),
            taps: at(Place::Taps).collect(),
            power: at(Place::Power).collect(),
            states: at(Place::States).collect(),
        },
        frequency,
        known: Vec::new(),
    };
    let start = Now::at_rest(rest.motor.rest, states);
    let mut output = match course {
        Course::Integrate(kept) => {
            simulation.known = std::mem::take(&mut kept.solutions);
            let output = simulation.integrate(grid, start, kept, Part::All)?;
            if kept.solutions.is_empty() {
                kept.solutions = std::mem::take(&mut simulation.known);
            }
            output
        }
        Course::BesideMotor(kept) => simulation.integrate(grid, start, kept, Part::Beside)?,
        Course::EffectsAlone(kept) => {
            if simulation.places.states.is_empty() {
                kept.close();
                return Ok([Vec::new(), Vec::new()]);
            }
            return simulation.integrate(grid, start, kept, Part::Effects);
        }
        Course::Replay(kept) => simulation.replay(grid, start, kept)?,
    };
    measure(drive, grid, effects, &mut output);
    match output.iter().flatten().position(|y| !y.value().is_finite()) {
        None => Ok(output),
        Some(index) => Err(SimulationError::NotFinite {
            output: index % grid.time_s.len(),
        }),
    }
}

/// Phasors of a step as constants.
#[inline]
fn constants<S: Pass>(u: [[f64; 2]; 3]) -> [[S; 2]; 3] {
    [
        complex::constant(u[0]),
        complex::constant(u[1]),
        complex::constant(u[2]),
    ]
}

/// A ratio at the beginning, in the middle and at the end of a step that goes straight.
#[inline]
fn straight<S: Pass>(first: [S; 2], last: [S; 2]) -> [[S; 2]; 3] {
    let middle = [(first[0] + last[0]) * 0.5, (first[1] + last[1]) * 0.5];
    [first, middle, last]
}

impl<S: Pass> Simulation<'_, '_, S> {
    /// By fixed steps.
    fn integrate(
        &self,
        grid: &Grid,
        mut now: Now<S>,
        kept: &mut Kept,
        part: Part,
    ) -> Result<Output<S>, SimulationError> {
        let instants = if part == Part::Effects {
            0
        } else {
            grid.time_s.len()
        };
        let mut output: Output<S> = [0, 1].map(|_| Vec::with_capacity(instants));
        let mut trial = now.clone();
        let terminal = self.drive.terminal;
        // Output instants so far.
        let mut passed = 0;
        let mut emit = |now: &mut Now<S>, output: &mut Output<S>, passed: &mut usize| {
            let index = *passed;
            *passed += 1;
            if part == Part::All {
                kept.keep(now);
            } else {
                kept.restore_motor(index, now);
                kept.keep_effects(now);
            }
            if part == Part::Effects {
                return Ok(());
            }
            self.emit(grid, now, output)
        };
        for sample in 0..terminal.sample_count() {
            emit(&mut now, &mut output, &mut passed)?;
            if sample + 1 == terminal.sample_count() {
                break;
            }
            let (substeps, outputs) = grid.substeps(terminal, sample, self.rate_per_s(&now));
            let duration_s = terminal.sample_interval_s / substeps as f64;
            for j in 0..substeps {
                let u = grid.phasors(terminal, sample, j, substeps);
                let index = passed - 1;
                // Substeps since the last output and per output interval.
                let each = substeps / outputs;
                let shares = [j % each, j % each + 1].map(|j| j as f64 / each as f64);
                if self.coupled {
                    let between = shares.map(|share| self.moment(index, share));
                    self.advance_coupled([&mut now, &mut trial], u, duration_s, between)?;
                    if terminal.jumps[sample] {
                        now.way = Way::UNKNOWN;
                    }
                } else {
                    self.advance_bare(&mut now, u, duration_s, (index, shares), part);
                }
                if j + 1 < substeps && ((j + 1) * outputs).is_multiple_of(substeps) {
                    emit(&mut now, &mut output, &mut passed)?;
                }
            }
        }
        kept.close();
        kept.solutions = now.solutions;
        kept.lowest_voltage = now.lowest_voltage;
        Ok(output)
    }

    /// The output for states that a pass before has been through.
    fn replay(
        &self,
        grid: &Grid,
        mut now: Now<S>,
        kept: &Kept,
    ) -> Result<Output<S>, SimulationError> {
        let mut output: Output<S> = [0, 1].map(|_| Vec::with_capacity(grid.time_s.len()));
        for index in 0..grid.time_s.len() {
            kept.restore(index, &mut now);
            self.emit(grid, &mut now, &mut output)?;
        }
        Ok(output)
    }

    /// The fastest rate of all states, 1/s.
    fn rate_per_s(&self, now: &Now<S>) -> f64 {
        let effects = self.places.states.iter().map(|e| {
            let own = e.own(&now.effects);
            e.equations().rate_per_s(e.parameters(), own, &e.rest)
        });
        effects.fold(self.rest.motor.rate_per_s(&now.motor), f64::max)
    }

    /// The moment `share` of the way from an output instant to the next.
    fn moment(&self, index: usize, share: f64) -> Moment<S> {
        let here = self.frequency[index];
        let next = self.frequency.get(index + 1).map_or(here, |f| *f);
        Moment {
            index,
            share,
            deviation: here + (next - here) * share,
        }
    }

    /// A step in which the load sees the measured phasor, its ends at these shares of the output interval.
    fn advance_bare(
        &self,
        now: &mut Now<S>,
        u: [[f64; 2]; 3],
        duration_s: f64,
        (index, shares): (usize, [f64; 2]),
        part: Part,
    ) {
        let own = (self.seen.as_ref()).map(|_| self.seen_phasors(constants(u), index, shares));
        let voltage = || u.map(|[re, im]| (re * re + im * im).sqrt());
        if !self.places.states.is_empty() {
            let phasor = constants(u);
            let motor_phasor = own.unwrap_or(phasor);
            let voltage = voltage().map(S::constant);
            self.advance_effects(now, [phasor, motor_phasor], voltage, duration_s, index);
        }
        if part == Part::All {
            if let Some(lag) = &self.lag {
                now.lagged = lag.advanced_measured(now.lagged, voltage(), duration_s);
            }
            let motor = &self.rest.motor;
            now.motor = match own {
                Some(own) => motor.step(&now.motor, own, duration_s),
                None => motor.measured_step(&now.motor, u, duration_s),
            };
        }
    }

    fn advance_effects(
        &self,
        now: &mut Now<S>,
        [phasor, motor_phasor]: [[[S; 2]; 3]; 2],
        voltage: [S; 3],
        duration_s: f64,
        index: usize,
    ) {
        let step = Step {
            duration_s,
            phasor,
            motor_phasor,
            voltage,
            frequency_deviation: self.frequency[index],
        };
        for e in &self.places.states {
            let own = e.effect.first_state..e.effect.end();
            if let Some(own) = now.effects.get_mut(own) {
                e.equations().advance(e.parameters(), own, &step, &e.rest);
            }
        }
    }

    /// A step in which the phasor at the load is not the measured one. Behind a feeder it depends on
    /// the load: the ratio of the two goes on its way. Where that is not known one step with the ratio held finds it at the
    /// end, and a second one lets it go straight there.
    fn advance_coupled(
        &self,
        [now, trial]: [&mut Now<S>; 2],
        u: [[f64; 2]; 3],
        duration_s: f64,
        [from, to]: [Moment<S>; 2],
    ) -> Result<(), SimulationError> {
        let measured = constants(u);
        let between = [from, to];
        if self.network.is_none() {
            let [first, last] = between.map(|at| self.gains(now, at));
            let ratios = straight(first, last);
            self.advance_with(now, measured, ratios, duration_s, between);
            now.ratio = last;
            return Ok(());
        }
        let first = now.ratio;
        if let Some([middle, last]) = now.way.ahead(first, duration_s) {
            self.advance_with(now, measured, [first, middle, last], duration_s, between);
            now.ratio = self.ratio(now, measured[2], to)?;
            now.settled = true;
        } else {
            trial.exchange(now);
            self.advance_with(trial, measured, [first; 3], duration_s, between);
            let last = self.ratio(trial, measured[2], to)?;
            now.secant = trial.secant;
            now.looked_for = trial.looked_for;
            std::mem::swap(&mut now.solutions, &mut trial.solutions);
            let ratios = straight(first, last);
            self.advance_with(now, measured, ratios, duration_s, between);
            now.ratio = last;
            now.settled = false;
        }
        now.way.add(first, duration_s);
        Ok(())
    }

    fn advance_with(
        &self,
        now: &mut Now<S>,
        measured: [[S; 2]; 3],
        ratio: [[S; 2]; 3],
        duration_s: f64,
        [from, to]: [Moment<S>; 2],
    ) {
        let phasor = [
            complex::product(measured[0], ratio[0]),
            complex::product(measured[1], ratio[1]),
            complex::product(measured[2], ratio[2]),
        ];
        let motor_phasor = self.seen_phasors(phasor, from.index, [from.share, to.share]);
        if self.lag.is_some() || !self.places.states.is_empty() {
            let voltage = [
                complex::modulus(phasor[0]),
                complex::modulus(phasor[1]),
                complex::modulus(phasor[2]),
            ];
            if let Some(lag) = &self.lag {
                now.lagged = lag.advanced(now.lagged, voltage, duration_s);
            }
            if !self.places.states.is_empty() {
                self.advance_effects(now, [phasor, motor_phasor], voltage, duration_s, from.index);
            }
        }
        now.motor = self.rest.motor.step(&now.motor, motor_phasor, duration_s);
    }

    /// The phasors of a step as motors see them; its ends lie at these shares of the output interval.
    fn seen_phasors(&self, phasor: [[S; 2]; 3], index: usize, [from, to]: [f64; 2]) -> [[S; 2]; 3] {
        let Some(seen) = &self.seen else {
            return phasor;
        };
        let first = seen[index].turn;
        let last = seen.get(index + 1).map_or(first, |view| view.turn);
        let shares = [from, 0.5 * (from + to), to];
        [0, 1, 2].map(|i| {
            let part = |k: usize| first[k] + (last[k] - first[k]) * shares[i];
            complex::product(phasor[i], [part(0), part(1)])
        })
    }

    /// Power of the motor, and the phasor that it sees, at an output instant.
    fn motor_power(&self, now: &Now<S>, phasor: [S; 2], index: usize) -> ([S; 2], [S; 2]) {
        let motor = &self.rest.motor;
        match &self.seen {
            None => (motor.power(&now.motor, phasor), phasor),
            Some(seen) => {
                let View { turn, factor } = seen[index];
                let own = complex::product(phasor, turn);
                (motor.power(&now.motor, own).map(|part| part * factor), own)
            }
        }
    }

    /// Phasor at the load over the measured one.
    fn ratio(&self, now: &mut Now<S>, u: [S; 2], at: Moment<S>) -> Result<[S; 2], SimulationError> {
        // Below this the phasor has no direction to turn.
        const MODULUS_MIN: f64 = 1e-6;
        let Some(network) = &self.network else {
            return Ok(self.gains(now, at));
        };
        if complex::modulus(u).value() < MODULUS_MIN {
            return Ok(now.ratio);
        }
        let sent = complex::product(u, product(&self.places.gain, now, at.deviation));
        let taps = product(&self.places.taps, now, at.deviation);
        // Behind the feeder an ideal transformer: its power is the load's.
        let load = |behind: [S; 2]| self.load_power(now, complex::product(behind, taps), at);
        let known = self.known.get(now.looked_for);
        let (solution, behind) = if let Some(known) = known {
            network.known(sent, known, load)
        } else {
            let own = complex::product(u.map(S::value), now.ratio.map(S::value));
            let guess = complex::quotient(own, taps.map(S::value));
            let mut secant = now.secant;
            let found = network.solve(sent, guess, &mut secant, load);
            now.secant = secant;
            found.ok_or(SimulationError::NoLoadVoltage { output: at.index })?
        };
        now.looked_for += 1;
        if !known.is_some_and(Solution::knows_slopes) {
            now.solutions.push(solution);
        }
        Ok(complex::quotient(complex::product(behind, taps), u))
    }

    /// All factors on the phasor.
    fn gains(&self, now: &Now<S>, at: Moment<S>) -> [S; 2] {
        let [gain, taps] =
            [&self.places.gain, &self.places.taps].map(|of| product(of, now, at.deviation));
        complex::product(gain, taps)
    }

    fn emit(
        &self,
        grid: &Grid,
        now: &mut Now<S>,
        output: &mut Output<S>,
    ) -> Result<(), SimulationError> {
        let index = output[0].len();
        let at = self.moment(index, 0.0);
        let u = complex::constant(grid.phasor[index]);
        let [active, reactive] = if self.coupled {
            if !now.settled {
                now.ratio = self.ratio(now, u, at)?;
            }
            let own = complex::product(u, now.ratio);
            let voltage = complex::modulus(own.map(S::value));
            now.lowest_voltage = now.lowest_voltage.min(voltage);
            let load = self.load_power(now, own, at);
            self.network.as_ref().map_or(load, |network| {
                let sent = complex::product(u, product(&self.places.gain, now, at.deviation));
                let taps = product(&self.places.taps, now, at.deviation);
                network.power(sent, complex::quotient(own, taps), load)
            })
        } else {
            let voltage = S::constant(grid.voltage[index]);
            if self.seen.is_some() {
                let (motor, own) = self.motor_power(now, u, index);
                self.power(now, [u, own], voltage, motor, at)
            } else {
                let motor = self.rest.motor.power(&now.motor, grid.phasor[index]);
                self.power(now, [u, u], voltage, motor, at)
            }
        };
        output[0].push(active);
        output[1].push(reactive);
        Ok(())
    }

    /// Power over P0 of a load that sees `own`, as if it were at the measured bus.
    fn load_power(&self, now: &Now<S>, own: [S; 2], at: Moment<S>) -> [S; 2] {
        let (motor, seen) = self.motor_power(now, own, at.index);
        self.power(now, [own, seen], complex::modulus(own), motor, at)
    }

    fn power(
        &self,
        now: &Now<S>,
        [phasor, motor_phasor]: [[S; 2]; 2],
        voltage: S,
        motor: [S; 2],
        moment: Moment<S>,
    ) -> [S; 2] {
        let [share, c_z, c_i, d_z, d_i] = self.linear;
        let deviation = moment.deviation;
        let square = voltage * voltage + -1.0;
        let line = voltage + -1.0;
        let from_voltage = c_z * square + c_i * line;
        let excess = motor[0] - self.rest.motor.rest_power[0];
        let mut active = share * excess + from_voltage + 1.0;
        let mut reactive = share * (motor[1] - self.rest.motor.rest_power[1])
            + (d_z * square + d_i * line)
            + self.rest.reactive;
        if !self.places.power.is_empty() {
            let one = S::constant(1.0);
            let seen = self.seen.as_ref();
            let factor = seen.map_or(one, |seen| seen[moment.index].factor);
            let square = complex::square(motor_phasor);
            let magnetising = self.rest.motor.susceptance * square * factor;
            let at = Instant {
                time_s: self.time_s[moment.index],
                phasor,
                motor_phasor,
                voltage,
                frequency_deviation: deviation,
                motor: [motor[0], motor[1] + magnetising],
                motor_factor: factor,
                static_active: from_voltage + 1.0 - share,
            };
            for e in &self.places.power {
                let own = e.own(&now.effects);
                let [p, q] = e.equations().power(e.parameters(), own, &at, &e.rest);
                active = active + p;
                reactive = reactive + q;
            }
        }
        if let Some(lag) = &self.lag {
            let [p, q] = lag.power(now.lagged, voltage);
            active = active + p;
            reactive = reactive + q;
        }
        [active, reactive]
    }
}
