//! What every effect of the catalogue must satisfy. A new effect is tested here the moment it is
//! listed; its own file holds only the tests that need its physics.

use std::path::{Path, PathBuf};

use super::{ComposedModel, Drive, Response, SimulationError};
use crate::load_model::{
    Structure, TerminalInput,
    effect::{Effect, Kind, Parameter, Role},
    effects::catalogue,
};

const RATE_FPS: f64 = 60.0;
const POINTS: usize = 16;
const REACTIVE_AT_REST: f64 = 0.3;

/// Phasors of a function of time over 2 s, jumps where the function says so.
pub(crate) fn input(phasor: impl Fn(f64) -> [f64; 2], jump_times_s: &[f64]) -> TerminalInput {
    lasting(2.0, phasor, jump_times_s)
}

/// Phasors of a function of time.
pub(crate) fn lasting(
    duration_s: f64,
    phasor: impl Fn(f64) -> [f64; 2],
    jump_times_s: &[f64],
) -> TerminalInput {
    let sample_interval_s = 1.0 / RATE_FPS;
    let samples = 1
        + (1..=100_000_u32)
            .take_while(|k| f64::from(*k) <= duration_s * RATE_FPS)
            .count();
    let grid: Vec<[f64; 2]> = (0..=(samples - 1) * POINTS)
        .map(|i| phasor(i as f64 * sample_interval_s / POINTS as f64))
        .collect();
    let jumps = (0..samples - 1)
        .map(|k| {
            let interval = k as f64 * sample_interval_s..=(k + 1) as f64 * sample_interval_s;
            jump_times_s.iter().any(|t| interval.contains(t))
        })
        .collect();
    TerminalInput {
        real: grid.iter().map(|u| u[0]).collect(),
        imaginary: grid.iter().map(|u| u[1]).collect(),
        points_per_sample: POINTS,
        sample_interval_s,
        jumps,
        dense: vec![false; samples - 1],
        synchronous_speed_rad_s: 376.99,
    }
}

/// A dip to `depth` with a phase jump from 0.5 s to 0.75 s, then a slow recovery from 0.93.
pub(crate) fn a_dip(depth: f64, angle: f64) -> TerminalInput {
    let phasor = |t: f64| {
        let (v, turned) = if t < 0.5 {
            (1.0, 0.0)
        } else if t < 0.75 {
            (depth + 0.02 * (t - 0.5), angle)
        } else {
            let late = (-(t - 0.75) / 0.4_f64).exp();
            (1.0 - 0.07 * late, -0.03 * (1.0 - late))
        };
        [v * turned.cos(), v * turned.sin()]
    };
    let mut input = input(phasor, &[0.5, 0.75]);
    for k in 28..33 {
        input.dense[k] = true;
    }
    input
}

fn frequency(input: &TerminalInput) -> Vec<f64> {
    let fine_s = input.sample_interval_s / input.points_per_sample as f64;
    let slow = |i: usize| 0.012 * (1.5 * (i as f64 * fine_s - 0.5).max(0.0)).sin();
    input.output_points().into_iter().map(slow).collect()
}

fn run(
    model: &ComposedModel,
    parameters: &[f64],
    wanted: &[usize],
    input: &TerminalInput,
) -> Result<Response, SimulationError> {
    let frequency = frequency(input);
    let drive = Drive::new(input, &frequency, REACTIVE_AT_REST);
    model.simulate(parameters, wanted, &drive)
}

fn model_with(names: &[&str]) -> Option<ComposedModel> {
    let mut all = vec!["zip", "induction_motor"];
    all.extend(names);
    Structure::parse(&all).ok().map(|s| ComposedModel::new(&s))
}

