//! Which phasors of a PMU look like a load's voltage and currents, by their names: a proposal for the
//! engineer who writes the mapping.

use std::collections::BTreeMap;

use super::{
    channel::{PhasorChannel, PhasorComponent, PhasorQuantity},
    configuration::PmuConfiguration,
    load_mapping::{LoadMapping, PhasorSet, PmuChoice, PowerSource, SignedSet},
};

/// Letters of the phases in the order of rotation.
const LETTERS: [[char; 3]; 5] = [
    ['A', 'B', 'C'],
    ['R', 'S', 'T'],
    ['U', 'V', 'W'],
    ['\u{410}', '\u{412}', '\u{421}'],
    ['1', '2', '3'],
];
/// Words that mark a positive sequence, in a name without blanks in capitals.
const POSITIVE: [&str; 8] = ["V1", "U1", "I1", "VPOS", "UPOS", "IPOS", "POSSEQ", "+SEQ"];

/// A mapping of `pmu` with every current that seems to be a feeder's, each taken into the load. None
/// when no voltage or no current can be told. A name that the PMU has twice is given as `#n`.
#[must_use]
pub fn propose(pmu: &PmuConfiguration) -> Option<LoadMapping> {
    let voltage = sets(pmu, PhasorQuantity::Voltage).into_iter().next()?;
    let currents = sets(pmu, PhasorQuantity::Current);
    let first = currents.first()?.clone();
    let feeders = currents.into_iter().map(|phasors| SignedSet {
        phasors,
        reversed: false,
    });
    Some(LoadMapping {
        pmu: PmuChoice::IdCode(pmu.id_code),
        power: PowerSource::Currents(feeders.collect()),
        ..LoadMapping::new(voltage, first)
    })
}

/// Three phases that belong together, then positive sequences of what is left. One of a quantity whose
/// phases are there is the same current once more, and left out.
fn sets(pmu: &PmuConfiguration, quantity: PhasorQuantity) -> Vec<PhasorSet> {
    let of_quantity = |(_, channel): &(usize, &PhasorChannel)| channel.quantity == quantity;
    let channels: Vec<(usize, &PhasorChannel)> =
        pmu.phasors.iter().enumerate().filter(of_quantity).collect();
    let phases = three_phases(&channels);
    if !phases.is_empty() {
        let named = phases
            .into_iter()
            .map(|three| three.map(|index| name(pmu, index)));
        return named.map(PhasorSet::Phases).collect();
    }
    let positive = channels
        .into_iter()
        .filter(|(_, channel)| is_positive(channel));
    let named = positive.map(|(index, _)| name(pmu, index));
    named.map(PhasorSet::PositiveSequence).collect()
}

/// Indices of phasors whose names differ in the phase only, in the order of the first of each three.
fn three_phases(channels: &[(usize, &PhasorChannel)]) -> Vec<[usize; 3]> {
    let mut found: Vec<[usize; 3]> = Vec::new();
    for letters in LETTERS {
        let mut stems: BTreeMap<String, [Option<usize>; 3]> = BTreeMap::new();
        for (index, channel) in channels {
            if found.iter().flatten().any(|taken| taken == index) {
                continue;
            }
            for (stem, phase) in stems_of(&channel.name, letters) {
                stems.entry(stem).or_default()[phase].get_or_insert(*index);
            }
        }
        for three in stems.into_values() {
            let [Some(a), Some(b), Some(c)] = three else {
                continue;
            };
            let taken = |index: &usize| found.iter().flatten().any(|taken| taken == index);
            if ![a, b, c].iter().any(taken) {
                found.push([a, b, c]);
            }
        }
    }
    found.sort_unstable();
    found
}

/// The name with a phase's letter taken out, for every place where it may be one.
fn stems_of(name: &str, letters: [char; 3]) -> Vec<(String, usize)> {
    let name: Vec<char> = name.trim().to_uppercase().chars().collect();
    let places = name.iter().enumerate().filter_map(|(at, letter)| {
        let phase = letters.iter().position(|known| known == letter)?;
        let (before, after) = (name[..at].iter(), name[at + 1..].iter());
        Some((before.chain(&['*']).chain(after).collect(), phase))
    });
    places.collect()
}

