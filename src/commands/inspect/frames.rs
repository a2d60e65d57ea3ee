//! C37.118 frames in a file, as a capture or a configuration frame saved by itself: what the stream holds,
//! what of it cannot be read and why, and a mapping for the configuration.

use std::{collections::BTreeMap, fmt::Write as _};

use serde_json::{Value, json};

use super::frame_contents;
use crate::adapters::c37118::{
    Configuration, ConfigurationAssembler, ConfigurationKind, Frame, FrameKind, LoadMapping,
    PhasorQuantity, PhasorSet, PmuConfiguration, PowerSource, StreamCounters, StreamDecoder,
    decode, propose,
};

/// Faults that are told in words; the others are counted.
const FAULTS_TOLD_MAX: usize = 10;

/// What a file of frames holds.
pub(super) struct View {
    counters: StreamCounters,
    /// Bytes at the end that no frame was made of.
    held_bytes: usize,
    data: usize,
    configurations: Vec<Configuration>,
    /// The ones by which data are read, by stream.
    in_force: BTreeMap<u16, Configuration>,
    /// Data frames of streams without a configuration.
    not_configured: u64,
    /// Frames with a right check word that cannot be read.
    faulty: u64,
    /// The first of these, with their number in the file.
    faults: Vec<(u64, String)>,
    /// Every frame, where they are wanted.
    contents: Option<Vec<Value>>,
}

impl View {
    /// The frames of these bytes, each with its contents where they are wanted.
    ///
    /// # Errors
    /// The bytes hold no frame that can be read: what is wrong with the first one.
    pub(super) fn new(bytes: &[u8], contents: bool) -> Result<Self, String> {
        let mut decoder = StreamDecoder::new();
        decoder.push(bytes);
        let mut view = Self {
            counters: StreamCounters::default(),
            held_bytes: 0,
            data: 0,
            configurations: Vec::new(),
            in_force: BTreeMap::new(),
            not_configured: 0,
            faulty: 0,
            faults: Vec::new(),
            contents: contents.then(Vec::new),
        };
        let mut assembler = ConfigurationAssembler::new();
        while let Some(frame) = decoder.next_frame() {
            let number = decoder.counters().frames;
            if let Err(fault) = view.take(&frame, &mut assembler) {
                view.faulty += 1;
                if view.faults.len() < FAULTS_TOLD_MAX {
                    view.faults.push((number, fault.clone()));
                }
                view.note(|| json!({"fault": fault}));
            }
        }
        view.counters = decoder.counters();
        view.held_bytes = decoder.held_bytes();
        if view.counters.frames == 0 {
            decode(bytes).map_err(|error| error.to_string())?;
        }
        if let (true, Some((_, fault))) = (view.faulty == view.counters.frames, view.faults.first())
        {
            return Err(fault.clone());
        }
        Ok(view)
    }

    fn take(&mut self, bytes: &[u8], assembler: &mut ConfigurationAssembler) -> Result<(), String> {
        let frame = decode(bytes).map_err(|error| error.to_string())?;
        match frame {
            Frame::Data(message) => {
                self.data += 1;
                if let Some(configuration) = self.in_force.get(&message.prefix.id_code) {
                    let data = message.decode(configuration).map_err(|e| e.to_string())?;
                    if let Some(contents) = &mut self.contents {
                        contents.push(frame_contents::data(&data, configuration));
                    }
                } else {
                    self.not_configured += 1;
                    self.note(|| frame_contents::unread(&message));
                }
            }
            Frame::Configuration(configuration) => self.add(configuration),
            Frame::ConfigurationPart(part) => {
                let (prefix, index) = (part.prefix, part.index);
                let whole = assembler.push(part).map_err(|error| error.to_string())?;
                match whole {
                    Some(configuration) => self.add(configuration),
                    None => self.note(|| frame_contents::part(prefix, index)),
                }
            }
            Frame::Header(header) => self.note(|| frame_contents::header(&header)),
            Frame::Command(command) => self.note(|| frame_contents::command(&command)),
        }
        Ok(())
    }

    fn add(&mut self, configuration: Configuration) {
        self.note(|| frame_contents::configuration(&configuration));
        let mut known = self.configurations.iter();
        if !known.any(|known| known.says_the_same_as(&configuration)) {
            self.configurations.push(configuration.clone());
        }
        // What a source could send (CFG-1) says nothing of what it sends.
        if configuration.kind != ConfigurationKind::Configuration1 {
            let stream = configuration.prefix.id_code;
            self.in_force.insert(stream, configuration);
        }
    }

    fn note(&mut self, content: impl FnOnce() -> Value) {
        if let Some(contents) = &mut self.contents {
            contents.push(content());
        }
    }

    pub(super) fn text(&self) -> String {
        let (counters, mut out) = (&self.counters, String::new());
        // Writing into a String cannot fail.
        writeln!(
            out,
            "IEEE C37.118.2: {} frames, {} of data, {} bytes that are no frame",
            counters.frames,
            self.data,
            counters.skipped_bytes + self.held_bytes as u64
        )
        .ok();
        self.write_faults(&mut out);
        for configuration in &self.configurations {
            let kind: FrameKind = configuration.kind.frame_kind();
            let (id_code, rate) = (configuration.prefix.id_code, configuration.rate);
            let rate = rate.frames_per_second();
            let rate = rate.map_or("no rate".to_owned(), |rate| format!("{rate} frames/s"));
            writeln!(out, "\n{kind} of stream {id_code}, {rate}").ok();
            for pmu in &configuration.pmus {
                describe(pmu, &mut out);
            }
        }
        if self.configurations.is_empty() {
            out.push_str("no configuration among them: the data cannot be read\n");
        }
        for content in self.contents.iter().flatten() {
            writeln!(out, "{content}").ok();
        }
        out
    }

