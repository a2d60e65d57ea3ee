//! How often the diagnosis is right, on generated sites whose truth is known.
//!
//! `cargo run --release --example diagnosis_study -- [--seed N] [--sites N] [--only NAME] [--pairs N] [--plain N] [--lines FILE]`
//!
//! Every effect of the truth simulator is hidden in `--sites` sites of its own, pairs of effects in
//! `--pairs`, nothing in `--plain`. One line of JSON per site goes to `--lines`, the tables of
//! `docs/diagnosis-rates.md` to standard output.
#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::panic,
    clippy::disallowed_methods,
    clippy::too_many_lines,
    reason = "a study prints its tables, stops at the first surprise and tells its time"
)]

use std::{collections::BTreeMap, fs::File, io::Write, time::Instant};

use loadmodeld::{
    adapters::recordings::site_folder,
    diagnosis::{Change, DiagnosisOptions, Status, diagnose, improve},
    disturbance::{ScreeningOptions, Window, screen},
    measurement::Site,
    truth::{Effect, StudyShape, SyntheticSite, study_site},
};
use serde_json::json;

struct Arguments {
    seed: u64,
    sites: u64,
    pairs: u64,
    plain: u64,
    only: Option<String>,
    lines: Option<String>,
}

fn arguments() -> Arguments {
    let mut found = Arguments {
        seed: 2026,
        sites: 8,
        pairs: 0,
        plain: 20,
        only: None,
        lines: None,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().unwrap();
        match word.as_str() {
            "--seed" => found.seed = value.parse().unwrap(),
            "--sites" => found.sites = value.parse().unwrap(),
            "--pairs" => found.pairs = value.parse().unwrap(),
            "--plain" => found.plain = value.parse().unwrap(),
            "--only" => found.only = Some(value),
            "--lines" => found.lines = Some(value),
            other => panic!("unknown option {other}"),
        }
    }
    found
}

/// Descriptions that the truth calls equal.
const EQUALS: [[&str; 2]; 1] = [["electronic_load_dropout", "self_disconnection"]];
/// What half of the sites have besides, so that naming it is right.
const ALSO_PRESENT: [&str; 2] = ["stator_resistance", "phasor_window"];

fn same(truth: &str, named: &str) -> bool {
    let equal = |pair: &[&str; 2]| pair.contains(&truth) && pair.contains(&named);
    truth == named || EQUALS.iter().any(equal)
}

/// Noise, rate and number of events of a site: every combination comes up.
fn shape(number: u64, effects: Vec<Effect>) -> StudyShape {
    let of = |values: &[f64], step: u64| {
        let count = values.len() as u64;
        values[usize::try_from(number / step % count).unwrap()]
    };
    StudyShape {
        effects,
        noise: of(&[0.001, 0.000_5, 0.002], 1),
        rate_fps: of(&[60.0, 50.0, 120.0, 30.0], 2),
        events: [10, 12, 8, 6][usize::try_from(number % 4).unwrap()],
        ..StudyShape::default()
    }
}

fn windows(site: &Site, made: &SyntheticSite) -> Vec<Window> {
    let numbered = made.records.iter().zip(1..);
    numbered
        .map(|(record, number)| Window {
            id: format!("event_{number:02}"),
            ..site_folder::window(site, record)
        })
        .filter(|window| screen(window, &ScreeningOptions::default()).usable())
        .collect()
}

/// The hidden effects' parameters, by name.
fn parameters(made: &SyntheticSite) -> BTreeMap<&'static str, f64> {
    let hidden = made.options.effects.iter();
    hidden
        .flat_map(|h| h.values().map(|(p, value)| (p.name, value)))
        .collect()
}

#[derive(Default)]
struct Row {
    sites: u32,
    visible: u32,
    first: u32,
    in_set: u32,
    set_size: usize,
    unknown: u32,
    nothing: u32,
    named: BTreeMap<String, u32>,
}

