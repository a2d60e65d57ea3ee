//! What the expressions of a file are compiled into: four programs, for what is computed once, in
//! every stage of the integration, for relays, and at the output instants.

use super::{
    functions::NAMES,
    lexer::NAME_LENGTH_MAX,
    parser,
    problem::Fault,
    program::{Binary, Flat, OPERATIONS_MAX, Operation, Place, Program, Variable},
    unit::Unit,
};

/// Longest expression, bytes.
pub(super) const EXPRESSION_BYTES_MAX: usize = 2048;
/// Most states of an effect, those of `lag`, `timer`, `latch` and the like included.
pub(super) const STATES_MAX: usize = 8;

/// Where an expression is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// Once, at rest.
    Initial,
    /// In every stage of the integration.
    Rates,
    /// At start, middle and end of a step.
    Conditions,
    /// At the output instants.
    Power,
}

/// A value in the program of the current target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Value {
    pub(super) place: Place,
    pub(super) unit: Unit,
}

/// A state that a function keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kept {
    /// Follows the input with a time constant; places in `Rates`.
    Lag { input: Place, time: Place },
    /// Shows how long the condition has held.
    Timer { condition: Place },
    /// A timer, and behind it the share that has switched.
    Latch { condition: Place, delay: Place },
    /// The smallest value since the start.
    Minimum { input: Place },
    /// The largest value since the start.
    Maximum { input: Place },
}

impl Kept {
    /// The program of its arguments.
    pub(super) fn target(self) -> Target {
        match self {
            Self::Lag { .. } => Target::Rates,
            _ => Target::Conditions,
        }
    }

    /// Its arguments.
    pub(super) fn arguments(self) -> Vec<Place> {
        match self {
            Self::Lag { input, time } => vec![input, time],
            Self::Latch { condition, delay } => vec![condition, delay],
            Self::Timer { condition: x }
            | Self::Minimum { input: x }
            | Self::Maximum { input: x } => {
                vec![x]
            }
        }
    }

    pub(super) fn width(self) -> usize {
        if matches!(self, Self::Latch { .. }) {
            2
        } else {
            1
        }
    }
}

/// A name that expressions may use.
#[derive(Clone, Debug)]
pub(super) struct Symbol {
    pub(super) name: String,
    pub(super) operation: Operation,
    pub(super) unit: Unit,
}

pub(super) const VARIABLE_NAMES: [(&str, Variable, Unit); 7] = [
    ("v", Variable::Voltage, Unit::ONE),
    ("df", Variable::FrequencyDeviation, Unit::ONE),
    ("t", Variable::Time, Unit::SECOND),
    ("q0", Variable::ReactiveAtRest, Unit::ONE),
    ("p_m", Variable::MotorActive, Unit::ONE),
    ("q_m", Variable::MotorReactive, Unit::ONE),
    ("p_s", Variable::StaticActive, Unit::ONE),
];

/// Names no parameter or state may take.
pub(super) fn is_reserved(name: &str) -> bool {
    name == "pi"
        || VARIABLE_NAMES.iter().any(|(n, _, _)| *n == name)
        || NAMES.iter().any(|(n, _)| *n == name)
}

/// Whether a text can be a name in an expression.
pub(super) fn is_name(text: &str) -> bool {
    let mut rest = text.chars();
    rest.next()
        .is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
        && rest.all(|c| c.is_ascii_alphanumeric() || c == '_')
        && text.len() <= NAME_LENGTH_MAX
}

/// What all expressions of a file are compiled into.
#[derive(Clone, Debug)]
pub(super) struct Compiler {
    pub(super) symbols: Vec<Symbol>,
    /// Names of parameters and the symbols that stand for them.
    pub(super) spelled_out: Vec<(String, String)>,
    programs: [Program; 4],
    /// States of functions and the first state of each, and their units.
    pub(super) kept: Vec<(Kept, usize)>,
    kept_units: Vec<Unit>,
    states: usize,
}

impl Compiler {
    /// With parameters and states as symbols.
    pub(super) fn new(symbols: Vec<Symbol>, spelled_out: Vec<(String, String)>) -> Self {
        let is_state = |s: &&Symbol| matches!(s.operation, Operation::State(_));
        let states = symbols.iter().filter(is_state).count();
        Self {
            symbols,
            spelled_out,
            programs: Default::default(),
            kept: Vec::new(),
            kept_units: Vec::new(),
            states,
        }
    }

    /// The value of a constant.
    pub(super) fn constant(&self, target: Target, place: Place) -> Option<f64> {
        self.programs[target as usize].constant(place)
    }

    /// The program of a target for some of its values.
    pub(super) fn flat(&self, target: Target, wanted: &[Place]) -> Flat {
        self.programs[target as usize].flat(wanted)
    }

    /// The rate of a lag, `(input - state)/time`.
    pub(super) fn lag_rate(
        &mut self,
        [input, time]: [Place; 2],
        state: usize,
    ) -> Result<Place, Fault> {
        let mut add = |o| self.emit(Target::Rates, o, Unit::ONE, 0).map(|v| v.place);
        let own = add(Operation::State(narrow(state)))?;
        let apart = add(Operation::Binary(Binary::Subtract, input, own))?;
        add(Operation::Binary(Binary::Divide, apart, time))
    }

