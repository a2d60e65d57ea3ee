//! C37.118 frames in a file, as a capture or a configuration frame saved by itself: what the stream holds,
//! and a mapping for the configuration.

use std::fmt::Write as _;

use serde_json::{Value, json};

use crate::adapters::c37118::{
    Configuration, ConfigurationAssembler, Frame, FrameKind, LoadMapping, PhasorQuantity,
    PhasorSet, PmuConfiguration, PowerSource, StreamCounters, StreamDecoder, decode, propose,
};

/// What a file of frames holds.
pub(super) struct View {
    counters: StreamCounters,
    data: usize,
    configurations: Vec<Configuration>,
}

impl View {
    /// None when the bytes hold no frame at all.
    pub(super) fn new(bytes: &[u8]) -> Option<Self> {
        let mut decoder = StreamDecoder::new();
        decoder.push(bytes);
        let mut view = Self {
            counters: StreamCounters::default(),
            data: 0,
            configurations: Vec::new(),
        };
        let mut assembler = ConfigurationAssembler::new();
        while let Some(frame) = decoder.next_frame() {
            match decode(&frame) {
                Ok(Frame::Data(_)) => view.data += 1,
                Ok(Frame::Configuration(configuration)) => view.add(configuration),
                Ok(Frame::ConfigurationPart(part)) => {
                    if let Ok(Some(configuration)) = assembler.push(part) {
                        view.add(configuration);
                    }
                }
                Ok(Frame::Header(_) | Frame::Command(_)) | Err(_) => {}
            }
        }
        view.counters = decoder.counters();
        (view.counters.frames > 0).then_some(view)
    }

    fn add(&mut self, configuration: Configuration) {
        let mut known = self.configurations.iter();
        if !known.any(|known| known.says_the_same_as(&configuration)) {
            self.configurations.push(configuration);
        }
    }

    pub(super) fn text(&self) -> String {
        let (counters, mut out) = (&self.counters, String::new());
        // Writing into a String cannot fail.
        writeln!(
            out,
            "IEEE C37.118.2: {} frames, {} of data, {} bytes that are no frame",
            counters.frames, self.data, counters.skipped_bytes
        )
        .ok();
        for configuration in &self.configurations {
            let kind: FrameKind = configuration.kind.frame_kind();
            let (id_code, rate) = (configuration.prefix.id_code, configuration.rate);
            let rate = rate.frames_per_second().unwrap_or(f64::NAN);
            writeln!(out, "\n{kind} of stream {id_code}, {rate} frames/s").ok();
            for pmu in &configuration.pmus {
                describe(pmu, &mut out);
            }
        }
        if self.configurations.is_empty() {
            out.push_str("no configuration among them: the data cannot be read\n");
        }
        out
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
        json!({
            "v": 1,
            "format": "C37.118",
            "frames": self.counters.frames,
            "data_frames": self.data,
            "skipped_bytes": self.counters.skipped_bytes,
            "configurations": configurations.collect::<Vec<_>>(),
        })
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

const fn quantity(quantity: PhasorQuantity) -> &'static str {
    match quantity {
        PhasorQuantity::Voltage => "voltage",
        PhasorQuantity::Current => "current",
        PhasorQuantity::Reserved(_) => "reserved",
    }
}