fn is_positive(channel: &PhasorChannel) -> bool {
    if let Some(component) = channel.component() {
        return component == PhasorComponent::PositiveSequence;
    }
    let name = channel.name.to_uppercase();
    let name: String = name.chars().filter(|c| !" _-.".contains(*c)).collect();
    POSITIVE.iter().any(|mark| name.contains(mark))
}

/// The channel's name if the PMU has it once, else its number.
fn name(pmu: &PmuConfiguration, index: usize) -> String {
    let name = pmu.phasors[index].name.trim();
    let alike = pmu.phasors.iter().filter(|p| p.name.trim() == name).count();
    if alike == 1 && !name.is_empty() && !name.starts_with('#') {
        name.to_owned()
    } else {
        format!("#{}", index + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::c37118::{Format, NominalFrequencyCode, PhasorScaling};

    fn pmu(names: &[&str]) -> PmuConfiguration {
        let phasor = |name: &&str| PhasorChannel {
            name: (*name).to_owned(),
            quantity: if name.contains('I') {
                PhasorQuantity::Current
            } else {
                PhasorQuantity::Voltage
            },
            scaling: PhasorScaling::PerBit(1),
        };
        PmuConfiguration {
            station: "S".to_owned(),
            id_code: 7,
            format: Format(0),
            phasors: names.iter().map(phasor).collect(),
            analogs: Vec::new(),
            digitals: Vec::new(),
            nominal: NominalFrequencyCode::HZ_50,
            changes: 0,
            place: None,
        }
    }

    fn phases(names: [&str; 3]) -> PhasorSet {
        PhasorSet::Phases(names.map(str::to_owned))
    }

    fn currents(mapping: &LoadMapping) -> Vec<PhasorSet> {
        match &mapping.power {
            PowerSource::Currents(sets) => sets.iter().map(|s| s.phasors.clone()).collect(),
            other @ PowerSource::Analogs { .. } => panic!("{other:?}"),
        }
    }

    #[test]
    fn phases_are_found_whatever_their_order_and_letters() {
        let mapping = propose(&pmu(&["VB", "VA", "VC", "V1", "I_R", "I_S", "I_T"])).unwrap();
        assert_eq!(mapping.voltage, phases(["VA", "VB", "VC"]));
        assert_eq!(currents(&mapping), [phases(["I_R", "I_S", "I_T"])]);
        assert_eq!(mapping.pmu, PmuChoice::IdCode(7));
    }

    #[test]
    fn every_feeder_is_a_current_of_its_own() {
        let names = [
            "VA", "VB", "VC", "IA F1", "IB F1", "IC F1", "IA F2", "IB F2", "IC F2",
        ];
        let mapping = propose(&pmu(&names)).unwrap();
        let expected = [
            phases(["IA F1", "IB F1", "IC F1"]),
            phases(["IA F2", "IB F2", "IC F2"]),
        ];
        assert_eq!(currents(&mapping), expected);
    }

    #[test]
    fn a_positive_sequence_will_do_and_nothing_else() {
        let mapping = propose(&pmu(&["BUS V1", "LINE I1"])).unwrap();
        let set = |name: &str| PhasorSet::PositiveSequence(name.to_owned());
        assert_eq!(mapping.voltage, set("BUS V1"));
        assert_eq!(currents(&mapping), [set("LINE I1")]);
        assert_eq!(propose(&pmu(&["V0", "LINE I1"])), None);
        assert_eq!(propose(&pmu(&["VA", "VB", "IA"])), None);
    }

    #[test]
    fn names_that_are_there_twice_become_numbers() {
        let mapping = propose(&pmu(&["VA", "VB", "VC", "VA", "I1"])).unwrap();
        assert_eq!(mapping.voltage, phases(["#1", "VB", "VC"]));
    }
}
