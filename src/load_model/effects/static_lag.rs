//! The static load behind a lag: for the moment an admittance, a few milliseconds later what ZIP says.
//!
//! No static load draws constant power or constant current by itself: a controller keeps it there, and until that has
//! acted the load is the admittance that it was. The ZIP part of every composed model has this lag; it is no effect of
//! the catalogue and is never named as missing. Simulators have it as the lag of the load's voltage measurement.
//!
//! Missing, it leaves a spike of a sample or two at every jump of the voltage, in which P is too high as the voltage falls and too low as it returns.
//! A stator resistance stands in for it then.
//!
//! With `z` the voltage seen through the lag and `k`, `c_i` the constant-power and constant-current parts (of Q:
//! likewise), the static power is `(v/z)^2 f(z)` with `f(z) = k + c_i z + c_z z^2`, which is `f(v)` and
//!
//! ```text
//! T dz/dt = v - z                                        (1)
//! dP = k ((v/z)^2 - 1) + c_i v (v/z - 1)                 (2)
//! ```
//!
//! more (`composed::static_lag`). The constant-impedance part does not notice. Valid while `v/z` stays below 3; it is held there.
//!
//! Behind a feeder the step that finds the load's voltage holds `z`: at a lag of nothing, derivatives there are those of a
//! lag shorter than the step, which differ by some thousandths near jumps. Values are not touched.
//!
//! Source: the load model `vfd_load` of RAMSES (STEPSS) by its manual, shown by running it (`docs/known-limits.md`); no
//! measurement of a real load.

use crate::{
    load_model::effect::{
        Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Prior, Scale,
    },
    numerics::Elementary,
};

/// The lag of the static load.
#[derive(Clone, Copy, Debug)]
pub(super) struct StaticLag;

/// `T`, absent unless a fit says so. The upper bound is chosen: a longer
/// lag lasts into the decay of a motor's flux and stands in for a stator resistance.
pub(super) const STATIC_LAG: Parameter = Parameter {
    prior: Prior {
        centre: 0.0,
        deviation: 0.003,
        scale: Scale::Linear,
    },
    ..Parameter::one_sided(["static_lag_s", "T", "s"], [0.0, 0.006, 0.001])
};

const DECLARATION: Declaration = Declaration {
    name: "static_lag",
    title: "Static load behind a lag",
    kind: Kind::Physics,
    version: 1,
    parameters: &[STATIC_LAG],
    states: &[],
    acts_on: &[Place::StaticLag],
    excludes: &[],
    resembles: &["stator_resistance"],
    needs: Needs {
        separating_event: "an edge steeper than a frame",
        ..Needs::A_DIP
    },
    source: "RAMSES (STEPSS), vfd_load (verified by running it)",
};

impl Declared for StaticLag {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for StaticLag {
    fn static_lag_s(&self, p: &[S]) -> S {
        p[0]
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    /// P of a load without a motor to speak of, half a millisecond after a step from 1 to 0.8 and later, with the lag and
    /// without.
    #[test]
    fn after_a_step_the_load_is_an_admittance_and_then_what_zip_says() {
        let step = |t: f64| [if t < 0.5 { 1.0 } else { 0.8 }, 0.0];
        let input = lasting(1.0, step, &[0.5]);
        let model = ComposedModel::new(&Structure::zip_im());
        let mut p = model.neutral();
        // K 0.02, c_z 0.2, c_i 0.3: k = 0.48.
        [p[3], p[4], p[5]] = [0.02, 0.2, 0.3];
        let drive = Drive::new(&input, &[], 0.3);
        let without = model.simulate(&p, &[], &drive).unwrap();
        let lag = model.index("static_lag_s").unwrap();
        p[lag] = 0.01;
        let with = model.simulate(&p, &[], &drive).unwrap();
        let time_s = |k: usize| {
            let points = input.output_points();
            points[k] as f64 / input.points_per_sample as f64 * input.sample_interval_s
        };
        let mut seen = 0;
        for k in 0..input.output_count() {
            let t = time_s(k);
            if !(0.503..0.56).contains(&t) {
                continue;
            }
            // z = 0.8 + 0.2 e^(-(t - 0.5)/T); the jump is spread over 1 ms.
            let z = 0.8 + 0.2 * (-(t - 0.5) / 0.01).exp();
            let ratio = 0.8 / z;
            let expected = 0.48 * (ratio * ratio - 1.0) + 0.3 * 0.8 * (ratio - 1.0);
            let found = with.active[k] - without.active[k];
            assert!((found - expected).abs() < 0.01, "{t}: {found} {expected}");
            seen += 1;
        }
        assert!(seen >= 3, "{seen}");
        let last = with.active.len() - 1;
        assert!((with.active[last] - without.active[last]).abs() < 1e-9);
    }

    #[test]
    fn derivatives_by_the_lag_agree_with_differences_also_where_it_is_short() {
        let dip = |t: f64| [if (0.5..0.6).contains(&t) { 0.7 } else { 1.0 }, 0.0];
        let input = lasting(1.0, dip, &[0.5, 0.6]);
        let model = ComposedModel::new(&Structure::zip_im());
        let lag = model.index("static_lag_s").unwrap();
        let drive = Drive::new(&input, &[], 0.3);
        for time_s in [0.0, 1e-6, 0.002, 0.008] {
            let mut p = model.typical();
            p[lag] = time_s;
            let own = model.simulate(&p, &[lag], &drive).unwrap();
            let step = if time_s > 0.0 { 1e-4 * time_s } else { 1e-9 };
            p[lag] = time_s + step;
            let above = model.simulate(&p, &[], &drive).unwrap();
            let rows = own.active_derivatives[0].iter().zip(&above.active);
            for ((derivative, above), value) in rows.zip(&own.active) {
                let difference = (above - value) / step;
                let scale = 1.0 + difference.abs();
                assert!(
                    (derivative - difference).abs() < 2e-3 * scale,
                    "{time_s}: {derivative} {difference}"
                );
            }
        }
    }
}
