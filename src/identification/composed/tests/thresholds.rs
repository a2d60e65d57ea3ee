//! What acts below a voltage: where that voltage is put, and beside which motor it is found.

use super::{
    super::{Baseline, ComposedFit, ComposedFitOptions, Ground, fit, narrowed, refine},
    FREE, drawn_by, events, window,
};
use crate::{
    identification::intake::{IntakeOptions, PreparedEvent, prepare},
    load_model::{Structure, composed::ComposedModel},
};

const DEPTHS: [f64; 3] = [0.85, 0.6, 0.75];

/// Dips from one sample to the next.
pub(super) fn steep_dips(depths: [f64; 3]) -> [PreparedEvent; 3] {
    depths.map(|depth| {
        let mut dip = window("dip", depth, 0.2);
        for (k, sample) in dip.record.samples.iter_mut().enumerate() {
            let inside = (61..73).contains(&k);
            sample.voltage_pu = if inside { depth } else { 1.0 };
            sample.angle_rad = if inside { -0.1 } else { 0.0 };
        }
        prepare(&dip, &IntakeOptions::default()).unwrap()
    })
}

#[test]
fn a_threshold_between_two_dips_stays_in_their_middle() {
    const EFFECT: &str = "self_disconnection";
    let truth = ComposedModel::new(&Structure::zip_im().with(EFFECT).unwrap());
    let voltage = truth.index(&format!("{EFFECT}.voltage")).unwrap();
    let mut parameters = truth.typical();
    // Far from the middle, which is at 0.675.
    parameters[voltage] = 0.73;
    let events = drawn_by(&truth, &parameters, &steep_dips(DEPTHS));
    let free: Vec<usize> = (0..truth.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let begun = fit(&events, &truth, &parameters, &free, &options, &|| false).unwrap();
    let wide = refine(&events, begun, EFFECT, &options, &|| false);
    let narrow = narrowed(&events, &wide, &options, &|| false);
    let found = narrow.parameters[voltage];
    assert!((found - 0.675).abs() < 0.02, "{found}");
    // A uniform distribution over 0.15 less the spread of the relays.
    let error = narrow.standard_error(voltage).unwrap();
    assert!((0.03..0.06).contains(&error), "{error}");
}

#[test]
fn where_a_band_begins_is_known_as_well_as_fits_with_it_elsewhere_say() {
    const EFFECT: &str = "electronic_load_dropout";
    let truth = ComposedModel::new(&Structure::zip_im().with(EFFECT).unwrap());
    let place = |name: &str| truth.index(&format!("{EFFECT}.{name}")).unwrap();
    let voltage = place("first_voltage");
    let mut parameters = truth.typical();
    let own = [("share", 0.2), ("first_voltage", 0.72), ("span", 0.1)];
    for (name, value) in own {
        parameters[place(name)] = value;
    }
    // No dip within the band.
    let events = drawn_by(&truth, &parameters, &steep_dips([0.85, 0.6, 0.55]));
    let free: Vec<usize> = (0..truth.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let begun = fit(&events, &truth, &parameters, &free, &options, &|| false).unwrap();
    let wide = refine(&events, begun, EFFECT, &options, &|| false);
    let narrow = narrowed(&events, &wide, &options, &|| false);
    let (found, error) = (
        narrow.parameters[voltage],
        narrow.standard_error(voltage).unwrap(),
    );
    assert!((0.015..0.08).contains(&error), "{error}");
    assert!((found - 0.72).abs() < 1.5 * error, "{found} within {error}");
    // Its share goes with it: known no better than beside a band that is.
    assert!(narrow.standard_error(place("span")).unwrap() > 0.5 * error);
}

#[test]
fn what_is_added_later_leaves_no_threshold_at_an_end() {
    let structure = Structure::zip_im().with("self_disconnection").unwrap();
    let truth = ComposedModel::new(&structure.with("load_ramp").unwrap());
    let voltage = truth.index("self_disconnection.voltage").unwrap();
    let mut parameters = truth.typical();
    parameters[truth.index("load_ramp.active_per_s").unwrap()] = -0.01;
    // Far from the middle, which is at 0.675.
    parameters[voltage] = 0.73;
    let events = drawn_by(&truth, &parameters, &steep_dips(DEPTHS));
    let free: Vec<usize> = (0..truth.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let begun = fit(&events, &truth, &parameters, &free, &options, &|| false).unwrap();
    let found = refine(&events, begun, "load_ramp", &options, &|| false).parameters[voltage];
    assert!((found - 0.675).abs() < 0.02, "{found}");
}

/// Motors near their pull-out, half of which trip in the deepest dip and come back: fitted without that, the motor is
/// of another kind.
#[test]
fn what_trips_is_found_beside_the_motor_of_its_kind() {
    let plain = Structure::zip_im();
    let truth = ComposedModel::new(&plain.with("motor_undervoltage_trip").unwrap());
    let mut parameters = truth.typical();
    parameters[..3].copy_from_slice(&[3.2, 7.2, 0.7]);
    let own = [
        ("share", 0.5),
        ("trip_voltage", 0.68),
        ("return_voltage", 0.9),
        ("return_time_s", 0.35),
    ];
    for (name, value) in own {
        let place = truth.index(&format!("motor_undervoltage_trip.{name}"));
        parameters[place.unwrap()] = value;
    }
    let events = drawn_by(&truth, &parameters, &events());
    let model = ComposedModel::new(&plain);
    let options = ComposedFitOptions::default();
    let all = fit(&events, &model, &model.typical(), &FREE, &options, &|| {
        false
    })
    .unwrap();
    let base = Baseline {
        structure: plain.clone(),
        ordinary: Some(all.clone()),
        all,
        mild: None,
    };
    let of_every_kind = |base: &Baseline| base.motors_of_every_kind(&events, &options, &|| false);
    let motors = of_every_kind(&base);
    assert_eq!(motors.len(), 18);
    let kind = |load: &ComposedFit| load.parameters[..3].to_vec();
    for (place, load) in motors.iter().enumerate() {
        let mut others = motors[..place].iter();
        assert!(others.all(|other| kind(other) != kind(load)));
        assert_eq!(load.parameters[3..], base.all.parameters[3..]);
    }
    let ground = Ground::new(&events, &plain, &[], &options, &|| false).and_from(&motors);
    let screened = ground.screen("motor_undervoltage_trip").unwrap();
    let found = base.sketched(&ground, &screened, f64::INFINITY).unwrap();
    let from_the_fit = Ground::new(&events, &plain, &base.origins(), &options, &|| false);
    let screened = from_the_fit.screen("motor_undervoltage_trip").unwrap();
    let bent = base.sketched(&from_the_fit, &screened, f64::INFINITY);
    let [found, bent] = [Some(found), bent].map(|fit| fit.unwrap().chi_square_per_row());
    assert!(found < 1.0 && 10.0 * found < bent, "{found} {bent}");

    let content = Baseline {
        ordinary: None,
        ..base
    };
    assert!(of_every_kind(&content).is_empty());
}

/// Five dips, the first two of them mild, with P and Q of a model and a noise of 0.2 % of P0.
fn five_dips(truth: &ComposedModel, parameters: &[f64]) -> Vec<PreparedEvent> {
    let dips = [
        ("a", 0.93, 0.3),
        ("b", 0.85, 0.1),
        ("c", 0.78, 0.2),
        ("d", 0.67, 0.12),
        ("e", 0.6, 0.2),
    ];
    let windows = dips.map(|(name, depth, duration)| window(name, depth, duration));
    let prepared = windows.map(|window| prepare(&window, &IntakeOptions::default()).unwrap());
    let mut events = drawn_by(truth, parameters, &prepared);
    for event in &mut events {
        let deviations = event.active_deviation.iter_mut();
        for deviation in deviations.chain(&mut event.reactive_deviation) {
            *deviation *= 3.0;
        }
    }
    events
}

/// The fits of a structure to all `events` and to the `mild` first of them.
fn fitted_to_mild(structure: &Structure, events: &[PreparedEvent], mild: usize) -> Baseline {
    let model = ComposedModel::new(structure);
    let free: Vec<usize> = (0..model.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let fitted = |events: &[PreparedEvent]| {
        fit(events, &model, &model.typical(), &free, &options, &|| false).unwrap()
    };
    let mild = &events[..mild];
    Baseline {
        structure: structure.clone(),
        ordinary: None,
        all: fitted(events),
        mild: Some((mild.to_vec(), fitted(mild))),
    }
}

/// Motors that trip in the two deepest of five dips and come back, beside a recovery: fitted to all events together, a
/// return at the wrong moment bends everything else to it.
#[test]
fn what_comes_back_is_found_in_one_deep_event_after_another() {
    const RELAY: &str = "motor_undervoltage_trip";
    let fewer = Structure::zip_im().with("exponential_recovery").unwrap();
    let truth = ComposedModel::new(&fewer.with(RELAY).unwrap());
    let place = |name: &str| truth.index(&format!("{RELAY}.{name}")).unwrap();
    let mut parameters = truth.typical();
    let own = [
        ("share", 0.5),
        ("trip_voltage", 0.72),
        ("return_voltage", 0.85),
        ("return_time_s", 0.31),
    ];
    for (name, value) in own {
        parameters[place(name)] = value;
    }
    let events = five_dips(&truth, &parameters);
    let base = fitted_to_mild(&fewer, &events, 3);
    // All events, begun where the motors come back late.
    let mut late = parameters.clone();
    late[place("return_time_s")] = 0.6;
    let options = ComposedFitOptions::default();
    let all: Vec<usize> = (0..truth.parameters().len()).collect();
    let coarse = options.coarse();
    let bent = fit(&events, &truth, &late, &all, &coarse, &|| false).unwrap();
    let from_all = refine(&events, bent.clone(), RELAY, &options, &|| false);
    let found = base.completed(&events, bent, RELAY, &options, &|| false);
    let found = found.unwrap().all;
    let [left, before] = [&found, &from_all].map(ComposedFit::chi_square_per_row);
    assert!(10.0 * left < before, "{left} {before}");
    for (name, value) in own {
        let found = found.parameters[place(name)];
        assert!((found - value).abs() < 0.1 * value, "{name} {found}");
    }
}

/// Motors that trip in the two deepest of five dips and come back, beside a load that leaves in the third as well.
#[test]
fn of_two_relays_the_mildest_event_says_which_is_placed_first() {
    const TRIP: &str = "motor_undervoltage_trip";
    const LEAVES: &str = "self_disconnection";
    let own = [
        (TRIP, "share", 0.5),
        (TRIP, "trip_voltage", 0.72),
        (TRIP, "return_voltage", 0.85),
        (TRIP, "return_time_s", 0.31),
        (LEAVES, "share", 0.15),
        (LEAVES, "voltage", 0.815),
        (LEAVES, "time_s", 0.03),
    ];
    for [first, second] in [[TRIP, LEAVES], [LEAVES, TRIP]] {
        let fewer = Structure::zip_im().with(first).unwrap();
        let truth = ComposedModel::new(&fewer.with(second).unwrap());
        let place = |effect: &str, name: &str| truth.index(&format!("{effect}.{name}")).unwrap();
        let mut parameters = truth.typical();
        for (effect, name, value) in own {
            parameters[place(effect, name)] = value;
        }
        let events = five_dips(&truth, &parameters);
        let base = fitted_to_mild(&fewer, &events, 2);
        // All events, begun where the motors come back late and the load leaves with them.
        let mut bent = parameters.clone();
        bent[place(TRIP, "return_time_s")] = 0.6;
        bent[place(LEAVES, "voltage")] = 0.7;
        let options = ComposedFitOptions::default();
        let all: Vec<usize> = (0..truth.parameters().len()).collect();
        let coarse = options.coarse();
        let bent = fit(&events, &truth, &bent, &all, &coarse, &|| false).unwrap();
        let before = bent.chi_square_per_row();
        let found = base.completed(&events, bent, second, &options, &|| false);
        let found = found.unwrap().all;
        let left = found.chi_square_per_row();
        assert!(20.0 * left < before, "{first} first: {left} {before}");
        // At which voltage they come back, and how late the others leave, these five dips hardly show.
        let shown = ["share", "trip_voltage", "return_time_s", "voltage"];
        for (effect, name, value) in own.iter().filter(|(_, name, _)| shown.contains(name)) {
            let found = found.parameters[place(effect, name)];
            assert!((found - value).abs() < 0.1 * value, "{name} {found}");
        }
    }
}
