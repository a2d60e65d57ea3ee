//! The parameters of every effect with their typical ranges.
//!
//! Ranges: catalogue of effects (WECC and NERC composite load records, PSAT, published motors),
//! narrowed or shifted where a site of a dozen events of ten seconds would not show the effect;
//! `docs/generating-sites.md` says where.

mod instruments;

use super::effect::{Effect, EffectParameter};
use instruments::{FREQUENCY_TRACKING, PHASOR_WINDOW, RATIO_PHASE_ERROR, TIME_SKEW};

/// A quantity drawn from a range, positive.
const fn quantity(
    name: &'static str,
    typical: (f64, f64),
    admissible: (f64, f64),
    meaning: &'static str,
) -> EffectParameter {
    EffectParameter {
        name,
        meaning,
        typical,
        either_sign: false,
        admissible,
        counts: false,
        choices: &[],
    }
}

/// A whole number.
const fn count(
    name: &'static str,
    typical: (f64, f64),
    admissible: (f64, f64),
    meaning: &'static str,
) -> EffectParameter {
    EffectParameter {
        counts: true,
        ..quantity(name, typical, admissible, meaning)
    }
}

/// A quantity of either sign; `typical` is the range of its size.
const fn signed(
    name: &'static str,
    typical: (f64, f64),
    admissible: (f64, f64),
    meaning: &'static str,
) -> EffectParameter {
    EffectParameter {
        either_sign: true,
        ..quantity(name, typical, admissible, meaning)
    }
}

/// One of several words.
const fn choice(
    name: &'static str,
    choices: &'static [&'static str],
    meaning: &'static str,
) -> EffectParameter {
    let range = (0.0, choices.len() as f64 - 1.0);
    EffectParameter {
        choices,
        ..quantity(name, range, range, meaning)
    }
}

const SHARE: (f64, f64) = (0.0, 0.8);
const VOLTAGE: (f64, f64) = (0.05, 1.2);
const DELAY: (f64, f64) = (0.0, 60.0);
const REACTANCE: (f64, f64) = (1e-3, 100.0);
const POWER_FACTOR: (f64, f64) = (0.2, 1.0);

const STATOR_RESISTANCE: &[EffectParameter] = &[quantity(
    "resistance_pu",
    (0.02, 0.04),
    (0.0, 0.3),
    "stator resistance on the motors' base",
)];

const FREQUENCY_SCALED_POWER: &[EffectParameter] = &[quantity(
    "lag_s",
    (0.02, 0.05),
    (0.002, 1.0),
    "lag of the frequency that scales",
)];

const STATIC_FREQUENCY_DEPENDENCE: &[EffectParameter] = &[
    quantity(
        "active",
        (1.0, 2.6),
        (-10.0, 10.0),
        "Kpf of the static load",
    ),
    quantity(
        "reactive",
        (-2.3, 1.6),
        (-10.0, 10.0),
        "Kqf of the static load",
    ),
    quantity(
        "lag_s",
        (0.03, 0.08),
        (0.002, 1.0),
        "lag with which the load notices the frequency",
    ),
];

const SECOND_MOTOR: &[EffectParameter] = &[
    quantity(
        "share_of_motors",
        (0.35, 0.65),
        (0.0, 0.95),
        "share of the motors' power that the second group draws",
    ),
    quantity(
        "inertia_s",
        (0.12, 2.0),
        (0.01, 20.0),
        "H of the second group",
    ),
    quantity(
        "rotor_resistance_pu",
        (0.008, 0.045),
        (1e-4, 1.0),
        "rotor resistance",
    ),
    quantity(
        "rotor_reactance_pu",
        (0.10, 0.18),
        REACTANCE,
        "rotor leakage reactance",
    ),
    quantity(
        "stator_reactance_pu",
        (0.08, 0.12),
        REACTANCE,
        "stator leakage reactance",
    ),
    quantity(
        "magnetising_reactance_pu",
        (2.2, 3.8),
        REACTANCE,
        "magnetising reactance",
    ),
    quantity(
        "load_factor",
        (0.6, 0.8),
        (0.01, 2.0),
        "active power over rating",
    ),
];

