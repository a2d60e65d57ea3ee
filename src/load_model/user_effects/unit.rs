//! Units of an effect file. All powers are over P0, all voltages over V0 and all frequencies over
//! the nominal one, so that none of them has a dimension: `v^a`, a polynomial in `v` or a product
//! of power and frequency are textbook equations, and a unit that told volts from watts would
//! refuse them. What is left, and what is confused in practice, is time.

use std::fmt::{self, Display, Formatter};

/// Largest power of a second that an expression may have.
const EXPONENT_MAX: i8 = 8;

/// A power of the second, 0 for everything per unit; none where the declaration is at fault, which was told there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unit(Option<i8>);

impl Unit {
    /// Dimensionless, per unit.
    pub(super) const ONE: Self = Self(Some(0));
    /// Seconds.
    pub(super) const SECOND: Self = Self(Some(1));
    /// Of what is declared with no unit, or a wrong one: it agrees with every other.
    pub(super) const UNKNOWN: Self = Self(None);

    /// Whether values of these units can be added or compared.
    pub(super) fn agrees(self, other: Self) -> bool {
        self == other || self == Self::UNKNOWN || other == Self::UNKNOWN
    }

    /// The unit of a sum.
    pub(super) fn or(self, other: Self) -> Self {
        Self(self.0.or(other.0))
    }

    /// `1`, `pu`, `s`, `s^2`, `1/s`, `pu/s`, `1/s^2`.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (above, below) = match text.split_once('/') {
            None => (text, None),
            Some((above, below)) => (above, Some(below)),
        };
        let part = |t: &str| match t.trim() {
            "1" | "pu" => Some(0),
            "s" => Some(1),
            other => {
                let exponent: i8 = other.strip_prefix("s^")?.parse().ok()?;
                (1..=EXPONENT_MAX).contains(&exponent).then_some(exponent)
            }
        };
        let denominator = below.map_or(Some(0), part)?;
        Some(Self(Some(part(above)? - denominator)))
    }

    pub(super) fn times(self, other: Self) -> Option<Self> {
        self.with(other, |a, b| Some(a + b))
    }

    pub(super) fn over(self, other: Self) -> Option<Self> {
        self.with(other, |a, b| Some(a - b))
    }

    pub(super) fn to_the(self, exponent: i32) -> Option<Self> {
        self.with(Self::ONE, |a, _| a.checked_mul(exponent))
    }

    pub(super) fn root(self) -> Option<Self> {
        self.with(Self::ONE, |a, _| (a % 2 == 0).then_some(a / 2))
    }

    /// The exponent made of two, within its bounds.
    fn with(self, other: Self, made: impl Fn(i32, i32) -> Option<i32>) -> Option<Self> {
        let (Some(own), Some(other)) = (self.0, other.0) else {
            return Some(Self::UNKNOWN);
        };
        let exponent = i8::try_from(made(i32::from(own), i32::from(other))?).ok()?;
        (exponent.abs() <= EXPONENT_MAX).then_some(Self(Some(exponent)))
    }
}

impl Display for Unit {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Some(exponent) = self.0 else {
            return write!(f, "?");
        };
        match exponent {
            0 => write!(f, "1"),
            1 => write!(f, "s"),
            -1 => write!(f, "1/s"),
            n if n > 0 => write!(f, "s^{n}"),
            n => write!(f, "1/s^{}", -n),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_powers_of_a_second() {
        for (text, shown) in [
            ("1", "1"),
            ("pu", "1"),
            ("s", "s"),
            ("1/s", "1/s"),
            ("pu/s^2", "1/s^2"),
            ("s^3", "s^3"),
        ] {
            assert_eq!(Unit::parse(text).unwrap().to_string(), shown);
        }
        for text in ["", "ms", "%", "Hz", "s^0", "s^99", "s/s/s", "S"] {
            assert_eq!(Unit::parse(text), None, "{text}");
        }
    }

    #[test]
    fn what_is_not_known_agrees_with_everything() {
        for unit in [Unit::ONE, Unit::SECOND, Unit::UNKNOWN] {
            assert!(unit.agrees(Unit::UNKNOWN) && Unit::UNKNOWN.agrees(unit));
            assert_eq!(unit.times(Unit::UNKNOWN), Some(Unit::UNKNOWN));
            assert_eq!(Unit::UNKNOWN.or(unit), unit);
        }
        assert!(!Unit::ONE.agrees(Unit::SECOND));
    }

    #[test]
    fn powers_that_would_run_away_are_refused() {
        let high = Unit::parse("s^8").unwrap();
        assert_eq!(high.times(Unit::SECOND), None);
        assert_eq!(high.to_the(i32::MAX), None);
        assert_eq!(high.root(), Unit::parse("s^4"));
    }
}
