//! Expressions as a flat list of operations, evaluated over any [`Elementary`] scalar: one source
//! for values and for exact derivatives. An operation refers only to earlier ones, so that
//! evaluation is one pass without a stack, and equal operations are there once.

use crate::{
    load_model::effects::relay,
    numerics::{
        Elementary,
        elementary::{larger, power, smaller, smooth_step},
    },
};

/// Most operations of one program. Bounds time and the stack of an evaluation (72 bytes each).
pub(super) const OPERATIONS_MAX: usize = 512;
/// Largest exponent that is a repeated product.
pub(super) const WHOLE_EXPONENT_MAX: i32 = 16;

/// What an expression sees besides parameters and states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Variable {
    /// `|u|` at the load over V0.
    Voltage,
    /// Frequency deviation, pu.
    FrequencyDeviation,
    /// Time since the first sample, s.
    Time,
    /// `Q0/P0`.
    ReactiveAtRest,
    /// Power of the motors over P0.
    MotorActive,
    /// Reactive power of the motors over P0, magnetisation included.
    MotorReactive,
    /// Active power of the static part over P0.
    StaticActive,
}

/// Number of variables.
pub(super) const VARIABLES: usize = 7;

/// An operation on one value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unary {
    Negative,
    Absolute,
    Exponential,
    Logarithm,
    Root,
    Sine,
    Cosine,
    SmoothStep,
}

/// An operation on two values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Smaller,
    Larger,
    /// Whether the first is below the second, spread as in `effects::relay`.
    Below,
}

/// Index of an operation in its program.
pub(super) type Place = u16;

/// One operation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Operation {
    Constant(f64),
    Variable(Variable),
    Parameter(u8),
    State(u8),
    Unary(Unary, Place),
    Binary(Binary, Place, Place),
    WholePower(Place, i8),
}

/// The values a program sees.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scope<'a, S> {
    pub(super) variables: [S; VARIABLES],
    pub(super) parameters: &'a [S],
    pub(super) states: &'a [S],
}

/// A list of operations.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Program {
    operations: Vec<Operation>,
}

impl Program {
    /// The place of an operation, which is added unless it is there; `None` when the program is full.
    pub(super) fn place(&mut self, operation: Operation) -> Option<Place> {
        let operation = self.folded(operation);
        let known = self.operations.iter().position(|o| same(o, &operation));
        if known.is_none() && self.operations.len() >= OPERATIONS_MAX {
            return None;
        }
        let place = known.unwrap_or_else(|| {
            self.operations.push(operation);
            self.operations.len() - 1
        });
        Place::try_from(place).ok()
    }

    /// The value of a constant operation.
    pub(super) fn constant(&self, place: Place) -> Option<f64> {
        match self.operations.get(usize::from(place)) {
            Some(Operation::Constant(value)) => Some(*value),
            _ => None,
        }
    }

    /// Whether some operation reads the parameter.
    pub(super) fn reads(&self, operation: Operation) -> bool {
        self.operations.contains(&operation)
    }

    /// An operation on constants becomes a constant.
    fn folded(&self, operation: Operation) -> Operation {
        let value = match operation {
            Operation::Unary(f, x) => self.constant(x).map(|x| unary(f, x)),
            Operation::Binary(f, x, y) => match (self.constant(x), self.constant(y)) {
                (Some(x), Some(y)) => Some(binary(f, x, y)),
                _ => None,
            },
            Operation::WholePower(x, n) => self.constant(x).map(|x| whole_power(x, n)),
            _ => None,
        };
        value.map_or(operation, Operation::Constant)
    }

    /// The states that the values at these places are made of, one bit each.
    pub(super) fn states_behind(&self, places: &[Place]) -> u32 {
        let needed = self.needed(places);
        let states = self.operations.iter().zip(needed).map(|(o, n)| match o {
            Operation::State(i) if n => 1_u32 << i,
            _ => 0,
        });
        states.fold(0, |all, state| all | state)
    }

    /// Which operations the values at these places need.
    fn needed(&self, places: &[Place]) -> Vec<bool> {
        let mut needed = vec![false; self.operations.len()];
        for place in places {
            if let Some(mark) = needed.get_mut(usize::from(*place)) {
                *mark = true;
            }
        }
        for k in (0..self.operations.len()).rev() {
            if !needed[k] {
                continue;
            }
            // Arguments come before what is made of them.
            match self.operations[k] {
                Operation::Unary(_, x) | Operation::WholePower(x, _) => {
                    needed[usize::from(x)] = true;
                }
                Operation::Binary(_, x, y) => {
                    needed[usize::from(x)] = true;
                    needed[usize::from(y)] = true;
                }
                _ => {}
            }
        }
        needed
    }

