//! Composed fits against the plain problem, and a known effect that is found again.

use super::{
    Baseline, ComposedFitOptions, Ground, RelaySetting, SettingOf, fit, has_no_motor, narrowed,
    operating_point::at_operating_point,
    refine,
    rows::{EventRows, Scatter, random_effects},
    with_levels_of,
};
use crate::{
    disturbance::{Closing, Trigger, Window},
    identification::{
        intake::{IntakeOptions, PreparedEvent, prepare},
        joint_problem::{JointProblem, ProblemOptions},
    },
    load_model::{
        Structure,
        composed::{ComposedModel, Drive},
    },
    measurement::{Quality, Record, Sample},
};
use nalgebra::DVector;

mod distances;
mod operating_points;
mod stated_errors;
mod thresholds;
mod waiting;

const RATE_FPS: f64 = 60.0;
const SAMPLES: usize = 300;

/// A dip to `depth` with rounded flanks between 1 s and `1 s + duration_s`, P and Q static.
fn window(name: &str, depth: f64, duration_s: f64) -> Window {
    let sample = |k: usize| {
        let t = k as f64 / RATE_FPS;
        let flank = |at: f64| 1.0 / (1.0 + (-(t - at) / 0.01).exp());
        let inside = flank(1.0) - flank(1.0 + duration_s);
        // A tenth of a per mille of structured noise: intake divides by the noise it finds.
        let noise = 1e-4 * (12.9 * k as f64).sin();
        let voltage = 1.0 - (1.0 - depth) * inside;
        Sample {
            time_ns: 0,
            voltage_pu: voltage,
            angle_rad: -0.1 * inside,
            frequency_hz: 60.0,
            active_pu: 0.8 * voltage * (1.0 + noise),
            reactive_pu: 0.3 * voltage * voltage + noise,
            negative_sequence_ratio: 0.0,
            quality: Quality::default(),
        }
    };
    Window {
        id: name.to_owned(),
        site: "site".to_owned(),
        record: Record {
            start_ns: 0,
            rate_fps: RATE_FPS,
            nominal_hz: 60.0,
            samples: (0..SAMPLES).map(sample).collect(),
        },
        onset: 57,
        triggers: vec![Trigger::Recording],
        closing: Closing::RecordingEnded,
    }
}

pub(in crate::identification) fn events() -> Vec<PreparedEvent> {
    [("a", 0.85, 0.1), ("b", 0.6, 0.15), ("c", 0.75, 0.3)]
        .iter()
        .map(|(name, depth, duration)| {
            prepare(&window(name, *depth, *duration), &IntakeOptions::default()).unwrap()
        })
        .collect()
}

/// The events with P and Q of a model, and the noise that they had.
fn drawn_by(
    model: &ComposedModel,
    parameters: &[f64],
    events: &[PreparedEvent],
) -> Vec<PreparedEvent> {
    let mut drawn = events.to_vec();
    for event in &mut drawn {
        let drive = Drive::new(
            &event.input,
            event.chain.output_frequency_deviation(),
            event.q0_pu / event.p0_pu,
        );
        let response = model.simulate(parameters, &[], &drive).unwrap();
        let measured = event.chain.measured(&response.active, &response.reactive);
        for (k, [active, reactive]) in measured.into_iter().enumerate() {
            let noise = 1e-4 * (7.1 * k as f64).sin();
            event.active[k] = active + noise;
            event.reactive[k] = reactive - noise;
        }
    }
    drawn
}

