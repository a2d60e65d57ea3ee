//! From the load before an event to its parts.

use super::{
    Effect, HiddenEffect, MotorCircuit, Phasor, TruthError, Zip,
    load::{Load, Part, Supply},
    parts::{
        AirConditioner, AirConditionerSettings, Behaviour, Blocks, BlocksSettings,
        FrequencyDependence, FrequencyRelaySettings, FrequencyRelays, Generation,
        GenerationSettings, Machine, MachineSettings, Motor, Recovery, RecoverySettings,
        RotorBranch, Saturation, StaticLoad,
    },
    relay::RelaySettings,
    tap_changer::{TapChanger, TapSettings},
};

/// The load before an event, as measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct OperatingPoint {
    pub(super) voltage: Phasor,
    pub(super) power: Phasor,
    pub(super) motor_share: f64,
    pub(super) zip: Zip,
}

/// Power that a part of the load draws before the event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartPower {
    /// The part.
    pub part: &'static str,
    /// Active power, pu; generation is negative.
    pub active_pu: f64,
    /// Reactive power, pu.
    pub reactive_pu: f64,
}

/// A load with its parts in place.
pub(super) struct Composed {
    pub(super) load: Load,
    /// Voltage at the load itself.
    pub(super) terminal: Phasor,
    pub(super) powers: Vec<PartPower>,
}

/// The least the static load must draw, share of P0: below it shares do not fit each other.
const STATIC_SHARE_MIN: f64 = 0.02;
/// Devices in a group that lets go between two voltages.
const DEVICES: usize = 24;

/// The load at `point` with `effects` in it.
///
/// # Errors
///
/// [`TruthError::NoEquilibrium`] and [`TruthError::NothingLeft`].
pub(super) fn compose(
    point: &OperatingPoint,
    circuit: MotorCircuit,
    effects: &[HiddenEffect],
    nominal_rad_s: f64,
) -> Result<Composed, TruthError> {
    let current = (point.power / point.voltage).conj();
    let impedance = series_impedance(effects);
    let terminal = point.voltage - impedance * current;
    let mut composition = Composition {
        effects,
        circuit,
        active_pu: point.power.re,
        terminal,
        nominal_rad_s,
        parts: Vec::new(),
        powers: Vec::new(),
        rest: terminal * current.conj(),
    };
    composition.add_motors(point.motor_share * point.power.re)?;
    for effect in effects {
        composition.add_effect(effect);
    }
    composition.add_static(point.zip)?;
    let tap_changer = found(effects, Effect::TapChanger)
        .map(|taps| TapChanger::new(tap_settings(taps), terminal.norm()));
    Ok(Composed {
        load: Load {
            supply: Supply {
                impedance,
                tap_changer,
            },
            parts: composition.parts,
        },
        terminal,
        powers: composition.powers,
    })
}

/// Shares of the motors' power: of the motors without an effect of their own, of a second group, of
/// those that trip. The last are taken from the first.
pub(super) fn motor_groups(effects: &[HiddenEffect]) -> (f64, f64, f64) {
    let share = |effect| found(effects, effect).map_or(0.0, |h| h.value("share_of_motors"));
    let second = share(Effect::SecondMotor);
    let tripping = (1.0 - second) * share(Effect::MotorUndervoltageTrip);
    (1.0 - second - tripping, second, tripping)
}

fn found(effects: &[HiddenEffect], effect: Effect) -> Option<&HiddenEffect> {
    effects.iter().find(|hidden| hidden.effect() == effect)
}

fn series_impedance(effects: &[HiddenEffect]) -> Phasor {
    let feeder = found(effects, Effect::FeederImpedance).map_or(Phasor::new(0.0, 0.0), |f| {
        Phasor::new(f.value("resistance_pu"), f.value("reactance_pu"))
    });
    let transformer = found(effects, Effect::TapChanger).map_or(0.0, |t| t.value("reactance_pu"));
    feeder + Phasor::new(0.0, transformer)
}

fn tap_settings(taps: &HiddenEffect) -> TapSettings {
    TapSettings {
        step: taps.value("step"),
        deadband_pu: taps.value("deadband_pu"),
        first_s: taps.value("first_s"),
        next_s: taps.value("next_s"),
        steps_max: 16,
    }
}

