//! How a dependence on the frequency compares with the one that every motor has (`frequency_scaled_power`).

use crate::identification::composed::ComposedFit;

/// Share of the motors in P0, which the parameters of every composed model have.
const MOTOR_SHARE: &str = "motor_share";
/// dQ/df of the motors' magnetising currents over P0, per unit, at most: the prior of `frequency_scaled_power`, 0.2 with a
/// deviation of 0.1, and three of these.
const MAGNETISING_MOST: f64 = 0.5;

/// dP/df of an effect over that of the motors, whose torque times frequency is their power (`P` in proportion to `f`), at
/// slow deviations. `None` where the effect is no dependence on the frequency, or follows it in Q as no motor does.
pub(super) fn times_every_motor(effect: &str, fit: &ComposedFit) -> Option<f64> {
    let value = |name: &str| Some(fit.parameters[fit.model.index(name)?]);
    let of = |name: &str| value(&format!("{effect}.{name}"));
    match effect {
        "static_frequency_dependence" => {
            let motors = value(MOTOR_SHARE)?;
            let in_reactive = of("reactive_coefficient")?.abs();
            let in_active = of("active_coefficient")? * (1.0 - motors);
            (in_reactive <= MAGNETISING_MOST).then(|| in_active / motors.max(f64::MIN_POSITIVE))
        }
        // The speed goes with the frequency, and the torque with this power of it.
        "speed_dependent_torque" => of("exponent"),
        _ => None,
    }
}
