//! The steps of intake in order.

use super::{
    Unusable,
    edges::{self, Edge},
    frequency, operating_point,
    series::Series,
    smoothing::{self, LogPhasor},
    spikes, weights,
};
use crate::{disturbance::Window, load_model::TerminalInput};
use std::f64::consts::PI;

mod known_terminal;

pub use known_terminal::KnownTerminal;

/// Settings of intake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntakeOptions {
    /// Fewest usable samples. Default 20; at least 10.
    pub samples_min: usize,
    /// Least change of the complex voltage, relative. Default 0.002; at least 0.
    pub voltage_change_min: f64,
    /// Error of P per unit of local voltage motion near edges, relative to P0. Default 0.08.
    pub edge_share_active: f64,
    /// The same of Q. Default 0.16.
    pub edge_share_reactive: f64,
}

impl Default for IntakeOptions {
    fn default() -> Self {
        Self {
            samples_min: 20,
            voltage_change_min: 0.002,
            edge_share_active: 0.08,
            edge_share_reactive: 0.16,
        }
    }
}

/// An event ready to be fitted, normalised by its own operating point.
#[derive(Clone, Debug, PartialEq)]
pub struct PreparedEvent {
    /// Event identifier.
    pub id: String,
    /// Samples per second.
    pub rate_fps: f64,
    /// Operating point before the event: voltage, pu.
    pub v0_pu: f64,
    /// Active power, pu, positive.
    pub p0_pu: f64,
    /// Reactive power, pu.
    pub q0_pu: f64,
    /// Whether the operating point was at rest before the event.
    pub steady_start: bool,
    /// First sample of the event part.
    pub event_start: usize,
    /// Terminal phasor, 1 at rest.
    pub input: TerminalInput,
    /// `|u|` at the samples.
    pub voltage: Vec<f64>,
    /// Frequency deviation from its value before the event, relative to nominal, from the smoothed
    /// angle away from edges.
    pub frequency_deviation: Vec<f64>,
    /// Measured P over P0.
    pub active: Vec<f64>,
    /// Measured Q over P0.
    pub reactive: Vec<f64>,
    /// Standard deviation assumed for each sample of P over P0.
    pub active_deviation: Vec<f64>,
    /// The same of Q over P0.
    pub reactive_deviation: Vec<f64>,
    /// Noise of P over P0 before the event.
    pub active_noise: f64,
    /// Noise of Q over P0 before the event.
    pub reactive_noise: f64,
    /// Whether each sample may enter the fit.
    pub used: Vec<bool>,
    /// Whether each sample lies within two nominal cycles of a voltage edge.
    pub near_edge: Vec<bool>,
    /// Lowest `|u|`.
    pub lowest_voltage: f64,
    /// Highest `|u|`.
    pub highest_voltage: f64,
    /// How well P0 and Q0 are known, relative to P0 (standard deviation).
    pub operating_point_deviation: f64,
    /// Jumps of the terminal phasor between unfiltered samples; empty where a filter has spread
    /// them.
    pub edges: Vec<Edge>,
    /// ln|u| and angle at the samples, smoothed: what `input` was made of.
    smooth: Vec<LogPhasor>,
    at_edge: Vec<bool>,
    /// Isolated spikes that were removed.
    pub spikes: usize,
}

impl PreparedEvent {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.voltage.len()
    }

    /// The same event with the jumps of the voltage moved to other instants, in samples.
    #[must_use]
    pub fn with_edge_positions(&self, positions: &[f64]) -> Self {
        let mut moved = self.clone();
        for (edge, position) in moved.edges.iter_mut().zip(positions) {
            edge.position = *position;
        }
        (moved.input.real, moved.input.imaginary) = smoothing::reconstruct(
            &moved.smooth,
            &moved.at_edge,
            &moved.edges,
            moved.input.points_per_sample,
        );
        moved
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.voltage.is_empty()
    }
}

/// Fine grid points per sample interval. Chosen: half steps of sixteen substeps lie on it.
const POINTS_PER_SAMPLE: usize = 32;
/// Voltage before the event below which the bus is dead, pu.
const VOLTAGE_MIN_PU: f64 = 0.05;
/// Standard deviation left to P0 and Q0 when there was no steady part to measure them.
const UNKNOWN_OPERATING_POINT: f64 = 0.2;

/// The terminal voltage of an event, smoothed, with its jumps.
struct Voltage {
    smooth: Vec<LogPhasor>,
    phasor: Vec<[f64; 2]>,
    at_edge: Vec<bool>,
    edges: Vec<Edge>,
    noise: f64,
}

/// Prepares one window for fitting. Pure; cost linear in the number of samples.
///
/// # Errors
///
/// [`Unusable`] with the number that makes the window unusable.
pub fn prepare(window: &Window, options: &IntakeOptions) -> Result<PreparedEvent, Unusable> {
    let required = options.samples_min;
    let mut series = Series::read(&window.record).ok_or(Unusable::TooFewSamples {
        usable: 0,
        required,
    })?;
    let spikes = spikes::remove(&mut series);
    let usable = series.bad.iter().filter(|bad| !**bad).count();
    if usable < required {
        return Err(Unusable::TooFewSamples { usable, required });
    }
    let steps = edges::steps_at_edges(&series);
    let before = operating_point::find(&series, &steps, window.onset);
    if !(before.voltage.is_finite() && before.voltage > VOLTAGE_MIN_PU) {
        return Err(Unusable::NoVoltage {
            voltage_pu: before.voltage,
        });
    }
    let voltage = terminal_voltage(&series, &before, steps);
    check_disturbance(&voltage.phasor, &series, options)?;
    let mut event = assembled(&window.id, &series, &before, voltage, options)?;
    event.spikes = spikes;
    Ok(event)
}

