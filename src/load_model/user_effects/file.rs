//! An effect file from its text: tables, declarations, expressions, and the checks on what they
//! compute.

use toml::de::DeTable;

use super::{
    check,
    compile::{Compiler, Kept, Target, narrow},
    declared::{self, Open, OwnedParameter, OwnedState},
    document::{FILE_BYTES_MAX, Faults, Table, Text},
    effect::{Formulas, Switched, UserEffect},
    problem::{self, Fault, Problem},
    program::{Operation, Place},
    unit::Unit,
    written::Compiled,
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
    warnings: Vec<Problem>,
    /// Line and column of its name and of those of others.
    places: Vec<(String, [usize; 2])>,
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

    /// What is sound but will not do for every site: expressions without a finite value in deep dips.
    #[must_use]
    pub fn warnings(&self) -> &[Problem] {
        &self.warnings
    }

    /// The effects it resembles or excludes.
    pub(in crate::load_model) fn others(&self) -> impl Iterator<Item = &str> {
        let excluded = self.excludes.iter().map(|(other, _)| other);
        self.resembles.iter().chain(excluded).map(String::as_str)
    }

    /// Line and column of its name, or of one of [`Self::others`].
    pub(super) fn place_of(&self, name: &str) -> [usize; 2] {
        let found = self.places.iter().find(|(known, _)| known == name);
        found.map_or([1, 1], |(_, place)| *place)
    }

    /// Takes out every reference to another effect.
    pub(super) fn forget(&mut self, other: &str) {
        self.resembles.retain(|name| name != other);
        self.excludes.retain(|(name, _)| name != other);
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
    let (parameters, states, open) = declarations(&mut root, faults);
    let symbols = declared::symbols(&parameters, &states, faults);
    let spelled_out = parameters
        .iter()
        .map(|p| (p.name.clone(), p.symbol.clone()));
    let mut compiler = Compiler::new(symbols, spelled_out.collect());
    let expressions = expressions(&mut root, &states, (&mut compiler, open), faults);
    root.finish(faults);
    let expressions = expressions?;
    if !faults.0.is_empty() {
        return None;
    }
    unused_parameters(&parameters, &compiler, faults);
    let names: Vec<Text> = states.iter().map(|s| s.name.clone()).collect();
    let used = compiler.used_states(expressions.power, &expressions.rates);
    unused_states(&names, used, faults);
    let all = all_states(states, &compiler);
    let formulas = formulas(compiler, expressions);
    let formulas = formulas
        .map_err(|f| faults.add(0, f.message, f.cure))
        .ok()?;
    let warning = check::physics(&formulas, &parameters, &all, faults);
    let header = header?;
    let places = header.places.into_iter();
    Some(EffectFile {
        places: places
            .map(|name| (name.value, problem::place(text, name.at)))
            .collect(),
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
        warnings: warning.into_iter().map(|w| w.place(text)).collect(),
    })
}

/// Parameters and states, those that can be read, and what others leave open.
fn declarations(
    root: &mut Table<'_>,
    faults: &mut Faults,
) -> (Vec<OwnedParameter>, Vec<OwnedState>, Open) {
    let before = faults.0.len();
    let tables = ["parameters", "states"].map(|key| root.sections(key, faults));
    if tables[0].is_empty() && faults.0.len() == before {
        root.missing("parameters", declared::AMPLITUDE_NEEDED, faults);
    }
    let count = tables.iter().map(Vec::len).sum();
    let [parameters, states] = tables;
    let parameters = declared::parameters(parameters, 0, faults);
    let states = declared::states(states, faults);
    let open = Open::new((&parameters, &states), count);
    (parameters, states, open)
}

/// Names and units of the declared states and of those that functions keep.
fn all_states(states: Vec<OwnedState>, compiler: &Compiler) -> Vec<(String, String)> {
    let declared = states.into_iter().map(|s| (s.name.value, s.unit));
    let of_functions = compiler.kept_units().iter().enumerate();
    let of_functions =
        of_functions.map(|(k, unit)| (format!("function_state_{}", k + 1), unit.to_string()));
    declared.chain(of_functions).collect()
}

struct Header {
    name: String,
    title: String,
    source: String,
    version: u32,
    resembles: Vec<String>,
    excludes: Vec<(String, String)>,
    /// Its name and those of others.
    places: Vec<Text>,
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
            Some((other?, reason?.value))
        });
    let excludes: Vec<(Text, String)> = excludes.collect();
    let name = name?;
    let others = excludes.iter().map(|(other, _)| other);
    let places = [&name].into_iter().chain(&resembles).chain(others);
    Some(Header {
        places: places.cloned().collect(),
        name: name.value,
        title: title?.value,
        source: source?.value,
        version: version?,
        resembles: resembles.into_iter().map(|r| r.value).collect(),
        excludes: (excludes.into_iter())
            .map(|(other, reason)| (other.value, reason))
            .collect(),
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

/// All expressions of a file as they were compiled.
struct Expressions {
    initial: Vec<Place>,
    rates: Vec<Place>,
    /// Active and reactive power added.
    power: [Place; 2],
    /// In the order of evaluation.
    compiled: Vec<Compiled>,
}

/// Compiles one expression after the other.
struct Gathering<'c> {
    compiler: &'c mut Compiler,
    open: Open,
    compiled: Vec<Compiled>,
}

impl Gathering<'_> {
    fn compile(
        &mut self,
        key: String,
        text: Option<&Text>,
        (target, unit): (Target, Unit),
        faults: &mut Faults,
    ) -> Option<Place> {
        let text = text?;
        let before = self.compiler.kept.len();
        match self.compiler.compile(&text.value, target, unit) {
            Ok(place) => {
                self.compiled.push(Compiled {
                    key,
                    text: text.clone(),
                    target,
                    place,
                    functions: before..self.compiler.kept.len(),
                });
                Some(place)
            }
            Err(fault) => {
                if !self.open.explains(&text.value, &fault) {
                    faults.add(text.at + fault.at, fault.message, fault.cure);
                }
                None
            }
        }
    }
}

