//! One site of the study: made, diagnosed, improved.

use std::{collections::BTreeMap, path::Path};

use loadmodeld::{
    adapters::{recordings::site_folder, synthetic},
    diagnosis::{Change, DiagnosisOptions, Improvement, improve},
    disturbance::{ScreeningOptions, Window, screen},
    load_model::effects::catalogue,
    truth::{Effect, StudyShape, SyntheticSite, study_site},
};
use serde_json::{Value, json};

use super::novel::Novel;

/// What a site hides.
#[derive(Clone, Copy)]
pub(crate) enum Hidden {
    Nothing,
    Single(Effect),
    Pair([Effect; 2]),
    /// An effect that the catalogue is made not to have.
    Outside(Effect),
    /// A load that no catalogue has.
    Novel(Novel),
}

pub(crate) struct Case {
    seed: u64,
    number: u64,
    hidden: Hidden,
    composition_spread: f64,
}

/// Descriptions that the truth calls equal.
const EQUALS: [[&str; 2]; 1] = [["electronic_load_dropout", "self_disconnection"]];

pub(crate) fn same(truth: &str, named: &str) -> bool {
    let equal = |pair: &[&str; 2]| pair.contains(&truth) && pair.contains(&named);
    truth == named || EQUALS.iter().any(equal)
}

/// By how much further on the second of a pair is from number to number: a prime, so that none is left out.
const APART: u64 = 7;

impl Hidden {
    /// Every effect meets every other one as numbers go on.
    pub(crate) fn pair(number: u64) -> Self {
        let found =
            |effect: &Effect| !["stator_resistance", "phasor_window"].contains(&effect.name());
        let all: Vec<Effect> = Effect::ALL.into_iter().filter(found).collect();
        let count = all.len() as u64;
        let pick = |k: u64| all[usize::try_from(k % count).unwrap()];
        let others = count - 1;
        Self::Pair([pick(number), pick(number + 1 + number * APART % others)])
    }

    fn effects(self) -> Vec<Effect> {
        match self {
            Self::Nothing | Self::Novel(_) => Vec::new(),
            Self::Single(effect) | Self::Outside(effect) => vec![effect],
            Self::Pair(two) => two.to_vec(),
        }
    }

    /// Names of what is hidden.
    fn names(self) -> Vec<&'static str> {
        match self {
            Self::Novel(load) => vec![load.name()],
            _ => self.effects().into_iter().map(Effect::name).collect(),
        }
    }

    fn kind(self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::Single(_) => "single",
            Self::Pair(_) => "pair",
            Self::Outside(_) => "outside",
            Self::Novel(_) => "novel",
        }
    }
}

/// The number of a study's site: distinct for every kind of case.
fn site_number(hidden: Hidden, number: u64) -> u64 {
    let code = |effect: Effect| Effect::ALL.iter().position(|e| *e == effect).unwrap() as u64;
    match hidden {
        Hidden::Nothing => 99_000 + number,
        Hidden::Single(effect) => 1_000 * code(effect) + number,
        Hidden::Outside(effect) => 100_000 + 1_000 * code(effect) + number,
        Hidden::Pair(_) => 200_000 + number,
        Hidden::Novel(load) => {
            let code = Novel::ALL.iter().position(|l| *l == load).unwrap() as u64;
            300_000 + 1_000 * code + number
        }
    }
}

impl Case {
    pub(crate) fn new(seed: u64, number: u64, hidden: Hidden) -> Self {
        Self {
            seed,
            number,
            hidden,
            composition_spread: StudyShape::default().composition_spread,
        }
    }

    /// The case of another spread of the composition from event to event.
    pub(crate) fn spread(self, composition_spread: f64) -> Self {
        Self {
            composition_spread,
            ..self
        }
    }

    pub(crate) fn name(&self) -> String {
        let kind = self.hidden.kind();
        let names = self.hidden.names().join("+");
        format!("{} {kind} {names} {}", self.seed, self.number)
    }

    /// Noise, rate and number of events: every combination comes up.
    fn shape(&self) -> StudyShape {
        let of = |values: &[f64], step: u64| {
            let count = values.len() as u64;
            values[usize::try_from(self.number / step % count).unwrap()]
        };
        StudyShape {
            effects: self.hidden.effects(),
            noise: of(&[0.001, 0.000_5, 0.002], 1),
            rate_fps: of(&[60.0, 50.0, 120.0, 30.0], 2),
            events: [10, 12, 8, 6][usize::try_from(self.number % 4).unwrap()],
            composition_spread: self.composition_spread,
            ..StudyShape::default()
        }
    }

