//! Relays that wait, beside others that open late.

use super::{
    super::{ComposedFitOptions, fit, refine, relay_walk, rows::EventRows},
    drawn_by, window,
};
use crate::{
    identification::intake::{IntakeOptions, PreparedEvent, prepare},
    load_model::{Structure, composed::ComposedModel},
};

/// A fault of so many samples, at whose beginning and end the voltage is as given.
fn fault(name: &str, samples: usize, [begins, ends]: [f64; 2]) -> PreparedEvent {
    let mut fault = window(name, begins, 0.2);
    for (k, sample) in fault.record.samples.iter_mut().enumerate() {
        let inside = (61..61 + samples).contains(&k);
        let sunk = (ends - begins) * (k.saturating_sub(61)) as f64 / samples as f64;
        sample.voltage_pu = if inside { begins + sunk } else { 1.0 };
        sample.angle_rad = if inside { -0.1 } else { 0.0 };
    }
    prepare(&fault, &IntakeOptions::default()).unwrap()
}

/// Motors that trip after 62 ms below 0.79 pu: in faults that begin just below that and sink, and not in one that is over
/// sooner although it sinks further than where another has tripped them.
#[test]
fn a_relay_that_waits_is_found_from_one_that_opens_late() {
    const RELAY: &str = "motor_undervoltage_trip";
    let model = ComposedModel::new(&Structure::zip_im().with(RELAY).unwrap());
    let place = |name: &str| model.index(&format!("{RELAY}.{name}")).unwrap();
    let with = |own: [(&str, f64); 4]| {
        let mut parameters = model.typical();
        parameters[place("share")] = 0.45;
        for (name, value) in own {
            parameters[place(name)] = value;
        }
        parameters
    };
    let truth = with([
        ("trip_voltage", 0.79),
        ("trip_time_s", 0.062),
        ("opening_s", 0.002),
        ("opening_spread_s", 0.006),
    ]);
    let late = with([
        ("trip_voltage", 0.745),
        ("trip_time_s", 0.02),
        ("opening_s", 0.008),
        ("opening_spread_s", 0.033),
    ]);
    let events = [
        fault("mild", 6, [0.86, 0.84]),
        fault("short", 3, [0.78, 0.73]),
        fault("sinking", 8, [0.775, 0.7]),
        fault("deep", 5, [0.7, 0.65]),
        fault("long", 15, [0.66, 0.59]),
    ];
    let events = drawn_by(&model, &truth, &events);
    let free: Vec<usize> = (0..model.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let begun = fit(&events, &model, &late, &free, &options, &|| false).unwrap();
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    let walked = relay_walk::from_fit(&rows, &begun, &options, &|| false);
    let walked =
        walked.map(|from| fit(&events, &model, &from, &free, &options, &|| false).unwrap());
    let before = walked.as_ref().unwrap_or(&begun).chi_square_per_row();
    let found = refine(&events, begun, RELAY, &options, &|| false);
    let left = found.chi_square_per_row();
    assert!(100.0 * left < before, "{left} {before}");
    let value = |name: &str| found.parameters[place(name)];
    let switched_s = value("trip_time_s") + value("opening_s") + 0.5 * value("opening_spread_s");
    assert!((switched_s - 0.067).abs() < 0.01, "{switched_s}");
    assert!((value("trip_voltage") - 0.79).abs() < 0.015);
}
