//! What happens in the grid: kinds of events, how severe, when.

use super::{
    Effect, Phasor, Random,
    excitation::{Excitation, Threshold},
    network::{Action, Grid},
    simulation::Switching,
};

/// A kind of event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// A fault that is cleared; the grid is as before.
    Fault,
    /// A fault that is cleared by taking a line out.
    FaultAndLineTrip,
    /// A fault, and another one after an unsuccessful reclosure.
    DoubleFault,
    /// A line is taken out: a small step.
    LineSwitching,
    /// A generator is lost: the frequency declines.
    GeneratorTrip,
    /// A large load elsewhere is lost: the frequency rises.
    LoadRejection,
    /// A capacitor is switched in.
    CapacitorIn,
    /// A capacitor is switched out.
    CapacitorOut,
}

impl EventKind {
    /// In this order kinds follow each other: any four events hold a fault and something else, any
    /// eleven hold everything.
    pub(super) const SEQUENCE: [Self; 11] = [
        Self::Fault,
        Self::FaultAndLineTrip,
        Self::GeneratorTrip,
        Self::Fault,
        Self::DoubleFault,
        Self::LineSwitching,
        Self::Fault,
        Self::CapacitorOut,
        Self::Fault,
        Self::LoadRejection,
        Self::CapacitorIn,
    ];

    /// Name in the truth file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fault => "fault",
            Self::FaultAndLineTrip => "fault+trip",
            Self::DoubleFault => "double",
            Self::LineSwitching => "line",
            Self::GeneratorTrip => "gen",
            Self::LoadRejection => "rejection",
            Self::CapacitorIn => "cap",
            Self::CapacitorOut => "capout",
        }
    }

    /// Whether the event is a voltage dip of a chosen depth.
    #[must_use]
    pub const fn is_fault(self) -> bool {
        matches!(
            self,
            Self::Fault | Self::FaultAndLineTrip | Self::DoubleFault
        )
    }
}

/// What shall happen in one event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EventPlan {
    /// Kind.
    pub kind: EventKind,
    /// First switching, seconds from the start of the window.
    pub onset_s: f64,
    /// Voltage a fault shall leave, share of the voltage before it; 1 for other kinds.
    pub retained: f64,
    /// Duration of a fault, nominal cycles; 0 for other kinds.
    pub cycles: f64,
    /// Time from the clearing of the first fault to the second one, s.
    pub reclose_s: f64,
    /// How much is switched: factor of the line's impedance, pu power or pu susceptance.
    pub amount: f64,
    /// The effect whose threshold the dip is for, and whether it shall go beyond it.
    pub target: Option<(Effect, bool)>,
}

/// Retained voltage of the deepest and of the mildest fault where nothing else is asked for.
pub(super) const RETAINED: (f64, f64) = (0.50, 0.92);
/// The same where effects must not show.
const RETAINED_MILD: (f64, f64) = (0.91, 0.96);
/// Deepest and mildest fault of all.
const RETAINED_LIMITS: (f64, f64) = (0.3, 0.96);

impl EventPlan {
    /// Plans for `count` events with faults between `retained` (deepest and mildest).
    pub(super) fn draw(
        count: usize,
        retained: (f64, f64),
        excitation: &Excitation,
        random: &mut Random,
    ) -> Vec<Self> {
        let kinds: Vec<_> = (0..count).map(|index| excitation.kind(index)).collect();
        let faults = kinds.iter().filter(|kind| kind.is_fault()).count();
        let (deepest, mildest) = if excitation.mild_only() {
            RETAINED_MILD
        } else {
            retained
        };
        let mut depths: Vec<_> = (0..faults)
            .map(|k| {
                let share = (k as f64 + random.uniform()) / faults as f64;
                deepest + share * (mildest - deepest)
            })
            .collect();
        random.shuffle(&mut depths);
        let mut depths = depths.into_iter().enumerate();
        let mut plans = Vec::with_capacity(count);
        for kind in kinds {
            let fault = if kind.is_fault() { depths.next() } else { None };
            let (number, depth) = fault.unwrap_or((0, 1.0));
            let mut plan = Self::drawn(kind, depth, random);
            if let Some((threshold, beyond)) = excitation.target(number)
                && kind.is_fault()
            {
                plan.aim(threshold, beyond, random);
            }
            plans.push(plan);
        }
        plans
    }

