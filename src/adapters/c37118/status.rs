//! The STAT word of a PMU's data (6.3, tables 6 and 7).

use super::time::TimeQuality;
use crate::measurement::Quality;

/// STAT as received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status(pub u16);

impl Status {
    /// Bits 15 and 14: 0 good, 1 PMU error of which nothing is known, 2 test mode or no data, 3
    /// PMU error. In 2005: bit 15 data invalid, bit 14 PMU error.
    #[must_use]
    pub const fn data_error(self) -> u8 {
        (self.0 >> 14).to_be_bytes()[1]
    }

    /// Bit 13: the PMU's clock is not in step with UTC.
    #[must_use]
    pub const fn out_of_sync(self) -> bool {
        self.0 & 0x2000 != 0
    }

    /// Bit 12: the data were sorted by arrival, because their time stamp could not be used.
    #[must_use]
    pub const fn sorted_by_arrival(self) -> bool {
        self.0 & 0x1000 != 0
    }

    /// Bit 11: a trigger of the PMU has picked up.
    #[must_use]
    pub const fn triggered(self) -> bool {
        self.0 & 0x0800 != 0
    }

    /// Bit 10: the configuration changes within a minute.
    #[must_use]
    pub const fn configuration_changes(self) -> bool {
        self.0 & 0x0400 != 0
    }

    /// Bit 9 (2011): the data were modified after the measurement.
    #[must_use]
    pub const fn modified(self) -> bool {
        self.0 & 0x0200 != 0
    }

    /// Bits 8 to 6 (2011), table 7: bound on the time error in steps of ten from 1 (100 ns) to 6
    /// (10 ms); 7 is more or unknown, 0 is not used.
    #[must_use]
    pub const fn time_error_code(self) -> u8 {
        (self.0 >> 6).to_be_bytes()[1] & 0x07
    }

    /// Bits 5 and 4: unlocked for less than 10 s (0), 100 s (1), 1000 s (2), or longer (3).
    #[must_use]
    pub const fn unlocked_code(self) -> u8 {
        (self.0 >> 4).to_be_bytes()[1] & 0x03
    }

    /// Bits 3 to 0: why the trigger picked up.
    #[must_use]
    pub const fn trigger_reason(self) -> u8 {
        self.0.to_be_bytes()[1] & 0x0f
    }

    /// The flags of a sample with this STAT, sent at that time quality.
    ///
    /// STAT bits are kept as they are, with three exceptions. Any data error sets
    /// [`Quality::DATA_INVALID`]: a PMU in error of which nothing is known proves nothing. Bits 5
    /// and 4 go to [`Quality::unlocked_code`], because bit 4 means [`Quality::STALE`] in a sample. A
    /// clock that has been unlocked for 10 s or more, has failed, is wrong by 10 ms or more, or whose
    /// data were sorted by arrival, sets [`Quality::NOT_SYNCHRONISED`] as well. The message time
    /// quality is kept in [`Quality::time_quality_code`].
    #[must_use]
    pub fn quality(self, time: TimeQuality) -> Quality {
        const UNLOCKED_BITS: u16 = 0x0030;
        const TIME_ERROR_UNKNOWN: u8 = 7;
        const ERROR_10_MS: u8 = 8;
        let mut quality = Quality(u32::from(self.0 & !UNLOCKED_BITS));
        if self.data_error() != 0 {
            quality = quality | Quality::DATA_INVALID;
        }
        if self.sorted_by_arrival()
            || self.unlocked_code() > 0
            || self.time_error_code() == TIME_ERROR_UNKNOWN
            || time.indicator() >= ERROR_10_MS
        {
            quality = quality | Quality::NOT_SYNCHRONISED;
        }
        quality.with_clock(time.indicator(), self.unlocked_code())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_unlocked_clock_is_unsynchronised_and_not_stale() {
        // STAT of a recorder without a clock: out of step, error unknown, unlocked for 1000 s.
        let quality = Status(0x21f0).quality(TimeQuality(0x0f));
        assert!(quality.contains(Quality::NOT_SYNCHRONISED));
        assert!(!quality.contains(Quality::STALE));
        assert!(quality.usable());
        assert_eq!(
            (quality.time_quality_code(), quality.unlocked_code()),
            (15, 3)
        );
        let unlocked = Status(0x0010).quality(TimeQuality(0));
        assert_eq!(unlocked, Quality::NOT_SYNCHRONISED.with_clock(0, 1));
    }

    #[test]
    fn every_data_error_forbids_use() {
        for status in [0x4000, 0x8000, 0xc000] {
            assert!(!Status(status).quality(TimeQuality(0)).usable());
        }
        assert!(Status(0x0e0f).quality(TimeQuality(0)).usable());
        assert_eq!(Status(0x0800).quality(TimeQuality(0)), Quality(0x0800));
    }

    #[test]
    fn fields_are_where_the_standard_puts_them() {
        let status = Status(0b1001_1010_1101_0101);
        assert_eq!(status.data_error(), 2);
        assert!(status.sorted_by_arrival() && status.triggered() && status.modified());
        assert!(!status.out_of_sync() && !status.configuration_changes());
        assert_eq!(status.time_error_code(), 3);
        assert_eq!(status.unlocked_code(), 1);
        assert_eq!(status.trigger_reason(), 5);
    }
}
