use super::*;
use crate::numerics::Scalar;

const FULL_TURN: f64 = 376.99;
const ROUGH: Effort = Effort::Rough { looseness: 10_000 };

/// A dip to half with an angle, 0.1 s at 60 samples per second, then a slow swing.
fn input(dense: bool) -> TerminalInput {
    let (points, samples) = (32, 46);
    let phasor = |i: usize| {
        let t = i as f64 / (points as f64 * 60.0);
        let v = if (0.2..0.3).contains(&t) { 0.5 } else { 1.0 };
        let angle = if t < 0.2 {
            0.0
        } else {
            0.1 * (9.0 * (t - 0.2)).sin()
        };
        [v * angle.cos(), v * angle.sin()]
    };
    let grid: Vec<_> = (0..=(samples - 1) * points).map(phasor).collect();
    TerminalInput {
        real: grid.iter().map(|u| u[0]).collect(),
        imaginary: grid.iter().map(|u| u[1]).collect(),
        points_per_sample: points,
        sample_interval_s: 1.0 / 60.0,
        jumps: vec![false; samples - 1],
        dense: (0..samples - 1)
            .map(|k| dense && (11..20).contains(&k))
            .collect(),
        synchronous_speed_rad_s: FULL_TURN,
    }
}

/// Ordinary motors, some that stall, one that runs alone, one that cannot carry its load.
fn motors() -> Vec<MotorCoordinates<f64>> {
    let share = |i: u32, step: f64| (f64::from(i) * step).fract();
    let mut all: Vec<_> = (0..37)
        .map(|i| MotorCoordinates {
            alpha_per_s: 3.0 * 100.0_f64.powf(share(i, 0.618)),
            nu_per_s2: 20.0 * 2000.0_f64.powf(share(i, 0.755)),
            kappa: 0.02 + 0.95 * share(i, 0.57),
        })
        .collect();
    all[5].alpha_per_s = 2e5;
    all[20].kappa = 1.5;
    all
}

fn on(
    arch: Arch,
    motors: &[MotorCoordinates<f64>],
    input: &TerminalInput,
    effort: Effort,
) -> Vec<Vec<[u64; 2]>> {
    let mut out = vec![Vec::new(); motors.len()];
    let mut sink = |instant: usize, members: &[usize], p: &[f64], q: &[f64]| {
        for (lane, &motor) in members.iter().enumerate() {
            assert_eq!(out[motor].len(), instant);
            // The sign of "not a number" differs between instruction sets and means nothing.
            let bits = |x: f64| {
                if x.is_nan() {
                    f64::NAN.to_bits()
                } else {
                    x.to_bits()
                }
            };
            out[motor].push([bits(p[lane]), bits(q[lane])]);
        }
    };
    simulate_batch_on(arch, motors, &BatchInput::new(input), effort, &mut sink);
    out
}

#[test]
fn a_batch_has_the_bits_of_each_motor_alone() {
    for dense in [false, true] {
        let (motors, input) = (motors(), input(dense));
        let batch = on(Arch::new(), &motors, &input, Effort::Exact);
        for (i, motor) in motors.iter().enumerate() {
            let mut out = MotorOutput::default();
            let verdict = motor.simulate(&input, &mut out);
            assert_eq!(verdict.is_ok(), i != 20);
            let expected = if verdict.is_ok() {
                input.output_count()
            } else {
                0
            };
            assert_eq!(batch[i].len(), expected);
            for (k, bits) in batch[i].iter().enumerate() {
                assert_eq!(bits[0], out.active[k].to_bits(), "motor {i}, instant {k}");
                assert_eq!(bits[1], out.reactive[k].to_bits(), "motor {i}, instant {k}");
            }
        }
    }
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    let (motors, input) = (motors(), input(true));
    for effort in [
        Effort::Exact,
        ROUGH,
        Effort::Fixed {
            steps_per_sample: 2,
        },
    ] {
        let best = on(Arch::new(), &motors, &input, effort);
        assert!(best == on(Arch::Scalar, &motors, &input, effort));
    }
}

#[test]
fn a_motor_in_a_batch_does_not_depend_on_its_companions() {
    let (motors, input) = (motors(), input(false));
    for effort in [
        Effort::Exact,
        ROUGH,
        Effort::Fixed {
            steps_per_sample: 4,
        },
    ] {
        let together = on(Arch::new(), &motors, &input, effort);
        let mut reversed = motors.clone();
        reversed.reverse();
        let mut backwards = on(Arch::new(), &reversed, &input, effort);
        backwards.reverse();
        assert!(together == backwards);
    }
}

#[test]
fn fixed_steps_converge_with_order_four() {
    let input = input(false);
    let motor = [MotorCoordinates {
        alpha_per_s: 35.0,
        nu_per_s2: 1300.0,
        kappa: 0.36,
    }];
    let exact = on(Arch::new(), &motor, &input, Effort::Exact);
    let error = |steps_per_sample| {
        let fixed = on(
            Arch::new(),
            &motor,
            &input,
            Effort::Fixed { steps_per_sample },
        );
        fixed[0]
            .iter()
            .zip(&exact[0])
            .fold(0.0_f64, |worst, (f, e)| {
                worst.max((f64::from_bits(f[0]) - f64::from_bits(e[0])).abs())
            })
    };
    let (coarse, fine) = (error(2), error(8));
    assert!(
        coarse < 1e-3 && fine < coarse / 100.0,
        "{coarse:e}, {fine:e}"
    );
}

