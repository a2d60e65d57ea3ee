//! Facts about the motor that need no reference trajectory.

use super::*;
use crate::numerics::Dual;

const AN_ORDINARY_MOTOR: MotorCoordinates<f64> = MotorCoordinates {
    alpha_per_s: 35.0,
    nu_per_s2: 1300.0,
    kappa: 0.36,
};

/// A dip to `depth` between 0.5 s and 0.6 s with a phase jump, 60 samples per second.
fn dip(depth: f64) -> TerminalInput {
    let (points, samples) = (16, 180);
    let phasor = |i: usize| {
        let t = i as f64 / (points as f64 * 60.0);
        let inside = (0.5..0.6).contains(&t);
        let (v, angle) = if inside {
            (depth, -0.2_f64)
        } else {
            (1.0, 0.0)
        };
        [v * angle.cos(), v * angle.sin()]
    };
    let grid: Vec<_> = (0..=(samples - 1) * points).map(phasor).collect();
    TerminalInput {
        real: grid.iter().map(|u| u[0]).collect(),
        imaginary: grid.iter().map(|u| u[1]).collect(),
        points_per_sample: points,
        sample_interval_s: 1.0 / 60.0,
        jumps: vec![true; samples - 1],
        dense: vec![false; samples - 1],
        synchronous_speed_rad_s: 376.99,
    }
}

#[test]
fn undisturbed_terminal_leaves_every_state_at_rest() {
    let mut out = MotorOutput::default();
    AN_ORDINARY_MOTOR.simulate(&dip(1.0), &mut out).unwrap();
    // Only the 0.1 s with a phase jump moves it; before that it is at rest to rounding.
    assert!(out.active[..30].iter().all(|p| (p - 1.0).abs() < 1e-12));
}

#[test]
fn steady_state_agrees_with_the_polar_formulas_of_the_paper() {
    // x = 3.1, x' = 0.2, by hand: sin(2 delta) = -2*3.1*0.2/2.9 = -0.427586,
    // delta = -0.220896; E' = 2.9/3.1 cos(delta) = 0.912743 ; w = E' e^(j delta) * 3.1/2.9.
    let kappa = 2.0 * 3.1 * 0.2 / 2.9;
    let at = MotorCoordinates {
        kappa,
        ..AN_ORDINARY_MOTOR
    };
    let [a0, b0, s0] = at.steady_state().unwrap();
    let delta = -0.5 * kappa.asin();
    assert!((a0 - delta.cos() * delta.cos()).abs() < 1e-12);
    assert!((b0 - delta.cos() * delta.sin()).abs() < 1e-12);
    assert!((s0 - at.alpha_per_s * delta.tan()).abs() < 1e-9);
}

#[test]
fn an_overloaded_motor_has_no_steady_state() {
    let at = MotorCoordinates {
        kappa: 1.2,
        ..AN_ORDINARY_MOTOR
    };
    let error = at.steady_state().unwrap_err();
    assert!((error.violation - 0.2).abs() < 1e-12);
    assert!(
        MotorCoordinates {
            kappa: f64::NAN,
            ..at
        }
        .steady_state()
        .is_err()
    );
}

#[test]
fn sensitivities_agree_with_differences() {
    let input = dip(0.6);
    let (alpha, nu, kappa) = (35.0_f64, 1300.0_f64, 0.36_f64);
    let at = MotorCoordinates {
        alpha_per_s: Dual::<3>::variable(alpha.ln(), 0).exp(),
        nu_per_s2: Dual::<3>::variable(nu.ln(), 1).exp(),
        kappa: Dual::<3>::variable(kappa, 2),
    };
    let mut exact = MotorOutput::default();
    at.simulate(&input, &mut exact).unwrap();
    let run = |d: [f64; 3]| {
        let mut out = MotorOutput::default();
        MotorCoordinates {
            alpha_per_s: (alpha.ln() + d[0]).exp(),
            nu_per_s2: (nu.ln() + d[1]).exp(),
            kappa: kappa + d[2],
        }
        .simulate(&input, &mut out)
        .unwrap();
        out
    };
    for i in 0..3 {
        let h = 1e-5;
        let mut step = [0.0; 3];
        step[i] = h;
        let (plus, minus) = (run(step), run(step.map(|x| -x)));
        for k in 0..exact.active.len() {
            let p = (plus.active[k] - minus.active[k]) / (2.0 * h);
            let q = (plus.reactive[k] - minus.reactive[k]) / (2.0 * h);
            // h^2 times third derivatives of order 10.
            assert!((exact.active[k].derivatives[i] - p).abs() < 1e-6);
            assert!((exact.reactive[k].derivatives[i] - q).abs() < 1e-6);
        }
    }
}

