//! A site folder as text and JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::{number, utc_json, utc_text};
use crate::{
    adapters::recordings::site_folder::{FolderEvent, Intake, SiteFolder, onset},
    measurement::{Quality, Record},
};

/// What an event looks like.
struct Shape {
    onset_s: Option<f64>,
    /// Median voltage before the onset, pu.
    before_pu: f64,
    lowest_pu: f64,
    highest_pu: f64,
    frequency_range_hz: [f64; 2],
    active_before_pu: f64,
}

pub(super) fn text(folder: &SiteFolder) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _written = write(&mut text, folder);
    text
}

fn write(text: &mut String, folder: &SiteFolder) -> std::fmt::Result {
    let site = &folder.site;
    writeln!(text, "site folder {}", site.name)?;
    writeln!(
        text,
        "base       {} MVA, {} kV",
        site.s_base_mva, site.v_base_kv
    )?;
    writeln!(text, "frequency  {} Hz", site.nominal_hz)?;
    writeln!(text, "rate       {} per second", folder.rate_fps)?;
    for note in &folder.notes {
        writeln!(text, "note       {note}")?;
    }
    writeln!(text, "\n{} events", folder.events.len())?;
    for event in &folder.events {
        write_event(text, event)?;
    }
    Ok(())
}

fn write_event(text: &mut String, event: &FolderEvent) -> std::fmt::Result {
    let record = &event.record;
    let shape = shape(record);
    let channels = if record.has_angle() {
        "V, angle, f, P, Q"
    } else {
        "V, f, P, Q"
    };
    let onset = shape.onset_s.map_or("no onset found".to_owned(), |s| {
        format!("onset at {s:.3} s")
    });
    writeln!(text, "  {}  {}", event.name, utc_text(event.utc_ns))?;
    writeln!(
        text,
        "    {} samples in {:.3} s, {channels}; {onset}",
        record.samples.len(),
        record.duration_s()
    )?;
    writeln!(
        text,
        "    V {:.4} pu before, {:.4} to {:.4} (depth {:.4}); f {:.3} to {:.3} Hz; P {:.4} pu before",
        shape.before_pu,
        shape.lowest_pu,
        shape.highest_pu,
        shape.before_pu - shape.lowest_pu,
        shape.frequency_range_hz[0],
        shape.frequency_range_hz[1],
        shape.active_before_pu
    )?;
    let bad: Vec<String> = quality(record)
        .into_iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{name} {count}"))
        .chain(intake_text(&event.intake))
        .collect();
    let bad = if bad.is_empty() {
        "none".to_owned()
    } else {
        bad.join(", ")
    };
    let share = 100.0 * record.usable_share();
    writeln!(text, "    usable {share:.2} %; bad samples: {bad}")
}

fn intake_text(intake: &Intake) -> Vec<String> {
    let counts = [
        ("duplicate rows", intake.duplicates),
        ("rows out of order", intake.out_of_order),
        ("rows off the grid", intake.off_grid),
        ("rows without a time", intake.bad_rows),
        ("unreadable cells", intake.bad_cells),
    ];
    let nonzero = counts.iter().filter(|(_, count)| *count > 0);
    let mut texts: Vec<String> = nonzero
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    if let Some((line, column)) = intake.first_bad {
        texts.push(format!("first at line {line}, {column}"));
    }
    texts
}

fn quality(record: &Record) -> [(&'static str, usize); 5] {
    [
        ("missing", record.count_flagged(Quality::MISSING)),
        ("not finite", record.count_flagged(Quality::NOT_FINITE)),
        ("invalid", record.count_flagged(Quality::DATA_INVALID)),
        (
            "not synchronised",
            record.count_flagged(Quality::NOT_SYNCHRONISED),
        ),
        ("stale", record.count_flagged(Quality::STALE)),
    ]
}

fn shape(record: &Record) -> Shape {
    let onset = onset(record);
    let end = onset.unwrap_or(record.samples.len());
    let median = |value: fn(&crate::measurement::Sample) -> f64| {
        let before = record.samples[..end].iter().filter(|s| s.usable());
        let mut values: Vec<f64> = before.map(value).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let span = |value: fn(&crate::measurement::Sample) -> f64| {
        let usable = record.samples.iter().filter(|s| s.usable()).map(value);
        usable.fold([f64::NAN; 2], |[low, high], v| [low.min(v), high.max(v)])
    };
    let [lowest_pu, highest_pu] = span(|s| s.voltage_pu);
    Shape {
        onset_s: onset.map(|index| index as f64 / record.rate_fps),
        before_pu: median(|s| s.voltage_pu),
        lowest_pu,
        highest_pu,
        frequency_range_hz: span(|s| s.frequency_hz),
        active_before_pu: median(|s| s.active_pu),
    }
}

pub(super) fn json(folder: &SiteFolder) -> Value {
    let site = &folder.site;
    json!({
        "kind": "site_folder",
        "site": site.name,
        "base_mva": site.s_base_mva,
        "base_kv": site.v_base_kv,
        "nominal_hz": site.nominal_hz,
        "sample_rate_fps": folder.rate_fps,
        "events": folder.events.iter().map(event_json).collect::<Vec<_>>(),
        "notes": folder.notes.iter().map(ToString::to_string).collect::<Vec<_>>(),
    })
}

fn event_json(event: &FolderEvent) -> Value {
    let record = &event.record;
    let shape = shape(record);
    let intake = &event.intake;
    json!({
        "event": event.name,
        "utc": utc_json(event.utc_ns),
        "samples": record.samples.len(),
        "duration_s": record.duration_s(),
        "has_angle": record.has_angle(),
        "onset_s": shape.onset_s,
        "voltage_before_pu": number(shape.before_pu),
        "voltage_lowest_pu": number(shape.lowest_pu),
        "voltage_highest_pu": number(shape.highest_pu),
        "depth_pu": number(shape.before_pu - shape.lowest_pu),
        "frequency_range_hz": shape.frequency_range_hz.map(number),
        "active_before_pu": number(shape.active_before_pu),
        "usable_share": record.usable_share(),
        "quality": quality(record)
            .into_iter()
            .map(|(name, count)| (name.replace(' ', "_"), Value::from(count)))
            .collect::<serde_json::Map<_, _>>(),
        "intake": {
            "rows": intake.rows,
            "bad_rows": intake.bad_rows,
            "bad_cells": intake.bad_cells,
            "first_bad_line": intake.first_bad.map(|(line, _)| line),
            "first_bad_column": intake.first_bad.map(|(_, column)| column),
            "duplicates": intake.duplicates,
            "out_of_order": intake.out_of_order,
            "off_grid": intake.off_grid,
            "gaps": intake.gaps,
        },
    })
}
