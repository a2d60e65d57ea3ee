//! The steps of intake in order.

use super::{
    super::{
        measurement_chain::{ChainParts, MeasurementChain},
        phasor_filter::{FilterChoice, PhasorFilter},
    },
    SiteReference, Unusable,
    edges::{self, Edge},
    frequency, gaps, jumps,
    longer_window::{longer_window, samples_of},
    operating_point,
    series::Series,
    spikes, stiffness,
    voltage::{Jump, Log, Measured, Voltage},
    weights,
};
use crate::{disturbance::Window, load_model::TerminalInput};
use std::{f64::consts::PI, sync::Arc};

mod known_terminal;

pub use known_terminal::KnownTerminal;

/// Settings of intake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntakeOptions {
    /// Fewest usable samples. Default 20; at least 10.
    pub samples_min: usize,
    /// Least change of the complex voltage, relative. Default 0.002; at least 0.
    pub voltage_change_min: f64,
    /// The filter through which the instrument sees phasors. Default: what explains the edges of
    /// each event best.
    pub filter: FilterChoice,
    /// Whether a window longer than those of the standard is looked for in the jumps of all events. Default: no.
    pub longer_window: bool,
    /// Error of P per unit of local voltage motion near edges that no filter explains, relative to
    /// P0. Default 0.08.
    pub edge_share_active: f64,
    /// The same of Q. Default 0.16.
    pub edge_share_reactive: f64,
}

impl Default for IntakeOptions {
    fn default() -> Self {
        Self {
            samples_min: 20,
            voltage_change_min: 0.002,
            filter: FilterChoice::Auto,
            longer_window: false,
            edge_share_active: 0.08,
            edge_share_reactive: 0.16,
        }
    }
}

/// The part of a model with which longer windows are looked for.
pub const LONGER_WINDOW: &str = "phasor_window";

impl IntakeOptions {
    /// These settings for models made of these parts.
    #[must_use]
    pub fn for_parts<T: AsRef<str>>(mut self, parts: &[T]) -> Self {
        self.longer_window |= parts.iter().any(|part| part.as_ref() == LONGER_WINDOW);
        self
    }

    /// These settings for these windows: a longer phasor window that they show is taken for all of them.
    #[must_use]
    pub fn for_windows(mut self, windows: &[Window]) -> Self {
        if self.longer_window
            && self.filter == FilterChoice::Auto
            && let Some(found) = longer_window(windows)
        {
            self.filter = FilterChoice::Fixed(PhasorFilter::Longer(found));
        }
        self
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
    /// What `d_z` and `d_i` are here above those of the site ([`ReactiveTrend`](crate::identification::ReactiveTrend)); zero
    /// as prepared.
    pub reactive_offset: [f64; 2],
    /// Where the coefficients of the site hold; `None` as prepared.
    pub site: Option<SiteReference>,
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
    /// Jumps of the terminal phasor that are explained, behind `filter`.
    pub edges: Vec<Edge>,
    /// The filter that explains the jumps; none where no jump shows one.
    pub filter: Option<PhasorFilter>,
    /// From the load's power at the output instants of `input` to P and Q as measured.
    pub chain: MeasurementChain,
    /// What `input` was made of; none where it was given.
    origin: Option<Origin>,
    /// What drives a model where one jump lies a standard deviation farther, for each jump of which the voltages leave
    /// the instant open behind a short window.
    elsewhere: Arc<[Elsewhere]>,
    /// Isolated spikes that were removed.
    pub spikes: usize,
}

/// A terminal input, and the chain behind it, with one jump at another instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Elsewhere {
    /// The terminal voltage.
    pub input: TerminalInput,
    /// From the load's power at its output instants to P and Q as measured.
    pub chain: MeasurementChain,
}

/// Where a terminal input comes from.
#[derive(Clone, Debug, PartialEq)]
struct Origin {
    /// ln|u| and angle between the jumps.
    terminal: Voltage,
    measured: Measured,
}

