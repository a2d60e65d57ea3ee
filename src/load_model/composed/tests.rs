//! The composed simulation against the plain kernel, and its own accuracy.

use nalgebra::Complex;

use super::{Accuracy, ComposedModel, Drive, SimulationError, contract};
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

/// Runs `difference` on dips of two depths for each motor (alpha, nu, kappa) and asserts that what it returns stays
/// below `limit`.
fn over_dips_and_motors(
    motors: [[f64; 3]; 4],
    limit: f64,
    difference: impl Fn(&ComposedModel, &[f64], &TerminalInput) -> f64,
) {
    let model = ComposedModel::new(&Structure::zip_im());
    for depth in [0.8, 0.5] {
        let input = contract::a_dip(depth, -0.1);
        for [alpha, nu, kappa] in motors {
            let mut parameters = model.typical();
            parameters[..3].copy_from_slice(&[alpha.ln(), nu.ln(), kappa]);
            let found = difference(&model, &parameters, &input);
            assert!(found < limit, "alpha {alpha}, depth {depth}: {found:e}");
        }
    }
}

#[test]
fn without_effects_it_agrees_with_the_plain_kernel() {
    // An ordinary motor, a light and fast one, a heavy and slow one, one close to pull-out.
    let motors = [
        [35.0_f64, 1300.0_f64, 0.36],
        [120.0, 9000.0, 0.5],
        [4.0, 60.0, 0.2],
        [20.0, 700.0, 0.9],
    ];
    over_dips_and_motors(motors, 1e-4, |model, parameters, input| {
        let drive = Drive::new(input, &[], 0.25);
        let out = model.simulate(parameters, &[], &drive).unwrap();
        let [active, reactive] = plain_kernel(parameters, input, 0.25);
        largest_difference(&out.active, &active).max(largest_difference(&out.reactive, &reactive))
    });
}

#[test]
fn rough_steps_stay_within_what_measurements_tell_apart() {
    // The last but one is as fast as searches go, the last near pull-out.
    let motors = [
        [35.0_f64, 1300.0_f64, 0.36],
        [4.0, 60.0, 0.2],
        [300.0, 9000.0, 0.3],
        [20.0, 700.0, 0.9],
    ];
    over_dips_and_motors(motors, 5e-3, |model, parameters, input| {
        let full = Drive::new(input, &[], 0.25);
        let rough = Drive {
            accuracy: Accuracy::Rough,
            ..full
        };
        let [full, rough] =
            [full, rough].map(|drive| model.simulate(parameters, &[0], &drive).unwrap());
        largest_difference(&full.active, &rough.active)
            .max(largest_difference(&full.reactive, &rough.reactive))
    });
}

/// The same phasor sampled so many times as fast.
fn sampled_faster(input: &TerminalInput, by: usize) -> TerminalInput {
    let fine = |of: &[f64]| {
        let between = |pair: &[f64]| {
            let (from, to) = (pair[0], pair[1]);
            (0..by).map(move |j| from + (to - from) * j as f64 / by as f64)
        };
        let mut all: Vec<f64> = of.windows(2).flat_map(between).collect();
        all.extend(of.last());
        all
    };
    let jumps = input.jumps.iter();
    TerminalInput {
        real: fine(&input.real),
        imaginary: fine(&input.imaginary),
        sample_interval_s: input.sample_interval_s / by as f64,
        jumps: jumps.flat_map(|jump| vec![*jump; by]).collect(),
        dense: vec![false; input.dense.len() * by],
        ..input.clone()
    }
}

