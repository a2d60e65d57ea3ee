//! What a candidate, or a general form, would do to the model, drawn before it is added: its refit of the diagnosis on one
//! event, beside the structure judged.

use maud::{Markup, html};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{
    super::{
        desk::{Desk, Judged},
        layout::segment,
        plot::{self, Chart},
        problem::Problem,
        words,
    },
    diagnosis::DiagnosisPage,
    overlay::{self, Captions, Overlay},
};
use crate::{
    adapters::{
        report::number,
        wire::v1::{DiagnosisV1, FittedStructureV1},
    },
    identification::FittedStructure,
};

/// What is asked to be drawn.
#[derive(Clone, Debug, Default, Deserialize)]
pub(in super::super) struct Asked {
    /// The effect; empty for the first one that the diagnosis names.
    #[serde(default)]
    with: String,
    /// The event; empty for the one that shows most.
    #[serde(default)]
    event: String,
}

/// A candidate on an event.
pub(super) struct Trial {
    pub(super) effect: String,
    overlay: Overlay,
}

/// The trial that is asked for; none where the diagnosis keeps no refits or the event no waveforms.
///
/// # Errors
///
/// The refusal of an effect or event that is not there.
pub(super) fn load(
    desk: &Desk,
    diagnosis: &DiagnosisV1,
    asked: &Asked,
) -> Result<Option<Trial>, Problem> {
    let (effect, event) = (effect(diagnosis, asked)?, event(diagnosis, asked)?);
    let (Some((effect, refit)), Some(base), Some(event)) = (effect, &diagnosis.model, event) else {
        return Ok(None);
    };
    let Some(window) = desk.store().window(event)? else {
        return Ok(None);
    };
    let judged = |fitted: &FittedStructureV1, what: &str| {
        let name = format!("{} diagnosis {} {what}", diagnosis.site, diagnosis.version);
        let fitted = FittedStructure::from(fitted);
        desk.comparison_of_fitted(&fitted, &name, &window)
    };
    // A model that has no response in this event is no failure of the page.
    let (Ok(before), Ok(after)) = (judged(base, ""), judged(refit, effect)) else {
        return Ok(None);
    };
    Ok(Some(Trial {
        effect: effect.to_owned(),
        overlay: Overlay { before, after },
    }))
}

/// An effect by its name, with its refit.
type Refit<'a> = (&'a str, &'a FittedStructureV1);

fn form(diagnosis: &DiagnosisV1) -> Option<Refit<'_>> {
    let form = diagnosis.unexplained.as_ref()?.general_form.as_ref()?;
    Some((&form.name, &form.model))
}

fn drawable(diagnosis: &DiagnosisV1) -> impl Iterator<Item = Refit<'_>> {
    let list = diagnosis.candidates.iter();
    let candidates = list.filter_map(|c| Some((c.effect.as_str(), c.model.as_ref()?)));
    candidates.chain(form(diagnosis))
}

/// The one asked for, else the best of the answer (candidates come best first), or the general form where nothing is named.
fn effect<'a>(diagnosis: &'a DiagnosisV1, asked: &Asked) -> Result<Option<Refit<'a>>, Problem> {
    let mut list = drawable(diagnosis);
    if asked.with.is_empty() {
        let answered = list.find(|(name, _)| diagnosis.answer_set.iter().any(|a| a == name));
        return Ok(answered.or_else(|| form(diagnosis)));
    }
    let unknown = || {
        let detail = format!("this diagnosis keeps no refit with `{}`", asked.with);
        Problem::not_found(detail)
    };
    let found = list.find(|(name, _)| *name == asked.with);
    found.map(Some).ok_or_else(unknown)
}

/// The one asked for, else where the model fails most among the events that no fit has seen.
fn event<'a>(diagnosis: &'a DiagnosisV1, asked: &Asked) -> Result<Option<&'a str>, Problem> {
    let mut failures = diagnosis.failures.iter();
    if asked.event.is_empty() {
        let unseen = |event: &String| diagnosis.events.untouched.contains(event);
        let worst = failures.max_by(|a, b| {
            let seen = unseen(&a.event).cmp(&unseen(&b.event));
            seen.then(a.error_to_noise.total_cmp(&b.error_to_noise))
        });
        return Ok(worst.map(|failure| failure.event.as_str()));
    }
    let found = failures.find(|failure| failure.event == asked.event);
    let unknown = || {
        let detail = format!("this diagnosis has not used the event `{}`", asked.event);
        Problem::not_found(detail)
    };
    found
        .map(|failure| Some(failure.event.as_str()))
        .ok_or_else(unknown)
}

impl Trial {
    fn event(&self) -> &str {
        &self.overlay.after.comparison.event
    }

    pub(super) fn chart(&self) -> Chart {
        let effect = words::effect(&self.effect);
        let (before, after) = (format!("without {effect}"), format!("with {effect}"));
        let captions = Captions {
            title: "Measurement, the model without it and the model with it",
            description: format!(
                "Active and reactive power of event {}: measured, and as modelled without and with {effect}.",
                self.event()
            ),
            before: &before,
            after: &after,
        };
        overlay::chart(&self.overlay, &captions)
    }

