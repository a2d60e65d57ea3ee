//! A COMTRADE recording as text and JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::{number, utc_json, utc_text};
use crate::{
    adapters::recordings::{
        comtrade::{AnalogChannel, Note, Recording, Scaling},
        grouping::{self, Proposal, Triple},
        mapping::{self, Quantity},
    },
    measurement::{Record, Site, phasor::Connection},
};

/// Frequency assumed where the file gives none, Hz.
const NOMINAL_HZ: f64 = 50.0;

/// A recording with what was found out about it.
pub(super) struct View<'a> {
    recording: &'a Recording,
    triples: Vec<Triple>,
    loads: Vec<(Proposal, Result<Preview, mapping::Error>)>,
}

/// What the phasors of a proposed load look like.
struct Preview {
    /// Line-to-line positive-sequence voltage at the beginning and at its lowest, kV.
    voltage_kv: f64,
    lowest_kv: f64,
    /// Power at the beginning, MW and Mvar, and the range of active power.
    active_mw: f64,
    reactive_mvar: f64,
    active_range_mw: [f64; 2],
    frequency_range_hz: [f64; 2],
    /// Largest negative-sequence ratio of the voltage.
    unbalance: f64,
    phasors: usize,
    pieces: usize,
}

impl<'a> View<'a> {
    pub(super) fn new(recording: &'a Recording) -> Self {
        let triples = grouping::group(recording);
        let loads = grouping::propose(recording, &triples)
            .into_iter()
            .map(|proposal| {
                let preview = preview(recording, &proposal);
                (proposal, preview)
            })
            .collect();
        Self {
            recording,
            triples,
            loads,
        }
    }

    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _written = self
            .write_header(&mut text)
            .and_then(|()| self.write_channels(&mut text))
            .and_then(|()| self.write_loads(&mut text));
        text
    }

    fn write_header(&self, text: &mut String) -> std::fmt::Result {
        let r = self.recording;
        let nominal = r
            .nominal_hz
            .map_or("unknown".to_owned(), |hz| format!("{hz} Hz"));
        writeln!(text, "COMTRADE {} {}", r.revision.year(), r.format.name())?;
        writeln!(text, "station    {}", r.station)?;
        writeln!(text, "recorder   {}", r.recorder)?;
        writeln!(text, "code page  {}", r.code_page)?;
        writeln!(text, "frequency  {nominal}")?;
        writeln!(text, "start      {}", utc_text(r.start_ns))?;
        writeln!(text, "trigger    {}", utc_text(r.trigger_ns))?;
        writeln!(text, "samples    {} in {:.3} s", r.len(), r.duration_s())?;
        for segment in &r.segments {
            let from_s = r.time_s[segment.first];
            let (len, rate_hz) = (segment.len, segment.rate_hz);
            writeln!(
                text,
                "  from {from_s:.6} s: {len} at {rate_hz:.3} per second"
            )?;
        }
        for note in &r.notes {
            writeln!(text, "note       {}", note_text(note))?;
        }
        Ok(())
    }

    fn write_channels(&self, text: &mut String) -> std::fmt::Result {
        let r = self.recording;
        writeln!(text, "\n{} analog channels", r.analog.len())?;
        for channel in &r.analog {
            let (low, high) = range(&channel.values);
            let phase = if channel.phase.is_empty() {
                "-"
            } else {
                &channel.phase
            };
            writeln!(
                text,
                "{:>5}  {}  phase {phase}  {low:.4} to {high:.4} {}  {}  missing {}",
                channel.number,
                channel.name,
                channel.unit,
                side_text(channel),
                channel.missing(),
            )?;
        }
        let changing: Vec<_> = r.digital.iter().filter(|d| !d.changes.is_empty()).collect();
        let (count, moving) = (r.digital.len(), changing.len());
        writeln!(text, "\n{count} digital channels, {moving} of them change")?;
        for channel in changing {
            let first_s = r.time_s[channel.changes[0]];
            let (number, name) = (channel.number, &channel.name);
            let changes = channel.changes.len();
            writeln!(
                text,
                "{number:>5}  {name}  {changes} changes, first at {first_s:.6} s"
            )?;
        }
        Ok(())
    }

    fn write_loads(&self, text: &mut String) -> std::fmt::Result {
        writeln!(text, "\n{} three-phase groups", self.triples.len())?;
        for triple in &self.triples {
            let names = triple
                .channels
                .map(|i| self.recording.analog[i].name.as_str());
            let (kind, evidence) = (kind(triple), triple.evidence.name());
            writeln!(
                text,
                "  {kind}  {}  = {}  (by {evidence})",
                triple.label,
                names.join(", ")
            )?;
        }
        writeln!(
            text,
            "\n{} proposed loads (voltage, current)",
            self.loads.len()
        )?;
        for (proposal, preview) in &self.loads {
            writeln!(text, "  {} with {}", proposal.label, proposal.voltage_label)?;
            match preview {
                Ok(p) => write_preview(text, p)?,
                Err(error) => writeln!(text, "    no phasors: {error}")?,
            }
            for line in toml(proposal, preview.as_ref().ok()).lines() {
                writeln!(text, "      {line}")?;
            }
        }
        Ok(())
    }

    pub(super) fn json(&self) -> Value {
        let r = self.recording;
        let segments = r.segments.iter().map(|s| {
            json!({"first": s.first, "samples": s.len, "rate_hz": s.rate_hz,
                "start_s": r.time_s[s.first]})
        });
        let digital = r.digital.iter().map(|d| {
            json!({"number": d.number, "name": d.name, "phase": d.phase, "circuit": d.circuit,
                "initial": d.initial, "changes": d.changes})
        });
        let groups = self.triples.iter().map(|t| {
            json!({"quantity": kind(t), "label": t.label, "evidence": t.evidence.name(),
                "channels": t.channels.map(|i| r.analog[i].name.clone()),
                "numbers": t.channels.map(|i| r.analog[i].number)})
        });
        json!({
            "kind": "comtrade",
            "revision": r.revision.year(),
            "format": r.format.name(),
            "station": r.station,
            "recorder": r.recorder,
            "code_page": r.code_page,
            "nominal_hz": r.nominal_hz,
            "start_utc": utc_json(r.start_ns),
            "trigger_utc": utc_json(r.trigger_ns),
            "samples": r.len(),
            "duration_s": r.duration_s(),
            "segments": segments.collect::<Vec<_>>(),
            "analog": r.analog.iter().map(channel_json).collect::<Vec<_>>(),
            "digital": digital.collect::<Vec<_>>(),
            "groups": groups.collect::<Vec<_>>(),
            "loads": self.loads.iter().map(load_json).collect::<Vec<_>>(),
            "notes": r.notes.iter().map(note_text).collect::<Vec<_>>(),
        })
    }
}

