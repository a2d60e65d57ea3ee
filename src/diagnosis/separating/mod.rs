//! Which disturbance would tell apart what the events of a site do not.
//!
//! Every effect of an answer set foretells what P and Q do in a disturbance that nobody has seen yet. What it foretells is
//! as open as the events have left its parameters, so that two effects are told apart by a disturbance where what one of
//! them foretells cannot be followed with the other, whatever its parameters are within that:
//! [`composed::distance`] in both directions. Where only one direction is that far, one effect can do what the other
//! does, as a band of thresholds can act like one, and only the opposite would be an answer. A list of ordinary disturbances
//! is tried, and the first that would raise the criterion of the wrong one by more than what leaves two effects together in
//! an answer set is told, or else the one of which the fewest would.

mod plain;
mod would_show;

pub(super) use would_show::{Silent, would_show};

pub(super) use plain::Plain;
use plain::{ALL, Seen};

use super::{case::Case, claim::told_apart, trials::Trial, where_it_fails::Channel};
use crate::{
    identification::{
        composed::{self, ComposedFit, Foretold, Open},
        evaluate::Curves,
        intake::PreparedEvent,
        median_operating_point,
    },
    load_model::effects,
    numerics::statistics,
};

/// A band of voltages wider than this has a middle that a dip can reach, pu.
const SPAN_MIN_PU: f64 = 0.01;
/// A disturbance of which more would be needed tells nothing.
const EVENTS_MAX: f64 = 5.0;
/// Disturbances are simulated at no more than that: more samples of the same noise would cost more than they tell.
const RATE_MAX_FPS: f64 = 240.0;
/// What is said where none of [`ALL`] does.
const NONE: &str = "none of twenty ordinary disturbances would (dips to 40 % of the voltage for 0.3 s, two dips in a row, lasting steps \
                    of 5 %, 1 Hz below nominal): as far as these events determine them, both foretell the same";

/// An effect and the model with it.
struct Rival<'a> {
    name: &'a str,
    fit: &'a ComposedFit,
    open: Open,
}

/// A disturbance that would tell two effects apart.
#[derive(Clone, Debug, PartialEq)]
pub struct SeparatingEvent {
    /// The effect that it tells from this one.
    pub from: String,
    /// The disturbance, in words.
    pub disturbance: String,
    /// By how much the weighted squares of the wrong effect would rise.
    pub squares: f64,
    /// What is enough for an answer.
    pub needed: f64,
    /// How many of them would be enough.
    pub events: u32,
    /// Where the two differ most: in P or Q, ...
    pub channel: Channel,
    /// ... so long after [`Self::since`], s, ...
    pub time_s: f64,
    /// ... by so much of P0: with this effect less with the other, both as fitted.
    pub difference: f64,
    /// What the time counts from, in words.
    pub since: &'static str,
    /// Where one of the two can follow what the other foretells, so that only the opposite would be an answer: whether that
    /// is this effect.
    pub follows: Option<bool>,
}

impl SeparatingEvent {
    /// The same as the other effect has it, whose opposite is `from`.
    fn turned(&self, from: &str) -> Self {
        Self {
            from: from.to_owned(),
            difference: -self.difference,
            follows: self.follows.map(|own| !own),
            ..self.clone()
        }
    }

    /// In words, for `effect`.
    #[must_use]
    pub fn words(&self, effect: &str) -> String {
        let Self {
            from,
            disturbance,
            events,
            time_s,
            since,
            ..
        } = self;
        let channel = self.channel.name();
        let way = if self.difference < 0.0 {
            "less"
        } else {
            "more"
        };
        let size = 100.0 * self.difference.abs();
        let side = if *time_s < 0.0 { "before" } else { "after" };
        let time_s = time_s.abs();
        let often = match events {
            0 | 1 => String::new(),
            events => format!(" ({events} such events)"),
        };
        let only = match self.follows {
            None => String::new(),
            Some(own) => {
                let [flexible, other] = if own { [effect, from] } else { [from, effect] };
                format!("; it would show {flexible}, which can also do what {other} does")
            }
        };
        format!(
            "{disturbance}{often}: {time_s:.1} s {side} {since} {channel} would be {size:.1} % of P0 {way} with {effect} than with {from}{only}"
        )
    }
}

/// What separates one effect of an answer set from the first, or the first from the others.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Separated {
    /// In words; empty where nothing could be asked.
    pub(super) words: String,
    pub(super) events: Vec<SeparatingEvent>,
}

