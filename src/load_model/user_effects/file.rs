//! An effect file from its text: tables, declarations, expressions, and the checks on what they
//! compute.

use toml::de::DeTable;

use super::{
    check,
    compile::{Compiler, Kept, Target, narrow},
    declared::{self, OwnedParameter, OwnedState},
    document::{FILE_BYTES_MAX, Faults, Table, Text},
    effect::{Formulas, Switched, UserEffect},
    problem::{Fault, Problem},
    program::{Operation, Place},
    unit::Unit,
};
use crate::load_model::effect::{
    Declaration, Effect, Exclusion, Kind, Needs, Parameter, Place as Acting, State,
};

/// A sound effect file, read but not yet part of the program.
#[derive(Clone, Debug)]
pub struct EffectFile {
    name: String,
    title: String,
    source: String,
    version: u32,
    resembles: Vec<String>,
    excludes: Vec<(String, String)>,
    needs: Needs,
    separating_event: String,
    parameters: Vec<OwnedParameter>,
    states: Vec<(String, String)>,
    formulas: Formulas,
}

impl EffectFile {
    /// Reads an effect file. All faults are told at once, in the order of the file; those of the
    /// physics (something at rest, a state that is too fast) only when everything else is sound.
    ///
    /// # Errors
    ///
    /// The problems, at least one.
    pub fn parse(text: &str) -> Result<Self, Vec<Problem>> {
        let mut faults = Faults::default();
        let found = read(text, &mut faults);
        if let (Some(found), true) = (found, faults.0.is_empty()) {
            return Ok(found);
        }
        if faults.0.is_empty() {
            faults.add(0, "the file cannot be read", "");
        }
        let mut problems: Vec<Problem> = faults.0.into_iter().map(|f| f.place(text)).collect();
        problems.sort();
        problems.dedup();
        Err(problems)
    }

    /// Name of the effect.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The effects it resembles or excludes.
    pub(in crate::load_model) fn others(&self) -> impl Iterator<Item = &str> {
        let excluded = self.excludes.iter().map(|(other, _)| other);
        self.resembles.iter().chain(excluded).map(String::as_str)
    }

    /// Makes an effect of it that lives as long as the program: its memory, a few kilobytes, is
    /// never given back. [`register`](crate::load_model::effects::register) bounds their number.
    pub(in crate::load_model) fn into_effect(self) -> &'static dyn Effect {
        let shapes: Vec<Vec<f64>> = self
            .parameters
            .iter()
            .filter(|p| !p.numbers.is_amplitude())
            .map(|p| match p.grid.as_slice() {
                [] => vec![p.numbers.typical],
                grid => grid.to_vec(),
            })
            .collect();
        let acts_on: &'static [Acting] = if self.states.is_empty() {
            &[Acting::Power]
        } else {
            &[Acting::States, Acting::Power]
        };
        let parameters = self.parameters.into_iter().map(|p| Parameter {
            name: kept(p.name),
            symbol: kept(p.symbol),
            unit: kept(p.unit),
            ..p.numbers
        });
        let states = self.states.into_iter().map(|(name, unit)| State {
            name: kept(name),
            unit: kept(unit),
        });
        let excludes = self.excludes.into_iter().map(|(other, reason)| Exclusion {
            other: kept(other),
            reason: kept(reason),
        });
        let declaration = Declaration {
            name: kept(self.name),
            title: kept(self.title),
            kind: Kind::Physics,
            version: self.version,
            parameters: Vec::leak(parameters.collect()),
            states: Vec::leak(states.collect()),
            acts_on,
            excludes: Vec::leak(excludes.collect()),
            resembles: Vec::leak(self.resembles.into_iter().map(kept).collect()),
            needs: Needs {
                separating_event: kept(self.separating_event),
                ..self.needs
            },
            source: kept(self.source),
        };
        Box::leak(Box::new(UserEffect {
            declaration: Box::leak(Box::new(declaration)),
            grid: product(&shapes),
            formulas: self.formulas,
        }))
    }
}

fn kept(text: String) -> &'static str {
    String::leak(text)
}

/// Every combination, the last list running fastest.
fn product(lists: &[Vec<f64>]) -> Vec<Vec<f64>> {
    lists.iter().fold(vec![Vec::new()], |points, list| {
        let longer = |point: &Vec<f64>| {
            let point = point.clone();
            list.iter().map(move |x| {
                let mut longer = point.clone();
                longer.push(*x);
                longer
            })
        };
        points.iter().flat_map(longer).collect()
    })
}

