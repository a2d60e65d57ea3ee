//! Where the derivative columns of an event's rows come from: by a parameter itself, or by what it moves besides.

use super::operating_point::{
    LINEAR_COUNT, LINEAR_FIRST, LoadExponent, WholeLoad, load_exponents, of_whole_load,
};
use crate::{identification::intake::PreparedEvent, load_model::composed::ComposedModel};

/// Where derivative columns come from.
pub(super) struct Sources {
    /// The parameters by which the simulation gives derivatives.
    pub(super) simulated: Vec<usize>,
    /// Of every column the places among those, and what each is multiplied by; none for what is not simulated.
    pub(super) columns: Vec<Vec<(usize, f64)>>,
}

impl Sources {
    /// Of the columns by the parameters `wanted`.
    pub(super) fn new(
        (model, parameters): (&ComposedModel, &[f64]),
        wanted: &[usize],
        event: &PreparedEvent,
    ) -> Self {
        let exponents = load_exponents(model);
        let delay = model.delay();
        let terms: Vec<Vec<(usize, f64)>> = (wanted.iter())
            .map(|&index| match index {
                _ if Some(index) == delay => Vec::new(),
                _ => (exponents.iter())
                    .find(|e| index == e.amplitude || index == e.exponent)
                    .map_or_else(
                        || vec![(index, 1.0)],
                        |e| of_amplitude(e, index == e.exponent, &exponents, parameters, event),
                    ),
            })
            .collect();
        let mut simulated: Vec<usize> = Vec::with_capacity(wanted.len());
        for (source, _) in terms.iter().flatten() {
            if !simulated.contains(source) {
                simulated.push(*source);
            }
        }
        let place = |(source, factor): &(usize, f64)| {
            let found = simulated.iter().position(|i| i == source);
            found.map(|place| (place, *factor))
        };
        let columns = terms.iter().map(|t| t.iter().filter_map(place).collect());
        Self {
            columns: columns.collect(),
            simulated,
        }
    }
}

/// What an amplitude, or its exponent, moves: what is fed in the event, and with it the composition of what is measured.
fn of_amplitude(
    e: &LoadExponent,
    is_exponent: bool,
    exponents: &[LoadExponent],
    parameters: &[f64],
    event: &PreparedEvent,
) -> Vec<(usize, f64)> {
    let slope = |p0_pu: f64| {
        if is_exponent {
            e.exponent_slope(parameters, p0_pu)
        } else {
            e.factor(parameters, p0_pu)
        }
    };
    let mut terms = vec![(e.amplitude, slope(event.p0_pu))];
    if let Some(site) = &event.site {
        let whole = WholeLoad::new(exponents, parameters, event.p0_pu, site);
        let by = whole.logarithmic_slope(slope(event.p0_pu), slope(site.p0_pu));
        let linear = of_whole_load(parameters, site);
        let linear = (LINEAR_FIRST..LINEAR_FIRST + LINEAR_COUNT).zip(linear);
        terms.extend(linear.map(|(place, value)| (place, by * value)));
    }
    terms
}