    /// Puts the depth of a fault on one side of `threshold`.
    fn aim(&mut self, threshold: Threshold, beyond: bool, random: &mut Random) {
        let retained = if beyond {
            threshold.well_below_pu - random.between(0.03, 0.14)
        } else {
            threshold.first_pu + random.between(0.07, 0.20)
        };
        self.retained = retained.clamp(RETAINED_LIMITS.0, RETAINED_LIMITS.1);
        let can_act = !threshold.second_dip || self.kind == EventKind::DoubleFault;
        self.target = can_act.then_some((threshold.effect, beyond));
        self.cycles = (5 + random.below(1 + depth_allowance(self.retained))) as f64;
    }

    /// Goes deeper or milder where what the load did (`acted`) has missed the aim; whether it does.
    pub(super) fn correct(&mut self, acted: bool, step: f64) -> bool {
        let Some((_, beyond)) = self.target else {
            return false;
        };
        if acted == beyond {
            return false;
        }
        let wanted = self.retained + if beyond { -step } else { step };
        let (deepest, mildest) = RETAINED_LIMITS;
        if !(deepest..=mildest).contains(&wanted) {
            return false;
        }
        self.retained = wanted;
        true
    }

    /// Makes the fault last at least `lasting_s` and three cycles more.
    pub(super) fn outlast(&mut self, lasting_s: f64, nominal_hz: f64) {
        if self.kind.is_fault() {
            self.cycles = self.cycles.max((lasting_s * nominal_hz).ceil() + 3.0);
        }
    }

    fn drawn(kind: EventKind, retained: f64, random: &mut Random) -> Self {
        let amount = match kind {
            EventKind::Fault => 0.0,
            EventKind::FaultAndLineTrip | EventKind::DoubleFault => random.between(1.1, 1.3),
            EventKind::LineSwitching => random.between(1.3, 1.7),
            EventKind::GeneratorTrip => random.between(0.6, 1.2),
            EventKind::LoadRejection => random.between(0.4, 0.8),
            EventKind::CapacitorIn | EventKind::CapacitorOut => random.between(0.15, 0.3),
        };
        // Deep and long together would stall motors: the deeper, the shorter.
        let cycles_max = 5 + random.below(1 + depth_allowance(retained));
        Self {
            kind,
            onset_s: random.between(1.4, 2.0),
            retained,
            cycles: if kind.is_fault() {
                cycles_max as f64
            } else {
                0.0
            },
            reclose_s: random.between(0.5, 1.2),
            amount,
            target: None,
        }
    }

