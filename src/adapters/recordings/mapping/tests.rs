//! The mapping on a small recording of our own and, where the folder is there, on real recordings
//! with reference phasors beside them.

use std::{
    f64::consts::{PI, TAU},
    path::PathBuf,
};

use super::*;
use crate::adapters::recordings::comtrade::{self, Options};

/// A 2013 ASCII recording: 60 ms of 50 Hz at 1 kHz, 110 kV and 300 A secondary, channel 7 reversed.
fn recording(unit: &str, scaling: &str) -> Recording {
    use std::fmt::Write as _;
    let channel = |n: usize, name: &str, unit: &str, ratio: &str| {
        format!("{n},{name},,,{unit},0.01,0,0,-99999,99998,{ratio},{scaling}\n")
    };
    let mut text = "here,recorder,1999\n7,7A,0D\n".to_owned();
    for (n, name) in ["Ua", "Ub", "Uc"].iter().enumerate() {
        text += &channel(n + 1, name, unit, "110000,100");
    }
    for (n, name) in ["Ia", "Ib", "Ic", "Ia"].iter().enumerate() {
        text += &channel(n + 4, name, "A", "600,5");
    }
    text += "50\n1\n1000,60\n02/01/2020,00:00:01.0\n02/01/2020,00:00:01.0\nASCII\n1\n";
    let mut data = String::new();
    for n in 0..60_u32 {
        write!(data, "{},{}", n + 1, n * 1000).unwrap();
        let angle = TAU * 0.05 * f64::from(n);
        for k in [0.0, 1.0, 2.0] {
            let volts = (2.0_f64 / 3.0).sqrt() * 100.0 * (angle - k * TAU / 3.0).cos();
            write!(data, ",{:.0}", volts * 100.0).unwrap();
        }
        for k in [0.0, 1.0, 2.0] {
            let amperes = 2.5 * 2.0_f64.sqrt() * (angle - k * TAU / 3.0).cos();
            write!(data, ",{:.0}", amperes * 100.0).unwrap();
        }
        data += ",0\n";
    }
    comtrade::decode(text.as_bytes(), data.as_bytes(), &Options::default()).unwrap()
}

fn site() -> Site {
    Site {
        name: "here".to_owned(),
        s_base_mva: 50.0,
        v_base_kv: 110.0,
        nominal_hz: 50.0,
    }
}

#[test]
fn secondary_values_become_primary_per_unit() {
    let mapping = RecordingMapping::new(["Ua", "Ub", "Uc"], ["4", "Ib", "Ic"]);
    let record = mapping.record(&recording("V", "S"), &site()).unwrap();
    // 110 kV and 2.5 A x 120 = 300 A: 57.16 MVA on 50.
    for sample in &record.samples {
        assert!((sample.voltage_pu - 1.0).abs() < 1e-4, "{sample:?}");
        assert!(
            (sample.active_pu - 57.1577 / 50.0).abs() < 1e-3,
            "{sample:?}"
        );
    }
    let mut reversed = mapping;
    reversed.currents[0].reversed = true;
    let record = reversed.record(&recording("V", "S"), &site()).unwrap();
    assert!(record.samples[0].active_pu < -1.1);
}

#[test]
fn feeders_add_up() {
    let mut mapping = RecordingMapping::new(["1", "2", "3"], ["4", "5", "6"]);
    mapping.currents.push(mapping.currents[0].clone());
    let record = mapping.record(&recording("V", "S"), &site()).unwrap();
    assert!((record.samples[0].active_pu - 2.0 * 57.1577 / 50.0).abs() < 2e-3);
}

#[test]
fn mapping_that_does_not_fit_says_which_channel() {
    let say = |mapping: &RecordingMapping, recording: &Recording| {
        mapping.record(recording, &site()).unwrap_err().to_string()
    };
    let good = RecordingMapping::new(["Ua", "Ub", "Uc"], ["4", "Ib", "Ic"]);
    let ambiguous = RecordingMapping::new(["Ua", "Ub", "Uc"], ["Ia", "Ib", "Ic"]);
    let absent = RecordingMapping::new(["Ua", "Ub", "Ux"], ["4", "Ib", "Ic"]);
    let swapped = RecordingMapping::new(["4", "Ib", "Ic"], ["Ua", "Ub", "Uc"]);
    let secondary = recording("V", "S");
    assert_eq!(
        say(&ambiguous, &secondary),
        "2 channels are called 'Ia': use their numbers"
    );
    assert_eq!(
        say(&absent, &secondary),
        "no channel is called or numbered 'Ux'"
    );
    assert_eq!(
        say(&swapped, &secondary),
        "channel 'Ia' is in 'A', expected V or kV"
    );
    let unstated = say(&good, &recording("V", ""));
    assert!(
        unstated.contains("'Ua' does not say if it is primary"),
        "{unstated}"
    );
}

