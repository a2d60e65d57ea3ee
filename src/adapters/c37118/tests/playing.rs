//! Samples played as frames come back as they were.

use crate::{
    adapters::c37118::{
        AnalogPower, ConfigurationKind, FrameIntake, LoadMapping, PhasorSet, Played, PlayingError,
        PowerSource,
    },
    measurement::{Channel, Quality, Sample, Site},
};

fn site() -> Site {
    Site {
        name: "a substation with a long name".to_owned(),
        s_base_mva: 40.0,
        v_base_kv: 110.0,
        nominal_hz: 60.0,
    }
}

fn sample(k: u32) -> Sample {
    let x = f64::from(k) / 60.0;
    Sample {
        time_ns: 1_700_000_000_000_000_000 + i64::from(k) * 1_000_000_000 / 60,
        voltage_pu: 1.0 - 0.2 * x,
        angle_rad: 0.5 - x,
        frequency_hz: 60.0 - 0.1 * x,
        active_pu: 0.8 - 0.1 * x,
        reactive_pu: 0.3 * x - 0.1,
        negative_sequence_ratio: f64::NAN,
        quality: Quality::GOOD,
    }
}

fn mapping(analogs: bool) -> LoadMapping {
    let set = |name: &str| PhasorSet::PositiveSequence(name.to_owned());
    let mut mapping = LoadMapping::new(set("V1"), set("I1"));
    if analogs {
        let power = |name: &str| AnalogPower {
            channel: name.to_owned(),
            mega_per_unit: 1.0,
        };
        mapping.power = PowerSource::Analogs {
            active: power("P_MW"),
            reactive: power("Q_MVAR"),
        };
    }
    mapping
}

#[test]
fn samples_come_back_within_single_precision() {
    for kind in [
        ConfigurationKind::Configuration2,
        ConfigurationKind::Configuration3,
    ] {
        for analogs in [false, true] {
            let mut played = Played::new(&site(), 60.0, 7).unwrap();
            let mut intake = FrameIntake::new(&site(), "pmu", &mapping(analogs));
            intake.take(&played.configuration(kind).encode().unwrap().concat());
            for sample in (0..60).map(sample) {
                let frame = played.frame(&sample).unwrap().unwrap();
                let taken = intake.take(&frame);
                let batch = &taken.batches[0];
                assert!((batch.start_ns - sample.time_ns).abs() <= 500);
                for (channel, values) in &batch.channels {
                    let (value, played) = (values[0], sample.value(*channel));
                    assert!((value - played).abs() < 2e-6 * 60.0, "{channel:?}: {value}");
                }
            }
        }
    }
}

#[test]
fn a_record_without_angles_turns_with_its_frequency() {
    let mut played = Played::new(&site(), 60.0, 7).unwrap();
    let mut intake = FrameIntake::new(&site(), "pmu", &mapping(false));
    let configuration = played.configuration(ConfigurationKind::Configuration2);
    intake.take(&configuration.encode().unwrap()[0]);
    let mut last = f64::NAN;
    for k in 0..=30 {
        let sample = Sample {
            angle_rad: f64::NAN,
            frequency_hz: 60.1,
            ..sample(k)
        };
        let taken = intake.take(&played.frame(&sample).unwrap().unwrap());
        let mut channels = taken.batches[0].channels.iter();
        last = channels.find(|(c, _)| *c == Channel::AngleRad).unwrap().1[0];
    }
    // 0.1 Hz over half a second.
    assert!((last - 0.05 * std::f64::consts::TAU).abs() < 1e-5, "{last}");
}

#[test]
fn what_may_not_be_used_is_sent_as_invalid_and_what_is_missing_not_at_all() {
    let mut played = Played::new(&site(), 60.0, 7).unwrap();
    let mut intake = FrameIntake::new(&site(), "pmu", &mapping(false));
    let configuration = played.configuration(ConfigurationKind::Configuration2);
    intake.take(&configuration.encode().unwrap()[0]);
    assert_eq!(played.frame(&Sample::missing(sample(0).time_ns)), Ok(None));
    for (quality, expected) in [
        (Quality::STALE, Quality::DATA_INVALID),
        (Quality::SPIKE, Quality::DATA_INVALID),
        (Quality::NOT_SYNCHRONISED, Quality::NOT_SYNCHRONISED),
        (
            Quality::NOT_SYNCHRONISED.with_clock(6, 1),
            Quality::NOT_SYNCHRONISED.with_clock(6, 1),
        ),
    ] {
        let sample = Sample {
            quality,
            ..sample(1)
        };
        let taken = intake.take(&played.frame(&sample).unwrap().unwrap());
        assert_eq!(taken.batches[0].quality, [expected]);
    }
}

#[test]
fn what_has_no_code_is_refused() {
    let error = Played::new(&site(), 59.94, 7).unwrap_err();
    assert_eq!(error, PlayingError::Rate { rate_fps: 59.94 });
    assert!(Played::new(&site(), 0.5, 7).is_ok());
    let odd = Site {
        nominal_hz: 16.7,
        ..site()
    };
    let error = Played::new(&odd, 50.0, 7).unwrap_err();
    assert_eq!(error, PlayingError::Nominal { nominal_hz: 16.7 });
}
