//! An effect's declaration as JSON: the same by `/api/v1/effects` and by `effects --json`.

use serde_json::{Value, json};

use crate::load_model::{
    effect::{Declaration, Kind, Parameter, Role, Scale},
    effects,
};

/// A declaration as a document.
#[must_use]
pub fn effect_document(d: &Declaration) -> Value {
    let states: Vec<Value> = d
        .states
        .iter()
        .map(|s| json!({"name": s.name, "unit": s.unit}))
        .collect();
    let excludes: Vec<Value> = d
        .excludes
        .iter()
        .map(|e| json!({"other": e.other, "reason": e.reason}))
        .collect();
    json!({
        "name": d.name,
        "title": d.title,
        "kind": effect_kind_name(d.kind),
        "version": d.version,
        "from_file": effects::is_registered(d.name),
        "parameters": d.parameters.iter().map(parameter).collect::<Vec<_>>(),
        "states": states,
        "excludes": excludes,
        "resembles": d.resembles,
        "needs": {
            "frequency": d.needs.frequency,
            "voltage_below": d.needs.voltage_below,
            "voltage_above": d.needs.voltage_above,
            "frequency_deviation": d.needs.frequency_deviation,
            "window_s": d.needs.window_s,
            "rate_fps": d.needs.rate_fps,
            "separating_event": d.needs.separating_event,
        },
        "source": d.source,
    })
}

fn parameter(p: &Parameter) -> Value {
    let (role, meaningful) = match p.role {
        Role::OneSidedAmplitude { meaningful } => ("one_sided", Some(meaningful)),
        Role::TwoSidedAmplitude { meaningful } => ("two_sided", Some(meaningful)),
        Role::Shape => ("shape", None),
        Role::Count => ("count", None),
        Role::Shared => ("shared", None),
        Role::Base => ("base", None),
    };
    // JSON has no infinity: a prior that says nothing is null.
    let prior = p.prior.deviation.is_finite().then(|| {
        let scale = match p.prior.scale {
            Scale::Linear => "linear",
            Scale::Logarithmic => "logarithmic",
        };
        json!({"centre": p.prior.centre, "deviation": p.prior.deviation, "scale": scale})
    });
    json!({
        "name": p.name,
        "symbol": p.symbol,
        "unit": p.unit,
        "role": role,
        "meaningful": meaningful,
        "lower": p.lower,
        "upper": p.upper,
        "neutral": p.neutral,
        "typical": p.typical,
        "prior": prior,
    })
}

/// Word for a kind of effect.
#[must_use]
pub const fn effect_kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::Physics => "physics",
        Kind::Instrument => "instrument",
    }
}