fn read(text: &str, faults: &mut Faults) -> Option<EffectFile> {
    if text.len() > FILE_BYTES_MAX {
        // Its length is not known: only so much of it was read.
        let message = "the file is too long";
        faults.add(
            0,
            message,
            format!("at most {FILE_BYTES_MAX} bytes, one effect to a file"),
        );
        return None;
    }
    let (document, errors) = DeTable::parse_recoverable(text);
    for error in &errors {
        let at = error.span().map_or(0, |span| span.start);
        faults.add(at, error.message(), "");
    }
    if !errors.is_empty() {
        return None;
    }
    let mut root = Table::new(text, document.get_ref(), 0, "the file".to_owned());
    let header = header(&mut root, faults);
    let (needs, separating_event) = needs(root.section("needs", faults), faults);
    let parameters = declared::parameters(root.sections("parameters", faults), 0, faults);
    let states = declared::states(root.sections("states", faults), faults);
    let symbols = declared::symbols(&parameters, &states, faults);
    let spelled_out = parameters
        .iter()
        .map(|p| (p.name.clone(), p.symbol.clone()));
    let mut compiler = Compiler::new(symbols, spelled_out.collect());
    let places = expressions(&mut root, &states, &mut compiler, faults);
    root.finish(faults);
    let (initial_places, rate_places, power_places) = places?;
    if !faults.0.is_empty() {
        return None;
    }
    unused_parameters(&parameters, &compiler, faults);
    let names = states.iter().map(|s| s.name.clone()).collect();
    let mut all: Vec<(String, String)> =
        states.into_iter().map(|s| (s.name.value, s.unit)).collect();
    let of_functions = compiler.kept_units().iter().enumerate();
    all.extend(
        of_functions.map(|(k, unit)| (format!("function_state_{}", k + 1), unit.to_string())),
    );
    let declared: Vec<Text> = names;
    unused_states(
        &declared,
        compiler.used_states(power_places, &rate_places),
        faults,
    );
    let formulas = formulas(compiler, [&initial_places, &rate_places], power_places);
    let formulas = formulas
        .map_err(|f| faults.add(0, f.message, f.cure))
        .ok()?;
    check::physics(&formulas, &parameters, &all, power_at(text), faults);
    let header = header?;
    Some(EffectFile {
        name: header.name,
        title: header.title,
        source: header.source,
        version: header.version,
        resembles: header.resembles,
        excludes: header.excludes,
        needs,
        separating_event,
        parameters,
        states: all,
        formulas,
    })
}

/// Where faults of the physics are shown.
fn power_at(text: &str) -> usize {
    text.find("[power]").unwrap_or(0)
}

struct Header {
    name: String,
    title: String,
    source: String,
    version: u32,
    resembles: Vec<String>,
    excludes: Vec<(String, String)>,
}

fn header(root: &mut Table<'_>, faults: &mut Faults) -> Option<Header> {
    const SOURCE_LENGTH_MIN: usize = 16;
    let name = root.needed_text("name", "the name in structures and JSON", faults);
    let title = root.needed_text("title", "the title for people", faults);
    let kind = root.text("kind", faults);
    let meaning = "where equations and values come from, and what was not verified";
    let source = root.needed_text("source", meaning, faults);
    if let Some(name) = &name {
        declared::identifier(name, "effect name", faults);
    }
    if let Some(kind) = kind.filter(|k| k.value != "physics") {
        let cure = "only \"physics\" can be written in a file; an instrument is written in Rust";
        faults.add(kind.at, format!("kind `{:.40}`", kind.value), cure);
    }
    if let Some(source) = source
        .as_ref()
        .filter(|s| s.value.len() < SOURCE_LENGTH_MIN)
    {
        let message = format!("`source` has {} characters", source.value.len());
        faults.add(source.at, message, meaning);
    }
    let version = version(root, faults);
    let resembles = root.texts("resembles", faults);
    let excludes = root
        .sections("excludes", faults)
        .into_iter()
        .filter_map(|mut table| {
            let other = table.needed_text("other", "the name of an effect", faults);
            let ending = "the end of the sentence \"cannot be combined, because ...\"";
            let reason = table.needed_text("reason", ending, faults);
            table.finish(faults);
            Some((other?.value, reason?.value))
        });
    let excludes = excludes.collect();
    Some(Header {
        name: name?.value,
        title: title?.value,
        source: source?.value,
        version: version?,
        resembles: resembles.into_iter().map(|r| r.value).collect(),
        excludes,
    })
}

fn version(root: &mut Table<'_>, faults: &mut Faults) -> Option<u32> {
    let Some(given) = root.number("version", faults) else {
        return Some(1);
    };
    let whole = given.value.fract().abs() <= 0.0 && (1.0..=1e6).contains(&given.value);
    if !whole {
        let cure = "a whole number from 1, raised with every change of the equations";
        faults.add(given.at, format!("version {}", given.value), cure);
        return None;
    }
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "whole and between 1 and a million"
    )]
    let version = given.value as u32;
    Some(version)
}

fn needs(table: Option<Table<'_>>, faults: &mut Faults) -> (Needs, String) {
    let mut needs = Needs::A_DIP;
    let default = needs.separating_event.to_owned();
    let Some(mut table) = table else {
        return (needs, default);
    };
    let below = table.number("voltage_below", faults);
    let above = table.number("voltage_above", faults);
    let deviation = table.number("frequency_deviation", faults);
    needs.voltage_below = below.map(|n| n.value);
    needs.voltage_above = above.map(|n| n.value);
    needs.frequency_deviation = deviation.map(|n| n.value);
    needs.frequency = table.switch("frequency", faults).unwrap_or(false);
    for (key, target) in [
        ("window_s", &mut needs.window_s),
        ("rate_fps", &mut needs.rate_fps),
    ] {
        if let Some(given) = table.number(key, faults) {
            if given.value <= 0.0 {
                faults.add(given.at, format!("`{key}` is {}", given.value), "above 0");
            }
            *target = given.value;
        }
    }
    let event = table.text("separating_event", faults);
    table.finish(faults);
    (needs, event.map_or(default, |e| e.value))
}

