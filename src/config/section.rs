//! Reading of one table: each key into its place, with its range, and what is left over is unknown.

use std::{fmt::Display, ops::Range, time::Duration};

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use super::problems::{Problem, place};
use crate::load_model::user_effects;

/// What was found in a table and those below it.
#[derive(Debug, Default)]
pub(super) struct Findings {
    pub(super) problems: Vec<Problem>,
    /// Keys that the file could have had, but did not.
    pub(super) absent: Vec<String>,
}

impl Findings {
    pub(super) fn add(&mut self, other: Self) {
        self.problems.extend(other.problems);
        self.absent.extend(other.absent);
    }
}

/// One table of a configuration, or its absence: then every value stays as it is.
#[derive(Debug)]
pub(super) struct Section<'a> {
    text: &'a str,
    path: String,
    table: Option<&'a DeTable<'a>>,
    span: Range<usize>,
    asked: Vec<&'static str>,
    findings: Findings,
}

impl<'a> Section<'a> {
    pub(super) fn root(text: &'a str, table: &'a Spanned<DeTable<'a>>) -> Self {
        Self {
            text,
            path: String::new(),
            table: Some(table.get_ref()),
            span: 0..0,
            asked: Vec::new(),
            findings: Findings::default(),
        }
    }

    /// The table `name`, present or not.
    pub(super) fn section(&mut self, name: &'static str) -> Self {
        let value = self.value(name);
        let table = value.and_then(|value| {
            let table = value.get_ref().as_table();
            if table.is_none() {
                self.wrong_type(name, value, "a table");
            }
            table
        });
        self.below(name, table, value.map(Spanned::span))
    }

    /// The tables of the array `name`, none when it is absent.
    pub(super) fn sections(&mut self, name: &'static str) -> Vec<Self> {
        let Some(value) = self.value(name) else {
            return Vec::new();
        };
        let Some(array) = value.get_ref().as_array() else {
            self.wrong_type(name, value, &format!("an array of tables, [[{name}]]"));
            return Vec::new();
        };
        let mut sections = Vec::new();
        for element in array {
            match element.get_ref().as_table() {
                Some(table) => sections.push(self.below(name, Some(table), Some(element.span()))),
                None => self.wrong_type(name, element, "a table"),
            }
        }
        sections
    }

    /// Ends the reading: what was not asked for is unknown.
    pub(super) fn finish(mut self) -> Findings {
        let Some(table) = self.table else {
            return self.findings;
        };
        for (key, _) in table {
            if !self.asked.contains(&key.get_ref().as_ref()) {
                let known = nearest(key.get_ref(), &self.asked);
                self.report(key.get_ref(), key.span(), "unknown key", Some(known));
            }
        }
        self.findings
    }

    pub(super) fn is_present(&self, name: &str) -> bool {
        self.table.is_some_and(|table| table.contains_key(name))
    }

    pub(super) fn flag(&mut self, name: &'static str, target: &mut bool) {
        if let Some(value) = self.value(name) {
            match value.get_ref().as_bool() {
                Some(flag) => *target = flag,
                None => self.wrong_type(name, value, "true or false"),
            }
        }
    }

    /// A number within its range.
    pub(super) fn number(&mut self, name: &'static str, target: &mut f64, range: (f64, f64)) {
        if let Some(value) = self.value(name) {
            match float(value.get_ref()) {
                Some(number) if number >= range.0 && number <= range.1 => *target = number,
                _ => self.out_of_range(name, value, &between(range)),
            }
        }
    }

    /// A number within its range; none where the key is absent.
    pub(super) fn number_if_given(
        &mut self,
        name: &'static str,
        target: &mut Option<f64>,
        range: (f64, f64),
    ) {
        if let Some(value) = self.value(name) {
            match float(value.get_ref()) {
                Some(number) if number >= range.0 && number <= range.1 => *target = Some(number),
                _ => self.out_of_range(name, value, &between(range)),
            }
        }
    }

