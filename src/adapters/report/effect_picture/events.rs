//! The three dips in which effects are shown.

use nalgebra::Complex;

use super::super::figure::Ink;
use crate::{
    identification::intake::{IntakeOptions, local_motion},
    load_model::{
        ComposedModel, Drive, Response, SimulationError, TerminalInput, effect::Needs,
        effects::find,
    },
};

const RATE_FPS: f64 = 60.0;
const POINTS: usize = 16;
const REACTIVE_AT_REST: f64 = 0.3;
const NOMINAL_RAD_S: f64 = 376.99;
/// When the dips begin, and how long they last, s: longer than the delays of most relays.
pub(super) const ONSET_S: f64 = 0.5;
const DIP_S: f64 = 0.15;
/// Shortest and longest time shown after the onset, s.
const AFTER_S: (f64, f64) = (2.5, 60.0);
/// Where a window is longer, s, what lasts less than this after the dip, s, is next to it.
const LONG_S: f64 = 12.0;
const SOON_S: f64 = 0.5;
/// What the voltage lacks at first after the clearing of the deepest dip.
const SLOW_DROP: f64 = 0.05;
/// How far it overshoots what an effect needs.
const OVERSHOOT: f64 = 0.03;
/// The frequency swings into where it ends: angular speed, rad/s, and decay, s.
const SWING_RAD_S: f64 = 3.8;
const SWING_S: f64 = 1.2;
/// The most that the frequency ends at where no relay needs more; of a relay's setting: the swing takes it beyond.
const DEVIATION_MOST: f64 = 0.004;
const OF_SETTING: f64 = 0.8;
/// Samples each side of a jump that intake takes for near it.
const REACH: usize = 2;
/// Noise that the refit's weights assume, over P0.
const NOISE: f64 = 1e-3;

/// What tells the dips apart, and how they are drawn. Depth, lasting change of voltage and frequency do not go with each
/// other: what an effect does is not taken for what ZIP and motor do at another voltage.
pub(super) struct Shown {
    /// What is left of the voltage in the dip.
    retained: f64,
    /// What it stays below V0 for good.
    lasting_drop: f64,
    /// What the frequency ends at, of the most of the three.
    frequency: f64,
    pub(super) ink: Ink,
    pub(super) width_quarter_px: u32,
}

pub(super) const SHOWN: [Shown; 3] = [
    Shown {
        retained: 0.9,
        lasting_drop: 0.03,
        frequency: 0.4,
        ink: Ink::Rival,
        width_quarter_px: 5,
    },
    Shown {
        retained: 0.7,
        lasting_drop: 0.015,
        frequency: -0.8,
        ink: Ink::Measured,
        width_quarter_px: 7,
    },
    Shown {
        retained: 0.5,
        lasting_drop: 0.0,
        frequency: -1.0,
        ink: Ink::Model,
        width_quarter_px: 9,
    },
];

/// One dip: its voltage, its frequency, and P and Q of the load with the effect at every sample.
pub(super) struct Dip {
    input: TerminalInput,
    deviation: Vec<f64>,
    /// Output instants that are samples.
    pub(super) samples: Vec<usize>,
    /// How far the voltage moves around every sample.
    motion: Vec<f64>,
    pub(super) load: [Vec<f64>; 2],
}

impl Dip {
    /// The dips, with what `load` draws in them.
    pub(super) fn all(
        load: &ComposedModel,
        parameters: &[f64],
        needs: Option<&Needs>,
    ) -> Result<Vec<Self>, SimulationError> {
        let after_s = needs.map_or(AFTER_S.0, |n| n.window_s.clamp(AFTER_S.0, AFTER_S.1));
        let highest = needs.and_then(|n| n.voltage_above);
        let most = deviation_reached(load, parameters);
        let dip = |shown: &Shown| {
            let mut dip = Self::new(shown, after_s, highest, most * shown.frequency);
            dip.load = dip.channels(&dip.simulate(load, parameters, &[])?);
            Ok(dip)
        };
        SHOWN.iter().map(dip).collect()
    }

    fn new(shown: &Shown, after_s: f64, highest: Option<f64>, reached: f64) -> Self {
        let input = phasors(shown, after_s, highest, reached);
        let points = input.output_points();
        let fine_s = input.sample_interval_s / input.points_per_sample as f64;
        let since_s = |point: &usize| *point as f64 * fine_s - ONSET_S;
        let samples = (points.iter().enumerate())
            .filter(|(_, point)| point.is_multiple_of(POINTS))
            .map(|(place, _)| place)
            .collect();
        let phasor: Vec<Complex<f64>> = (input.real.iter().zip(&input.imaginary))
            .step_by(POINTS)
            .map(|(re, im)| Complex::new(*re, *im))
            .collect();
        // The turning of the phasor between jumps is smooth, and followed.
        let near = |k: usize| {
            let steps = k.saturating_sub(REACH)..(k + REACH).min(input.jumps.len());
            input.jumps[steps].contains(&true)
        };
        Self {
            deviation: points
                .iter()
                .map(|p| reached * course(since_s(p))[0])
                .collect(),
            samples,
            motion: (0..phasor.len())
                .map(|k| {
                    if near(k) {
                        local_motion(&phasor, k, 0.0)
                    } else {
                        0.0
                    }
                })
                .collect(),
            input,
            load: Default::default(),
        }
    }

