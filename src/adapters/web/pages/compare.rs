//! Two events of a site over one time axis.

use std::sync::Arc;

use axum::{
    extract::{Path, RawQuery, State},
    http::Uri,
    response::Response,
};
use maud::{Markup, html};
use serde_json::{Value, json};

use super::{
    super::{
        desk::{Desk, Judged},
        layout::{SiteHead, Tab, segment},
        plot::{self, Chart, Ink, Mark, Panel, padded, span_of},
        problem::Problem,
        view::{self, Page, Table, cell},
        words,
    },
    models::{self, Model},
};
use crate::{
    adapters::{report::number, wire::v1::rfc3339},
    disturbance::Window,
    measurement::Sample,
};

/// `/sites/{site}/compare?event=A&event=B`.
pub(in super::super) async fn show(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    RawQuery(query): RawQuery,
    uri: Uri,
) -> Response {
    let query = query.unwrap_or_default();
    view::show(desk, uri, move |desk| Pair::load(desk, &site, &query)).await
}

struct Member {
    window: Window,
    judged: Option<Arc<Judged>>,
}

struct Pair {
    head: SiteHead,
    model: Option<Model>,
    members: [Member; 2],
}

impl Pair {
    fn load(desk: &Desk, site: &str, query: &str) -> Result<Self, Problem> {
        let head = SiteHead::load(desk, site)?;
        let names: Vec<String> = url_pairs(query)
            .filter(|(name, _)| name == "event")
            .map(|(_, value)| value)
            .collect();
        let [a, b] = names.as_slice() else {
            let detail = format!("tick two events to compare; {} were ticked", names.len());
            return Err(Problem::bad_request(detail));
        };
        let model = models::usual(desk, &head, None)?;
        let member = |name: &str| {
            let window = desk
                .store()
                .window(name)?
                .filter(|window| window.site == site);
            let window = window.ok_or_else(|| {
                Problem::not_found(format!("`{site}` has no event `{name}` with waveforms"))
            })?;
            let judged = model
                .as_ref()
                .and_then(|m| desk.comparison(&m.set, &m.content_hash, &window).ok());
            Ok::<_, Problem>(Member { window, judged })
        };
        Ok(Self {
            members: [member(a)?, member(b)?],
            head,
            model,
        })
    }
}

/// Names and values of a query, with `%XX` and `+` resolved.
fn url_pairs(query: &str) -> impl Iterator<Item = (String, String)> {
    query.split('&').filter_map(|pair| {
        let (name, value) = pair.split_once('=')?;
        Some((unescaped(name), unescaped(value)))
    })
}

fn unescaped(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'+' => b' ',
            b'%' => {
                let digits = rest.clone().take(2).map(|d| char::from(d).to_digit(16));
                let value = digits
                    .collect::<Option<Vec<u32>>>()
                    .filter(|d| d.len() == 2);
                match value.and_then(|d| u8::try_from(16 * d[0] + d[1]).ok()) {
                    Some(value) => {
                        rest.nth(1);
                        value
                    }
                    None => b'%',
                }
            }
            other => other,
        });
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

impl Member {
    fn time_s(&self) -> Vec<f64> {
        let (onset, rate) = (self.window.onset as f64, self.window.record.rate_fps);
        (0..self.window.record.samples.len())
            .map(|k| (k as f64 - onset) / rate)
            .collect()
    }

    fn channel(&self, value: fn(&Sample) -> f64) -> Vec<f64> {
        let samples = self.window.record.samples.iter();
        samples
            .map(|s| if s.usable() { value(s) } else { f64::NAN })
            .collect()
    }

    fn name(&self) -> String {
        words::utc(self.window.onset_ns())
    }
}

impl Page for Pair {
    fn title(&self) -> String {
        format!("Two events of {}", self.head.site.name)
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        Some((&self.head, Tab::Events))
    }