    /// What the values at these places need, ready for evaluation.
    pub(super) fn flat(&self, wanted: &[Place]) -> Flat {
        let needed = self.needed(wanted);
        let mut flat = Flat::default();
        let mut sources: Vec<Source> = Vec::new();
        for (operation, needed) in self.operations.iter().zip(needed) {
            let source = |place: Place| sources[usize::from(place)];
            let constant = |place: Place| self.constant(place);
            let step = match *operation {
                _ if !needed => None,
                Operation::Variable(_) | Operation::Parameter(_) | Operation::State(_) => None,
                Operation::Constant(value) => Some(Step::Constant(value)),
                Operation::Unary(f, x) => Some(Step::Unary(f, source(x))),
                Operation::WholePower(x, n) => Some(Step::WholePower(source(x), n)),
                Operation::Binary(f, x, y) => Some(match (f, constant(x), constant(y)) {
                    (Binary::Add, None, Some(c)) => Step::Add(source(x), c),
                    (Binary::Add, Some(c), None) => Step::Add(source(y), c),
                    (Binary::Subtract, None, Some(c)) => Step::Add(source(x), -c),
                    (Binary::Multiply, None, Some(c)) => Step::Scale(source(x), c),
                    (Binary::Multiply, Some(c), None) => Step::Scale(source(y), c),
                    _ => Step::Binary(f, source(x), source(y)),
                }),
            };
            sources.push(match *operation {
                Operation::Variable(variable) => Source::Variable(variable),
                Operation::Parameter(i) => Source::Parameter(i),
                Operation::State(i) => Source::State(i),
                _ => Source::Step(Place::try_from(flat.steps.len()).unwrap_or(Place::MAX)),
            });
            flat.steps.extend(step);
        }
        flat.outputs = wanted
            .iter()
            .map(|place| sources[usize::from(*place)])
            .collect();
        flat
    }
}

/// Where an operand is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    Variable(Variable),
    Parameter(u8),
    State(u8),
    Step(Place),
}

/// One operation on operands where they are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Constant(f64),
    Add(Source, f64),
    Scale(Source, f64),
    Unary(Unary, Source),
    Binary(Binary, Source, Source),
    WholePower(Source, i8),
}

/// What evaluation runs through: no loads, no operation that nobody needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Flat {
    steps: Vec<Step>,
    outputs: Vec<Source>,
}

impl Flat {
    /// Evaluates, and writes the outputs in their order.
    pub(super) fn evaluate<S: Elementary>(&self, scope: &Scope<'_, S>, into: &mut [S]) {
        // The smallest of a few sizes: filling the array is part of the cost.
        match self.steps.len() {
            0..=4 => self.evaluate_in::<S, 4>(scope, into),
            5..=8 => self.evaluate_in::<S, 8>(scope, into),
            9..=16 => self.evaluate_in::<S, 16>(scope, into),
            17..=64 => self.evaluate_in::<S, 64>(scope, into),
            _ => self.evaluate_in::<S, OPERATIONS_MAX>(scope, into),
        }
    }

    fn evaluate_in<S: Elementary, const N: usize>(&self, scope: &Scope<'_, S>, into: &mut [S]) {
        let mut values = [S::constant(0.0); N];
        for (k, step) in self.steps.iter().take(N).enumerate() {
            let at = |source: Source| scope.at(source, &values);
            let value = match *step {
                Step::Constant(value) => S::constant(value),
                Step::Add(x, c) => *at(x) + c,
                Step::Scale(x, c) => *at(x) * c,
                Step::Unary(f, x) => unary(f, *at(x)),
                Step::Binary(f, x, y) => binary(f, *at(x), *at(y)),
                Step::WholePower(x, n) => whole_power(*at(x), n),
            };
            values[k] = value;
        }
        for (source, target) in self.outputs.iter().zip(into) {
            *target = *scope.at(*source, &values);
        }
    }
}

impl<S> Scope<'_, S> {
    fn at<'v>(&'v self, source: Source, values: &'v [S]) -> &'v S {
        match source {
            Source::Variable(variable) => &self.variables[variable as usize],
            Source::Parameter(i) => &self.parameters[usize::from(i)],
            Source::State(i) => &self.states[usize::from(i)],
            Source::Step(place) => &values[usize::from(place)],
        }
    }
}

/// Equality of operations in which a constant equals itself by its bits.
fn same(one: &Operation, other: &Operation) -> bool {
    match (one, other) {
        (Operation::Constant(x), Operation::Constant(y)) => x.to_bits() == y.to_bits(),
        _ => one == other,
    }
}

fn unary<S: Elementary>(f: Unary, x: S) -> S {
    match f {
        Unary::Negative => -x,
        Unary::Absolute => {
            if x.value() < 0.0 {
                -x
            } else {
                x
            }
        }
        Unary::Exponential => x.exp(),
        Unary::Logarithm => x.ln(),
        // The slope at 0 is infinite; 0 stands for it, as a value that never left 0 has no slope.
        Unary::Root if is_zero(x) => S::constant(0.0),
        Unary::Root => x.sqrt(),
        Unary::Sine => x.sin_cos()[0],
        Unary::Cosine => x.sin_cos()[1],
        Unary::SmoothStep => smooth_step(x),
    }
}