    pub(super) fn simulate(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        wanted: &[usize],
    ) -> Result<Response, SimulationError> {
        let drive = Drive::new(&self.input, &self.deviation, REACTIVE_AT_REST);
        model.simulate(parameters, wanted, &drive)
    }

    /// P and Q at the samples.
    pub(super) fn channels(&self, response: &Response) -> [Vec<f64>; 2] {
        [&response.active, &response.reactive]
            .map(|channel| self.samples.iter().map(|&k| channel[k]).collect())
    }

    pub(super) fn voltage(&self) -> Vec<f64> {
        let real = self.input.real.iter().step_by(POINTS);
        let imaginary = self.input.imaginary.iter().step_by(POINTS);
        real.zip(imaginary).map(|(x, y)| x.hypot(*y)).collect()
    }

    /// Deviation of the frequency at the samples.
    pub(super) fn frequency(&self) -> Vec<f64> {
        self.samples.iter().map(|&k| self.deviation[k]).collect()
    }

    /// Whether the voltage jumps next to a sample; in a long window, whether it is in the dip or soon after.
    pub(super) fn is_near_edge(&self, sample: usize) -> bool {
        let is_long = time_s(self.samples.len()) > LONG_S;
        let at_dip = (0.0..DIP_S + SOON_S).contains(&time_s(sample));
        self.motion[sample] > 0.0 || is_long && at_dip
    }

    /// Deviation of every sample of a channel as intake has it: noise, and near edges what goes with the motion of
    /// the voltage.
    pub(super) fn deviations(&self, channel: usize) -> Vec<f64> {
        let options = IntakeOptions::default();
        let share = [options.edge_share_active, options.edge_share_reactive][channel];
        let of = |motion: &f64| NOISE.hypot(share * motion);
        self.motion.iter().map(of).collect()
    }
}

/// Seconds since the onset.
pub(super) fn time_s(sample: usize) -> f64 {
    sample as f64 / RATE_FPS - ONSET_S
}

/// The phasor of a dip with phase jumps, whose angle takes the course of the frequency.
fn phasors(shown: &Shown, after_s: f64, highest: Option<f64>, reached: f64) -> TerminalInput {
    let samples = 1
        + (1..=100_000_u32)
            .take_while(|k| f64::from(*k) <= (ONSET_S + after_s) * RATE_FPS)
            .count();
    let depth = 1.0 - shown.retained;
    let swell = highest.map_or(0.0, |v| v - 1.0 + OVERSHOOT);
    let phasor = |i: usize| {
        let time_s = i as f64 / (RATE_FPS * POINTS as f64) - ONSET_S;
        let turned = NOMINAL_RAD_S * reached * course(time_s)[1];
        let (magnitude, angle) = if time_s < 0.0 {
            (1.0, 0.0)
        } else if time_s < DIP_S {
            (shown.retained, -0.2 * depth)
        } else {
            let slow = (-(time_s - DIP_S) / 0.3).exp();
            let late = (-(time_s - DIP_S) / 0.8).exp();
            let lacking = shown.lasting_drop + SLOW_DROP * depth / 0.5 * slow;
            (1.0 - lacking + swell * (late - slow), -0.02 * (1.0 - slow))
        };
        [
            magnitude * (angle + turned).cos(),
            magnitude * (angle + turned).sin(),
        ]
    };
    let grid: Vec<[f64; 2]> = (0..=(samples - 1) * POINTS).map(phasor).collect();
    let edge = |k: usize, reach: f64| {
        let begins = k as f64 / RATE_FPS - ONSET_S;
        let interval_s = 1.0 / RATE_FPS;
        [0.0, DIP_S].iter().any(|at| {
            (begins - reach * interval_s..=begins + (1.0 + reach) * interval_s).contains(at)
        })
    };
    TerminalInput {
        real: grid.iter().map(|u| u[0]).collect(),
        imaginary: grid.iter().map(|u| u[1]).collect(),
        points_per_sample: POINTS,
        sample_interval_s: 1.0 / RATE_FPS,
        jumps: (0..samples - 1).map(|k| edge(k, 0.01)).collect(),
        dense: (0..samples - 1).map(|k| edge(k, 3.0)).collect(),
        synchronous_speed_rad_s: NOMINAL_RAD_S,
    }
}

/// The largest lasting deviation of the frequency.
fn deviation_reached(load: &ComposedModel, parameters: &[f64]) -> f64 {
    let settings = load.effect_names().filter_map(find).flat_map(|effect| {
        let own = effect.declaration().name;
        let names = effect.frequency_thresholds().iter();
        names.filter_map(move |name| load.index(&format!("{own}.{name}")))
    });
    let beyond = settings.map(|index| OF_SETTING * parameters[index]);
    beyond.fold(DEVIATION_MOST, f64::max)
}

/// The course of the frequency since the onset, 1 where it ends, and its integral, s.
fn course(since_s: f64) -> [f64; 2] {
    let t = since_s.max(0.0);
    let left = (-t / SWING_S).exp();
    let (sine, cosine) = (SWING_RAD_S * t).sin_cos();
    let rate = 1.0 / SWING_S;
    let swung = left * (SWING_RAD_S * sine - rate * cosine) + rate;
    [
        1.0 - left * cosine,
        t - swung / (rate * rate + SWING_RAD_S * SWING_RAD_S),
    ]
}
