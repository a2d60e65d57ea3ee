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
    let others = found.chosen[1..].iter();
    let others: Vec<String> = others
        .map(|other| format!(" Besides, {}.", told(events, &terms[other.term], other)))
        .collect();
    let fitted: f64 = found.chosen.iter().flat_map(|c| c.shares).sum();
    let together = if found.chosen.len() == 1 {
        "This is"
    } else {
        "Together"
    };
    let proven = match found.held_out_share {
        Some(share) => format!(
            ", and of what is above the noise {:.0} % on events left out",
            100.0 * share
        ),
        None => "; there is one event, so that nothing tests it".to_owned(),
    };
    format!(
        "{}.{} {together} {:.0} % of the residual's squares{proven}.",
        told(events, &terms[first.term], first),
        others.concat(),
        100.0 * fitted
    )
}

/// What a term says.
fn told(events: &[(&PreparedEvent, &Curves)], term: &Term, chosen: &Chosen) -> String {
    match term.threshold() {
        Some(threshold) => told_of_threshold(events, term, threshold, chosen),
        None => told_of_course(term, chosen),
    }
}

fn told_of_threshold(
    events: &[(&PreparedEvent, &Curves)],
    term: &Term,
    threshold: f64,
    chosen: &Chosen,
) -> String {
    let Subject {
        who,
        is,
        stays,
        size,
    } = Subject::new(chosen);
    let level = level(chosen);
    let excess = matches!(term, Term::Excess { .. });
    let crossed = |event: &PreparedEvent| {
        if excess {
            event.highest_voltage > threshold
        } else {
            event.lowest_voltage < threshold
        }
    };
    let count = events.iter().filter(|(event, _)| crossed(event)).count();
    let what = match term.class() {
        Class::Lasting => {
            let delay = delay_text(term);
            let depth = if matches!(term, Term::Memory { .. }) {
                ", the more the deeper,"
            } else {
                ""
            };
            format!(
                "{who} {stays} {size} than modelled after dips below {level}{delay}{depth} and \
                 nothing of it comes back within the window"
            )
        }
        Class::Returning => format!(
            "{who} {is} {size} than modelled from dips below {level} on, fading within about {}",
            time_text(term)
        ),
        Class::WhileLow => format!(
            "{who} {is} {size} than modelled as long as the voltage is below {level}, and back at \
             once after that"
        ),
        _ => format!(
            "{who} {is} up to {size} than modelled {} {level}, in step with the voltage",
            if excess { "above" } else { "below" }
        ),
    };
    format!("{what} ({count} of {} events)", events.len())
}

fn told_of_course(term: &Term, chosen: &Chosen) -> String {
    let Subject { who, is, size, .. } = Subject::new(chosen);
    let time = time_text(term);
    match term.class() {
        Class::Quick => format!(
            "{who} {is} up to {size} than modelled for some cycles after each change of the \
             voltage, in step with its rate of change"
        ),
        Class::Dynamic => format!(
            "{who} {is} up to {size} than modelled while the voltage changes, fading with a time \
             constant of about {time}"
        ),
        Class::Recovering => format!(
            "{who} {is} up to {size} than modelled after a lasting change of the voltage and \
             recovers over about {time}"
        ),
        Class::Frequency => {
            let lag = if matches!(term, Term::FrequencyLag { .. }) {
                format!(", with a lag of about {time},")
            } else {
                String::new()
            };
            format!(
                "{who} {is} not only what is modelled but follows the frequency{lag} by {} % of \
                 P0 per 1 % of frequency deviation",
                coefficients(chosen, 1.0)
            )
        }
        Class::Drift => format!(
            "{who} {is} drifting away from the model through the whole window, before the \
             disturbance too, by {} % of P0 per second",
            coefficients(chosen, 100.0)
        ),
        _ => format!(
            "{who} {is} up to {size} than modelled as a bent function of the present voltage, \
             without memory"
        ),
    }
}

/// The channels and by how much they are off, as parts of a sentence.
struct Subject {
    who: &'static str,
    is: &'static str,
    stays: &'static str,
    size: String,
}

impl Subject {
    fn new(chosen: &Chosen) -> Self {
        let [p, q] = chosen.coefficients;
        let larger = p.abs().max(q.abs()).max(f64::MIN_POSITIVE);
        let side = |c: f64| {
            let word = if c > 0.0 { "higher" } else { "lower" };
            format!(
                "{:.1} % of P0 {word}",
                100.0 * chosen.largest_pu * c.abs() / larger
            )
        };
        let (who, size) = match (p != 0.0, q != 0.0) {
            (true, true) => ("P and Q", format!("{} and {}", side(p), side(q))),
            (false, true) => ("Q", side(q)),
            _ => ("P", side(p)),
        };
        let (is, stays) = if p != 0.0 && q != 0.0 {
            ("are", "stay")
        } else {
            ("is", "stays")
        };
        Self {
            who,
            is,
            stays,
            size,
        }
    }
}

fn coefficients(chosen: &Chosen, scale: f64) -> String {
    let shown = chosen.coefficients.into_iter().filter(|c| *c != 0.0);
    let texts: Vec<String> = shown.map(|c| format!("{:+.2}", scale * c)).collect();
    texts.join(" and ")
}

fn level(chosen: &Chosen) -> String {
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
