//! Coefficients that hold at the operating point of the site and are others in an event.

use nalgebra::DVector;

use super::events;
use crate::{
    identification::{
        ReactiveTrend,
        composed::{operating_point::at_operating_point, rows::EventRows},
        intake::PreparedEvent,
    },
    load_model::{Structure, composed::ComposedModel},
};

/// The trend of a site at another operating point than the event's.
const TREND: ReactiveTrend = ReactiveTrend {
    ratio: 0.3,
    slopes: [0.7, 0.2],
    site: Some([1.01, 0.9]),
    standard_errors: None,
};

fn event() -> PreparedEvent {
    TREND.applied_to(&events().remove(1))
}

fn model_with(effect: &str, values: &[(&str, f64)]) -> (ComposedModel, Vec<f64>) {
    let model = ComposedModel::new(&Structure::zip_im().with(effect).unwrap());
    let mut parameters = model.typical();
    for (name, value) in values {
        parameters[model.index(&format!("{effect}.{name}")).unwrap()] = *value;
    }
    (model, parameters)
}

/// Columns of an event's rows against central differences of its residual.
fn assert_derivatives_agree(model: &ComposedModel, parameters: &[f64], wanted: &[usize]) {
    let event = event();
    let rows = EventRows::new(&event);
    let columns = rows.expanded(model, parameters, wanted).unwrap();
    for (column, index) in wanted.iter().enumerate() {
        let residual = |by: f64| -> DVector<f64> {
            let mut moved = parameters.to_vec();
            moved[*index] += by;
            rows.residual(model, &moved).unwrap()
        };
        let step = 1e-4;
        let difference = (residual(-step) - residual(step)) / (2.0 * step);
        let scale = difference.amax().max(1e-6);
        let off = (difference - columns.column(column)).amax() / scale;
        assert!(off < 1e-3, "{index}: {off}");
    }
}

#[test]
fn derivatives_by_a_feeder_count_what_the_load_behind_it_draws() {
    let (model, parameters) = model_with(
        "feeder_impedance",
        &[("resistance", 0.03), ("reactance", 0.1)],
    );
    let wanted = ["resistance", "reactance"]
        .map(|name| model.index(&format!("feeder_impedance.{name}")).unwrap());
    assert_derivatives_agree(&model, &parameters, &wanted);
}

#[test]
fn derivatives_by_generation_count_the_composition_of_the_whole_load() {
    let (model, parameters) = model_with(
        "distributed_generation",
        &[("share", 0.2), ("load_exponent", 0.8), ("voltage", 0.75)],
    );
    let effect = |name: &str| {
        model
            .index(&format!("distributed_generation.{name}"))
            .unwrap()
    };
    // Beside a coefficient that they move, and without any.
    assert_derivatives_agree(
        &model,
        &parameters,
        &[effect("share"), 3, effect("load_exponent")],
    );
    assert_derivatives_agree(&model, &parameters, &[effect("load_exponent")]);
}

#[test]
fn generation_that_stays_leaves_the_composition_of_the_whole_load() {
    let (model, mut parameters) = model_with(
        "distributed_generation",
        &[("share", 0.2), ("load_exponent", 1.0)],
    );
    let event = event();
    let (own, slopes) = at_operating_point(&model, &parameters, &event);
    // 0.2 pu of generation are 0.25 of 0.8 pu, and 0.222 of the site's 0.9: of what the whole load draws
    // its motors have the same share.
    let [p0_pu, site_p0_pu] = [event.p0_pu, 0.9];
    let ratio = (1.0 + 0.2 / p0_pu) / (1.0 + 0.2 / site_p0_pu);
    assert!((own[3] - ratio * parameters[3]).abs() < 1e-12);
    assert!((slopes[3] - ratio).abs() < 1e-12);
    // A reactive power that stays the same share of the whole load changes `d_z` as it does the others.
    let mut alike = event.clone();
    alike.q0_pu = TREND.ratio * ratio * p0_pu;
    let alike = TREND.applied_to(&alike);
    let (own, _) = at_operating_point(&model, &parameters, &alike);
    assert!((own[6] - ratio * parameters[6]).abs() < 1e-12);
    // Generation that follows the load leaves every share as it is.
    parameters[model.index("distributed_generation.load_exponent").unwrap()] = 0.0;
    let (own, _) = at_operating_point(&model, &parameters, &event);
    assert!((own[3] - parameters[3]).abs() < 1e-12);
}

#[test]
fn capacitors_of_motors_go_with_the_reactive_power_of_the_load() {
    let (model, parameters) = model_with(
        "motor_undervoltage_trip",
        &[
            ("share", 0.4),
            ("trip_voltage", 0.75),
            ("capacitors_by_q0_over_p0", -0.6),
        ],
    );
    let place = model
        .index("motor_undervoltage_trip.capacitors_by_q0_over_p0")
        .unwrap();
    let event = event();
    let change = event.q0_pu / event.p0_pu - TREND.ratio;
    assert!(change.abs() > 0.02, "{change}");
    let (own, slopes) = at_operating_point(&model, &parameters, &event);
    assert!((own[place] + 0.6 * change).abs() < 1e-12);
    assert!((slopes[place] - change).abs() < 1e-12);
    assert_derivatives_agree(&model, &parameters, &[place]);
    // Where the site is not known the event is the site.
    let (own, _) = at_operating_point(&model, &parameters, &events().remove(1));
    assert!(own[place].abs() < 1e-12);
}
