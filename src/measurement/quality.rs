//! Quality of one sample: the STAT bits of IEEE C37.118.2 plus what intake itself found.

use std::{fmt, ops::BitOr};

/// Quality flags of one sample.
///
/// The low 16 bits have the meaning of the C37.118.2 STAT word, except for bits 5 and 4: in site
/// folders and batches bit 4 means [`Quality::STALE`], so that the code of the time without lock
/// that STAT has there is kept in [`Quality::unlocked_code`] instead. Bits 16 to 18 are set by intake;
/// bits 24 to 29 keep what the source said of its clock and forbid nothing by themselves.
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

    /// The bits of [`Quality::time_quality_code`] and [`Quality::unlocked_code`].
    pub const CLOCK: Self = Self(0x3f00_0000);

    const TIME_QUALITY_SHIFT: u32 = 24;
    const UNLOCKED_SHIFT: u32 = 28;

    /// These flags with the source's words on its clock: the message time quality (C37.118.2, table
    /// 4, 0 to 15) and the code of the time without lock (table 7, 0 to 3).
    #[must_use]
    pub const fn with_clock(self, time_quality_code: u8, unlocked_code: u8) -> Self {
        let time_quality = (time_quality_code & 0x0f) as u32;
        let unlocked = (unlocked_code & 0x03) as u32;
        let clock = time_quality << Self::TIME_QUALITY_SHIFT | unlocked << Self::UNLOCKED_SHIFT;
        Self(self.0 & !Self::CLOCK.0 | clock)
    }

    /// Message time quality: 0 locked, n from 1 to 11 wrong by at most 10^(n - 10) s, 15 failed. Of
    /// several streams the bitwise or, which is never better than the worst.
    #[must_use]
    pub const fn time_quality_code(self) -> u8 {
        (self.0 >> Self::TIME_QUALITY_SHIFT).to_le_bytes()[0] & 0x0f
    }

    /// Time without lock: 0 locked or less than 10 s, 1 less than 100 s, 2 less than 1000 s, 3 more.
    #[must_use]
    pub const fn unlocked_code(self) -> u8 {
        (self.0 >> Self::UNLOCKED_SHIFT).to_le_bytes()[0] & 0x03
    }

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

    #[test]
    fn what_a_source_says_of_its_clock_is_kept_and_forbids_nothing() {
        let quality = Quality::NOT_SYNCHRONISED.with_clock(0x0b, 3);
        assert_eq!(quality.time_quality_code(), 0x0b);
        assert_eq!(quality.unlocked_code(), 3);
        assert!(quality.usable() && quality.contains(Quality::NOT_SYNCHRONISED));
        assert_eq!(quality.with_clock(0, 0), Quality::NOT_SYNCHRONISED);
        assert_eq!(Quality::CLOCK, Quality::GOOD.with_clock(0xff, 0xff));
    }
}
