//! The equations of an effect file, as the simulation calls them.
//!
//! A step first takes the declared states and the lags over it with the classical fourth-order
//! Runge-Kutta method, relays and extremes held; then the relays and extremes, whose conditions are
//! read at its start, middle and end. A relay that acts on a lag, or waits for another relay, is
//! seen there one step later.

use super::{
    compile::STATES_MAX,
    program::{Flat, Scope, VARIABLES},
    written::Written,
};
use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Drive, Instant, Rest, Step},
        effect::{Declaration, Declared, Equations, NoValue, Sensitivity},
        effects::relay,
    },
    numerics::{
        Elementary, Scalar,
        elementary::{larger, smaller},
    },
};

/// A state that moves at the end of a step; it reads one argument, a latch a second one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Switched {
    Timer,
    /// A timer and, in the state behind it, what has switched.
    Latch,
    Minimum,
    Maximum,
}

/// The equations of a file.
#[derive(Clone, Debug)]
pub(super) struct Formulas {
    /// Number of states.
    pub(super) states: usize,
    /// Initial values of the declared states, which are the first.
    pub(super) initial: Flat,
    /// What lags and extremes start from, inner functions first.
    pub(super) rest: Vec<(usize, Flat)>,
    /// Slopes of the states in `moving`.
    pub(super) rates: Flat,
    pub(super) moving: Vec<usize>,
    /// Arguments of those in `switched`, one after the other.
    pub(super) conditions: Flat,
    pub(super) switched: Vec<(Switched, usize)>,
    /// Active and reactive power added.
    pub(super) power: Flat,
    /// Every expression by itself, in the order of evaluation.
    pub(super) written: Vec<Written>,
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

    fn no_value(&self, p: &[f64], drive: &Drive<'_>) -> Option<NoValue> {
        self.without_value(p, drive)
    }
}

/// What states see: no time, no power.
pub(super) fn scope<'a, S: Elementary>(
    p: &'a [S],
    x: &'a [S],
    [voltage, deviation]: [S; 2],
    reactive_at_rest: f64,
) -> Scope<'a, S> {
    let none = S::constant(0.0);
    let reactive = S::constant(reactive_at_rest);
    Scope {
        variables: [voltage, deviation, none, reactive, none, none, none],
        parameters: p,
        states: x,
    }
}

impl Formulas {
    /// The states at rest; `x` is zero before.
    pub(super) fn at_rest<S: Elementary>(&self, p: &[S], reactive_at_rest: f64, x: &mut [S]) {
        let still = [S::constant(1.0), S::constant(0.0)];
        self.initial
            .evaluate(&scope(p, &[], still, reactive_at_rest), x);
        for (state, flat) in &self.rest {
            let mut value = [S::constant(0.0)];
            flat.evaluate(&scope(p, x, still, reactive_at_rest), &mut value);
            x[*state] = value[0];
        }
    }

    /// Slopes of the states in `moving`, in that order.
    pub(super) fn slopes<S: Elementary, const N: usize>(
        &self,
        p: &[S],
        x: &[S],
        seen: [S; 2],
        reactive_at_rest: f64,
    ) -> [S; N] {
        let mut slopes = [S::constant(0.0); N];
        self.rates
            .evaluate(&scope(p, x, seen, reactive_at_rest), &mut slopes);
        slopes
    }

    /// Takes the states over one step.
    pub(super) fn advance<S: Elementary>(&self, p: &[S], x: &mut [S], step: &Step<S>, rest: f64) {
        match self.states {
            0 => {}
            1 => self.advance_in::<S, 1>(p, x, step, rest),
            2 => self.advance_in::<S, 2>(p, x, step, rest),
            3 | 4 => self.advance_in::<S, 4>(p, x, step, rest),
            _ => self.advance_in::<S, STATES_MAX>(p, x, step, rest),
        }
    }

    fn advance_in<S: Elementary, const N: usize>(
        &self,
        p: &[S],
        x: &mut [S],
        step: &Step<S>,
        rest: f64,
    ) {
        let mut before = [S::constant(0.0); N];
        before[..x.len()].copy_from_slice(x);
        let mut after = before;
        if !self.moving.is_empty() {
            self.integrate(p, &before, &mut after, step, rest);
        }
        if !self.switched.is_empty() {
            self.switch(p, &before, &mut after, step, rest);
        }
        let used = x.len();
        x.copy_from_slice(&after[..used]);
    }

