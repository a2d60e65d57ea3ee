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
use loadmodeld::truth::Effect;
use novel::Novel;
use serde_json::Value;

#[derive(Default)]
struct Arguments {
    seed: u64,
    first: u64,
    sites: u64,
    pairs: u64,
    outside: u64,
    novel: u64,
    plain: u64,
    composition_spread: Option<f64>,
    only: Option<String>,
    lines: Option<String>,
    write: Option<String>,
    summary: Option<String>,
}

fn arguments() -> Arguments {
    let mut found = Arguments {
        seed: 2026,
        ..Arguments::default()
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().unwrap();
        match word.as_str() {
            "--seed" => found.seed = value.parse().unwrap(),
            "--first" => found.first = value.parse().unwrap(),
            "--sites" => found.sites = value.parse().unwrap(),
            "--pairs" => found.pairs = value.parse().unwrap(),
            "--outside" => found.outside = value.parse().unwrap(),
            "--novel" => found.novel = value.parse().unwrap(),
            "--plain" => found.plain = value.parse().unwrap(),
            "--composition-spread" => found.composition_spread = Some(value.parse().unwrap()),
            "--only" => found.only = Some(value),
            "--lines" => found.lines = Some(value),
            "--write" => found.write = Some(value),
            "--summary" => found.summary = Some(value),
            other => panic!("unknown option {other}"),
        }
    }
    found
}

/// Every kind of case in turn, so that an interrupted study has tried each about as often.
fn cases(asked: &Arguments) -> Vec<Case> {
    let wanted = |effect: &Effect| {
        let only = asked.only.as_ref();
        only.is_none_or(|only| only.split(',').any(|name| name == effect.name()))
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
    let pairs =
        (asked.first..asked.pairs).filter_map(|number| Hidden::pair(number).map(|p| (number, p)));
    cases.extend(pairs.map(|(number, pair)| Case::new(asked.seed, number, pair)));
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
    let asked = arguments();
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
        panic!("--lines FILE is missing");
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
