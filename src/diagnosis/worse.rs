//! Whether a step of an improvement is taken: what it does to the error on events that were not fitted.

use super::outcome::StructureErrors;
use crate::identification::ErrorSummary;

/// A step may raise the error on events not fitted by this share: the spread of composition alone
/// moves it as much, ...
const WORSE_MAX: f64 = 0.02;
/// ... or by this one, where that on all judged events does not rise: the held-out ones are few.
const WORSE_MAX_OF_FEW: f64 = 0.25;
/// A step is not taken either where the error on untouched events rises by more than this share.
const WORSE_MAX_UNTOUCHED: f64 = 0.1;

/// The errors by which a step is taken: never those of the untouched events, which are quoted and must not have
/// been chosen by. They can only speak against it.
pub(super) fn deciding(errors: &StructureErrors) -> &ErrorSummary {
    errors.gate.as_ref().unwrap_or(&errors.fit)
}

/// Whether a step that leads from errors to others is not taken.
pub(super) fn is_worse(before: &StructureErrors, after: &StructureErrors) -> bool {
    let falls = after.judged_error_to_noise() <= before.judged_error_to_noise();
    let most = if falls { WORSE_MAX_OF_FEW } else { WORSE_MAX };
    deciding(after).error_to_noise > (1.0 + most) * deciding(before).error_to_noise
        || rise_on_untouched(before, after).is_some()
}

/// The error on untouched events where it rises so far that nobody would want the step.
pub(super) fn rise_on_untouched(before: &StructureErrors, after: &StructureErrors) -> Option<f64> {
    let [before, after] = [before, after].map(|e| e.untouched.as_ref());
    let (before, after) = (before?.error_to_noise, after?.error_to_noise);
    (after > (1.0 + WORSE_MAX_UNTOUCHED) * before).then_some(after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::EventErrors;

    /// Error over noise on the fitted events and on the gating ones, and how many there are of each.
    fn errors(of: [f64; 2], counts: [usize; 2]) -> StructureErrors {
        let [fit, gate] = [0, 1].map(|set| ErrorSummary {
            error_to_noise: of[set],
            events: vec![EventErrors::default(); counts[set]],
            ..ErrorSummary::default()
        });
        StructureErrors {
            fit,
            gate: Some(gate),
            untouched: None,
        }
    }

    #[test]
    fn few_gating_events_may_rise_where_all_together_fall() {
        let before = errors([2.6, 1.9], [6, 2]);
        let worse = |of: [f64; 2]| is_worse(&before, &errors(of, [6, 2]));
        assert!(!worse([2.6, 1.9]) && !worse([1.6, 1.5]));
        assert!(!worse([1.6, 2.2]));
        assert!(worse([1.6, 2.5]));
        assert!(worse([2.6, 2.0]));
        assert!(worse([1.6, f64::INFINITY]) && worse([f64::INFINITY, 2.0]));
    }

    #[test]
    fn untouched_events_speak_against_what_raises_their_error() {
        let quoted = |error: f64| StructureErrors {
            untouched: Some(ErrorSummary {
                error_to_noise: error,
                ..ErrorSummary::default()
            }),
            ..errors([2.0, 2.0], [6, 2])
        };
        let worse = |after: f64| is_worse(&quoted(1.8), &quoted(after));
        assert!(!worse(1.0) && !worse(1.9) && worse(2.1) && worse(f64::INFINITY));
        // From nothing that can be simulated every number is a fall.
        assert!(!is_worse(&quoted(f64::INFINITY), &quoted(70.0)));
    }
}
