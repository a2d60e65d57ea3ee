//! Whether stated standard errors are as large as the errors are: sites of the truth simulator with one
//! effect each, fitted by the structure with that effect, and how often the truth lies within one and
//! two standard errors.
//!
//! ```text
//! nice cargo run --release --example coverage -- [sites per effect] [seed] [spread of the composition, %] [wide]
//! ```
//!
//! Right errors give 68 and 95 %. Only what means the same to simulator and estimator is compared: where
//! a relay of the simulator has one delay, the sum of the estimator's, to the middle of the opening. Every
//! comparison goes to the standard error output. The composition of the load varies by 2 % from event to event if nothing else is said, so that the true share of
//! the motors is that of the mean of the events. Compared is the fit that is published, with the narrowest spread that the
//! events allow; with `wide` the one by which structures compete.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "an example speaks to whoever runs it"
)]

use std::collections::BTreeMap;

use loadmodeld::{
    adapters::recordings::site_folder,
    disturbance::Window,
    identification::{
        composed::{ComposedFit, ComposedFitOptions, Ground, fit, narrowed, refine},
        intake::{IntakeOptions, PreparedEvent, prepare},
    },
    load_model::{Structure, composed::ComposedModel},
    truth::{Effect, HiddenEffect, StudyShape, SyntheticSite, estimator_terms, study_site},
};

