//! Series over the output instants beside the power: the frequency, what motors see of it, and what
//! instruments make of the whole.

use super::{
    Drive, FrequencyCourse, Seen, Series,
    active::{Active, Pass},
    grid::Grid,
    run::Output,
};
use crate::{load_model::effect::Place, numerics::Elementary};

/// The motors' view at one output instant.
#[derive(Clone, Copy)]
pub(super) struct View<S> {
    /// Factor on the phasor they see.
    pub(super) turn: [S; 2],
    /// Factor on their power.
    pub(super) factor: S,
}

/// What motors see of the frequency where an effect makes a difference.
pub(super) fn seen<S: Pass>(
    drive: &Drive<'_>,
    grid: &Grid,
    frequency: &[S],
    effects: &[Active<'_, S>],
) -> Option<Vec<View<S>>> {
    let mut acting = effects
        .iter()
        .filter(|e| e.declaration.acts_on(Place::MotorFrequency))
        .peekable();
    acting.peek()?;
    let jumps = grid.time_s.iter().zip(&grid.jump);
    let jumps_s: Vec<f64> = jumps.filter(|(_, jump)| **jump).map(|(t, _)| *t).collect();
    let course = FrequencyCourse {
        time_s: &grid.time_s,
        deviation: frequency,
        jumps_s: &jumps_s,
        synchronous_speed_rad_s: drive.terminal.synchronous_speed_rad_s,
    };
    let nothing = Seen {
        frequency: S::constant(1.0),
        turn_rad: S::constant(0.0),
    };
    let mut seen = vec![nothing; frequency.len()];
    for e in acting {
        e.equations
            .motor_frequency(&e.parameters, &course, &mut seen);
    }
    let view = |at: Seen<S>| {
        let [sine, cosine] = at.turn_rad.sin_cos();
        View {
            turn: [cosine / at.frequency, sine / at.frequency],
            factor: at.frequency,
        }
    };
    Some(seen.into_iter().map(view).collect())
}

/// Lets the instruments act on the series.
pub(super) fn measure<S: Pass>(
    drive: &Drive<'_>,
    grid: &Grid,
    effects: &[Active<'_, S>],
    [active, reactive]: &mut Output<S>,
) {
    let mut series = Series {
        time_s: &grid.time_s,
        jump: &grid.jump,
        phasor: &grid.phasor,
        reactive_at_rest: drive.reactive_at_rest,
        active,
        reactive,
    };
    let measures = |e: &&Active<'_, S>| {
        let left = drive.leaves_delay && e.delays;
        e.declaration.acts_on(Place::Measurement) && !left
    };
    for e in effects.iter().filter(measures) {
        e.equations.measure(&e.parameters, &mut series);
    }
}

pub(super) fn frequency_series<S: Elementary>(drive: &Drive<'_>, grid: &Grid) -> Vec<S> {
    if drive.frequency_deviation.is_empty() {
        return vec![S::constant(0.0); grid.time_s.len()];
    }
    drive
        .frequency_deviation
        .iter()
        .map(|f| S::constant(*f))
        .collect()
}
