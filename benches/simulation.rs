//! Time per simulation of the motor: alone, with sensitivities, and side by side in a batch.
//!
//! `cargo bench --bench simulation`. Every figure is the best of several repetitions, all in one run, so that
//! ratios hold on a busy machine where absolute times do not. Alongside, the classical Runge-Kutta method on
//! the same input, as the plain loop that one would write first.
#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    clippy::let_underscore_must_use,
    clippy::inline_always,
    reason = "a bench measures time and prints it"
)]

use loadmodeld::{
    load_model::{
        MotorCoordinates, MotorOutput, TerminalInput,
        induction_motor::{BatchInput, BatchSink, Effort, simulate_batch},
    },
    numerics::Dual,
};
use std::{hint::black_box, time::Instant};

const RATE_FPS: usize = 60;
const SAMPLES: usize = 600;
const POINTS: usize = 32;
const BATCH: usize = 96;

/// Ten seconds with a dip to 0.6 for 0.1 s, small swings of magnitude and angle throughout.
fn input() -> TerminalInput {
    let phasor = |i: usize| {
        let t = i as f64 / (POINTS * RATE_FPS) as f64;
        let dip = if (2.0..2.1).contains(&t) { 0.6 } else { 1.0 };
        let v = dip * (1.0 + 0.002 * (9.0 * t).sin() + 0.0005 * (47.0 * t).cos());
        let angle = 0.05 * (3.0 * t).sin();
        [v * angle.cos(), v * angle.sin()]
    };
    let grid: Vec<_> = (0..=(SAMPLES - 1) * POINTS).map(phasor).collect();
    TerminalInput {
        real: grid.iter().map(|u| u[0]).collect(),
        imaginary: grid.iter().map(|u| u[1]).collect(),
        points_per_sample: POINTS,
        sample_interval_s: 1.0 / RATE_FPS as f64,
        jumps: vec![false; SAMPLES - 1],
        dense: vec![false; SAMPLES - 1],
        synchronous_speed_rad_s: 376.99,
    }
}

fn best_us(repetitions: usize, mut work: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..repetitions {
        let start = Instant::now();
        work();
        best = best.min(start.elapsed().as_secs_f64());
    }
    best * 1e6
}

/// The classical method, as many steps per sample as divide the fine grid twice over.
fn runge_kutta(motor: &MotorCoordinates<f64>, input: &TerminalInput, steps: usize) -> f64 {
    let (alpha, nu) = (motor.alpha_per_s, motor.nu_per_s2);
    let root = (1.0 - motor.kappa * motor.kappa).sqrt();
    let load = -0.5 * motor.kappa;
    let slopes = |[a, b, s]: [f64; 3], at: usize| {
        let (re, im) = (input.real[at], input.imaginary[at]);
        [
            alpha * (re - a) - s * b,
            alpha * (im - b) + s * a,
            nu * (load - b * re + a * im),
        ]
    };
    let ahead =
        |x: [f64; 3], k: [f64; 3], h: f64| [x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2]];
    let half = input.points_per_sample / (2 * steps);
    let h = input.sample_interval_s / steps as f64;
    let a0 = 0.5 * (1.0 + root);
    let (mut x, mut sum) = ([a0, load, alpha * load / a0], 0.0);
    for at in (0..input.real.len() - 2 * half).step_by(2 * half) {
        let k1 = slopes(x, at);
        let k2 = slopes(ahead(x, k1, 0.5 * h), at + half);
        let k3 = slopes(ahead(x, k2, 0.5 * h), at + half);
        let k4 = slopes(ahead(x, k3, h), at + 2 * half);
        for i in 0..3 {
            x[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
        sum += x[1];
    }
    sum
}

/// What an objective keeps: an inner product per motor.
struct InnerProducts(Vec<f64>);

impl BatchSink for InnerProducts {
    #[inline(always)]
    fn output(&mut self, _: usize, motors: &[usize], active: &[f64], reactive: &[f64]) {
        for ((motor, p), q) in motors.iter().zip(active).zip(reactive) {
            self.0[*motor] += p * p + q * q;
        }
    }
}

fn main() {
    let input = input();
    println!("{SAMPLES} samples at {RATE_FPS} per second; microseconds per simulation\n");
    alone(&input);
    side_by_side(&input);
}

fn alone(input: &TerminalInput) {
    println!(
        "alpha, 1/s    nu, 1/s^2   kappa   exact   with 3 sensitivities   ratio   RK4, 8 steps   16 steps"
    );
    let motors = [
        (5.0, 20.0, 0.2),
        (35.0, 1300.0, 0.36),
        (100.0, 5000.0, 0.3),
        (250.0, 30_000.0, 0.5),
        (1e4, 1e5, 0.5),
    ];
    for (alpha, nu, kappa) in motors {
        let motor = MotorCoordinates {
            alpha_per_s: alpha,
            nu_per_s2: nu,
            kappa,
        };
        let dual = MotorCoordinates {
            alpha_per_s: Dual::<3>::variable(alpha, 0),
            nu_per_s2: Dual::<3>::variable(nu, 1),
            kappa: Dual::<3>::variable(kappa, 2),
        };
        let (mut out, mut sensitivities) = (MotorOutput::default(), MotorOutput::default());
        let value = best_us(50, || {
            let _ = black_box(motor.simulate(input, &mut out));
        });
        let derivatives = best_us(50, || {
            let _ = black_box(dual.simulate(input, &mut sensitivities));
        });
        let classical = [8, 16].map(|steps| {
            best_us(50, || {
                black_box(runge_kutta(&motor, input, steps));
            })
        });
        println!(
            "{alpha:10} {nu:12} {kappa:7} {value:7.1} {derivatives:22.1} {:7.2} {:14.1} {:10.1}",
            derivatives / value,
            classical[0],
            classical[1]
        );
    }
}

fn side_by_side(input: &TerminalInput) {
    let share = |i: usize, step: f64| (i as f64 * step).fract();
    let motors: Vec<_> = (0..BATCH)
        .map(|i| MotorCoordinates {
            alpha_per_s: 5.0 * 20.0_f64.powf(share(i, 0.618_034)),
            nu_per_s2: 50.0 * 80.0_f64.powf(share(i, 0.754_878)),
            kappa: 0.05 + 0.5 * share(i, 0.569_840),
        })
        .collect();
    let mut sums = InnerProducts(vec![0.0; BATCH]);
    let mut out = MotorOutput::default();
    let alone = best_us(5, || {
        for motor in &motors {
            let _ = black_box(motor.simulate(input, &mut out));
        }
    }) / BATCH as f64;
    println!("\n{BATCH} motors, alpha 5 to 100, nu 50 to 4000, kappa 0.05 to 0.55");
    println!("one by one, exact          {alone:8.2}");
    let efforts = [
        ("side by side, exact       ", Effort::Exact),
        (
            "side by side, rough       ",
            Effort::Rough { looseness: 100_000 },
        ),
        (
            "side by side, 1 fixed step",
            Effort::Fixed {
                steps_per_sample: 1,
            },
        ),
        (
            "side by side, 2 fixed     ",
            Effort::Fixed {
                steps_per_sample: 2,
            },
        ),
        (
            "side by side, 4 fixed     ",
            Effort::Fixed {
                steps_per_sample: 4,
            },
        ),
    ];
    let input = BatchInput::new(input);
    for (name, effort) in efforts {
        let batch = best_us(20, || {
            black_box(simulate_batch(&motors, &input, effort, &mut sums));
        }) / BATCH as f64;
        println!("{name} {batch:8.2}   {:5.1} times faster", alone / batch);
    }
}
