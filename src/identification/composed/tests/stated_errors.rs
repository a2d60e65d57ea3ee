//! Errors that are stated with a fit: what differs from event to event, how the estimate weighs the events, residuals that
//! last, and settings beside a cliff.

use super::{
    super::{
        ComposedFit, ComposedFitOptions,
        band::bands,
        fit, narrowed,
        quoted::quoted,
        rows::{EventRows, Scatter, random_effects},
        spread::{NARROWEST, Spreads},
    },
    FREE, drawn_by, events,
    thresholds::steep_dips,
};
use crate::{
    identification::intake::PreparedEvent,
    load_model::{Structure, composed::ComposedModel},
};

const MOTOR_SHARE: usize = 3;

/// The events with motors' shares of their own, relative to the typical one.
fn with_motor_shares(model: &ComposedModel, relative: &[f64]) -> Vec<PreparedEvent> {
    let all = events();
    let one = |(event, relative): (&PreparedEvent, &f64)| {
        let mut parameters = model.typical();
        parameters[MOTOR_SHARE] *= 1.0 + relative;
        drawn_by(model, &parameters, std::slice::from_ref(event)).remove(0)
    };
    all.iter().zip(relative).map(one).collect()
}

#[test]
fn the_more_events_differ_the_larger_are_the_errors_that_are_stated() {
    let model = ComposedModel::new(&Structure::zip_im());
    let options = ComposedFitOptions::default();
    let of = |relative: [f64; 3]| {
        let events = with_motor_shares(&model, &relative);
        let typical = model.typical();
        let wide = fit(&events, &model, &typical, &FREE, &options, &|| false).unwrap();
        let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
        let spreads = Spreads::new(&rows, &wide, &options, &|| false).unwrap();
        let shown = spreads.shown();
        let published = narrowed(&events, &wide, &options, &|| false);
        let assumed = wide.standard_error(MOTOR_SHARE).unwrap();
        (
            shown[0],
            published.standard_error(MOTOR_SHARE).unwrap() / assumed,
        )
    };
    let (alike, slightly, widely) = (of([0.0; 3]), of([0.02, -0.02, 0.01]), of([0.1, -0.1, 0.05]));
    assert!(alike.0 < slightly.0 && slightly.0 < widely.0);
    assert!(alike.1 < slightly.1 && slightly.1 < widely.1);
}

#[test]
fn a_delay_beside_a_cliff_is_known_as_well_as_the_other_side_says() {
    const EFFECT: &str = "self_disconnection";
    let truth = ComposedModel::new(&Structure::zip_im().with(EFFECT).unwrap());
    let place = |name: &str| truth.index(&format!("{EFFECT}.{name}")).unwrap();
    let mut parameters = truth.typical();
    parameters[place("share")] = 0.2;
    parameters[place("voltage")] = 0.8;
    let free: Vec<usize> = (0..truth.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let mut error_s = |delay_s: f64| {
        parameters[place("time_s")] = delay_s;
        let events = drawn_by(&truth, &parameters, &steep_dips([0.85, 0.6, 0.75]));
        let wide = fit(&events, &truth, &parameters, &free, &options, &|| false).unwrap();
        let published = narrowed(&events, &wide, &options, &|| false);
        let of = |fit: &ComposedFit| fit.standard_error(place("time_s")).unwrap();
        (of(&wide), of(&published))
    };
    // Dips of 0.2 s: far from the cliff every millisecond shows.
    let (_, within) = error_s(0.15);
    assert!(within < 0.002, "{within}");
    // With a little less the load would be gone, with more nothing changes: the derivative knows of the cliff alone.
    let (derivative, beside) = error_s(0.198);
    assert!(derivative < 1e-4, "{derivative}");
    assert!(beside > 0.02, "{beside}");
}

/// Normal deviates of a fixed sequence.
fn normal(number: &mut u64) -> f64 {
    let mut uniform = || {
        *number = number
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        ((*number >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    };
    let radius = (-2.0 * uniform().ln()).sqrt();
    radius * (std::f64::consts::TAU * uniform()).cos()
}

#[test]
fn an_estimate_that_weighs_events_otherwise_errs_as_stated() {
    const DRAWS: usize = 40;
    let model = ComposedModel::new(&Structure::zip_im());
    let typical = model.typical();
    let options = ComposedFitOptions::default();
    let random = random_effects(&model, &typical, &options.scatter);
    let mut number = 1;
    let mut drawn = || -> Vec<PreparedEvent> {
        let all = events();
        let one = |event: &PreparedEvent| {
            let mut parameters = model.typical();
            for (index, deviation) in &random {
                parameters[*index] += deviation * normal(&mut number);
            }
            drawn_by(&model, &parameters, std::slice::from_ref(event)).remove(0)
        };
        all.iter().map(one).collect()
    };
    // Next to no spread: the event with the deepest dip decides.
    let weighed = ComposedFitOptions {
        scatter: options.scatter.times(NARROWEST),
        ..options
    };
    let estimates: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let fit = fit(&drawn(), &model, &typical, &FREE, &weighed, &|| false).unwrap();
            fit.parameters[MOTOR_SHARE]
        })
        .collect();
    let mean = estimates.iter().sum::<f64>() / DRAWS as f64;
    let squares = estimates.iter().map(|e| (e - mean).powi(2));
    let found = (squares.sum::<f64>() / (DRAWS - 1) as f64).sqrt();

    let events = drawn_by(&model, &typical, &events());
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    let wide = fit(&events, &model, &typical, &FREE, &options, &|| false).unwrap();
    let bands = bands(&rows, &wide, &options, &|| false);
    let quoted = quoted(&rows, &bands, &options, &|| false).unwrap();
    let of = |scatter: &Scatter| {
        let covariance = quoted.of_estimate(&rows, &bands, scatter).unwrap();
        covariance[(MOTOR_SHARE, MOTOR_SHARE)].sqrt()
    };
    let (stated, best) = (of(&weighed.scatter), of(&options.scatter));
    assert!((0.75..1.3).contains(&(found / stated)), "{found} {stated}");
    assert!(stated > 1.05 * best, "{stated} {best}");
}

#[test]
fn residuals_that_last_make_stated_errors_larger() {
    let model = ComposedModel::new(&Structure::zip_im());
    let white = drawn_by(&model, &model.typical(), &events());
    let mut lasting = white.clone();
    for event in &mut lasting {
        for (k, active) in event.active.iter_mut().enumerate() {
            // Half a second: faster than any parameter can follow, slower than a sample.
            *active += 8e-4 * (0.2 * k as f64).sin();
        }
    }
    let options = ComposedFitOptions::default();
    let largest = |events: &[PreparedEvent]| {
        let start = model.typical();
        let wide = fit(events, &model, &start, &FREE, &options, &|| false).unwrap();
        let stated = narrowed(events, &wide, &options, &|| false);
        let (stated, plain) = (stated.covariance.unwrap(), wide.covariance.unwrap());
        let ratio = |i: usize| (stated[(i, i)] / plain[(i, i)]).sqrt();
        (0..FREE.len()).map(ratio).fold(0.0, f64::max)
    };
    let (white, lasting) = (largest(&white), largest(&lasting));
    assert!(white < 1.1, "{white}");
    assert!(lasting > 1.8, "{lasting}");
}
