//! Quality of one sample: the STAT bits of IEEE C37.118.2 plus what intake itself found.

use std::{fmt, ops::BitOr};

/// Quality flags of one sample. The low 16 bits are C37.118.2 STAT bits as received; the high bits
/// are set by intake.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Quality(pub u32);

impl Quality {
    /// Nothing to object to.
    pub const GOOD: Self = Self(0);
    /// STAT bit 15: the data are invalid.
    pub const DATA_INVALID: Self = Self(0x8000);
    /// STAT bit 13: the source's clock was not synchronised.
    pub const NOT_SYNCHRONISED: Self = Self(0x2000);
    /// STAT bit 4 as used by site folders: stale or interpolated by the source.
    pub const STALE: Self = Self(0x0010);
    /// No sample arrived for this instant.
    pub const MISSING: Self = Self(0x0001_0000);
    /// A channel held a value that is not a finite number.
    pub const NOT_FINITE: Self = Self(0x0002_0000);
    /// An isolated spike that its neighbours contradict.
    pub const SPIKE: Self = Self(0x0004_0000);

    /// Whether all flags of `other` are set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether the values may be used in a fit. A sample whose clock was not synchronised may: its
    /// magnitudes are right, and a wrong time shows as a skew, which has its own test.
    #[must_use]
    pub const fn usable(self) -> bool {
        const REFUSED: u32 = Quality::DATA_INVALID.0
            | Quality::STALE.0
            | Quality::MISSING.0
            | Quality::NOT_FINITE.0
            | Quality::SPIKE.0;
        self.0 & REFUSED == 0
    }
}

impl BitOr for Quality {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:#07x}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unsynchronised_sample_is_usable_and_an_invalid_one_is_not() {
        assert!(Quality::NOT_SYNCHRONISED.usable());
        assert!(!(Quality::NOT_SYNCHRONISED | Quality::DATA_INVALID).usable());
        assert!(!Quality::MISSING.usable());
    }
}
