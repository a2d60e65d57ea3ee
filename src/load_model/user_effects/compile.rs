//! From the text of an expression to operations: a parser by binding power that emits operations as
//! it reads, with the unit of each. Its recursion is bounded by [`NESTING_MAX`].

use super::{
    functions::{self, Function, NAMES},
    lexer::{NAME_LENGTH_MAX, Placed, Token, tokens},
    problem::{Fault, suggestion},
    program::{
        Binary, OPERATIONS_MAX, Operation, Place, Program, Unary, Variable, WHOLE_EXPONENT_MAX,
    },
    unit::Unit,
};

/// Deepest nesting of brackets, signs and arguments.
pub(super) const NESTING_MAX: usize = 32;
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

/// A program with the units of its operations.
#[derive(Clone, Debug, Default)]
pub(super) struct Units {
    pub(super) program: Program,
    units: Vec<Unit>,
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
    fn width(self) -> usize {
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

const VARIABLE_NAMES: [(&str, Variable, Unit); 7] = [
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
    symbols: Vec<Symbol>,
    /// Names of parameters and the symbols that stand for them.
    spelled_out: Vec<(String, String)>,
    programs: [Units; 4],
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

    /// All programs: initial, rates, conditions, power.
    pub(super) fn into_programs(self) -> [Program; 4] {
        self.programs.map(|p| p.program)
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
        self.programs.iter().any(|p| p.program.reads(operation))
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
        let tokens = tokens(text)?;
        let mut reader = Reader {
            tokens: &tokens,
            next: 0,
            target,
            compiler: self,
        };
        let value = reader.expression(0, 0)?;
        let rest = reader.peek().clone();
        if rest.token != Token::End {
            let message = format!("unexpected {}", shown(&rest.token));
            let cure = "an operator or the end belongs here";
            return Err(Fault::new(rest.at, message, cure));
        }
        if value.unit != expected {
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

    fn emit(
        &mut self,
        target: Target,
        operation: Operation,
        unit: Unit,
        at: usize,
    ) -> Result<Value, Fault> {
        let Units { program, units } = &mut self.programs[target as usize];
        let place = program.place(operation).ok_or_else(|| {
            let message = format!("more than {OPERATIONS_MAX} operations");
            Fault::new(at, message, "simplify, or write this effect in Rust")
        })?;
        if program.constant(place).is_some_and(|c| !c.is_finite()) {
            let message = "this constant is not finite";
            return Err(Fault::new(at, message, "divide by something other than 0"));
        }
        if usize::from(place) == units.len() {
            units.push(unit);
        }
        Ok(Value { place, unit })
    }

    /// The first state of what a function keeps; the same call twice has one state.
    fn keep(&mut self, kept: Kept, unit: Unit, at: usize) -> Result<usize, Fault> {
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

fn unit_cure() -> &'static str {
    "powers, voltages and frequencies are per unit (1); time is in s, and a number can carry it: \
     `0.5s`, `20ms`"
}

fn shown(token: &Token) -> String {
    match token {
        Token::Number(value, _) => format!("number {value}"),
        Token::Name(name) => format!("name `{name}`"),
        Token::Sign(sign) => format!("`{sign}`"),
        Token::End => "end of the expression".to_owned(),
    }
}

/// Reads the tokens of one expression.
struct Reader<'a> {
    tokens: &'a [Placed],
    next: usize,
    target: Target,
    compiler: &'a mut Compiler,
}

/// Left binding power, and that of the right side.
fn binding(sign: char) -> Option<(u8, u8)> {
    match sign {
        '+' | '-' => Some((1, 2)),
        '*' | '/' => Some((3, 4)),
        '^' => Some((8, 7)),
        _ => None,
    }
}

/// Binding power of a sign in front: weaker than `^`, so that `-v^2` is `-(v^2)`.
const SIGN_BINDING: u8 = 6;

impl Reader<'_> {
    fn peek(&self) -> &Placed {
        // The last token is the end, and nothing reads past it.
        &self.tokens[self.next.min(self.tokens.len() - 1)]
    }

    fn take(&mut self) -> Placed {
        let token = self.peek().clone();
        self.next += 1;
        token
    }

    fn emit(&mut self, operation: Operation, unit: Unit, at: usize) -> Result<Value, Fault> {
        self.compiler.emit(self.target, operation, unit, at)
    }

    fn expression(&mut self, weakest: u8, depth: usize) -> Result<Value, Fault> {
        if depth > NESTING_MAX {
            let message = format!("nested deeper than {NESTING_MAX}");
            let cure = "keep parts of it as states, or write the effect in Rust";
            return Err(Fault::new(self.peek().at, message, cure));
        }
        let mut left = self.prefix(depth)?;
        loop {
            let Placed { token, at } = self.peek().clone();
            let Token::Sign(sign) = token else { break };
            let Some((_, right)) = binding(sign).filter(|(binds, _)| *binds >= weakest) else {
                break;
            };
            self.take();
            let other = self.expression(right, depth + 1)?;
            left = self.combine(sign, left, other, at)?;
        }
        Ok(left)
    }

    fn prefix(&mut self, depth: usize) -> Result<Value, Fault> {
        let Placed { token, at } = self.take();
        match token {
            Token::Number(value, unit) => self.emit(Operation::Constant(value), unit, at),
            Token::Name(name) if self.peek().token == Token::Sign('(') => {
                self.call(&name, at, depth)
            }
            Token::Name(name) => self.name(&name, at),
            Token::Sign('(') => {
                let value = self.expression(0, depth + 1)?;
                self.close(at)?;
                Ok(value)
            }
            Token::Sign('-') => {
                let value = self.expression(SIGN_BINDING, depth + 1)?;
                self.emit(
                    Operation::Unary(Unary::Negative, value.place),
                    value.unit,
                    at,
                )
            }
            Token::Sign('+') => self.expression(SIGN_BINDING, depth + 1),
            other => {
                let message = format!("unexpected {}", shown(&other));
                let cure = "a number, a name or a bracket belongs here";
                Err(Fault::new(at, message, cure))
            }
        }
    }

    fn close(&mut self, opened: usize) -> Result<(), Fault> {
        let Placed { token, at } = self.take();
        if token == Token::Sign(')') {
            return Ok(());
        }
        let message = format!("unexpected {}", shown(&token));
        let cure = format!("the bracket at character {} is still open", opened + 1);
        Err(Fault::new(at, message, cure))
    }

    fn name(&mut self, name: &str, at: usize) -> Result<Value, Fault> {
        if name == "pi" {
            return self.emit(Operation::Constant(std::f64::consts::PI), Unit::ONE, at);
        }
        if let Some((_, variable, unit)) = VARIABLE_NAMES.iter().find(|(n, _, _)| *n == name) {
            self.allowed(name, *variable, at)?;
            return self.emit(Operation::Variable(*variable), *unit, at);
        }
        let found = self.compiler.symbols.iter().find(|s| s.name == name);
        if let Some(symbol) = found {
            let (operation, unit) = (symbol.operation, symbol.unit);
            if let (Target::Initial, Operation::State(_)) = (self.target, operation) {
                let message = format!("the initial value refers to the state `{name}`");
                let cure = "an initial value is made of parameters, v (1), df (0) and q0 only";
                return Err(Fault::new(at, message, cure));
            }
            return self.emit(operation, unit, at);
        }
        Err(self.unknown(name, at))
    }

    fn unknown(&self, name: &str, at: usize) -> Fault {
        let message = format!("unknown variable `{name}`");
        let spelled = self.compiler.spelled_out.iter().find(|(n, _)| n == name);
        if let Some((_, symbol)) = spelled {
            return Fault::new(at, message, format!("its symbol is `{symbol}`"));
        }
        if let Some((_, signature)) = NAMES.iter().find(|(n, _)| *n == name) {
            return Fault::new(at, message, format!("the function is written {signature}"));
        }
        let variables = VARIABLE_NAMES.iter().map(|(n, _, _)| *n);
        let symbols = self.compiler.symbols.iter().map(|s| s.name.as_str());
        Fault::new(at, message, suggestion(name, variables.chain(symbols)))
    }

    /// Power and time are known only where power is computed.
    fn allowed(&self, name: &str, variable: Variable, at: usize) -> Result<(), Fault> {
        let everywhere = [
            Variable::Voltage,
            Variable::FrequencyDeviation,
            Variable::ReactiveAtRest,
        ];
        if self.target == Target::Power || everywhere.contains(&variable) {
            return Ok(());
        }
        let message = format!("`{name}` is not known to states and functions that keep a state");
        let cure = "they see v, df, q0, parameters and states; use it in [power]";
        Err(Fault::new(at, message, cure))
    }

    fn combine(&mut self, sign: char, x: Value, y: Value, at: usize) -> Result<Value, Fault> {
        match sign {
            '+' => self.alike(Binary::Add, [x, y], at),
            '-' => self.alike(Binary::Subtract, [x, y], at),
            '*' => self.product(Binary::Multiply, [x, y], x.unit.times(y.unit), at),
            '/' => self.product(Binary::Divide, [x, y], x.unit.over(y.unit), at),
            _ => self.power([x, y], at),
        }
    }

    /// An operation on two values of one unit.
    fn alike(&mut self, f: Binary, [x, y]: [Value; 2], at: usize) -> Result<Value, Fault> {
        if x.unit != y.unit {
            let message = format!("units differ: {} and {}", x.unit, y.unit);
            return Err(Fault::new(at, message, unit_cure()));
        }
        self.emit(Operation::Binary(f, x.place, y.place), x.unit, at)
    }

    fn product(
        &mut self,
        f: Binary,
        [x, y]: [Value; 2],
        unit: Option<Unit>,
        at: usize,
    ) -> Result<Value, Fault> {
        let unit = unit.ok_or_else(|| {
            let message = format!("the unit of {} and {} runs away", x.unit, y.unit);
            Fault::new(at, message, "divide by a time on the way")
        })?;
        self.emit(Operation::Binary(f, x.place, y.place), unit, at)
    }

    /// `x^y`: a repeated product for a small whole constant, otherwise `exp(y ln x)`.
    fn power(&mut self, [x, y]: [Value; 2], at: usize) -> Result<Value, Fault> {
        self.pure(y, "an exponent", at)?;
        let program = &self.compiler.programs[self.target as usize].program;
        if let Some(whole) = program.constant(y.place).and_then(whole) {
            let unit = x.unit.to_the(i32::from(whole));
            let unit = unit.ok_or_else(|| {
                let message = format!("the unit {}^{whole} runs away", x.unit);
                Fault::new(at, message, "divide by a time before")
            })?;
            return self.emit(Operation::WholePower(x.place, whole), unit, at);
        }
        self.pure(x, "the base of a power that is not a whole number", at)?;
        let operation = Operation::Binary(Binary::Power, x.place, y.place);
        self.emit(operation, Unit::ONE, at)
    }

    fn pure(&self, value: Value, what: &str, at: usize) -> Result<(), Fault> {
        if value.unit == Unit::ONE {
            return Ok(());
        }
        let message = format!("{what} has the unit {}", value.unit);
        Err(Fault::new(at, message, "divide by a time, `x/T` or `x/1s`"))
    }

    /// Arguments up to the closing bracket, each in the program where the function works.
    fn arguments(&mut self, depth: usize) -> Result<Vec<(Value, usize)>, Fault> {
        let Placed { at: opened, .. } = self.take();
        let mut found = Vec::new();
        loop {
            let at = self.peek().at;
            found.push((self.expression(0, depth + 1)?, at));
            if self.peek().token != Token::Sign(',') {
                self.close(opened)?;
                return Ok(found);
            }
            self.take();
        }
    }

    fn call(&mut self, name: &str, at: usize, depth: usize) -> Result<Value, Fault> {
        let Some(function) = functions::find(name) else {
            let message = format!("unknown function `{name}`");
            let known = NAMES.iter().map(|(n, _)| *n);
            return Err(Fault::new(at, message, suggestion(name, known)));
        };
        let outside = self.target;
        if let Some(inside) = function.target() {
            if outside == Target::Initial {
                let message =
                    format!("`{name}` keeps a state, which has no value before the start");
                return Err(Fault::new(at, message, "give the value at rest itself"));
            }
            self.target = inside;
        }
        let arguments = self.arguments(depth);
        let value = arguments.and_then(|arguments| {
            if arguments.len() != function.arity() {
                let message = format!(
                    "`{name}` takes {} arguments, {} given",
                    function.arity(),
                    arguments.len()
                );
                return Err(Fault::new(at, message, function.signature()));
            }
            self.apply(function, &arguments, at, outside)
        });
        self.target = outside;
        value
    }

    fn apply(
        &mut self,
        function: Function,
        given: &[(Value, usize)],
        at: usize,
        outside: Target,
    ) -> Result<Value, Fault> {
        let values: Vec<Value> = given.iter().map(|(v, _)| *v).collect();
        match (function, values.as_slice()) {
            (Function::Unary(f), &[x]) => {
                let unit = match f {
                    Unary::Absolute => x.unit,
                    Unary::Root => x.unit.root().ok_or_else(|| {
                        let message = format!("the root of the unit {}", x.unit);
                        Fault::new(given[0].1, message, "divide by a time before")
                    })?,
                    _ => {
                        self.pure(x, "the argument", given[0].1)?;
                        Unit::ONE
                    }
                };
                self.emit(Operation::Unary(f, x.place), unit, at)
            }
            (Function::Alike(f), &[x, y]) => self.alike(f, [x, y], at),
            (Function::Power, &[x, y]) => self.power([x, y], at),
            (Function::Below, &[x, y]) => self.below([x, y], at),
            (Function::Above, &[x, y]) => {
                let below = self.below([x, y], at)?;
                let one = self.emit(Operation::Constant(1.0), Unit::ONE, at)?;
                self.alike(Binary::Subtract, [one, below], at)
            }
            (Function::Clip, &[x, low, high]) => {
                let raised = self.alike(Binary::Larger, [x, low], at)?;
                self.alike(Binary::Smaller, [raised, high], at)
            }
            (Function::SmoothStep, &[x, from, to]) => {
                let above = self.alike(Binary::Subtract, [x, from], at)?;
                let width = self.alike(Binary::Subtract, [to, from], at)?;
                let share = self.product(Binary::Divide, [above, width], Some(Unit::ONE), at)?;
                self.emit(
                    Operation::Unary(Unary::SmoothStep, share.place),
                    Unit::ONE,
                    at,
                )
            }
            _ => self.stateful(function, &values, at, outside),
        }
    }

    fn below(&mut self, [x, y]: [Value; 2], at: usize) -> Result<Value, Fault> {
        self.pure(x, "the argument", at)?;
        self.alike(Binary::Below, [x, y], at)
    }

    fn stateful(
        &mut self,
        function: Function,
        values: &[Value],
        at: usize,
        outside: Target,
    ) -> Result<Value, Fault> {
        let seconds = |value: Value| {
            if value.unit == Unit::SECOND {
                return Ok(());
            }
            let message = format!("the second argument has the unit {}, not s", value.unit);
            Err(Fault::new(at, message, unit_cure()))
        };
        let (kept, unit) = match (function, values) {
            (Function::Lag, &[x, time]) => {
                seconds(time)?;
                let (input, time) = (x.place, time.place);
                (Kept::Lag { input, time }, x.unit)
            }
            (Function::Timer, &[x]) => {
                self.pure(x, "a condition", at)?;
                (Kept::Timer { condition: x.place }, Unit::SECOND)
            }
            (Function::Latch, &[x, delay]) => {
                self.pure(x, "a condition", at)?;
                seconds(delay)?;
                let (condition, delay) = (x.place, delay.place);
                (Kept::Latch { condition, delay }, Unit::ONE)
            }
            (Function::Maximum, &[x]) => (Kept::Maximum { input: x.place }, x.unit),
            (_, &[x, ..]) => (Kept::Minimum { input: x.place }, x.unit),
            (_, []) => return Err(Fault::new(at, "no argument", function.signature())),
        };
        let first = self.compiler.keep(kept, unit, at)?;
        let state = first + kept.width() - 1;
        let operation = Operation::State(narrow(state));
        self.compiler.emit(outside, operation, unit, at)
    }
}

/// Indices of states and parameters are small by their limits.
pub(super) fn narrow(index: usize) -> u8 {
    u8::try_from(index).unwrap_or(u8::MAX)
}

/// A constant that is a small whole number.
fn whole(value: f64) -> Option<i8> {
    let limit = f64::from(WHOLE_EXPONENT_MAX);
    #[allow(
        clippy::cast_possible_truncation,
        reason = "whole and at most 16 in size"
    )]
    let whole = (value.fract().abs() <= 0.0 && value.abs() <= limit).then_some(value as i8);
    whole
}
