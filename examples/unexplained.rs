//! How well what is left of a fit is described when the catalogue is not asked: sites of the truth
//! simulator with one hidden effect each, fitted by ZIP and motor alone.
//!
//! ```text
//! cargo run --release --example unexplained -- [sites per effect] [seed]
//! ```
//!
//! Prints, for each effect, the leading terms and how many of them are of a kind that an engineer
//! would accept for it.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "an example speaks to whoever runs it"
)]

use loadmodeld::{
    adapters::recordings::site_folder,
    diagnosis::unexplained::describe,
    disturbance::Window,
    identification::{
        composed::{ComposedFitOptions, ComposedLoad, fit},
        evaluate::{Curves, EventModel},
        intake::{IntakeOptions, PreparedEvent, prepare},
    },
    load_model::{Structure, composed::ComposedModel},
    truth::{Effect, StudyShape, SyntheticSite, study_site},
};

/// The effects, and words of which the leading formula of a right description holds one.
const EXPECTED: &[(Effect, &[&str])] = &[
    (Effect::SelfDisconnection, &["latch", "minimum"]),
    (Effect::ElectronicLoadDropout, &["latch", "minimum"]),
    (Effect::MotorUndervoltageTrip, &["latch", "minimum"]),
    (Effect::DistributedGeneration, &["latch"]),
    (Effect::SinglePhaseAcStall, &["latch"]),
    (Effect::DischargeLighting, &["latch", "below"]),
    (Effect::ContactorDropout, &["latch", "below"]),
    (Effect::LowVoltageConversion, &["max(", "below", "^"]),
    (Effect::Saturation, &["^", "max("]),
    (Effect::ExponentialRecovery, &["lag(v"]),
    (Effect::TapChanger, &["lag(v", "t"]),
    (Effect::SecondMotor, &["lag(v"]),
    (Effect::DoubleCageRotor, &["lag(v"]),
    (Effect::StatorResistance, &["lag(v", "^", "max("]),
    (Effect::FeederImpedance, &["lag(v", "^", "max("]),
    (Effect::StaticFrequencyDependence, &["df"]),
    (Effect::SpeedDependentTorque, &["df"]),
    (Effect::FrequencyScaledPower, &["df"]),
    (Effect::LoadRamp, &["t"]),
    (Effect::TimeSkew, &["lag(v"]),
];

fn main() {
    let numbers: Vec<u64> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let sites = numbers.first().copied().unwrap_or(4);
    let seed = numbers.get(1).copied().unwrap_or(1);
    let (mut right, mut described, mut all) = (0, 0, 0);
    for (effect, words) in EXPECTED {
        for number in 0..sites {
            let Some(found) = describe_site(seed, number, &[*effect]) else {
                continue;
            };
            all += 1;
            let first = found.as_ref().and_then(|u| u.terms.first());
            let fits = first.is_some_and(|t| words.iter().any(|w| matches(&t.formula, w)));
            right += usize::from(fits);
            described += usize::from(first.is_some());
            println!(
                "{:28} {} {}",
                effect.name(),
                if fits { "right" } else { "-    " },
                found.map_or_else(|| "nothing left".to_owned(), |u| u.signature)
            );
        }
    }
    let mut claimed = 0;
    let mut plain = 0;
    for number in 0..2 * sites {
        let Some(found) = describe_site(seed, number, &[]) else {
            continue;
        };
        plain += 1;
        let terms = found.as_ref().is_some_and(|u| !u.terms.is_empty());
        claimed += usize::from(terms);
        println!(
            "{:28} {} {}",
            "nothing hidden",
            if terms { "CLAIM" } else { "-    " },
            found.map_or_else(|| "nothing left".to_owned(), |u| u.signature)
        );
    }
    println!("kind of the leading term right: {right} of {all} (described: {described})");
    println!("terms where nothing is hidden: {claimed} of {plain}");
}

fn matches(formula: &str, word: &str) -> bool {
    if word == "t" {
        formula == "t"
    } else {
        formula.contains(word)
    }
}

/// The description of one site; `None` when it could not be made or fitted.
fn describe_site(
    seed: u64,
    number: u64,
    effects: &[Effect],
) -> Option<Option<loadmodeld::diagnosis::Unexplained>> {
    let shape = StudyShape {
        effects: effects.to_vec(),
        bad_samples: false,
        ..StudyShape::default()
    };
    let site = study_site(seed, number, &shape)
        .map_err(|e| eprintln!("site {number} of {effects:?}: {e}"))
        .ok()?;
    let events = prepared(&site);
    let structure = Structure::zip_im();
    let model = ComposedModel::new(&structure);
    let free: Vec<usize> = (0..model.parameters().len()).collect();
    let options = ComposedFitOptions::default();
    let fitted = fit(&events, &model, &model.typical(), &free, &options, &|| {
        false
    })?;
    let model = ComposedLoad {
        structure,
        model,
        parameters: fitted.parameters,
    };
    let curves: Vec<Curves> = events
        .iter()
        .map(|e| model.curves(e).ok())
        .collect::<Option<_>>()?;
    Some(describe(&events, &curves))
}

fn prepared(site: &SyntheticSite) -> Vec<PreparedEvent> {
    let windows = site.records.iter().zip(1..).map(|(record, number)| Window {
        id: format!("event_{number:02}"),
        ..site_folder::window(&site.options.site, record)
    });
    windows
        .filter_map(|w| prepare(&w, &IntakeOptions::default()).ok())
        .collect()
}
