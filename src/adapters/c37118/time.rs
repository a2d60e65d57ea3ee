//! Time stamps: SOC, FRACSEC and the message time quality (6.2.2, tables 3 and 4).

use super::{
    bytes::Reader,
    error::{EncodeError, Error},
};

/// Largest value of the 24-bit fraction.
pub(super) const FRACTION_MAX: u32 = 0x00ff_ffff;

/// SOC and FRACSEC of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timestamp {
    /// SOC: seconds since 1970-01-01 UTC, leap seconds not counted.
    pub seconds: u32,
    /// Low 24 bits of FRACSEC: fraction of the second in units of 1 / `TIME_BASE`.
    pub fraction: u32,
    /// High byte of FRACSEC.
    pub quality: TimeQuality,
}

/// The message time quality: leap-second bits and the state of the clock (tables 3 and 4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeQuality(pub u8);

impl TimeQuality {
    /// Bit 6: the leap second is a deletion, not an insertion.
    #[must_use]
    pub const fn leap_second_deletes(self) -> bool {
        self.0 & 0x40 != 0
    }

    /// Bit 5: set for 24 hours after a leap second.
    #[must_use]
    pub const fn leap_second_occurred(self) -> bool {
        self.0 & 0x20 != 0
    }

    /// Bit 4: a leap second follows within the minute; cleared in the second after it.
    #[must_use]
    pub const fn leap_second_pending(self) -> bool {
        self.0 & 0x10 != 0
    }

    /// Bits 3 to 0, the code of table 4: 0 is locked, 15 is a failed clock.
    #[must_use]
    pub const fn indicator(self) -> u8 {
        self.0 & 0x0f
    }

    /// Bound on the clock's error, seconds: code n between 1 and 11 means 10^(n - 10). None while
    /// the clock is locked, has failed, or the code is reserved.
    #[must_use]
    pub fn error_bound_s(self) -> Option<f64> {
        let code = self.indicator();
        (1..=11)
            .contains(&code)
            .then(|| 10.0_f64.powi(i32::from(code) - 10))
    }
}

impl Timestamp {
    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        let seconds = reader.u32("SOC")?;
        let fraction = reader.u32("FRACSEC")?;
        Ok(Self {
            seconds,
            fraction: fraction & FRACTION_MAX,
            quality: TimeQuality(fraction.to_be_bytes()[0]),
        })
    }

    pub(super) fn write(self, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        if self.fraction > FRACTION_MAX {
            return Err(EncodeError::Value {
                field: "FRACSEC",
                found: i64::from(self.fraction),
                expected: "a number of 24 bits",
            });
        }
        out.extend(self.seconds.to_be_bytes());
        let quality = u32::from(self.quality.0) << 24;
        out.extend((quality | self.fraction).to_be_bytes());
        Ok(())
    }

    /// UTC nanoseconds since 1970, rounded to the nearest. None when the fraction is not below
    /// `time_base`, the parts of a second of the configuration.
    ///
    /// The second that a leap second inserts has no number of its own in SOC nor in UTC
    /// nanoseconds: see [`Timestamp::in_inserted_second`].
    #[must_use]
    pub fn utc_ns(self, time_base: u32) -> Option<i64> {
        const NANOSECONDS: u64 = 1_000_000_000;
        if self.fraction >= time_base {
            return None;
        }
        let base = u64::from(time_base);
        let fraction_ns = (u64::from(self.fraction) * NANOSECONDS + base / 2) / base;
        let total = u64::from(self.seconds) * NANOSECONDS + fraction_ns;
        i64::try_from(total).ok()
    }

    /// Whether the stamp lies in 23:59:60: an insertion is still pending although the count has
    /// reached the new day. It then repeats the stamps of the second after it.
    #[must_use]
    pub const fn in_inserted_second(self) -> bool {
        const DAY_SECONDS: u32 = 86_400;
        self.quality.leap_second_pending()
            && !self.quality.leap_second_deletes()
            && self.seconds.is_multiple_of(DAY_SECONDS)
    }

    /// The stamp of `utc_ns`, rounded to the nearest part of `time_base`; none outside 1970 to
    /// 2106 or for a base of zero or of more than 24 bits.
    #[must_use]
    pub fn from_utc_ns(utc_ns: i64, time_base: u32, quality: TimeQuality) -> Option<Self> {
        const NANOSECONDS: u64 = 1_000_000_000;
        if time_base == 0 || time_base > FRACTION_MAX {
            return None;
        }
        let total = u64::try_from(utc_ns).ok()?;
        let parts = (total % NANOSECONDS * u64::from(time_base) + NANOSECONDS / 2) / NANOSECONDS;
        let carry = parts / u64::from(time_base);
        Some(Self {
            seconds: u32::try_from(total / NANOSECONDS + carry).ok()?,
            fraction: u32::try_from(parts % u64::from(time_base)).ok()?,
            quality,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fraction_counts_parts_of_the_time_base() {
        let stamp = Timestamp {
            seconds: 1_500_878_659,
            fraction: 300_000,
            quality: TimeQuality(0x0f),
        };
        assert_eq!(stamp.utc_ns(1_000_000), Some(1_500_878_659_300_000_000));
        assert_eq!(
            stamp.utc_ns(300_000),
            None,
            "the fraction is a whole second"
        );
        assert_eq!(stamp.quality.error_bound_s(), None);
        assert_eq!(TimeQuality(0x09).error_bound_s(), Some(0.1));
    }

    #[test]
    fn writing_a_time_rounds_into_the_next_second() {
        let ns = 1_999_999_999;
        let stamp = Timestamp::from_utc_ns(ns, 1_000_000, TimeQuality(0)).unwrap();
        assert_eq!((stamp.seconds, stamp.fraction), (2, 0));
        assert_eq!(Timestamp::from_utc_ns(-1, 1_000_000, TimeQuality(0)), None);
        assert_eq!(Timestamp::from_utc_ns(0, 0, TimeQuality(0)), None);
    }

    #[test]
    fn inserted_second_is_told_by_the_pending_bit_at_midnight() {
        let midnight = |quality| Timestamp {
            seconds: 1_483_228_800,
            fraction: 0,
            quality: TimeQuality(quality),
        };
        assert!(midnight(0x10).in_inserted_second());
        assert!(!midnight(0x20).in_inserted_second(), "the second after it");
        assert!(!midnight(0x50).in_inserted_second(), "a deletion");
    }
}