/// M, T0', X, X', Kpm of the rows of the reference paper's Table 1.
const TABLE_1: [[f64; 5]; 9] = [
    [0.0015, 0.1963, 1.2901, 0.1228, 0.5024],
    [0.0024, 1.0852, 1.9606, 0.3837, 0.2102],
    [4.7646, 1.2844, 3.9603, 0.1022, 0.1000],
    [0.0016, 0.0402, 0.1434, 0.0700, 0.4998],
    [0.0015, 0.2524, 1.6960, 0.1256, 0.5024],
    [0.0010, 0.1294, 1.3634, 0.1243, 0.5449],
    [0.0015, 0.2702, 1.8553, 0.1261, 0.5049],
    [0.0015, 0.2331, 2.9249, 0.0990, 0.6469],
    [0.0018, 0.4246, 2.5739, 0.1261, 0.4907],
];

/// A dip of 30 % that comes and goes within 0.2 s, without jumps.
fn smooth_dip(rate_fps: usize) -> TerminalInput {
    let (points, samples) = (32, 2 * rate_fps + 1);
    let voltage = |i: usize| {
        let t = i as f64 / (points * rate_fps) as f64 - 0.5;
        if (0.0..0.2).contains(&t) {
            1.0 - 0.3 * (std::f64::consts::PI * t / 0.2).sin().powi(2)
        } else {
            1.0
        }
    };
    let real: Vec<f64> = (0..=(samples - 1) * points).map(voltage).collect();
    TerminalInput {
        imaginary: vec![0.0; real.len()],
        real,
        points_per_sample: points,
        sample_interval_s: 1.0 / rate_fps as f64,
        jumps: vec![false; samples - 1],
        dense: vec![false; samples - 1],
        synchronous_speed_rad_s: 376.99,
    }
}

#[test]
fn steps_are_short_enough_for_the_motors_of_table_1() {
    const FINER: usize = 16;
    let (coarse, fine) = (smooth_dip(60), smooth_dip(60 * FINER));
    let mut worst = 0.0_f64;
    for [m, t0, x, x_prime, kpm] in TABLE_1 {
        let g = (1.0 / x_prime - 1.0 / x) / kpm;
        let motor = MotorCoordinates {
            alpha_per_s: x / (x_prime * t0),
            nu_per_s2: g * kpm / m,
            kappa: 2.0 / g,
        };
        let (mut by_sample, mut exact) = (MotorOutput::default(), MotorOutput::default());
        motor.simulate(&coarse, &mut by_sample).unwrap();
        motor.simulate(&fine, &mut exact).unwrap();
        for k in 0..by_sample.active.len() {
            let p = (by_sample.active[k] - exact.active[FINER * k]).abs();
            let q = (by_sample.reactive[k] - exact.reactive[FINER * k]).abs();
            worst = worst.max(p).max(q);
        }
    }
    assert!(
        worst < 1e-7,
        "largest difference to a sixteen times finer input: {worst:e}"
    );
}

#[test]
fn dense_intervals_give_the_same_output_at_the_samples_and_more_between() {
    let plain = smooth_dip(60);
    let mut dense = plain.clone();
    for k in 30..40 {
        dense.dense[k] = true;
    }
    let (mut few, mut many) = (MotorOutput::default(), MotorOutput::default());
    AN_ORDINARY_MOTOR.simulate(&plain, &mut few).unwrap();
    AN_ORDINARY_MOTOR.simulate(&dense, &mut many).unwrap();
    let points = dense.output_points();
    assert_eq!(many.active.len(), dense.output_count());
    assert_eq!(points.len(), dense.output_count());
    for (point, active) in points.iter().zip(&many.active) {
        if point.is_multiple_of(dense.points_per_sample) {
            let sample = point / dense.points_per_sample;
            assert!((active - few.active[sample]).abs() < 1e-8);
        }
    }
}

#[test]
fn a_dip_that_stalls_the_rotor_stays_finite_and_stands_still() {
    let heavy = MotorCoordinates {
        alpha_per_s: 35.0,
        nu_per_s2: 40_000.0,
        kappa: 0.95,
    };
    let mut out = MotorOutput::default();
    heavy.simulate(&dip(0.05), &mut out).unwrap();
    assert!(
        out.active
            .iter()
            .chain(&out.reactive)
            .all(|x| x.is_finite())
    );
}

