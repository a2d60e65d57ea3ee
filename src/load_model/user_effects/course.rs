//! An effect driven by a course of the voltage alone, without a motor: for checks, and to say afterwards where an
//! expression had no finite value.

use std::fmt::{self, Display, Formatter};

use super::{
    compile::STATES_MAX,
    effect::{Formulas, UserEffect},
    program::VARIABLES,
    written::Written,
};
use crate::load_model::{
    composed::{Drive, Step},
    effect::NoValue,
};

/// A point of a course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub(super) time_s: f64,
    pub(super) voltage: f64,
    /// Frequency deviation, pu.
    pub(super) deviation: f64,
}

impl Point {
    pub(super) const REST: Self = Self {
        time_s: 0.0,
        voltage: 1.0,
        deviation: 0.0,
    };
}

impl Display for Point {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "at v = {:.3}, df = {:.4}, t = {:.3} s",
            self.voltage, self.deviation, self.time_s
        )
    }
}

/// Substeps between two points at most.
const SUBSTEPS_MAX: f64 = 64.0;
/// Longest step, `rate * step <= this`, as in the simulation.
const LONGEST: f64 = 0.5;

/// Variables of an expression, with an ordinary motor in the place of the true one.
pub(super) fn variables(at: &Point, reactive: f64) -> [f64; VARIABLES] {
    const MOTOR_SHARE: f64 = 0.4;
    const MOTOR_REACTIVE: f64 = 0.2;
    let v = at.voltage;
    [
        v,
        at.deviation,
        at.time_s,
        reactive,
        MOTOR_SHARE * v,
        MOTOR_REACTIVE * v * v,
        (1.0 - MOTOR_SHARE) * v,
    ]
}

impl Formulas {
    /// Takes the states from rest through a course; `look` sees each point with the states there, and ends it with what
    /// it returns.
    pub(super) fn through<T>(
        &self,
        p: &[f64],
        reactive: f64,
        points: &[Point],
        mut look: impl FnMut(&Point, &[f64]) -> Option<T>,
    ) -> Option<T> {
        let mut x = [0.0; STATES_MAX];
        self.at_rest(p, reactive, &mut x);
        let rate_per_s = self.rate_per_s(p);
        for (k, at) in points.iter().enumerate() {
            if let Some(found) = look(at, &x) {
                return Some(found);
            }
            let Some(next) = points.get(k + 1) else { break };
            let interval_s = next.time_s - at.time_s;
            let substeps = (rate_per_s * interval_s / LONGEST)
                .ceil()
                .clamp(1.0, SUBSTEPS_MAX);
            let middle = 0.5 * (at.voltage + next.voltage);
            let voltage = [at.voltage, middle, next.voltage];
            let phasor = voltage.map(|v| [v, 0.0]);
            let step = Step {
                duration_s: interval_s / substeps,
                phasor,
                motor_phasor: phasor,
                voltage,
                frequency_deviation: at.deviation,
            };
            let mut done = 0.0;
            while done < substeps {
                self.advance(p, &mut x[..self.states], &step, reactive);
                done += 1.0;
            }
        }
        None
    }

    /// The first expression without a finite value on a course, and where.
    pub(super) fn without_value<'f>(
        &'f self,
        p: &[f64],
        reactive: f64,
        points: &[Point],
    ) -> Option<(&'f Written, Point)> {
        self.through(p, reactive, points, |at, x| {
            let found = self.not_finite(p, x, variables(at, reactive))?;
            Some((found, *at))
        })
    }
}

impl UserEffect {
    /// Where an expression has no finite value while the load sees the measured voltage.
    pub(super) fn without_value(&self, p: &[f64], drive: &Drive<'_>) -> Option<NoValue> {
        let terminal = drive.terminal;
        let fine_s = terminal.sample_interval_s / terminal.points_per_sample.max(1) as f64;
        let deviations = drive.frequency_deviation;
        let point = |(k, i): (usize, usize)| {
            let (re, im) = (terminal.real.get(i)?, terminal.imaginary.get(i)?);
            Some(Point {
                time_s: i as f64 * fine_s,
                voltage: re.hypot(*im),
                deviation: deviations.get(k).copied().unwrap_or(0.0),
            })
        };
        let outputs = terminal.output_points().into_iter().enumerate();
        let points: Vec<Point> = outputs.filter_map(point).collect();
        let found = self
            .formulas
            .without_value(p, drive.reactive_at_rest, &points);
        found.map(|(written, at)| NoValue {
            what: written.shown(),
            voltage: at.voltage,
            time_s: at.time_s,
        })
    }
}
