//! What a fit costs: one event, ten events jointly, derivatives, threads.
//!
//! ```text
//! cargo bench --bench fit -- [--problems 20] [--rounds 5]
//! ```
//!
//! Figures are medians over the rounds; what is compared is measured alternately in one run, so that
//! the load of the machine falls on both sides.
#![allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    missing_docs,
    unreachable_pub,
    reason = "a bench prints its table and measures time"
)]

mod clock;
#[allow(dead_code, reason = "the study says where a problem comes from")]
mod problems;

use std::{error::Error, hint::black_box};

use loadmodeld::{
    identification::{
        fit::{Fit, SearchOptions, fit},
        intake::PreparedEvent,
        joint_problem::{JointProblem, ProblemOptions, motor_coordinates},
    },
    load_model::{MotorCoordinates, MotorOutput},
    numerics::{Dual, Objective, Scalar},
};
use nalgebra::DVector;
use rayon::prelude::*;

/// An aggregated motor of ordinary data: ln alpha, ln nu, kappa.
const ORDINARY: [f64; 3] = [3.4, 7.0, 0.4];

fn main() -> Result<(), Box<dyn Error>> {
    let (mut count, mut rounds) = (20, 5);
    let mut arguments = std::env::args().skip(1);
    while let Some(name) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{name} needs a value"));
        match name.as_str() {
            "--problems" => count = value()?.parse()?,
            "--rounds" => rounds = value()?.parse()?,
            "--bench" => {} // cargo says so to every bench
            other => return Err(format!("unknown option {other}").into()),
        }
    }
    let events: Vec<PreparedEvent> = (0..count)
        .map(|index| problems::problem(problems::PUBLISHED_SEED, index).event)
        .collect();
    println!("| what | median | spread (10 to 90 %) |\n|---|---|---|");
    derivatives(&events, rounds);
    // The clock counts the thread it is read on: the search must stay on that one.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    single_events(&events, rounds, &alone);
    joint_fit(rounds.min(3))?;
    threads(&events, rounds.min(3))
}

/// One simulation and one evaluation of the objective, without and with derivatives.
fn derivatives(events: &[PreparedEvent], rounds: usize) {
    const REPEATS: usize = 20;
    let x = DVector::from_column_slice(&ORDINARY);
    let plain = motor_coordinates(&x);
    let dual = MotorCoordinates {
        alpha_per_s: Dual::<3>::variable(x[0], 0).exp(),
        nu_per_s2: Dual::<3>::variable(x[1], 1).exp(),
        kappa: Dual::<3>::variable(x[2], 2),
    };
    let (mut out, mut slopes) = (MotorOutput::default(), MotorOutput::default());
    let mut times = [const { Vec::new() }; 5];
    for _ in 0..rounds {
        for event in events {
            let joint = single(event);
            let points = vec![x.clone(); 64];
            times[0].push(time(REPEATS, || {
                plain.simulate(&event.input, &mut out).is_ok()
            }));
            times[1].push(time(REPEATS, || {
                dual.simulate(&event.input, &mut slopes).is_ok()
            }));
            times[2].push(time(REPEATS, || joint.value(&x).is_some()));
            times[3].push(time(REPEATS, || joint.expansion(&x).is_some()));
            times[4].push(time(1, || joint.values(&points).len() == 64) / 64.0);
        }
    }
    let [plain, dual, value, expansion, batch] = &times;
    line(
        "simulation of 600 samples, ordinary motor",
        plain,
        "us",
        1e6,
    );
    line("the same with three sensitivities", dual, "us", 1e6);
    ratio("sensitivities / plain", dual, plain);
    line("objective", value, "us", 1e6);
    line("objective, gradient and curvature", expansion, "us", 1e6);
    ratio("with derivatives / without", expansion, value);
    line(
        "objective, 64 points asked for at once, per point",
        batch,
        "us",
        1e6,
    );
}

