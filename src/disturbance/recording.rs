//! A recording as a window: whoever recorded it has already decided that it is a disturbance.

use super::{Closing, Detector, DetectorOptions, Trigger, Window, window::window_id};
use crate::measurement::{Record, Site};

/// The whole of a recording, or of an event file of a site folder, as one window. Onset and
/// triggers are the detector's; where it finds none, the onset is where the voltage is farthest
/// from its first values. [`Trigger::Recording`] is among the triggers. None when no sample is
/// usable.
#[must_use]
pub fn window_of_recording(
    site: &Site,
    record: Record,
    options: &DetectorOptions,
) -> Option<Window> {
    let whole_s = record.duration_s() + 1.0;
    let options = DetectorOptions {
        pre_trigger_s: whole_s,
        post_trigger_s: whole_s,
        longest_s: 3.0 * whole_s,
        ..*options
    };
    let mut detector = Detector::new(site, options);
    detector.begin(record.rate_fps);
    for sample in &record.samples {
        detector.push(*sample);
    }
    let found = detector.flush(Closing::RecordingEnded);
    let (onset, mut triggers) = match found {
        Some(window) => (window.onset, window.triggers),
        None => (farthest_from_start(&record)?, Vec::new()),
    };
    triggers.push(Trigger::Recording);
    Some(Window {
        id: window_id(&site.name, record.samples.get(onset)?.time_ns),
        site: site.name.clone(),
        onset,
        triggers,
        closing: Closing::RecordingEnded,
        record,
    })
}

/// The usable sample whose voltage differs most from the first usable one's.
fn farthest_from_start(record: &Record) -> Option<usize> {
    let usable = || {
        record
            .samples
            .iter()
            .enumerate()
            .filter(|(_, s)| s.usable())
    };
    let (_, first) = usable().next()?;
    let distance = |voltage_pu: f64| (voltage_pu - first.voltage_pu).abs();
    usable()
        .max_by(|(_, a), (_, b)| distance(a.voltage_pu).total_cmp(&distance(b.voltage_pu)))
        .map(|(at, _)| at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::{Quality, Sample, record::grid_offset_ns};

    fn record(voltage_pu: impl Fn(usize) -> f64) -> Record {
        let sample = |k: usize| Sample {
            voltage_pu: voltage_pu(k),
            frequency_hz: 50.0,
            active_pu: 1.0,
            reactive_pu: 0.2,
            quality: Quality::GOOD,
            ..Sample::missing(grid_offset_ns(k as f64, 200.0))
        };
        Record {
            start_ns: 0,
            rate_fps: 200.0,
            nominal_hz: 50.0,
            samples: (0..100).map(sample).collect(),
        }
    }

    fn site() -> Site {
        Site {
            name: "here".to_owned(),
            s_base_mva: 1.0,
            v_base_kv: 1.0,
            nominal_hz: 50.0,
        }
    }

    #[test]
    fn a_short_recording_of_two_dips_is_one_window_from_end_to_end() {
        let dips = record(|k| {
            if k == 12 || (13..30).contains(&k) || k > 80 {
                0.87
            } else {
                1.0
            }
        });
        let window = window_of_recording(&site(), dips, &DetectorOptions::default()).unwrap();
        assert_eq!((window.onset, window.record.samples.len()), (12, 100));
        assert_eq!(window.triggers.last(), Some(&Trigger::Recording));
        assert!(window.triggers.contains(&Trigger::VoltageDip));
        assert_eq!(window.id, "here-19700101T000000.060Z");
    }

    #[test]
    fn a_recording_without_a_trigger_starts_where_the_voltage_is_farthest() {
        let drift = record(|k| 1.0 + 1e-6 * k as f64 * (70 - k.min(70)) as f64);
        let window = window_of_recording(&site(), drift, &DetectorOptions::default()).unwrap();
        assert_eq!(window.triggers, [Trigger::Recording]);
        assert_eq!(window.onset, 35);
    }

    #[test]
    fn a_recording_without_a_usable_sample_is_no_window() {
        let nothing = record(|_| f64::NAN);
        assert!(window_of_recording(&site(), nothing, &DetectorOptions::default()).is_none());
    }
}
