//! The TOML text as tables whose keys are asked for one by one: every value has a place, a key
//! nobody asked for is a fault.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

use super::problem::{Fault, nearest, suggestion};

/// Largest file, bytes.
pub const FILE_BYTES_MAX: usize = 64 * 1024;
/// Faults that are told at most.
pub(super) const FAULTS_MAX: usize = 50;

/// Faults found so far.
#[derive(Debug, Default)]
pub(super) struct Faults(pub(super) Vec<Fault>);

impl Faults {
    pub(super) fn push(&mut self, fault: Fault) {
        self.add(fault.at, fault.message, fault.cure);
    }

    pub(super) fn add(&mut self, at: usize, message: impl Into<String>, cure: impl Into<String>) {
        if self.0.len() < FAULTS_MAX {
            self.0.push(Fault::new(at, message, cure));
        }
    }
}

/// A value and its byte in the file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct At<T> {
    pub(super) value: T,
    pub(super) at: usize,
}

/// An expression or other text with the byte of its first character.
pub(super) type Text = At<String>;

/// A table of the file.
pub(super) struct Table<'a> {
    text: &'a str,
    entries: &'a DeTable<'a>,
    /// Where the table is, and how messages call it.
    pub(super) at: usize,
    pub(super) title: String,
    known: Vec<&'static str>,
    /// Keys that were said not to be there.
    lacking: Vec<&'static str>,
}

impl<'a> Table<'a> {
    pub(super) fn new(text: &'a str, table: &'a DeTable<'a>, at: usize, title: String) -> Self {
        Self {
            text,
            entries: table,
            at,
            title,
            known: Vec::new(),
            lacking: Vec::new(),
        }
    }

    fn get(&mut self, key: &'static str) -> Option<(&'a DeValue<'a>, Range<usize>)> {
        self.knows(key);
        let found = self.entries.iter().find(|(k, _)| k.get_ref() == key)?;
        Some((found.1.get_ref(), found.1.span()))
    }

    fn knows(&mut self, key: &'static str) {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
    }

    /// A text that may be absent.
    pub(super) fn text(&mut self, key: &'static str, faults: &mut Faults) -> Option<Text> {
        let (value, span) = self.get(key)?;
        let Some(content) = value.as_str() else {
            let message = format!("`{key}` is {}", kind(value));
            faults.add(span.start, message, "write a text in quotes");
            return None;
        };
        // Without escapes the characters stand in the file as they are; with them, the place of
        // the value has to do.
        let raw = self.text.get(span.clone()).unwrap_or("");
        let ahead = raw.find(content).unwrap_or(0);
        Some(Text {
            value: content.to_owned(),
            at: span.start + ahead,
        })
    }

    /// A text that must be there and not be empty.
    pub(super) fn needed_text(
        &mut self,
        key: &'static str,
        meaning: &str,
        faults: &mut Faults,
    ) -> Option<Text> {
        if !self.has(key) {
            self.missing(key, meaning, faults);
        }
        let found = self.text(key, faults)?;
        if found.value.trim().is_empty() {
            faults.add(found.at, format!("`{key}` is empty"), meaning);
            return None;
        }
        Some(found)
    }

    pub(super) fn has(&self, key: &str) -> bool {
        self.entries.iter().any(|(k, _)| k.get_ref() == key)
    }

    /// Where the value of a key is.
    pub(super) fn place(&self, key: &str) -> Option<usize> {
        let (_, value) = self.entries.iter().find(|(k, _)| k.get_ref() == key)?;
        Some(value.span().start)
    }

    /// Says that a key is not there. That is taken back where it was misspelt.
    pub(super) fn missing(&mut self, key: &'static str, meaning: &str, faults: &mut Faults) {
        self.knows(key);
        self.lacking.push(key);
        faults.add(self.at, self.lack(key), meaning);
    }

