//! The equations of an effect file, as the simulation calls them.
//!
//! A step first takes the declared states and the lags over it with the classical fourth-order
//! Runge-Kutta method, relays and extremes held; then the relays and extremes, whose conditions are
//! read at its start, middle and end. A relay that acts on a lag, or waits for another relay, is
//! seen there one step later.

use super::{
    compile::{Kept, STATES_MAX},
    program::{Place, Program, Scope, VARIABLES},
};
use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{Declaration, Declared, Equations, Sensitivity},
        effects::relay,
    },
    numerics::{
        Elementary, Scalar,
        elementary::{larger, smaller},
    },
};

/// The equations of a file.
#[derive(Clone, Debug)]
pub(super) struct Formulas {
    /// Number of states.
    pub(super) states: usize,
    /// Initial values of the declared states.
    pub(super) initial: Program,
    pub(super) initial_places: Vec<Place>,
    /// Slopes of the declared states, and the arguments of lags.
    pub(super) rates: Program,
    pub(super) rate_places: Vec<Place>,
    /// Arguments of relays and extremes.
    pub(super) conditions: Program,
    pub(super) power: Program,
    pub(super) power_places: [Place; 2],
    /// What functions keep, and the first state of each; inner ones come first.
    pub(super) kept: Vec<(Kept, usize)>,
}

/// An effect that was read from a file.
#[derive(Debug)]
pub(super) struct UserEffect {
    pub(super) declaration: &'static Declaration,
    pub(super) grid: Vec<Vec<f64>>,
    pub(super) formulas: Formulas,
}

impl Declared for UserEffect {
    fn declaration(&self) -> &'static Declaration {
        self.declaration
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        self.grid.clone()
    }
}

type States<S> = [S; STATES_MAX];

fn zeros<S: Elementary>() -> States<S> {
    [S::constant(0.0); STATES_MAX]
}

/// What states see: no time, no power.
fn seen<S: Elementary>(voltage: S, deviation: S, reactive_at_rest: f64) -> [S; VARIABLES] {
    let none = S::constant(0.0);
    let reactive = S::constant(reactive_at_rest);
    [voltage, deviation, none, reactive, none, none, none]
}

impl Formulas {
    /// The same for all uses of an argument of a function.
    fn argument<S: Elementary>(program: &Program, scope: &Scope<'_, S>, place: Place) -> S {
        let mut value = [S::constant(0.0)];
        program.evaluate(scope, std::iter::once(place), &mut value);
        value[0]
    }

    /// The states at rest.
    pub(super) fn at_rest<S: Elementary>(&self, p: &[S], reactive_at_rest: f64, x: &mut [S]) {
        let variables = seen(S::constant(1.0), S::constant(0.0), reactive_at_rest);
        let mut start = zeros::<S>();
        let scope = Scope {
            variables,
            parameters: p,
            states: &zeros::<S>(),
        };
        let places = self.initial_places.iter().copied();
        self.initial.evaluate(&scope, places, &mut start);
        for (kept, state) in &self.kept {
            let scope = Scope {
                variables,
                parameters: p,
                states: &start,
            };
            let value = match *kept {
                Kept::Lag { input, .. } => Self::argument(&self.rates, &scope, input),
                Kept::Minimum { input } | Kept::Maximum { input } => {
                    Self::argument(&self.conditions, &scope, input)
                }
                Kept::Timer { .. } | Kept::Latch { .. } => continue,
            };
            start[*state] = value;
        }
        for (target, value) in x.iter_mut().zip(start) {
            *target = value;
        }
    }