fn main() {
    let asked = arguments();
    let mut lines = asked.lines.as_ref().map(|path| File::create(path).unwrap());
    let structure = ["zip".to_owned(), "induction_motor".to_owned()];
    let options = DiagnosisOptions::default();
    let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
    let wanted = |name: &str| {
        asked
            .only
            .as_ref()
            .is_none_or(|only| only.split(',').any(|o| o == name))
    };
    let mut cases: Vec<(&str, u64, Vec<Effect>)> = Vec::new();
    for effect in Effect::ALL.into_iter().filter(|e| wanted(e.name())) {
        cases.extend((0..asked.sites).map(|number| (effect.name(), number, vec![effect])));
    }
    if asked.only.is_none() {
        cases.extend((0..asked.plain).map(|number| ("none", number, Vec::new())));
    }
    // Interrupted, it has tried every effect about as often.
    cases.sort_by_key(|(_, number, _)| *number);
    let begun = Instant::now();
    for (truth, number, effects) in cases {
        let code = Effect::ALL
            .iter()
            .position(|e| e.name() == truth)
            .unwrap_or(99) as u64;
        let made = match study_site(asked.seed, 1000 * code + number, &shape(number, effects)) {
            Ok(made) => made,
            Err(error) => {
                println!("{truth} {number}: not generated: {error}");
                continue;
            }
        };
        let site = made.options.site.clone();
        let windows = windows(&site, &made);
        let started = Instant::now();
        let found = diagnose(&site, &windows, &structure, &options, &|_| (), &|| false).unwrap();
        let seconds = started.elapsed().as_secs_f64();
        let row = rows.entry(truth).or_default();
        row.sites += 1;
        let baseline = found.baseline.fit.error_to_noise;
        let visible = truth != "none" && baseline > 1.5;
        row.visible += u32::from(visible);
        let answer: Vec<&str> = found.answer_set.iter().map(String::as_str).collect();
        let right = |named: &&str| same(truth, named);
        row.first += u32::from(answer.first().is_some_and(right));
        row.in_set += u32::from(answer.iter().any(right));
        row.set_size += answer.len();
        row.unknown += u32::from(found.status == Status::UnknownEffect);
        let only_besides = answer.iter().all(|a| ALSO_PRESENT.contains(a));
        row.nothing +=
            u32::from(answer.is_empty() || (only_besides && !ALSO_PRESENT.contains(&truth)));
        let name = answer.first().copied().unwrap_or(found.status.name());
        *row.named.entry(name.to_owned()).or_default() += 1;
        let top: Vec<_> = found
            .candidates
            .iter()
            .take(4)
            .map(|c| {
                json!([
                    c.effect,
                    c.delta_bic,
                    c.held_out_error_before,
                    c.held_out_error_after,
                    c.refused
                ])
            })
            .collect();
        println!(
            "{truth} {number}: {} {answer:?} baseline {baseline:.2} {seconds:.1} s; {}",
            found.status.name(),
            found.reasons.first().map_or("", String::as_str)
        );
        if let Some(file) = &mut lines {
            let line = json!({
                "truth": truth, "number": number, "status": found.status.name(), "answer": answer,
                "baseline": baseline, "seconds": seconds, "candidates": top, "reasons": found.reasons,
                "visible": visible, "parameters": parameters(&made),
            });
            writeln!(file, "{line}").unwrap();
        }
    }
    table(&mut rows);
    if asked.pairs > 0 {
        pairs(&asked, &structure, &options);
    }
    println!("{:.0} s", begun.elapsed().as_secs_f64());
}

fn table(rows: &mut BTreeMap<&str, Row>) {
    println!(
        "\n| hidden | sites | shows | right first | in the set | mean set | unknown effect | nothing | first answers |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (truth, row) in rows {
        let named: Vec<String> = row.named.iter().map(|(n, c)| format!("{n} {c}")).collect();
        println!(
            "| {truth} | {} | {} | {} | {} | {:.2} | {} | {} | {} |",
            row.sites,
            row.visible,
            row.first,
            row.in_set,
            row.set_size as f64 / f64::from(row.sites.max(1)),
            row.unknown,
            row.nothing,
            named.join(", ")
        );
    }
}

fn pairs(asked: &Arguments, structure: &[String], options: &DiagnosisOptions) {
    let (mut both, mut made_count) = (0, 0);
    let all: Vec<Effect> = Effect::ALL
        .into_iter()
        .filter(|e| !ALSO_PRESENT.contains(&e.name()))
        .collect();
    for number in 0..asked.pairs {
        let pick = |k: u64| all[usize::try_from(k % all.len() as u64).unwrap()];
        let two = [pick(number), pick(number * 7 + 5)];
        if two[0] == two[1] {
            continue;
        }
        let Ok(made) = study_site(asked.seed, 200_000 + number, &shape(number, two.to_vec()))
        else {
            continue;
        };
        let site = made.options.site.clone();
        let windows = windows(&site, &made);
        let found = improve(
            &site,
            &windows,
            structure,
            &Change::UntilAdequate,
            options,
            &|_| (),
            &|| false,
        );
        let Ok(found) = found else { continue };
        let steps: Vec<&str> = found
            .steps
            .iter()
            .filter_map(|s| s.added.as_deref())
            .collect();
        let named = two
            .iter()
            .filter(|e| steps.iter().any(|s| same(e.name(), s)))
            .count();
        made_count += 1;
        both += u32::from(named == 2);
        let errors: Vec<String> = found
            .steps
            .iter()
            .map(|s| format!("{:.2}", s.errors.quoted().error_to_noise))
            .collect();
        println!(
            "pair {} + {}: {steps:?} {} errors {}",
            two[0].name(),
            two[1].name(),
            found.last.status.name(),
            errors.join(" ")
        );
    }
    println!("\npairs: both found {both} of {made_count}");
}