    /// For programs.
    pub(super) fn json(&self) -> Value {
        let errors = |judged: &Judged| {
            let errors = &judged.comparison.errors;
            json!({
                "eps_p_percent": errors.eps_p_percent,
                "eps_q_percent": errors.eps_q_percent,
                "error_to_noise": errors.error_to_noise,
            })
        };
        json!({
            "effect": self.effect,
            "event": self.event(),
            "without": errors(&self.overlay.before),
            "with": errors(&self.overlay.after),
        })
    }
}

/// The section of the page.
pub(super) fn section(
    page: &DiagnosisPage,
    diagnosis: &DiagnosisV1,
    trial: &Trial,
    source: &str,
) -> Markup {
    let errors = |judged: &Judged| judged.comparison.errors.clone();
    let (before, after) = (errors(&trial.overlay.before), errors(&trial.overlay.after));
    let fell = |before: f64, after: f64| {
        html! { (number::significant(before, 3)) " → " strong { (number::significant(after, 3)) } }
    };
    let seen = if diagnosis
        .events
        .untouched
        .iter()
        .any(|e| e == trial.event())
    {
        "Neither fit has seen this event."
    } else {
        "Both fits have seen this event."
    };
    html! {
        h2 #what-it-does { "What " (words::effect(&trial.effect)) " does to the model" }
        p {
            "Error of P " (fell(before.eps_p_percent, after.eps_p_percent)) " %, of Q "
            (fell(before.eps_q_percent, after.eps_q_percent)) " %, "
            (fell(before.error_to_noise, after.error_to_noise)) " × noise, on event "
            a href=(page.head.address(&format!("events/{}", segment(trial.event())))) { (trial.event()) }
            ". " (seen)
        }
        (choice(diagnosis, trial))
        (plot::figure(&trial.chart(), Some(source)))
    }
}

fn choice(diagnosis: &DiagnosisV1, trial: &Trial) -> Markup {
    html! {
        form.filter method="get" {
            label { "Effect "
                select name="with" {
                    @for (effect, _) in drawable(diagnosis) {
                        option value=(effect) selected[effect == trial.effect] { (words::effect(effect)) }
                    }
                }
            }
            label { "Event "
                select name="event" {
                    @for failure in &diagnosis.failures {
                        option value=(failure.event) selected[failure.event == trial.event()] {
                            (failure.event) ", V/V0 " (number::fixed(failure.lowest_voltage, 2))
                            @if diagnosis.events.untouched.contains(&failure.event) { ", not seen by the fits" }
                        }
                    }
                }
            }
            button type="submit" { "Draw" }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::wire::v1::examples;

    fn asked(with: &str, event: &str) -> Asked {
        Asked {
            with: with.to_owned(),
            event: event.to_owned(),
        }
    }

    #[test]
    fn the_first_effect_of_the_answer_that_was_refitted_is_drawn() {
        let mut diagnosis = DiagnosisV1::new(&examples::diagnosis(), 1);
        let drawn = |diagnosis: &DiagnosisV1, with: &str| {
            let found = effect(diagnosis, &asked(with, ""));
            found.map(|found| found.map(|(effect, _)| effect.to_owned()))
        };
        let named = Some("stator_resistance".to_owned());
        assert_eq!(drawn(&diagnosis, ""), Ok(named.clone()));
        let unknown = drawn(&diagnosis, "tap_changer").unwrap_err();
        assert!(unknown.detail.contains("tap_changer"), "{}", unknown.detail);
        diagnosis.answer_set.clear();
        let form = Some("general_second_order".to_owned());
        assert_eq!(drawn(&diagnosis, ""), Ok(form), "nothing is named");
        assert_eq!(drawn(&diagnosis, "stator_resistance"), Ok(named));
        diagnosis.candidates[0].model = None;
        assert!(drawn(&diagnosis, "stator_resistance").is_err());
        diagnosis.unexplained = None;
        assert_eq!(drawn(&diagnosis, ""), Ok(None));
    }

    #[test]
    fn an_event_that_no_fit_has_seen_is_drawn_before_a_worse_one() {
        let mut diagnosis = DiagnosisV1::new(&examples::diagnosis(), 1);
        let mut worse = diagnosis.failures[0].clone();
        worse.event = "worse".to_owned();
        worse.error_to_noise *= 2.0;
        diagnosis.failures.push(worse);
        let first = diagnosis.failures[0].event.clone();
        assert_eq!(event(&diagnosis, &asked("", "")), Ok(Some("worse")));
        assert_eq!(event(&diagnosis, &asked("", &first)), Ok(Some(&*first)));
        diagnosis.events.untouched = vec![first.clone()];
        assert_eq!(event(&diagnosis, &asked("", "")), Ok(Some(&*first)));
        assert!(event(&diagnosis, &asked("", "nothing")).is_err());
    }
}