fn name(effect: &&'static dyn Effect) -> &'static str {
    effect.declaration().name
}

/// The dips in which the derivatives are tested: one deep enough for every threshold.
fn dips() -> [TerminalInput; 2] {
    [a_dip(0.437, -0.12), a_dip(0.813, 0.05)]
}

#[test]
fn declarations_are_complete() {
    let mut seen = Vec::new();
    for effect in catalogue() {
        let d = effect.declaration();
        assert!(!seen.contains(&d.name), "{} twice", d.name);
        seen.push(d.name);
        assert!(!d.title.is_empty() && d.version >= 1, "{}", d.name);
        assert!(d.source.len() > 15, "{}: no source", d.name);
        assert!(!d.acts_on.is_empty(), "{}: acts nowhere", d.name);
        assert!(
            d.needs.window_s > 0.0 && d.needs.rate_fps > 0.0,
            "{}",
            d.name
        );
        assert!(!d.needs.separating_event.is_empty(), "{}", d.name);
        assert!(
            d.parameters.iter().any(Parameter::is_amplitude),
            "{}: nothing makes it vanish",
            d.name
        );
        for p in d.parameters {
            let who = format!("{}.{}", d.name, p.name);
            assert!(!p.unit.is_empty() && !p.symbol.is_empty(), "{who}");
            assert!(p.lower < p.upper, "{who}: bounds");
            assert!((p.lower..=p.upper).contains(&p.neutral), "{who}: neutral");
            assert!((p.lower..=p.upper).contains(&p.typical), "{who}: typical");
            assert!(p.prior.deviation > 0.0, "{who}: prior");
            match p.role {
                Role::OneSidedAmplitude { meaningful } => {
                    assert!(
                        p.lower.eq(&p.neutral),
                        "{who}: neutral is not the lower bound"
                    );
                    assert!(meaningful > 0.0 && meaningful < p.upper, "{who}");
                }
                Role::TwoSidedAmplitude { meaningful } => {
                    assert!(p.lower < p.neutral && p.neutral < p.upper, "{who}");
                    assert!(meaningful > 0.0 && meaningful < p.upper, "{who}");
                }
                Role::Shape | Role::Count | Role::Shared => {
                    assert!(p.neutral.eq(&p.typical), "{who}");
                }
                Role::Base => panic!("{who}: only ZIP and motor have base parameters"),
            }
        }
    }
}

/// The folder of the effects' files.
pub(super) fn effects_folder() -> PathBuf {
    let here = Path::new(file!());
    let own = here
        .parent()
        .and_then(Path::parent)
        .unwrap()
        .join("effects");
    // Relative to the project root, unless the module was given an absolute path.
    Path::new(env!("CARGO_MANIFEST_DIR")).join(own)
}

#[test]
fn every_name_is_a_file_and_every_file_is_listed() {
    const BLOCKS: [&str; 5] = ["mod", "relay", "series", "lag", "static_lag"];
    let mut files: Vec<String> = std::fs::read_dir(effects_folder())
        .unwrap()
        .filter_map(|f| f.ok()?.path().file_stem()?.to_str().map(str::to_owned))
        .filter(|f| !BLOCKS.contains(&f.as_str()))
        .collect();
    files.sort();
    let mut names: Vec<String> = catalogue().iter().map(|e| name(e).to_owned()).collect();
    names.sort();
    assert_eq!(names, files);
}

#[test]
fn resembled_and_excluded_effects_are_in_the_catalogue() {
    for effect in catalogue() {
        let d = effect.declaration();
        let excluded = d.excludes.iter().map(|e| e.other);
        for other in d.resembles.iter().copied().chain(excluded) {
            let found = catalogue().iter().any(|e| name(e) == other);
            assert!(found && other != d.name, "{}: {other}", d.name);
        }
    }
}

#[test]
fn every_nuisance_point_lies_in_the_bounds_of_the_shapes() {
    let motor = crate::load_model::MotorCoordinates {
        alpha_per_s: 33.0,
        nu_per_s2: 1100.0,
        kappa: 0.4,
    };
    for effect in catalogue() {
        let d = effect.declaration();
        let shapes: Vec<_> = d.shapes().collect();
        let grid = effect.nuisance_grid(&motor);
        assert!(!grid.is_empty(), "{}", d.name);
        for point in grid {
            assert_eq!(point.len(), shapes.len(), "{}", d.name);
            for (value, p) in point.iter().zip(&shapes) {
                assert!((p.lower..=p.upper).contains(value), "{}.{}", d.name, p.name);
            }
        }
    }
}

#[test]
fn at_rest_p0_and_q0_hold_and_stay() {
    let flat = input(|_| [1.0, 0.0], &[]);
    for effect in catalogue() {
        let model = model_with(&[name(effect)]).unwrap();
        let drive = Drive::new(&flat, &[], REACTIVE_AT_REST);
        let mut parameters = model.typical();
        for p in model.parameters() {
            if let (Role::TwoSidedAmplitude { meaningful }, Some(i)) =
                (p.declaration.role, model.index(&p.name))
            {
                parameters[i] += meaningful;
            }
        }
        let out = model.simulate(&parameters, &[], &drive).unwrap();
        let slow = effect.declaration().name == "load_ramp";
        for k in 0..if slow { 1 } else { out.active.len() } {
            let (p, q) = (out.active[k] - 1.0, out.reactive[k] - REACTIVE_AT_REST);
            assert!(p.abs() < 1e-11, "{}: P moves by {p:e} at {k}", name(effect));
            assert!(q.abs() < 1e-11, "{}: Q moves by {q:e} at {k}", name(effect));
        }
    }
}

#[test]
fn neutral_equals_absent_bit_for_bit() {
    let plain = model_with(&[]).unwrap();
    for input in dips() {
        let absent = run(&plain, &plain.typical(), &[], &input).unwrap();
        for effect in catalogue() {
            let model = model_with(&[name(effect)]).unwrap();
            let neutral = run(&model, &model.neutral(), &[], &input).unwrap();
            assert_eq!(neutral, absent, "{}", name(effect));
            // The equations themselves vanish, too: values and derivatives of the sensitivity pass.
            let base: Vec<usize> = (0..super::BASE_PARAMETERS).collect();
            let mut wanted: Vec<usize> = base.iter().copied().take(6).collect();
            wanted.extend(
                (super::BASE_PARAMETERS..model.parameters().len())
                    .find(|i| model.parameters()[*i].declaration.is_amplitude()),
            );
            let present = run(&model, &model.neutral(), &wanted, &input).unwrap();
            let reference = run(&plain, &plain.typical(), &base, &input).unwrap();
            for (column, w) in wanted.iter().enumerate().take(6) {
                let pairs = present.active_derivatives[column]
                    .iter()
                    .zip(&reference.active_derivatives[*w]);
                for (x, y) in pairs {
                    // Two formulations of one motor, with steps of different length: the derivatives
                    // of the shallower steps are good to about 1e-4.
                    assert!((x - y).abs() < 3e-4, "{}: {x} {y}", name(effect));
                }
            }
        }
    }
}

#[test]
fn derivatives_are_exact() {
    for input in dips() {
        for effect in catalogue() {
            let model = model_with(&[name(effect)]).unwrap();
            let parameters = model.typical();
            // A lag of nothing behind a feeder: see `static_lag`.
            let wanted: Vec<usize> = (0..model.static_lag()).collect();
            let exact = run(&model, &parameters, &wanted, &input).unwrap();
            for i in wanted {
                let what = format!("{} by {}", name(effect), model.parameters()[i].name);
                compare_to_differences(&model, &parameters, i, &exact, &input, &what);
            }
        }
    }
}

fn compare_to_differences(
    model: &ComposedModel,
    parameters: &[f64],
    i: usize,
    exact: &Response,
    input: &TerminalInput,
    what: &str,
) {
    // Small against the width of the smoothed relays, large against rounding.
    let h = 2e-7 * parameters[i].abs().max(0.05);
    let at = |by: f64| {
        let mut moved = parameters.to_vec();
        moved[i] += by;
        run(model, &moved, &[], input).unwrap()
    };
    let (plus, minus) = (at(h), at(-h));
    let channels = [
        (&plus.active, &minus.active, &exact.active_derivatives[i]),
        (
            &plus.reactive,
            &minus.reactive,
            &exact.reactive_derivatives[i],
        ),
    ];
    for (plus, minus, exact) in channels {
        let largest = exact.iter().fold(0.0_f64, |m, d| m.max(d.abs()));
        for k in 0..exact.len() {
            let difference = (plus[k] - minus[k]) / (2.0 * h);
            let error = (exact[k] - difference).abs();
            assert!(
                error < 2e-6 * (1.0 + largest) + 1e-14 / h,
                "{what}, output {k}: exact {} difference {difference}, largest {largest}",
                exact[k]
            );
        }
    }
}

#[test]
fn the_derivative_at_neutral_is_that_of_the_sides_there_are() {
    let input = a_dip(0.437, -0.12);
    for effect in catalogue() {
        let model = model_with(&[name(effect)]).unwrap();
        let parameters = model.neutral();
        for i in super::BASE_PARAMETERS..parameters.len() {
            let p = &model.parameters()[i];
            if !p.declaration.is_amplitude() {
                continue;
            }
            let exact = run(&model, &parameters, &[i], &input).unwrap();
            // Extrapolated from steps away from neutral, to second order; between both sides where
            // there are two.
            let h = 1e-4 * p.declaration.upper;
            let at = |by: f64| {
                let mut moved = parameters.clone();
                moved[i] += by;
                run(&model, &moved, &[], &input).unwrap()
            };
            let one_sided = |h: f64| {
                let [x, y, z] = [1.0, 2.0, 3.0].map(|by| at(by * h).active);
                move |k: usize| {
                    let (first, second) = ((y[k] - x[k]) / h, (z[k] - y[k]) / h);
                    first + 1.5 * (first - second)
                }
            };
            let right = one_sided(h);
            let left = (p.declaration.lower < 0.0).then(|| one_sided(-h));
            let column = &exact.active_derivatives[0];
            let largest = column.iter().fold(0.0_f64, |m, d| m.max(d.abs()));
            for (k, slope) in column.iter().enumerate() {
                let expected = match &left {
                    None => right(k),
                    Some(left) => 0.5 * (left(k) + right(k)),
                };
                assert!(
                    (slope - expected).abs() < 2e-3 * (1.0 + largest),
                    "{} at {k}: {slope} {expected}",
                    p.name
                );
            }
        }
    }
}

#[test]
fn at_every_bound_there_is_a_finite_response_or_a_reason() {
    let phasor = |t: f64| {
        let inside = (0.5..0.75).contains(&t);
        if inside { [0.25, -0.05] } else { [0.99, 0.0] }
    };
    let start = |t: f64| if t < 0.5 { [1.0, 0.0] } else { phasor(t) };
    let input = lasting(7.0, start, &[0.5, 0.75]);
    for effect in catalogue() {
        let model = model_with(&[name(effect)]).unwrap();
        for (i, p) in model.parameters().iter().enumerate() {
            for bound in [p.declaration.lower, p.declaration.upper] {
                let mut parameters = model.typical();
                parameters[i] = bound;
                match run(&model, &parameters, &[], &input) {
                    Ok(_)
                    | Err(SimulationError::Infeasible(_) | SimulationError::NoLoadVoltage { .. }) =>
                        {}
                    Err(error) => panic!("{}: {} = {bound}: {error}", name(effect), p.name),
                }
            }
        }
    }
}

#[test]
fn where_a_threshold_lies_below_a_dip_changes_nothing() {
    let input = a_dip(0.8, -0.1);
    let mut seen = 0;
    for effect in catalogue() {
        let Some(threshold) = effect.threshold() else {
            continue;
        };
        let model = model_with(&[name(effect)]).unwrap();
        let index = model.index(&format!("{}.{threshold}", name(effect)));
        let index = index.unwrap();
        let amplitudes: Vec<usize> = (super::BASE_PARAMETERS..model.parameters().len())
            .filter(|i| model.parameters()[*i].declaration.is_amplitude())
            .collect();
        let at = |pu: f64| {
            let mut parameters = model.typical();
            parameters[index] = pu;
            run(&model, &parameters, &amplitudes, &input).unwrap()
        };
        let lower = model.parameters()[index].declaration.lower;
        assert_eq!(at(lower), at(0.778), "{}", name(effect));
        seen += 1;
    }
    assert!(seen >= 6, "{seen}");
}

#[test]
fn a_span_lies_below_a_threshold() {
    let mut seen = 0;
    for effect in catalogue() {
        let Some(span) = effect.span() else { continue };
        let declared = |name: &str| {
            let parameters = effect.declaration().parameters.iter();
            parameters.clone().find(|p| p.name == name).unwrap()
        };
        let threshold = declared(effect.threshold().unwrap());
        assert_eq!(declared(span).unit, threshold.unit, "{}", name(effect));
        assert!(declared(span).lower > 0.0, "{}", name(effect));
        seen += 1;
    }
    assert!(seen >= 4, "{seen}");
}

#[test]
fn any_two_effects_compose() {
    let input = a_dip(0.6, -0.1);
    for (i, one) in catalogue().iter().enumerate() {
        for other in &catalogue()[i + 1..] {
            let Some(model) = model_with(&[name(one), name(other)]) else {
                continue; // excluded, with a reason
            };
            let mut parameters = model.typical();
            for (value, p) in parameters.iter_mut().zip(model.parameters()) {
                if p.declaration.is_amplitude() {
                    *value = 0.5 * (*value + p.declaration.neutral);
                }
            }
            let out = run(&model, &parameters, &[3], &input);
            let out = out.unwrap_or_else(|e| panic!("{} + {}: {e}", name(one), name(other)));
            if ![name(one), name(other)].contains(&"load_ramp") {
                assert!((out.active[0] - 1.0).abs() < 1e-11);
            }
            assert!(out.active_derivatives[0].iter().all(|d| d.is_finite()));
        }
    }
}

#[test]
fn instruments_and_physics_are_told_apart() {
    const INSTRUMENTS: [&str; 4] = [
        "time_skew",
        "phasor_window",
        "ratio_phase_error",
        "frequency_tracking",
    ];
    for effect in catalogue() {
        let d = effect.declaration();
        let expected = INSTRUMENTS.contains(&d.name);
        assert_eq!(d.kind == Kind::Instrument, expected, "{}", d.name);
    }
}