    fn lack(&self, key: &str) -> String {
        format!("{} has no `{key}`", self.title)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// A finite number that may be absent.
    pub(super) fn number(&mut self, key: &'static str, faults: &mut Faults) -> Option<At<f64>> {
        let (value, span) = self.get(key)?;
        let found = number(value);
        if found.is_none() {
            let (what, cure) = if matches!(value, DeValue::Float(_) | DeValue::Integer(_)) {
                (
                    "not a finite decimal number",
                    "write a number within +-1e308",
                )
            } else {
                (kind(value), "write a number, without quotes")
            };
            faults.add(span.start, format!("`{key}` is {what}"), cure);
        }
        Some(At {
            value: found?,
            at: span.start,
        })
    }

    /// A number that must be there.
    pub(super) fn needed_number(
        &mut self,
        key: &'static str,
        meaning: &str,
        faults: &mut Faults,
    ) -> Option<At<f64>> {
        if !self.has(key) {
            self.missing(key, meaning, faults);
        }
        self.number(key, faults)
    }

    pub(super) fn switch(&mut self, key: &'static str, faults: &mut Faults) -> Option<bool> {
        let (value, span) = self.get(key)?;
        let found = value.as_bool();
        if found.is_none() {
            faults.add(
                span.start,
                format!("`{key}` is {}, not a switch", kind(value)),
                "write true or false, without quotes",
            );
        }
        found
    }

    pub(super) fn numbers(
        &mut self,
        key: &'static str,
        faults: &mut Faults,
    ) -> Option<At<Vec<f64>>> {
        let (value, span) = self.get(key)?;
        let list = value.as_array().and_then(|list| {
            let numbers = list.iter().map(|v| number(v.get_ref()));
            numbers.collect::<Option<Vec<f64>>>()
        });
        if list.is_none() {
            faults.add(
                span.start,
                format!("`{key}` is not a list of numbers"),
                "write [1.0, 2.0]",
            );
        }
        Some(At {
            value: list?,
            at: span.start,
        })
    }

    pub(super) fn texts(&mut self, key: &'static str, faults: &mut Faults) -> Vec<Text> {
        let Some((value, span)) = self.get(key) else {
            return Vec::new();
        };
        let list = value.as_array().and_then(|list| {
            let text = |v: &toml::Spanned<DeValue<'_>>| {
                Some(Text {
                    value: v.get_ref().as_str()?.to_owned(),
                    at: v.span().start,
                })
            };
            list.iter().map(text).collect::<Option<Vec<Text>>>()
        });
        list.unwrap_or_else(|| {
            faults.add(
                span.start,
                format!("`{key}` is not a list of texts"),
                "write [\"a\", \"b\"]",
            );
            Vec::new()
        })
    }

    /// A table that may be absent.
    pub(super) fn section(&mut self, key: &'static str, faults: &mut Faults) -> Option<Table<'a>> {
        let (value, span) = self.get(key)?;
        let Some(table) = value.as_table() else {
            faults.add(
                span.start,
                format!("`{key}` is not a table"),
                format!("write [{key}]"),
            );
            return None;
        };
        Some(Table::new(self.text, table, span.start, format!("[{key}]")))
    }

    /// Tables of one kind.
    pub(super) fn sections(&mut self, key: &'static str, faults: &mut Faults) -> Vec<Table<'a>> {
        let Some((value, span)) = self.get(key) else {
            return Vec::new();
        };
        let Some(list) = value.as_array() else {
            let cure = format!("write [[{key}]] before each");
            faults.add(span.start, format!("`{key}` is not a list of tables"), cure);
            return Vec::new();
        };
        let mut found = Vec::new();
        for (k, entry) in list.iter().enumerate() {
            let at = entry.span().start;
            match entry.get_ref().as_table() {
                Some(table) => {
                    let title = format!("entry {} of [[{key}]]", k + 1);
                    found.push(Table::new(self.text, table, at, title));
                }
                None => faults.add(at, format!("entry of `{key}` is not a table"), ""),
            }
        }
        found
    }

    /// Names every key that was not asked for.
    pub(super) fn finish(self, faults: &mut Faults) {
        for (key, _) in self.entries {
            let name: &str = key.get_ref();
            if !self.known.contains(&name) {
                let known = || self.known.iter().copied();
                if let Some(meant) = nearest(name, known()).filter(|k| self.lacking.contains(k)) {
                    let (at, lack) = (self.at, self.lack(meant));
                    faults.0.retain(|f| f.at != at || f.message != lack);
                }
                let message = format!("unknown key `{name:.60}` in {}", self.title);
                faults.add(key.span().start, message, suggestion(name, known()));
            }
        }
    }
}

/// What a value is, for messages.
fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a text",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    let text = match value {
        DeValue::Float(float) => float.as_str(),
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str(),
        _ => return None,
    };
    let number: f64 = text.parse().ok()?;
    number.is_finite().then_some(number)
}