    /// The switchings on a grid at rest with `voltage` and `current` at the load.
    pub(super) fn switchings(
        &self,
        grid: &Grid,
        voltage: Phasor,
        current: Phasor,
        nominal_hz: f64,
    ) -> Vec<Switching> {
        let at = |time_s: f64, action: Action| Switching { time_s, action };
        let fault = grid.fault_for(self.retained, &grid.initial_state(), voltage, current);
        let cleared_s = self.onset_s + self.cycles / nominal_hz;
        let dip = [
            at(self.onset_s, Action::Fault(fault)),
            at(cleared_s, Action::Clear),
        ];
        match self.kind {
            EventKind::Fault => dip.to_vec(),
            EventKind::FaultAndLineTrip => {
                let trip = at(cleared_s, Action::GridImpedance(self.amount));
                dip.into_iter().chain([trip]).collect()
            }
            EventKind::DoubleFault => {
                let again_s = cleared_s + self.reclose_s;
                let gone_s = again_s + self.cycles / nominal_hz;
                let second = [
                    at(again_s, Action::Fault(fault)),
                    at(gone_s, Action::Clear),
                    at(gone_s, Action::GridImpedance(self.amount)),
                ];
                dip.into_iter().chain(second).collect()
            }
            EventKind::LineSwitching => vec![at(self.onset_s, Action::GridImpedance(self.amount))],
            EventKind::GeneratorTrip => vec![
                at(self.onset_s, Action::GridPower(-self.amount)),
                at(self.onset_s, Action::GridImpedance(1.15)),
            ],
            EventKind::LoadRejection => vec![at(self.onset_s, Action::GridPower(self.amount))],
            EventKind::CapacitorIn => vec![at(self.onset_s, Action::Capacitor(self.amount))],
            EventKind::CapacitorOut => vec![at(self.onset_s, Action::Capacitor(-self.amount))],
        }
    }
}

/// Cycles beyond five that a fault of this depth may last: none at 0.5, ten from 0.8 on.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to 0..=10 in the same expression"
)]
fn depth_allowance(retained: f64) -> usize {
    ((retained - 0.5) / 0.03).clamp(0.0, 10.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::HiddenEffect;

    fn plain(count: usize, random: &mut Random) -> Vec<EventPlan> {
        EventPlan::draw(count, RETAINED, &Excitation::of(&[], true), random)
    }

    #[test]
    fn dips_lie_on_both_sides_of_a_threshold_or_all_above_it() {
        let hidden = HiddenEffect::drawn(Effect::SelfDisconnection, 2);
        let level = hidden.value("threshold_pu");
        let hidden = [hidden];
        let depths = |wanted| {
            let excitation = Excitation::of(&hidden, wanted);
            let plans = EventPlan::draw(11, RETAINED, &excitation, &mut Random::new(8));
            let faults = plans.into_iter().filter(|plan| plan.kind.is_fault());
            faults.map(|plan| plan.retained).collect::<Vec<_>>()
        };
        let below = depths(true).iter().filter(|d| **d < level).count();
        let above = depths(true).iter().filter(|d| **d > level).count();
        assert!(below >= 4 && above >= 2, "{below} {above}");
        assert!(depths(false).iter().all(|d| *d > level + 0.06));
    }

    #[test]
    fn a_missed_aim_is_corrected_towards_it_and_only_so_far() {
        let mut plan = plain(1, &mut Random::new(1))[0];
        assert!(!plan.correct(true, 0.05), "no aim, nothing to correct");
        plan.target = Some((Effect::SelfDisconnection, true));
        plan.retained = 0.5;
        assert!(!plan.correct(true, 0.05));
        assert!(plan.correct(false, 0.05) && (plan.retained - 0.45).abs() < 1e-12);
        plan.retained = 0.31;
        assert!(!plan.correct(false, 0.05));
    }

    #[test]
    fn eleven_events_hold_every_kind_and_depths_from_mild_to_deep() {
        let plans = plain(11, &mut Random::new(4));
        for kind in EventKind::SEQUENCE {
            assert!(plans.iter().any(|plan| plan.kind == kind), "{kind:?}");
        }
        let depths: Vec<_> = plans.iter().map(|plan| plan.retained).collect();
        let deepest = depths.iter().copied().fold(1.0, f64::min);
        assert!(deepest < 0.57, "{depths:?}");
        assert!(
            depths.iter().any(|d| (0.85..0.92).contains(d)),
            "{depths:?}"
        );
    }

    #[test]
    fn deep_faults_are_short() {
        let mut random = Random::new(9);
        for plan in plain(300, &mut random) {
            if plan.retained < 0.53 {
                assert!(plan.cycles <= 5.0, "{plan:?}");
            }
            assert!(plan.cycles <= 15.0);
        }
    }
}