const MOTOR_UNDERVOLTAGE_TRIP: &[EffectParameter] = &[
    quantity(
        "share_of_motors",
        (0.3, 0.6),
        (0.0, 0.95),
        "share of the first group's power that trips",
    ),
    quantity("threshold_pu", (0.62, 0.78), VOLTAGE, "voltage of the trip"),
    quantity("delay_s", (0.02, 0.06), DELAY, "delay of the trip"),
    choice(
        "reconnects",
        &["no", "yes"],
        "whether tripped motors come back",
    ),
    quantity(
        "reconnect_pu",
        (0.82, 0.9),
        VOLTAGE,
        "voltage at which they do",
    ),
    quantity(
        "reconnect_delay_s",
        (0.1, 0.5),
        DELAY,
        "delay with which they do",
    ),
    quantity(
        "inertia_s",
        (0.4, 0.9),
        (0.01, 20.0),
        "H of the motors that trip",
    ),
];

const ELECTRONIC_LOAD_DROPOUT: &[EffectParameter] = &[
    quantity(
        "share",
        (0.1, 0.25),
        SHARE,
        "share of P0 that electronics draw",
    ),
    quantity("first_pu", (0.7, 0.78), VOLTAGE, "Vd1: the first goes"),
    quantity("last_pu", (0.5, 0.62), VOLTAGE, "Vd2: the last goes"),
    quantity("returning", (0.0, 0.8), (0.0, 1.0), "share that returns"),
    quantity(
        "delay_s",
        (0.0, 0.02),
        DELAY,
        "hold-up time of power supplies",
    ),
];

const SELF_DISCONNECTION: &[EffectParameter] = &[
    quantity("share", (0.06, 0.2), SHARE, "share of P0 that disconnects"),
    quantity(
        "power_factor",
        (0.95, 1.0),
        POWER_FACTOR,
        "power factor of that share",
    ),
    quantity(
        "threshold_pu",
        (0.66, 0.82),
        VOLTAGE,
        "voltage of the disconnection",
    ),
    quantity("delay_s", (0.02, 0.05), DELAY, "its delay"),
    quantity(
        "exponent",
        (0.0, 1.5),
        (0.0, 4.0),
        "exponent of the voltage while connected",
    ),
    count(
        "dips",
        (1.0, 1.0),
        (1.0, 9.0),
        "dip of the window at which it happens",
    ),
];

const EXPONENTIAL_RECOVERY: &[EffectParameter] = &[
    quantity("share", (0.25, 0.45), SHARE, "share of P0 that recovers"),
    quantity(
        "power_factor",
        (0.93, 0.99),
        POWER_FACTOR,
        "power factor of that share",
    ),
    quantity(
        "steady_active",
        (0.0, 0.4),
        (-2.0, 6.0),
        "exponent of P in the end",
    ),
    quantity(
        "transient_active",
        (1.5, 2.3),
        (-2.0, 6.0),
        "exponent of P at once",
    ),
    quantity(
        "steady_reactive",
        (0.0, 1.0),
        (-2.0, 8.0),
        "exponent of Q in the end",
    ),
    quantity(
        "transient_reactive",
        (1.8, 2.6),
        (-2.0, 8.0),
        "exponent of Q at once",
    ),
    quantity(
        "time_constant_s",
        (1.5, 6.0),
        (0.05, 600.0),
        "time constant of the recovery",
    ),
];

const FREQUENCY_TRIP: &[EffectParameter] = &[
    choice(
        "what",
        &["generation_below", "generation_above", "load_below"],
        "what leaves, and on which side of the nominal frequency",
    ),
    quantity(
        "share",
        (0.06, 0.2),
        SHARE,
        "its power over the net load P0",
    ),
    quantity(
        "power_factor",
        (0.95, 1.0),
        POWER_FACTOR,
        "power factor of load that leaves; generation has 1",
    ),
    quantity(
        "deviation",
        (0.003, 0.007),
        (1e-3, 0.1),
        "deviation of the frequency, over the nominal one",
    ),
    quantity("delay_s", (0.06, 0.3), DELAY, "how long it must last"),
    quantity(
        "lag_s",
        (0.02, 0.05),
        (1e-3, 1.0),
        "lag with which relays notice the frequency",
    ),
];

const DISTRIBUTED_GENERATION: &[EffectParameter] = &[
    quantity(
        "share",
        (0.15, 0.35),
        SHARE,
        "generation over the net load P0",
    ),
    choice(
        "behaviour",
        &["momentary_cessation", "trip", "ride_through"],
        "what inverters do in a dip",
    ),
    quantity(
        "threshold_pu",
        (0.7, 0.86),
        VOLTAGE,
        "voltage below which they do it",
    ),
    quantity("delay_s", (0.0, 0.04), DELAY, "delay with which they do it"),
    quantity("tripping", (0.5, 1.0), (0.0, 1.0), "share that trips"),
    quantity(
        "recovery_delay_s",
        (0.05, 0.5),
        DELAY,
        "time before the ramp",
    ),
    quantity("ramp_s", (0.6, 3.0), (0.01, 100.0), "length of the ramp"),
    quantity(
        "lag_s",
        (0.02, 0.05),
        (1e-3, 1.0),
        "lag of the current control",
    ),
    quantity(
        "current_limit",
        (1.05, 1.2),
        (1.0, 3.0),
        "largest current over that at rest",
    ),
];

