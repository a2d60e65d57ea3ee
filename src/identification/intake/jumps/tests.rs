//! Jumps made by brute force, and one of the truth simulator, are found again.

use super::*;
use std::f64::consts::PI;

/// A dip with phase jumps between two instants (seconds) that settles exponentially, through
/// a window of this half width and shape, by brute force.
fn record(rate_fps: f64, filter: PhasorFilter, (begin_s, end_s): (f64, f64)) -> Vec<Log> {
    let half_s = filter.half_width_cycles() / 60.0;
    let phasor = |t: f64| {
        if t < begin_s {
            Log::new(0.0, 0.0).exp()
        } else if t < end_s {
            let settling = 0.05 * (-(t - begin_s) / 0.03).exp();
            Log::new(-0.4 - settling, -0.08 + 0.5 * (t - begin_s)).exp()
        } else {
            let settling = 0.04 * (-(t - end_s) / 0.05).exp();
            Log::new(-0.01 - settling, 0.03).exp()
        }
    };
    (0..400)
        .map(|k| f64::from(k) / rate_fps)
        .take_while(|t| *t < 2.0)
        .map(|t| {
            if half_s == 0.0 {
                return phasor(t).ln();
            }
            let (mut sum, mut total) = (Log::new(0.0, 0.0), 0.0);
            for i in -2000..2000 {
                let offset = (f64::from(i) + 0.5) / 2000.0;
                let weight = filter.weight(offset);
                sum += phasor(t + offset * half_s) * weight;
                total += weight;
            }
            (sum / total).ln()
        })
        .collect()
}

fn series(rate_fps: f64, log: &[Log]) -> Series {
    let n = log.len();
    Series {
        rate_fps,
        nominal_hz: 60.0,
        voltage: log.iter().map(|l| l.re.exp()).collect(),
        angle: log.iter().map(|l| l.im).collect(),
        frequency_hz: vec![60.0; n],
        active: vec![1.0; n],
        reactive: vec![0.3; n],
        bad: vec![false; n],
    }
}

fn found(rate_fps: f64, filter: PhasorFilter, instants: (f64, f64), bad: &[usize]) -> Found {
    let log = record(rate_fps, filter, instants);
    let mut series = series(rate_fps, &log);
    for &k in bad {
        series.bad[k] = true;
    }
    let steep = crate::identification::intake::edges::steps_at_edges(&series, 0);
    find(&series, &log, &steep, 2e-4, FilterChoice::Auto)
}

#[test]
fn instants_and_shape_of_filtered_jumps_are_found_at_every_usual_rate() {
    for filter in [PhasorFilter::PClass, PhasorFilter::OneCycle] {
        for rate in [60.0, 100.0, 120.0, 200.0, 240.0] {
            let instants = (0.906_1, 0.990_7);
            let found = found(rate, filter, instants, &[]);
            assert_eq!(found.filter, Some(filter), "{rate} frames/s");
            assert_eq!(found.jumps.len(), 2, "{rate} frames/s");
            for ((jump, _), instant) in found.jumps.iter().zip([instants.0, instants.1]) {
                let late_s = jump.position / rate - instant;
                // A settling of 5 % within 30 ms is not a parabola over 17 ms samples.
                assert!(late_s.abs() < 5e-4, "{rate} frames/s: {late_s} s");
            }
        }
    }
}

#[test]
fn both_jumps_of_a_dip_of_three_samples_are_found() {
    let instants = (0.906_1, 0.990_7);
    let found = found(30.0, PhasorFilter::PClass, instants, &[]);
    assert_eq!(found.jumps.len(), 2);
    for ((jump, _), instant) in found.jumps.iter().zip([instants.0, instants.1]) {
        let late = jump.position - 30.0 * instant;
        assert!(late.abs() < 0.4, "{late} samples");
    }
}

/// A fault of five cycles at 30 frames/s with noise, made by the truth simulator: |V| and angle; the fault begins
/// at 10.47 and ends at 12.97 samples. No sample holds much of its beginning, and the voltage recovers after it.
const SHORT_FAULT: [(f64, f64); 30] = [
    (0.99027, -0.31950),
    (0.99069, -0.32026),
    (0.98982, -0.31929),
    (0.99075, -0.32023),
    (0.99058, -0.32132),
    (0.99108, -0.32027),
    (0.98993, -0.31990),
    (0.99056, -0.31945),
    (0.99077, -0.32000),
    (0.99019, -0.31970),
    (0.98943, -0.31975),
    (0.57742, -0.33080),
    (0.53237, -0.33963),
    (0.71066, -0.32888),
    (0.91525, -0.32984),
    (0.94031, -0.33150),
    (0.95936, -0.31753),
    (0.97451, -0.30493),
    (0.98487, -0.30095),
    (0.99008, -0.30517),
    (0.99078, -0.31381),
    (0.98987, -0.32079),
    (0.98869, -0.32722),
    (0.98853, -0.33097),
    (0.98898, -0.33352),
    (0.98913, -0.33321),
    (0.98885, -0.33128),
    (0.98946, -0.32734),
    (0.98956, -0.32148),
    (0.98933, -0.31692),
];

