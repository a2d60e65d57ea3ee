//! What a set shows on the events at hand, by the rule that validates a fit. What it showed on the
//! events of its own fit is another matter.

use super::{
    ErrorSummary, IdentificationError, IdentificationOptions, ParameterSet, Verdict, VerdictStatus,
    edge_timing::align,
    evaluate::{EventModel, StaticModel, errors},
    identify::{model_of, prepare_all, trend_of},
    intake::PreparedEvent,
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

/// Judges `set` on the events of `site` in `windows` by the rule of [`validate`]: fitted events are
/// those that it names as such, all others are held out. Where none of its fitted events is there,
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
    let (events, refused) = prepare_all(windows, &options.intake);
    if events.is_empty() {
        return Err(IdentificationError::NoUsableEvent { refused });
    }
    let events: Vec<PreparedEvent> = (events.iter())
        .map(|event| align(model, &trend.applied_to(event)))
        .collect();
    let warnings = warnings(set, site, &events);
    let (fitted, unseen): (Vec<_>, Vec<_>) =
        (events.into_iter()).partition(|event| set.fitted_events.contains(&event.id));
    let reference = StaticModel::fit(if fitted.is_empty() { &unseen } else { &fitted });
    let summary = |events: &[PreparedEvent]| summary(model, &reference, events);
    let (held_out, others): (Vec<_>, Vec<_>) =
        (unseen.iter().cloned()).partition(|event| set.held_out_events.contains(&event.id));
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
    let seen = set.site != site || knows_any(set, &unseen) || !fitted.is_empty();
    Ok(Judgement {
        site: site.to_owned(),
        held_out: summary(&held_out)?,
        others: summary(&others)?,
        fitted: fitted_errors,
        verdict: if seen { verdict } else { unproven(verdict) },
        warnings,
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

fn knows(set: &ParameterSet, event: &str) -> bool {
    let mut named = set.fitted_events.iter().chain(&set.held_out_events);
    named.any(|name| name == event)
}

fn knows_any(set: &ParameterSet, events: &[PreparedEvent]) -> bool {
    events.iter().any(|event| knows(set, &event.id))
}

fn warnings(set: &ParameterSet, site: &str, events: &[PreparedEvent]) -> Vec<String> {
    let mut warnings = Vec::new();
    if set.site != site {
        warnings.push(format!(
            "the set is one of site `{}`, the events are those of site `{site}`",
            set.site
        ));
    }
    if !knows_any(set, events) {
        let own = set.fitted_events.first();
        let own = own.map_or_else(String::new, |name| {
            format!(" (it names events as `{name}`)")
        });
        warnings.push(format!(
            "the set knows none of these events by name{own}: what it was fitted to is not here"
        ));
    }
    warnings
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
