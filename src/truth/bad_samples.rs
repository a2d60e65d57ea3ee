//! Samples that are bad on purpose, as recorders deliver them.

use super::Random;
use crate::measurement::{Quality, Record, Sample};

/// What is wrong with a run of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Defect {
    /// The samples are missing.
    Gap,
    /// The powers are not numbers.
    NotANumber,
    /// One sample's powers are far off and nothing says so.
    SpikeUnflagged,
    /// The values are wrong and marked as invalid.
    Invalid,
    /// The clock was not synchronised; the values are right.
    NotSynchronised,
    /// The last value is repeated and marked as stale.
    Stale,
}

impl Defect {
    /// Every defect.
    pub const ALL: [Self; 6] = [
        Self::Gap,
        Self::NotANumber,
        Self::SpikeUnflagged,
        Self::Invalid,
        Self::NotSynchronised,
        Self::Stale,
    ];

    /// Name in the truth file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gap => "gap",
            Self::NotANumber => "nan",
            Self::SpikeUnflagged => "spike_unflagged",
            Self::Invalid => "invalid",
            Self::NotSynchronised => "sync",
            Self::Stale => "stale",
        }
    }
}

/// A run of bad samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadSamples {
    /// What is wrong.
    pub defect: Defect,
    /// Index of the first sample.
    pub first: usize,
    /// Number of samples.
    pub count: usize,
}

impl BadSamples {
    /// A run somewhere in the last part of a record of `samples`, after `earliest`; none when there
    /// is no room.
    pub(super) fn draw(random: &mut Random, earliest: usize, samples: usize) -> Option<Self> {
        let defect = Defect::ALL[random.below(Defect::ALL.len())];
        let count = match defect {
            Defect::SpikeUnflagged => 1,
            Defect::NotSynchronised => 20 + random.below(60),
            _ => 2 + random.below(8),
        };
        let room = samples.checked_sub(earliest + count + 1)?;
        Some(Self {
            defect,
            first: earliest + 1 + random.below(room),
            count,
        })
    }

    /// Makes the samples of `record` bad.
    pub(super) fn apply(&self, record: &mut Record) {
        let Some(last_good) = self.first.checked_sub(1) else {
            return;
        };
        let end = (self.first + self.count).min(record.samples.len());
        for index in self.first..end {
            let before = record.samples[last_good];
            let sample = &mut record.samples[index];
            match self.defect {
                Defect::Gap => *sample = Sample::missing(sample.time_ns),
                Defect::NotANumber => {
                    sample.active_pu = f64::NAN;
                    sample.reactive_pu = f64::NAN;
                    sample.quality = sample.quality | Quality::NOT_FINITE;
                }
                Defect::SpikeUnflagged => {
                    sample.active_pu *= 1.6;
                    sample.reactive_pu *= 0.3;
                }
                Defect::Invalid => {
                    sample.voltage_pu *= 0.2;
                    sample.active_pu = 0.0;
                    sample.reactive_pu = 0.0;
                    sample.quality = sample.quality | Quality::DATA_INVALID;
                }
                Defect::NotSynchronised => {
                    sample.quality = sample.quality | Quality::NOT_SYNCHRONISED;
                }
                Defect::Stale => {
                    *sample = Sample {
                        time_ns: sample.time_ns,
                        quality: before.quality | Quality::STALE,
                        ..before
                    };
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> Record {
        let sample = |k: i64| Sample {
            time_ns: k * 10_000_000,
            voltage_pu: 1.0,
            angle_rad: 0.0,
            frequency_hz: 50.0,
            active_pu: 0.9 + 0.001 * k as f64,
            reactive_pu: 0.3,
            negative_sequence_ratio: f64::NAN,
            quality: Quality::GOOD,
        };
        Record {
            start_ns: 0,
            rate_fps: 100.0,
            nominal_hz: 50.0,
            samples: (0..200).map(sample).collect(),
        }
    }

    #[test]
    fn only_the_unflagged_spike_and_the_lost_clock_leave_samples_usable() {
        for defect in Defect::ALL {
            let mut record = record();
            let bad = BadSamples {
                defect,
                first: 50,
                count: 3,
            };
            bad.apply(&mut record);
            let usable = matches!(defect, Defect::SpikeUnflagged | Defect::NotSynchronised);
            assert!(
                record.samples[50..53].iter().all(|s| s.usable() == usable),
                "{defect:?}"
            );
            for neighbour in [49, 53] {
                assert!(record.samples[neighbour].usable());
            }
        }
    }

    #[test]
    fn a_stale_sample_repeats_the_last_good_one() {
        let mut record = record();
        BadSamples {
            defect: Defect::Stale,
            first: 50,
            count: 2,
        }
        .apply(&mut record);
        for index in [50, 51] {
            let (stale, good) = (record.samples[index], record.samples[49]);
            assert!((stale.active_pu - good.active_pu).abs() < 1e-15);
            assert_eq!(stale.time_ns, record.time_ns(index));
        }
    }

    #[test]
    fn drawn_runs_stay_inside_the_record() {
        let mut random = Random::new(5);
        for _ in 0..500 {
            let bad = BadSamples::draw(&mut random, 100, 200).unwrap();
            assert!(bad.first > 100 && bad.first + bad.count <= 200, "{bad:?}");
        }
        assert_eq!(BadSamples::draw(&mut random, 199, 200), None);
    }
}
