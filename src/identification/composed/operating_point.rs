//! Amplitudes that do not follow the load: what they are in an event of a given active power.
//!
//! ```text
//! a_e = a P0^-e,   d a_e/d a = P0^-e,   d a_e/d e = -a_e ln P0                      (1)
//! ```

use crate::{
    identification::intake::PreparedEvent,
    load_model::{composed::ComposedModel, effect::Declared, effects},
};

/// Places of `d_z` and `d_i` in a model's vector.
const REACTIVE: std::ops::Range<usize> = 6..8;

/// Places of an amplitude and of its exponent in a model's vector.
#[derive(Clone, Copy, Debug)]
pub(super) struct LoadExponent {
    pub(super) amplitude: usize,
    pub(super) exponent: usize,
}

impl LoadExponent {
    /// The amplitude in an event.
    pub(super) fn amplitude_at(&self, parameters: &[f64], p0_pu: f64) -> f64 {
        parameters[self.amplitude] * self.factor(parameters, p0_pu)
    }

    /// Its derivative with respect to the parameter.
    pub(super) fn factor(&self, parameters: &[f64], p0_pu: f64) -> f64 {
        p0_pu.powf(-parameters[self.exponent])
    }

    /// Its derivative with respect to the exponent.
    pub(super) fn exponent_slope(&self, parameters: &[f64], p0_pu: f64) -> f64 {
        -self.amplitude_at(parameters, p0_pu) * p0_pu.ln()
    }
}

/// The amplitudes of a model that have an exponent.
pub(super) fn load_exponents(model: &ComposedModel) -> Vec<LoadExponent> {
    let mut list = Vec::new();
    for (exponent, parameter) in model.parameters().iter().enumerate() {
        let Some(effect) = parameter.effect else {
            continue;
        };
        let Some([amplitude, own]) = effects::find(effect).and_then(Declared::load_exponent) else {
            continue;
        };
        if parameter.declaration.name != own {
            continue;
        }
        if let Some(amplitude) = model.index(&format!("{effect}.{amplitude}")) {
            list.push(LoadExponent {
                amplitude,
                exponent,
            });
        }
    }
    list
}

/// The parameters of a model on the base of an event, and the derivative of each with respect to the
/// declared one; amplitudes with an exponent have theirs from [`LoadExponent`] instead.
pub(super) fn at_operating_point(
    model: &ComposedModel,
    parameters: &[f64],
    event: &PreparedEvent,
) -> (Vec<f64>, Vec<f64>) {
    let (mut own, slopes) = model.on_event_base(parameters, event.v0_pu, event.p0_pu);
    scale(model, parameters, event.p0_pu, &mut own);
    for (value, offset) in own[REACTIVE].iter_mut().zip(event.reactive_offset) {
        *value += offset;
    }
    (own, slopes)
}

fn scale(model: &ComposedModel, parameters: &[f64], p0_pu: f64, own: &mut [f64]) {
    for e in load_exponents(model) {
        own[e.amplitude] = e.amplitude_at(parameters, p0_pu);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load_model::Structure;

    #[test]
    fn generation_that_stays_is_a_larger_share_of_a_smaller_load() {
        let model =
            ComposedModel::new(&Structure::zip_im().with("distributed_generation").unwrap());
        let mut parameters = model.typical();
        let [pair] = load_exponents(&model)[..] else {
            panic!("one exponent");
        };
        parameters[pair.amplitude] = 0.2;
        for (exponent, expected) in [(0.0, 0.2), (1.0, 0.25)] {
            parameters[pair.exponent] = exponent;
            let mut own = parameters.clone();
            scale(&model, &parameters, 0.8, &mut own);
            assert!((own[pair.amplitude] - expected).abs() < 1e-12);
        }
        let slope = pair.exponent_slope(&parameters, 0.8);
        parameters[pair.exponent] -= 1e-6;
        let difference = (0.25 - pair.amplitude_at(&parameters, 0.8)) / 1e-6;
        assert!((slope - difference).abs() < 1e-6);
    }
}
