//! The expressions of a file one by one, for messages: which of them has no finite value, or is not neutral.

use super::{
    compile::{Compiler, Target},
    document::Text,
    effect::{Formulas, scope},
    program::{Flat, Place, Scope, VARIABLES},
};
use std::ops::Range;

/// Characters of an expression that a message shows.
const SHOWN_MAX: usize = 80;

/// An expression and the programs it became.
#[derive(Clone, Debug)]
pub(super) struct Written {
    /// The key in the file with the state it belongs to: `active`, "derivative of state `z`".
    pub(super) key: String,
    pub(super) text: String,
    /// Byte in the file.
    pub(super) at: usize,
    pub(super) target: Target,
    value: Flat,
    /// Places in `Formulas::conditions` or states that its functions keep, and what those read.
    arguments: Vec<(Target, Flat)>,
    /// States of its functions.
    pub(super) kept: Range<usize>,
}

/// An expression as it was compiled.
#[derive(Clone, Debug)]
pub(super) struct Compiled {
    pub(super) key: String,
    pub(super) text: Text,
    pub(super) target: Target,
    pub(super) place: Place,
    /// Which functions that keep a state it was the first to call.
    pub(super) functions: Range<usize>,
}

impl Compiled {
    /// With its programs, once all expressions are compiled.
    pub(super) fn written(self, compiler: &Compiler) -> Written {
        let functions = compiler.kept.get(self.functions).unwrap_or(&[]);
        let argument = |place: &Place, target| (target, compiler.flat(target, &[*place]));
        let arguments = functions.iter().flat_map(|(kept, _)| {
            let target = kept.target();
            let places = kept.arguments();
            let flats: Vec<_> = places.iter().map(|p| argument(p, target)).collect();
            flats
        });
        let first = functions.first().map_or(0, |(_, state)| *state);
        let end = functions
            .last()
            .map_or(0, |(kept, state)| state + kept.width());
        Written {
            value: compiler.flat(self.target, &[self.place]),
            arguments: arguments.collect(),
            kept: first..end,
            key: self.key,
            text: self.text.value,
            at: self.text.at,
            target: self.target,
        }
    }
}

impl Written {
    /// The expression for a message.
    pub(super) fn shown(&self) -> String {
        let text = self.text.split_whitespace().collect::<Vec<_>>().join(" ");
        if text.chars().count() <= SHOWN_MAX {
            return format!("{} = \"{text}\"", self.key);
        }
        let start: String = text.chars().take(SHOWN_MAX).collect();
        format!("{} = \"{start} ...\"", self.key)
    }

    /// Its value.
    pub(super) fn value(&self, p: &[f64], x: &[f64], given: [f64; VARIABLES]) -> f64 {
        evaluated(&self.value, self.target, p, x, given)
    }

    fn is_finite(&self, p: &[f64], x: &[f64], given: [f64; VARIABLES]) -> bool {
        let finite =
            |(target, flat): &(Target, Flat)| evaluated(flat, *target, p, x, given).is_finite();
        self.arguments.iter().all(finite) && self.value(p, x, given).is_finite()
    }
}

fn evaluated(flat: &Flat, target: Target, p: &[f64], x: &[f64], given: [f64; VARIABLES]) -> f64 {
    let [voltage, deviation, _, reactive, ..] = given;
    let mut value = [0.0];
    let scope = match target {
        Target::Initial => scope(p, &[], [1.0, 0.0], reactive),
        Target::Rates | Target::Conditions => scope(p, x, [voltage, deviation], reactive),
        Target::Power => Scope {
            variables: given,
            parameters: p,
            states: x,
        },
    };
    flat.evaluate(&scope, &mut value);
    value[0]
}

impl Formulas {
    /// The first expression in the order of evaluation that has no finite value.
    pub(super) fn not_finite(
        &self,
        p: &[f64],
        x: &[f64],
        given: [f64; VARIABLES],
    ) -> Option<&Written> {
        self.written.iter().find(|w| !w.is_finite(p, x, given))
    }

    /// The expression of a key.
    pub(super) fn of_key(&self, key: &str) -> Option<&Written> {
        self.written.iter().find(|w| w.key == key)
    }
}
