//! Named estimates of a composed fit: the coordinates of ZIP and motor as for the plain model, and
//! every parameter of the effects.

use nalgebra::DMatrix;

use super::{
    OperatingPoint, ParameterEstimate,
    composed::ComposedFit,
    estimates::{Estimates, Located, estimates_at},
    joint_problem::ProblemOptions,
    precision::{Precision, SIZE},
};
use crate::load_model::{
    composed::ModelParameter,
    effect::{Declaration, Role, Scale},
    effects,
};

/// A parameter within this share of its range of a bound lies on it.
const AT_BOUND: f64 = 1e-6;
/// A parameter counts as determined when its standard error is below this share of its range.
const DETERMINED_SHARE: f64 = 0.25;

/// Names the parameters of a composed fit at an operating point.
pub(super) fn composed_estimates(
    fit: &ComposedFit,
    options: &ProblemOptions,
    operating_point: &OperatingPoint,
    nominal_hz: f64,
) -> (Estimates, Precision) {
    let OperatingPoint { v0_pu, p0_pu, .. } = *operating_point;
    let (own, slopes) = fit.model.on_event_base(&fit.parameters, v0_pu, p0_pu);
    let precision = precision(fit, &slopes);
    let parameters = fit.model.parameters();
    let located = Located {
        coordinates: own[..SIZE].to_vec(),
        held: (0..SIZE)
            .map(|i| at_bound(&parameters[i], fit.parameters[i]))
            .collect(),
    };
    let mut estimates = estimates_at(&located, options, operating_point, nominal_hz, &precision);
    let scale = precision.inflation[0];
    for (index, parameter) in parameters.iter().enumerate().skip(SIZE) {
        let estimate = effect_estimate(fit, index, parameter, scale);
        estimates.parameters.push(estimate);
    }
    let effects: Vec<&str> = fit.model.effect_names().collect();
    let unseparated = unseparated(&effects, &estimates.parameters);
    estimates.notes.extend(unseparated);
    (estimates, precision)
}

/// Pairs of effects that resemble each other where an amplitude of one is not determined, in words.
fn unseparated(names: &[&str], parameters: &[ParameterEstimate]) -> Vec<String> {
    let found: Vec<_> = names
        .iter()
        .filter_map(|name| effects::find(name))
        .collect();
    let open = |declared: &Declaration| {
        let first = declared.parameters.iter().find(|p| p.is_amplitude())?;
        let name = format!("{}.{}", declared.name, first.name);
        let estimate = parameters.iter().find(|p| p.name == name)?;
        estimate.standard_error.is_none().then_some(name)
    };
    let mut notes = Vec::new();
    for (k, one) in found.iter().enumerate() {
        for other in &found[k + 1..] {
            let (one, other) = (one.declaration(), other.declaration());
            let Some(name) = open(other).or_else(|| open(one)) else {
                continue;
            };
            if one.is_like(other) {
                notes.push(format!(
                    "{} and {} describe much the same, and these events do not separate them: {name} is not determined; \
                     the values of both hold together only",
                    one.name, other.name
                ));
            }
        }
    }
    notes
}

/// The parameters of one effect in a composed fit; none where the model has no such effect.
#[must_use]
pub fn composed_parameters(fit: &ComposedFit, effect: &str) -> Vec<ParameterEstimate> {
    let scale = fit.chi_square_per_row().max(1.0).sqrt();
    let own = fit.model.parameters().iter().enumerate();
    own.filter(|(_, p)| p.effect == Some(effect))
        .map(|(index, parameter)| effect_estimate(fit, index, parameter, scale))
        .collect()
}