#[test]
fn full_steps_give_what_eight_times_as_many_samples_give() {
    const FASTER: usize = 8;
    let structures: [&[&str]; 5] = [
        &["second_motor"],
        &["feeder_impedance"],
        &["second_motor", "feeder_impedance"],
        &["double_cage_rotor", "feeder_impedance"],
        &["speed_dependent_torque", "feeder_impedance"],
    ];
    for names in structures {
        let all: Vec<&str> = ["zip", "induction_motor"]
            .iter()
            .chain(names)
            .copied()
            .collect();
        let model = ComposedModel::new(&Structure::parse(&all).unwrap());
        let parameters = model.typical();
        for depth in [0.8, 0.5] {
            let input = contract::a_dip(depth, -0.1);
            let faster = sampled_faster(&input, FASTER);
            let run = |input: &TerminalInput| {
                let drive = Drive::new(input, &[], 0.25);
                let found = model.simulate(&parameters, &[], &drive).unwrap();
                [found.active, found.reactive]
            };
            // Every output instant of the one is a sample of the other.
            let apart = input.points_per_sample / FASTER;
            let points = input.output_points();
            let at: Vec<usize> = points.iter().map(|point| point / apart).collect();
            let [exact, found] = [run(&faster), run(&input)];
            for (exact, found) in exact.iter().zip(&found) {
                let exact: Vec<f64> = at.iter().map(|&i| exact[i]).collect();
                let square = exact.iter().zip(found).map(|(x, y)| (x - y).powi(2));
                let off = (square.sum::<f64>() / at.len() as f64).sqrt();
                assert!(off < 2e-4, "{names:?}, depth {depth}: {off:e}");
                // At the edge of a deep dip the fine grid itself is coarse.
                let most = largest_difference(&exact, found);
                assert!(most < 2e-3, "{names:?}, depth {depth}: {most:e}");
            }
        }
    }
}

#[test]
fn a_motor_with_every_detail_neutral_is_the_plain_one() {
    let names = ["zip", "induction_motor", "stator_resistance"];
    let detailed = ComposedModel::new(&Structure::parse(&names).unwrap());
    let plain = ComposedModel::new(&Structure::zip_im());
    let input = contract::a_dip(0.5, -0.1);
    let drive = Drive::new(&input, &[], 0.25);
    let mut parameters = detailed.neutral();
    // Next to nothing, so that the detailed equations are used.
    parameters[8] = 1e-9;
    let one = detailed.simulate(&parameters, &[], &drive).unwrap();
    let other = plain.simulate(&plain.typical(), &[], &drive).unwrap();
    assert!(largest_difference(&one.active, &other.active) < 1e-7);
    assert!(largest_difference(&one.reactive, &other.reactive) < 1e-7);
}

/// The motor as a circuit with rotor flux linkages, another derivation than that of
/// `composed::motor`: `psi = x_m i_s + (x_r + x_m) i_r`, `dpsi/dt = -w0 r_r i_r + j (w - w0) psi`.
struct Circuit {
    stator: Complex<f64>,
    magnetising: f64,
    rotor_self: f64,
    rotor_resistance: f64,
    inertia: f64,
    torque: f64,
}

const W0: f64 = 376.99;
/// Steps of the circuit per fine grid point.
const PARTS: usize = 16;

impl Circuit {
    fn stator_current(&self, u: Complex<f64>, psi: Complex<f64>) -> Complex<f64> {
        let behind = Complex::<f64>::i() * psi * (self.magnetising / self.rotor_self);
        (u - behind) / self.stator
    }

    fn torque(&self, u: Complex<f64>, psi: Complex<f64>) -> f64 {
        let current = self.stator_current(u, psi);
        self.magnetising / self.rotor_self * (psi.conj() * current).im
    }

    fn slopes(&self, u: Complex<f64>, (psi, slip): (Complex<f64>, f64)) -> (Complex<f64>, f64) {
        let stator = self.stator_current(u, psi);
        let rotor = (psi - stator * self.magnetising) / self.rotor_self;
        let turning = Complex::<f64>::i() * psi * slip;
        let surplus = self.torque(u, psi) - self.torque;
        let loss = rotor * (W0 * self.rotor_resistance);
        (turning - loss, surplus / self.inertia)
    }

    fn step(&self, u: [Complex<f64>; 2], x: (Complex<f64>, f64), h: f64) -> (Complex<f64>, f64) {
        let middle = (u[0] + u[1]) * 0.5;
        let ahead = |k: (Complex<f64>, f64), by: f64| (x.0 + k.0 * by, x.1 + k.1 * by);
        let k1 = self.slopes(u[0], x);
        let k2 = self.slopes(middle, ahead(k1, 0.5 * h));
        let k3 = self.slopes(middle, ahead(k2, 0.5 * h));
        let k4 = self.slopes(u[1], ahead(k3, h));
        let mean = |a: f64, b: f64, c: f64, d: f64| (a + 2.0 * b + 2.0 * c + d) / 6.0;
        let re = mean(k1.0.re, k2.0.re, k3.0.re, k4.0.re);
        let im = mean(k1.0.im, k2.0.im, k3.0.im, k4.0.im);
        let slip = mean(k1.1, k2.1, k3.1, k4.1);
        (x.0 + Complex::new(re, im) * h, x.1 + slip * h)
    }
}

