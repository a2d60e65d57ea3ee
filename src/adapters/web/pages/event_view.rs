//! The page of an event, in its three forms.

use std::sync::Arc;

use maud::{Markup, html};
use serde_json::{Value, json};

use super::{
    super::{
        desk::Judged,
        layout::{SiteHead, Tab, segment, verdict},
        plot,
        problem::Problem,
        view::{Page, Table, cell},
        words,
    },
    event_charts::{self, Power},
    models::{self, Choice, Model},
};
use crate::{
    adapters::{
        http::EventDocument,
        report::number,
        store::WindowSummary,
        wire::v1::{ComparisonV1, EventFailureV1},
    },
    disturbance::Window,
    identification::Comparison,
};

/// A model and what it makes of the event.
#[derive(Clone, Debug)]
pub(super) struct Drawn {
    pub(super) model: Model,
    pub(super) judged: Arc<Judged>,
}

impl Drawn {
    pub(super) fn comparison(&self) -> &Comparison {
        &self.judged.comparison
    }

    /// How the model knows the event.
    fn role(&self) -> &'static str {
        let (set, event) = (&self.model.set, &self.comparison().event);
        if set.fitted_events.contains(event) {
            "fitted on it"
        } else if set.held_out_events.contains(event) {
            "validated on it, not fitted"
        } else {
            "never saw it"
        }
    }
}

/// What the page of an event is made of.
#[derive(Debug)]
pub(super) struct EventPage {
    pub(super) head: SiteHead,
    pub(super) summary: WindowSummary,
    /// None where the waveforms have been pruned.
    pub(super) window: Option<Window>,
    pub(super) choices: Vec<Choice>,
    pub(super) model: Option<Drawn>,
    pub(super) rival: Option<Drawn>,
    /// Why no model is drawn.
    pub(super) note: Option<String>,
    /// Name of the file and what is to be known of it, where the reader sent the recording.
    pub(super) recording: Option<(String, Option<String>)>,
}

impl EventPage {
    /// The page as that of a recording that the reader sent.
    pub(super) fn of_recording(self, name: &str, note: Option<&str>) -> Self {
        Self {
            recording: Some((name.to_owned(), note.map(str::to_owned))),
            ..self
        }
    }
}

impl Page for EventPage {
    fn title(&self) -> String {
        format!(
            "Event of {} at {}",
            self.summary.site,
            words::utc(self.summary.onset_ns)
        )
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        Some((&self.head, Tab::Events))
    }

    fn body(&self, source: &str) -> Markup {
        html! {
            @if let Some((name, note)) = &self.recording {
                h1 { "Recording " (name) }
                (self.facts())
                p.note {
                    @if let Some(note) = note { (note) " " }
                    "Not stored, and used by no fit. " a href=(self.head.address("recordings")) { "Another recording" }
                }
            } @else {
                h1 { "Disturbance of " (words::utc(self.summary.onset_ns)) " UTC" }
                (self.facts())
            }
            (self.choice())
            @if let Some(note) = &self.note { p.problem { "No model is drawn: " (note) } }
            @if self.window.is_none() {
                p.problem { "The waveforms of this event are no longer kept; its summary is." }
            }
            (self.sentences())
            (self.standing())
            @let charts = event_charts::charts(self);
            @if let Some((first, others)) = charts.split_first() {
                (plot::figure(first, Some(source)))
                div.charts { @for chart in others { (plot::figure(chart, Some(source))) } }
            }
        }
    }

    fn charts(&self) -> Vec<plot::Chart> {
        event_charts::charts(self)
    }

    fn json(&self) -> Result<Value, Problem> {
        let drawn = |drawn: &Drawn| {
            json!({
                "model": drawn.model.key,
                "structure": drawn.model.set.structure,
                "comparison": ComparisonV1::from(drawn.comparison()),
                "failure": drawn.judged.failure.as_ref().map(EventFailureV1::from),
            })
        };
        Ok(json!({
            "event": EventDocument::from(&self.summary),
            "model": self.model.as_ref().map(drawn),
            "with": self.rival.as_ref().map(drawn),
            "note": self.note,
            "measured": if self.model.is_some() { Value::Null } else { self.measured() },
        }))
    }

    fn table(&self) -> Table {
        let Some(window) = &self.window else {
            return Table::new(&["time_s", "v_pu", "freq_hz", "p_pu", "q_pu"]);
        };
        let mut header = vec!["time_s", "v_pu", "freq_hz", "p_pu", "q_pu"];
        let drawn: Vec<&Drawn> = self.model.iter().chain(&self.rival).collect();
        let names = [["p_model_pu", "q_model_pu"], ["p_with_pu", "q_with_pu"]];
        header.extend(names.iter().take(drawn.len()).flatten());
        let mut table = Table::new(&header);
        let onset = window.onset as f64;
        table.rows = (window.record.samples.iter().enumerate())
            .map(|(k, sample)| {
                let time = drawn.first().map_or_else(
                    || (k as f64 - onset) / window.record.rate_fps,
                    |d| d.comparison().time_s[k],
                );
                let measured = if sample.usable() {
                    [
                        sample.voltage_pu,
                        sample.frequency_hz,
                        sample.active_pu,
                        sample.reactive_pu,
                    ]
                } else {
                    [f64::NAN; 4]
                };
                let modelled = drawn
                    .iter()
                    .flat_map(|d| Power::BOTH.map(|power| power.model(d.comparison())[k]));
                std::iter::once(time)
                    .chain(measured)
                    .chain(modelled)
                    .map(cell)
                    .collect()
            })
            .collect();
        table
    }
}