#[test]
fn units_are_read_in_latin_and_cyrillic() {
    use Quantity::{Current, Voltage};
    for (unit, expected) in [
        ("kV", Some((Voltage, 1e3))),
        ("\u{43a}\u{412}", Some((Voltage, 1e3))),
        ("\u{410}", Some((Current, 1.0))),
        ("ampere", Some((Current, 1.0))),
        ("mA", Some((Current, 1e-3))),
        ("Hz", None),
        ("", None),
    ] {
        assert_eq!(Quantity::of_unit(unit), expected, "{unit}");
    }
}

#[test]
fn skew_is_undone_when_asked_for() {
    let time_s: Vec<f64> = (0..48).map(|n| f64::from(n) / 1200.0).collect();
    let wave = |t: f64| (TAU * 50.0 * t).sin();
    for skew_s in [400e-6, -700e-6, 841e-6] {
        let late: Vec<f64> = time_s.iter().map(|t| wave(t + skew_s)).collect();
        let undone = shifted(&time_s, &late, skew_s);
        let known = undone.iter().zip(&time_s).filter(|(v, _)| v.is_finite());
        assert!(known.clone().count() >= 44);
        assert!(known.into_iter().all(|(v, t)| (v - wave(*t)).abs() < 2e-4));
    }
}

/// A reference table: rows of time, V1 (pu of an unstated base), P, Q and I1.
struct Reference {
    time_s: Vec<f64>,
    columns: [Vec<f64>; 4],
}

fn reference(name: &str) -> Option<Reference> {
    let path = shared().join(format!("reference_phasors/{name}.csv"));
    let mut reader = csv::Reader::from_path(path).ok()?;
    let headers = reader.headers().ok()?.clone();
    let mut columns = [const { Vec::new() }; 5];
    for row in reader.records() {
        let row = row.ok()?;
        for (column, name) in columns.iter_mut().zip(["time_s", "v_pu", "p1", "q1", "i1"]) {
            let at = headers.iter().position(|header| header == name)?;
            column.push(row[at].parse().ok()?);
        }
    }
    let [time_s, v, p, q, i] = columns;
    Some(Reference {
        time_s,
        columns: [v, p, q, i],
    })
}

fn shared() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data/recordings")
}