const SPEED_DEPENDENT_TORQUE: &[EffectParameter] = &[
    quantity(
        "quadratic",
        (0.7, 1.0),
        (-2.0, 3.0),
        "A of the torque A w^2 + B w + 1 - A - B",
    ),
    quantity("linear", (0.0, 0.0), (-2.0, 3.0), "B of that torque"),
];

const FEEDER_IMPEDANCE: &[EffectParameter] = &[
    quantity(
        "resistance_pu",
        (0.015, 0.04),
        (0.0, 0.3),
        "resistance on the load base",
    ),
    quantity(
        "reactance_pu",
        (0.05, 0.12),
        (0.0, 0.4),
        "reactance on the load base",
    ),
    quantity(
        "capacitor_pu",
        (0.0, 0.05),
        (0.0, 0.5),
        "susceptance at the load",
    ),
];

const DOUBLE_CAGE_ROTOR: &[EffectParameter] = &[
    quantity(
        "inner_resistance_pu",
        (0.010, 0.015),
        (1e-4, 1.0),
        "resistance of the inner cage",
    ),
    quantity(
        "inner_reactance_pu",
        (0.22, 0.32),
        REACTANCE,
        "leakage of the inner cage",
    ),
    quantity(
        "outer_resistance_pu",
        (0.045, 0.07),
        (1e-4, 1.0),
        "resistance of the outer cage",
    ),
    quantity(
        "outer_reactance_pu",
        (0.08, 0.12),
        REACTANCE,
        "leakage of the outer cage",
    ),
];

const TAP_CHANGER: &[EffectParameter] = &[
    quantity(
        "step",
        (0.006_25, 0.0125),
        (1e-4, 0.1),
        "one step of the ratio",
    ),
    quantity(
        "deadband_pu",
        (0.012, 0.018),
        (1e-4, 0.2),
        "whole width of the deadband",
    ),
    quantity(
        "first_s",
        (1.5, 6.0),
        (0.05, 300.0),
        "delay of the first step",
    ),
    quantity(
        "next_s",
        (0.8, 3.0),
        (0.05, 300.0),
        "delay of the next ones",
    ),
    quantity(
        "reactance_pu",
        (0.06, 0.12),
        (0.0, 0.4),
        "reactance of the transformer on the load base",
    ),
];

const SINGLE_PHASE_AC_STALL: &[EffectParameter] = &[
    quantity(
        "share",
        (0.12, 0.25),
        SHARE,
        "share of P0 that air conditioners draw",
    ),
    quantity(
        "power_factor",
        (0.96, 0.98),
        POWER_FACTOR,
        "their power factor",
    ),
    quantity("stall_pu", (0.55, 0.65), VOLTAGE, "Vstall"),
    quantity("stall_delay_s", (0.033, 0.05), DELAY, "Tstall"),
    quantity(
        "resistance_pu",
        (0.1, 0.124),
        (0.01, 1.0),
        "R of stalled motors",
    ),
    quantity(
        "reactance_pu",
        (0.1, 0.114),
        (0.01, 1.0),
        "X of stalled motors",
    ),
    quantity(
        "restarting",
        (0.0, 0.2),
        (0.0, 1.0),
        "Frst: share that restarts",
    ),
    quantity("restart_pu", (0.85, 0.92), VOLTAGE, "Vrst"),
    quantity("restart_delay_s", (0.3, 0.4), DELAY, "Trst"),
    quantity("thermal_s", (10.0, 15.0), (0.1, 100.0), "Tth"),
    quantity(
        "first_trip",
        (0.7, 1.3),
        (0.1, 20.0),
        "Th1t: the first trips",
    ),
    quantity("last_trip", (1.9, 3.0), (0.1, 20.0), "Th2t: the last trips"),
    quantity("frequency_active", (0.0, 1.0), (-5.0, 5.0), "CmpKpf"),
    quantity("frequency_reactive", (-3.3, 0.0), (-9.0, 9.0), "CmpKqf"),
];

