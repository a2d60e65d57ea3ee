//! Relays that wait and then open at once, in place of those that pick up soon and open late.
//!
//! Both switch at the same time after the voltage has fallen, but a relay that waits does so only where the voltage
//! stays low, and where its own voltage is that of the first instants after a fault, it does not matter how far the voltage
//! sinks then. Between the two the objective has hills: voltage, delay and opening change together, and what static
//! load draws in a dip follows.

use nalgebra::DVector;

use super::{
    coordinates::Coordinates,
    fit::{ComposedFit, ComposedFitOptions, Place},
    relay_walk,
    rows::EventRows,
};
use crate::{
    load_model::{effect::Effect, effects},
    numerics::Objective,
};

/// Steps of the voltage from where it is, pu.
const VOLTAGE_STEPS_PU: [f64; 5] = [-0.02, 0.0, 0.02, 0.04, 0.06];
/// Steps of the delay from when the relay has switched in the middle, s: up to what an instrument's filter spreads.
const LATER_S: [f64; 9] = [-0.005, 0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.035];
/// How far a delay stays from how long the voltage is low in an event, s: half of the time over which a relay switches.
const BESIDE_S: f64 = 0.002;
/// What opens within this already has nothing to trade, s.
const AT_ONCE_S: f64 = 0.012;

/// The parameters of a fit with a relay that waits in place of one that does not, where it leaves less before anything else
/// has followed; none where none does, or nothing can be simulated.
pub(super) fn from_fit(
    rows: &[EventRows<'_>],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<f64>> {
    let relays = fit.model.effect_names().filter_map(effects::find);
    let settings = relays.filter_map(|relay| Settings::of(fit, relay));
    let settings: Vec<Settings> = settings.filter(|s| !s.opens_at_once(fit)).collect();
    if settings.is_empty() {
        return None;
    }
    let coordinates = Coordinates::new(&fit.model, &fit.parameters, &fit.free);
    let place = Place::new(rows, &fit.model, &coordinates, options, cancel);
    let x = coordinates.unknowns(&fit.parameters);
    let problem = place.problem(&x, None)?;
    let leaves = |x: &DVector<f64>| problem.value(x).unwrap_or(f64::INFINITY);
    let mut lowest = (leaves(&x) - 0.5 * relay_walk::WORTH, None);
    for relay in settings {
        for higher_pu in VOLTAGE_STEPS_PU {
            for delay_s in relay.delays_s(rows, fit, higher_pu) {
                let waits = relay.waits(fit, higher_pu, delay_s);
                let left = leaves(&coordinates.unknowns(&waits));
                if left < lowest.0 {
                    lowest = (left, Some(waits));
                }
            }
        }
    }
    lowest.1
}

/// The places of a relay's settings among the parameters of a fit.
struct Settings {
    voltage: usize,
    pick_up: usize,
    /// Until the first contact parts, and from there to the last.
    parting: [usize; 2],
}

impl Settings {
    /// Those of an effect that waits, where they are free.
    fn of(fit: &ComposedFit, relay: &'static dyn Effect) -> Option<Self> {
        let own = relay.declaration().name;
        let place = |name: &str| {
            let index = fit.model.index(&format!("{own}.{name}"))?;
            fit.free.contains(&index).then_some(index)
        };
        let [first, last] = relay.parting()?;
        Some(Self {
            voltage: place(relay.threshold()?)?,
            pick_up: place(relay.pick_up()?)?,
            parting: [place(first)?, place(last)?],
        })
    }

    fn opens_at_once(&self, fit: &ComposedFit) -> bool {
        let [opening, spread] = self.parting.map(|index| fit.parameters[index]);
        opening + spread < AT_ONCE_S
    }

    /// Delays around the time at which the relay has switched in the middle; and those that divide the events by how long
    /// they are below a voltage so much higher, s.
    fn delays_s(&self, rows: &[EventRows<'_>], fit: &ComposedFit, higher_pu: f64) -> Vec<f64> {
        let at = |index: usize| fit.parameters[index];
        let [opening, spread] = self.parting.map(at);
        let middle_s = at(self.pick_up) + opening + 0.5 * spread;
        let mut delays_s = LATER_S.map(|later| middle_s + later).to_vec();
        let [first, last] = [delays_s[0], delays_s[delays_s.len() - 1]];
        for event in rows.iter().map(EventRows::event) {
            let lasts_s = event.longest_below_s(at(self.voltage) + higher_pu);
            let beside = [lasts_s - BESIDE_S, lasts_s + BESIDE_S];
            delays_s.extend(beside.into_iter().filter(|s| (first..=last).contains(s)));
        }
        delays_s
    }

    /// The parameters of the fit with a relay that waits for so long, at a voltage so much higher, and opens at once.
    fn waits(&self, fit: &ComposedFit, higher_pu: f64, delay_s: f64) -> Vec<f64> {
        let mut parameters = fit.parameters.clone();
        parameters[self.voltage] += higher_pu;
        parameters[self.pick_up] = delay_s;
        for index in self.parting {
            parameters[index] = 0.0;
        }
        for index in [self.voltage, self.pick_up].into_iter().chain(self.parting) {
            let declared = &fit.model.parameters()[index].declaration;
            parameters[index] = parameters[index].clamp(declared.lower, declared.upper);
        }
        parameters
    }
}