impl PreparedEvent {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.voltage.len()
    }

    /// Number of rows of a fit: every used sample of P and of Q.
    #[must_use]
    pub fn rows(&self) -> usize {
        2 * self.used.iter().filter(|used| **used).count()
    }

    /// How long it stays below a voltage in a row at most, s.
    #[must_use]
    pub fn longest_below_s(&self, voltage_pu: f64) -> f64 {
        self.input.longest_below_s(voltage_pu / self.v0_pu)
    }

    /// Whether P and Q can tell more about the instants of the jumps: no filter has spread them, so
    /// that voltages leave them open, or so short a one that one or two voltages hold each.
    #[must_use]
    pub fn instants_open(&self) -> bool {
        let short = |origin: &Origin| origin.measured.has_short_window();
        !self.edges.is_empty()
            && (self.instants_unseen() || self.origin.as_ref().is_some_and(short))
    }

    /// Whether voltages say nothing of the instants but the samples they lie between: no filter has spread the jumps.
    #[must_use]
    pub fn instants_unseen(&self) -> bool {
        self.filter == Some(PhasorFilter::None)
    }

    /// The same with one jump a standard deviation farther, for each jump of which the voltages leave the instant open
    /// behind a short window; none where jumps were moved ([`Self::with_edge_positions`]).
    #[must_use]
    pub fn elsewhere(&self) -> &[Elsewhere] {
        &self.elsewhere
    }

    /// What [`Self::elsewhere`] gives.
    fn moved_one_by_one(&self) -> Arc<[Elsewhere]> {
        if self.instants_unseen() || !self.instants_open() {
            return Arc::new([]);
        }
        let positions: Vec<f64> = self.edges.iter().map(|e| e.position).collect();
        let moved = |number: usize| {
            let edge = &self.edges[number];
            let deviation = edge.deviation;
            if !(INSTANT_DEVIATION_LEAST..f64::INFINITY).contains(&deviation) {
                return None;
            }
            let mut at = positions.clone();
            // Away from a jump that follows at once.
            let next = positions.get(number + 1).map_or(f64::INFINITY, |p| *p);
            let later = edge.position + deviation;
            let crosses = later + INSTANTS_APART_LEAST > next;
            at[number] = if crosses {
                edge.position - deviation
            } else {
                later
            };
            let Self { input, chain, .. } = self.with_edge_positions(&at);
            Some(Elsewhere { input, chain })
        };
        (0..self.edges.len()).filter_map(moved).collect()
    }

    /// The same event with the jumps of the voltage moved to other instants, in samples.
    #[must_use]
    pub fn with_edge_positions(&self, positions: &[f64]) -> Self {
        let mut moved = self.clone();
        moved.elsewhere = Arc::new([]);
        let Some(origin) = &mut moved.origin else {
            return moved;
        };
        let mut jumps = origin.terminal.jumps().to_vec();
        for ((edge, jump), position) in moved.edges.iter_mut().zip(&mut jumps).zip(positions) {
            edge.position = *position;
            jump.position = *position;
        }
        let whole = (0, self.len() - 1);
        let before = Some(&origin.terminal);
        if let Some(terminal) = Voltage::fit(&origin.measured, whole, &jumps, before) {
            origin.terminal = terminal;
        }
        let speed = self.input.synchronous_speed_rad_s;
        moved.input = terminal_input(&origin.measured, &origin.terminal, speed);
        moved.chain = chain(
            &origin.measured,
            &origin.terminal,
            &moved.input,
            &self.frequency_deviation,
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
/// Least noise assumed, so that noiseless data are smoothed where they are smooth.
pub(super) const NOISE_LEAST: f64 = 2e-5;
/// Deviation of an instant that is known as well as anything, and least distance of two jumps, samples.
const INSTANT_DEVIATION_LEAST: f64 = 0.01;
const INSTANTS_APART_LEAST: f64 = 0.1;
/// Voltage before the event below which the bus is dead, pu.
pub(super) const VOLTAGE_MIN_PU: f64 = 0.05;
/// Standard deviation left to P0 and Q0 when there was no steady part to measure them.
const UNKNOWN_OPERATING_POINT: f64 = 0.2;

/// The terminal voltage of an event, smoothed, with its jumps.
struct Terminal {
    voltage: Voltage,
    measured: Measured,
    edges: Vec<Edge>,
    filter: Option<PhasorFilter>,
    unexplained: Vec<bool>,
    steep: Vec<bool>,
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
    let steps = edges::steps_at_edges(&series, spread(&series, options));
    let before = operating_point::find(&series, &steps, window.onset);
    if !(before.voltage.is_finite() && before.voltage > VOLTAGE_MIN_PU) {
        return Err(Unusable::NoVoltage {
            voltage_pu: before.voltage,
        });
    }
    let terminal = terminal_voltage(&series, &before, steps, options).ok_or(
        // Every sample is missing on one side of a jump, or none is finite.
        Unusable::TooFewSamples { usable, required },
    )?;
    check_disturbance(&terminal.measured, options)?;
    let mut event = assembled(&window.id, &series, &before, terminal, options)?;
    event.spikes = spikes;
    event.elsewhere = event.moved_one_by_one();
    Ok(event)
}

/// Samples over which a longer window spreads a jump.
fn spread(series: &Series, options: &IntakeOptions) -> usize {
    match options.filter {
        FilterChoice::Fixed(PhasorFilter::Longer(window)) => samples_of(window.cycles(), series),
        _ => 0,
    }
}

fn terminal_voltage(
    series: &Series,
    before: &operating_point::PreEvent,
    mut steep: Vec<bool>,
    options: &IntakeOptions,
) -> Option<Terminal> {
    let noise = edges::input_noise(series).max(NOISE_LEAST);
    let log = terminal_log(series, before);
    let found = jumps::find(series, &log, &steep, noise, options.filter);
    let mut measured = found.measured;
    let (jumps, edges): (Vec<Jump>, Vec<Edge>) = found.jumps.into_iter().unzip();
    for (jump, edge) in jumps.iter().zip(&edges) {
        // A small one, of which no step is as steep as those of an edge.
        if !steep[jump.anchor] {
            steep[edge.left..edge.right].fill(true);
        }
    }
    stiffness::estimate(&mut measured, &jumps);
    let whole = (0, series.len() - 1);
    let voltage = Voltage::fit(&measured, whole, &jumps, None)?.with_variances(&measured)?;
    Some(Terminal {
        voltage,
        measured,
        edges,
        filter: found.filter,
        unexplained: found.unexplained,
        steep,
    })
}

fn assembled(
    id: &str,
    series: &Series,
    before: &operating_point::PreEvent,
    u: Terminal,
    options: &IntakeOptions,
) -> Result<PreparedEvent, Unusable> {
    let scaled = |x: &[f64]| x.iter().map(|y| y / before.active).collect::<Vec<_>>();
    let (active, reactive) = (scaled(&series.active), scaled(&series.reactive));
    let n = series.len();
    let uncertain = weights::InputUncertainty {
        phasor: u.measured.log.iter().map(|l| l.exp()).collect(),
        voltage_noise: u.measured.noise,
        deviation: (0..n).map(|k| u.voltage.deviation_at_sample(k)).collect(),
        mismatch: mismatch(&u, n),
        unexplained: near_unexplained(&u, n),
        behind_filter: (0..n)
            .map(|k| u.measured.in_reach(u.voltage.jumps(), k))
            .collect(),
    };
    let weigh =
        |values: &[f64], share: f64| weights::channel(values, before.samples, &uncertain, share);
    let active_weights = weigh(&active, options.edge_share_active);
    let reactive_weights = weigh(&reactive, options.edge_share_reactive);
    check_load(before.active, active_weights.noise)?;
    let to_edge = edges::distance_to_edge(&u.steep, n);
    let angle: Vec<f64> = (0..n).map(|k| u.voltage.at_sample(k).im).collect();
    let frequency_deviation = frequency::deviation(&angle, &to_edge, series);
    let two_cycles = 2.0 * series.samples_per_cycle();
    let input = terminal_input(&u.measured, &u.voltage, 2.0 * PI * before.frequency_hz);
    let voltage = seen_voltage(&u, n);
    Ok(PreparedEvent {
        id: id.to_owned(),
        rate_fps: series.rate_fps,
        v0_pu: before.voltage,
        p0_pu: before.active,
        q0_pu: before.reactive,
        reactive_offset: [0.0; 2],
        site: None,
        steady_start: before.steady,
        event_start: before.samples,
        chain: chain(&u.measured, &u.voltage, &input, &frequency_deviation),
        input,
        lowest_voltage: voltage.iter().copied().fold(f64::INFINITY, f64::min),
        highest_voltage: voltage.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        voltage,
        frequency_deviation,
        active,
        reactive,
        operating_point_deviation: operating_point_deviation(before, active_weights.noise),
        active_deviation: active_weights.deviation,
        reactive_deviation: reactive_weights.deviation,
        active_noise: active_weights.noise,
        reactive_noise: reactive_weights.noise,
        used: weights::used(series, &gaps::behind(series, before.voltage, before.active)),
        near_edge: to_edge.iter().map(|d| *d <= two_cycles).collect(),
        edges: u.edges,
        filter: u.filter,
        origin: Some(Origin {
            terminal: u.voltage,
            measured: u.measured,
        }),
        elsewhere: Arc::new([]),
        spikes: 0,
    })
}

/// `|u|` at the samples as the instrument sees it, without its noise.
fn seen_voltage(u: &Terminal, samples: usize) -> Vec<f64> {
    (0..samples)
        .map(|k| {
            if u.measured.in_reach(u.voltage.jumps(), k) {
                let missed = u.voltage.residual(&u.measured, k);
                u.measured.log[k].re.exp() * (1.0 - missed).norm()
            } else {
                u.voltage.at_sample(k).re.exp()
            }
        })
        .collect()
}

/// For each sample, what the filter leaves unexplained of the voltage of the jumps spread over it.
fn mismatch(u: &Terminal, samples: usize) -> Vec<f64> {
    (0..samples)
        .map(|k| {
            (u.voltage.jumps().iter().zip(&u.edges))
                .filter(|(jump, _)| u.measured.spread(jump, k))
                .map(|(_, edge)| edge.mismatch)
                .fold(0.0, f64::max)
        })
        .collect()
}

/// Samples close to a steep step that no jump explains. Without a filter every sample is right up to
/// the jump itself.
fn near_unexplained(u: &Terminal, samples: usize) -> Vec<bool> {
    const REACH: usize = 3;
    if u.filter == Some(PhasorFilter::None) {
        return vec![false; samples];
    }
    (0..samples)
        .map(|k| {
            let steps = k.saturating_sub(REACH)..(k + REACH).min(u.unexplained.len());
            u.unexplained[steps].iter().any(|x| *x)
        })
        .collect()
}

fn terminal_input(measured: &Measured, voltage: &Voltage, speed_rad_s: f64) -> TerminalInput {
    let samples = measured.log.len();
    let per = POINTS_PER_SAMPLE;
    let fine: Vec<Log> = (0..=(samples - 1) * per)
        .map(|i| voltage.on_grid(i as f64 / per as f64, per).exp())
        .collect();
    let mut jumps = vec![false; samples - 1];
    for jump in voltage.jumps() {
        // The jump is spread over one fine interval, which may reach into the next sample's.
        let blurred = 0.5 / per as f64;
        for edge in [jump.position - blurred, jump.position + blurred] {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped to the samples"
            )]
            let interval = edge.max(0.0) as usize;
            jumps[interval.min(samples - 2)] = true;
        }
    }
    TerminalInput {
        real: fine.iter().map(|u| u.re).collect(),
        imaginary: fine.iter().map(|u| u.im).collect(),
        points_per_sample: per,
        sample_interval_s: measured.interval_s,
        dense: dense_intervals(measured, voltage, samples),
        jumps,
        synchronous_speed_rad_s: speed_rad_s,
    }
}

