//! Grouping on labels as recorders write them.

use std::path::PathBuf;

use super::*;
use crate::adapters::recordings::comtrade::{self, Options};

/// A recording of one sample whose channels are `(name, phase, circuit, unit)`.
fn recording(channels: &[(&str, &str, &str, &str)]) -> Recording {
    use std::fmt::Write as _;
    let count = channels.len();
    let mut text = format!("s,r,1999\n{count},{count}A,0D\n");
    for (n, (name, phase, circuit, unit)) in channels.iter().enumerate() {
        writeln!(
            text,
            "{},{name},{phase},{circuit},{unit},1,0,0,-9,9,1,1,P",
            n + 1
        )
        .unwrap();
    }
    text += "50\n1\n1000,1\n02/01/2020,0:0:0\n02/01/2020,0:0:0\nASCII\n1\n";
    let data = "1,0".to_owned() + &",0".repeat(count);
    comtrade::decode(text.as_bytes(), data.as_bytes(), &Options::default()).unwrap()
}

fn labels(recording: &Recording) -> Vec<(String, [usize; 3])> {
    let triples = group(recording);
    triples.into_iter().map(|t| (t.label, t.channels)).collect()
}

#[test]
fn names_that_differ_in_the_phase_letter_are_grouped_in_any_script() {
    let recording = recording(&[
        ("Ua_1\u{421}\u{428}-110", "A", "", "kV"),
        ("Ub_1\u{421}\u{428}-110", "B", "", "kV"),
        ("Uc_1\u{421}\u{428}-110", "C", "", "kV"),
        ("3Uo_1\u{421}\u{428}-110", "N", "", "kV"),
        ("1\u{53f7}\u{4e3b}\u{53d8}_Ia", "A", "", "A"),
        ("1\u{53f7}\u{4e3b}\u{53d8}_Ib", "B", "", "A"),
        ("1\u{53f7}\u{4e3b}\u{53d8}_Ic", "C", "", "A"),
        ("Ic\u{5bf9}\u{4fa7}", "", "", "A"),
        ("Ia\u{5bf9}\u{4fa7}", "", "", "A"),
        ("Ib\u{5bf9}\u{4fa7}", "", "", "A"),
        ("HV IR", "", "", "A"),
        ("HV IS", "", "", "A"),
        ("HV IT", "", "", "A"),
        (
            "I\u{410} \u{444}\u{438}\u{434}\u{435}\u{440}",
            "",
            "",
            "\u{410}",
        ),
        (
            "I\u{412} \u{444}\u{438}\u{434}\u{435}\u{440}",
            "",
            "",
            "\u{410}",
        ),
        (
            "I\u{421} \u{444}\u{438}\u{434}\u{435}\u{440}",
            "",
            "",
            "\u{410}",
        ),
    ]);
    let expected = [
        ("U*_1\u{421}\u{428}-110", [0, 1, 2]),
        ("1\u{53f7}\u{4e3b}\u{53d8}_I*", [4, 5, 6]),
        ("I*\u{5bf9}\u{4fa7}", [8, 9, 7]),
        ("HV I*", [10, 11, 12]),
        ("I* \u{444}\u{438}\u{434}\u{435}\u{440}", [13, 14, 15]),
    ];
    let expected: Vec<_> = expected
        .iter()
        .map(|(l, c)| ((*l).to_owned(), *c))
        .collect();
    assert_eq!(labels(&recording), expected);
}

#[test]
fn feeder_numbers_are_not_taken_for_phases() {
    let recording = recording(&[
        ("F1-IA", "A", "", "A"),
        ("F1-IB", "B", "", "A"),
        ("F1-IC", "C", "", "A"),
        ("F2-IA", "A", "", "A"),
        ("F2-IB", "B", "", "A"),
        ("F2-IC", "C", "", "A"),
        ("F3-IA", "A", "", "A"),
    ]);
    let expected = [
        ("F1-I*".to_owned(), [0, 1, 2]),
        ("F2-I*".to_owned(), [3, 4, 5]),
    ];
    assert_eq!(labels(&recording), expected);
}