    fn body(&self, source: &str) -> Markup {
        html! {
            h1 { "Two events over one time axis" }
            div.scroll tabindex="0" role="region" aria-label="The two events" {
                table.list {
                    thead { tr {
                        th scope="col" { "Event" } th.num scope="col" { "Lowest V, pu" }
                        th scope="col" { "Where the model fails" } th.num scope="col" { "Error / noise" }
                    } }
                    tbody { @for member in &self.members {
                        tr {
                            th scope="row" { a href=(self.head.address(&format!("events/{}", segment(&member.window.id)))) { (member.name()) } }
                            td.num { (number::fixed(member.window.record.lowest_voltage_pu(), 3)) }
                            @if let Some(judged) = &member.judged {
                                td { (judged.failure.as_ref().map_or("", |f| f.sentence.as_str())) }
                                td.num { (number::significant(judged.comparison.errors.error_to_noise, 3)) }
                            } @else { td {} td {} }
                        }
                    } }
                }
            }
            @if let Some(model) = &self.model {
                p.note { "Model: " (model.label) ", " (words::structure(&model.set.structure)) }
            }
            (plot::figure(&self.chart(), Some(source)))
        }
    }

    fn charts(&self) -> Vec<Chart> {
        vec![self.chart()]
    }

    fn json(&self) -> Result<Value, Problem> {
        Ok(json!({
            "site": self.head.site.name,
            "events": self.members.iter().map(|member| json!({
                "event": member.window.id,
                "onset_utc": rfc3339(member.window.onset_ns()),
                "time_s": member.time_s(),
                "voltage_pu": member.channel(|s| s.voltage_pu),
                "frequency_hz": member.channel(|s| s.frequency_hz),
                "active_pu": member.channel(|s| s.active_pu),
                "reactive_pu": member.channel(|s| s.reactive_pu),
                "error_to_noise": member.judged.as_ref().map(|j| j.comparison.errors.error_to_noise),
            })).collect::<Vec<_>>(),
        }))
    }

    fn table(&self) -> Table {
        let mut table = Table::new(&["event", "time_s", "v_pu", "freq_hz", "p_pu", "q_pu"]);
        for member in &self.members {
            for (time, sample) in member
                .time_s()
                .into_iter()
                .zip(&member.window.record.samples)
            {
                let values = if sample.usable() {
                    [
                        sample.voltage_pu,
                        sample.frequency_hz,
                        sample.active_pu,
                        sample.reactive_pu,
                    ]
                } else {
                    [f64::NAN; 4]
                };
                let mut row = vec![member.window.id.clone(), cell(time)];
                row.extend(values.map(cell));
                table.rows.push(row);
            }
        }
        table
    }
}

/// Title, height, least span and value of a panel.
type Channel = (&'static str, u32, f64, fn(&Sample) -> f64);

const CHANNELS: [Channel; 4] = [
    ("Voltage V, pu", 130, 0.004, |s| s.voltage_pu),
    ("Frequency f, Hz", 110, 0.02, |s| s.frequency_hz),
    ("Active power P, pu", 180, 0.004, |s| s.active_pu),
    ("Reactive power Q, pu", 180, 0.004, |s| s.reactive_pu),
];

impl Pair {
    fn chart(&self) -> Chart {
        let panels = CHANNELS.map(|(title, height, least, value)| {
            let series = self.members.each_ref().map(|member| member.channel(value));
            let vertical = padded(span_of(series.iter().flatten()), least);
            let inks = [Ink::Measured, Ink::Model];
            let lines = self
                .members
                .iter()
                .zip(series)
                .zip(inks)
                .map(|((member, y), ink)| Mark::Line {
                    name: member.name(),
                    ink,
                    x: Some(member.time_s()),
                    y,
                    dashed: ink == Ink::Model,
                });
            let marks = std::iter::once(Mark::Upright { at: 0.0 })
                .chain(lines)
                .collect();
            Panel {
                title: title.to_owned(),
                height,
                vertical,
                logarithmic: false,
                marks,
            }
        });
        let times: Vec<f64> = self.members.iter().flat_map(Member::time_s).collect();
        Chart {
            id: "pair".to_owned(),
            title: "Two disturbances of one load".to_owned(),
            description:
                "Voltage, frequency, active and reactive power of both events, each from its onset."
                    .to_owned(),
            horizontal_title: "time from onset, s".to_owned(),
            horizontal: span_of(&times)
                .filter(|(low, high)| low < high)
                .unwrap_or((0.0, 1.0)),
            names: Vec::new(),
            x: Vec::new(),
            linked: Some("time"),
            panels: panels.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_query_is_read_as_browsers_write_it() {
        let found: Vec<_> = url_pairs("event=a%2Fb+c&x&event=%zz%C3%BC").collect();
        let expected = [("event", "a/b c"), ("event", "%zzü")];
        assert_eq!(found, expected.map(|(a, b)| (a.to_owned(), b.to_owned())));
    }
}