#[test]
fn instants_of_a_dip_of_two_samples_are_sought_together_and_its_recovery_is_no_jump() {
    let log: Vec<Log> = (SHORT_FAULT.iter())
        .map(|(voltage, angle)| Log::new(voltage.ln(), *angle))
        .collect();
    let series = series(30.0, &log);
    let steep = crate::identification::intake::edges::steps_at_edges(&series, 0);
    let found = find(&series, &log, &steep, 4e-4, FilterChoice::Auto);
    let positions: Vec<f64> = found.jumps.iter().map(|j| j.1.position).collect();
    assert_eq!(positions.len(), 2, "{positions:?}");
    for (position, instant) in positions.iter().zip([10.47, 12.97]) {
        assert!((position - instant).abs() < 0.4, "{positions:?}");
    }
}

/// A fault of fifteen cycles at 30 frames/s with 0.1 % noise, made by RAMSES: |V| and angle; the fault begins at 10.49
/// and ends at 17.99 samples, and the machines swing so fast that steps within and after it stand out.
const LONG_FAULT: [(f64, f64); 32] = [
    (1.00678, -0.29741),
    (1.00536, -0.29936),
    (1.00570, -0.29728),
    (1.00581, -0.29793),
    (1.00637, -0.29774),
    (1.00569, -0.29720),
    (1.00556, -0.29798),
    (1.00762, -0.29679),
    (1.00644, -0.29814),
    (1.00588, -0.29711),
    (1.00644, -0.29827),
    (0.78027, -0.30190),
    (0.72070, -0.27231),
    (0.68822, -0.23346),
    (0.66865, -0.18898),
    (0.65610, -0.13129),
    (0.64791, -0.06434),
    (0.64185, 0.01645),
    (0.72486, 0.12146),
    (0.87669, 0.21202),
    (0.92727, 0.28443),
    (0.96798, 0.36693),
    (1.00308, 0.45464),
    (1.03663, 0.54292),
    (1.06167, 0.61931),
    (1.08136, 0.69179),
    (1.09008, 0.75302),
    (1.09620, 0.80989),
    (1.09756, 0.86110),
    (1.09845, 0.90930),
    (1.09812, 0.95490),
    (1.09422, 0.99975),
];

#[test]
fn a_swing_at_a_low_rate_is_no_jump() {
    let log: Vec<Log> = (LONG_FAULT.iter())
        .map(|(voltage, angle)| Log::new(voltage.ln(), *angle))
        .collect();
    let series = series(30.0, &log);
    let steep = crate::identification::intake::edges::steps_at_edges(&series, 0);
    let found = find(&series, &log, &steep, 1e-3, FilterChoice::Auto);
    let positions: Vec<f64> = found.jumps.iter().map(|j| j.1.position).collect();
    assert_eq!(positions.len(), 2, "{positions:?}");
    for (position, instant) in positions.iter().zip([10.49, 17.99]) {
        assert!((position - instant).abs() < 0.3, "{positions:?}");
    }
}

#[test]
fn what_a_jump_switches_is_behind_the_filter_too() {
    let changed = |filter: PhasorFilter| -> Vec<usize> {
        let found = found(60.0, filter, (0.906_1, 0.990_7), &[]);
        let jumps: Vec<Jump> = found.jumps.iter().map(|j| j.0).collect();
        let samples = 0..found.measured.log.len();
        let changes = |k: &usize| found.measured.changes(&jumps, *k);
        samples.filter(changes).collect()
    };
    // From a window before the first jump, at 54.4 samples, to 0.2 s after the second, at 59.4.
    let expected: Vec<usize> = (53..=71).collect();
    assert_eq!(changed(PhasorFilter::PClass), expected);
    assert!(changed(PhasorFilter::None).is_empty());
}

#[test]
fn unfiltered_jumps_keep_their_instant_open() {
    let found = found(60.0, PhasorFilter::None, (0.906_1, 0.990_7), &[]);
    assert_eq!(found.filter, Some(PhasorFilter::None));
    let positions: Vec<f64> = found.jumps.iter().map(|j| j.1.position).collect();
    assert_eq!(positions, [54.5, 59.5]);
}

#[test]
fn a_missing_sample_at_a_jump_leaves_the_instant_less_certain() {
    let whole = found(60.0, PhasorFilter::PClass, (0.906_1, 0.990_7), &[]);
    let holed = found(60.0, PhasorFilter::PClass, (0.906_1, 0.990_7), &[54]);
    assert_eq!(holed.jumps.len(), 2);
    let late = holed.jumps[0].1.position - 0.906_1 * 60.0;
    assert!(late.abs() < 0.1, "{late} samples");
    assert!(holed.jumps[0].1.deviation > whole.jumps[0].1.deviation);
}