fn terminal_voltage(
    series: &Series,
    before: &operating_point::PreEvent,
    mut at_edge: Vec<bool>,
) -> Voltage {
    let noise = edges::input_noise(series);
    let raw = terminal_phasor(series, before);
    // Behind a phasor filter the smeared voltage goes with smeared P and Q; only samples that no
    // filter has touched show true jumps, whose instant they leave open.
    let edges = edges::unfiltered_jumps(&raw, &at_edge).unwrap_or_default();
    if !edges.is_empty() {
        at_edge.fill(false);
        for edge in &edges {
            at_edge[edge.left] = true;
        }
    }
    let smooth = smoothing::smooth(&raw, series, &at_edge, noise);
    let phasor = smooth
        .iter()
        .map(|l| [l[0].exp() * l[1].cos(), l[0].exp() * l[1].sin()])
        .collect();
    Voltage {
        smooth,
        phasor,
        at_edge,
        edges,
        noise,
    }
}

fn assembled(
    id: &str,
    series: &Series,
    before: &operating_point::PreEvent,
    u: Voltage,
    options: &IntakeOptions,
) -> Result<PreparedEvent, Unusable> {
    let scaled = |x: &[f64]| x.iter().map(|y| y / before.active).collect::<Vec<_>>();
    let (active, reactive) = (scaled(&series.active), scaled(&series.reactive));
    let weigh = |values: &[f64], share: f64| {
        // Samples that no filter has spread are right up to the jump itself.
        let share = if u.edges.is_empty() { share } else { 0.0 };
        weights::channel(values, &u.phasor, before.samples, u.noise, share)
    };
    let active_weights = weigh(&active, options.edge_share_active);
    let reactive_weights = weigh(&reactive, options.edge_share_reactive);
    check_load(before.active, active_weights.noise)?;
    let voltage: Vec<f64> = u.smooth.iter().map(|l| l[0].exp()).collect();
    let to_edge = edges::distance_to_edge(&u.at_edge, series.len());
    let two_cycles = 2.0 * series.samples_per_cycle();
    Ok(PreparedEvent {
        id: id.to_owned(),
        rate_fps: series.rate_fps,
        v0_pu: before.voltage,
        p0_pu: before.active,
        q0_pu: before.reactive,
        steady_start: before.steady,
        event_start: before.samples,
        input: terminal_input(series, before, &u),
        lowest_voltage: voltage.iter().copied().fold(f64::INFINITY, f64::min),
        highest_voltage: voltage.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        voltage,
        frequency_deviation: frequency::deviation(&u.smooth, &to_edge, series),
        active,
        reactive,
        operating_point_deviation: operating_point_deviation(before, active_weights.noise),
        active_deviation: active_weights.deviation,
        reactive_deviation: reactive_weights.deviation,
        active_noise: active_weights.noise,
        reactive_noise: reactive_weights.noise,
        used: weights::used(series),
        near_edge: to_edge.iter().map(|d| *d <= two_cycles).collect(),
        edges: u.edges,
        smooth: u.smooth,
        at_edge: u.at_edge,
        spikes: 0,
    })
}

fn terminal_input(
    series: &Series,
    before: &operating_point::PreEvent,
    u: &Voltage,
) -> TerminalInput {
    let (real, imaginary) =
        smoothing::reconstruct(&u.smooth, &u.at_edge, &u.edges, POINTS_PER_SAMPLE);
    TerminalInput {
        real,
        imaginary,
        points_per_sample: POINTS_PER_SAMPLE,
        sample_interval_s: 1.0 / series.rate_fps,
        dense: vec![false; u.at_edge.len()],
        jumps: u.at_edge.clone(),
        synchronous_speed_rad_s: 2.0 * PI * before.frequency_hz,
    }
}

fn operating_point_deviation(before: &operating_point::PreEvent, noise: f64) -> f64 {
    if before.steady {
        // Neighbouring phasors are correlated: count one independent value per four samples.
        noise * (4.0 / before.samples as f64).sqrt()
    } else {
        UNKNOWN_OPERATING_POINT
    }
}

/// ln|V/V0| and angle without the pre-event slope.
fn terminal_phasor(series: &Series, before: &operating_point::PreEvent) -> Vec<LogPhasor> {
    (0..series.len())
        .map(|k| {
            let turn = before.angle + before.angle_slope * k as f64;
            [
                (series.voltage[k].max(1e-3) / before.voltage).ln(),
                series.angle[k] - turn,
            ]
        })
        .collect()
}

fn check_disturbance(
    phasor: &[[f64; 2]],
    series: &Series,
    options: &IntakeOptions,
) -> Result<(), Unusable> {
    let change = phasor
        .iter()
        .zip(&series.bad)
        .filter(|(_, bad)| !**bad)
        .map(|(u, _)| (u[0].hypot(u[1]) - 1.0).abs())
        .fold(0.0, f64::max);
    if change < options.voltage_change_min {
        Err(Unusable::NoDisturbance { change })
    } else {
        Ok(())
    }
}

fn check_load(active_pu: f64, relative_noise: f64) -> Result<(), Unusable> {
    let noise_pu = (relative_noise * active_pu).abs();
    if active_pu.is_finite() && active_pu > 0.0 && relative_noise.abs() < 0.2 {
        Ok(())
    } else {
        Err(Unusable::NoLoad {
            active_pu,
            noise_pu,
        })
    }
}
