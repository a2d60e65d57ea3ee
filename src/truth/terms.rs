//! True values in the estimator's terms, where they exist: parameters on the load base at the mean
//! operating point.

use std::f64::consts::TAU;

use super::{
    Effect, HiddenEffect, MotorCircuit, SiteOptions, SyntheticSite,
    compose::{motor_groups, second_circuit},
};

/// An effect and its true values by name.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectTerms {
    /// The effect.
    pub effect: Effect,
    /// Names with units, and values.
    pub values: Vec<(&'static str, f64)>,
}

/// What an estimator on the load base should find, for every effect where that differs from the
/// effect's own parameters.
#[must_use]
pub fn estimator_terms(site: &SyntheticSite) -> Vec<EffectTerms> {
    let effects = site.options.effects.iter();
    let terms = effects.filter_map(|hidden| {
        let values = values_of(site, hidden)?;
        Some(EffectTerms {
            effect: hidden.effect(),
            values,
        })
    });
    terms.collect()
}

fn values_of(site: &SyntheticSite, hidden: &HiddenEffect) -> Option<Vec<(&'static str, f64)>> {
    let options = &site.options;
    let nominal_rad_s = TAU * options.site.nominal_hz;
    let motors_pu = options.active_pu * options.motor_share;
    let own = |name: &'static str| hidden.value(name);
    match hidden.effect() {
        Effect::StatorResistance => {
            let rating = motors_pu / options.motor.load_factor;
            Some(vec![
                ("resistance_pu", own("resistance_pu") / rating),
                ("resistance_motor_base_pu", own("resistance_pu")),
            ])
        }
        Effect::SecondMotor => {
            let share = options.motor_share * own("share_of_motors");
            let circuit = second_circuit(hidden, &options.motor);
            let on_base = circuit.on_load_base(options.active_pu * share, nominal_rad_s);
            Some(vec![
                ("share", share),
                ("first_share", options.motor_share - share),
                ("M", on_base.inertia),
                ("T0_prime", on_base.transient_open_circuit_time_constant_s),
                ("X", on_base.reactance),
                ("X_prime", on_base.transient_reactance),
            ])
        }
        Effect::MotorUndervoltageTrip => Some(tripping_terms(options, hidden)),
        Effect::DoubleCageRotor => {
            Some(cage_terms(&options.motor, hidden, motors_pu, nominal_rad_s))
        }
        Effect::FrequencyTrip => {
            let sign = if hidden.choice("what") == "load_below" {
                1.0
            } else {
                -1.0
            };
            Some(vec![
                ("share", sign * own("share")),
                ("deviation", own("deviation")),
            ])
        }
        Effect::SpeedDependentTorque => Some(vec![("exponent", exponent(hidden))]),
        Effect::TapChanger => Some(vec![("feeder_reactance_pu", own("reactance_pu"))]),
        // The truth's current is ahead, the estimator's lags.
        Effect::RatioPhaseError => Some(vec![("angle_rad", -own("angle_deg").to_radians())]),
        _ => None,
    }
}

/// The relay, and the parameters of the motors that it is to act on: an estimator has those that trip and those that stay
/// as one motor.
fn tripping_terms(options: &SiteOptions, hidden: &HiddenEffect) -> Vec<(&'static str, f64)> {
    let (staying, _, tripping) = motor_groups(&options.effects);
    let motors_pu = options.active_pu * options.motor_share * (staying + tripping);
    let nominal_rad_s = TAU * options.site.nominal_hz;
    let on_base = options.motor.on_load_base(motors_pu, nominal_rad_s);
    vec![
        ("share", options.motor_share * tripping),
        ("share_of_motors", hidden.value("share_of_motors")),
        ("threshold_pu", hidden.value("threshold_pu")),
        ("delay_s", hidden.value("delay_s")),
        ("M", on_base.inertia),
        ("T0_prime", on_base.transient_open_circuit_time_constant_s),
        ("X", on_base.reactance),
        ("X_prime", on_base.transient_reactance),
    ]
}

