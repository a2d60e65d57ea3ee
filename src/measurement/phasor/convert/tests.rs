//! The conversion on waveforms whose phasors are known by construction.

use super::*;
use crate::measurement::phasor::Connection;

fn site() -> Site {
    Site {
        name: "test".to_owned(),
        s_base_mva: 100.0,
        v_base_kv: 110.0,
        nominal_hz: 50.0,
    }
}

/// Balanced 110 kV at `frequency_hz`, 300 A lagging by 0.5 rad, with `unbalance` of negative
/// sequence in the voltage.
fn waveforms(time_s: Vec<f64>, frequency_hz: f64, unbalance: f64) -> Waveforms {
    let wave = |peak: f64, phase: f64| -> Vec<f64> {
        let turn = TAU * frequency_hz;
        time_s
            .iter()
            .map(|t| peak * (turn * t + phase).cos())
            .collect()
    };
    let volt = 110e3 * (2.0_f64 / 3.0).sqrt();
    let step = TAU / 3.0;
    let voltage = |k: f64| {
        let negative = wave(unbalance * volt, step * k + 0.7);
        let positive = wave(volt, -step * k);
        positive.iter().zip(negative).map(|(p, n)| p + n).collect()
    };
    Waveforms {
        start_ns: 1_000_000_000,
        nominal_hz: 50.0,
        voltage_v: [0.0, 1.0, 2.0].map(voltage),
        connection: Connection::LineToGround,
        current_a: [0.0, 1.0, 2.0].map(|k| wave(300.0 * 2.0_f64.sqrt(), -step * k - 0.5)),
        time_s,
    }
}

fn uniform(rate_hz: f64, from_s: f64, seconds: f64) -> Vec<f64> {
    let count = (seconds * rate_hz).round();
    std::iter::successors(Some(0.0), |n| Some(n + 1.0))
        .take_while(|n| *n < count)
        .map(|n| from_s + n / rate_hz)
        .collect()
}

#[test]
fn balanced_waves_give_their_phasors_in_per_unit() {
    // S = sqrt(3) 110 kV 300 A = 57.1577 MVA; P = S cos 0.5, Q = S sin 0.5 on 100 MVA.
    let record = &records(
        &waveforms(uniform(1200.0, 0.0, 0.5), 50.0, 0.0),
        &site(),
        &Settings::default(),
    )
    .unwrap()[0];
    assert!((record.rate_fps - 200.0).abs() < 1e-9);
    assert_eq!(
        record.start_ns, 1_010_000_000,
        "half a cycle after the first sample"
    );
    for sample in &record.samples {
        assert!(sample.usable());
        assert!((sample.voltage_pu - 1.0).abs() < 1e-9, "{sample:?}");
        assert!((sample.active_pu - 0.571_577 * 0.5_f64.cos()).abs() < 1e-6);
        assert!((sample.reactive_pu - 0.571_577 * 0.5_f64.sin()).abs() < 1e-6);
        assert!((sample.frequency_hz - 50.0).abs() < 1e-9);
        assert!(sample.angle_rad.abs() < 1e-9);
        assert!(sample.negative_sequence_ratio < 1e-9);
    }
}

#[test]
fn off_nominal_frequency_changes_neither_magnitude_nor_power_and_turns_the_angle() {
    for frequency_hz in [47.0, 49.5, 51.0, 53.0] {
        let waves = waveforms(uniform(3200.0, 0.0, 0.6), frequency_hz, 0.0);
        let record = &records(&waves, &site(), &Settings::default()).unwrap()[0];
        let inner = &record.samples[4..record.samples.len() - 4];
        let rates = inner
            .windows(2)
            .map(|p| (p[1].angle_rad - p[0].angle_rad) / TAU * 200.0);
        assert!(
            rates
                .into_iter()
                .all(|hz| (hz - frequency_hz + 50.0).abs() < 1e-2)
        );
        for sample in inner {
            assert!(
                (sample.voltage_pu - 1.0).abs() < 2e-4,
                "{frequency_hz} {sample:?}"
            );
            assert!((sample.active_pu - 0.571_577 * 0.5_f64.cos()).abs() < 2e-4);
            assert!(
                (sample.frequency_hz - frequency_hz).abs() < 2e-3,
                "{sample:?}"
            );
        }
    }
}