#[test]
fn a_motor_with_stator_resistance_is_the_circuit_of_the_textbook() {
    // On the rating: r_s .03, x_s .1, x_m 3, x_r .12, r_r .02, H .6 s, slip .012. Scaling every
    // impedance by the power at rest brings it to the base of its own initial power.
    let (slip, h) = (0.012, 0.6);
    let j = Complex::<f64>::i();
    let rotor = Complex::new(0.02 / slip, 0.12);
    let impedance = Complex::new(0.03, 0.1) + j * 3.0 * rotor / (j * 3.0 + rotor);
    let k = impedance.inv().re;
    let (xs, xm, xr) = (0.1 * k, 3.0 * k, 0.12 * k);
    let (x, x_prime) = (xs + xm, xs + xm * xr / (xm + xr));
    let open_circuit_s = (xr + xm) / (W0 * 0.02 * k);
    let inertia = 2.0 * h / k / W0;
    let mut circuit = Circuit {
        stator: Complex::new(0.03 * k, x_prime),
        magnetising: xm,
        rotor_self: xr + xm,
        rotor_resistance: 0.02 * k,
        inertia,
        torque: 0.0,
    };
    let current = (impedance * k).inv();
    let rotor_current = -current * j * 3.0 / (j * 3.0 + rotor);
    let mut state = (current * xm + rotor_current * (xr + xm), -slip * W0);
    circuit.torque = circuit.torque(Complex::new(1.0, 0.0), state.0);

    let input = contract::a_dip(0.55, -0.15);
    let structure = Structure::zip_im().with("stator_resistance").unwrap();
    let model = ComposedModel::new(&structure);
    let strength = 1.0 / x_prime - 1.0 / x;
    let alpha = x / (x_prime * open_circuit_s);
    let nu = strength / inertia;
    let parameters = [
        alpha.ln(),
        nu.ln(),
        2.0 / strength,
        1.0,
        0.0,
        0.0,
        1.0 / x,
        0.0,
        0.03 * k,
        x,
        0.0,
    ];
    let drive = Drive::new(&input, &[], -current.im);
    let out = model.simulate(&parameters, &[], &drive).unwrap();

    let fine_s = input.sample_interval_s / input.points_per_sample as f64;
    let phasor = |i: usize| Complex::new(input.real[i], input.imaginary[i]);
    let mut outputs = input.output_points().into_iter().enumerate().peekable();
    let mut worst = 0.0_f64;
    for i in 0..input.real.len() {
        if let Some((k, _)) = outputs.next_if(|(_, point)| *point == i) {
            let power = phasor(i) * circuit.stator_current(phasor(i), state.0).conj();
            worst = worst.max((out.active[k] - power.re).abs());
            worst = worst.max((out.reactive[k] - power.im).abs());
        }
        if i + 1 == input.real.len() {
            break;
        }
        let between =
            |part: usize| phasor(i) + (phasor(i + 1) - phasor(i)) * (part as f64 / PARTS as f64);
        for part in 0..PARTS {
            let u = [between(part), between(part + 1)];
            state = circuit.step(u, state, fine_s / PARTS as f64);
        }
    }
    assert!(worst < 5e-5, "{worst:e}");
}

#[test]
fn wrong_arguments_are_named() {
    let model = ComposedModel::new(&Structure::zip_im());
    let input = contract::a_dip(0.5, -0.1);
    let drive = Drive::new(&input, &[0.0], 0.25);
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
        simulate(&typical, &[typical.len()], &drive),
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
    let drive = Drive::new(&input, &[], 0.25);
    let parameters = model.typical();
    let all: Vec<usize> = (0..parameters.len()).collect();
    let every = model.simulate(&parameters, &all, &drive).unwrap();
    let few = model.simulate(&parameters, &[9, 1], &drive).unwrap();
    assert_eq!(few.active, every.active);
    assert_eq!(few.active_derivatives[0], every.active_derivatives[9]);
    assert_eq!(few.reactive_derivatives[1], every.reactive_derivatives[1]);
}

