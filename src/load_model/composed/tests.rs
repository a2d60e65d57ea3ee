//! The composed simulation against the plain kernel, and its own accuracy.

use super::{ComposedModel, Drive, SimulationError, contract};
use crate::load_model::{
    LinearCoefficients, MotorCoordinates, MotorOutput, Structure, TerminalInput,
};

fn plain_kernel(parameters: &[f64], input: &TerminalInput, q0: f64) -> [Vec<f64>; 2] {
    let motor = MotorCoordinates {
        alpha_per_s: parameters[0].exp(),
        nu_per_s2: parameters[1].exp(),
        kappa: parameters[2],
    };
    let mut out = MotorOutput::default();
    motor.simulate(input, &mut out).unwrap();
    let beta = LinearCoefficients::from_array(std::array::from_fn(|i| parameters[3 + i]));
    let voltage = |i: usize| input.real[i].hypot(input.imaginary[i]);
    let at: Vec<f64> = input.output_points().into_iter().map(voltage).collect();
    let rest = out.reactive[0];
    let active = (0..at.len()).map(|k| {
        1.0 + beta.motor_share * (out.active[k] - 1.0)
            + beta.active_quadratic * (at[k] * at[k] - 1.0)
            + beta.active_linear * (at[k] - 1.0)
    });
    let reactive = (0..at.len()).map(|k| {
        q0 + beta.motor_share * (out.reactive[k] - rest)
            + beta.reactive_quadratic * (at[k] * at[k] - 1.0)
            + beta.reactive_linear * (at[k] - 1.0)
    });
    [active.collect(), reactive.collect()]
}

fn largest_difference(x: &[f64], y: &[f64]) -> f64 {
    assert_eq!(x.len(), y.len());
    let pairs = x.iter().zip(y);
    pairs.map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

#[test]
fn without_effects_it_agrees_with_the_plain_kernel() {
    let model = ComposedModel::new(&Structure::zip_im());
    // An ordinary motor, a light and fast one, a heavy and slow one, one close to pull-out.
    let motors = [
        [35.0_f64, 1300.0_f64, 0.36],
        [120.0, 9000.0, 0.5],
        [4.0, 60.0, 0.2],
        [20.0, 700.0, 0.9],
    ];
    for depth in [0.8, 0.5] {
        let input = contract::a_dip(depth, -0.1);
        for [alpha, nu, kappa] in motors {
            let mut parameters = model.typical();
            parameters[..3].copy_from_slice(&[alpha.ln(), nu.ln(), kappa]);
            let drive = Drive {
                terminal: &input,
                frequency_deviation: &[],
                reactive_at_rest: 0.25,
            };
            let out = model.simulate(&parameters, &[], &drive).unwrap();
            let [active, reactive] = plain_kernel(&parameters, &input, 0.25);
            let p = largest_difference(&out.active, &active);
            let q = largest_difference(&out.reactive, &reactive);
            assert!(
                p < 1e-4 && q < 1e-4,
                "alpha {alpha}, depth {depth}: {p:e} {q:e}"
            );
        }
    }
}

#[test]
fn a_motor_with_every_detail_neutral_is_the_plain_one() {
    let names = ["zip", "induction_motor", "stator_resistance"];
    let detailed = ComposedModel::new(&Structure::parse(&names).unwrap());
    let plain = ComposedModel::new(&Structure::zip_im());
    let input = contract::a_dip(0.5, -0.1);
    let drive = Drive {
        terminal: &input,
        frequency_deviation: &[],
        reactive_at_rest: 0.25,
    };
    let mut parameters = detailed.neutral();
    // Next to nothing, so that the detailed equations are used.
    parameters[8] = 1e-9;
    let one = detailed.simulate(&parameters, &[], &drive).unwrap();
    let other = plain.simulate(&plain.typical(), &[], &drive).unwrap();
    assert!(largest_difference(&one.active, &other.active) < 1e-7);
    assert!(largest_difference(&one.reactive, &other.reactive) < 1e-7);
}

#[test]
fn wrong_arguments_are_named() {
    let model = ComposedModel::new(&Structure::zip_im());
    let input = contract::a_dip(0.5, -0.1);
    let drive = Drive {
        terminal: &input,
        frequency_deviation: &[0.0],
        reactive_at_rest: 0.25,
    };
    let simulate = |p: &[f64], w: &[usize], d: &Drive<'_>| model.simulate(p, w, d).unwrap_err();
    let typical = model.typical();
    assert!(matches!(
        simulate(&typical, &[], &drive),
        SimulationError::FrequencyCount { .. }
    ));
    let drive = Drive {
        frequency_deviation: &[],
        ..drive
    };
    assert!(matches!(
        simulate(&typical[1..], &[], &drive),
        SimulationError::ParameterCount { .. }
    ));
    assert!(matches!(
        simulate(&typical, &[8], &drive),
        SimulationError::NoSuchParameter { .. }
    ));
    let mut overloaded = typical;
    overloaded[2] = 1.1;
    assert!(matches!(
        simulate(&overloaded, &[], &drive),
        SimulationError::Infeasible(_)
    ));
}

#[test]
fn the_order_and_choice_of_wanted_parameters_change_no_number() {
    let names = ["zip", "induction_motor", "second_motor"];
    let model = ComposedModel::new(&Structure::parse(&names).unwrap());
    let input = contract::a_dip(0.5, -0.1);
    let drive = Drive {
        terminal: &input,
        frequency_deviation: &[],
        reactive_at_rest: 0.25,
    };
    let parameters = model.typical();
    let all: Vec<usize> = (0..parameters.len()).collect();
    let every = model.simulate(&parameters, &all, &drive).unwrap();
    let few = model.simulate(&parameters, &[9, 1], &drive).unwrap();
    assert_eq!(few.active, every.active);
    assert_eq!(few.active_derivatives[0], every.active_derivatives[9]);
    assert_eq!(few.reactive_derivatives[1], every.reactive_derivatives[1]);
}
