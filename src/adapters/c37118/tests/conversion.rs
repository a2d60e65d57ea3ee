//! From data frames to samples: values against a hand calculation, quality, time, mapping errors.

use super::fixture::{configuration, data, formats};
use crate::{
    adapters::c37118::{
        AnalogPower, Configuration, ConfigurationKind, Converter, DataFrame, FloatFrequency,
        Format, LoadMapping, Number, Phasor, PhasorScaling, PhasorSet, PmuChoice, PowerSource,
        SampleRefusal, SignedSet, Status, TimeQuality, batches,
    },
    measurement::{Channel, Quality, Sample, SampleBatch, Site, phasor::Connection},
};

fn site() -> Site {
    Site {
        name: "north".to_owned(),
        s_base_mva: 30.0,
        v_base_kv: 20.0 * 3.0_f64.sqrt(),
        nominal_hz: 50.0,
    }
}

fn phases(letter: &str) -> PhasorSet {
    PhasorSet::Phases(["A", "B", "C"].map(|phase| format!("{letter}{phase}")))
}

fn mapping() -> LoadMapping {
    LoadMapping::new(phases("V"), phases("I"))
}

fn convert(
    configuration: &Configuration,
    mapping: &LoadMapping,
    frame: &DataFrame,
) -> Result<Sample, SampleRefusal> {
    let converter = Converter::new(configuration, mapping, &site()).unwrap();
    converter.sample(frame)
}

/// 20 kV at 0.3 rad and 500 A at 0.1 rad: V = 1 pu, P + jQ = 3 * 20 kV * 500 A / 30 MVA * exp(0.2j)
/// = exp(0.2j).
fn assert_reference(sample: &Sample, tolerance: f64) {
    let expected = [
        (Channel::VoltagePu, 1.0),
        (Channel::AngleRad, 0.3),
        (Channel::FrequencyHz, 50.1),
        (Channel::ActivePu, 0.2_f64.cos()),
        (Channel::ReactivePu, 0.2_f64.sin()),
    ];
    for (channel, expected) in expected {
        let found = sample.value(channel);
        assert!((found - expected).abs() < tolerance, "{channel:?} {found}");
    }
    assert_eq!(sample.time_ns, 1_700_000_000_500_000_000);
}

#[test]
fn every_format_and_kind_gives_the_hand_calculated_sample() {
    for kind in [
        ConfigurationKind::Configuration2,
        ConfigurationKind::Configuration3,
    ] {
        for format in formats() {
            // Integer steps are 1e-4 of the voltage and 1e-4 rad.
            let tolerance = if format.phasors_float() { 2e-6 } else { 3e-4 };
            let stream = configuration(kind, &[format]);
            let frame = data(&stream);
            let sample = convert(&stream, &mapping(), &frame).unwrap();
            assert_reference(&sample, tolerance);
            assert!(sample.negative_sequence_ratio < tolerance);
            assert!(sample.usable());
            let mut given = mapping();
            given.voltage = PhasorSet::PositiveSequence("V1".to_owned());
            let sample = convert(&stream, &given, &frame).unwrap();
            assert_reference(&sample, tolerance);
            assert!(sample.negative_sequence_ratio.is_nan() && sample.usable());
        }
    }
}

#[test]
fn scale_factors_and_angle_of_a_cfg_3_are_applied_to_floating_point_too() {
    let mut stream = configuration(ConfigurationKind::Configuration3, &[Format(15)]);
    for channel in &mut stream.pmus[0].phasors {
        if let PhasorScaling::Affine {
            factor, angle_rad, ..
        } = &mut channel.scaling
        {
            *factor = 2.0;
            *angle_rad = 0.25;
        }
    }
    let sample = convert(&stream, &mapping(), &data(&stream)).unwrap();
    assert!((sample.voltage_pu - 2.0).abs() < 1e-6);
    assert!((sample.angle_rad - 0.05).abs() < 1e-6);
    assert!((sample.active_pu - 4.0 * 0.2_f64.cos()).abs() < 1e-5);
}