fn binary<S: Elementary>(f: Binary, x: S, y: S) -> S {
    match f {
        Binary::Add => x + y,
        Binary::Subtract => x - y,
        Binary::Multiply => x * y,
        Binary::Divide => x / y,
        // 0^y for y > 0, at a dead bus: 0, and no slope by y.
        Binary::Power if is_zero(x) && y.value() > 0.0 => S::constant(0.0),
        Binary::Power => power(x, y),
        Binary::Smaller => smaller(x, y),
        Binary::Larger => larger(x, y),
        Binary::Below => relay::below(x, y),
    }
}

fn is_zero<S: Elementary>(x: S) -> bool {
    x.value().abs() <= 0.0
}

fn whole_power<S: Elementary>(x: S, exponent: i8) -> S {
    let factors = exponent.unsigned_abs();
    let mut product = if factors == 0 { S::constant(1.0) } else { x };
    for _ in 1..factors {
        product = product * x;
    }
    if exponent < 0 {
        S::constant(1.0) / product
    } else {
        product
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::{Dual, Scalar};

    fn every_operation() -> (Program, Vec<Place>) {
        let mut program = Program::default();
        let x = program.place(Operation::Parameter(0)).unwrap();
        let y = program.place(Operation::Parameter(1)).unwrap();
        let unaries = [
            Unary::Negative,
            Unary::Absolute,
            Unary::Exponential,
            Unary::Logarithm,
            Unary::Root,
            Unary::Sine,
            Unary::Cosine,
            Unary::SmoothStep,
        ];
        let binaries = [
            Binary::Add,
            Binary::Subtract,
            Binary::Multiply,
            Binary::Divide,
            Binary::Power,
            Binary::Smaller,
            Binary::Larger,
            Binary::Below,
        ];
        let mut all: Vec<Operation> = unaries.map(|f| Operation::Unary(f, x)).to_vec();
        all.extend(binaries.map(|f| Operation::Binary(f, x, y)));
        all.extend([3, -2, 0].map(|n| Operation::WholePower(x, n)));
        let places = all.iter().map(|o| program.place(*o).unwrap()).collect();
        (program, places)
    }

    fn evaluate<S: Elementary>(x: S, y: S) -> Vec<S> {
        let (program, places) = every_operation();
        let mut out = vec![S::constant(0.0); places.len()];
        let scope = Scope {
            variables: [S::constant(0.0); VARIABLES],
            parameters: &[x, y],
            states: &[],
        };
        program.flat(&places).evaluate(&scope, &mut out);
        out
    }

    #[test]
    fn derivatives_of_every_operation_agree_with_differences() {
        // Within the spread of `Below`, and away from equality.
        for (x, y) in [(0.701, 0.705), (0.43, 0.9), (0.9, 0.2)] {
            let exact = evaluate(Dual::<2>::variable(x, 0), Dual::<2>::variable(y, 1));
            let plain = evaluate(x, y);
            let h = 1e-7;
            let by = [
                [evaluate(x + h, y), evaluate(x - h, y)],
                [evaluate(x, y + h), evaluate(x, y - h)],
            ];
            for (k, dual) in exact.iter().enumerate() {
                assert_eq!(dual.value.to_bits(), plain[k].to_bits());
                for (i, [plus, minus]) in by.iter().enumerate() {
                    let difference = (plus[k] - minus[k]) / (2.0 * h);
                    let error = (dual.derivatives[i] - difference).abs();
                    assert!(error < 1e-6 * (1.0 + difference.abs()), "{k} {i}");
                }
            }
        }
    }

    #[test]
    fn equal_operations_and_constants_are_there_once() {
        let mut program = Program::default();
        let two = program.place(Operation::Constant(2.0)).unwrap();
        let four = program
            .place(Operation::Binary(Binary::Multiply, two, two))
            .unwrap();
        assert!(
            program
                .constant(four)
                .is_some_and(|c| (c - 4.0).abs() < 1e-15)
        );
        let again = program.place(Operation::Constant(4.0)).unwrap();
        assert_eq!(four, again);
    }

    #[test]
    fn a_dead_bus_has_finite_powers_and_roots() {
        let zero = Dual::<1>::variable(0.0, 0);
        let exponent = Dual::<1>::constant(1.7);
        let power = binary(Binary::Power, zero, exponent);
        let root = unary(Unary::Root, zero);
        for x in [power, root] {
            assert!(x.value.abs() <= 0.0 && x.derivatives[0].abs() <= 0.0);
        }
        assert!(!binary(Binary::Divide, 1.0, 0.0).is_finite());
        assert!(unary(Unary::Root, -1.0).is_nan());
    }
}