    fn write_faults(&self, out: &mut String) {
        let bad = self.counters.bad_checksums;
        if bad > 0 {
            writeln!(out, "  {bad} with a wrong check word").ok();
        }
        if self.held_bytes > 0 {
            let held = self.held_bytes;
            writeln!(
                out,
                "  the last {held} bytes begin a frame and do not end it"
            )
            .ok();
        }
        if self.not_configured > 0 {
            let count = self.not_configured;
            writeln!(
                out,
                "  {count} of data before a configuration of their stream"
            )
            .ok();
        }
        for (number, fault) in &self.faults {
            writeln!(out, "  frame {number} cannot be read: {fault}").ok();
        }
        let further = self.faulty - self.faults.len() as u64;
        if further > 0 {
            writeln!(out, "  nor can {further} others").ok();
        }
    }

    pub(super) fn json(&self) -> Value {
        let configurations = self.configurations.iter().map(|configuration| {
            let pmus: Vec<Value> = configuration.pmus.iter().map(pmu_json).collect();
            json!({
                "kind": configuration.kind.frame_kind().to_string(),
                "id_code": configuration.prefix.id_code,
                "rate_fps": configuration.rate.frames_per_second(),
                "pmus": pmus,
            })
        });
        let faults = self.faults.iter();
        let faults = faults.map(|(number, fault)| json!({"frame": number, "fault": fault}));
        let mut view = json!({
            "v": 1,
            "format": "C37.118",
            "frames": self.counters.frames,
            "data_frames": self.data,
            "skipped_bytes": self.counters.skipped_bytes,
            "bad_checksums": self.counters.bad_checksums,
            "incomplete_bytes": self.held_bytes,
            "data_frames_not_configured": self.not_configured,
            "faulty_frames": self.faulty,
            "faults": faults.collect::<Vec<_>>(),
            "configurations": configurations.collect::<Vec<_>>(),
        });
        if let Some(contents) = &self.contents {
            view["contents"] = Value::Array(contents.clone());
        }
        view
    }
}

fn describe(pmu: &PmuConfiguration, out: &mut String) {
    let (station, id_code) = (&pmu.station, pmu.id_code);
    writeln!(out, "  PMU {id_code} `{station}`, {} Hz", pmu.nominal.hz()).ok();
    for (number, phasor) in (1..).zip(&pmu.phasors) {
        let quantity = quantity(phasor.quantity);
        writeln!(out, "    #{number} {quantity} `{}`", phasor.name).ok();
    }
    for (number, analog) in (1..).zip(&pmu.analogs) {
        writeln!(out, "    #{number} analog `{}`", analog.name).ok();
    }
    match propose(pmu) {
        Some(mapping) => {
            out.push_str(
                "  proposed, to be checked for polarity and for whose the currents are:\n",
            );
            for line in toml(&mapping, id_code).lines() {
                writeln!(out, "    {line}").ok();
            }
        }
        None => out.push_str("  no voltage and current of a load can be told from the names\n"),
    }
}

fn pmu_json(pmu: &PmuConfiguration) -> Value {
    let phasors = pmu
        .phasors
        .iter()
        .map(|phasor| json!({"name": phasor.name, "quantity": quantity(phasor.quantity)}));
    let analogs = pmu.analogs.iter().map(|analog| analog.name.clone());
    json!({
        "id_code": pmu.id_code,
        "station": pmu.station,
        "nominal_hz": pmu.nominal.hz(),
        "phasors": phasors.collect::<Vec<_>>(),
        "analogs": analogs.collect::<Vec<_>>(),
        "proposal": propose(pmu).map(|mapping| toml(&mapping, pmu.id_code)),
    })
}

/// The table of the configuration file that says so.
fn toml(mapping: &LoadMapping, id_code: u16) -> String {
    let set = |set: &PhasorSet| match set {
        PhasorSet::PositiveSequence(name) => json!([name]).to_string(),
        PhasorSet::Phases(names) => json!(names).to_string(),
    };
    let sets = match &mapping.power {
        PowerSource::Currents(sets) => sets.iter().map(|s| set(&s.phasors)).collect(),
        PowerSource::Analogs { .. } => Vec::new(),
    };
    let currents = match sets.as_slice() {
        [one] => one.clone(),
        several => format!("[{}]", several.join(", ")),
    };
    format!(
        "[[site.c37118]]\npmu = {id_code}\nvoltage = {}\ncurrents = {currents}\n",
        set(&mapping.voltage)
    )
}

/// Word for what a phasor is a phasor of.
pub(super) const fn quantity(quantity: PhasorQuantity) -> &'static str {
    match quantity {
        PhasorQuantity::Voltage => "voltage",
        PhasorQuantity::Current => "current",
        PhasorQuantity::Reserved(_) => "reserved",
    }
}