/// A load that is being put together.
struct Composition<'a> {
    effects: &'a [HiddenEffect],
    circuit: MotorCircuit,
    active_pu: f64,
    terminal: Phasor,
    nominal_rad_s: f64,
    parts: Vec<Box<dyn Part + Send>>,
    powers: Vec<PartPower>,
    /// What no part draws yet.
    rest: Phasor,
}

impl Composition<'_> {
    fn add(&mut self, name: &'static str, part: Box<dyn Part + Send>) {
        let at = super::load::Terminal {
            time_s: 0.0,
            voltage: self.terminal,
        };
        let power = self.terminal * part.current(at, &part.initial_state()).conj();
        self.rest -= power;
        self.powers.push(PartPower {
            part: name,
            active_pu: power.re,
            reactive_pu: power.im,
        });
        self.parts.push(part);
    }

    /// Motors that together draw `total_pu`.
    fn add_motors(&mut self, total_pu: f64) -> Result<(), TruthError> {
        let (first, second, tripping) = motor_groups(self.effects);
        let plain = self.motor_settings();
        let is_plain = plain == MachineSettings::plain(plain.circuit);
        let first_pu = total_pu * first;
        if first_pu > 0.0 && is_plain {
            let motor = Motor::at_operating_point(
                plain.circuit,
                first_pu,
                self.terminal,
                self.nominal_rad_s,
            )?;
            self.add("motor", Box::new(motor));
        } else if first_pu > 0.0 {
            self.add_machine(plain, first_pu)?;
        }
        if let Some(hidden) = found(self.effects, Effect::SecondMotor) {
            let settings = MachineSettings {
                part: "second_motor",
                circuit: second_circuit(hidden, &plain.circuit),
                second_rotor: None,
                ..plain
            };
            self.add_machine(settings, total_pu * second)?;
        }
        if let Some(hidden) = found(self.effects, Effect::MotorUndervoltageTrip) {
            self.add_machine(tripping_motor(hidden, plain), total_pu * tripping)?;
        }
        Ok(())
    }

    fn add_machine(&mut self, settings: MachineSettings, active_pu: f64) -> Result<(), TruthError> {
        if active_pu > 0.0 {
            let machine = Machine::at_operating_point(
                settings,
                active_pu,
                self.terminal,
                self.nominal_rad_s,
            )?;
            self.add(settings.part, Box::new(machine));
        }
        Ok(())
    }

    /// What all motors have in common.
    fn motor_settings(&self) -> MachineSettings {
        let mut settings = MachineSettings::plain(self.circuit);
        for hidden in self.effects {
            match hidden.effect() {
                Effect::StatorResistance => {
                    settings.circuit.stator_resistance = hidden.value("resistance_pu");
                }
                Effect::FrequencyScaledPower => {
                    settings.frequency_lag_s = Some(hidden.value("lag_s"));
                }
                Effect::SpeedDependentTorque => {
                    settings.torque = (hidden.value("quadratic"), hidden.value("linear"));
                }
                Effect::Saturation => {
                    settings.saturation = Some(Saturation {
                        at_1_0: hidden.value("at_1_0"),
                        at_1_2: hidden.value("at_1_2"),
                    });
                }
                Effect::DoubleCageRotor => settings = with_cages(settings, hidden),
                _ => {}
            }
        }
        settings
    }

    fn add_effect(&mut self, hidden: &HiddenEffect) {
        let name = hidden.effect().name();
        let voltage_pu = self.terminal.norm();
        match hidden.effect() {
            Effect::ExponentialRecovery => {
                let recovery = Recovery {
                    settings: recovery(hidden),
                    initial_voltage_pu: voltage_pu,
                    initial: self.share(hidden),
                };
                self.add(name, Box::new(recovery));
            }
            Effect::DistributedGeneration => {
                let active_pu = hidden.value("share") * self.active_pu;
                let generation = Generation::new(generation(hidden), active_pu, voltage_pu);
                self.add(name, Box::new(generation));
            }
            Effect::FrequencyTrip => {
                let settings = frequency_relays(hidden, self.nominal_rad_s);
                let angle_rad = self.terminal.arg();
                let power = if hidden.choice("what") == "load_below" {
                    self.share(hidden)
                } else {
                    Phasor::new(-hidden.value("share") * self.active_pu, 0.0)
                };
                let relays = FrequencyRelays::new(settings, angle_rad, power);
                self.add(name, Box::new(relays));
            }
            Effect::SinglePhaseAcStall => {
                let active_pu = hidden.value("share") * self.active_pu;
                let settings = air_conditioner(hidden, self.nominal_rad_s);
                let motors = AirConditioner::new(settings, active_pu, self.terminal);
                self.add(name, Box::new(motors));
            }
            Effect::FeederImpedance if hidden.value("capacitor_pu") > 0.0 => {
                let reactive = -hidden.value("capacitor_pu") * voltage_pu.powi(2);
                let impedance = Zip {
                    active_impedance: 1.0,
                    active_current: 0.0,
                    reactive_impedance: 1.0,
                    reactive_current: 0.0,
                };
                let power = Phasor::new(0.0, reactive);
                let capacitor = StaticLoad::plain(impedance, self.terminal, power);
                self.add("feeder_capacitor", Box::new(capacitor));
            }
            _ => {
                if let Some(settings) = blocks(hidden) {
                    let blocks = Blocks::new(settings, voltage_pu, self.share(hidden));
                    self.add(name, Box::new(blocks));
                }
            }
        }
    }

    /// Power of an effect that takes a share of P0, with its power factor where it has one.
    fn share(&self, hidden: &HiddenEffect) -> Phasor {
        let active_pu = hidden.value("share") * self.active_pu;
        let has_factor = hidden.effect() != Effect::ElectronicLoadDropout;
        let factor = if has_factor {
            hidden.value("power_factor")
        } else {
            1.0
        };
        Phasor::new(active_pu, active_pu * factor.acos().tan())
    }

    fn add_static(&mut self, zip: Zip) -> Result<(), TruthError> {
        if self.rest.re < STATIC_SHARE_MIN * self.active_pu {
            return Err(TruthError::NothingLeft {
                of: "the static load",
                left: self.rest.re / self.active_pu,
            });
        }
        let mut load = StaticLoad::plain(zip, self.terminal, self.rest);
        for hidden in self.effects {
            match hidden.effect() {
                Effect::StaticFrequencyDependence => {
                    load.frequency = Some(FrequencyDependence {
                        active: hidden.value("active"),
                        reactive: hidden.value("reactive"),
                        lag_s: hidden.value("lag_s"),
                        nominal_rad_s: self.nominal_rad_s,
                    });
                }
                Effect::LowVoltageConversion => load.conversion_pu = hidden.value("below_pu"),
                Effect::LoadRamp => {
                    load.ramp_per_s =
                        (hidden.value("active_per_s"), hidden.value("reactive_per_s"));
                }
                _ => {}
            }
        }
        self.add("static", Box::new(load));
        Ok(())
    }
}

