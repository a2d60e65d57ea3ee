//! The functions an expression may call.

use super::{
    compile::Target,
    program::{Binary, Unary},
};

/// A function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Function {
    Unary(Unary),
    /// On two values of one unit.
    Alike(Binary),
    Power,
    Below,
    Above,
    Clip,
    SmoothStep,
    Lag,
    Timer,
    Latch,
    Minimum,
    Maximum,
}

/// Name and signature of every function, in the order of the manual.
pub(super) const NAMES: [(&str, &str); 18] = [
    ("abs", "abs(x)"),
    ("exp", "exp(x)"),
    ("ln", "ln(x)"),
    ("sqrt", "sqrt(x)"),
    ("sin", "sin(x)"),
    ("cos", "cos(x)"),
    ("pow", "pow(x, exponent)"),
    ("min", "min(x, y)"),
    ("max", "max(x, y)"),
    ("clip", "clip(x, low, high)"),
    ("smooth_step", "smooth_step(x, from, to)"),
    ("below", "below(x, threshold)"),
    ("above", "above(x, threshold)"),
    ("lag", "lag(x, time_constant)"),
    ("timer", "timer(condition)"),
    ("latch", "latch(condition, delay)"),
    ("minimum_since_start", "minimum_since_start(x)"),
    ("maximum_since_start", "maximum_since_start(x)"),
];

/// The function of this name.
pub(super) fn find(name: &str) -> Option<Function> {
    Some(match name {
        "abs" => Function::Unary(Unary::Absolute),
        "exp" => Function::Unary(Unary::Exponential),
        "ln" => Function::Unary(Unary::Logarithm),
        "sqrt" => Function::Unary(Unary::Root),
        "sin" => Function::Unary(Unary::Sine),
        "cos" => Function::Unary(Unary::Cosine),
        "pow" => Function::Power,
        "min" => Function::Alike(Binary::Smaller),
        "max" => Function::Alike(Binary::Larger),
        "clip" => Function::Clip,
        "smooth_step" => Function::SmoothStep,
        "below" => Function::Below,
        "above" => Function::Above,
        "lag" => Function::Lag,
        "timer" => Function::Timer,
        "latch" => Function::Latch,
        "minimum_since_start" => Function::Minimum,
        "maximum_since_start" => Function::Maximum,
        _ => return None,
    })
}

impl Function {
    /// Number of arguments.
    pub(super) fn arity(self) -> usize {
        match self {
            Self::Unary(_) | Self::Timer | Self::Minimum | Self::Maximum => 1,
            Self::Clip | Self::SmoothStep => 3,
            _ => 2,
        }
    }

    /// How it is written.
    pub(super) fn signature(self) -> String {
        let found = NAMES.iter().find(|(name, _)| find(name) == Some(self));
        format!("write {}", found.map_or("", |(_, signature)| signature))
    }

    /// The program in which a function that keeps a state reads its arguments.
    pub(super) fn target(self) -> Option<Target> {
        match self {
            Self::Lag => Some(Target::Rates),
            Self::Timer | Self::Latch | Self::Minimum | Self::Maximum => Some(Target::Conditions),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn every_function_is_listed_with_as_many_arguments_as_it_takes() {
        for (name, signature) in NAMES {
            let function = find(name).unwrap();
            assert!(signature.starts_with(&format!("{name}(")));
            assert_eq!(signature.matches(',').count() + 1, function.arity());
        }
    }

    #[test]
    fn the_manual_has_every_function() {
        // Relative to the project root, unless the module was given an absolute path.
        let here = Path::new(env!("CARGO_MANIFEST_DIR")).join(file!());
        let root = here.ancestors().nth(4).unwrap();
        let manual = std::fs::read_to_string(root.join("docs/adding-an-effect.md")).unwrap();
        for (_, signature) in NAMES {
            assert!(manual.contains(&format!("`{signature}`")), "{signature}");
        }
    }
}