#[test]
fn negative_sequence_is_kept_apart_from_the_positive_one() {
    let waves = waveforms(uniform(1000.0, 0.0, 0.3), 50.0, 0.2);
    let record = &records(&waves, &site(), &Settings::default()).unwrap()[0];
    for sample in &record.samples {
        assert!((sample.voltage_pu - 1.0).abs() < 1e-9);
        assert!((sample.negative_sequence_ratio - 0.2).abs() < 1e-9);
    }
}

#[test]
fn voltages_between_phases_give_the_same_phasors() {
    let mut waves = waveforms(uniform(1200.0, 0.0, 0.3), 50.0, 0.1);
    let [a, b, c] = waves.voltage_v.clone();
    let minus = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x - y).collect();
    let ground = records(&waves, &site(), &Settings::default()).unwrap();
    waves.voltage_v = [minus(&a, &b), minus(&b, &c), minus(&c, &a)];
    waves.connection = Connection::LineToLine;
    let line = records(&waves, &site(), &Settings::default()).unwrap();
    for (x, y) in ground[0].samples.iter().zip(&line[0].samples) {
        assert!((x.voltage_pu - y.voltage_pu).abs() < 1e-9);
        assert!((x.angle_rad - y.angle_rad).abs() < 1e-9);
        assert!((x.reactive_pu - y.reactive_pu).abs() < 1e-9);
        assert!((x.negative_sequence_ratio - y.negative_sequence_ratio).abs() < 1e-9);
    }
}

#[test]
fn slow_piece_between_fast_ones_is_missing_and_the_grid_goes_on() {
    let mut time_s = uniform(3200.0, 0.0, 0.4);
    time_s.extend(uniform(50.0, 0.4, 0.72));
    time_s.extend(uniform(3200.0, 1.12, 0.46));
    let parts = records(&waveforms(time_s, 50.0, 0.0), &site(), &Settings::default()).unwrap();
    assert_eq!(parts.len(), 2);
    let joined = join(&parts).unwrap();
    let missing = joined.count_flagged(Quality::MISSING);
    assert!(
        (145..=150).contains(&missing),
        "{missing} of 0.74 s at 200 per second"
    );
    assert!(
        joined
            .samples
            .iter()
            .filter(|s| s.usable())
            .all(|s| s.angle_rad.abs() < 1e-9)
    );
    let last = joined.samples.len() - 1;
    assert_eq!(
        joined.samples[last].time_ns,
        parts[1].time_ns(parts[1].samples.len() - 1)
    );
}

#[test]
fn missing_sample_marks_the_phasors_over_it() {
    let mut waves = waveforms(uniform(1000.0, 0.0, 0.3), 50.0, 0.0);
    waves.current_a[1][150] = f64::NAN;
    let record = &records(&waves, &site(), &Settings::default()).unwrap()[0];
    assert_eq!(
        record.count_flagged(Quality::NOT_FINITE),
        5,
        "20 ms at 200 per second"
    );
}

#[test]
fn effective_values_are_refused_as_waveforms() {
    let waves = waveforms(uniform(200.0, 0.0, 2.0), 50.0, 0.0);
    let error = records(&waves, &site(), &Settings::default()).unwrap_err();
    assert!(matches!(error, Error::NoWaveform { .. }), "{error}");
}

#[test]
fn dead_bus_has_no_frequency() {
    let mut waves = waveforms(uniform(1000.0, 0.0, 0.3), 50.0, 0.0);
    waves.voltage_v = [0, 1, 2].map(|_| vec![0.0; waves.time_s.len()]);
    let record = &records(&waves, &site(), &Settings::default()).unwrap()[0];
    assert!(
        record
            .samples
            .iter()
            .all(|s| s.frequency_hz.is_nan() && !s.usable())
    );
}