const FREE: [usize; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

#[test]
fn the_plain_structure_has_the_objective_of_the_plain_problem() {
    let events = events();
    let problem = JointProblem::new(&events, ProblemOptions::default(), &|| false);
    let x = [3.4, 7.0, 0.4];
    let point = problem.point(&DVector::from_column_slice(&x)).unwrap();
    let model = ComposedModel::new(&Structure::zip_im());
    let parameters: Vec<f64> = x
        .iter()
        .chain(&point.linear)
        .chain(&[0.0])
        .copied()
        .collect();
    let mut options = ComposedFitOptions::default();
    options.local.evaluations_max = 1;
    options.rounds_max = 1;
    // The plain problem's does not go with the share.
    options.scatter.motor_share = 10.0;
    let at = fit(&events, &model, &parameters, &FREE, &options, &|| false).unwrap();
    // Two integrators, 1e-4 of P0 apart at worst.
    assert!(
        (at.objective / point.objective - 1.0).abs() < 0.02,
        "{} {}",
        at.objective,
        point.objective
    );
    let options = ComposedFitOptions {
        scatter: options.scatter,
        ..ComposedFitOptions::default()
    };
    let improved = fit(&events, &model, &parameters, &FREE, &options, &|| false).unwrap();
    assert!(
        improved.objective < 1.001 * point.objective,
        "{} {}",
        improved.objective,
        point.objective
    );
}

#[test]
fn an_event_has_its_own_reactive_coefficients() {
    let model = ComposedModel::new(&Structure::zip_im());
    let mut event = events().remove(0);
    let (site, _) = at_operating_point(&model, &model.typical(), &event);
    event.reactive_offset = [0.03, -0.01];
    let (own, _) = at_operating_point(&model, &model.typical(), &event);
    for (index, (own, site)) in own.iter().zip(&site).enumerate() {
        let expected = match model.parameters()[index].name.as_str() {
            "reactive_quadratic" => 0.03,
            "reactive_linear" => -0.01,
            _ => 0.0,
        };
        assert!((own - site - expected).abs() < 1e-15, "{index}");
    }
}

#[test]
fn a_resistance_in_the_data_is_found_again_and_lowers_the_information_criterion() {
    let plain = Structure::zip_im();
    let truth = ComposedModel::new(&plain.with("stator_resistance").unwrap());
    let mut parameters = truth.typical();
    let place = truth.index("stator_resistance.resistance").unwrap();
    parameters[place] = 0.03;
    let events = drawn_by(&truth, &parameters, &events());
    let model = ComposedModel::new(&plain);
    let options = ComposedFitOptions::default();
    let base = fit(&events, &model, &model.typical(), &FREE, &options, &|| {
        false
    })
    .unwrap();
    let ground = Ground::new(&events, &plain, &[&base], &options, &|| false);
    let screened = ground.screen("stator_resistance").unwrap();
    assert!(screened.best().unwrap().gain > 0.0);
    let found = ground.refit(&screened, f64::INFINITY).unwrap();
    assert!(
        (found.parameters[place] - 0.03).abs() < 0.002,
        "{:?}",
        found.parameters
    );
    assert!(found.bayesian_information() < base.bayesian_information() - 100.0);
    assert!(found.chi_square_per_row() < base.chi_square_per_row());
    let squares: f64 = found.squares.iter().sum();
    let reached = ground.refit(&screened, 1.01 * squares).unwrap();
    assert_eq!(
        (reached.parameters, reached.given_up),
        (found.parameters, false)
    );
    let given_up = ground.refit(&screened, 0.5 * squares).unwrap();
    assert!(given_up.given_up && given_up.evaluations < found.evaluations);
    let refined = refine(
        &events,
        given_up,
        "stator_resistance",
        &options.wanting(0.5 * squares),
        &|| false,
    );
    assert!(refined.given_up);
    // Not even begun, and yet free to move in all that the others are.
    let out_of_question = ground.refit(&screened, 1e-3 * squares).unwrap();
    assert!(out_of_question.given_up);
    assert_eq!(out_of_question.free, found.free);
}

#[test]
fn a_share_that_no_event_has_is_not_taken_for_one_that_all_have() {
    let model = ComposedModel::new(&Structure::zip_im());
    let truth = model.typical();
    let events = drawn_by(&model, &truth, &events());
    let options = ComposedFitOptions::default();
    let shared = fit(&events, &model, &truth, &FREE, &options, &|| false).unwrap();
    let with = |motor_share: f64| {
        let mut other = shared.clone();
        other.parameters[3] = motor_share;
        other
    };
    let is_shared = |other| narrowed::is_shared(&events, [&shared, &other], &options);
    assert!(is_shared(shared.clone()));
    assert!(!is_shared(with(0.75 * shared.parameters[3])));
    // What cannot be simulated is shared by none.
    assert!(!is_shared(with(f64::NAN)));
}

#[test]
fn what_no_event_shows_is_as_its_prior_has_it() {
    // Motors that trip and do not return within the window: at which voltage they would is not seen.
    const EFFECT: &str = "motor_undervoltage_trip";
    let truth = ComposedModel::new(&Structure::zip_im().with(EFFECT).unwrap());
    let place = |name: &str| truth.index(&format!("{EFFECT}.{name}")).unwrap();
    let mut parameters = truth.typical();
    parameters[place("share")] = 0.3;
    let events = drawn_by(&truth, &parameters, &events());
    let mut elsewhere = parameters.clone();
    elsewhere[place("return_voltage")] = 0.6;
    let free: Vec<usize> = (0..truth.parameters().len()).collect();
    let options = ComposedFitOptions {
        rounds_max: 1,
        ..ComposedFitOptions::default()
    };
    let begun = fit(&events, &truth, &elsewhere, &free, &options, &|| false).unwrap();
    let before = begun.minus_twice_log_posterior();
    let refined = refine(&events, begun, EFFECT, &options, &|| false);
    let found = refined.parameters[place("return_voltage")];
    assert!((found - 0.8).abs() < 0.03, "{found}");
    // Twice what a threshold may cost that is put in the middle of where it can be.
    assert!(refined.minus_twice_log_posterior() < before + 4.0);
}

#[test]
fn a_second_effect_is_seen_beside_one_whose_threshold_has_no_slope() {
    const FIRST: &str = "motor_undervoltage_trip";
    const SECOND: &str = "self_disconnection";
    let one = Structure::zip_im().with(FIRST).unwrap();
    let both = ComposedModel::new(&one.with(SECOND).unwrap());
    let mut truth = both.typical();
    truth[both.index(&format!("{FIRST}.share")).unwrap()] = 0.3;
    truth[both.index(&format!("{SECOND}.share")).unwrap()] = 0.1;
    let events = drawn_by(&both, &truth, &events());
    let model = ComposedModel::new(&one);
    let free: Vec<usize> = (0..model.parameters().len()).collect();
    let mut begun: Vec<f64> = (model.parameters().iter())
        .map(|p| truth[both.index(&p.name).unwrap()])
        .collect();
    // No voltage comes near it before the motors are off, and above it all the time afterwards.
    begun[model.index(&format!("{FIRST}.return_voltage")).unwrap()] = 0.7;
    let mut options = ComposedFitOptions::default();
    (options.rounds_max, options.local.evaluations_max) = (1, 1);
    let base = fit(&events, &model, &begun, &free, &options, &|| false).unwrap();
    let options = ComposedFitOptions::default();
    let ground = Ground::new(&events, &one, &[&base], &options, &|| false);
    let screened = ground.screen(SECOND).unwrap();
    let found = ground.refit(&screened, f64::INFINITY).expect("a candidate");
    assert!(found.chi_square_per_row() < 0.2 * base.chi_square_per_row());
    // What leaves with both is better known than which part of it is motors.
    let value = |name: &str| found.parameters[both.index(name).unwrap()];
    let share = value(&format!("{SECOND}.share"));
    let gone = share + value("motor_share") * value(&format!("{FIRST}.share"));
    let expected = 0.1 + 0.3 * truth[both.index("motor_share").unwrap()];
    assert!((gone - expected).abs() < 0.01, "{gone} {expected}");
    assert!((share - 0.1).abs() < 0.04, "{share}");
}

#[test]
fn a_fit_that_another_effect_helped_on_is_taken_on_without_it() {
    let structure = Structure::zip_im().with("stator_resistance").unwrap();
    let model = ComposedModel::new(&structure);
    let mut truth = model.typical();
    truth[model.index("stator_resistance.resistance").unwrap()] = 0.02;
    let events = drawn_by(&model, &truth, &events());
    let free: Vec<usize> = (0..model.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let mut unfinished = options;
    (unfinished.rounds_max, unfinished.local.evaluations_max) = (1, 1);
    let mut begun = truth.clone();
    (begun[0], begun[2]) = (begun[0] + 1.5, 1.3 * begun[2]);
    let baseline = Baseline {
        all: fit(&events, &model, &begun, &free, &unfinished, &|| false).unwrap(),
        mild: None,
        ordinary: None,
        structure: structure.clone(),
    };
    let helped = ComposedModel::new(&structure.with("time_skew").unwrap());
    let values: Vec<f64> = (helped.parameters().iter())
        .map(|p| {
            model
                .index(&p.name)
                .map_or(p.declaration.neutral, |i| truth[i])
        })
        .collect();
    let fit_with = fit(&events, &helped, &values, &free, &unfinished, &|| false).unwrap();
    assert!(baseline.all.chi_square_per_row() > 10.0);
    let lower = (baseline.lower_from(&events, &fit_with, &options, &|| false)).expect("lower");
    assert!(lower.all.chi_square_per_row() < 0.1 * baseline.all.chi_square_per_row());
    // There it ends.
    assert!(
        lower
            .lower_from(&events, &fit_with, &options, &|| false)
            .is_none()
    );
}

#[test]
fn a_motor_whose_share_or_kappa_has_run_to_its_least_is_none() {
    let model = ComposedModel::new(&Structure::zip_im());
    let events = events();
    let mut options = ComposedFitOptions::default();
    (options.rounds_max, options.local.evaluations_max) = (1, 1);
    let typical = fit(&events, &model, &model.typical(), &FREE, &options, &|| {
        false
    });
    let typical = typical.unwrap();
    for (name, expected) in [("ln_alpha", false), ("kappa", true), ("motor_share", true)] {
        let mut fit = typical.clone();
        fit.parameters = model.typical();
        let index = model.index(name).unwrap();
        fit.parameters[index] = model.parameters()[index].declaration.lower;
        assert_eq!(has_no_motor(&fit), expected, "{name}");
    }
}

#[test]
fn a_motor_of_next_to_no_share_hardly_varies() {
    let model = ComposedModel::new(&Structure::zip_im());
    let share = model.index("motor_share").unwrap();
    let scatter = Scatter::default();
    let spread = |value: f64| {
        let mut parameters = model.typical();
        parameters[share] = value;
        let effects = random_effects(&model, &parameters, &scatter);
        let found = effects.iter().find(|(index, _)| *index == share);
        found.unwrap().1
    };
    assert!((spread(0.02) - 0.002).abs() < 1e-12);
    for common in [0.25, 0.6] {
        assert!((spread(common) - scatter.composition[0]).abs() < 1e-12);
    }
}

#[test]
fn a_level_that_no_event_bounds_is_that_of_the_other_fit() {
    const EFFECT: &str = "motor_undervoltage_trip";
    let model = ComposedModel::new(&Structure::zip_im().with(EFFECT).unwrap());
    let events = events();
    let free: Vec<usize> = (0..model.parameters().len()).collect();
    let mut options = ComposedFitOptions::default();
    (options.rounds_max, options.local.evaluations_max) = (1, 1);
    let at = model.index(&format!("{EFFECT}.trip_voltage")).unwrap();
    let with_level = |level: f64| {
        let mut values = model.typical();
        values[at] = level;
        let mut own = fit(&events, &model, &values, &free, &options, &|| false).unwrap();
        own.parameters[at] = level;
        own
    };
    let (one, other) = (with_level(0.7), with_level(0.78));
    let open = |setting: &RelaySetting| {
        let [one, other] = setting.values;
        setting.of == SettingOf::Level && one < 0.75 && other > 0.75 && setting.dip <= 1.0
    };
    let [held, whole] = with_levels_of(&one, &other, open).expect("the level is open");
    for held in [&held, &whole] {
        assert!((held.parameters[at] - 0.78).abs() < 1e-12 && !held.free.contains(&at));
    }
    assert_eq!(held.free.len() + 1, one.free.len());
    let delay = one.model.index(&format!("{EFFECT}.trip_time_s")).unwrap();
    assert!(held.free.contains(&delay) && !whole.free.contains(&delay));
    assert!(with_levels_of(&one, &other, |_| false).is_none());
    // So is how long the voltage has to be below it, by itself.
    let of_delay = SettingOf::PickUp { level_pu: 0.7 };
    let [held, whole] =
        with_levels_of(&one, &other, |setting| setting.of == of_delay).expect("the delay is open");
    assert!(held.free.contains(&at) && !held.free.contains(&delay));
    assert!(!whole.free.contains(&at) && !whole.free.contains(&delay));
}

#[test]
fn what_is_excluded_or_unknown_is_an_error() {
    let events = events();
    let structure = Structure::zip_im();
    let model = ComposedModel::new(&structure);
    let options = ComposedFitOptions::default();
    let base = fit(&events, &model, &model.typical(), &FREE, &options, &|| {
        false
    })
    .unwrap();
    let ground = Ground::new(&events, &structure, &[&base], &options, &|| false);
    assert!(ground.screen("perpetual_motion").is_err());
}

#[test]
fn a_cancelled_fit_is_none() {
    let events = events();
    let model = ComposedModel::new(&Structure::zip_im());
    let options = ComposedFitOptions::default();
    assert!(fit(&events, &model, &model.typical(), &FREE, &options, &|| true).is_none());
}

#[test]
fn derivatives_by_the_delay_of_an_instrument_agree_with_differences() {
    const STEP_S: f64 = 1e-6;
    let model = ComposedModel::new(&Structure::zip_im().with("time_skew").unwrap());
    let delay = model.delay().unwrap();
    let wanted: Vec<usize> = (0..model.parameters().len()).collect();
    for event in &events() {
        let rows = EventRows::new(event);
        for delay_s in [0.0, 0.007, -0.025] {
            let mut at = model.typical();
            at[delay] = delay_s;
            let beside = |step: f64| {
                let mut moved = at.clone();
                moved[delay] += step;
                rows.residual(&model, &moved).unwrap()
            };
            let expanded = rows.expanded(&model, &at, &wanted).unwrap();
            // What is left falls where the model rises.
            let difference = (beside(-STEP_S) - beside(STEP_S)) / (2.0 * STEP_S);
            let error = (expanded.column(delay) - &difference).amax();
            assert!(error < 1e-4 * difference.amax(), "{delay_s}: {error:e}");
            let residual = expanded.column(wanted.len());
            assert!((residual - rows.residual(&model, &at).unwrap()).amax() < 1e-12);
        }
    }
}

/// A dip at 30 frames/s behind a triangle of two cycles, a window of one sample; the voltage jumps at 30.2 and 36.4
/// samples. P and Q follow it.
fn seen_by_few_samples() -> Window {
    let share_after = |k: usize, jump: f64| {
        let x = (2.0 * (k as f64 - jump)).clamp(-1.0, 1.0);
        if x < 0.0 {
            0.5 * (1.0 + x) * (1.0 + x)
        } else {
            1.0 - 0.5 * (1.0 - x) * (1.0 - x)
        }
    };
    let mut window = window("few", 1.0, 0.1);
    window.record.rate_fps = 30.0;
    window.onset = 28;
    for (k, sample) in window.record.samples.iter_mut().enumerate() {
        let noise = 1e-4 * (12.9 * k as f64).sin();
        let inside = share_after(k, 30.2) - share_after(k, 36.4);
        let voltage = 1.0 - 0.4 * inside + noise;
        sample.voltage_pu = voltage;
        sample.angle_rad = 0.0;
        sample.active_pu = 0.8 * voltage;
        sample.reactive_pu = 0.3 * voltage * voltage;
    }
    window
}

#[test]
fn what_an_instant_leaves_open_varies_from_event_to_event() {
    let event = prepare(&seen_by_few_samples(), &IntakeOptions::default()).unwrap();
    // A sample holds the first jump, none the second.
    assert_eq!((event.edges.len(), event.elsewhere().len()), (2, 1));
    let model = ComposedModel::new(&Structure::zip_im());
    let at = model.typical();
    let mut positions: Vec<f64> = event.edges.iter().map(|e| e.position).collect();
    positions[1] += event.edges[1].deviation;
    let moved = event.with_edge_positions(&positions);
    let residual = |event: &PreparedEvent| EventRows::new(event).residual(&model, &at).unwrap();
    let change = residual(&moved) - residual(&event);
    let covariance = |event: &PreparedEvent| {
        let rows = EventRows::new(event);
        let scatter = Scatter::default();
        rows.covariance(&model, &at, &scatter).unwrap().unwrap()
    };
    // A deviation of an instant costs one square at most, where fits know of it.
    assert!(covariance(&event).square(&change) <= 1.0);
    assert!(moved.elsewhere().is_empty());
    assert!(covariance(&moved).square(&change) > 2.0 * covariance(&event).square(&change));
}
