//! From the text of an expression to operations: a parser by binding power that emits operations as
//! it reads. Its recursion is bounded by [`NESTING_MAX`].

use super::{
    compile::{Compiler, Kept, Target, VARIABLE_NAMES, Value, narrow, unit_cure},
    functions::{self, Function, NAMES},
    lexer::{Placed, Token, tokens},
    problem::{Fault, suggestion},
    program::{Binary, Operation, Unary, Variable, WHOLE_EXPONENT_MAX},
    unit::Unit,
};

/// How a message about a name begins that is neither declared nor a variable.
pub(super) const UNKNOWN_VARIABLE: &str = "unknown variable";
/// Deepest nesting of brackets, signs and arguments.
pub(super) const NESTING_MAX: usize = 32;

/// Compiles a whole text into the program of the target.
pub(super) fn value(compiler: &mut Compiler, text: &str, target: Target) -> Result<Value, Fault> {
    let tokens = tokens(text)?;
    let mut reader = Reader {
        tokens: &tokens,
        next: 0,
        target,
        compiler,
    };
    let value = reader.expression(0, 0)?;
    let rest = reader.peek().clone();
    if rest.token != Token::End {
        let message = format!("unexpected {}", shown(&rest.token));
        let cure = "an operator or the end belongs here";
        return Err(Fault::new(rest.at, message, cure));
    }
    Ok(value)
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
        let message = format!("{UNKNOWN_VARIABLE} `{name}`");
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
        if !x.unit.agrees(y.unit) {
            let message = format!("units differ: {} and {}", x.unit, y.unit);
            return Err(Fault::new(at, message, unit_cure()));
        }
        self.emit(
            Operation::Binary(f, x.place, y.place),
            x.unit.or(y.unit),
            at,
        )
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
        pure(y, "an exponent", at)?;
        let constant = self.compiler.constant(self.target, y.place);
        if let Some(whole) = constant.and_then(whole) {
            let unit = x.unit.to_the(i32::from(whole));
            let unit = unit.ok_or_else(|| {
                let message = format!("the unit {}^{whole} runs away", x.unit);
                Fault::new(at, message, "divide by a time before")
            })?;
            return self.emit(Operation::WholePower(x.place, whole), unit, at);
        }
        pure(x, "the base of a power that is not a whole number", at)?;
        let operation = Operation::Binary(Binary::Power, x.place, y.place);
        self.emit(operation, Unit::ONE, at)
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
                        pure(x, "the argument", given[0].1)?;
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
        pure(x, "the argument", at)?;
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
            if value.unit.agrees(Unit::SECOND) {
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
                pure(x, "a condition", at)?;
                (Kept::Timer { condition: x.place }, Unit::SECOND)
            }
            (Function::Latch, &[x, delay]) => {
                pure(x, "a condition", at)?;
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

/// Refuses a value with a unit.
fn pure(value: Value, what: &str, at: usize) -> Result<(), Fault> {
    if value.unit.agrees(Unit::ONE) {
        return Ok(());
    }
    let message = format!("{what} has the unit {}", value.unit);
    Err(Fault::new(at, message, "divide by a time, `x/T` or `x/1s`"))
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