#[test]
fn numbered_and_plain_channels_are_grouped_by_order_circuit_or_digit() {
    let numbered = recording(&[
        ("1-Ia", "A", "", "A"),
        ("2-Ib", "B", "", "A"),
        ("3-Ic", "C", "", "A"),
        ("x", "B", "bus 1", "kV"),
        ("y", "A", "bus 1", "kV"),
        ("z", "C", "bus 1", "kV"),
        ("I1", "", "", "A"),
        ("I2", "", "", "A"),
        ("I3", "", "", "A"),
        ("I4", "", "", "A"),
    ]);
    let triples = group(&numbered);
    let found: Vec<_> = triples.iter().map(|t| (t.channels, t.evidence)).collect();
    let expected = [
        ([0, 1, 2], Evidence::Order),
        ([4, 3, 5], Evidence::Circuit),
        ([6, 7, 8], Evidence::Name),
    ];
    assert_eq!(found, expected);
}

#[test]
fn phase_field_that_numbers_every_channel_alike_does_not_hide_the_letters() {
    let recording = recording(&[
        ("Ia", "1", "", "A"),
        ("Ib", "1", "", "A"),
        ("Ic", "1", "", "A"),
    ]);
    assert_eq!(labels(&recording), [("I*".to_owned(), [0, 1, 2])]);
}

#[test]
fn voltages_between_phases_are_recognised() {
    let recording = recording(&[
        ("Uab", "", "", "kV"),
        ("Ubc", "", "", "kV"),
        ("Uca", "", "", "kV"),
    ]);
    let triples = group(&recording);
    assert_eq!(triples.len(), 1);
    assert_eq!(triples[0].connection, Connection::LineToLine);
}

#[test]
fn current_is_paired_with_the_voltage_of_its_own_bus() {
    let recording = recording(&[
        ("Ua_bus1", "A", "", "kV"),
        ("Ub_bus1", "B", "", "kV"),
        ("Uc_bus1", "C", "", "kV"),
        ("Ua_bus2", "A", "", "kV"),
        ("Ub_bus2", "B", "", "kV"),
        ("Uc_bus2", "C", "", "kV"),
        ("Ia_bus2_L4", "A", "", "A"),
        ("Ib_bus2_L4", "B", "", "A"),
        ("Ic_bus2_L4", "C", "", "A"),
        ("Ia", "A", "", "A"),
        ("Ib", "B", "", "A"),
        ("Ic", "C", "", "A"),
    ]);
    let proposals = propose(&recording, &group(&recording));
    let pairs: Vec<_> = proposals
        .iter()
        .map(|p| (p.label.as_str(), p.voltage_label.as_str()))
        .collect();
    assert_eq!(pairs, [("I*_bus2_L4", "U*_bus2"), ("I*", "U*_bus1")]);
    assert_eq!(proposals[0].mapping.currents[0].channels[1], "Ib_bus2_L4");
}

#[test]
fn feeders_of_real_recordings_are_found() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data/recordings");
    // Three-phase voltages and currents as counted by hand in the channel lists.
    for (name, voltages, currents) in [("ru110", 2, 11), ("xtz", 2, 8), ("ymz", 10, 9)] {
        let path = folder.join(format!("{name}/{name}.cfg"));
        if !path.is_file() {
            println!("skipped {name}: no recordings beside the project");
            continue;
        }
        let recording = comtrade::read(&path, &Options::default()).unwrap();
        let triples = group(&recording);
        let count = |quantity| triples.iter().filter(|t| t.quantity == quantity).count();
        let found = (count(Quantity::Voltage), count(Quantity::Current));
        for proposal in propose(&recording, &triples) {
            println!("{name}: {} with {}", proposal.label, proposal.voltage_label);
        }
        assert_eq!(found, (voltages, currents), "{name}");
    }
}