/// The whole search of one event, by the study's objective and by the program's default.
fn single_events(events: &[PreparedEvent], rounds: usize, alone: &rayon::ThreadPool) {
    let mut times = [Vec::new(), Vec::new()];
    let mut simulations = Vec::new();
    for _ in 0..rounds {
        for event in events {
            let options = [problems::plain_objective(), ProblemOptions::default()];
            for (times, options) in times.iter_mut().zip(options) {
                let (found, seconds) = alone.install(|| {
                    let started = clock::cpu_seconds();
                    let found = searched(std::slice::from_ref(event), options);
                    (found, clock::cpu_seconds() - started)
                });
                times.push(seconds);
                let cost = found.map(|f| f.cost).unwrap_or_default();
                simulations.push((cost.simulations + cost.sensitivity_simulations) as f64);
            }
        }
    }
    line(
        "fit of one event, plain least squares (CPU)",
        &times[0],
        "ms",
        1e3,
    );
    line(
        "fit of one event, the program's objective (CPU)",
        &times[1],
        "ms",
        1e3,
    );
    line("simulations of such a fit", &simulations, "", 1.0);
}

fn joint_fit(rounds: usize) -> Result<(), Box<dyn Error>> {
    let events = problems::joint_events(problems::PUBLISHED_SEED, 10);
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..rounds {
        for (times, threads) in times.iter_mut().zip([1, 2]) {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()?;
            let started = clock::wall_seconds();
            pool.install(|| drop(black_box(searched(&events, ProblemOptions::default()))));
            times.push(clock::wall_seconds() - started);
        }
    }
    line(
        "joint fit of 10 events, 1 thread (wall)",
        &times[0],
        "ms",
        1e3,
    );
    line(
        "joint fit of 10 events, 2 threads (wall)",
        &times[1],
        "ms",
        1e3,
    );
    ratio("1 thread / 2 threads", &times[0], &times[1]);
    Ok(())
}

/// Fits of single events side by side.
fn threads(events: &[PreparedEvent], rounds: usize) -> Result<(), Box<dyn Error>> {
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..rounds {
        for (times, threads) in times.iter_mut().zip([1, 2]) {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()?;
            let started = clock::wall_seconds();
            pool.install(|| {
                events.par_iter().for_each(|event| {
                    let event = std::slice::from_ref(event);
                    drop(black_box(searched(event, ProblemOptions::default())));
                });
            });
            times.push(clock::wall_seconds() - started);
        }
    }
    let name = |threads| format!("{} single fits, {threads} (wall)", events.len());
    line(&name("1 thread"), &times[0], "ms", 1e3);
    line(&name("2 threads"), &times[1], "ms", 1e3);
    ratio("1 thread / 2 threads", &times[0], &times[1]);
    Ok(())
}

fn searched(events: &[PreparedEvent], options: ProblemOptions) -> Option<Fit> {
    fit(events, options, &SearchOptions::default(), &|| false)
}

fn single(event: &PreparedEvent) -> JointProblem<'_> {
    let events = std::slice::from_ref(event);
    JointProblem::new(events, problems::plain_objective(), &|| false)
}

/// CPU seconds of one of `repeats` calls.
fn time(repeats: usize, mut work: impl FnMut() -> bool) -> f64 {
    let started = clock::cpu_seconds();
    for _ in 0..repeats {
        black_box(work());
    }
    (clock::cpu_seconds() - started) / repeats as f64
}

fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
    sorted.get(at).copied().unwrap_or(f64::NAN)
}

fn line(what: &str, seconds: &[f64], unit: &str, factor: f64) {
    let [low, middle, high] = [0.1, 0.5, 0.9].map(|share| factor * quantile(seconds, share));
    println!("| {what} | {middle:.1} {unit} | {low:.1} to {high:.1} |");
}

/// Median of the ratios of measurements made next to each other.
fn ratio(what: &str, over: &[f64], under: &[f64]) {
    let ratios: Vec<f64> = over.iter().zip(under).map(|(a, b)| a / b).collect();
    let [low, middle, high] = [0.1, 0.5, 0.9].map(|share| quantile(&ratios, share));
    println!("| {what} | {middle:.2} | {low:.2} to {high:.2} |");
}