#[test]
fn sensitivities_of_fast_motors_agree_with_differences() {
    // Through the implicit method, and through stall and standstill.
    let motors = [(20_000.0_f64, 50_000.0_f64, 0.4_f64), (35.0, 20_000.0, 0.9)];
    for (alpha, nu, kappa) in motors {
        let input = dip(0.3);
        let at = MotorCoordinates {
            alpha_per_s: Dual::<3>::variable(alpha.ln(), 0).exp(),
            nu_per_s2: Dual::<3>::variable(nu.ln(), 1).exp(),
            kappa: Dual::<3>::variable(kappa, 2),
        };
        let mut exact = MotorOutput::default();
        at.simulate(&input, &mut exact).unwrap();
        let run = |d: [f64; 3]| {
            let mut out = MotorOutput::default();
            MotorCoordinates {
                alpha_per_s: (alpha.ln() + d[0]).exp(),
                nu_per_s2: (nu.ln() + d[1]).exp(),
                kappa: kappa + d[2],
            }
            .simulate_to(0.1, &input, &mut out)
            .unwrap();
            out
        };
        for i in 0..3 {
            let h = 1e-5;
            let mut step = [0.0; 3];
            step[i] = h;
            let (plus, minus) = (run(step), run(step.map(|x| -x)));
            let slopes: Vec<_> = plus
                .active
                .iter()
                .zip(&minus.active)
                .map(|(p, m)| (p - m) / (2.0 * h))
                .collect();
            let size = slopes.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
            for (k, slope) in slopes.iter().enumerate() {
                let difference = (exact.active[k].derivatives[i] - slope).abs();
                assert!(
                    difference < 1e-4 * size,
                    "{i} {k}: {difference:e} of {size:e}"
                );
            }
        }
    }
}

#[test]
fn the_value_of_a_run_with_sensitivities_has_the_bits_of_the_plain_run() {
    let input = dip(0.4);
    for (alpha, nu, kappa) in [(35.0, 1300.0, 0.36), (9000.0, 1e5, 0.5), (35.0, 4e4, 0.95)] {
        let plain = MotorCoordinates {
            alpha_per_s: alpha,
            nu_per_s2: nu,
            kappa,
        };
        let dual = MotorCoordinates {
            alpha_per_s: Dual::<3>::variable(alpha, 0),
            nu_per_s2: Dual::<3>::variable(nu, 1),
            kappa: Dual::<3>::variable(kappa, 2),
        };
        let (mut values, mut duals) = (MotorOutput::default(), MotorOutput::default());
        plain.simulate(&input, &mut values).unwrap();
        dual.simulate(&input, &mut duals).unwrap();
        for (v, d) in values.reactive.iter().zip(&duals.reactive) {
            assert_eq!(v.to_bits(), d.value.to_bits());
        }
    }
}

#[test]
fn a_stalled_rotor_neither_turns_backwards_nor_stays_when_the_torque_returns() {
    // At standstill the flux follows dw/dt = -(alpha + j w0) w + alpha u: within 0.3 s it has settled at
    // alpha u / (alpha + j w0), and q = G (|u|^2 - Re(u conj w)) with G = 2 / kappa.
    let motor = MotorCoordinates {
        alpha_per_s: 35.0,
        nu_per_s2: 40_000.0,
        kappa: 0.95,
    };
    let mut input = dip(0.05);
    let low = input.real.iter().position(|re| *re < 0.5).unwrap();
    for (re, im) in input.real[low..]
        .iter_mut()
        .zip(&mut input.imaginary[low..])
    {
        (*re, *im) = (0.05, 0.0);
    }
    let mut out = MotorOutput::default();
    motor.simulate(&input, &mut out).unwrap();
    let (v, rate, w0) = (0.05, 35.0, input.synchronous_speed_rad_s);
    let real = rate * rate * v / (rate * rate + w0 * w0);
    let settled = 2.0 / 0.95 * (v * v - v * real);
    let last = out.reactive.last().unwrap();
    assert!((last - settled).abs() < 1e-8, "{last} against {settled}");

    // A light load and a dip to nothing: the rotor stops and runs up again.
    let light = MotorCoordinates {
        alpha_per_s: 100.0,
        nu_per_s2: 40_000.0,
        kappa: 0.15,
    };
    light.simulate(&dip(0.0), &mut out).unwrap();
    let last = out.active.last().unwrap();
    assert!((last - 1.0).abs() < 1e-3, "back at rest: {last}");
}

#[test]
fn a_motor_with_more_slip_than_one_stays_at_rest_undisturbed() {
    let nonsense = MotorCoordinates {
        alpha_per_s: 5e4,
        nu_per_s2: 1300.0,
        kappa: 0.5,
    };
    let mut out = MotorOutput::default();
    nonsense.simulate(&dip(1.0), &mut out).unwrap();
    assert!(out.active[..30].iter().all(|p| (p - 1.0).abs() < 1e-9));
}

#[test]
fn an_input_that_is_not_a_number_ends_in_numbers_that_are_not() {
    let mut input = dip(0.5);
    input.real[1000] = f64::NAN;
    let mut out = MotorOutput::default();
    AN_ORDINARY_MOTOR.simulate(&input, &mut out).unwrap();
    assert!(out.active[10].is_finite());
    assert!(out.active.last().unwrap().is_nan());
}