#[test]
fn a_motor_that_overflows_leaves_the_others_alone() {
    let input = input(false);
    let mut motors = motors();
    let before = on(
        Arch::new(),
        &motors,
        &input,
        Effort::Fixed {
            steps_per_sample: 1,
        },
    );
    motors[3].alpha_per_s = 1e200;
    let after = on(
        Arch::new(),
        &motors,
        &input,
        Effort::Fixed {
            steps_per_sample: 1,
        },
    );
    for i in (0..motors.len()).filter(|i| *i != 3) {
        assert!(before[i] == after[i]);
    }
}

/// A motor with derivatives by ln alpha, ln nu and kappa.
fn sensitive(motor: &MotorCoordinates<f64>) -> MotorCoordinates<Slopes> {
    MotorCoordinates {
        alpha_per_s: Slopes::variable(motor.alpha_per_s.ln(), 0).exp(),
        nu_per_s2: Slopes::variable(motor.nu_per_s2.ln(), 1).exp(),
        kappa: Slopes::variable(motor.kappa, 2),
    }
}

/// Per motor and instant, P and its derivatives.
#[derive(Default)]
struct Kept(Vec<Vec<[f64; 4]>>);

impl BatchSink for Kept {
    #[inline(always)]
    fn output(&mut self, instant: usize, motors: &[usize], active: &[f64], _: &[f64]) {
        for (motor, p) in motors.iter().zip(active) {
            assert_eq!(self.0[*motor].len(), instant);
            self.0[*motor].push([*p, 0.0, 0.0, 0.0]);
        }
    }

    #[inline(always)]
    fn slope(&mut self, instant: usize, motors: &[usize], i: usize, active: &[f64], _: &[f64]) {
        for (motor, p) in motors.iter().zip(active) {
            self.0[*motor][instant][1 + i] = *p;
        }
    }
}

fn with_slopes(arch: Arch, motors: &[MotorCoordinates<f64>], effort: Effort) -> Kept {
    let motors: Vec<_> = motors.iter().map(sensitive).collect();
    let mut kept = Kept(vec![Vec::new(); motors.len()]);
    let input = input(false);
    let input = BatchInput::new(&input);
    simulate_batch_with_slopes_on(arch, &motors, &input, effort, &mut kept);
    kept
}

#[test]
fn rough_slopes_depend_neither_on_companions_nor_on_the_instruction_set() {
    let motors = motors();
    let all = with_slopes(Arch::new(), &motors, ROUGH);
    let portable = with_slopes(Arch::Scalar, &motors, ROUGH);
    for (i, motor) in motors.iter().enumerate() {
        let alone = with_slopes(Arch::new(), std::slice::from_ref(motor), ROUGH);
        let bits = |rows: &[[f64; 4]]| -> Vec<u64> {
            rows.iter().flatten().map(|x| x.to_bits()).collect()
        };
        assert_eq!(
            bits(&all.0[i]),
            bits(&alone.0[0]),
            "motor {i} and companions"
        );
        assert_eq!(bits(&all.0[i]), bits(&portable.0[i]), "motor {i}, portable");
    }
}

#[test]
fn exact_slopes_have_the_bits_of_each_motor_alone() {
    let motors = motors();
    let all = with_slopes(Arch::new(), &motors, Effort::Exact);
    let input = input(false);
    for (i, motor) in motors.iter().enumerate() {
        let mut alone = MotorOutput::default();
        if sensitive(motor).simulate(&input, &mut alone).is_err() {
            assert!(all.0[i].is_empty(), "motor {i}");
            continue;
        }
        let expected = (alone.active.iter())
            .map(|p| [p.value, p.slope(0), p.slope(1), p.slope(2)].map(f64::to_bits));
        let got = all.0[i].iter().map(|row| row.map(f64::to_bits));
        assert!(expected.eq(got), "motor {i}");
    }
}

#[test]
fn a_rough_simulation_is_as_near_to_the_exact_one_as_its_looseness_says() {
    let motors = motors();
    let exact = with_slopes(Arch::new(), &motors, Effort::Exact);
    let rough = with_slopes(Arch::new(), &motors, ROUGH);
    let apart = |i: usize, column: usize| {
        let rows = exact.0[i].iter().zip(&rough.0[i]);
        let apart = rows.clone().map(|(e, r)| (e[column] - r[column]).abs());
        let size = rows.map(|(e, _)| e[column].abs());
        apart.fold(0.0, f64::max) / size.fold(0.0, f64::max)
    };
    let feasible: Vec<usize> = (0..motors.len()).filter(|i| *i != 20).collect();
    // Steps of ten-thousandfold tolerance, some 1e-5 of the power each.
    let mut of_power: Vec<f64> = feasible.iter().map(|i| apart(*i, 0)).collect();
    of_power.sort_by(f64::total_cmp);
    let (median, largest) = (of_power[of_power.len() / 2], of_power[of_power.len() - 1]);
    assert!(median < 1e-5 && largest < 1e-2, "{median:e} {largest:e}");
    let mut of_slopes: Vec<f64> = (feasible.iter())
        .flat_map(|i| [1, 2, 3].map(|column| apart(*i, column)))
        .collect();
    of_slopes.sort_by(f64::total_cmp);
    let median = of_slopes[of_slopes.len() / 2];
    assert!(median < 1e-4, "{median:e}");
}