#[test]
fn a_ramp_is_no_jump_behind_a_filter() {
    // From 1 to 0.6 within 0.1 s: six steep steps in a row.
    let log: Vec<Log> = (0..120)
        .map(|k| {
            let share = ((f64::from(k) - 54.0) / 6.0).clamp(0.0, 1.0);
            Log::new((1.0 - 0.4 * share).ln(), -0.02 * PI * share)
        })
        .collect();
    let series = series(60.0, &log);
    let steep = crate::identification::intake::edges::steps_at_edges(&series, 0);
    let found = find(&series, &log, &steep, 2e-4, FilterChoice::Auto);
    assert!(found.jumps.is_empty(), "{:?}", found.jumps);
}

#[test]
fn a_flicker_is_no_row_of_jumps() {
    // One cycle's mean at 60 frames/s of a voltage that goes to and fro every 5.3 samples.
    let instant = |n: u32| 10.4 + 5.3 * f64::from(n);
    let flicker = |jumps: u32| {
        let log: Vec<Log> = (0..200)
            .map(|k| {
                let height: f64 = (0..jumps)
                    .map(|n| (f64::from(k) - instant(n) + 0.5).clamp(0.0, 1.0))
                    .zip([-0.2, 0.2].iter().cycle())
                    .map(|(share, size)| share * size)
                    .sum();
                Log::new((0.95 + height).ln(), -0.02 * height)
            })
            .collect();
        let series = series(60.0, &log);
        let steep = crate::identification::intake::edges::steps_at_edges(&series, 0);
        let one_cycle = FilterChoice::Fixed(PhasorFilter::OneCycle);
        find(&series, &log, &steep, 2e-4, one_cycle)
    };
    let few = flicker(6);
    assert_eq!(few.jumps.len(), 6);
    for (n, (jump, _)) in (0..).zip(&few.jumps) {
        let late = jump.position - instant(n);
        assert!(late.abs() < 0.1, "jump {n}: {late} samples");
    }
    let many = flicker(30);
    assert!(many.jumps.is_empty() && many.unexplained.contains(&true));
}

/// Noise of unit deviation that is the same on every machine: sums of twelve numbers of a linear congruential generator.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let uniform = |_| {
            self.0 = (self.0)
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f64 / f64::from(1 << 24)
        };
        (0..12).map(uniform).sum::<f64>() - 6.0
    }

    fn phasor(&mut self) -> Log {
        Log::new(self.next(), self.next())
    }
}

/// What is found at 60 frames/s in `log` with 0.1 % noise, of which the jumps are told.
fn found_in_noise(seed: u64, log: impl Fn(f64) -> Log) -> Found {
    let mut noise = Noise(seed);
    let log: Vec<Log> = (0..240)
        .map(|k| log(f64::from(k)) + noise.phasor() * 1e-3)
        .collect();
    let series = series(60.0, &log);
    let steep = crate::identification::intake::edges::steps_at_edges(&series, 0);
    find(&series, &log, &steep, 1e-3, FilterChoice::Auto)
}

#[test]
fn a_capacitor_that_is_switched_is_a_small_jump_wherever_the_samples_lie() {
    // The share of a jump that a triangle over two cycles shows so many samples after it.
    let shown = |after: f64| {
        let x = after.clamp(-1.0, 1.0);
        0.5 + x - 0.5 * x * x.abs()
    };
    for seed in 0..20 {
        let at = 100.0 + 0.05 * seed as f64;
        let found = found_in_noise(seed, |k| {
            // The grid goes on moving.
            Log::new(0.015, -0.004) * shown(k - at) + Log::new(0.0, -2e-4 * k)
        });
        assert_eq!(found.jumps.len(), 1, "at {at}");
        assert_eq!(found.filter, Some(PhasorFilter::PClass), "at {at}");
        let (jump, edge) = found.jumps[0];
        let late = (jump.position - at).abs();
        assert!(late < 0.3 && late < 4.0 * edge.deviation, "at {at}: {late}");
    }
}

#[test]
fn noise_and_swings_hold_no_small_jump() {
    for seed in 0..100 {
        // 0.1 rad at 1.5 Hz, and a voltage that comes back within 0.3 s.
        let swing = |k: f64| {
            let t = k / 60.0;
            let back = 0.03 * (-(t / 0.3)).exp();
            Log::new(-back, 0.1 * (2.0 * PI * 1.5 * t).sin())
        };
        assert!(found_in_noise(seed, swing).jumps.is_empty(), "seed {seed}");
    }
}
