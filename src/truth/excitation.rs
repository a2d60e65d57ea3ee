//! What events must be like so that hidden effects show, or do not.

use super::{Effect, EventKind, HiddenEffect};

/// What an effect needs of the events.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Need {
    /// Dips below a voltage, and others above it.
    Dips(Threshold),
    /// Frequency that stays away from nominal, to both sides.
    Frequency,
    /// Voltage that stays away from where it was.
    Sustained,
    /// Deep and mild dips.
    Depths,
    /// Nothing in particular.
    Nothing,
}

/// Where an effect begins to act.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Threshold {
    pub(super) effect: Effect,
    /// Above this voltage nothing happens, pu.
    pub(super) first_pu: f64,
    /// Below this voltage much happens, pu.
    pub(super) well_below_pu: f64,
    /// How long a dip must last, s.
    pub(super) lasting_s: f64,
    /// Whether it takes a second dip in the window.
    pub(super) second_dip: bool,
}

/// What all hidden effects need together.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Excitation {
    pub(super) needs: Vec<Need>,
    /// Whether needs are met, or avoided.
    pub(super) wanted: bool,
}

impl Need {
    pub(super) fn of(hidden: &HiddenEffect) -> Self {
        let value = |name: &str| hidden.value(name);
        let between = |first_pu: f64, last_pu: f64, lasting_s: f64| {
            Self::Dips(Threshold {
                effect: hidden.effect(),
                first_pu,
                well_below_pu: 0.5 * (first_pu + last_pu),
                lasting_s,
                second_dip: hidden.effect() == Effect::SelfDisconnection && value("dips") > 1.0,
            })
        };
        let at = |voltage_pu: f64, lasting_s: f64| between(voltage_pu, voltage_pu, lasting_s);
        match hidden.effect() {
            Effect::MotorUndervoltageTrip | Effect::SelfDisconnection => {
                at(value("threshold_pu"), value("delay_s"))
            }
            Effect::DistributedGeneration => match hidden.choice("behaviour") {
                "ride_through" => Self::Depths,
                _ => at(value("threshold_pu"), value("delay_s")),
            },
            Effect::ElectronicLoadDropout => {
                between(value("first_pu"), value("last_pu"), value("delay_s"))
            }
            Effect::DischargeLighting => between(value("first_pu"), value("last_pu"), 0.0),
            Effect::ContactorDropout => {
                between(value("first_pu"), value("last_pu"), value("drop_delay_s"))
            }
            Effect::SinglePhaseAcStall => at(value("stall_pu"), value("stall_delay_s")),
            Effect::LowVoltageConversion => at(value("below_pu"), 0.0),
            Effect::StaticFrequencyDependence
            | Effect::SpeedDependentTorque
            | Effect::FrequencyScaledPower
            | Effect::FrequencyTrip
            | Effect::FrequencyTracking => Self::Frequency,
            Effect::ExponentialRecovery | Effect::TapChanger | Effect::Saturation => {
                Self::Sustained
            }
            Effect::StatorResistance
            | Effect::SecondMotor
            | Effect::FeederImpedance
            | Effect::DoubleCageRotor
            | Effect::TimeSkew
            | Effect::PhasorWindow => Self::Depths,
            Effect::LoadRamp | Effect::RatioPhaseError => Self::Nothing,
        }
    }

    /// The order in which kinds of events follow each other.
    fn sequence(self, wanted: bool) -> &'static [EventKind] {
        use EventKind::{
            CapacitorIn, CapacitorOut, DoubleFault, Fault, FaultAndLineTrip, GeneratorTrip,
            LineSwitching, LoadRejection,
        };
        match (self, wanted) {
            (Self::Dips(threshold), true) if threshold.second_dip => {
                &[DoubleFault, Fault, DoubleFault, DoubleFault, GeneratorTrip]
            }
            (Self::Dips(_), true) => &[
                Fault,
                Fault,
                FaultAndLineTrip,
                GeneratorTrip,
                Fault,
                DoubleFault,
                LineSwitching,
                Fault,
                FaultAndLineTrip,
                Fault,
                CapacitorOut,
            ],
            (Self::Frequency, true) => &[
                GeneratorTrip,
                Fault,
                LoadRejection,
                FaultAndLineTrip,
                GeneratorTrip,
                LoadRejection,
                Fault,
                DoubleFault,
            ],
            (Self::Frequency, false) => &[
                Fault,
                FaultAndLineTrip,
                LineSwitching,
                DoubleFault,
                CapacitorOut,
                Fault,
                CapacitorIn,
            ],
            (Self::Sustained, true) => &[
                FaultAndLineTrip,
                CapacitorOut,
                LineSwitching,
                Fault,
                CapacitorIn,
                FaultAndLineTrip,
                GeneratorTrip,
                DoubleFault,
                CapacitorIn,
                Fault,
                LineSwitching,
            ],
            (Self::Sustained, false) => &[Fault],
            (Self::Dips(_) | Self::Depths | Self::Nothing, _) => &EventKind::SEQUENCE,
        }
    }
}

