//! What a set shows on the events at hand, by the rule that validates a fit. What it showed on the
//! events of its own fit is another matter.

use super::{
    ErrorSummary, IdentificationError, IdentificationOptions, ParameterSet, Verdict, VerdictStatus,
    edge_timing::align,
    evaluate::{EventModel, StaticModel, errors},
    identify::prepare_all,
    intake::PreparedEvent,
    on_windows::{model_of, trend_of},
    validate::{Evidence, largest_voltage_change, validate},
};
use crate::disturbance::Window;

/// What a set shows on some events. A summary is none where there is no such event.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// Site of the events.
    pub site: String,
    /// Errors on those events that the set was fitted to.
    pub fitted: Option<ErrorSummary>,
    /// Errors on those that were held out when it was fitted.
    pub held_out: Option<ErrorSummary>,
    /// Errors on those that the set does not know.
    pub others: Option<ErrorSummary>,
    /// The verdict on all events that the set was not fitted to.
    pub verdict: Verdict,
    /// Why the set may not belong to these events, sentences without a full stop.
    pub warnings: Vec<String>,
}

impl Judgement {
    /// What part an event played for the set: `"fitted"`, `"held out"` or `"neither"`.
    #[must_use]
    pub fn role(&self, event: &str) -> &'static str {
        let holds = |summary: &Option<ErrorSummary>| {
            let mut events = summary.iter().flat_map(|summary| &summary.events);
            events.any(|of| of.event == event)
        };
        if holds(&self.fitted) {
            "fitted"
        } else if holds(&self.held_out) {
            "held out"
        } else {
            "neither"
        }
    }
}

/// Judges `set` on the events of `site` in `windows` by the rule of [`validate`]: fitted events are
/// those of its own site that it names as such, all others are held out. Where none of its fitted events is there,
/// their errors are those that the set brings along.
///
/// # Errors
///
/// As [`super::compare`].
pub fn judge(
    set: &ParameterSet,
    site: &str,
    windows: &[Window],
    options: &IdentificationOptions,
) -> Result<Judgement, IdentificationError> {
    let (model, trend) = (model_of(set)?, trend_of(set));
    let model = model.as_ref();
    let (events, refused) = prepare_all(windows, &options.intake.for_parts(&set.structure));
    if events.is_empty() {
        return Err(IdentificationError::NoUsableEvent { refused });
    }
    let events: Vec<PreparedEvent> = (events.iter())
        .map(|event| align(model, &trend.applied_to(event)))
        .collect();
    // Events of different sites may bear the same names.
    let own_site = set.site == site;
    let is_among = |names: &[String], event: &PreparedEvent| own_site && names.contains(&event.id);
    let (fitted, unseen): (Vec<_>, Vec<_>) =
        (events.into_iter()).partition(|event| is_among(&set.fitted_events, event));
    let reference = StaticModel::fit(if fitted.is_empty() { &unseen } else { &fitted });
    let summary = |events: &[PreparedEvent]| summary(model, &reference, events);
    let (held_out, others): (Vec<_>, Vec<_>) =
        (unseen.iter().cloned()).partition(|event| is_among(&set.held_out_events, event));
    let (fitted_errors, unseen_errors) = (summary(&fitted)?, summary(&unseen)?);
    let evidence = Evidence {
        model,
        largest_change_fitted: largest_change_fitted(set, &fitted),
        held_out: &unseen,
        fit_errors: fitted_errors.as_ref().unwrap_or(&set.fit),
        held_out_errors: unseen_errors.as_ref(),
        motor_share_determined: (set.parameters.iter()).any(|p| p.name == "Kpm" && p.identifiable),
        slip: (set.derived.iter().find(|d| d.name == "slip")).map_or(f64::NAN, |d| d.value),
    };
    let verdict =
        validate(&evidence, &options.validation).map_err(|_| IdentificationError::NoSolution)?;
    let knows_none = fitted.is_empty() && held_out.is_empty();
    Ok(Judgement {
        site: site.to_owned(),
        held_out: summary(&held_out)?,
        others: summary(&others)?,
        fitted: fitted_errors,
        verdict: if own_site && knows_none {
            unproven(verdict)
        } else {
            verdict
        },
        warnings: warning(set, site, knows_none).into_iter().collect(),
    })
}

fn summary(
    model: &dyn EventModel,
    reference: &StaticModel,
    events: &[PreparedEvent],
) -> Result<Option<ErrorSummary>, IdentificationError> {
    if events.is_empty() {
        return Ok(None);
    }
    let summary = errors(model, reference, events).map_err(|_| IdentificationError::NoSolution)?;
    Ok(Some(summary))
}

/// Of the events at hand where there are some, otherwise as the set tells. Infinite, which is no ground
/// for an objection, where nothing is told or the set's own validation had none.
fn largest_change_fitted(set: &ParameterSet, fitted: &[PreparedEvent]) -> f64 {
    if !fitted.is_empty() {
        return largest_voltage_change(fitted);
    }
    let told = set.fit.events.iter().map(|e| 1.0 - e.lowest_voltage);
    told.reduce(f64::max)
        .filter(|_| set.verdict.status == VerdictStatus::CannotJudge)
        .unwrap_or(f64::INFINITY)
}

fn warning(set: &ParameterSet, site: &str, knows_none: bool) -> Option<String> {
    if set.site != site {
        return Some(format!(
            "the set is one of site `{}`, the events are those of site `{site}`",
            set.site
        ));
    }
    let own = set.fitted_events.first();
    let own = own.map_or_else(String::new, |name| {
        format!(" (it names events as `{name}`)")
    });
    knows_none.then(|| {
        format!(
            "the set knows none of these events by name{own}: what it was fitted to is not here"
        )
    })
}

/// Of the same site and without a known name, the events may be those of the fit itself.
fn unproven(verdict: Verdict) -> Verdict {
    if verdict.status != VerdictStatus::Pass {
        return verdict;
    }
    let doubt = "the set knows none of these events by name: it may have been fitted to them";
    Verdict {
        status: VerdictStatus::CannotJudge,
        reasons: std::iter::once(doubt.to_owned())
            .chain(verdict.reasons)
            .collect(),
        channels: verdict.channels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::EventErrors;

    #[test]
    fn what_an_event_was_for_the_set_is_told_by_the_summaries() {
        let of = |event: &str| {
            Some(ErrorSummary {
                events: vec![EventErrors {
                    event: event.to_owned(),
                    ..EventErrors::default()
                }],
                ..ErrorSummary::default()
            })
        };
        let judgement = Judgement {
            site: "a".to_owned(),
            fitted: of("one"),
            held_out: of("two"),
            others: of("three"),
            verdict: verdict(VerdictStatus::Pass),
            warnings: Vec::new(),
        };
        let roles = ["one", "two", "three"].map(|event| judgement.role(event));
        assert_eq!(roles, ["fitted", "held out", "neither"]);
    }

    fn verdict(status: VerdictStatus) -> Verdict {
        Verdict {
            status,
            reasons: vec!["figures".to_owned()],
            channels: Vec::new(),
        }
    }

    #[test]
    fn events_that_may_have_been_fitted_prove_nothing() {
        let doubted = unproven(verdict(VerdictStatus::Pass));
        assert_eq!(doubted.status, VerdictStatus::CannotJudge);
        assert!(doubted.reasons[0].contains("by name") && doubted.reasons[1] == "figures");
        let failed = unproven(verdict(VerdictStatus::Fail));
        assert_eq!(failed, verdict(VerdictStatus::Fail));
    }
}