    /// A number within its range, or 0 for none.
    pub(super) fn number_or_none(
        &mut self,
        name: &'static str,
        target: &mut Option<f64>,
        range: (f64, f64),
    ) {
        if let Some(value) = self.value(name) {
            match float(value.get_ref()) {
                Some(number) if number.abs() <= 0.0 => *target = None,
                Some(number) if number >= range.0 && number <= range.1 => *target = Some(number),
                _ => self.out_of_range(name, value, &format!("0, or {}", between(range))),
            }
        }
    }

    /// A whole number within its range.
    pub(super) fn count<T>(&mut self, name: &'static str, target: &mut T, range: (T, T))
    where
        T: TryFrom<i64> + PartialOrd + Display + Copy,
    {
        if let Some(value) = self.value(name) {
            match integer(value.get_ref()).and_then(|count| T::try_from(count).ok()) {
                Some(count) if count >= range.0 && count <= range.1 => *target = count,
                _ => {
                    let allowed = format!("a whole number, {} to {}", range.0, range.1);
                    self.out_of_range(name, value, &allowed);
                }
            }
        }
    }

    /// A duration in seconds.
    pub(super) fn seconds(&mut self, name: &'static str, target: &mut Duration, range: (f64, f64)) {
        let mut seconds = target.as_secs_f64();
        self.number(name, &mut seconds, range);
        if let Ok(duration) = Duration::try_from_secs_f64(seconds) {
            *target = duration;
        }
    }

    /// A duration in days, or 0 for ever.
    pub(super) fn days_or_ever(
        &mut self,
        name: &'static str,
        target: &mut Option<Duration>,
        range: (f64, f64),
    ) {
        const DAY_S: f64 = 86_400.0;
        let mut days = target.map(|duration| duration.as_secs_f64() / DAY_S);
        self.number_or_none(name, &mut days, range);
        *target = days.and_then(|days| Duration::try_from_secs_f64(days * DAY_S).ok());
    }

    /// One of a few words.
    pub(super) fn choice<T: Copy>(
        &mut self,
        name: &'static str,
        target: &mut T,
        words: &[(&str, T)],
    ) {
        if let Some(value) = self.value(name) {
            let word = value.get_ref().as_str();
            if let Some((_, choice)) = words.iter().find(|(known, _)| Some(*known) == word) {
                *target = *choice;
            } else {
                let known: Vec<String> = words
                    .iter()
                    .map(|(word, _)| format!("\"{word}\""))
                    .collect();
                self.out_of_range(name, value, &known.join(", "));
            }
        }
    }

    /// A text that `parsed` understands; it says what would be right.
    pub(super) fn text<T>(
        &mut self,
        name: &'static str,
        target: &mut T,
        parsed: impl Fn(&str) -> Result<T, String>,
    ) {
        if let Some(value) = self.value(name) {
            self.parse(name, value, &parsed, |parsed| *target = parsed);
        }
    }

    /// Texts, each of which `parsed` understands.
    pub(super) fn texts<T>(
        &mut self,
        name: &'static str,
        target: &mut Vec<T>,
        parsed: impl Fn(&str) -> Result<T, String>,
    ) {
        if let Some(array) = self.array(name) {
            let mut texts = Vec::new();
            for element in array {
                self.parse(name, element, &parsed, |parsed| texts.push(parsed));
            }
            *target = texts;
        }
    }

    /// 1, or -1 for reversed.
    pub(super) fn choice_of_sign(&mut self, name: &'static str, reversed: &mut bool) {
        if let Some(value) = self.value(name) {
            match integer(value.get_ref()) {
                Some(1) => *reversed = false,
                Some(-1) => *reversed = true,
                _ => self.out_of_range(name, value, "1 or -1"),
            }
        }
    }

    /// Any array.
    pub(super) fn array(&mut self, name: &'static str) -> Option<&'a DeArray<'a>> {
        let value = self.value(name)?;
        let array = value.get_ref().as_array();
        if array.is_none() {
            self.wrong_type(name, value, "an array, [...]");
        }
        array
    }

    /// Any table, taken as it is.
    pub(super) fn any_table(&mut self, name: &'static str) -> Option<&'a DeTable<'a>> {
        let value = self.value(name)?;
        let table = value.get_ref().as_table();
        if table.is_none() {
            self.wrong_type(name, value, "a table");
        }
        table
    }

    /// Line and character of a key's value, or of the table where it has none.
    pub(super) fn place_of(&self, name: &str) -> (usize, usize) {
        let value = self.table.and_then(|table| table.get(name));
        place(
            self.text,
            value.map_or(self.span.start, |value| value.span().start),
        )
    }

    /// Says that a key that must be there is not.
    pub(super) fn require(&mut self, name: &'static str, allowed: &str) {
        if !self.is_present(name) {
            let span = self.span.clone();
            self.report(name, span, "missing", Some(allowed.to_owned()));
        }
    }

    /// Says something about a key that is there (or about its table).
    pub(super) fn object(&mut self, name: &str, message: &str, allowed: &str) {
        let span = self
            .table
            .and_then(|table| table.get(name))
            .map_or(self.span.clone(), Spanned::span);
        self.report(name, span, message, Some(allowed.to_owned()));
    }

    fn path_of(&self, name: &str) -> String {
        if self.path.is_empty() {
            name.to_owned()
        } else {
            format!("{}.{name}", self.path)
        }
    }

    fn below(
        &self,
        name: &'static str,
        table: Option<&'a DeTable<'a>>,
        span: Option<Range<usize>>,
    ) -> Self {
        Self {
            text: self.text,
            path: self.path_of(name),
            table,
            span: span.unwrap_or_else(|| self.span.clone()),
            asked: Vec::new(),
            findings: Findings::default(),
        }
    }

    fn value(&mut self, name: &'static str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.asked.push(name);
        let value = self.table.and_then(|table| table.get(name));
        if value.is_none() {
            self.findings.absent.push(self.path_of(name));
        }
        value
    }

    fn parse<T>(
        &mut self,
        name: &str,
        value: &Spanned<DeValue<'_>>,
        parsed: &impl Fn(&str) -> Result<T, String>,
        mut take: impl FnMut(T),
    ) {
        match value.get_ref().as_str().map(parsed) {
            Some(Ok(parsed)) => take(parsed),
            Some(Err(allowed)) => self.out_of_range(name, value, &allowed),
            None => self.wrong_type(name, value, "a text, \"...\""),
        }
    }

    fn wrong_type(&mut self, name: &str, value: &Spanned<DeValue<'_>>, allowed: &str) {
        let found = format!("{} given", value.get_ref().type_str());
        self.report(name, value.span(), &found, Some(allowed.to_owned()));
    }

    fn out_of_range(&mut self, name: &str, value: &Spanned<DeValue<'_>>, allowed: &str) {
        let source = self.text.get(value.span()).unwrap_or_default();
        let source: String = source.chars().take(60).collect();
        let message = format!("{source} is not admissible");
        self.report(name, value.span(), &message, Some(allowed.to_owned()));
    }

    fn report(&mut self, name: &str, span: Range<usize>, message: &str, allowed: Option<String>) {
        let (line, column) = place(self.text, span.start);
        self.findings.problems.push(Problem {
            line,
            column,
            key: self.path_of(name),
            message: message.to_owned(),
            allowed,
        });
    }
}

fn integer(value: &DeValue<'_>) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

fn float(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        _ => integer(value).map(|integer| integer as f64),
    }
}

fn between((lowest, highest): (f64, f64)) -> String {
    format!("{lowest} to {highest}")
}

/// The known key most like an unknown one, or all of them.
fn nearest(unknown: &str, known: &[&str]) -> String {
    let part_of = |one: &str, other: &str| one.len() >= 4 && other.contains(one);
    let contained = |name: &&str| part_of(unknown, name) || part_of(name, unknown);
    let names = || known.iter().copied();
    match user_effects::nearest(unknown, names()).or_else(|| names().find(contained)) {
        Some(best) => format!("perhaps {best}"),
        None => known.join(", "),
    }
}