#[test]
fn the_same_equipment_has_other_figures_on_the_base_of_another_event() {
    // V0 = 0.95, P0 = 0.8: V0^2 = 0.9025. 0.4/0.9025 = 0.443213; ln 0.9025 = -0.102587;
    // 0.04 x 0.8/0.9025 = 0.0354571.
    let structure = Structure::zip_im().with("feeder_impedance").unwrap();
    let model = ComposedModel::new(&structure);
    let mut declared = model.typical();
    let resistance = model.index("feeder_impedance.resistance").unwrap();
    declared[1] = 7.0;
    declared[2] = 0.4;
    declared[resistance] = 0.04;
    let (own, slopes) = model.on_event_base(&declared, 0.95, 0.8);
    assert!((own[1] - 6.897_413).abs() < 1e-6);
    assert!((own[2] - 0.443_213).abs() < 1e-6);
    assert!((own[resistance] - 0.035_457_1).abs() < 1e-7);
    assert!(own[0].to_bits() == declared[0].to_bits() && own[3].to_bits() == declared[3].to_bits());
    for (k, p) in model.parameters().iter().enumerate() {
        let mut moved = declared.clone();
        moved[k] += 1e-3;
        let (there, _) = model.on_event_base(&moved, 0.95, 0.8);
        assert!(
            ((there[k] - own[k]) / 1e-3 - slopes[k]).abs() < 1e-9,
            "{}",
            p.name
        );
        let back = p.declaration.reference.declared(own[k], 0.95, 0.8);
        assert!((back - declared[k]).abs() < 1e-12, "{}", p.name);
    }
}

#[test]
fn a_relay_knows_the_voltage_and_not_its_share_of_that_before_the_event() {
    // V0 = 0.95: 0.6/0.95 = 0.631579; 4.4 x 0.9025 = 3.971.
    let structure = Structure::zip_im().with("single_phase_ac_stall").unwrap();
    let model = ComposedModel::new(&structure);
    let mut declared = model.typical();
    let place = |name: &str| {
        let name = format!("single_phase_ac_stall.{name}");
        model.index(&name).unwrap()
    };
    let (stall, conductance) = (place("stall_voltage"), place("stalled_conductance"));
    (declared[stall], declared[conductance]) = (0.6, 4.4);
    let (own, slopes) = model.on_event_base(&declared, 0.95, 0.8);
    assert!((own[stall] - 0.631_579).abs() < 1e-6);
    assert!((own[conductance] - 3.971).abs() < 1e-9);
    assert!((slopes[stall] - 1.0 / 0.95).abs() < 1e-12);
}

#[test]
fn derivatives_are_the_same_asked_for_alone_and_together() {
    // Alone they are carried by narrower numbers.
    let input = contract::a_dip(0.6, 0.1);
    let deviation = vec![-2e-3; input.output_count()];
    let drive = Drive::new(&input, &deviation, 0.3);
    for effect in crate::load_model::effects::catalogue() {
        let name = effect.declaration().name;
        let model = ComposedModel::new(&Structure::zip_im().with(name).unwrap());
        let typical = model.typical();
        // A lag of nothing behind a feeder: see `static_lag`.
        let all: Vec<usize> = (0..model.static_lag()).collect();
        let together = model.simulate(&typical, &all, &drive).unwrap();
        for &index in &all {
            let alone = model.simulate(&typical, &[index], &drive).unwrap();
            let pairs = [
                (
                    &alone.active_derivatives[0],
                    &together.active_derivatives[index],
                ),
                (
                    &alone.reactive_derivatives[0],
                    &together.reactive_derivatives[index],
                ),
            ];
            for (alone, together) in pairs {
                let scale = together.iter().fold(1.0_f64, |most, d| most.max(d.abs()));
                let apart = largest_difference(alone, together);
                assert!(
                    apart < 1e-9 * scale,
                    "{name}, {index}: {apart:e} of {scale:e}"
                );
            }
        }
    }
}
