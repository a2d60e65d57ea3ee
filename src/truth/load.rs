//! What a load is made of: parts that draw a current, some with states, some with relays, behind a
//! feeder and a tap changer.

use super::{Phasor, tap_changer::TapChanger};

/// What a part sees of its terminals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Terminal {
    /// Seconds from the start of the window.
    pub(super) time_s: f64,
    /// Voltage, pu.
    pub(super) voltage: Phasor,
}

/// Something that a relay or a controller did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Operation {
    /// When, seconds from the start of the window.
    pub time_s: f64,
    /// What did it.
    pub part: &'static str,
    /// What it did.
    pub action: &'static str,
}

/// A part of the load.
///
/// What happens at an instant (a relay picks up, a delay ends) is announced beforehand: `guards`
/// are quantities whose change of sign is such an instant, `timer_s` is the next known one. The
/// simulation finds the instant and calls `react` there.
pub(super) trait Part {
    /// Number of states.
    fn states(&self) -> usize {
        0
    }

    /// The states before the event.
    fn initial_state(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Current drawn, pu of the load base.
    fn current(&self, at: Terminal, state: &[f64]) -> Phasor;

    /// Rates of change of the states, per second.
    fn derivatives(&self, _at: Terminal, _state: &[f64], _slope: &mut [f64]) {}

    /// Appends the quantities whose change of sign the part wants to be told of.
    fn guards(&self, _at: Terminal, _state: &[f64], _guards: &mut Vec<f64>) {}

    /// The next instant at which the part wants to be called.
    fn timer_s(&self) -> f64 {
        f64::INFINITY
    }

    /// Lets relays look at the voltage; what they do goes into `log`.
    fn react(&mut self, _at: Terminal, _state: &[f64], _log: &mut Vec<Operation>) {}
}

/// What lies between the measured terminals and the load.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Supply {
    /// Series impedance, pu of the load base.
    pub(super) impedance: Phasor,
    /// Transformer with taps behind it.
    pub(super) tap_changer: Option<TapChanger>,
}

impl Supply {
    /// The load at the measured terminals themselves.
    pub(super) const NONE: Self = Self {
        impedance: Phasor::new(0.0, 0.0),
        tap_changer: None,
    };

    /// Voltage at the load over voltage behind the series impedance.
    pub(super) fn ratio(&self) -> f64 {
        self.tap_changer.as_ref().map_or(1.0, TapChanger::ratio)
    }
}

/// All parts of a load; their states lie one after the other.
pub(super) struct Load {
    pub(super) supply: Supply,
    pub(super) parts: Vec<Box<dyn Part + Send>>,
}

impl Load {
    pub(super) fn initial_state(&self) -> Vec<f64> {
        let states = self.parts.iter().map(|part| part.initial_state());
        states.flatten().collect()
    }

    /// Current at the load's own terminals.
    pub(super) fn current(&self, at: Terminal, state: &[f64]) -> Phasor {
        let mut rest = state;
        let mut current = Phasor::new(0.0, 0.0);
        for part in &self.parts {
            let (own, others) = rest.split_at(part.states());
            current += part.current(at, own);
            rest = others;
        }
        current
    }

    pub(super) fn derivatives(&self, at: Terminal, state: &[f64], slope: &mut [f64]) {
        let (mut rest, mut slope_rest) = (state, slope);
        for part in &self.parts {
            let (own, others) = rest.split_at(part.states());
            let (own_slope, other_slopes) = slope_rest.split_at_mut(part.states());
            part.derivatives(at, own, own_slope);
            (rest, slope_rest) = (others, other_slopes);
        }
    }

    pub(super) fn guards(&self, at: Terminal, state: &[f64], guards: &mut Vec<f64>) {
        guards.clear();
        let mut rest = state;
        for part in &self.parts {
            let (own, others) = rest.split_at(part.states());
            part.guards(at, own, guards);
            rest = others;
        }
        if let Some(taps) = &self.supply.tap_changer {
            guards.extend(taps.guards(at.voltage.norm()));
        }
    }

    pub(super) fn timer_s(&self) -> f64 {
        let taps = self.supply.tap_changer.as_ref();
        let parts = self.parts.iter().map(|part| part.timer_s());
        parts
            .chain(taps.map(TapChanger::timer_s))
            .fold(f64::INFINITY, f64::min)
    }

    pub(super) fn react(&mut self, at: Terminal, state: &[f64], log: &mut Vec<Operation>) {
        let mut rest = state;
        for part in &mut self.parts {
            let (own, others) = rest.split_at(part.states());
            part.react(at, own, log);
            rest = others;
        }
        if let Some(taps) = &mut self.supply.tap_changer {
            taps.react(at, log);
        }
    }
}