    /// The states on which power depends, directly or through others, one bit each; `rates` are the
    /// slopes of the declared ones.
    pub(super) fn used_states(&self, power: [Place; 2], rates: &[Place]) -> u32 {
        let behind =
            |target: Target, places: &[Place]| self.programs[target as usize].states_behind(places);
        let mut used = behind(Target::Power, &power);
        loop {
            let before = used;
            for (k, place) in rates.iter().enumerate() {
                if used >> k & 1 == 1 {
                    used |= behind(Target::Rates, &[*place]);
                }
            }
            for (kept, state) in &self.kept {
                if used >> (state + kept.width() - 1) & 1 == 1 {
                    used |= behind(kept.target(), &kept.arguments());
                }
            }
            if used == before {
                return used;
            }
        }
    }

    /// States in all.
    pub(super) fn states(&self) -> usize {
        self.states
    }

    /// The units of the states that functions keep.
    pub(super) fn kept_units(&self) -> &[Unit] {
        &self.kept_units
    }

    /// Whether any expression reads the parameter or state.
    pub(super) fn reads(&self, operation: Operation) -> bool {
        self.programs.iter().any(|p| p.reads(operation))
    }

    /// Compiles an expression and holds it against the unit it must have.
    pub(super) fn compile(
        &mut self,
        text: &str,
        target: Target,
        expected: Unit,
    ) -> Result<Place, Fault> {
        if text.len() > EXPRESSION_BYTES_MAX {
            let message = format!("an expression of {} bytes", text.len());
            let cure = format!("at most {EXPRESSION_BYTES_MAX}; keep parts of it as states");
            return Err(Fault::new(0, message, cure));
        }
        let value = parser::value(self, text, target)?;
        if !value.unit.agrees(expected) {
            let message = format!(
                "the expression has the unit {}, and {expected} is needed",
                value.unit
            );
            return Err(Fault::new(0, message, unit_cure()));
        }
        Ok(value.place)
    }

    /// Active and reactive power added, of expressions for both and for the factors of motors and
    /// static part, where they are given: `active + (motor - 1) p_m + (static - 1) p_s` and
    /// `reactive + (motor - 1) q_m`.
    pub(super) fn added_power(&mut self, given: [Option<Place>; 4]) -> Result<[Place; 2], Fault> {
        let [active, reactive, motor, fixed] = given;
        let of_motor = self.excess(motor, Variable::MotorActive)?;
        let of_static = self.excess(fixed, Variable::StaticActive)?;
        let reactive_of_motor = self.excess(motor, Variable::MotorReactive)?;
        Ok([
            self.sum(&[active, of_motor, of_static])?,
            self.sum(&[reactive, reactive_of_motor])?,
        ])
    }

    /// `(factor - 1) power`.
    fn excess(&mut self, factor: Option<Place>, power: Variable) -> Result<Option<Place>, Fault> {
        let Some(factor) = factor else {
            return Ok(None);
        };
        let mut add = |o| self.emit(Target::Power, o, Unit::ONE, 0).map(|v| v.place);
        let one = add(Operation::Constant(1.0))?;
        let excess = add(Operation::Binary(Binary::Subtract, factor, one))?;
        let power = add(Operation::Variable(power))?;
        add(Operation::Binary(Binary::Multiply, excess, power)).map(Some)
    }

    fn sum(&mut self, terms: &[Option<Place>]) -> Result<Place, Fault> {
        let mut add = |o| self.emit(Target::Power, o, Unit::ONE, 0).map(|v| v.place);
        let mut terms = terms.iter().flatten().copied();
        let Some(first) = terms.next() else {
            return add(Operation::Constant(0.0));
        };
        terms.try_fold(first, |sum, term| {
            add(Operation::Binary(Binary::Add, sum, term))
        })
    }

    pub(super) fn emit(
        &mut self,
        target: Target,
        operation: Operation,
        unit: Unit,
        at: usize,
    ) -> Result<Value, Fault> {
        let program = &mut self.programs[target as usize];
        let place = program.place(operation).ok_or_else(|| {
            let message = format!("more than {OPERATIONS_MAX} operations");
            Fault::new(at, message, "simplify, or write this effect in Rust")
        })?;
        if program.constant(place).is_some_and(|c| !c.is_finite()) {
            let message = "this constant is not finite";
            return Err(Fault::new(at, message, "divide by something other than 0"));
        }
        Ok(Value { place, unit })
    }

    /// The first state of what a function keeps; the same call twice has one state.
    pub(super) fn keep(&mut self, kept: Kept, unit: Unit, at: usize) -> Result<usize, Fault> {
        if let Some((_, state)) = self.kept.iter().find(|(k, _)| *k == kept) {
            return Ok(*state);
        }
        let state = self.states;
        self.states += kept.width();
        if self.states > STATES_MAX {
            let message = format!("more than {STATES_MAX} states");
            let cure = "`lag`, `timer`, `minimum_since_start` and `maximum_since_start` count as \
                        one, `latch` as two";
            return Err(Fault::new(at, message, cure));
        }
        if kept.width() == 2 {
            self.kept_units.push(Unit::SECOND);
        }
        self.kept_units.push(unit);
        self.kept.push((kept, state));
        Ok(state)
    }
}

pub(super) fn unit_cure() -> &'static str {
    "powers, voltages and frequencies are per unit (1); time is in s, and a number can carry it: \
     `0.5s`, `20ms`"
}

/// Indices of states and parameters are small by their limits.
pub(super) fn narrow(index: usize) -> u8 {
    u8::try_from(index).unwrap_or(u8::MAX)
}