    /// Slopes of the declared states and of lags; 0 for the others.
    pub(super) fn slopes<S: Elementary>(
        &self,
        p: &[S],
        x: &States<S>,
        [voltage, deviation]: [S; 2],
        reactive_at_rest: f64,
    ) -> States<S> {
        let scope = Scope {
            variables: seen(voltage, deviation, reactive_at_rest),
            parameters: p,
            states: x,
        };
        let lags = self.kept.iter().filter_map(|(kept, state)| match *kept {
            Kept::Lag { input, time } => Some((*state, [input, time])),
            _ => None,
        });
        let arguments = lags.clone().flat_map(|(_, places)| places);
        let wanted = self.rate_places.iter().copied().chain(arguments);
        let mut found = [S::constant(0.0); 2 * STATES_MAX];
        self.rates.evaluate(&scope, wanted, &mut found);
        let declared = self.rate_places.len();
        let mut slopes = zeros::<S>();
        slopes[..declared].copy_from_slice(&found[..declared]);
        for (k, (state, _)) in lags.enumerate() {
            let [input, time] = [0, 1].map(|i| found[declared + 2 * k + i]);
            slopes[state] = (input - x[state]) / time;
        }
        slopes
    }

    /// The places of the arguments of relays and extremes.
    fn condition_places(&self) -> impl Iterator<Item = Place> {
        self.kept
            .iter()
            .flat_map(|(kept, _)| match *kept {
                Kept::Latch { condition, delay } => [Some(condition), Some(delay)],
                Kept::Timer { condition: x }
                | Kept::Minimum { input: x }
                | Kept::Maximum { input: x } => [Some(x), None],
                Kept::Lag { .. } => [None, None],
            })
            .flatten()
    }

