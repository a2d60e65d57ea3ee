//! The program against a dense scan on problems with a known truth: is its best solution ever
//! beaten, does it find every solution, what does a fit cost, and does it give the same bytes twice.
//!
//! ```text
//! cargo bench --bench study -- [--problems 300] [--seed 2014] [--first 0] [--step 1] [--objective plain|default]
//!     [--scan 20x18x8] [--threads 2] [--json FILE] [--export DIRECTORY] [--determinism]
//! ```
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::disallowed_methods,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    missing_docs,
    unreachable_pub,
    reason = "a study prints its tables and measures time"
)]

#[path = "../clock.rs"]
mod clock;
mod export;
#[path = "../problems/mod.rs"]
mod problems;
mod report;
mod scan;

use std::{error::Error, fmt::Write as _, path::PathBuf};

use loadmodeld::identification::{
    fit::{Fit, SearchOptions, fit},
    joint_problem::{JointProblem, ProblemOptions},
};
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use problems::Problem;
use report::{Found, Outcome};

/// What to do.
struct Settings {
    problems: usize,
    first: usize,
    step: usize,
    seed: u64,
    objective: ProblemOptions,
    shape: [usize; 3],
    threads: usize,
    json: Option<PathBuf>,
    export: Option<PathBuf>,
    determinism: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let settings = Settings::from_arguments(std::env::args().skip(1))?;
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    if let Some(directory) = &settings.export {
        return export::write(directory, &settings);
    }
    if settings.determinism {
        let mut hashes = Vec::new();
        for threads in [1, 1, 2, 8] {
            let hash = pool(threads)?.install(|| hash_of_fits(&settings));
            println!("{threads} threads: {hash}");
            hashes.push(hash);
        }
        return if hashes.iter().all(|hash| *hash == hashes[0]) {
            Ok(())
        } else {
            Err("the same input gave different bytes".into())
        };
    }
    let outcomes: Vec<Outcome> = pool(settings.threads)?.install(|| {
        (settings.indices())
            .into_par_iter()
            .map(|index| study(&settings, index))
            .collect()
    });
    report::print(&outcomes);
    if let Some(file) = &settings.json {
        report::write_json(file, settings.seed, &outcomes)?;
    }
    Ok(())
}

/// One problem: the program's fit, then the scan.
fn study(settings: &Settings, index: usize) -> Outcome {
    let problem = problems::problem(settings.seed, index);
    let events = [problem.event.clone()];
    let started = clock::cpu_seconds();
    let found = fit(
        &events,
        settings.objective,
        &SearchOptions::default(),
        &|| false,
    );
    let fit_cpu_s = clock::cpu_seconds() - started;
    let joint = JointProblem::new(&events, settings.objective, &|| false);
    let started = clock::cpu_seconds();
    let scanned = scan::minima(&joint, settings.shape);
    let scan_cpu_s = clock::cpu_seconds() - started;
    let found_minima = solutions_of(found.as_ref());
    let outcome = report::compare(&problem, &joint, &found_minima, &scanned);
    let directions = found.as_ref().map_or(0, |f| f.directions.len());
    let cost = found.map(|f| f.cost).unwrap_or_default();
    eprintln!(
        "{index}: fit {:.6} in {:.0} ms, scan {:.6} in {:.0} ms",
        outcome.best_of_fit(),
        1e3 * fit_cpu_s,
        outcome.best_of_scan(),
        1e3 * scan_cpu_s
    );
    Outcome {
        fit_cpu_s,
        scan_cpu_s,
        directions,
        simulations: cost.simulations,
        sensitivity_simulations: cost.sensitivity_simulations,
        ..outcome
    }
}

fn solutions_of(found: Option<&Fit>) -> Vec<Found> {
    let solutions = found.map(|f| f.solutions.as_slice()).unwrap_or_default();
    solutions
        .iter()
        .map(|s| Found::new(s.found.local.x.as_slice(), &s.point, Some(s.found.tier)))
        .collect()
}

/// SHA-256 over every number of every fit, in order of the problems.
fn hash_of_fits(settings: &Settings) -> String {
    let texts: Vec<String> = (settings.indices())
        .into_par_iter()
        .map(|index| {
            let Problem { event, .. } = problems::problem(settings.seed, index);
            let found = fit(
                &[event],
                settings.objective,
                &SearchOptions::default(),
                &|| false,
            );
            // Rust prints the shortest decimal that reads back as the same number.
            found.map_or_else(String::new, |f| {
                let points: Vec<_> = (f.solutions.iter())
                    .map(|s| (&s.found, s.point.objective, s.point.linear))
                    .collect();
                format!("{points:?} {:?} {:?}", f.directions, f.cost)
            })
        })
        .collect();
    let digest = Sha256::digest(texts.concat());
    digest.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string cannot fail.
        write!(text, "{byte:02x}").ok();
        text
    })
}

impl Settings {
    fn from_arguments(arguments: impl Iterator<Item = String>) -> Result<Self, Box<dyn Error>> {
        let mut settings = Self {
            problems: 300,
            first: 0,
            step: 1,
            seed: problems::PUBLISHED_SEED,
            objective: problems::plain_objective(),
            shape: [20, 18, 8],
            threads: 2,
            json: None,
            export: None,
            determinism: false,
        };
        let mut arguments = arguments.peekable();
        while let Some(name) = arguments.next() {
            let mut value = || arguments.next().ok_or(format!("{name} needs a value"));
            match name.as_str() {
                "--problems" => settings.problems = value()?.parse()?,
                "--first" => settings.first = value()?.parse()?,
                "--step" => settings.step = value()?.parse::<usize>()?.max(1),
                "--seed" => settings.seed = value()?.parse()?,
                "--threads" => settings.threads = value()?.parse()?,
                "--scan" => settings.shape = shape(&value()?)?,
                "--json" => settings.json = Some(value()?.into()),
                "--export" => settings.export = Some(value()?.into()),
                "--determinism" => settings.determinism = true,
                "--objective" => {
                    settings.objective = match value()?.as_str() {
                        "plain" => problems::plain_objective(),
                        "default" => ProblemOptions::default(),
                        other => return Err(format!("no objective {other}").into()),
                    }
                }
                "--bench" => {} // cargo says so to every bench
                other => return Err(format!("unknown option {other}").into()),
            }
        }
        Ok(settings)
    }

    fn indices(&self) -> Vec<usize> {
        (0..self.problems)
            .map(|k| self.first + k * self.step)
            .collect()
    }
}

fn shape(text: &str) -> Result<[usize; 3], Box<dyn Error>> {
    let sizes: Vec<usize> = (text.split('x').map(str::parse)).collect::<Result<_, _>>()?;
    match <[usize; 3]>::try_from(sizes) {
        Ok(shape) if shape.iter().all(|n| *n >= 2) => Ok(shape),
        _ => Err(format!("a scan needs three sizes of at least 2, not {text}").into()),
    }
}
