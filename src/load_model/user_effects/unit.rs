//! Units of an effect file. All powers are over P0, all voltages over V0 and all frequencies over
//! the nominal one, so that none of them has a dimension: `v^a`, a polynomial in `v` or a product
//! of power and frequency are textbook equations, and a unit that told volts from watts would
//! refuse them. What is left, and what is confused in practice, is time.

use std::fmt::{self, Display, Formatter};

/// Largest power of a second that an expression may have.
const EXPONENT_MAX: i8 = 8;

/// A power of the second; 0 for everything per unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unit(i8);

impl Unit {
    /// Dimensionless, per unit.
    pub(super) const ONE: Self = Self(0);
    /// Seconds.
    pub(super) const SECOND: Self = Self(1);

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
        Some(Self(part(above)? - denominator))
    }

    pub(super) fn times(self, other: Self) -> Option<Self> {
        Self::bounded(i32::from(self.0) + i32::from(other.0))
    }

    pub(super) fn over(self, other: Self) -> Option<Self> {
        Self::bounded(i32::from(self.0) - i32::from(other.0))
    }

    pub(super) fn to_the(self, exponent: i32) -> Option<Self> {
        Self::bounded(i32::from(self.0).checked_mul(exponent)?)
    }

    pub(super) fn root(self) -> Option<Self> {
        (self.0 % 2 == 0).then_some(Self(self.0 / 2))
    }

    fn bounded(exponent: i32) -> Option<Self> {
        let exponent = i8::try_from(exponent).ok()?;
        (exponent.abs() <= EXPONENT_MAX).then_some(Self(exponent))
    }
}

impl Display for Unit {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0 {
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
    fn powers_that_would_run_away_are_refused() {
        let high = Unit::parse("s^8").unwrap();
        assert_eq!(high.times(Unit::SECOND), None);
        assert_eq!(high.to_the(i32::MAX), None);
        assert_eq!(high.root(), Unit::parse("s^4"));
    }
}