    fn integrate<S: Elementary, const N: usize>(
        &self,
        p: &[S],
        x: &[S; N],
        next: &mut [S; N],
        step: &Step<S>,
        rest: f64,
    ) {
        let slopes = |x: &[S; N], stage: usize| {
            let seen = [step.voltage[stage], step.frequency_deviation];
            self.slopes::<S, N>(p, x, seen, rest)
        };
        let ahead = |k: &[S; N], by: f64| {
            let mut moved = *x;
            for (state, k) in self.moving.iter().zip(k) {
                moved[*state] = moved[*state] + *k * by;
            }
            moved
        };
        let h = step.duration_s;
        let k1 = slopes(x, 0);
        let k2 = slopes(&ahead(&k1, 0.5 * h), 1);
        let k3 = slopes(&ahead(&k2, 0.5 * h), 1);
        let k4 = slopes(&ahead(&k3, h), 2);
        for (i, state) in self.moving.iter().enumerate() {
            let sum = k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i];
            next[*state] = x[*state] + sum * (h / 6.0);
        }
    }

    fn switch<S: Elementary, const N: usize>(
        &self,
        p: &[S],
        before: &[S; N],
        x: &mut [S; N],
        step: &Step<S>,
        rest: f64,
    ) {
        let mut middle = *x;
        for state in &self.moving {
            middle[*state] = (middle[*state] + before[*state]) * 0.5;
        }
        // A column for each argument; there are no more of them than states.
        let mut found = [[S::constant(0.0); N]; 3];
        let points = [before, &middle, &*x];
        for ((states, voltage), found) in points.into_iter().zip(step.voltage).zip(&mut found) {
            let seen = [voltage, step.frequency_deviation];
            self.conditions
                .evaluate(&scope(p, states, seen, rest), found);
        }
        let mut column = 0;
        for (kind, state) in &self.switched {
            let state = *state;
            let argument = [0, 1, 2].map(|i: usize| found[i][column]);
            column += 1;
            match kind {
                Switched::Timer => relay::run_timer(&mut x[state], argument, step.duration_s),
                Switched::Latch => {
                    let delay = found[2][column];
                    column += 1;
                    if let Some([timer, latched]) = x.get_mut(state..state + 2) {
                        relay::latch([timer, latched], argument, delay, step.duration_s);
                    }
                }
                Switched::Minimum => x[state] = argument.into_iter().fold(x[state], smaller),
                Switched::Maximum => x[state] = argument.into_iter().fold(x[state], larger),
            }
        }
    }

    /// Values of the conditions of timers and latches at rest, each with its state.
    pub(super) fn conditions_at_rest(&self, p: &[f64], x: &[f64], rest: f64) -> Vec<(usize, f64)> {
        let mut found = [0.0; STATES_MAX];
        self.conditions
            .evaluate(&scope(p, x, [1.0, 0.0], rest), &mut found);
        let mut conditions = Vec::new();
        let mut column = 0;
        for (kind, state) in &self.switched {
            if matches!(kind, Switched::Timer | Switched::Latch) {
                conditions.push((*state, found[column]));
            }
            column += 1 + usize::from(*kind == Switched::Latch);
        }
        conditions
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
        self.power.evaluate(&scope, &mut power);
        power
    }

    /// Fastest rate of the states at rest and in dips, 1/s.
    pub(super) fn rate_per_s(&self, p: &[f64]) -> f64 {
        self.fastest(p).0
    }

    /// The same, and the place in `moving` of the state that is as fast.
    pub(super) fn fastest(&self, p: &[f64]) -> (f64, usize) {
        let rates = RATE_VOLTAGES.map(|v| self.rate_at(p, v));
        rates.into_iter().fold((0.0, 0), faster)
    }

    /// Largest row sum of the absolute derivatives of the slopes by the states at a voltage, 1/s, and its row.
    fn rate_at(&self, p: &[f64], voltage: f64) -> (f64, usize) {
        let constants: Vec<Sensitivity> = p.iter().map(|p| Sensitivity::constant(*p)).collect();
        let mut x = [Sensitivity::constant(0.0); STATES_MAX];
        self.at_rest(&constants, 0.0, &mut x);
        for (lane, x) in x.iter_mut().enumerate() {
            *x = Sensitivity::variable(x.value, lane);
        }
        let at = [voltage, 0.0].map(Sensitivity::constant);
        let slopes = self.slopes::<Sensitivity, STATES_MAX>(&constants, &x, at, 0.0);
        let row = |s: &Sensitivity| s.derivatives().map(f64::abs).sum::<f64>();
        let rows = slopes.iter().enumerate().map(|(k, s)| (row(s), k));
        rows.fold((0.0, 0), faster)
    }
}

/// A maximum that keeps what is not a number.
fn faster(x: (f64, usize), y: (f64, usize)) -> (f64, usize) {
    if y.0 > x.0 || y.0.is_nan() { y } else { x }
}

/// Voltages at which the rate of the states is looked at.
const RATE_VOLTAGES: [f64; 3] = [1.0, 0.6, 0.1];

impl<S: Elementary> Equations<S> for UserEffect {
    fn initialise(&self, p: &[S], rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        self.formulas.at_rest(p, rest.reactive, x);
        Ok(())
    }

    fn rate_per_s(&self, p: &[S], _x: &[S], _rest: &Rest<S>) -> f64 {
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
