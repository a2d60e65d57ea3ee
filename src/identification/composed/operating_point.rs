//! What parameters of the site are at the operating point of an event: amplitudes that do not follow the load (1), the
//! composition beside them (2), and what goes with Q0/P0.
//!
//! ```text
//! a_e = a P0^-e,   d a_e/d a = P0^-e,   d a_e/d e = -a_e ln P0                      (1)
//! ```

use crate::{
    identification::intake::{PreparedEvent, SiteReference},
    load_model::{
        composed::{AtLoad, ComposedModel},
        effect::Declared,
        effects,
    },
};

/// First of the linear coefficients in a composed model's vector.
pub(super) const LINEAR_FIRST: usize = 3;
/// Linear coefficients: motor share, `c_z`, `c_i`, `d_z`, `d_i`.
pub(super) const LINEAR_COUNT: usize = 5;

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

/// Places of the parameters that are changes by Q0/P0.
fn by_reactive_ratio(model: &ComposedModel) -> impl Iterator<Item = usize> + '_ {
    model.effect_names().filter_map(|effect| {
        let name = effects::find(effect)?.by_reactive_ratio()?;
        model.index(&format!("{effect}.{name}"))
    })
}

/// The whole load, which is what is measured and what amplitudes with an exponent feed, over P0, in an event and at the
/// operating point of the site: shares of the whole load stay.
///
/// ```text
/// x_e = x (1 + sum a_e)/(1 + sum a_s)   for x of Kpm, c_z, c_i, d_z, d_i             (2)
/// ```
#[derive(Clone, Copy, Debug)]
pub(super) struct WholeLoad {
    event: f64,
    site: f64,
}

impl WholeLoad {
    pub(super) fn new(
        exponents: &[LoadExponent],
        parameters: &[f64],
        p0_pu: f64,
        site: &SiteReference,
    ) -> Self {
        let whole = |p0_pu: f64| {
            let fed = exponents.iter().map(|e| e.amplitude_at(parameters, p0_pu));
            1.0 + fed.sum::<f64>()
        };
        Self {
            event: whole(p0_pu),
            site: whole(site.p0_pu),
        }
    }

    /// What (2) multiplies by; exactly 1 where nothing is fed.
    fn ratio(&self) -> f64 {
        self.event / self.site
    }

    /// Derivative of its logarithm, given those of what is fed in the event and at the site.
    pub(super) fn logarithmic_slope(&self, event: f64, site: f64) -> f64 {
        event / self.event - site / self.site
    }
}

/// The linear coefficients of a model with the reactive ones as far as they go with the whole load.
pub(super) fn of_whole_load(parameters: &[f64], site: &SiteReference) -> [f64; LINEAR_COUNT] {
    let mut own: [f64; LINEAR_COUNT] = std::array::from_fn(|l| parameters[LINEAR_FIRST + l]);
    for (value, slope) in own[LINEAR_COUNT - 2..].iter_mut().zip(site.slopes) {
        *value -= slope * site.ratio;
    }
    own
}

/// The parameters of a model on the base of an event, and the derivative of each with respect to the
/// declared one; amplitudes with an exponent have theirs from [`LoadExponent`] instead.
pub(super) fn at_operating_point(
    model: &ComposedModel,
    parameters: &[f64],
    event: &PreparedEvent,
) -> (Vec<f64>, Vec<f64>) {
    let (mut own, mut slopes) = model.on_event_base(parameters, event.v0_pu, event.p0_pu);
    let exponents = load_exponents(model);
    for e in &exponents {
        own[e.amplitude] = e.amplitude_at(parameters, event.p0_pu);
    }
    for (value, offset) in own[REACTIVE].iter_mut().zip(event.reactive_offset) {
        *value += offset;
    }
    for place in by_reactive_ratio(model) {
        let ratio = event.q0_pu / event.p0_pu;
        let change = event.site.map_or(0.0, |site| ratio - site.ratio);
        own[place] *= change;
        slopes[place] = change;
    }
    if let Some(site) = &event.site
        && !exponents.is_empty()
    {
        let ratio = WholeLoad::new(&exponents, parameters, event.p0_pu, site).ratio();
        let whole = of_whole_load(parameters, site);
        for (place, value) in (LINEAR_FIRST..).zip(whole) {
            own[place] += (ratio - 1.0) * value;
            slopes[place] *= ratio;
        }
    }
    (own, slopes)
}

/// How the reactive coefficients of an event go with what a load behind a feeder draws.
pub(super) fn at_load(event: &PreparedEvent) -> Option<AtLoad> {
    let admittance = |v0_pu: f64, p0_pu: f64| p0_pu / (v0_pu * v0_pu);
    event.site.map(|site| AtLoad {
        slopes: site.slopes,
        site_reactive_at_rest: site.ratio,
        site_admittance_ratio: admittance(site.v0_pu, site.p0_pu)
            / admittance(event.v0_pu, event.p0_pu),
    })
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
            assert!((pair.amplitude_at(&parameters, 0.8) - expected).abs() < 1e-12);
        }
        let slope = pair.exponent_slope(&parameters, 0.8);
        parameters[pair.exponent] -= 1e-6;
        let difference = (0.25 - pair.amplitude_at(&parameters, 0.8)) / 1e-6;
        assert!((slope - difference).abs() < 1e-6);
    }
}
