//! What a C37.118 frame says, as JSON: for `inspect --frames`.

use serde_json::{Value, json};

use super::{number, utc_json};
use crate::adapters::c37118::{
    AnalogScaling, Command, CommandFrame, Configuration, DataFrame, DataMessage, HeaderFrame,
    PhasorScaling, PmuConfiguration, PmuData, Prefix,
};

/// A data frame, read by its configuration: volts, amperes, radians, hertz.
pub(super) fn data(frame: &DataFrame, configuration: &Configuration) -> Value {
    let pmus = frame.pmus.iter().zip(&configuration.pmus);
    let pmus: Vec<Value> = pmus.map(|(data, pmu)| pmu_data(data, pmu)).collect();
    let time_ns = frame.prefix.time.utc_ns(configuration.time_base);
    let own = json!({"time_utc": utc_json(time_ns), "pmus": pmus});
    with_prefix("data", frame.prefix, own)
}

/// A data frame of which no configuration is known.
pub(super) fn unread(message: &DataMessage) -> Value {
    with_prefix("data", message.prefix, json!({"pmus": null}))
}

pub(super) fn configuration(configuration: &Configuration) -> Value {
    let pmus = configuration.pmus.iter().map(pmu_configuration);
    let own = json!({
        "time_base": configuration.time_base,
        "rate_fps": configuration.rate.frames_per_second(),
        "pmus": pmus.collect::<Vec<_>>(),
    });
    let kind = configuration.kind.frame_kind().to_string();
    with_prefix(&kind, configuration.prefix, own)
}

/// A part of a CFG-3 that is not the last.
pub(super) fn part(prefix: Prefix, index: u16) -> Value {
    with_prefix("CFG-3", prefix, json!({"part": index}))
}

pub(super) fn header(header: &HeaderFrame) -> Value {
    with_prefix("header", header.prefix, json!({"text": header.text}))
}

pub(super) fn command(frame: &CommandFrame) -> Value {
    let extension = match &frame.command {
        Command::Extended(bytes) => json!(bytes),
        _ => Value::Null,
    };
    let own = json!({"command": frame.command.code(), "extension": extension});
    with_prefix("command", frame.prefix, own)
}

/// What every frame says, and what only this one does.
fn with_prefix(kind: &str, prefix: Prefix, own: Value) -> Value {
    let time = prefix.time;
    let mut all = json!({
        "kind": kind,
        "id_code": prefix.id_code,
        "soc": time.seconds,
        "fraction": time.fraction,
        "time_quality": time.quality.0,
    });
    if let (Value::Object(all), Value::Object(own)) = (&mut all, own) {
        all.extend(own);
    }
    all
}

fn pmu_data(data: &PmuData, pmu: &PmuConfiguration) -> Value {
    let phasors = data.phasors.iter().zip(&pmu.phasors).map(|(phasor, channel)| {
        let value = channel.value(*phasor);
        let (magnitude, angle_rad) = (value.re.hypot(value.im), value.im.atan2(value.re));
        json!({"name": channel.name, "magnitude": number(magnitude), "angle_rad": number(angle_rad)})
    });
    let analogs = data.analogs.iter().zip(&pmu.analogs);
    let analogs = analogs.map(
        |(value, channel)| json!({"name": channel.name, "value": number(channel.value(*value))}),
    );
    json!({
        "id_code": pmu.id_code,
        "stat": data.status.0,
        "frequency_hz": number(data.frequency_hz(pmu.nominal.hz())),
        "rocof_hz_per_s": number(data.rocof_hz_per_s()),
        "phasors": phasors.collect::<Vec<_>>(),
        "analogs": analogs.collect::<Vec<_>>(),
        "digitals": data.digitals,
    })
}

fn pmu_configuration(pmu: &PmuConfiguration) -> Value {
    let phasors = pmu.phasors.iter().map(|channel| {
        let scaling = match channel.scaling {
            PhasorScaling::PerBit(units) => json!({"per_bit": units}),
            PhasorScaling::Affine {
                factor, angle_rad, ..
            } => json!({"factor": factor, "angle_rad": angle_rad}),
        };
        let quantity = super::frames::quantity(channel.quantity);
        json!({"name": channel.name, "quantity": quantity, "scaling": scaling})
    });
    let analogs = pmu.analogs.iter().map(|channel| {
        let scaling = match channel.scaling {
            AnalogScaling::User { factor, .. } => json!({"user": factor}),
            AnalogScaling::Affine { factor, offset } => json!({"factor": factor, "offset": offset}),
        };
        json!({"name": channel.name, "scaling": scaling})
    });
    let digitals = pmu.digitals.iter();
    let digitals = digitals
        .map(|word| json!({"names": word.names, "normal": word.normal, "valid": word.valid}));
    json!({
        "station": pmu.station,
        "id_code": pmu.id_code,
        "format": pmu.format.0,
        "nominal_hz": pmu.nominal.hz(),
        "changes": pmu.changes,
        "phasors": phasors.collect::<Vec<_>>(),
        "analogs": analogs.collect::<Vec<_>>(),
        "digitals": digitals.collect::<Vec<_>>(),
    })
}