    fn integrate<S: Elementary>(
        &self,
        p: &[S],
        x: &States<S>,
        step: &Step<S>,
        rest: f64,
    ) -> States<S> {
        let used = self.states;
        let slopes = |x: &States<S>, stage: usize| {
            self.slopes(p, x, [step.voltage[stage], step.frequency_deviation], rest)
        };
        let ahead = |k: &States<S>, by: f64| {
            let mut moved = *x;
            for (m, k) in moved.iter_mut().zip(k).take(used) {
                *m = *m + *k * by;
            }
            moved
        };
        let h = step.duration_s;
        let k1 = slopes(x, 0);
        let k2 = slopes(&ahead(&k1, 0.5 * h), 1);
        let k3 = slopes(&ahead(&k2, 0.5 * h), 1);
        let k4 = slopes(&ahead(&k3, h), 2);
        let mut next = *x;
        for i in 0..used {
            let mean = (k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i]) * (1.0 / 6.0);
            next[i] = next[i] + mean * h;
        }
        next
    }

    /// Arguments of relays and extremes at start, middle and end of a step.
    fn conditions<S: Elementary>(
        &self,
        p: &[S],
        [before, after]: [&States<S>; 2],
        step: &Step<S>,
        rest: f64,
    ) -> [[S; 2 * STATES_MAX]; 3] {
        let mut middle = *after;
        for (m, b) in middle.iter_mut().zip(before) {
            *m = (*m + *b) * 0.5;
        }
        let points = [before, &middle, after];
        let mut found = [[S::constant(0.0); 2 * STATES_MAX]; 3];
        for ((states, voltage), found) in points.into_iter().zip(step.voltage).zip(&mut found) {
            let scope = Scope {
                variables: seen(voltage, step.frequency_deviation, rest),
                parameters: p,
                states,
            };
            self.conditions
                .evaluate(&scope, self.condition_places(), found);
        }
        found
    }

    fn switch<S: Elementary>(&self, x: &mut States<S>, found: &[[S; 2 * STATES_MAX]; 3], h: f64) {
        let mut column = 0;
        for (kept, state) in &self.kept {
            let state = *state;
            let argument = [0, 1, 2].map(|i: usize| found[i][column]);
            match kept {
                Kept::Lag { .. } => continue,
                Kept::Timer { .. } => relay::run_timer(&mut x[state], argument, h),
                Kept::Latch { .. } => {
                    let delay = found[2][column + 1];
                    let (mut timer, mut latched) = (x[state], x[state + 1]);
                    relay::latch([&mut timer, &mut latched], argument, delay, h);
                    (x[state], x[state + 1]) = (timer, latched);
                    column += 1;
                }
                Kept::Minimum { .. } => {
                    x[state] = argument.into_iter().fold(x[state], smaller);
                }
                Kept::Maximum { .. } => {
                    x[state] = argument.into_iter().fold(x[state], larger);
                }
            }
            column += 1;
        }
    }

    /// A condition at rest.
    pub(super) fn condition(&self, p: &[f64], x: &States<f64>, rest: f64, place: Place) -> f64 {
        let scope = Scope {
            variables: seen(1.0, 0.0, rest),
            parameters: p,
            states: x,
        };
        Self::argument(&self.conditions, &scope, place)
    }

    /// Takes the states over one step.
    pub(super) fn advance<S: Elementary>(&self, p: &[S], x: &mut [S], step: &Step<S>, rest: f64) {
        let mut before = zeros::<S>();
        for (target, value) in before.iter_mut().zip(x.iter()) {
            *target = *value;
        }
        let mut after = self.integrate(p, &before, step, rest);
        if self.condition_places().next().is_some() {
            let found = self.conditions(p, [&before, &after], step, rest);
            self.switch(&mut after, &found, step.duration_s);
        }
        for (target, value) in x.iter_mut().zip(after) {
            *target = value;
        }
    }

    /// Active and reactive power added, over P0.
    pub(super) fn added_power<S: Elementary>(
        &self,
        p: &[S],
        x: &[S],
        variables: [S; VARIABLES],
    ) -> [S; 2] {
        let scope = Scope {
            variables,
            parameters: p,
            states: x,
        };
        let mut power = [S::constant(0.0); 2];
        let places = self.power_places.into_iter();
        self.power.evaluate(&scope, places, &mut power);
        power
    }

    /// Fastest rate of the states at rest and in dips, 1/s.
    pub(super) fn rate_per_s(&self, p: &[f64]) -> f64 {
        let rates = RATE_VOLTAGES.map(|v| self.rate_at(p, v));
        rates.into_iter().fold(0.0, f64::max)
    }

    /// Largest row sum of the absolute derivatives of the slopes by the states at a voltage, 1/s.
    fn rate_at(&self, p: &[f64], voltage: f64) -> f64 {
        let constants: Vec<Sensitivity> = p.iter().map(|p| Sensitivity::constant(*p)).collect();
        let mut x = zeros::<Sensitivity>();
        self.at_rest(&constants, 0.0, &mut x);
        for (lane, x) in x.iter_mut().enumerate() {
            *x = Sensitivity::variable(x.value, lane);
        }
        let at = [voltage, 0.0].map(Sensitivity::constant);
        let slopes = self.slopes(&constants, &x, at, 0.0);
        let row = |s: &Sensitivity| s.derivatives.iter().map(|d| d.abs()).sum::<f64>();
        slopes.iter().map(row).fold(0.0, f64::max)
    }
}

/// Voltages at which the rate of the states is looked at.
const RATE_VOLTAGES: [f64; 3] = [1.0, 0.6, 0.1];

impl<S: Elementary> Equations<S> for UserEffect {
    fn initialise(&self, p: &[S], rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        self.formulas.at_rest(p, rest.reactive, x);
        Ok(())
    }

    fn rate_per_s(&self, p: &[S]) -> f64 {
        let values: Vec<f64> = p.iter().map(|p| p.value()).collect();
        self.formulas.rate_per_s(&values)
    }

    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, rest: &Rest<S>) {
        self.formulas.advance(p, x, step, rest.reactive);
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, rest: &Rest<S>) -> [S; 2] {
        let variables = [
            at.voltage,
            at.frequency_deviation,
            S::constant(at.time_s),
            S::constant(rest.reactive),
            rest.motor_share * at.motor[0],
            rest.motor_share * at.motor[1],
            at.static_active,
        ];
        self.formulas.added_power(p, x, variables)
    }
}
