//! The description in an engineer's words.

use super::{
    selection::{Chosen, Description},
    term::{Class, ShapeKind, Term},
};
use crate::identification::{evaluate::Curves, intake::PreparedEvent};

/// One to three sentences: which channel, when, on what it depends, and how far that is proven.
pub(super) fn sentence(
    events: &[(&PreparedEvent, &Curves)],
    terms: &[Term],
    found: &Description,
) -> String {
    let Some(first) = found.chosen.first() else {
        return undescribed(events, found);
    };
    let mut text = format!("{}.", told(events, &terms[first.term], first));
    for other in &found.chosen[1..] {
        let told = told(events, &terms[other.term], other);
        text.push_str(&format!(" Besides, {told}."));
    }
    let fitted: f64 = found.chosen.iter().flat_map(|c| c.shares).sum();
    text.push_str(&format!(
        " {} {:.0} % of the residual's squares",
        if found.chosen.len() == 1 {
            "This is"
        } else {
            "Together"
        },
        100.0 * fitted
    ));
    text.push_str(&match found.held_out_share {
        Some(share) => format!(
            ", and of what is above the noise {:.0} % on events left out.",
            100.0 * share
        ),
        None => "; there is one event, so that nothing tests it.".to_owned(),
    });
    text
}

/// What a term says.
fn told(events: &[(&PreparedEvent, &Curves)], term: &Term, chosen: &Chosen) -> String {
    let (subject, size) = subject(chosen);
    let plural = chosen.coefficients.iter().all(|c| *c != 0.0);
    let (is, stays) = if plural {
        ("are", "stay")
    } else {
        ("is", "stays")
    };
    let threshold = threshold(chosen);
    let crossed = |by: &dyn Fn(&PreparedEvent) -> bool| {
        let count = events.iter().filter(|(e, _)| by(e)).count();
        format!("{count} of {} events", events.len())
    };
    let dips = || {
        let deepest = term.threshold().unwrap_or(1.0);
        crossed(&|e| e.lowest_voltage < deepest)
    };
    match term.class() {
        Class::Lasting => {
            let delay = delay_text(term);
            let depth = if matches!(term, Term::Memory { .. }) {
                ", the more the deeper,"
            } else {
                ""
            };
            format!(
                "{subject} {stays} {size} than modelled after dips below {threshold}{delay}{depth} \
                 and nothing of it comes back within the window ({})",
                dips()
            )
        }
        Class::Returning => {
            let time = time_text(term);
            format!(
                "{subject} {is} {size} than modelled from dips below {threshold} on, fading \
                 within about {time} ({})",
                dips()
            )
        }
        Class::WhileLow => format!(
            "{subject} {is} {size} than modelled as long as the voltage is below {threshold}, and \
             back at once after that ({})",
            dips()
        ),
        Class::Static => match term {
            Term::Deficit { .. } => format!(
                "{subject} {is} up to {size} than modelled below {threshold}, in step with how deep \
                 the voltage is ({})",
                dips()
            ),
            Term::Excess { .. } => format!(
                "{subject} {is} up to {size} than modelled above {threshold}, in step with the \
                 voltage ({})",
                crossed(&|e| e.highest_voltage > term.threshold().unwrap_or(1.0))
            ),
            _ => format!(
                "{subject} {is} up to {size} than modelled as a bent function of the present voltage, \
                 without memory"
            ),
        },
        Class::Quick => format!(
            "{subject} {is} up to {size} than modelled for some cycles after each change of the \
             voltage, in step with its rate of change"
        ),
        Class::Dynamic => format!(
            "{subject} {is} up to {size} than modelled while the voltage changes, fading with a time \
             constant of about {}",
            time_text(term)
        ),
        Class::Recovering => format!(
            "{subject} {is} up to {size} than modelled after a lasting change of the voltage and \
             recovers over about {}",
            time_text(term)
        ),
        Class::Frequency => format!(
            "{subject} changes with the frequency{} beyond what is modelled: by {} % of P0 per 1 % of \
             frequency deviation",
            match term {
                Term::FrequencyLag { .. } => format!(" with a lag of {}", time_text(term)),
                _ => String::new(),
            },
            coefficients(chosen),
        ),
        Class::Drift => format!(
            "{subject} moves away from the model through the whole window, before the disturbance too, by {} % of P0 \
             per second",
            coefficients(&Chosen {
                coefficients: chosen.coefficients.map(|c| 100.0 * c),
                ..chosen.clone()
            }),
        ),
    }
}

