//! Which channels of a recording look like three-phase voltages and currents, and which belong
//! together: a proposal for the engineer who writes the mapping.
//!
//! Names are compared with the phase letter taken out (`Ia_VL2`, `Ib_VL2`, `Ic_VL2` share
//! `I*_VL2`), in Latin, Cyrillic and Chinese labels; then circuits with phases A, B, C; then
//! neighbours with phases A, B, C.

mod phase;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

use phase::{Place, places, stated_phase};

use super::{
    comtrade::{AnalogChannel, Recording},
    mapping::{Quantity, RecordingMapping, ThreePhase},
};
use crate::measurement::phasor::{Connection, Settings};

/// Why three channels are thought to belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Evidence {
    /// Their names differ in the phase letter only.
    Name,
    /// They have one circuit and phases A, B, C.
    Circuit,
    /// They follow each other with phases A, B, C.
    Order,
}

impl Evidence {
    /// One word for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Name => "name",
            Self::Circuit => "circuit",
            Self::Order => "order",
        }
    }
}

/// Three channels that look like one three-phase quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Triple {
    /// Voltage or current.
    pub quantity: Quantity,
    /// Indices into the recording's analog channels, phases a, b, c.
    pub channels: [usize; 3],
    /// Connection, for voltages.
    pub connection: Connection,
    /// The common name, with `*` for the phase.
    pub label: String,
    /// Why they are thought to belong together.
    pub evidence: Evidence,
}

/// A load that a recording seems to hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// Label of the currents.
    pub label: String,
    /// Label of the voltages chosen for them: those whose label is most alike, else the first.
    pub voltage_label: String,
    /// The mapping.
    pub mapping: RecordingMapping,
}

/// The three-phase quantities of a recording, in order of their first channel.
#[must_use]
pub fn group(recording: &Recording) -> Vec<Triple> {
    let channels = &recording.analog;
    let mut free: BTreeSet<usize> = (0..channels.len())
        .filter(|&index| quantity(&channels[index]).is_some())
        .filter(|&index| !phase::is_residual(&channels[index]))
        .collect();
    let mut triples = Vec::new();
    let passes = [by_name(channels), by_circuit(channels), by_order(channels)];
    for triple in passes.into_iter().flatten() {
        if triple.channels.iter().all(|index| free.contains(index)) {
            for index in triple.channels {
                free.remove(&index);
            }
            triples.push(triple);
        }
    }
    triples.sort_by_key(|triple| triple.channels.into_iter().min());
    triples
}

/// One proposal for each three-phase current.
#[must_use]
pub fn propose(recording: &Recording, triples: &[Triple]) -> Vec<Proposal> {
    let of = |quantity| triples.iter().filter(move |t| t.quantity == quantity);
    let circuit = |triple: &Triple| &recording.analog[triple.channels[0]].circuit;
    of(Quantity::Current)
        .filter_map(|current| {
            let likeness = |voltage: &&Triple| {
                let labels = likeness(&voltage.label, &current.label);
                labels + likeness(circuit(voltage), circuit(current))
            };
            // The first of the equally alike: `max_by` would take the last.
            let voltage = of(Quantity::Voltage)
                .rev()
                .max_by(|x, y| likeness(x).total_cmp(&likeness(y)))?;
            Some(Proposal {
                label: current.label.clone(),
                voltage_label: voltage.label.clone(),
                mapping: RecordingMapping {
                    voltage: three_phase(recording, voltage),
                    connection: voltage.connection,
                    currents: vec![three_phase(recording, current)],
                    apply_skew: false,
                    phasors: Settings::default(),
                },
            })
        })
        .collect()
}

/// Channel names, or numbers where a name is not unique.
fn three_phase(recording: &Recording, triple: &Triple) -> ThreePhase {
    let name = |index: usize| {
        let channel = &recording.analog[index];
        let same = recording.analog.iter().filter(|c| c.name == channel.name);
        if channel.name.is_empty() || same.count() > 1 {
            channel.number.to_string()
        } else {
            channel.name.clone()
        }
    };
    ThreePhase {
        channels: triple.channels.map(name),
        ..ThreePhase::default()
    }
}