#[test]
fn power_comes_from_analog_values_and_from_reversed_currents_where_mapped() {
    let mut analog = mapping();
    let channel = |name: &str| AnalogPower {
        channel: name.to_owned(),
        mega_per_unit: 0.3,
    };
    analog.power = PowerSource::Analogs {
        active: channel("P"),
        reactive: channel("#2"),
    };
    let stream = configuration(ConfigurationKind::Configuration2, &[Format(5)]);
    let sample = convert(&stream, &analog, &data(&stream)).unwrap();
    // 100 * 0.3 MW on 30 MVA, and -40 * 0.3.
    assert!((sample.active_pu - 1.0).abs() < 1e-12);
    assert!((sample.reactive_pu + 0.4).abs() < 1e-12);
    let stream = configuration(ConfigurationKind::Configuration3, &[Format(5)]);
    let sample = convert(&stream, &analog, &data(&stream)).unwrap();
    // 0.5 * 100 + 1 = 51.
    assert!((sample.active_pu - 0.51).abs() < 1e-12);
    let set = |reversed| SignedSet {
        phasors: phases("I"),
        reversed,
    };
    let mut sum = mapping();
    sum.power = PowerSource::Currents(vec![set(true), set(true), set(false)]);
    sum.current_ratio = 2.0;
    let sample = convert(&stream, &sum, &data(&stream)).unwrap();
    assert!((sample.active_pu + 2.0 * 0.2_f64.cos()).abs() < 1e-3);
}

#[test]
fn voltages_between_phases_are_turned_and_divided() {
    let stream = configuration(ConfigurationKind::Configuration2, &[Format(15)]);
    let mut between = mapping();
    between.connection = Connection::LineToLine;
    let sample = convert(&stream, &between, &data(&stream)).unwrap();
    assert!((sample.voltage_pu - 1.0 / 3.0_f64.sqrt()).abs() < 1e-6);
    assert!((sample.angle_rad - (0.3 - std::f64::consts::FRAC_PI_6)).abs() < 1e-6);
}

#[test]
fn unbalanced_voltages_show_as_negative_sequence() {
    let stream = configuration(ConfigurationKind::Configuration2, &[Format(15)]);
    let mut frame = data(&stream);
    if let Phasor::PolarFloat { magnitude, .. } = &mut frame.pmus[0].phasors[0] {
        *magnitude *= 0.7;
    }
    let sample = convert(&stream, &mapping(), &frame).unwrap();
    // V1 = (0.7 + 1 + 1) / 3 = 0.9, V2 = -0.3 / 3.
    assert!((sample.voltage_pu - 0.9).abs() < 1e-6);
    assert!((sample.negative_sequence_ratio - 0.1 / 0.9).abs() < 1e-6);
}

#[test]
fn status_and_absent_numbers_become_quality() {
    let stream = configuration(ConfigurationKind::Configuration2, &[Format(0)]);
    let mut frame = data(&stream);
    frame.pmus[0].status = Status(0x8000);
    let sample = convert(&stream, &mapping(), &frame).unwrap();
    assert!(sample.quality.contains(Quality::DATA_INVALID) && !sample.usable());
    frame.pmus[0].status = Status(0x2830);
    frame.prefix.time.quality = TimeQuality(0x0f);
    let sample = convert(&stream, &mapping(), &frame).unwrap();
    assert!(sample.quality.contains(Quality::NOT_SYNCHRONISED) && sample.usable());
    frame.pmus[0].status = Status(0);
    frame.pmus[0].phasors[1] = Phasor::RectangularInteger {
        re: i16::MIN,
        im: i16::MIN,
    };
    let sample = convert(&stream, &mapping(), &frame).unwrap();
    assert!(sample.voltage_pu.is_nan() && sample.quality.contains(Quality::NOT_FINITE));
    let mut frame = data(&stream);
    frame.pmus[0].frequency = Number::Integer(i16::MIN);
    let sample = convert(&stream, &mapping(), &frame).unwrap();
    assert!(sample.frequency_hz.is_nan() && sample.quality.contains(Quality::NOT_FINITE));
}