const SATURATION: &[EffectParameter] = &[
    quantity("at_1_0", (0.1, 0.2), (1e-3, 2.0), "S at 1.0 pu flux"),
    quantity("at_1_2", (0.5, 0.9), (1e-3, 5.0), "S at 1.2 pu flux"),
];

const DISCHARGE_LIGHTING: &[EffectParameter] = &[
    quantity("share", (0.1, 0.25), SHARE, "share of P0 that lamps draw"),
    quantity(
        "power_factor",
        (0.88, 0.95),
        POWER_FACTOR,
        "their power factor",
    ),
    quantity("first_pu", (0.75, 0.8), VOLTAGE, "Va: the first goes out"),
    quantity("last_pu", (0.65, 0.7), VOLTAGE, "Vb: the last goes out"),
    quantity(
        "restrike_s",
        (1.0, 2.0),
        DELAY,
        "time until lamps strike again",
    ),
    quantity("exponent_active", (0.9, 1.1), (0.0, 6.0), "exponent of P"),
    quantity("exponent_reactive", (4.0, 5.0), (0.0, 8.0), "exponent of Q"),
];

const CONTACTOR_DROPOUT: &[EffectParameter] = &[
    quantity(
        "share",
        (0.12, 0.25),
        SHARE,
        "share of P0 behind contactors",
    ),
    quantity(
        "power_factor",
        (0.85, 0.95),
        POWER_FACTOR,
        "its power factor",
    ),
    quantity(
        "first_pu",
        (0.58, 0.68),
        VOLTAGE,
        "Vc1off: the first lets go",
    ),
    quantity("last_pu", (0.46, 0.55), VOLTAGE, "Vc2off: the last lets go"),
    quantity("margin_pu", (0.08, 0.1), (0.0, 0.5), "Von - Voff"),
    quantity("drop_delay_s", (0.01, 0.02), DELAY, "delay of letting go"),
    quantity(
        "close_delay_s",
        (0.05, 0.3),
        DELAY,
        "delay of closing again",
    ),
];

const LOW_VOLTAGE_CONVERSION: &[EffectParameter] = &[quantity(
    "below_pu",
    (0.7, 0.82),
    VOLTAGE,
    "voltage below which constant power and current collapse",
)];

const LOAD_RAMP: &[EffectParameter] = &[
    signed(
        "active_per_s",
        (0.002, 0.008),
        (-0.1, 0.1),
        "drift of the static P, share per second",
    ),
    signed(
        "reactive_per_s",
        (0.002, 0.008),
        (-0.1, 0.1),
        "drift of the static Q, share per second",
    ),
];

pub(super) const fn parameters_of(effect: Effect) -> &'static [EffectParameter] {
    match effect {
        Effect::StatorResistance => STATOR_RESISTANCE,
        Effect::FrequencyScaledPower => FREQUENCY_SCALED_POWER,
        Effect::StaticFrequencyDependence => STATIC_FREQUENCY_DEPENDENCE,
        Effect::SecondMotor => SECOND_MOTOR,
        Effect::MotorUndervoltageTrip => MOTOR_UNDERVOLTAGE_TRIP,
        Effect::ElectronicLoadDropout => ELECTRONIC_LOAD_DROPOUT,
        Effect::SelfDisconnection => SELF_DISCONNECTION,
        Effect::ExponentialRecovery => EXPONENTIAL_RECOVERY,
        Effect::DistributedGeneration => DISTRIBUTED_GENERATION,
        Effect::FrequencyTrip => FREQUENCY_TRIP,
        Effect::SpeedDependentTorque => SPEED_DEPENDENT_TORQUE,
        Effect::FeederImpedance => FEEDER_IMPEDANCE,
        Effect::DoubleCageRotor => DOUBLE_CAGE_ROTOR,
        Effect::TapChanger => TAP_CHANGER,
        Effect::SinglePhaseAcStall => SINGLE_PHASE_AC_STALL,
        Effect::Saturation => SATURATION,
        Effect::DischargeLighting => DISCHARGE_LIGHTING,
        Effect::ContactorDropout => CONTACTOR_DROPOUT,
        Effect::LowVoltageConversion => LOW_VOLTAGE_CONVERSION,
        Effect::LoadRamp => LOAD_RAMP,
        Effect::TimeSkew => TIME_SKEW,
        Effect::PhasorWindow => PHASOR_WINDOW,
        Effect::RatioPhaseError => RATIO_PHASE_ERROR,
        Effect::FrequencyTracking => FREQUENCY_TRACKING,
    }
}