/// The channels and by how much they are off.
fn subject(chosen: &Chosen) -> (&'static str, String) {
    let [p, q] = chosen.coefficients;
    let larger = if p.abs() >= q.abs() { p } else { q };
    let scale = if larger == 0.0 {
        0.0
    } else {
        100.0 * chosen.largest_pu / larger.abs()
    };
    let side = |c: f64| {
        let word = if c > 0.0 { "higher" } else { "lower" };
        format!("{:.1} % of P0 {word}", scale * c.abs())
    };
    match (p != 0.0, q != 0.0) {
        (true, true) => ("P and Q", format!("{} and {}", side(p), side(q))),
        (false, true) => ("Q", side(q)),
        _ => ("P", side(p)),
    }
}

fn coefficients(chosen: &Chosen) -> String {
    let shown = chosen.coefficients.into_iter().filter(|c| *c != 0.0);
    let texts: Vec<String> = shown.map(|c| format!("{c:+.2}")).collect();
    texts.join(" and ")
}

fn threshold(chosen: &Chosen) -> String {
    match chosen.thresholds {
        Some([low, high]) if high > low => format!("about {low:.2} to {high:.2} pu"),
        Some([low, _]) => format!("about {low:.2} pu"),
        None => String::new(),
    }
}

fn shape(term: &Term, kind: ShapeKind) -> Option<f64> {
    let mut shapes = term.shapes().into_iter().filter(|s| s.kind == kind);
    shapes.next().map(|s| s.value)
}

fn delay_text(term: &Term) -> String {
    match shape(term, ShapeKind::Delay) {
        Some(delay_s) if delay_s > 0.02 => {
            format!(" that last longer than about {:.0} ms", 1e3 * delay_s)
        }
        _ => String::new(),
    }
}

fn time_text(term: &Term) -> String {
    match shape(term, ShapeKind::Time) {
        Some(time_s) if time_s < 1.0 => format!("{:.0} ms", 1e3 * time_s),
        Some(time_s) => format!("{time_s} s"),
        None => String::new(),
    }
}

/// What is left when no term describes it: the channel and the part of the window where most is.
fn undescribed(events: &[(&PreparedEvent, &Curves)], found: &Description) -> String {
    const PARTS: [&str; 3] = [
        "before the disturbance",
        "near the edges of the voltage",
        "away from the edges, during and after the disturbance",
    ];
    let mut squares = [[0.0; 3]; 2];
    for (event, curves) in events {
        let channels = [
            (&event.active, &curves.active, &event.active_deviation),
            (&event.reactive, &curves.reactive, &event.reactive_deviation),
        ];
        for (sums, (y, model, deviation)) in squares.iter_mut().zip(channels) {
            for k in (0..event.len()).filter(|&k| event.used[k]) {
                let part = match (event.near_edge[k], k < event.event_start) {
                    (true, _) => 1,
                    (false, true) => 0,
                    (false, false) => 2,
                };
                sums[part] += ((y[k] - model[k]) / deviation[k]).powi(2);
            }
        }
    }
    let (mut most, mut place) = (0.0, (0, 0));
    for (channel, sums) in squares.iter().enumerate() {
        for (part, sum) in sums.iter().enumerate() {
            if *sum > most {
                (most, place) = (*sum, (channel, part));
            }
        }
    }
    let total: f64 = squares.iter().flatten().sum();
    format!(
        "The residual is {:.1} times the noise, {:.0} % of its squares in {} {}; no simple function of \
         voltage, frequency and time describes it on events left out",
        found.squares_per_row.sqrt(),
        100.0 * most / total.max(f64::MIN_POSITIVE),
        ["P", "Q"][place.0],
        PARTS[place.1],
    )
}
