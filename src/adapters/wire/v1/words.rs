//! The words for the domain's closed lists.

use crate::{
    adapters::wire::DocumentError,
    disturbance::{Closing, Trigger},
    identification::{DirectionOutcome, VerdictStatus},
};

const TRIGGERS: [Trigger; 7] = [
    Trigger::VoltageDip,
    Trigger::VoltageSwell,
    Trigger::VoltageStep,
    Trigger::PhaseJump,
    Trigger::FrequencyExcursion,
    Trigger::RateOfChangeOfFrequency,
    Trigger::Recording,
];

const CLOSINGS: [Closing; 5] = [
    Closing::Recovered,
    Closing::LongestReached,
    Closing::StreamGap,
    Closing::StreamSilent,
    Closing::RecordingEnded,
];

const STATUSES: [VerdictStatus; 3] = [
    VerdictStatus::Pass,
    VerdictStatus::Fail,
    VerdictStatus::CannotJudge,
];

/// Channels a verdict may be about.
const VERDICT_CHANNELS: [&str; 2] = ["P", "Q"];

/// Segments of an event a verdict may be about.
const SEGMENTS: [&str; 3] = ["before", "during", "after"];

/// Word for a trigger.
#[must_use]
pub const fn trigger_name(trigger: Trigger) -> &'static str {
    match trigger {
        Trigger::VoltageDip => "voltage_dip",
        Trigger::VoltageSwell => "voltage_swell",
        Trigger::VoltageStep => "voltage_step",
        Trigger::PhaseJump => "phase_jump",
        Trigger::FrequencyExcursion => "frequency_excursion",
        Trigger::RateOfChangeOfFrequency => "rate_of_change_of_frequency",
        Trigger::Recording => "recording",
    }
}

/// Word for why a window ended.
#[must_use]
pub const fn closing_name(closing: Closing) -> &'static str {
    match closing {
        Closing::Recovered => "recovered",
        Closing::LongestReached => "longest_reached",
        Closing::StreamGap => "stream_gap",
        Closing::StreamSilent => "stream_silent",
        Closing::RecordingEnded => "recording_ended",
    }
}

/// Word for the status of a verdict (design, section 11).
#[must_use]
pub const fn verdict_status_name(status: VerdictStatus) -> &'static str {
    match status {
        VerdictStatus::Pass => "pass",
        VerdictStatus::Fail => "fail",
        VerdictStatus::CannotJudge => "cannot_judge",
    }
}

/// Word for the outcome of a search direction (design, section 11).
#[must_use]
pub const fn outcome_name(outcome: DirectionOutcome) -> &'static str {
    match outcome {
        DirectionOutcome::NewSolution(_) => "new_solution",
        DirectionOutcome::KnownSolution(_) => "known_solution",
        DirectionOutcome::NoExitPoint { .. } => "no_exit_point",
        DirectionOutcome::LocalSolverInfeasible => "local_solver_infeasible",
    }
}

/// The trigger of that word.
pub(in crate::adapters) fn trigger_named(word: &str) -> Result<Trigger, DocumentError> {
    named(word, &TRIGGERS, trigger_name, "window", "trigger")
}

/// The closing of that word.
pub(in crate::adapters) fn closing_named(word: &str) -> Result<Closing, DocumentError> {
    named(word, &CLOSINGS, closing_name, "window", "closing")
}

/// The status of that word.
pub(in crate::adapters) fn verdict_status_named(
    word: &str,
) -> Result<VerdictStatus, DocumentError> {
    named(word, &STATUSES, verdict_status_name, "verdict", "status")
}

/// The static spelling of a verdict's channel.
pub(super) fn verdict_channel_named(word: &str) -> Result<&'static str, DocumentError> {
    named(word, &VERDICT_CHANNELS, |word| word, "verdict", "channel")
}

/// The static spelling of a verdict's segment.
pub(super) fn segment_named(word: &str) -> Result<&'static str, DocumentError> {
    named(word, &SEGMENTS, |word| word, "verdict", "segment")
}

fn named<T: Copy>(
    word: &str,
    all: &[T],
    name: impl Fn(T) -> &'static str,
    document: &'static str,
    field: &'static str,
) -> Result<T, DocumentError> {
    all.iter()
        .copied()
        .find(|one| name(*one) == word)
        .ok_or_else(|| DocumentError::UnknownWord {
            document,
            field,
            found: word.to_owned(),
            known: all
                .iter()
                .map(|one| name(*one))
                .collect::<Vec<_>>()
                .join(", "),
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_leads_back_to_what_it_names() {
        for trigger in TRIGGERS {
            assert_eq!(trigger_named(trigger_name(trigger)).unwrap(), trigger);
        }
        for closing in CLOSINGS {
            assert_eq!(closing_named(closing_name(closing)).unwrap(), closing);
        }
        for status in STATUSES {
            assert_eq!(
                verdict_status_named(verdict_status_name(status)).unwrap(),
                status
            );
        }
    }

    #[test]
    fn an_unknown_word_is_refused_with_the_words_that_are_known() {
        let error = verdict_status_named("maybe").unwrap_err().to_string();
        assert_eq!(
            error,
            "the verdict has `maybe` as its status, which is not one of: pass, fail, cannot_judge"
        );
    }
}
