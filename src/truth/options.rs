//! What a synthetic site shall be like, and whether that is possible.

use super::{
    Effect, HiddenEffect, IntegratorOptions, MotorCircuit, Network, Random, TruthError, Zip,
    plan::RETAINED,
};
use crate::measurement::Site;

/// Longest window, seconds.
const DURATION_MAX_S: f64 = 600.0;
/// Share of P0 that shall stay with the static load.
const STATIC_LEFT: f64 = 0.15;
/// Share of P0 that shall stay with motors.
const MOTORS_LEFT: f64 = 0.1;
/// Part of the random numbers that the variation of sites uses.
const VARIED_PART: u64 = 2_000_000;

/// What a synthetic site shall be like.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteOptions {
    /// The site and its bases.
    pub site: Site,
    /// Seed of every random number.
    pub seed: u64,
    /// Number of events, 1 to 99; default 11.
    pub events: usize,
    /// Reports per second, 10 to 240; default 60.
    pub rate_fps: f64,
    /// Length of a window, 4 to 600 s; default 10, longer where an effect is slow.
    pub duration_s: f64,
    /// Relative noise of the phasors, 0 to 0.05; default 0.0005.
    pub noise: f64,
    /// Width of the PMU's window in nominal cycles, 0 to 6, 0 for none; default 2.
    pub filter_cycles: f64,
    /// Mean active power of the load, pu, 0.05 to 2; default 0.9.
    pub active_pu: f64,
    /// Mean reactive power of the load, pu, -1 to 2; default 0.45.
    pub reactive_pu: f64,
    /// Half-width of the range of the operating point, 0 to 0.5; default 0.12.
    pub level_spread: f64,
    /// Range of the voltage before an event, pu, within 0.8 to 1.2; default 0.985 to 1.005.
    pub voltage_range_pu: (f64, f64),
    /// Standard deviation of the motor's share and of the ZIP shares from event to event, 0 to 0.2;
    /// default 0.02.
    pub composition_spread: f64,
    /// Whether some events hold bad samples; default yes.
    pub bad_samples: bool,
    /// Share of P that motors draw before an event, 0 to 0.95; default 0.45.
    pub motor_share: f64,
    /// The motors, on their own base.
    pub motor: MotorCircuit,
    /// The static load.
    pub zip: Zip,
    /// What is hidden in it.
    pub effects: Vec<HiddenEffect>,
    /// Whether events are such that the effects show; default yes.
    pub excited: bool,
    /// Voltage that the deepest and the mildest fault retain, 0.3 to 0.96; default 0.50 and 0.92. An
    /// effect with a threshold puts its dips on both sides of that instead.
    pub retained: (f64, f64),
    /// The grid.
    pub network: Network,
    /// Accuracy of the integration.
    pub integrator: IntegratorOptions,
}

impl SiteOptions {
    /// The defaults for `site` and `seed`.
    #[must_use]
    pub fn new(site: Site, seed: u64) -> Self {
        Self {
            site,
            seed,
            events: 11,
            rate_fps: 60.0,
            duration_s: 10.0,
            noise: 5e-4,
            filter_cycles: 2.0,
            active_pu: 0.9,
            reactive_pu: 0.45,
            level_spread: 0.12,
            voltage_range_pu: (0.985, 1.005),
            composition_spread: 0.02,
            bad_samples: true,
            motor_share: 0.45,
            motor: MotorCircuit::default(),
            zip: Zip {
                active_impedance: 0.35,
                active_current: 0.35,
                reactive_impedance: 0.6,
                reactive_current: 0.2,
            },
            effects: Vec::new(),
            excited: true,
            retained: RETAINED,
            network: Network::default(),
            integrator: IntegratorOptions::default(),
        }
    }

