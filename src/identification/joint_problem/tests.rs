//! The objective against its definition, and points side by side against points alone.

use nalgebra::{DVector, SVector};

use super::{
    JointProblem, LINEAR, OUTER, OuterSensitivities, ProblemOptions, motor_coordinates,
    reactive_at_rest,
};
use crate::{
    disturbance::{Closing, Trigger, Window},
    identification::{
        gram::{COLUMNS, EventColumns, Gram, Y, at_rest, linear_rows, motor_change},
        intake::{IntakeOptions, PreparedEvent, prepare},
    },
    load_model::{MotorCoordinates, MotorOutput},
    measurement::{Quality, Record, Sample},
    numerics::{Objective, Scalar},
};

const SAMPLES: usize = 240;

/// A dip to `depth` for `samples`, behind a triangular filter as wide as two samples, with some load.
fn window(name: &str, depth: f64, samples: f64) -> Window {
    let passed = |k: f64, at: f64| {
        let x = (k - at).clamp(-1.0, 1.0);
        let tail = 0.5 * (1.0 - x.abs()) * (1.0 - x.abs());
        if x < 0.0 { tail } else { 1.0 - tail }
    };
    let sample = |k: usize| {
        let k = k as f64;
        let inside = passed(k, 60.3) - passed(k, 60.3 + samples);
        let noise = 1e-3 * (12.9 * k).sin();
        let voltage = 1.0 - (1.0 - depth) * inside;
        let recovering = 0.1 * (1.0 - inside) * passed(k, 60.3) * (-(k - 60.0) / 20.0).exp();
        Sample {
            time_ns: 0,
            voltage_pu: voltage,
            angle_rad: -0.1 * inside,
            frequency_hz: 60.0,
            active_pu: 0.8 * voltage + recovering + noise,
            reactive_pu: 0.3 * voltage * voltage + 2.0 * recovering - noise,
            negative_sequence_ratio: 0.0,
            quality: Quality::default(),
        }
    };
    Window {
        id: name.to_owned(),
        site: "site".to_owned(),
        record: Record {
            start_ns: 0,
            rate_fps: 60.0,
            nominal_hz: 60.0,
            samples: (0..SAMPLES).map(sample).collect(),
        },
        onset: 57,
        triggers: vec![Trigger::Recording],
        closing: Closing::RecordingEnded,
    }
}

fn events() -> Vec<PreparedEvent> {
    let mut events: Vec<PreparedEvent> = [("a", 0.8, 6.0), ("b", 0.6, 9.4)]
        .iter()
        .map(|(name, depth, samples)| {
            prepare(&window(name, *depth, *samples), &IntakeOptions::default()).unwrap()
        })
        .collect();
    events[0].reactive_offset = [0.03, -0.01];
    // A gap in the middle, and a frequency that moves.
    events[1].used[100..107].fill(false);
    events
}

fn point(x: [f64; OUTER]) -> DVector<f64> {
    DVector::from_column_slice(&x)
}

/// Motors all over the box, and points at which there is no motor.
fn points() -> Vec<DVector<f64>> {
    let mut points: Vec<DVector<f64>> = (0..37)
        .map(|i| {
            let share = |step: usize| (i * step % 37) as f64 / 37.0;
            point([
                -0.6 + 6.3 * share(5),
                -0.6 + 11.0 * share(11),
                0.01 + 0.98 * share(17),
            ])
        })
        .collect();
    points[3][2] = 1.2;
    points[20][2] = -0.1;
    points[21][0] = f64::NAN;
    points
}

fn bits(values: &[Option<f64>]) -> Vec<Option<u64>> {
    values.iter().map(|v| v.map(f64::to_bits)).collect()
}

#[test]
fn points_side_by_side_have_the_bits_of_each_alone_however_they_are_grouped() {
    let (events, points) = (events(), points());
    let problem = JointProblem::new(&events, ProblemOptions::default(), &|| false);
    let alone: Vec<Option<f64>> = points.iter().map(|x| problem.value(x)).collect();
    assert!(alone[3].is_none() && alone[20].is_none() && alone[21].is_none());
    assert!(alone.iter().filter(|value| value.is_some()).count() > 20);
    let counted = problem.simulations();
    for group in [1, 3, 8, 37] {
        let before = problem.simulations().0;
        let together: Vec<Option<f64>> =
            (points.chunks(group).flat_map(|some| problem.values(some))).collect();
        assert_eq!(bits(&together), bits(&alone), "groups of {group}");
        assert_eq!(problem.simulations(), (before + counted.0, 0));
    }
}

#[test]
fn a_cancelled_problem_has_no_values() {
    let events = events();
    let problem = JointProblem::new(&events, ProblemOptions::default(), &|| true);
    assert!(problem.values(&points()).iter().all(Option::is_none));
    assert!(problem.point(&points()[0]).is_none());
}

