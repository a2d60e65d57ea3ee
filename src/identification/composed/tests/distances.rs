//! How far what another load does is from what a fit foretells.

use super::{drawn_by, thresholds::steep_dips};
use crate::{
    identification::{
        composed::{ComposedFit, ComposedFitOptions, Foretold, Open, Scatter, answer, fit, refine},
        evaluate::Curves,
        intake::PreparedEvent,
    },
    load_model::{Structure, composed::ComposedModel},
};

const EFFECT: &str = "self_disconnection";

/// A load of which a part leaves below 0.73 of the voltage, and the fit to its dips to 0.85, 0.6 and 0.75.
fn fitted() -> (ComposedModel, Vec<f64>, ComposedFit, Open) {
    let truth = ComposedModel::new(&Structure::zip_im().with(EFFECT).unwrap());
    let mut parameters = truth.typical();
    parameters[truth.index(&format!("{EFFECT}.voltage")).unwrap()] = 0.73;
    let events = drawn_by(&truth, &parameters, &steep_dips([0.85, 0.6, 0.75]));
    let free: Vec<usize> = (0..truth.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let begun = fit(&events, &truth, &parameters, &free, &options, &|| false).unwrap();
    let found = refine(&events, begun, EFFECT, &options, &|| false);
    let open = Open::of(&events, &found, EFFECT, &Scatter::default());
    (truth, parameters, found, open)
}

/// How far what was measured is from what a fit foretells.
fn distance(event: &PreparedEvent, fit: &ComposedFit, open: &Open) -> f64 {
    let measured = Curves {
        active: event.active.clone(),
        reactive: event.reactive.clone(),
    };
    let foretold = Foretold::new(event, fit, open, &Scatter::default()).unwrap();
    foretold.distance(&measured).unwrap()
}

#[test]
fn what_events_leave_open_is_no_distance() {
    let (truth, parameters, found, open) = fitted();
    let [between, below, _] = steep_dips([0.7, 0.5, 0.9]);
    // The fit has its threshold at 0.675, below the dip, and may have it above.
    let drawn = &drawn_by(&truth, &parameters, &[between])[0];
    let far = distance(drawn, &found, &Open::default());
    let near = distance(drawn, &found, &open);
    assert!(far > 1e3 && near < 0.05 * far, "{near} of {far}");
    // Load that does not leave at 0.5 is another one.
    let mut staying = parameters.clone();
    staying[truth.index(&format!("{EFFECT}.share")).unwrap()] = 0.0;
    let drawn = &drawn_by(&truth, &staying, &[below])[0];
    let other = distance(drawn, &found, &open);
    // Shares vary by 6 % of themselves between events, and were seen in one.
    assert!(other > 100.0, "{}", other);
}

#[test]
fn a_standard_error_of_a_parameter_is_a_distance_of_one_at_most() {
    let (_, _, found, open) = fitted();
    let [event, ..] = steep_dips([0.55, 0.8, 0.9]);
    let foretold = Foretold::new(&event, &found, &open, &Scatter::default()).unwrap();
    let squares =
        |parameters: &[f64]| foretold.distance(&answer(&event, &found.model, parameters)?);
    let itself = squares(&found.parameters).unwrap();
    assert!(itself < 1e-9, "{itself}");
    let covariance = found.covariance.clone().unwrap();
    for place in 0..found.free.len() {
        let parameter = &found.model.parameters()[found.free[place]];
        if parameter.effect == Some(EFFECT) && !parameter.declaration.is_amplitude() {
            continue;
        }
        let deviation = covariance[(place, place)].sqrt();
        let mut moved = found.parameters.clone();
        for (other, index) in found.free.iter().enumerate() {
            // A tenth, within which the model is linear.
            moved[*index] += 0.1 * covariance[(other, place)] / deviation;
        }
        if let Some(squares) = squares(&moved) {
            assert!(squares < 0.015, "{}: {squares}", parameter.name);
        }
    }
}