#[test]
fn deviation_in_a_floating_point_frequency_has_to_be_mapped() {
    let stream = configuration(ConfigurationKind::Configuration2, &[Format(15)]);
    let mut frame = data(&stream);
    frame.pmus[0].frequency = Number::Float(100.0);
    let sample = convert(&stream, &mapping(), &frame).unwrap();
    assert!(!sample.usable(), "100 Hz is no frequency of a 50 Hz grid");
    let mut deviation = mapping();
    deviation.float_frequency = FloatFrequency::DeviationMillihertz;
    let sample = convert(&stream, &deviation, &frame).unwrap();
    assert!((sample.frequency_hz - 50.1).abs() < 1e-12);
}

#[test]
fn frame_without_a_time_gives_no_sample() {
    let stream = configuration(ConfigurationKind::Configuration2, &[Format(15)]);
    let mut frame = data(&stream);
    frame.prefix.time.fraction = stream.time_base;
    let refusal = convert(&stream, &mapping(), &frame).unwrap_err();
    assert!(matches!(refusal, SampleRefusal::Fraction { .. }));
    frame.prefix.time.seconds = 1_483_228_800;
    frame.prefix.time.quality = TimeQuality(0x10);
    let refusal = convert(&stream, &mapping(), &frame).unwrap_err();
    assert!(matches!(refusal, SampleRefusal::LeapSecond { .. }));
}

#[test]
fn what_the_stream_does_not_hold_is_named() {
    let stream = configuration(ConfigurationKind::Configuration2, &[Format(0), Format(15)]);
    let message = |mapping: &LoadMapping| {
        let converter = Converter::new(&stream, mapping, &site());
        converter.unwrap_err().to_string()
    };
    let mut wrong = mapping();
    assert_eq!(
        message(&wrong),
        "2 PMUs of the stream are its only one; it holds 1 (Load bus 1), 2 (Load bus 2)"
    );
    wrong.pmu = PmuChoice::Station("Load bus 2".to_owned());
    wrong.voltage = PhasorSet::PositiveSequence("V2".to_owned());
    let present = "`VA`, `VB`, `VC`, `IA`, `IB`, `IC`, `V1`";
    assert_eq!(
        message(&wrong),
        format!("0 phasor channels of the PMU are called `V2`; it has {present}")
    );
    wrong.voltage = phases("I");
    assert_eq!(message(&wrong), "phasor `IA` is no voltage");
    wrong.voltage = phases("V");
    wrong.current_ratio = 0.0;
    assert!(message(&wrong).contains("current ratio of 0"));
    let mut site = site();
    site.nominal_hz = 60.0;
    wrong.current_ratio = 1.0;
    let error = Converter::new(&stream, &wrong, &site).unwrap_err();
    assert!(error.to_string().contains("50 Hz, the site's 60 Hz"));
}

#[test]
fn samples_become_batches_that_end_at_gaps() {
    let stream = configuration(ConfigurationKind::Configuration2, &[Format(15)]);
    let converter = Converter::new(&stream, &mapping(), &site()).unwrap();
    let frame = data(&stream);
    let samples: Vec<Sample> = [0, 1, 2, 5, 6]
        .iter()
        .map(|step| {
            let mut frame = frame.clone();
            // One microsecond of rounding, as sources do.
            frame.prefix.time.fraction = 20_000 * step + 1;
            converter.sample(&frame).unwrap()
        })
        .collect();
    let batches = batches(&converter, &samples, &site(), "pmu-1");
    let lengths: Vec<usize> = batches.iter().map(SampleBatch::len).collect();
    assert_eq!(lengths, [3, 2]);
    assert_eq!(batches[1].start_ns, samples[3].time_ns);
    assert_eq!(batches[0].channels.len(), 6);
    assert!((batches[0].rate_fps - 50.0).abs() < 1e-12);
}