fn with_cages(settings: MachineSettings, hidden: &HiddenEffect) -> MachineSettings {
    MachineSettings {
        circuit: MotorCircuit {
            rotor_resistance: hidden.value("inner_resistance_pu"),
            rotor_reactance: hidden.value("inner_reactance_pu"),
            ..settings.circuit
        },
        second_rotor: Some(RotorBranch {
            resistance: hidden.value("outer_resistance_pu"),
            reactance: hidden.value("outer_reactance_pu"),
        }),
        ..settings
    }
}

/// The circuit of a second group of motors that has its stator resistance in common with the first.
pub(super) fn second_circuit(hidden: &HiddenEffect, first: &MotorCircuit) -> MotorCircuit {
    MotorCircuit {
        stator_resistance: first.stator_resistance,
        stator_reactance: hidden.value("stator_reactance_pu"),
        magnetising_reactance: hidden.value("magnetising_reactance_pu"),
        rotor_resistance: hidden.value("rotor_resistance_pu"),
        rotor_reactance: hidden.value("rotor_reactance_pu"),
        inertia_s: hidden.value("inertia_s"),
        load_factor: hidden.value("load_factor"),
    }
}

fn tripping_motor(hidden: &HiddenEffect, plain: MachineSettings) -> MachineSettings {
    let returns = hidden.choice("reconnects") == "yes";
    MachineSettings {
        part: Effect::MotorUndervoltageTrip.name(),
        circuit: MotorCircuit {
            inertia_s: hidden.value("inertia_s"),
            ..plain.circuit
        },
        breaker: Some(RelaySettings {
            drop_below_pu: hidden.value("threshold_pu"),
            drop_delay_s: hidden.value("delay_s"),
            return_above_pu: if returns {
                hidden.value("reconnect_pu")
            } else {
                f64::INFINITY
            },
            return_delay_s: hidden.value("reconnect_delay_s"),
            dips: 1,
        }),
        ..plain
    }
}