/// The table of the configuration file that says so. What gives power at the beginning is turned round.
fn toml(proposal: &Proposal, preview: Option<&Preview>) -> String {
    let mapping = &proposal.mapping;
    let between = match mapping.connection {
        Connection::LineToGround => "",
        Connection::LineToLine => "connection = \"line_to_line\"\n",
    };
    let sign = if preview.is_some_and(|p| p.active_mw < 0.0) {
        "current_sign = -1\n"
    } else {
        ""
    };
    format!(
        "[[site.recording]]\nvoltages = {}\ncurrents = {}\n{between}{sign}",
        json!(mapping.voltage.channels),
        json!(mapping.currents[0].channels)
    )
}

/// The proposed load's phasors on bases of 1 MVA and 1 kV.
fn preview(recording: &Recording, proposal: &Proposal) -> Result<Preview, mapping::Error> {
    let site = Site {
        name: "preview".to_owned(),
        s_base_mva: 1.0,
        v_base_kv: 1.0,
        nominal_hz: recording.nominal_hz.unwrap_or(NOMINAL_HZ),
    };
    let records = proposal.mapping.records(recording, &site)?;
    let samples = || records.iter().flat_map(|r: &Record| &r.samples);
    let usable = || samples().filter(|s| s.usable());
    let span = |value: fn(&crate::measurement::Sample) -> f64| {
        let fold = |range: [f64; 2], v: f64| [range[0].min(v), range[1].max(v)];
        usable().map(value).fold([f64::NAN, f64::NAN], fold)
    };
    let first = usable().next();
    let initial = |value: fn(&crate::measurement::Sample) -> f64| first.map_or(f64::NAN, value);
    Ok(Preview {
        voltage_kv: initial(|s| s.voltage_pu),
        lowest_kv: span(|s| s.voltage_pu)[0],
        active_mw: initial(|s| s.active_pu),
        reactive_mvar: initial(|s| s.reactive_pu),
        active_range_mw: span(|s| s.active_pu),
        frequency_range_hz: span(|s| s.frequency_hz),
        unbalance: span(|s| s.negative_sequence_ratio)[1],
        phasors: samples().count(),
        pieces: records.len(),
    })
}

