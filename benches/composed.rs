//! What models with effects cost on the events of a site folder: one simulation without and with
//! all derivatives, a joint fit from the plain solution and typical values.
//!
//! ```text
//! cargo bench --bench composed -- SITE_DIR [STRUCTURE ...]
//! ```
//!
//! A structure is a list of effects joined by `+`. CPU time on one thread.
#![allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    missing_docs,
    unreachable_pub,
    reason = "a bench prints its table and measures time"
)]

#[path = "clock.rs"]
mod clock;

use std::{error::Error, hint::black_box, path::Path};

use loadmodeld::{
    adapters::recordings::site_folder,
    disturbance::Window,
    identification::{
        composed::{ComposedFitOptions, fit},
        fit::{SearchOptions, fit as search},
        intake::{IntakeOptions, PreparedEvent, prepare},
        joint_problem::ProblemOptions,
    },
    load_model::{
        Structure,
        composed::{ComposedModel, Drive, SimulationError},
    },
};

const STRUCTURES: [&str; 7] = [
    "",
    "stator_resistance",
    "second_motor",
    "feeder_impedance",
    "motor_undervoltage_trip",
    "phasor_window",
    "second_motor+feeder_impedance+exponential_recovery",
];
const REPEATS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    // cargo says --bench to every bench
    let mut arguments = std::env::args().skip(1).filter(|a| a != "--bench");
    let Some(site) = arguments.next() else {
        println!("no site folder given: nothing to measure");
        return Ok(());
    };
    let mut structures: Vec<String> = arguments.collect();
    if structures.is_empty() {
        structures = STRUCTURES.map(str::to_owned).to_vec();
    }
    // The clock counts the thread it is read on.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    alone.install(|| table(Path::new(&site), &structures).map_err(|e| e.to_string()))?;
    Ok(())
}

fn table(site: &Path, structures: &[String]) -> Result<(), Box<dyn Error>> {
    let events = events(site)?;
    let options = SearchOptions::default();
    let found = search(&events, ProblemOptions::default(), &options, &|| false);
    let best = found.and_then(|f| f.solutions.into_iter().next());
    let best = best.ok_or("no plain solution")?;
    println!("{} events\n", events.len());
    println!(
        "| effects | parameters | values, us | all derivatives, us | fit, s | evaluations | objective |"
    );
    println!("|---|---|---|---|---|---|---|");
    for text in structures {
        let names = ["zip", "induction_motor"].into_iter();
        let names: Vec<&str> = names
            .chain(text.split('+').filter(|n| !n.is_empty()))
            .collect();
        let model = ComposedModel::new(&Structure::parse(&names)?);
        let typical = model.typical();
        let all: Vec<usize> = (0..typical.len()).collect();
        let values = simulation(&events, &model, &typical, &[])?;
        let derivatives = simulation(&events, &model, &typical, &all)?;
        let mut start = typical;
        let plain = best.found.local.x.iter().chain(&best.point.linear);
        for (value, plain) in start.iter_mut().zip(plain) {
            *value = *plain;
        }
        let begun = clock::cpu_seconds();
        let options = ComposedFitOptions::default();
        let fitted = fit(&events, &model, &start, &all, &options, &|| false);
        let seconds = clock::cpu_seconds() - begun;
        let (evaluations, objective) =
            fitted.map_or((0, f64::NAN), |f| (f.evaluations, f.objective));
        println!(
            "| {text} | {} | {:.0} | {:.0} | {seconds:.3} | {evaluations} | {objective:.3} |",
            all.len(),
            1e6 * values,
            1e6 * derivatives
        );
    }
    Ok(())
}

fn events(site: &Path) -> Result<Vec<PreparedEvent>, Box<dyn Error>> {
    let folder = site_folder::load_events(site)?;
    let windows = folder.events.iter().map(|event| Window {
        id: event.name.clone(),
        ..site_folder::window(&folder.site, &event.record)
    });
    Ok(windows
        .filter_map(|window| prepare(&window, &IntakeOptions::default()).ok())
        .collect())
}

/// CPU seconds per event, the best of some repeats.
fn simulation(
    events: &[PreparedEvent],
    model: &ComposedModel,
    parameters: &[f64],
    wanted: &[usize],
) -> Result<f64, SimulationError> {
    let mut best = f64::INFINITY;
    for _ in 0..REPEATS {
        let begun = clock::cpu_seconds();
        for event in events {
            let drive = Drive::new(
                &event.input,
                event.chain.output_frequency_deviation(),
                event.q0_pu / event.p0_pu,
            );
            black_box(model.simulate(parameters, wanted, &drive)?);
        }
        best = best.min(clock::cpu_seconds() - begun);
    }
    Ok(best / events.len().max(1) as f64)
}