/// A true value of a site's effect, in the estimator's terms.
type True = fn(&SyntheticSite, &HiddenEffect) -> Option<f64>;
/// What of the estimator is compared, the parameters whose weighted sum it is (none: it is one parameter),
/// and its true value.
type Pair = (&'static str, &'static [(&'static str, f64)], True);

fn own(name: &'static str, hidden: &HiddenEffect) -> Option<f64> {
    hidden
        .values()
        .find(|(p, _)| p.name == name)
        .map(|(_, v)| v)
}

fn term(name: &str, site: &SyntheticSite) -> Option<f64> {
    let terms = estimator_terms(site);
    let mut values = terms.into_iter().flat_map(|t| t.values);
    values.find(|(n, _)| *n == name).map(|(_, value)| value)
}

/// What the estimator's relay takes by itself, in the middle of its switching.
const SWITCHING_S: f64 = 0.002;

fn until_open(hidden: &HiddenEffect) -> Option<f64> {
    Some(own("delay_s", hidden)? - SWITCHING_S)
}

/// The delays of a relay that disconnects, to the middle of its opening.
const DISCONNECTION: &[(&str, f64)] = &[
    ("time_s", 1.0),
    ("opening_s", 1.0),
    ("opening_spread_s", 0.5),
];
/// The same of motors.
const TRIP: &[(&str, f64)] = &[
    ("trip_time_s", 1.0),
    ("opening_s", 1.0),
    ("opening_spread_s", 0.5),
];

/// The middle of the voltages between which generation ceases, which the simulator's does at one.
const MIDDLE_OF_CUT: &[(&str, f64)] = &[("voltage", 1.0), ("span", -0.5)];

/// Generation that the dip changes: what stays on is netted out of the load.
fn stopping(hidden: &HiddenEffect) -> Option<f64> {
    let share = own("share", hidden)?;
    Some(match hidden.choice("behaviour") {
        "trip" => share * own("tripping", hidden)?,
        _ => share,
    })
}

/// The voltage of generation that is switched off; what rides through has one that does nothing.
fn switched_off_below(hidden: &HiddenEffect) -> Option<f64> {
    (hidden.choice("behaviour") == "trip").then(|| own("threshold_pu", hidden))?
}

fn ceasing_below(hidden: &HiddenEffect) -> Option<f64> {
    (hidden.choice("behaviour") == "momentary_cessation").then(|| own("threshold_pu", hidden))?
}

/// Effects, and what of them can be compared.
const COMPARED: &[(Effect, &[Pair])] = &[
    (
        Effect::SelfDisconnection,
        &[
            ("share", &[], |_, h| own("share", h)),
            ("voltage", &[], |_, h| own("threshold_pu", h)),
            ("delay", DISCONNECTION, |_, h| until_open(h)),
        ],
    ),
    (
        Effect::MotorUndervoltageTrip,
        &[
            ("share", &[], |_, h| own("share_of_motors", h)),
            ("trip_voltage", &[], |_, h| own("threshold_pu", h)),
            ("delay", TRIP, |_, h| until_open(h)),
        ],
    ),
    (
        Effect::ElectronicLoadDropout,
        &[
            ("share", &[], |_, h| own("share", h)),
            ("first_voltage", &[], |_, h| own("first_pu", h)),
            ("returning_share", &[], |_, h| own("returning", h)),
        ],
    ),
    (
        Effect::DistributedGeneration,
        &[
            ("share", &[], |_, h| stopping(h)),
            ("voltage", &[], |_, h| switched_off_below(h)),
            ("middle_of_cut", MIDDLE_OF_CUT, |_, h| ceasing_below(h)),
        ],
    ),
    (
        Effect::StaticFrequencyDependence,
        &[("active_coefficient", &[], |_, h| own("active", h))],
    ),
    (
        Effect::SpeedDependentTorque,
        &[("exponent", &[], |s, _| term("exponent", s))],
    ),
    (
        Effect::StatorResistance,
        &[("resistance", &[], |s, _| {
            term("resistance_motor_base_pu", s).map(|r| r * s.options.motor.load_factor)
        })],
    ),
    (
        Effect::TimeSkew,
        &[("delay_s", &[], |_, h| own("skew_s", h))],
    ),
    (
        Effect::RatioPhaseError,
        &[("angle_rad", &[], |s, _| term("angle_rad", s))],
    ),
];

/// The motors' share of the load from which events differ; not counted among all, where that of the events is.
const OF_LOAD: &str = "motor_share_of_load";

/// Counts of one parameter.
#[derive(Default)]
struct Count {
    all: u32,
    within_one: u32,
    within_two: u32,
    without_error: u32,
    ratios: Vec<f64>,
}

fn main() {
    let numbers: Vec<u64> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let sites = numbers.first().copied().unwrap_or(25);
    let seed = numbers.get(1).copied().unwrap_or(1);
    let spread_percent = std::env::args().nth(3).and_then(|a| a.parse().ok());
    let spread_percent: f64 = spread_percent.unwrap_or(2.0);
    let wide = std::env::args().any(|a| a == "wide");
    println!(
        "| effect | parameter | sites | within 1 | within 2 | median of error over standard error | no standard error |"
    );
    println!("|---|---|---|---|---|---|---|");
    let mut total: [u32; 3] = [0; 3];
    for (effect, pairs) in COMPARED {
        let mut counts: BTreeMap<&str, Count> = BTreeMap::new();
        for number in 0..sites {
            let shape = StudyShape {
                effects: vec![*effect],
                bad_samples: false,
                stator_resistance: 0.0,
                composition_spread: spread_percent / 100.0,
                ..StudyShape::default()
            };
            match study_site(seed, number, &shape) {
                Ok(site) => count(&site, pairs, wide, &mut counts),
                Err(error) => eprintln!("{} {number}: {error}", effect.name()),
            }
        }
        for (name, count) in &mut counts {
            count.ratios.sort_by(f64::total_cmp);
            let median = count.ratios.get(count.ratios.len() / 2);
            println!(
                "| {} | {name} | {} | {} | {} | {:.2} | {} |",
                effect.name(),
                count.all,
                count.within_one,
                count.within_two,
                median.copied().unwrap_or(f64::NAN),
                count.without_error
            );
            if *name != OF_LOAD {
                total[0] += count.all;
                total[1] += count.within_one;
                total[2] += count.within_two;
            }
        }
    }
    println!("| all | | {} | {} | {} | | |", total[0], total[1], total[2]);
}

fn count(
    site: &SyntheticSite,
    pairs: &[Pair],
    wide: bool,
    counts: &mut BTreeMap<&'static str, Count>,
) {
    let Some(hidden) = site.options.effects.first() else {
        return;
    };
    let name = hidden.effect().name();
    let Some(fitted) = fitted(site, name, wide) else {
        eprintln!("{}: no fit", site.options.site.name);
        return;
    };
    let mut compare = |what: &'static str, parts: &[(String, f64)], truth: f64| {
        let entry = counts.entry(what).or_default();
        let Some((estimate, error)) = weighted_sum(&fitted, parts) else {
            entry.without_error += 1;
            return;
        };
        let ratio = (estimate - truth).abs() / error;
        eprintln!(
            "{} {what}: {estimate:.4} +- {error:.4}, truth {truth:.4}, {ratio:.2}",
            site.options.site.name
        );
        entry.all += 1;
        entry.within_one += u32::from(ratio <= 1.0);
        entry.within_two += u32::from(ratio <= 2.0);
        entry.ratios.push(ratio);
    };
    for (what, parts, truth) in pairs {
        if let Some(truth) = truth(site, hidden) {
            let itself = [(*what, 1.0)];
            let parts = if parts.is_empty() { &itself } else { *parts };
            let parts: Vec<(String, f64)> = (parts.iter())
                .map(|(parameter, weight)| (format!("{name}.{parameter}"), *weight))
                .collect();
            compare(what, &parts, truth);
        }
    }
    let takes_motors = matches!(hidden.effect(), Effect::MotorUndervoltageTrip);
    if !takes_motors {
        let shares: Vec<f64> = site.truth.iter().map(|t| t.motor_share).collect();
        let mean = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
        let itself = [("motor_share".to_owned(), 1.0)];
        compare("motor_share", &itself, mean);
        compare(OF_LOAD, &itself, site.options.motor_share);
    }
}

/// Estimate of a weighted sum of parameters and its standard error; `None` where one of them has none.
fn weighted_sum(fitted: &ComposedFit, parts: &[(String, f64)]) -> Option<(f64, f64)> {
    let covariance = fitted.covariance.as_ref()?;
    let mut estimate = 0.0;
    let mut places = Vec::new();
    let mut variance = 0.0;
    for (name, weight) in parts {
        let index = fitted.model.index(name)?;
        estimate += weight * fitted.parameters[index];
        fitted.standard_error(index)?;
        let place = fitted.free.iter().position(|i| *i == index)?;
        places.push((place, *weight));
        // What the model's form leaves open is its own, whatever the data say.
        let declared = &fitted.model.parameters()[index].declaration;
        variance += (weight * declared.resolution).powi(2);
        // A step may lie anywhere in the model's span, uniformly.
        if name.rsplit('.').next() == Some("span") {
            variance += fitted.parameters[index].powi(2) / 12.0;
        }
    }
    let terms = (places.iter())
        .flat_map(|(i, a)| (places.iter()).map(move |(j, b)| a * b * covariance[(*i, *j)]));
    variance += terms.sum::<f64>();
    (variance > 0.0).then(|| (estimate, variance.sqrt()))
}

fn fitted(site: &SyntheticSite, effect: &str, wide: bool) -> Option<ComposedFit> {
    let windows = site.records.iter().zip(1..).map(|(record, number)| Window {
        id: format!("event_{number:02}"),
        ..site_folder::window(&site.options.site, record)
    });
    let events: Vec<PreparedEvent> = windows
        .filter_map(|w| prepare(&w, &IntakeOptions::default()).ok())
        .collect();
    let structure = Structure::zip_im();
    let model = ComposedModel::new(&structure);
    let free: Vec<usize> = (0..model.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let from = |events: &[PreparedEvent]| {
        fit(events, &model, &model.typical(), &free, &options, &|| false)
    };
    // The mildest events too, which no threshold has reached.
    let mut mild: Vec<PreparedEvent> = events.clone();
    mild.sort_by(|a, b| b.lowest_voltage.total_cmp(&a.lowest_voltage));
    mild.truncate(events.len().div_ceil(2).max(2));
    let starts = [from(&events), from(&mild)];
    let origins: Vec<&ComposedFit> = starts.iter().flatten().collect();
    let ground = Ground::new(&events, &structure, &origins, &options, &|| false);
    let sketched = ground.refit(&ground.screen(effect).ok()?, f64::INFINITY)?;
    let refined = refine(&events, sketched, effect, &options, &|| false);
    Some(if wide {
        refined
    } else {
        narrowed(&events, &refined, &options, &|| false)
    })
}