/// Reactances and time constants of two rotor circuits in parallel (Kundur, 1994, section 4.2).
fn cage_terms(
    motor: &MotorCircuit,
    hidden: &HiddenEffect,
    motors_pu: f64,
    nominal_rad_s: f64,
) -> Vec<(&'static str, f64)> {
    let parallel = |a: f64, b: f64| a * b / (a + b);
    let rating = motors_pu / motor.load_factor;
    let (xs, xm) = (motor.stator_reactance, motor.magnetising_reactance);
    let (r1, x1) = (
        hidden.value("inner_resistance_pu"),
        hidden.value("inner_reactance_pu"),
    );
    let (r2, x2) = (
        hidden.value("outer_resistance_pu"),
        hidden.value("outer_reactance_pu"),
    );
    let inner = parallel(xm, x1);
    vec![
        ("X", (xs + xm) / rating),
        ("X_prime", (xs + inner) / rating),
        ("X_double_prime", (xs + parallel(inner, x2)) / rating),
        ("T0_prime", (x1 + xm) / (nominal_rad_s * r1)),
        ("T0_double_prime", (x2 + inner) / (nominal_rad_s * r2)),
    ]
}

/// Relative change of the torque over that of the speed, near nominal speed:
/// (2 A + B)/1 at w = 1.
fn exponent(hidden: &HiddenEffect) -> f64 {
    2.0 * hidden.value("quadratic") + hidden.value("linear")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::Site;

    #[test]
    fn two_cages_have_the_reactances_computed_by_hand() {
        // X_s 0.1, X_m 2.2, cages 0.012 + j 0.3 and 0.06 + j 0.1, rating 0.75, 60 Hz:
        // X_m || X_1 = 0.66/2.5 = 0.264, X' = 0.364; 0.264 || 0.1 = 0.0264/0.364 = 0.0725275,
        // X'' = 0.1725275; T0' = 2.5/(376.991 x 0.012) = 0.552621 s,
        // T0'' = 0.364/(376.991 x 0.06) = 0.0160923 s.
        let mut hidden = HiddenEffect::drawn(Effect::DoubleCageRotor, 1);
        for (name, value) in [
            ("inner_resistance_pu", "0.012"),
            ("inner_reactance_pu", "0.3"),
            ("outer_resistance_pu", "0.06"),
            ("outer_reactance_pu", "0.1"),
        ] {
            hidden.set(name, value).unwrap();
        }
        let terms = cage_terms(&MotorCircuit::default(), &hidden, 0.45, 120.0 * TAU / 2.0);
        let expected = [
            2.3 / 0.75,
            0.364 / 0.75,
            0.172_527_5 / 0.75,
            0.552_621,
            0.016_092_3,
        ];
        for ((name, value), expected) in terms.iter().zip(expected) {
            assert!((value - expected).abs() < 1e-6, "{name} {value} {expected}");
        }
    }
    #[test]
    fn motors_that_trip_belong_to_the_motor_that_an_estimator_has() {
        let effects = [
            (Effect::MotorUndervoltageTrip, "0.5"),
            (Effect::SecondMotor, "0.2"),
        ];
        let effects = effects.map(|(effect, share)| {
            let mut hidden = HiddenEffect::drawn(effect, 1);
            hidden.set("share_of_motors", share).unwrap();
            hidden
        });
        let site = Site {
            name: "synthetic".to_owned(),
            s_base_mva: 200.0,
            v_base_kv: 23.0,
            nominal_hz: 60.0,
        };
        let options = SiteOptions {
            effects: effects.to_vec(),
            ..SiteOptions::new(site, 1)
        };
        let terms = tripping_terms(&options, &options.effects[0]);
        let term = |name| terms.iter().find(|(own, _)| *own == name).unwrap().1;
        // Half of the four fifths that are no second motors trip.
        assert!((term("share") - 0.4 * options.motor_share).abs() < 1e-12);
        // Reactances go with one over the power that all of these draw: X_s + X_m on the rating.
        let motor = &options.motor;
        let rating = options.active_pu * options.motor_share * 0.8 / motor.load_factor;
        let reactance = (motor.stator_reactance + motor.magnetising_reactance) / rating;
        assert!((term("X") - reactance).abs() < 1e-9 * reactance);
    }
}