    /// The site; none where the truth simulator refuses it.
    fn made(&self) -> Option<SyntheticSite> {
        let shape = self.shape();
        let mut made = match study_site(self.seed, site_number(self.hidden, self.number), &shape) {
            Ok(made) => made,
            Err(error) => {
                println!("{}: not generated: {error}", self.name());
                return None;
            }
        };
        if let Hidden::Novel(load) = self.hidden {
            load.write_into(&mut made, self.number);
        }
        Some(made)
    }

    /// Puts the site's folder and truth into a directory.
    pub(crate) fn write(&self, directory: &Path) {
        let Some(mut made) = self.made() else { return };
        made.options.site.name = self.name().replace([' ', '+', ':'], "-");
        synthetic::write(&made, directory).unwrap();
    }

    /// One line of the study; none where the truth simulator refuses the site.
    pub(crate) fn run(&self) -> Option<Value> {
        let made = self.made()?;
        let windows = windows(&made);
        let mut options = DiagnosisOptions::default();
        if let Hidden::Outside(effect) = self.hidden {
            let names = catalogue().iter().map(|e| e.declaration().name);
            options.excluded = names
                .filter(|name| same(effect.name(), name))
                .map(str::to_owned)
                .collect();
        }
        let improved = |change: &Change| {
            let structure = ["zip".to_owned(), "induction_motor".to_owned()];
            let site = &made.options.site;
            improve(
                site,
                &windows,
                &structure,
                change,
                &options,
                &|_| (),
                &|| false,
            )
            .unwrap()
        };
        let found = improved(&Change::UntilAdequate);
        let resistance = made.options.motor.stator_resistance > 0.0;
        Some(self.line(
            &made,
            &windows,
            &found,
            resistance.then(|| {
                // What is left for the hidden effect to explain, once the resistance is in the model.
                let with = found.steps.iter().find(|step| {
                    step.structure
                        .last()
                        .is_some_and(|last| last == "stator_resistance")
                });
                with.map_or_else(
                    || {
                        let add = vec!["stator_resistance".to_owned()];
                        let by_hand = improved(&Change::ByHand {
                            add,
                            remove: Vec::new(),
                        });
                        by_hand.steps.last().unwrap().errors.fit.error_to_noise
                    },
                    |step| step.errors.fit.error_to_noise,
                )
            }),
        ))
    }

    fn line(
        &self,
        made: &SyntheticSite,
        windows: &[Window],
        found: &Improvement,
        with_resistance: Option<f64>,
    ) -> Value {
        let diagnoses: Vec<_> = found.diagnoses.iter().chain([&found.last]).collect();
        let answers: Vec<_> = diagnoses.iter().map(|d| &d.answer_set).collect();
        let first = diagnoses[0];
        let lowest = windows
            .iter()
            .map(|w| w.record.lowest_voltage_pu())
            .fold(f64::INFINITY, f64::min);
        let parameters: BTreeMap<&str, f64> = made
            .options
            .effects
            .iter()
            .flat_map(|h| h.values().map(|(p, value)| (p.name, value)))
            .collect();
        let candidates: Vec<_> = first
            .candidates
            .iter()
            .take(4)
            .map(|c| {
                json!([
                    c.effect,
                    c.delta_bic,
                    c.held_out_error_before,
                    c.held_out_error_after,
                    c.refused
                ])
            })
            .collect();
        let shape = self.shape();
        json!({
            "case": self.name(), "kind": self.hidden.kind(),
            "truth": self.hidden.names(),
            "number": self.number, "noise": shape.noise, "rate_fps": shape.rate_fps, "events": windows.len(),
            "lowest_voltage": lowest, "with_resistance": with_resistance,
            "status": first.status.name(), "last_status": found.last.status.name(), "answers": answers,
            "added": found.steps.iter().filter_map(|s| s.added.as_deref()).collect::<Vec<_>>(),
            "structure": found.steps.last().unwrap().structure,
            "fitted": found.steps.iter().map(|s| s.errors.fit.error_to_noise).collect::<Vec<_>>(),
            "quoted": found.steps.iter().map(|s| s.errors.quoted().error_to_noise).collect::<Vec<_>>(),
            "noise_floor": first.noise_floor, "candidates": candidates, "reasons": first.reasons,
            "parameters": parameters,
        })
    }
}

fn windows(made: &SyntheticSite) -> Vec<Window> {
    let numbered = made.records.iter().zip(1..);
    numbered
        .map(|(record, number)| Window {
            id: format!("event_{number:02}"),
            ..site_folder::window(&made.options.site, record)
        })
        .filter(|window| screen(window, &ScreeningOptions::default()).usable())
        .collect()
}