fn recovery(hidden: &HiddenEffect) -> RecoverySettings {
    RecoverySettings {
        steady: (
            hidden.value("steady_active"),
            hidden.value("steady_reactive"),
        ),
        transient: (
            hidden.value("transient_active"),
            hidden.value("transient_reactive"),
        ),
        time_constant_s: hidden.value("time_constant_s"),
    }
}

fn generation(hidden: &HiddenEffect) -> GenerationSettings {
    GenerationSettings {
        behaviour: match hidden.choice("behaviour") {
            "trip" => Behaviour::Trip,
            "ride_through" => Behaviour::RideThrough,
            _ => Behaviour::MomentaryCessation,
        },
        threshold_pu: hidden.value("threshold_pu"),
        delay_s: hidden.value("delay_s"),
        tripping: hidden.value("tripping"),
        recovery_delay_s: hidden.value("recovery_delay_s"),
        ramp_s: hidden.value("ramp_s"),
        lag_s: hidden.value("lag_s"),
        current_limit: hidden.value("current_limit"),
    }
}

fn frequency_relays(hidden: &HiddenEffect, nominal_rad_s: f64) -> FrequencyRelaySettings {
    FrequencyRelaySettings {
        above: hidden.choice("what") == "generation_above",
        deviation: hidden.value("deviation"),
        delay_s: hidden.value("delay_s"),
        lag_s: hidden.value("lag_s"),
        nominal_rad_s,
    }
}

fn air_conditioner(hidden: &HiddenEffect, nominal_rad_s: f64) -> AirConditionerSettings {
    AirConditionerSettings {
        power_factor: hidden.value("power_factor"),
        stall_pu: hidden.value("stall_pu"),
        stall_delay_s: hidden.value("stall_delay_s"),
        stalled: (hidden.value("resistance_pu"), hidden.value("reactance_pu")),
        restarting: hidden.value("restarting"),
        restart_pu: hidden.value("restart_pu"),
        restart_delay_s: hidden.value("restart_delay_s"),
        thermal_s: hidden.value("thermal_s"),
        thermal_trip: (hidden.value("first_trip"), hidden.value("last_trip")),
        frequency: (
            hidden.value("frequency_active"),
            hidden.value("frequency_reactive"),
        ),
        nominal_rad_s,
    }
}

/// The effects that are groups of devices with relays.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the number of dips is checked: 1 to 9"
)]
fn blocks(hidden: &HiddenEffect) -> Option<BlocksSettings> {
    let none = BlocksSettings {
        part: hidden.effect().name(),
        devices: DEVICES,
        first_pu: 0.0,
        last_pu: 0.0,
        drop_delay_s: 0.0,
        returning: 0.0,
        margin_pu: 0.005,
        return_delay_s: (0.0, 0.0),
        dips: 1,
        exponents: (0.0, 0.0),
    };
    let value = |name: &str| hidden.value(name);
    match hidden.effect() {
        Effect::ElectronicLoadDropout => Some(BlocksSettings {
            first_pu: value("first_pu"),
            last_pu: value("last_pu"),
            drop_delay_s: value("delay_s"),
            returning: value("returning"),
            ..none
        }),
        Effect::SelfDisconnection => Some(BlocksSettings {
            devices: 1,
            first_pu: value("threshold_pu"),
            last_pu: value("threshold_pu"),
            drop_delay_s: value("delay_s"),
            dips: value("dips").round() as u32,
            exponents: (value("exponent"), value("exponent")),
            ..none
        }),
        Effect::DischargeLighting => Some(BlocksSettings {
            first_pu: value("first_pu"),
            last_pu: value("last_pu"),
            returning: 1.0,
            return_delay_s: (0.9 * value("restrike_s"), 1.1 * value("restrike_s")),
            exponents: (value("exponent_active"), value("exponent_reactive")),
            ..none
        }),
        Effect::ContactorDropout => Some(BlocksSettings {
            first_pu: value("first_pu"),
            last_pu: value("last_pu"),
            drop_delay_s: value("drop_delay_s"),
            returning: 1.0,
            margin_pu: value("margin_pu"),
            return_delay_s: (value("close_delay_s"), value("close_delay_s")),
            exponents: (2.0, 2.0),
            ..none
        }),
        _ => None,
    }
}
