//! How often the diagnosis is right, on generated sites whose truth is known.
//!
//! `cargo run --release --example diagnosis_study -- [--seed N] [--first N] [--sites N] [--only NAME,NAME] [--pairs N] [--outside N] [--novel N] [--plain N] [--composition-spread SHARE] --lines FILE`
//! tries every effect of the truth simulator in sites of its own with numbers from `--first` to below `--sites`, pairs of effects in `--pairs`,
//! effects taken out of the catalogue in those below `--outside`, loads that no catalogue has below `--novel`, nothing hidden below `--plain`: one line of
//! JSON per site is added to `--lines`, and what is there already is not tried again. Noise, rate and
//! number of events go with the number of the site.
//!
//! With `--write DIR` in place of `--lines` the sites are written as folders, for the program's own commands.
//!
//! `cargo run --release --example diagnosis_study -- --summary FILE` prints the tables of
//! `docs/diagnosis-rates.md` from such lines.
#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::panic,
    clippy::disallowed_methods,
    reason = "a study prints its tables, stops at the first surprise and tells its time"
)]

mod cases;
mod novel;
mod summary;

use std::{
    collections::HashSet,
    fs::{File, OpenOptions, read_to_string},
    io::Write,
    path::Path,
    time::Instant,
};

use cases::{Case, Hidden};
use clap::{CommandFactory, Parser, error::ErrorKind};
use loadmodeld::truth::Effect;
use novel::Novel;
use serde_json::Value;

#[derive(Parser)]
#[command(
    name = "diagnosis_study",
    about = "How often the diagnosis is right, on generated sites whose truth is known"
)]
struct Arguments {
    /// Seed of all sites
    #[arg(long, default_value_t = 2026)]
    seed: u64,
    /// Number of the first site of each kind
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Sites with one effect: numbers below this one, each of every effect
    #[arg(long, default_value_t = 0)]
    sites: u64,
    /// Sites with two effects: numbers below this one
    #[arg(long, default_value_t = 0)]
    pairs: u64,
    /// Sites with an effect that the catalogue is made not to have: numbers below this one, each of every effect
    #[arg(long, default_value_t = 0)]
    outside: u64,
    /// Sites with a load that no catalogue has: numbers below this one, each of every kind
    #[arg(long, default_value_t = 0)]
    novel: u64,
    /// Sites with nothing hidden: numbers below this one
    #[arg(long, default_value_t = 0)]
    plain: u64,
    /// By how much the composition varies from event to event, share of P0
    #[arg(long)]
    composition_spread: Option<f64>,
    /// These effects only
    #[arg(long, value_name = "NAME,NAME", value_delimiter = ',')]
    only: Option<Vec<String>>,
    /// Add one line of JSON per site to this file; sites that it has are not tried again
    #[arg(long, value_name = "FILE")]
    lines: Option<String>,
    /// Write the sites as folders instead
    #[arg(long, value_name = "DIR")]
    write: Option<String>,
    /// Print the tables of such lines
    #[arg(long, value_name = "FILE")]
    summary: Option<String>,
}

/// Every kind of case in turn, so that an interrupted study has tried each about as often.
fn cases(asked: &Arguments) -> Vec<Case> {
    let wanted = |effect: &Effect| {
        let only = asked.only.as_ref();
        only.is_none_or(|only| only.iter().any(|name| name == effect.name()))
    };
    let effects: Vec<Effect> = Effect::ALL.into_iter().filter(wanted).collect();
    let mut cases = Vec::new();
    for number in asked.first..asked.sites.max(asked.outside) {
        for effect in &effects {
            if number < asked.sites {
                cases.push(Case::new(asked.seed, number, Hidden::Single(*effect)));
            }
            if number < asked.outside {
                cases.push(Case::new(asked.seed, number, Hidden::Outside(*effect)));
            }
        }
    }
    for number in asked.first..asked.novel {
        let novel = Novel::ALL.into_iter().map(Hidden::Novel);
        cases.extend(novel.map(|load| Case::new(asked.seed, number, load)));
    }
    let pairs = asked.first..asked.pairs;
    cases.extend(pairs.map(|number| Case::new(asked.seed, number, Hidden::pair(number))));
    cases.extend(
        (asked.first..asked.plain).map(|number| Case::new(asked.seed, number, Hidden::Nothing)),
    );
    let spread = |case: Case| match asked.composition_spread {
        Some(composition_spread) => case.spread(composition_spread),
        None => case,
    };
    cases.into_iter().map(spread).collect()
}

fn read(path: &str) -> Vec<Value> {
    let text = read_to_string(path).unwrap_or_default();
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

fn main() {
    let asked = Arguments::parse();
    if let Some(path) = &asked.summary {
        summary::print(&read(path));
        return;
    }
    if let Some(directory) = &asked.write {
        for case in cases(&asked) {
            case.write(Path::new(directory));
        }
        return;
    }
    let Some(path) = asked.lines.as_deref() else {
        Arguments::command()
            .error(
                ErrorKind::MissingRequiredArgument,
                "one of --lines, --write and --summary is needed",
            )
            .exit();
    };
    let known = |line: &Value| line["case"].as_str().map(str::to_owned);
    let tried: HashSet<String> = read(path).iter().filter_map(known).collect();
    let mut file: File = OpenOptions::new()
        .create(true)
        .append(true)
        .open(path)
        .unwrap();
    for case in cases(&asked)
        .iter()
        .filter(|case| !tried.contains(&case.name()))
    {
        let begun = Instant::now();
        let Some(mut line) = case.run() else { continue };
        line["seconds"] = begun.elapsed().as_secs_f64().into();
        println!(
            "{}: {} {} error {} {:.0} s",
            case.name(),
            line["status"].as_str().unwrap_or_default(),
            line["answers"],
            line["fitted"],
            begun.elapsed().as_secs_f64()
        );
        writeln!(file, "{line}").unwrap();
    }
}