type Places = (Vec<Place>, Vec<Place>, [Place; 2]);

fn expressions(
    root: &mut Table<'_>,
    states: &[OwnedState],
    compiler: &mut Compiler,
    faults: &mut Faults,
) -> Option<Places> {
    let mut compile = |text: Option<&Text>, target, unit, faults: &mut Faults| {
        let text = text?;
        let outcome = compiler.compile(&text.value, target, unit);
        outcome
            .map_err(|f| faults.add(text.at + f.at, f.message, f.cure))
            .ok()
    };
    let mut initial = Vec::new();
    let mut rates = Vec::new();
    for state in states {
        let unit = state.measure;
        initial.push(compile(
            state.initial.as_ref(),
            Target::Initial,
            unit,
            faults,
        ));
        let per_second = unit.over(Unit::SECOND).unwrap_or(unit);
        rates.push(compile(
            state.derivative.as_ref(),
            Target::Rates,
            per_second,
            faults,
        ));
    }
    let [active, reactive, motor, fixed] = power(root, faults)?;
    let mut places = [None; 4];
    for (place, text) in places.iter_mut().zip([&active, &reactive, &motor, &fixed]) {
        if text.is_some() {
            *place = Some(compile(text.as_ref(), Target::Power, Unit::ONE, faults)?);
        }
    }
    let initial: Option<Vec<Place>> = initial.into_iter().collect();
    let rates: Option<Vec<Place>> = rates.into_iter().collect();
    let sums = compiler.added_power(places);
    let sums = sums
        .map_err(|f| faults.add(root.at, f.message, f.cure))
        .ok()?;
    Some((initial?, rates?, sums))
}

const POWER: &str = "give active, reactive, motor_factor or static_factor";

/// The expressions for active and reactive power and for the factors of motors and static part.
fn power(root: &mut Table<'_>, faults: &mut Faults) -> Option<[Option<Text>; 4]> {
    let Some(mut table) = root.section("power", faults) else {
        if !root.has("power") {
            faults.add(root.at, "the file has no [power]", POWER);
        }
        return None;
    };
    let keys = ["active", "reactive", "motor_factor", "static_factor"];
    let found = keys.map(|key| table.text(key, faults));
    if keys.iter().all(|key| !table.has(key)) {
        faults.add(table.at, "[power] says nothing", POWER);
    }
    table.finish(faults);
    found.iter().any(Option::is_some).then_some(found)
}

/// Programs ready for evaluation.
fn formulas(
    mut compiler: Compiler,
    [initial, rates]: [&[Place]; 2],
    power: [Place; 2],
) -> Result<Formulas, Fault> {
    let mut moving: Vec<usize> = (0..rates.len()).collect();
    let mut rates = rates.to_vec();
    let (mut rest, mut switched, mut conditions) = (Vec::new(), Vec::new(), Vec::new());
    for (kept, state) in compiler.kept.clone() {
        let starts = match kept {
            Kept::Lag { input, time } => {
                moving.push(state);
                rates.push(compiler.lag_rate([input, time], state)?);
                Some(input)
            }
            Kept::Minimum { input } | Kept::Maximum { input } => Some(input),
            Kept::Timer { .. } | Kept::Latch { .. } => None,
        };
        rest.extend(starts.map(|place| (state, compiler.flat(kept.target(), &[place]))));
        let kind = match kept {
            Kept::Lag { .. } => continue,
            Kept::Timer { .. } => Switched::Timer,
            Kept::Latch { .. } => Switched::Latch,
            Kept::Minimum { .. } => Switched::Minimum,
            Kept::Maximum { .. } => Switched::Maximum,
        };
        switched.push((kind, state));
        conditions.extend(kept.arguments());
    }
    Ok(Formulas {
        states: compiler.states(),
        initial: compiler.flat(Target::Initial, initial),
        rest,
        rates: compiler.flat(Target::Rates, &rates),
        moving,
        conditions: compiler.flat(Target::Conditions, &conditions),
        switched,
        power: compiler.flat(Target::Power, &power),
    })
}

fn unused_parameters(parameters: &[OwnedParameter], compiler: &Compiler, faults: &mut Faults) {
    for (k, p) in parameters.iter().enumerate() {
        if !compiler.reads(Operation::Parameter(narrow(k))) {
            let message = format!("no expression uses the parameter `{}`", p.symbol);
            faults.add(p.at, message, "use it or remove it");
        }
    }
}

fn unused_states(states: &[Text], used: u32, faults: &mut Faults) {
    for (k, name) in states.iter().enumerate() {
        if used >> k & 1 == 0 {
            let message = format!("no power depends on the state `{}`", name.value);
            faults.add(name.at, message, "use it or remove it");
        }
    }
}