impl Excitation {
    pub(super) fn of(effects: &[HiddenEffect], wanted: bool) -> Self {
        let mut needs: Vec<_> = effects.iter().map(Need::of).collect();
        needs.retain(|need| *need != Need::Nothing);
        Self { needs, wanted }
    }

    /// The kind of event `index`: the needs take turns.
    pub(super) fn kind(&self, index: usize) -> EventKind {
        let count = self.needs.len();
        let Some(need) = self.needs.get(index.checked_rem(count).unwrap_or(0)) else {
            return EventKind::SEQUENCE[index % EventKind::SEQUENCE.len()];
        };
        let sequence = need.sequence(self.wanted);
        sequence[(index / count) % sequence.len()]
    }

    /// The threshold that fault `number` is for, and whether it shall go beyond it: two dips in
    /// three do.
    pub(super) fn target(&self, number: usize) -> Option<(Threshold, bool)> {
        let thresholds: Vec<_> = self
            .needs
            .iter()
            .filter_map(|need| match need {
                Need::Dips(threshold) => Some(*threshold),
                _ => None,
            })
            .collect();
        if self.wanted {
            let turn = number.checked_rem(thresholds.len())?;
            let round = number / thresholds.len();
            Some((thresholds[turn], round % 3 != 1))
        } else {
            let highest = thresholds
                .into_iter()
                .reduce(|a, b| if b.first_pu > a.first_pu { b } else { a });
            highest.map(|threshold| (threshold, false))
        }
    }

    /// Whether depths must stay mild so that nothing shows.
    pub(super) fn mild_only(&self) -> bool {
        let any_depth = |need: &Need| !matches!(need, Need::Dips(_));
        !self.wanted && self.needs.iter().any(any_depth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn needs(effect: Effect) -> Excitation {
        Excitation::of(&[HiddenEffect::drawn(effect, 3)], true)
    }

    #[test]
    fn frequency_effects_get_declines_and_rises() {
        let excitation = needs(Effect::StaticFrequencyDependence);
        let kinds: Vec<_> = (0..8).map(|k| excitation.kind(k)).collect();
        let count = |kind| kinds.iter().filter(|k| **k == kind).count();
        assert_eq!(count(EventKind::GeneratorTrip), 2);
        assert_eq!(count(EventKind::LoadRejection), 2);
        assert!(kinds.iter().any(|kind| kind.is_fault()));
    }

    #[test]
    fn thresholds_get_dips_on_both_sides_and_two_thresholds_take_turns() {
        let excitation = needs(Effect::SelfDisconnection);
        let beyond: Vec<_> = (0..6)
            .filter_map(|k| excitation.target(k).map(|(_, beyond)| beyond))
            .collect();
        assert_eq!(beyond, [true, false, true, true, false, true]);
        let both = Excitation::of(
            &[
                HiddenEffect::drawn(Effect::SelfDisconnection, 3),
                HiddenEffect::drawn(Effect::SinglePhaseAcStall, 3),
            ],
            true,
        );
        let effect = |k: usize| both.target(k).map(|(threshold, _)| threshold.effect);
        assert_eq!(effect(0), Some(Effect::SelfDisconnection));
        assert_eq!(effect(1), Some(Effect::SinglePhaseAcStall));
    }

    #[test]
    fn without_effects_events_follow_the_usual_sequence() {
        let excitation = Excitation::of(&[], true);
        assert_eq!(excitation.kind(2), EventKind::GeneratorTrip);
        assert_eq!(excitation.target(0), None);
    }
}
