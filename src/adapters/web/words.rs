//! How pages say things.

use super::acting;
use crate::{
    adapters::{http::Ongoing, store::JobKind, wire::v1::rfc3339},
    disturbance::{Closing, Trigger},
    load_model::{effects, general_forms},
};

/// Parts of a model as a reader sees them: `ZIP + induction motor + second motor`.
pub(super) fn structure(parts: &[String]) -> String {
    parts
        .iter()
        .map(|part| effect(part))
        .collect::<Vec<_>>()
        .join(" + ")
}

/// A part of a model as words.
pub(super) fn effect(name: &str) -> String {
    if name == "zip" {
        "ZIP".to_owned()
    } else {
        name.replace('_', " ")
    }
}

/// A sentence of a diagnosis with its effects named as a reader sees them.
pub(super) fn readable(sentence: &str) -> String {
    let all = effects::catalogue().iter().chain(general_forms::all());
    let names = all.map(|e| e.declaration().name);
    names
        .filter(|name| name.contains('_'))
        .fold(sentence.to_owned(), |text, name| {
            text.replace(name, &effect(name))
        })
}

/// Who changed something.
pub(super) fn actor(actor: &str) -> &str {
    if actor == acting::ACTOR {
        "a reader of the page"
    } else {
        actor
    }
}

/// A parameter without what stands before it and behind it: its effect and its unit.
pub(super) fn parameter(name: &str, unit: &str) -> String {
    let name = name.rsplit('.').next().unwrap_or(name);
    let bare = name
        .strip_suffix(unit)
        .and_then(|name| name.strip_suffix('_'));
    bare.unwrap_or(name).replace('_', " ")
}

/// What a job is at, and for how long.
pub(super) fn ongoing(job: &Ongoing, now_ns: i64) -> String {
    let seconds = now_ns.saturating_sub(job.since_ns).max(0) / 1_000_000_000;
    let model = structure(&job.structure);
    let what = match job.kind {
        JobKind::IdentifySite => format!("Fitting {model} to the events of {}", job.site),
        JobKind::IdentifyEvent => format!("Fitting {model} to event {} alone", job.subject),
        JobKind::DiagnoseSite => format!("Diagnosing {model} at {}", job.site),
    };
    let stage = job.stage.as_ref().map_or_else(String::new, |stage| {
        let count = match stage.of {
            0 | 1 => String::new(),
            of => format!(" ({} of {of})", (stage.done + 1).min(of)),
        };
        format!("{}{count}, ", readable(&stage.what))
    });
    format!(
        "{what}: {stage}{} simulations, {seconds} s",
        job.simulations
    )
}

/// A UTC time to the millisecond, for reading.
pub(super) fn utc(ns: i64) -> String {
    let text = rfc3339(ns.saturating_add(500_000));
    let (date, time) = text.split_once('T').unwrap_or((&text, ""));
    let time = time.trim_end_matches('Z');
    let time = time.split_once('.').map_or_else(
        || format!("{time}.000"),
        |(whole, part)| format!("{whole}.{:0<3}", part.chars().take(3).collect::<String>()),
    );
    format!("{date} {time}")
}

/// What opened a window, in words.
pub(super) fn triggers(list: &[Trigger]) -> String {
    list.iter()
        .map(|trigger| match trigger.name() {
            "rate_of_change_of_frequency" => "ROCOF".to_owned(),
            name => name.replace('_', " "),
        })
        .collect::<Vec<_>>()
        .join(", ")
}

/// Why a window ended, in words.
pub(super) fn closing(closing: Closing) -> String {
    closing.name().replace('_', " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_three_decimals() {
        assert_eq!(utc(0), "1970-01-01 00:00:00.000");
        assert_eq!(utc(1_775_797_862_584_999_999), "2026-04-10 05:11:02.585");
    }

    #[test]
    fn a_structure_reads_as_words() {
        let parts = ["zip", "induction_motor"].map(str::to_owned);
        assert_eq!(structure(&parts), "ZIP + induction motor");
    }

    #[test]
    fn a_parameter_says_its_unit_once() {
        assert_eq!(parameter("tap.time_constant_s", "s"), "time constant");
        assert_eq!(parameter("tap.share", "1"), "share");
    }

    #[test]
    fn an_effect_in_a_sentence_reads_as_words() {
        let found = readable("The model lacks second_motor.");
        assert_eq!(found, "The model lacks second motor.");
    }
}