/// The intervals under the windows of filtered samples, and one more each side.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a filter spans a handful of samples"
)]
fn dense_intervals(measured: &Measured, voltage: &Voltage, samples: usize) -> Vec<bool> {
    let reach = measured.half_width.ceil() as usize;
    let mut dense = vec![false; samples - 1];
    for k in (0..samples).filter(|&k| measured.changes(voltage.jumps(), k)) {
        let window = k.saturating_sub(reach + 1)..(k + reach + 1).min(samples - 1);
        dense[window].fill(true);
    }
    dense
}

fn chain(
    measured: &Measured,
    voltage: &Voltage,
    input: &TerminalInput,
    frequency_deviation: &[f64],
) -> MeasurementChain {
    let positions: Vec<f64> = voltage.jumps().iter().map(|j| j.position).collect();
    let filtered: Vec<bool> = (0..measured.log.len())
        .map(|k| measured.changes(voltage.jumps(), k))
        .collect();
    MeasurementChain::new(&ChainParts {
        input,
        filter: measured.filter,
        half_width: measured.half_width,
        jumps: &positions,
        filtered: &filtered,
        frequency_deviation,
    })
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
pub(super) fn terminal_log(series: &Series, before: &operating_point::PreEvent) -> Vec<Log> {
    (0..series.len())
        .map(|k| {
            let turn = before.angle + before.angle_slope * k as f64;
            Log::new(
                (series.voltage[k].max(1e-3) / before.voltage).ln(),
                series.angle[k] - turn,
            )
        })
        .collect()
}

fn check_disturbance(measured: &Measured, options: &IntakeOptions) -> Result<(), Unusable> {
    let change = measured
        .log
        .iter()
        .zip(&measured.bad)
        .filter(|(_, bad)| !**bad)
        .map(|(l, _)| (l.re.exp() - 1.0).abs())
        .fold(0.0, f64::max);
    if change < options.voltage_change_min {
        Err(Unusable::NoDisturbance { change })
    } else {
        Ok(())
    }
}

/// No load of a site is larger than this, whatever its base; a number that is, is none.
const ACTIVE_MAX_PU: f64 = 1e9;

fn check_load(active_pu: f64, relative_noise: f64) -> Result<(), Unusable> {
    let noise_pu = (relative_noise * active_pu).abs();
    if active_pu > 0.0 && active_pu < ACTIVE_MAX_PU && relative_noise.abs() < 0.2 {
        Ok(())
    } else {
        Err(Unusable::NoLoad {
            active_pu,
            noise_pu,
        })
    }
}