/// One comparison: the file, the channels by number, the reference, what its V1 is per unit of
/// (phase volts, in the file's unit), and how its time zero lies against the first sample.
struct Case {
    file: &'static str,
    reference: &'static str,
    voltage: [&'static str; 3],
    current: [&'static str; 3],
    base: f64,
    samples_per_cycle: f64,
    offset_s: f64,
}

/// 110 kV / sqrt(3) for ru110 (VL5: its median); 60.333 V for the Chinese recorders, whose file
/// of reference values takes the pre-fault voltage of bus I for base. Times of ru110 count from
/// sample number 1 where the file begins with 0; the second part of ymz begins where the rates
/// say, 0.16625 s before the stamps.
const CASES: [Case; 11] = {
    const fn case(
        names: [&'static str; 2],
        voltage: [&'static str; 3],
        current: [&'static str; 3],
        numbers: [f64; 3],
    ) -> Case {
        let [base, samples_per_cycle, offset_s] = numbers;
        let [file, reference] = names;
        Case {
            file,
            reference,
            voltage,
            current,
            base,
            samples_per_cycle,
            offset_s,
        }
    }
    const RU: f64 = 63.508_530;
    const FIRST: f64 = 1.0 / 1200.0;
    const XTZ: [&str; 3] = ["17", "18", "19"];
    const XTZ_2: [&str; 3] = ["9", "10", "11"];
    const YMZ: [&str; 3] = ["53", "54", "55"];
    const YMZ_2: [&str; 3] = ["61", "62", "63"];
    const BUS: [&str; 3] = ["1", "2", "3"];
    [
        case(
            ["ru110", "ru110_VL2"],
            ["5", "6", "7"],
            ["17", "18", "19"],
            [RU, 24.0, FIRST],
        ),
        case(
            ["ru110", "ru110_VL3"],
            BUS,
            ["21", "22", "23"],
            [RU, 24.0, FIRST],
        ),
        case(
            ["ru110", "ru110_VL5"],
            BUS,
            ["29", "30", "31"],
            [52.192_25, 24.0, FIRST],
        ),
        case(["xtz", "xtz_T1hv_seg0"], BUS, XTZ, [60.3331, 64.0, 0.0]),
        case(["xtz", "xtz_T1hv_seg1"], BUS, XTZ, [60.3331, 64.0, 0.0]),
        case(["xtz", "xtz_T2hv_seg0"], BUS, XTZ_2, [60.3331, 64.0, 0.0]),
        case(["xtz", "xtz_T2hv_seg1"], BUS, XTZ_2, [60.3331, 64.0, 0.0]),
        case(["ymz", "ymz_T1hv_seg0"], BUS, YMZ, [60.3331, 80.0, 0.0]),
        case(
            ["ymz", "ymz_T1hv_seg1"],
            BUS,
            YMZ,
            [60.3331, 80.0, 0.166_25],
        ),
        case(["ymz", "ymz_T2hv_seg0"], BUS, YMZ_2, [60.3331, 80.0, 0.0]),
        case(
            ["ymz", "ymz_T2hv_seg1"],
            BUS,
            YMZ_2,
            [60.3331, 80.0, 0.166_25],
        ),
    ]
};

/// The reference resamples every channel to 64 samples per cycle by linear interpolation first,
/// which takes sinc^2(1 / N) off a sine of N samples per cycle: 0.57 % at 24, nothing where N is
/// 64. The comparison undoes that known loss of the reference, and only that.
fn interpolation_gain(samples_per_cycle: f64) -> f64 {
    let x = PI / samples_per_cycle;
    if (samples_per_cycle - 64.0).abs() < 1e-9 {
        1.0
    } else {
        (x.sin() / x).powi(2)
    }
}

/// Deviations of V1 and of P and Q (of apparent power), percent, away from edges: rows within one
/// cycle of which V1 stays within 1 %.
fn deviations(case: &Case) -> Option<Vec<[f64; 3]>> {
    let table = reference(case.reference)?;
    let path = shared().join(format!("{0}/{0}.cfg", case.file));
    let recording = comtrade::read(&path, &Options::default()).unwrap();
    let mapping = RecordingMapping::new(case.voltage, case.current);
    let waveforms = mapping.waveforms(&recording, 50.0).unwrap();
    let times_s: Vec<f64> = table.time_s.iter().map(|t| t + case.offset_s).collect();
    let phasors = phasor::sequences_at(&waveforms, &mapping.phasors, &times_s);
    // The reference stays in the file's unit and on its side of the transformers.
    let channel = |name: &str| {
        let channel = recording.channel(name).unwrap();
        (
            channel.to_primary().unwrap(),
            Quantity::of_unit(&channel.unit).unwrap().1,
        )
    };
    let (volts, volt_unit) = channel(case.voltage[0]);
    let (amperes, _) = channel(case.current[0]);
    let gain = interpolation_gain(case.samples_per_cycle);
    let [v, p, q, _] = &table.columns;
    let mut found = Vec::new();
    for (row, phasor) in phasors.iter().enumerate() {
        let around = &v[row.saturating_sub(4)..(row + 5).min(v.len())];
        let low = around.iter().copied().fold(f64::INFINITY, f64::min);
        let high = around.iter().copied().fold(0.0, f64::max);
        let Some((phasor, _)) = phasor else { continue };
        if high > 1.01 * low {
            continue;
        }
        let voltage = phasor.v1.magnitude() / (volts * volt_unit * case.base);
        let power = phasor.power_va().scale(1.0 / (volts * volt_unit * amperes));
        let [p, q] = [p[row], q[row]].map(|value| value / (gain * gain));
        let apparent = p.hypot(q);
        found.push([
            100.0 * (voltage * gain / v[row] - 1.0),
            100.0 * (power.re - p) / apparent,
            100.0 * (power.im - q) / apparent,
        ]);
    }
    Some(found)
}

#[test]
fn phasors_of_real_recordings_agree_with_the_reference() {
    let mut problems = Vec::new();
    for case in &CASES {
        let Some(rows) = deviations(case) else {
            println!(
                "skipped {}: no recordings beside the project",
                case.reference
            );
            continue;
        };
        let sorted = |k: usize| {
            let mut column: Vec<f64> = rows.iter().map(|row| row[k].abs()).collect();
            column.sort_by(f64::total_cmp);
            column
        };
        // One row in a hundred may lie next to a switching that V1 does not show.
        let column = [0, 1, 2].map(sorted);
        let worst = column
            .each_ref()
            .map(|c| c.last().copied().unwrap_or(f64::NAN));
        let usual = column
            .each_ref()
            .map(|c| c.get(c.len() * 99 / 100).copied());
        let line = format!(
            "{}: {} rows; 99 % of them within V {:.3?} P {:.3?} Q {:.3?} %; worst {worst:.3?} %",
            case.reference,
            rows.len(),
            usual[0],
            usual[1],
            usual[2],
        );
        println!("{line}");
        if usual.iter().any(|u| u.is_none_or(|u| u > 0.2)) || worst.iter().any(|w| *w > 0.3) {
            problems.push(line);
        }
    }
    assert!(problems.is_empty(), "{problems:#?}");
}