/// Quantity by the unit; by the first letter that says so where there is no unit.
fn quantity(channel: &AnalogChannel) -> Option<Quantity> {
    if !channel.unit.is_empty() {
        return Quantity::of_unit(&channel.unit).map(|(quantity, _)| quantity);
    }
    channel.name.chars().find_map(|c| match c {
        'I' | 'i' => Some(Quantity::Current),
        'U' | 'u' | 'V' | 'v' => Some(Quantity::Voltage),
        _ => None,
    })
}

/// Triples whose names differ in the phase only. Letters go before digits, close channels before
/// distant ones.
fn by_name(channels: &[AnalogChannel]) -> Vec<Triple> {
    type Key = (bool, String, bool, bool, String);
    let mut stems: BTreeMap<Key, [Option<usize>; 3]> = BTreeMap::new();
    for (index, channel) in channels.iter().enumerate() {
        let Some(quantity) = quantity(channel) else {
            continue;
        };
        for Place {
            phase,
            stem,
            between,
            digit,
        } in places(channel)
        {
            let voltage = quantity == Quantity::Voltage;
            if between && !voltage {
                continue;
            }
            let key = (digit, stem, between, voltage, channel.unit.clone());
            stems.entry(key).or_default()[phase].get_or_insert(index);
        }
    }
    let mut found: Vec<(bool, usize, usize, Triple)> = Vec::new();
    for ((digit, stem, between, voltage, _), slots) in stems {
        let [Some(a), Some(b), Some(c)] = slots else {
            continue;
        };
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let triple = Triple {
            quantity: if voltage {
                Quantity::Voltage
            } else {
                Quantity::Current
            },
            channels: [a, b, c],
            connection: if between {
                Connection::LineToLine
            } else {
                Connection::LineToGround
            },
            label: stem,
            evidence: Evidence::Name,
        };
        found.push((digit, high - low, low, triple));
    }
    found.sort_by_key(|(digit, span, low, _)| (*digit, *span, *low));
    found.into_iter().map(|(_, _, _, triple)| triple).collect()
}

/// Triples of one circuit, quantity and unit with each phase stated once.
fn by_circuit(channels: &[AnalogChannel]) -> Vec<Triple> {
    let mut circuits: BTreeMap<(String, bool, String), [Vec<usize>; 3]> = BTreeMap::new();
    for (index, channel) in channels.iter().enumerate() {
        let (Some(quantity), Some(phase)) = (quantity(channel), stated_phase(channel)) else {
            continue;
        };
        if !channel.circuit.is_empty() {
            let voltage = quantity == Quantity::Voltage;
            let key = (channel.circuit.clone(), voltage, channel.unit.clone());
            circuits.entry(key).or_default()[phase].push(index);
        }
    }
    let mut triples = Vec::new();
    for ((circuit, voltage, _), phases) in circuits {
        if let [[a], [b], [c]] = phases.each_ref().map(Vec::as_slice) {
            triples.push(Triple {
                quantity: if voltage {
                    Quantity::Voltage
                } else {
                    Quantity::Current
                },
                channels: [*a, *b, *c],
                connection: Connection::LineToGround,
                label: circuit,
                evidence: Evidence::Circuit,
            });
        }
    }
    triples
}

/// Triples of neighbours with phases A, B, C of one quantity and unit.
fn by_order(channels: &[AnalogChannel]) -> Vec<Triple> {
    let mut triples = Vec::new();
    for (first, three) in channels.windows(3).enumerate() {
        let Some(quantity) = quantity(&three[0]) else {
            continue;
        };
        let in_order = three
            .iter()
            .enumerate()
            .all(|(k, channel)| stated_phase(channel) == Some(k) && channel.unit == three[0].unit);
        if in_order {
            triples.push(Triple {
                quantity,
                channels: [first, first + 1, first + 2],
                connection: Connection::LineToGround,
                label: three[0].name.clone(),
                evidence: Evidence::Order,
            });
        }
    }
    triples
}

/// Share of letter pairs two labels have in common (Dice's coefficient), 0 to 1.
fn likeness(one: &str, other: &str) -> f64 {
    let pairs = |text: &str| -> BTreeSet<(char, char)> {
        let letters: Vec<char> = text.chars().filter(|c| !c.is_whitespace()).collect();
        letters.windows(2).map(|pair| (pair[0], pair[1])).collect()
    };
    let (one, other) = (pairs(one), pairs(other));
    let common = one.intersection(&other).count();
    2.0 * common as f64 / (one.len() + other.len()).max(1) as f64
}
