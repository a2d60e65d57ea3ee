//! Single-event identification problems with a known truth and a known input, the same for the
//! program and for every method it is held against.
//!
//! Problem `index` of seed `seed` depends on these two numbers only. The load is simulated by
//! `truth`, which shares no code with the estimator; the terminal voltage is handed to the estimator
//! as it is, so that a study measures the fit and nothing else.

mod truth_draw;
mod voltage_draw;

use loadmodeld::{
    identification::{
        intake::{KnownTerminal, PreparedEvent},
        joint_problem::ProblemOptions,
    },
    load_model::TerminalInput,
    truth::{self, CompositeLoad, IntegratorOptions, Phasor, PrescribedVoltage, Random},
};

pub use truth_draw::{Family, Truth};
pub use voltage_draw::Disturbance;

/// Samples of an event.
pub const SAMPLES: usize = 600;
/// Samples per second.
pub const RATE_FPS: f64 = 60.0;
/// Fine grid points per sample, as intake makes them.
pub const POINTS_PER_SAMPLE: usize = 32;
/// Nominal frequency, Hz.
pub const NOMINAL_HZ: f64 = 60.0;
/// Seed of the published study.
pub const PUBLISHED_SEED: u64 = 2014;
/// Standard deviation assumed where the data have no noise, relative to P0.
const LEAST_DEVIATION: f64 = 1e-3;
/// Power over P0 that no recording of a load shows; the corners of (14) reach a thousand.
const LARGEST_POWER: f64 = 10.0;
/// Noise of P and Q relative to P0.
const NOISES: [f64; 3] = [0.0, 1e-3, 5e-3];

/// A problem and what made it.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Number within the seed.
    pub index: usize,
    /// The load.
    pub truth: Truth,
    /// The voltage.
    pub disturbance: Disturbance,
    /// Noise of P and Q relative to P0.
    pub noise: f64,
    /// The data.
    pub event: PreparedEvent,
}

/// The objective of the study: weighted least squares of P and Q, the same composition in every
/// event, no prior worth mentioning, so that it can be written as a sum of squared residuals.
pub fn plain_objective() -> ProblemOptions {
    ProblemOptions {
        composition_spread: [0.0; 5],
        // The precision 1e-8 keeps the linear problem regular and is 1e-12 of what the data say.
        static_prior_deviation: 1e4,
        ..ProblemOptions::default()
    }
}

/// Problem `index` of `seed`.
pub fn problem(seed: u64, index: usize) -> Problem {
    let mut random = Random::for_part(seed, index as u64);
    let family = Family::of_index(index);
    let noise = NOISES[random.below(NOISES.len())];
    let second_motor = random.uniform() < 0.25;
    let disturbance = Disturbance::draw(&mut random);
    let (phasors, jumps) = disturbance.grid();
    loop {
        let drawn = Truth::draw(family, second_motor, &mut random);
        if let Some((truth, power)) = drawn.and_then(|t| response(&t, &phasors).map(|p| (t, p))) {
            let input = terminal_input(&phasors, jumps);
            let event = event(index, &truth, input, &power, noise, &mut random);
            return Problem {
                index,
                truth,
                disturbance,
                noise,
                event,
            };
        }
    }
}

/// One load under `count` disturbances: the events of a joint fit.
#[allow(dead_code, reason = "the study of single events has no use for it")]
pub fn joint_events(seed: u64, count: usize) -> Vec<PreparedEvent> {
    let mut random = Random::for_part(seed, u64::MAX);
    loop {
        let Some(truth) = Truth::draw(Family::NearTable1, false, &mut random) else {
            continue;
        };
        let events: Vec<PreparedEvent> = (0..count)
            .map_while(|index| {
                let (phasors, jumps) = Disturbance::draw(&mut random).grid();
                let power = response(&truth, &phasors)?;
                let input = terminal_input(&phasors, jumps);
                Some(event(index, &truth, input, &power, 1e-3, &mut random))
            })
            .collect();
        if events.len() == count {
            return events;
        }
    }
}

/// The load's power at the samples; none where it cannot be simulated, grows beyond measure or turns
/// a motor backwards.
fn response(truth: &Truth, phasors: &[Phasor]) -> Option<Vec<Phasor>> {
    let load = CompositeLoad {
        motors: truth.motors(),
        zip: truth.parameters.zip(),
        initial: Phasor::new(1.0, truth.q0_over_p0),
        nominal_hz: NOMINAL_HZ,
    };
    let voltage = PrescribedVoltage {
        phasors,
        interval_s: 1.0 / (RATE_FPS * POINTS_PER_SAMPLE as f64),
    };
    let options = IntegratorOptions::default();
    let response = truth::respond(&load, &voltage, POINTS_PER_SAMPLE, options).ok()?;
    let usual = response.power.iter().all(|s| s.norm() < LARGEST_POWER);
    (usual && response.lowest_speed_pu > 0.0).then_some(response.power)
}

fn terminal_input(phasors: &[Phasor], jumps: Vec<bool>) -> TerminalInput {
    TerminalInput {
        real: phasors.iter().map(|u| u.re).collect(),
        imaginary: phasors.iter().map(|u| u.im).collect(),
        points_per_sample: POINTS_PER_SAMPLE,
        sample_interval_s: 1.0 / RATE_FPS,
        dense: vec![false; jumps.len()],
        jumps,
        synchronous_speed_rad_s: std::f64::consts::TAU * NOMINAL_HZ,
    }
}

fn event(
    index: usize,
    truth: &Truth,
    input: TerminalInput,
    power: &[Phasor],
    noise: f64,
    random: &mut Random,
) -> PreparedEvent {
    let mut measured = |value: fn(&Phasor) -> f64| -> Vec<f64> {
        let noisy = |s| value(s) + noise * random.normal();
        power.iter().map(noisy).collect()
    };
    let (active, reactive) = (measured(|s| s.re), measured(|s| s.im));
    PreparedEvent::from(KnownTerminal {
        id: format!("problem_{index:03}"),
        input,
        q0_over_p0: truth.q0_over_p0,
        frequency_deviation: vec![0.0; active.len()],
        active,
        reactive,
        noise: [noise.max(LEAST_DEVIATION); 2],
        operating_point_deviation: 0.0,
        event_start: voltage_draw::EVENT_START_S as usize * RATE_FPS as usize,
    })
}