/// The Gram matrix as the sum over rows that it stands for.
fn summed_by_rows(event: &PreparedEvent, x: &DVector<f64>) -> Gram {
    let motor = dual_motor(x);
    let mut out = MotorOutput::default();
    motor.simulate(&event.input, &mut out).unwrap();
    let change = motor_change(event, &out, reactive_at_rest(&motor));
    let responses = event.chain.static_responses();
    let mut gram = Gram::zeros();
    for k in (0..event.len()).filter(|&k| event.used[k]) {
        let load = &responses[k];
        let linear = linear_rows(change[k].map(|m| m.value), load);
        let rest = at_rest(event, load);
        let [p, q] = load.unity;
        let offsets = [[p, -q], [q, p]];
        let measured = [event.active[k], event.reactive[k]];
        let deviations = [event.active_deviation[k], event.reactive_deviation[k]];
        for channel in 0..2 {
            let mut row = SVector::<f64, COLUMNS>::zeros();
            for i in 0..OUTER {
                row[i] = change[k][channel].derivative(i);
            }
            for i in 0..LINEAR {
                row[OUTER + i] = linear[channel][i];
            }
            row[OUTER + LINEAR] = offsets[channel][0];
            row[OUTER + LINEAR + 1] = offsets[channel][1];
            let [z, i] = event.reactive_offset;
            let own = z * linear[channel][3] + i * linear[channel][4];
            row[Y] = measured[channel] - rest[channel] - own;
            row /= deviations[channel];
            gram += row * row.transpose();
        }
    }
    gram
}

fn dual_motor(x: &DVector<f64>) -> MotorCoordinates<OuterSensitivities> {
    MotorCoordinates {
        alpha_per_s: OuterSensitivities::variable(x[0], 0).exp(),
        nu_per_s2: OuterSensitivities::variable(x[1], 1).exp(),
        kappa: OuterSensitivities::variable(x[2], 2),
    }
}

/// Largest difference relative to the norms of the two columns.
fn difference(gram: &Gram, expected: &Gram, columns: std::ops::Range<usize>) -> f64 {
    let mut worst = 0.0_f64;
    for i in columns.clone() {
        for j in columns.clone() {
            let size = (expected[(i, i)] * expected[(j, j)]).sqrt().max(1e-12);
            worst = worst.max((gram[(i, j)] - expected[(i, j)]).abs() / size);
        }
    }
    worst
}

#[test]
fn gram_matrices_are_the_sums_over_rows() {
    let x = point([3.4, 7.0, 0.4]);
    for event in &events() {
        assert!(!event.chain.filtered().is_empty());
        let columns = EventColumns::new(event);
        let expected = summed_by_rows(event, &x);

        let motor = dual_motor(&x);
        let mut out = MotorOutput::default();
        motor.simulate(&event.input, &mut out).unwrap();
        let length = columns.series_length();
        let column = |values: Vec<f64>| {
            let filled = length - values.len();
            values.into_iter().chain(std::iter::repeat_n(0.0, filled))
        };
        let part = |numbers: &[OuterSensitivities], i: usize| {
            let of = |x: &OuterSensitivities| if i < OUTER { x.derivative(i) } else { x.value };
            column(numbers.iter().map(of).collect())
        };
        let mut series: Vec<f64> = (0..=OUTER)
            .flat_map(|i| part(&out.active, i).chain(part(&out.reactive, i)))
            .collect();
        let gram = columns.sensitivity_gram(&mut series, reactive_at_rest(&motor));
        let error = difference(&gram, &expected, 0..COLUMNS);
        assert!(error < 1e-12, "with sensitivities: {error:e}");

        let motor = motor_coordinates(&x);
        let mut out = MotorOutput::default();
        motor.simulate(&event.input, &mut out).unwrap();
        let mut series: Vec<f64> = column(out.active).chain(column(out.reactive)).collect();
        let plain = columns.plain_gram(&mut series, reactive_at_rest(&motor));
        for i in OUTER..COLUMNS {
            for j in OUTER..COLUMNS {
                assert_eq!(plain[(i, j)].to_bits(), gram[(i, j)].to_bits());
            }
        }
    }
}

#[test]
fn derivatives_agree_with_differences_and_values_with_expansions() {
    let events = events();
    let problem = JointProblem::new(&events, ProblemOptions::default(), &|| false);
    for x in [[3.4, 7.0, 0.4], [2.0, 5.0, 0.7], [4.2, 8.0, 0.2]].map(point) {
        let expansion = problem.expansion(&x).unwrap();
        let value = problem.value(&x).unwrap();
        assert_eq!(expansion.value.to_bits(), value.to_bits());
        for i in 0..OUTER {
            let step = 1e-5;
            let at = |sign: f64| {
                let mut moved = x.clone();
                moved[i] += sign * step;
                problem.value(&moved).unwrap()
            };
            let slope = (at(1.0) - at(-1.0)) / (2.0 * step);
            let error = (expansion.gradient[i] - slope).abs();
            let size = expansion.gradient.amax().max(value);
            assert!(
                error < 1e-4 * size,
                "{i}: {} {slope}",
                expansion.gradient[i]
            );
        }
    }
}
