//! The pages of the manual: one per effect, their list, and the motor to which they refer.

use std::path::PathBuf;

use super::{BASE, contract::effects_folder};
use crate::load_model::{
    effect::{Kind, page, parameter_row},
    effects::{catalogue, description},
};

fn manual() -> PathBuf {
    effects_folder().join("../../../docs/effects")
}

/// Compares a page with what is expected, or writes it.
fn current(name: &str, expected: &str) {
    let path = manual().join(name).with_extension("md");
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::create_dir_all(manual()).unwrap();
        std::fs::write(&path, expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(
        found,
        expected,
        "{} is stale: run UPDATE_DOCS=1 cargo test the_manual",
        path.display()
    );
}

#[test]
fn the_manual_has_one_current_page_per_effect() {
    let mut refer_to_motor = 0;
    for effect in catalogue() {
        let declaration = effect.declaration();
        let name = declaration.name;
        let described = description(name).unwrap();
        refer_to_motor += usize::from(described.contains("`base_motor`"));
        let described = described.replace("`base_motor`", "[`base_motor`](base_motor.md)");
        // The picture is kept current by `adapters::report`.
        let picture = format!(
            "![What is left of P and Q when {name} is missing, in dips of 10, 30 and 50 %]({name}.svg)\n"
        );
        current(name, &(page(declaration, &described) + "\n" + &picture));
    }
    assert!(refer_to_motor >= 7, "{refer_to_motor} pages");
}

#[test]
fn the_manual_lists_every_effect_in_a_sentence() {
    let introduction = "# Effects\n\n\
        What may be missing in a model of ZIP and induction motor, or wrong in the instrument. Every page has the equations, \
        the parameters, and a picture of what is left of P and Q when the effect is missing: ZIP and motor refitted, with the \
        weights of a fit, to dips of 10, 30 and 50 % after which the voltage stays 3, 1.5 and 0 % low and the frequency swings \
        to another value. The motor to which the pages refer is [the base motor](base_motor.md).\n\n\
        | effect | of | what it is |\n|---|---|---|\n";
    let rows = catalogue().iter().map(|effect| {
        let declaration = effect.declaration();
        let name = declaration.name;
        let described = description(name).unwrap();
        let sentence = described.split("\n\n").next().unwrap().replace('\n', " ");
        let of = match declaration.kind {
            Kind::Physics => "load",
            Kind::Instrument => "instrument",
        };
        format!("| [{name}]({name}.md) | {of} | {sentence} |\n")
    });
    let rows: Vec<String> = rows.collect();
    current("README", &(introduction.to_owned() + &rows.concat()));
}

#[test]
fn the_manual_states_the_base_motor() {
    let path = manual().join("base_motor.md");
    let text = std::fs::read_to_string(path).unwrap();
    let (before, table) = text.split_once("## Parameters\n\n").unwrap();
    let heads = table.lines().take(2);
    let rest = table.lines().skip_while(|line| line.starts_with('|'));
    let rows = BASE.iter().map(parameter_row);
    let lines: Vec<String> = (heads.map(str::to_owned))
        .chain(rows)
        .chain(rest.map(str::to_owned))
        .collect();
    current(
        "base_motor",
        &format!("{before}## Parameters\n\n{}\n", lines.join("\n")),
    );
    for number in 1..=7 {
        assert!(before.contains(&format!("({number})\n")), "({number})");
    }
}