/// For each effect of an answer set, which of the [`ordinary`] disturbances would tell it from the first, or a dip into its
/// own band of voltages; for the first what would tell it from each of the others. Nothing where there is no other.
pub(super) fn separated(
    case: &Case<'_>,
    ordinary: &[(Plain, PreparedEvent)],
    answer: &[&Trial],
) -> Vec<Separated> {
    if answer.len() < 2 {
        return Vec::new();
    }
    let rivals: Option<Vec<Rival<'_>>> = (answer.iter())
        .map(|trial| {
            let (name, fit) = (trial.name(), trial.fit.as_ref()?);
            let open = Open::of(&case.judged, fit, name, &case.composed.scatter);
            Some(Rival { name, fit, open })
        })
        .collect();
    let Some([first, others @ ..]) = rivals.as_deref() else {
        return Vec::new();
    };
    let own = disturbances_of(case, halfway(case, rivals.iter().flatten()));
    let found: Vec<Option<SeparatingEvent>> = (others.iter())
        .map(|other| most_telling(case, ordinary.iter().chain(&own), [first, other]))
        .collect();
    let of_first = (others.iter().zip(&found))
        .map(|(other, found)| in_words(found.as_ref(), first.name, other.name));
    let own = Separated {
        words: of_first.collect::<Vec<_>>().join("; "),
        events: found.iter().flatten().cloned().collect(),
    };
    let of_others = others.iter().zip(&found).map(|(other, found)| {
        let turned = found.as_ref().map(|event| event.turned(first.name));
        Separated {
            words: in_words(turned.as_ref(), other.name, first.name),
            events: turned.into_iter().collect(),
        }
    });
    std::iter::once(own).chain(of_others).collect()
}

fn in_words(found: Option<&SeparatingEvent>, effect: &str, other: &str) -> String {
    match found {
        Some(event) => event.words(effect),
        None => format!("{effect} from {other}: {NONE}"),
    }
}

/// How the site would see a disturbance.
fn seen(case: &Case<'_>) -> Seen {
    let at = median_operating_point(&case.judged);
    let median = |value: &dyn Fn(&PreparedEvent) -> f64| {
        let values: Vec<f64> = case.judged.iter().map(value).collect();
        statistics::median(&values).unwrap_or(f64::NAN)
    };
    Seen {
        v0_pu: at.v0_pu,
        p0_pu: at.p0_pu,
        q0_pu: at.q0_pu,
        rate_fps: median(&|event| event.rate_fps).min(RATE_MAX_FPS),
        nominal_hz: case.site.nominal_hz,
        noise: [
            median(&|event| middle(&event.active_deviation, &event.used)),
            median(&|event| middle(&event.reactive_deviation, &event.used)),
        ],
        operating_point_deviation: median(&|event| event.operating_point_deviation),
    }
}

/// Median of the used samples.
fn middle(deviations: &[f64], used: &[bool]) -> f64 {
    let values: Vec<f64> = (deviations.iter().zip(used))
        .filter_map(|(deviation, used)| used.then_some(*deviation))
        .collect();
    statistics::median(&values).unwrap_or(f64::NAN)
}

/// Dips into the middle of the bands in which effects act in part.
fn halfway<'r>(
    case: &Case<'_>,
    rivals: impl Iterator<Item = &'r Rival<'r>>,
) -> impl Iterator<Item = Plain> {
    let v0_pu = median_operating_point(&case.judged).v0_pu;
    let middles = rivals.filter_map(move |rival| {
        let effect = effects::find(rival.name)?;
        let value = |name: &str| {
            let index = rival.fit.model.index(&format!("{}.{name}", rival.name))?;
            rival.fit.parameters.get(index).copied()
        };
        let (threshold, span) = (value(effect.threshold()?)?, value(effect.span()?)?);
        (span > SPAN_MIN_PU).then_some((threshold - 0.5 * span) / v0_pu)
    });
    middles.flat_map(Plain::dips)
}

/// The disturbances that are tried, and what the site would see of them.
pub(super) fn ordinary(case: &Case<'_>) -> Vec<(Plain, PreparedEvent)> {
    disturbances_of(case, ALL.into_iter())
}

fn disturbances_of(
    case: &Case<'_>,
    all: impl Iterator<Item = Plain>,
) -> Vec<(Plain, PreparedEvent)> {
    let seen = seen(case);
    all.map(|plain| (plain, case.trend.applied_to(&plain.event(&seen))))
        .collect()
}