    /// A site that is not like the others: motors, grid, shares and operating point drawn from what
    /// `seed` gives, within what industrial, commercial and residential loads have.
    #[must_use]
    pub fn varied(site: Site, seed: u64) -> Self {
        let mut random = Random::for_part(seed, VARIED_PART);
        let mut draw = |low: f64, high: f64| random.between(low, high);
        let active_impedance = draw(0.2, 0.6);
        let reactive_impedance = draw(0.5, 0.9);
        let active_pu = draw(0.7, 0.95);
        Self {
            active_pu,
            reactive_pu: active_pu * draw(0.2, 0.5),
            motor_share: draw(0.3, 0.65),
            motor: MotorCircuit {
                stator_resistance: 0.0,
                stator_reactance: draw(0.08, 0.12),
                magnetising_reactance: draw(2.2, 3.8),
                rotor_resistance: draw(0.014, 0.028),
                rotor_reactance: draw(0.10, 0.16),
                inertia_s: draw(0.35, 0.9),
                load_factor: draw(0.6, 0.78),
            },
            zip: Zip {
                active_impedance,
                active_current: draw(0.1, 0.9 - active_impedance),
                reactive_impedance,
                reactive_current: draw(0.0, 0.95 - reactive_impedance),
            },
            network: Network {
                grid_reactance: draw(0.09, 0.15),
                transformer_reactance: draw(0.04, 0.08),
                local_share: draw(0.25, 0.5),
                ..Network::default()
            },
            ..Self::new(site, seed)
        }
    }

    /// Hides `effects`, with a window long enough for the slowest of them.
    #[must_use]
    pub fn hiding(mut self, effects: Vec<HiddenEffect>) -> Self {
        let needed = effects.iter().map(window_s).fold(self.duration_s, f64::max);
        self.duration_s = needed.min(DURATION_MAX_S);
        self.effects = effects;
        self
    }

    /// Takes from the motors' share what the static load needs beside effects that take shares of
    /// P0 themselves.
    #[must_use]
    pub fn leaving_room(mut self) -> Self {
        let taken: f64 = self.effects.iter().map(share_of_static).sum();
        let room = (1.0 - STATIC_LEFT - taken).max(MOTORS_LEFT);
        self.motor_share = self.motor_share.min(room);
        self
    }

    pub(super) fn check(&self) -> Result<(), TruthError> {
        check_effects(&self.effects)?;
        let mut effects = self.effects.iter().map(HiddenEffect::effect);
        if let Some(effect) = effects.find(|effect| effect.is_of_motors())
            && self.motor_share <= 0.0
        {
            let (effect, motor_share) = (effect.name(), self.motor_share);
            return Err(TruthError::NoMotors {
                effect,
                motor_share,
            });
        }
        let ranges = self
            .measurement_ranges()
            .into_iter()
            .chain(self.load_ranges())
            .chain(self.motor_ranges());
        for (option, given, low, high, required) in ranges {
            if !(low..=high).contains(&given) {
                return Err(TruthError::OptionOutOfRange {
                    option,
                    given,
                    required,
                });
            }
        }
        Ok(())
    }

    fn measurement_ranges(&self) -> [Range; 8] {
        let site = &self.site;
        [
            ("events", self.events as f64, 1.0, 99.0, "1 to 99"),
            ("rate", self.rate_fps, 10.0, 240.0, "10 to 240 frames/s"),
            (
                "duration",
                self.duration_s,
                4.0,
                DURATION_MAX_S,
                "4 to 600 s",
            ),
            ("noise", self.noise, 0.0, 0.05, "0 to 0.05"),
            ("filter cycles", self.filter_cycles, 0.0, 6.0, "0 to 6"),
            (
                "nominal frequency",
                site.nominal_hz,
                16.0,
                400.0,
                "16 to 400 Hz",
            ),
            (
                "power base",
                site.s_base_mva,
                1e-6,
                1e6,
                "0.000001 to 1000000 MVA",
            ),
            (
                "voltage base",
                site.v_base_kv,
                1e-3,
                2e3,
                "0.001 to 2000 kV",
            ),
        ]
    }

    fn load_ranges(&self) -> [Range; 10] {
        [
            ("active power", self.active_pu, 0.05, 2.0, "0.05 to 2 pu"),
            ("reactive power", self.reactive_pu, -1.0, 2.0, "-1 to 2 pu"),
            ("level spread", self.level_spread, 0.0, 0.5, "0 to 0.5"),
            (
                "lowest voltage before an event",
                self.voltage_range_pu.0,
                0.8,
                1.2,
                "0.8 to 1.2 pu",
            ),
            (
                "highest voltage before an event",
                self.voltage_range_pu.1,
                0.8,
                1.2,
                "0.8 to 1.2 pu",
            ),
            (
                "composition spread",
                self.composition_spread,
                0.0,
                0.2,
                "0 to 0.2",
            ),
            ("motor share", self.motor_share, 0.0, 0.95, "0 to 0.95"),
            (
                "deepest retained voltage",
                self.retained.0,
                0.3,
                self.retained.1,
                "0.3 to the mildest",
            ),
            (
                "mildest retained voltage",
                self.retained.1,
                self.retained.0,
                0.96,
                "the deepest to 0.96",
            ),
            (
                "tolerance",
                self.integrator.tolerance,
                1e-14,
                1e-2,
                "1e-14 to 0.01",
            ),
        ]
    }

