//! What a load is made of: parts that draw a current, some with states, some with relays.

use super::Phasor;

/// A part of the load. Effects are added as further parts, or as relays inside a part.
pub(super) trait Part {
    /// Number of states.
    fn states(&self) -> usize;

    /// The states before the event.
    fn initial_state(&self) -> Vec<f64>;

    /// Current drawn, pu of the load base.
    fn current(&self, voltage: Phasor, state: &[f64]) -> Phasor;

    /// Rates of change of the states, per second.
    fn derivatives(&self, voltage: Phasor, state: &[f64], slope: &mut [f64]);

    /// Lets the part's relays look at the voltage; whether one of them switched.
    fn scan(&mut self, _time_s: f64, _voltage_pu: f64) -> bool {
        false
    }
}

/// All parts of a load; their states lie one after the other.
pub(super) struct Load {
    pub(super) parts: Vec<Box<dyn Part>>,
}

impl Load {
    pub(super) fn initial_state(&self) -> Vec<f64> {
        let states = self.parts.iter().map(|part| part.initial_state());
        states.flatten().collect()
    }

    pub(super) fn current(&self, voltage: Phasor, state: &[f64]) -> Phasor {
        let mut rest = state;
        let mut current = Phasor::new(0.0, 0.0);
        for part in &self.parts {
            let (own, others) = rest.split_at(part.states());
            current += part.current(voltage, own);
            rest = others;
        }
        current
    }

    pub(super) fn derivatives(&self, voltage: Phasor, state: &[f64], slope: &mut [f64]) {
        let (mut rest, mut slope_rest) = (state, slope);
        for part in &self.parts {
            let (own, others) = rest.split_at(part.states());
            let (own_slope, other_slopes) = slope_rest.split_at_mut(part.states());
            part.derivatives(voltage, own, own_slope);
            (rest, slope_rest) = (others, other_slopes);
        }
    }

    pub(super) fn scan(&mut self, time_s: f64, voltage_pu: f64) -> bool {
        let mut switched = false;
        for part in &mut self.parts {
            switched |= part.scan(time_s, voltage_pu);
        }
        switched
    }
}