/// The first disturbance that tells two effects apart, either way before one way; the one of which the fewest would where
/// none does alone. `None` where even those are many.
fn most_telling<'e>(
    case: &Case<'_>,
    events: impl Iterator<Item = &'e (Plain, PreparedEvent)>,
    pair: [&Rival<'_>; 2],
) -> Option<SeparatingEvent> {
    let mut best: Option<(f64, Apart<'_>)> = None;
    for (plain, event) in events {
        let Some(apart) = apart(case, (*plain, event), pair) else {
            continue;
        };
        let share = apart.most() / apart.needed;
        if apart.both_ways() {
            return Some(apart.separating(share, pair[1].name));
        }
        // What is enough is enough: the more ordinary one stays.
        if best
            .as_ref()
            .is_none_or(|(most, _)| share.min(1.0) > most.min(1.0))
        {
            best = Some((share, apart));
        }
    }
    let (share, apart) = best.filter(|(share, _)| share * EVENTS_MAX >= 1.0)?;
    Some(apart.separating(share, pair[1].name))
}

/// How far apart two effects are in an event.
struct Apart<'e> {
    plain: Plain,
    event: &'e PreparedEvent,
    /// Distance of what each foretells from what the other does.
    squares: [f64; 2],
    needed: f64,
    answers: [Curves; 2],
}

/// `None` where one of the effects foretells nothing of the event.
fn apart<'e>(
    case: &Case<'_>,
    (plain, event): (Plain, &'e PreparedEvent),
    [one, other]: [&Rival<'_>; 2],
) -> Option<Apart<'e>> {
    let squares: f64 = one.fit.squares.iter().sum();
    let per_row = one.fit.chi_square_per_row();
    let with_it = squares + per_row * event.rows() as f64;
    let needed = told_apart(per_row, with_it, f64::INFINITY, &case.options.claim);
    let scatter = &case.composed.scatter;
    let answer =
        |rival: &Rival<'_>| composed::answer(event, &rival.fit.model, &rival.fit.parameters);
    let answers = [answer(one)?, answer(other)?];
    let from = |rival: &Rival<'_>, answer: &Curves| {
        Foretold::new(event, rival.fit, &rival.open, scatter)?.distance(answer)
    };
    let squares = [from(other, &answers[0])?, from(one, &answers[1])?];
    Some(Apart {
        plain,
        event,
        squares,
        needed,
        answers,
    })
}

impl Apart<'_> {
    fn both_ways(&self) -> bool {
        self.squares.iter().all(|squares| *squares >= self.needed)
    }

    fn most(&self) -> f64 {
        self.squares[0].max(self.squares[1])
    }

    /// As the first of the two effects has it, which is so much of what is needed away from the one that it is told `from`.
    fn separating(&self, share: f64, from: &str) -> SeparatingEvent {
        let [one, other] = &self.answers;
        let event = self.event;
        let channels = [
            (
                Channel::Active,
                [&one.active, &other.active],
                &event.active_deviation,
            ),
            (
                Channel::Reactive,
                [&one.reactive, &other.reactive],
                &event.reactive_deviation,
            ),
        ];
        let (mut most, mut place) = (0.0, (Channel::Active, event.event_start, 0.0));
        for (channel, [one, other], deviations) in channels {
            for sample in (0..event.len()).filter(|&k| event.used[k]) {
                let difference = one[sample] - other[sample];
                let size = (difference / deviations[sample]).abs();
                if size > most {
                    (most, place) = (size, (channel, sample, difference));
                }
            }
        }
        let (channel, sample, difference) = place;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a few events"
        )]
        let events = share.recip().ceil().clamp(1.0, EVENTS_MAX) as u32;
        // One that is nowhere near what the other foretells cannot be had with it.
        let [there, back] = self
            .squares
            .map(|squares| squares * f64::from(events) >= self.needed);
        let both = there && back;
        let squares = if both {
            self.squares[0].min(self.squares[1])
        } else {
            self.most()
        };
        SeparatingEvent {
            from: from.to_owned(),
            disturbance: self.plain.words(),
            squares,
            needed: self.needed,
            events,
            channel,
            time_s: sample as f64 / event.rate_fps - self.plain.over_s(),
            difference,
            since: self.plain.since(),
            follows: (!both).then_some(there),
        }
    }
}