impl EventPage {
    fn facts(&self) -> Markup {
        let window = &self.summary;
        let duration_s = window.sample_count.saturating_sub(1) as f64 / window.rate_fps;
        html! {
            p.facts {
                (window.id) " · lowest voltage " strong { (number::fixed(window.lowest_voltage_pu, 3)) " pu" }
                " · " (number::fixed(duration_s, 1)) " s at " (number::short(window.rate_fps)) " samples/s · "
                @if self.recording.is_none() {
                    (words::triggers(&window.triggers)) " · ended: " (words::closing(window.closing))
                    @if self.window.is_some() {
                        " · " a href={ (self.head.address(&format!("events/{}", segment(&window.id)))) ".cff" } { "COMTRADE" }
                    }
                } @else {
                    "onset " (words::utc(window.onset_ns)) " UTC"
                }
            }
            @if let Some(screening) = &window.screening {
                @if !screening.usable() {
                    p.problem {
                        "Not used for fitting: "
                        (screening.refusals.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
                    }
                }
                @if !screening.marks.is_empty() {
                    p.note {
                        "Marked: "
                        (screening.marks.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
                    }
                }
            }
        }
    }

    fn choice(&self) -> Markup {
        let key = |drawn: &Option<Drawn>| drawn.as_ref().map_or("", |d| &d.model.key).to_owned();
        html! {
            @if !self.choices.is_empty() {
                form.filter method="get" {
                    label { "Model " (models::select("model", &self.choices, &key(&self.model), None)) }
                    label { "beside " (models::select("with", &self.choices, &key(&self.rival), Some("nothing"))) }
                    button type="submit" { "Draw" }
                }
            }
        }
    }

    /// Where each model fails, in words.
    fn sentences(&self) -> Markup {
        html! {
            @for d in self.model.iter().chain(&self.rival) {
                @if let Some(failure) = &d.judged.failure {
                    p.verdict-sentence {
                        @if self.rival.is_some() { strong { (d.model.label) ": " } }
                        (failure.sentence)
                    }
                }
            }
        }
    }

    /// How far each model is from the measurement.
    fn standing(&self) -> Markup {
        let drawn: Vec<&Drawn> = self.model.iter().chain(&self.rival).collect();
        html! {
            @if !drawn.is_empty() {
                div.scroll tabindex="0" role="region" aria-label="Errors" {
                    table.list.cards {
                        thead { tr {
                            th scope="col" { "Model" }
                            th scope="col" { "Structure" }
                            th scope="col" { "This event" }
                            th.num scope="col" { "Error of P, %" }
                            th.num scope="col" { "of Q, %" }
                            th.num scope="col" { "Event error of P, %" }
                            th.num scope="col" { "of Q, %" }
                            th.num scope="col" { "Error / noise" }
                            th.num scope="col" { "off edges" }
                        } }
                        tbody {
                            @for d in drawn {
                                @let errors = &d.comparison().errors;
                                tr {
                                    th scope="row" { (d.model.label) " " (verdict(d.model.set.verdict.status)) }
                                    td data-label="Structure" { (words::structure(&d.model.set.structure)) }
                                    td data-label="This event" { (d.role()) }
                                    td.num data-label="Error of P, %" { (number::significant(errors.eps_p_percent, 3)) }
                                    td.num data-label="Error of Q, %" { (number::significant(errors.eps_q_percent, 3)) }
                                    td.num data-label="Event error of P, %" { (number::significant(errors.event_eps_p_percent, 3)) }
                                    td.num data-label="Event error of Q, %" { (number::significant(errors.event_eps_q_percent, 3)) }
                                    td.num data-label="Error / noise" { (number::significant(errors.error_to_noise, 3)) }
                                    td.num data-label="off edges" { (number::significant(errors.error_to_noise_away_from_edges, 3)) }
                                }
                            }
                        }
                    }
                }
            }
        }
    }

    fn measured(&self) -> Value {
        self.window.as_ref().map_or(Value::Null, |window| {
            let of = |value: fn(&crate::measurement::Sample) -> f64| -> Vec<f64> {
                let samples = window.record.samples.iter();
                samples
                    .map(|s| if s.usable() { value(s) } else { f64::NAN })
                    .collect()
            };
            json!({
                "rate_fps": window.record.rate_fps,
                "onset": window.onset,
                "voltage_pu": of(|s| s.voltage_pu),
                "frequency_hz": of(|s| s.frequency_hz),
                "active_measured_pu": of(|s| s.active_pu),
                "reactive_measured_pu": of(|s| s.reactive_pu),
            })
        })
    }
}
