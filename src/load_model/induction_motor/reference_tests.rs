//! The simulation against trajectories computed elsewhere: the Radau method of `SciPy`, written by
//! `tests/fixtures/induction_motor_reference.py`, which also says what the cases are.

use super::*;

const REFERENCE: &str = include_str!("../../../tests/fixtures/induction_motor_reference.csv");
const SYNCHRONOUS_RAD_S: f64 = 376.99;
const COLUMNS_OF_CASE: usize = 9;

/// One line of the reference.
struct Case {
    kind: &'static str,
    motor: MotorCoordinates<f64>,
    rate_fps: usize,
    depth: f64,
    duration_s: f64,
    turn_rad: f64,
    smooth: bool,
    /// Sample, P, Q.
    answers: Vec<(usize, f64, f64)>,
}

fn cases() -> Vec<Case> {
    REFERENCE.lines().skip(1).map(case).collect()
}

fn case(line: &'static str) -> Case {
    let fields: Vec<_> = line.split(',').collect();
    let number = |i: usize| fields[i].parse::<f64>().unwrap();
    let whole = |i: usize| fields[i].parse::<usize>().unwrap();
    Case {
        kind: fields[0],
        motor: MotorCoordinates {
            alpha_per_s: number(1),
            nu_per_s2: number(2),
            kappa: number(3),
        },
        rate_fps: whole(4),
        depth: number(5),
        duration_s: number(6),
        turn_rad: number(7),
        smooth: whole(8) == 1,
        answers: (COLUMNS_OF_CASE..fields.len())
            .step_by(3)
            .map(|i| (whole(i), number(i + 1), number(i + 2)))
            .collect(),
    }
}

impl Case {
    /// One second from the pre-dip phasor on; at a step the grid holds the value after it.
    fn input(&self) -> TerminalInput {
        const POINTS: usize = 32;
        let phasor = |i: usize| {
            // In grid points, so that steps fall on them exactly.
            let per_second = (POINTS * self.rate_fps) as f64;
            let (start, length) = (0.2 * per_second, self.duration_s * per_second);
            let x = (i as f64 - start) / length;
            let inside = (-1e-9..1.0 - 1e-9).contains(&x);
            if !inside {
                return [1.0, 0.0];
            }
            let share = if self.smooth {
                (std::f64::consts::PI * x).sin().powi(2)
            } else {
                1.0
            };
            let (v, angle) = (1.0 - self.depth * share, self.turn_rad * share);
            [v * angle.cos(), v * angle.sin()]
        };
        let grid: Vec<_> = (0..=self.rate_fps * POINTS).map(phasor).collect();
        TerminalInput {
            real: grid.iter().map(|u| u[0]).collect(),
            imaginary: grid.iter().map(|u| u[1]).collect(),
            points_per_sample: POINTS,
            sample_interval_s: 1.0 / self.rate_fps as f64,
            jumps: vec![!self.smooth; self.rate_fps],
            dense: vec![false; self.rate_fps],
            synchronous_speed_rad_s: SYNCHRONOUS_RAD_S,
        }
    }

    /// Largest error of P and of Q, each relative to the largest value of the channel.
    fn error(&self, out: &MotorOutput<f64>) -> f64 {
        let (mut error, mut size) = ([0.0_f64; 2], [0.0_f64; 2]);
        for (sample, active, reactive) in &self.answers {
            let pairs = [
                (out.active[*sample], active),
                (out.reactive[*sample], reactive),
            ];
            for (c, (got, exact)) in pairs.into_iter().enumerate() {
                // NaN must not be overlooked.
                let difference = if got.is_finite() {
                    (got - exact).abs()
                } else {
                    f64::INFINITY
                };
                error[c] = error[c].max(difference);
                size[c] = size[c].max(exact.abs());
            }
        }
        (error[0] / size[0]).max(error[1] / size[1])
    }
}

fn errors(of: impl Fn(&Case) -> bool) -> Vec<f64> {
    let mut errors: Vec<_> = cases()
        .iter()
        .filter(|case| of(case))
        .map(|case| {
            let mut out = MotorOutput::default();
            case.motor.simulate(&case.input(), &mut out).unwrap();
            case.error(&out)
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    errors
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a length is an index"
)]
fn report(what: &str, errors: &[f64]) -> String {
    let (n, at) = (errors.len(), |share: f64| {
        errors[((errors.len() - 1) as f64 * share) as usize]
    });
    let good = errors.iter().filter(|e| **e < 1e-6).count();
    format!(
        "{what}: {good} of {n} below 1e-6; median {:.1e}, 99 % {:.1e}, largest {:.1e}",
        at(0.5),
        at(0.99),
        at(1.0)
    )
}

#[test]
fn errors_on_the_motors_of_table_1_are_below_1e_9() {
    let errors = errors(|case| case.kind == "table_1");
    assert_eq!(errors.len(), 9);
    assert!(
        errors.iter().all(|e| *e < 1e-9),
        "{}",
        report("Table 1", &errors)
    );
}

#[test]
fn errors_on_uniform_draws_over_the_box_are_below_1e_9() {
    let errors = errors(|case| case.kind == "uniform");
    assert!(errors.len() >= 50);
    assert!(
        errors.iter().all(|e| *e < 1e-9),
        "{}",
        report("uniform", &errors)
    );
}

#[test]
fn errors_on_logarithmic_draws_over_the_box_are_below_1e_6() {
    // Decay rates up to 4e6 1/s, rotors that stall, kappa up to 0.98.
    let errors = errors(|case| case.kind == "logarithmic");
    assert!(errors.len() >= 200);
    let good = errors.iter().filter(|e| **e < 1e-6).count();
    assert!(
        100 * good >= 99 * errors.len(),
        "{}",
        report("logarithmic", &errors)
    );
    // None is far off: what is left is the tolerance of the reference where Q is next to nothing.
    assert!(
        errors[errors.len() - 1] < 2e-6,
        "{}",
        report("logarithmic", &errors)
    );
}

/// The table of `docs/validation.md`: run with `--nocapture`.
#[test]
fn the_error_estimate_covers_the_error_by_region_of_the_box() {
    let regions = [0.0, 50.0, 500.0, 5e3, 5e4, f64::INFINITY];
    for pair in regions.windows(2) {
        let inside = |case: &Case| (pair[0]..pair[1]).contains(&case.motor.alpha_per_s);
        let what = format!("alpha from {} to {} 1/s", pair[0], pair[1]);
        println!("{}", report(&what, &errors(inside)));
    }
    for case in cases().iter().step_by(7) {
        let input = case.input();
        let estimate = case.motor.estimate_error(&input).unwrap();
        // 1e-7: the estimate does not know of the input's polynomials, nor of the reference's own error.
        let mut out = MotorOutput::default();
        case.motor.simulate(&input, &mut out).unwrap();
        let size = |x: &[f64]| x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let relative = estimate[0] / size(&out.active);
        assert!(relative < 1e-6, "{:?}: estimate {relative:e}", case.motor);
    }
}