fn expressions(
    root: &mut Table<'_>,
    states: &[OwnedState],
    (compiler, open): (&mut Compiler, Open),
    faults: &mut Faults,
) -> Option<Expressions> {
    let mut all = Gathering {
        compiler,
        open,
        compiled: Vec::new(),
    };
    let (mut initial, mut rates) = (Vec::new(), Vec::new());
    for state in states {
        let unit = state.measure;
        let name = &state.name.value;
        let key = format!("initial value of state `{name}`");
        let text = state.initial.as_ref();
        initial.push(all.compile(key, text, (Target::Initial, unit), faults));
        let per_second = unit.over(Unit::SECOND).unwrap_or(unit);
        let key = format!("derivative of state `{name}`");
        let text = state.derivative.as_ref();
        rates.push(all.compile(key, text, (Target::Rates, per_second), faults));
    }
    let power = power(root, faults)?;
    let mut places = [None; 4];
    for ((place, text), key) in places.iter_mut().zip(&power).zip(POWER_KEYS) {
        if text.is_some() {
            let of_power = (Target::Power, Unit::ONE);
            *place = Some(all.compile(key.to_owned(), text.as_ref(), of_power, faults)?);
        }
    }
    let initial: Option<Vec<Place>> = initial.into_iter().collect();
    let rates: Option<Vec<Place>> = rates.into_iter().collect();
    let sums = all.compiler.added_power(places);
    let sums = sums.map_err(|f| faults.add(root.at, f.message, f.cure));
    Some(Expressions {
        initial: initial?,
        rates: rates?,
        power: sums.ok()?,
        compiled: all.compiled,
    })
}

/// Keys of `[power]`.
const POWER_KEYS: [&str; 4] = ["active", "reactive", "motor_factor", "static_factor"];
const POWER: &str = "give active, reactive, motor_factor or static_factor";

/// The expressions for active and reactive power and for the factors of motors and static part.
fn power(root: &mut Table<'_>, faults: &mut Faults) -> Option<[Option<Text>; 4]> {
    let Some(mut table) = root.section("power", faults) else {
        if !root.has("power") {
            root.missing("power", POWER, faults);
        }
        return None;
    };
    let found = POWER_KEYS.map(|key| table.text(key, faults));
    if table.is_empty() {
        faults.add(table.at, "[power] says nothing", POWER);
    }
    table.finish(faults);
    found.iter().any(Option::is_some).then_some(found)
}

/// Programs ready for evaluation.
fn formulas(mut compiler: Compiler, expressions: Expressions) -> Result<Formulas, Fault> {
    let Expressions {
        initial,
        mut rates,
        power,
        compiled,
    } = expressions;
    let mut moving: Vec<usize> = (0..rates.len()).collect();
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
        initial: compiler.flat(Target::Initial, &initial),
        rest,
        rates: compiler.flat(Target::Rates, &rates),
        moving,
        conditions: compiler.flat(Target::Conditions, &conditions),
        switched,
        power: compiler.flat(Target::Power, &power),
        written: compiled.into_iter().map(|c| c.written(&compiler)).collect(),
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