    fn motor_ranges(&self) -> [Range; 7] {
        let motor = &self.motor;
        let reactance = "0.001 to 100 pu";
        [
            (
                "motor inertia",
                motor.inertia_s,
                1e-3,
                100.0,
                "0.001 to 100 s",
            ),
            (
                "stator resistance",
                motor.stator_resistance,
                0.0,
                1.0,
                "0 to 1 pu",
            ),
            (
                "rotor resistance",
                motor.rotor_resistance,
                1e-4,
                1.0,
                "0.0001 to 1 pu",
            ),
            (
                "stator reactance",
                motor.stator_reactance,
                1e-3,
                100.0,
                reactance,
            ),
            (
                "rotor reactance",
                motor.rotor_reactance,
                1e-3,
                100.0,
                reactance,
            ),
            (
                "magnetising reactance",
                motor.magnetising_reactance,
                1e-3,
                100.0,
                reactance,
            ),
            ("load factor", motor.load_factor, 1e-2, 2.0, "0.01 to 2"),
        ]
    }
}

/// Share of P0 that an effect takes from the static load.
fn share_of_static(hidden: &HiddenEffect) -> f64 {
    match hidden.effect() {
        Effect::ElectronicLoadDropout
        | Effect::SelfDisconnection
        | Effect::ExponentialRecovery
        | Effect::SinglePhaseAcStall
        | Effect::DischargeLighting
        | Effect::ContactorDropout => hidden.value("share"),
        Effect::FrequencyTrip if hidden.choice("what") == "load_below" => hidden.value("share"),
        _ => 0.0,
    }
}

/// Seconds that a window must last for an effect to be seen whole.
fn window_s(hidden: &HiddenEffect) -> f64 {
    match hidden.effect() {
        Effect::ExponentialRecovery => 4.0 + 3.0 * hidden.value("time_constant_s"),
        Effect::TapChanger => 8.0 + hidden.value("first_s") + 2.0 * hidden.value("next_s"),
        Effect::SinglePhaseAcStall => 30.0,
        Effect::StaticFrequencyDependence
        | Effect::SpeedDependentTorque
        | Effect::FrequencyScaledPower
        | Effect::FrequencyTrip => 12.0,
        _ => 0.0,
    }
}

/// Each effect once, with parameters that fit each other.
fn check_effects(effects: &[HiddenEffect]) -> Result<(), TruthError> {
    for (index, hidden) in effects.iter().enumerate() {
        let effect = hidden.effect().name();
        if effects[..index]
            .iter()
            .any(|other| other.effect() == hidden.effect())
        {
            return Err(TruthError::EffectTwice { effect });
        }
        for (larger, smaller) in ordered(hidden.effect()) {
            if hidden.value(larger) <= hidden.value(smaller) {
                return Err(TruthError::ParameterOutOfRange {
                    effect,
                    parameter: larger,
                    given: hidden.value(larger).to_string(),
                    required: format!("above {smaller}, {}", hidden.value(smaller)),
                });
            }
        }
    }
    Ok(())
}

/// Parameters of which the first must be larger than the second.
fn ordered(effect: Effect) -> &'static [(&'static str, &'static str)] {
    match effect {
        Effect::ElectronicLoadDropout | Effect::DischargeLighting | Effect::ContactorDropout => {
            &[("first_pu", "last_pu")]
        }
        Effect::MotorUndervoltageTrip => &[("reconnect_pu", "threshold_pu")],
        Effect::SinglePhaseAcStall => &[("restart_pu", "stall_pu"), ("last_trip", "first_trip")],
        Effect::Saturation => &[("at_1_2", "at_1_0")],
        _ => &[],
    }
}

/// Name, value, least, largest, and the range in words.
type Range = (&'static str, f64, f64, f64, &'static str);