fn effect_estimate(
    fit: &ComposedFit,
    index: usize,
    parameter: &ModelParameter,
    scale: f64,
) -> ParameterEstimate {
    let declared = parameter.declaration;
    let value = fit.parameters[index];
    let counts = declared.role == Role::Count;
    let at_bound = !counts && at_bound(parameter, value);
    let error = fit.standard_error(index);
    let error = error.map(|error| (scale * error).hypot(declared.resolution));
    let width = match declared.prior.scale {
        Scale::Linear => declared.upper - declared.lower,
        Scale::Logarithmic => value * (declared.upper / declared.lower).ln(),
    };
    let determined = !at_bound && error.is_some_and(|e| e < DETERMINED_SHARE * width);
    let what = match declared.role {
        _ if index == fit.model.static_lag() => "lag of the static load",
        Role::OneSidedAmplitude { .. } | Role::TwoSidedAmplitude { .. } => "amplitude",
        Role::Shape => "shape",
        Role::Count => "whole number",
        Role::Shared => "shared by several effects",
        Role::Base => "of ZIP and motor",
    };
    ParameterEstimate {
        name: parameter.name.clone(),
        meaning: format!("{} ({what})", declared.symbol),
        value,
        unit: declared.unit.to_owned(),
        lower: declared.lower,
        upper: declared.upper,
        standard_error: error.filter(|_| determined),
        at_bound,
        // One is what is taken where nothing speaks for more.
        identifiable: determined || counts && value > declared.lower,
        interval: None,
    }
}

fn at_bound(parameter: &ModelParameter, value: f64) -> bool {
    let declared = parameter.declaration;
    let close = AT_BOUND * (declared.upper - declared.lower);
    value - declared.lower <= close || declared.upper - value <= close
}

/// Covariance of the eight coordinates of ZIP and motor, effects free, on a base whose derivatives with
/// respect to the declared values are `slopes`; where the fit is worse than the noise, errors grow with it.
fn precision(fit: &ComposedFit, slopes: &[f64]) -> Precision {
    let scale = fit.chi_square_per_row().max(1.0).sqrt();
    let unknown = DMatrix::from_element(SIZE, SIZE, f64::NAN);
    let covariance = fit.covariance.as_ref().map_or(unknown, |all| {
        let place = |i: usize| fit.free.iter().position(|f| *f == i);
        DMatrix::from_fn(SIZE, SIZE, |i, j| match (place(i), place(j)) {
            (Some(a), Some(b)) => scale * scale * slopes[i] * all[(a, b)] * slopes[j],
            _ => 0.0,
        })
    });
    let (rank, condition) = rank_and_condition(fit);
    Precision {
        covariance,
        rank,
        condition,
        inflation: [scale; SIZE],
        events: 0,
    }
}

/// Rank and condition of the sensitivities of all free parameters, scaled to equal length.
fn rank_and_condition(fit: &ComposedFit) -> (usize, f64) {
    let Some(covariance) = &fit.covariance else {
        return (0, f64::INFINITY);
    };
    let size = covariance.nrows();
    let root = |i: usize| covariance[(i, i)].sqrt();
    let scaled = DMatrix::from_fn(size, size, |i, j| covariance[(i, j)] / (root(i) * root(j)));
    let eigenvalues = scaled.symmetric_eigenvalues();
    let (least, largest) = (eigenvalues.min(), eigenvalues.max());
    (size, (largest / least.max(f64::MIN_POSITIVE)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn amplitude(name: &str, standard_error: Option<f64>) -> ParameterEstimate {
        ParameterEstimate {
            name: name.to_owned(),
            meaning: String::new(),
            value: 0.1,
            unit: "1".to_owned(),
            lower: 0.0,
            upper: 1.0,
            standard_error,
            at_bound: false,
            identifiable: standard_error.is_some(),
            interval: None,
        }
    }

    #[test]
    fn a_pair_that_is_not_separated_has_a_note() {
        let names = [
            "self_disconnection",
            "electronic_load_dropout",
            "tap_changer",
        ];
        let told = |errors: [Option<f64>; 3]| {
            let of = |(name, error): (&&str, Option<f64>)| {
                let own = effects::find(name)?.declaration().parameters.iter();
                let first = own.clone().find(|p| p.is_amplitude())?;
                Some(amplitude(&format!("{name}.{}", first.name), error))
            };
            let list: Vec<_> = names.iter().zip(errors).filter_map(of).collect();
            unseparated(&names, &list)
        };
        let known = Some(0.01);
        assert!(told([known; 3]).is_empty());
        // The tap changer resembles neither.
        assert!(told([known, known, None]).is_empty());
        for errors in [[known, None, known], [None, known, known]] {
            let notes = told(errors);
            assert_eq!(notes.len(), 1, "{notes:?}");
            let both = "self_disconnection and electronic_load_dropout describe much the same";
            assert!(notes[0].starts_with(both), "{notes:?}");
        }
    }
}