fn write_preview(text: &mut String, p: &Preview) -> std::fmt::Result {
    if p.voltage_kv.is_nan() {
        return writeln!(
            text,
            "    no usable phasor: the voltage is dead or has missing samples"
        );
    }
    if p.active_mw < 0.0 {
        writeln!(
            text,
            "    power flows out at the beginning: a source, or currents that count the other way, as in the \
             table below; or the voltage is not that of these currents"
        )?;
    }
    let [low_mw, high_mw] = p.active_range_mw;
    let [low_hz, high_hz] = p.frequency_range_hz;
    writeln!(
        text,
        "    begins at {:.3} kV, {:.4} MW, {:.4} Mvar; lowest {:.3} kV; {low_mw:.4} to \
         {high_mw:.4} MW; {low_hz:.3} to {high_hz:.3} Hz; V2/V1 up to {:.3}; {} phasors in {} pieces",
        p.voltage_kv, p.active_mw, p.reactive_mvar, p.lowest_kv, p.unbalance, p.phasors, p.pieces
    )
}

fn load_json((proposal, preview): &(Proposal, Result<Preview, mapping::Error>)) -> Value {
    let table = toml(proposal, preview.as_ref().ok());
    let preview = match preview {
        Ok(p) => json!({
            "voltage_kv": number(p.voltage_kv),
            "lowest_voltage_kv": number(p.lowest_kv),
            "active_mw": number(p.active_mw),
            "reactive_mvar": number(p.reactive_mvar),
            "active_range_mw": p.active_range_mw.map(number),
            "frequency_range_hz": p.frequency_range_hz.map(number),
            "negative_sequence_ratio_max": number(p.unbalance),
            "phasors": p.phasors,
            "pieces": p.pieces,
        }),
        Err(error) => json!({"error": error.to_string()}),
    };
    let between = proposal.mapping.connection == Connection::LineToLine;
    json!({
        "label": proposal.label,
        "voltage_label": proposal.voltage_label,
        "voltage": proposal.mapping.voltage.channels,
        "voltage_between_phases": between,
        "current": proposal.mapping.currents[0].channels,
        "table": table,
        "preview": preview,
    })
}

fn channel_json(channel: &AnalogChannel) -> Value {
    let (low, high) = range(&channel.values);
    json!({
        "number": channel.number,
        "name": channel.name,
        "phase": channel.phase,
        "circuit": channel.circuit,
        "unit": channel.unit,
        "side": match channel.scaling {
            Scaling::Primary => Value::from("primary"),
            Scaling::Secondary => Value::from("secondary"),
            Scaling::Unstated => Value::Null,
        },
        "primary": channel.primary,
        "secondary": channel.secondary,
        "skew_us": channel.skew_us,
        "lowest": number(low),
        "highest": number(high),
        "missing": channel.missing(),
    })
}

fn kind(triple: &Triple) -> &'static str {
    match (triple.quantity, triple.connection) {
        (Quantity::Current, _) => "current",
        (Quantity::Voltage, Connection::LineToGround) => "voltage",
        (Quantity::Voltage, Connection::LineToLine) => "voltage between phases",
    }
}

fn side_text(channel: &AnalogChannel) -> String {
    match (channel.scaling, channel.primary, channel.secondary) {
        (Scaling::Primary, _, _) => "primary".to_owned(),
        (Scaling::Secondary, Some(p), Some(s)) => format!("secondary, {p}/{s}"),
        (Scaling::Secondary, _, _) => "secondary, ratio unknown".to_owned(),
        (Scaling::Unstated, _, _) => "side unknown".to_owned(),
    }
}

/// Lowest and highest finite value; NaN when there is none.
fn range(values: &[f64]) -> (f64, f64) {
    let fold = |(low, high): (f64, f64), v: &f64| (low.min(*v), high.max(*v));
    values.iter().fold((f64::NAN, f64::NAN), fold)
}

fn note_text(note: &Note) -> String {
    match note {
        Note::UnusualRevision { year, read_as } => {
            format!("revision {year} read as {}", read_as.year())
        }
        Note::ChannelTotal { total, sum } => {
            format!("total of {total} channels, but analog and digital make {sum}")
        }
        Note::ShortYear { line, year } => format!("line {line}: two-digit year read as {year}"),
        Note::DayAndMonthSwapped { line } => format!("line {line}: day and month swapped"),
        Note::TimeUnknown { line } => format!("line {line}: time unknown"),
        Note::SecondSixty { line } => format!("line {line}: second 60 read as the next minute"),
        Note::LinesAbsent { field } => format!("configuration ends before {field}"),
        Note::MoreDataThanDeclared { declared } => {
            format!("more samples than the {declared} declared; the rest was not read")
        }
        Note::Truncated { found, declared } => {
            format!("data end after {found} of {declared} samples")
        }
        Note::StampsDisagree { ratio } => {
            format!("time stamps not used: their intervals are {ratio:.3e} of the declared ones")
        }
        Note::Gap { sample, seconds } => {
            format!("gap of {seconds:.6} s before sample {}", sample + 1)
        }
        Note::BlankLines { count } => format!("{count} blank lines between samples skipped"),
        Note::DigitalValues { count } => {
            format!("{count} digital values other than 0 and 1 taken as no change")
        }
    }
}
