//! Settings of a diagnosis, and its progress.

use crate::identification::{IdentificationOptions, composed::ComposedFitOptions};

/// Settings of a diagnosis.
#[derive(Clone, Debug, PartialEq)]
pub struct DiagnosisOptions {
    /// Preparation, search and validation; its split is not used.
    pub identification: IdentificationOptions,
    /// Events by use; default: chosen by depth.
    pub split: EventSplit,
    /// Fits of structures with effects.
    pub composed: ComposedFitOptions,
    /// How many candidates of the screen are refitted. Default 8; at least 1.
    pub refits_max: usize,
    /// What may be claimed.
    pub claim: ClaimOptions,
    /// Effects that are not tried, by name.
    pub excluded: Vec<String>,
}

/// Which events serve for what.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum EventSplit {
    /// By depth: from eight events on a quarter gates and a fifth is untouched.
    #[default]
    Balanced,
    /// Exactly these; what is not named is fitted.
    Named {
        /// Held out to decide.
        gate: Vec<String>,
        /// Untouched.
        untouched: Vec<String>,
    },
}

/// What may be claimed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClaimOptions {
    /// A claim lowers the Bayesian information criterion by at least this much.
    pub delta_bic_min: f64,
    /// A claim lowers the weighted squares of the held-out events by at least this share.
    pub held_out_fall_min: f64,
    /// A claim lowers those of all fitted events by at least this share ...
    pub fall_min: f64,
    /// ... or this one, where they are at the floor already.
    pub fall_min_at_floor: f64,
    /// An effect stands out where every other one gains at most this share of what it gains ...
    pub distinct_runner_up: f64,
    /// ... and then needs this share only, of the fitted and of the held-out events, at the floor (above it, where
    /// the events are followed, `fall_min` of either).
    pub distinct_fall_min: f64,
    /// Where fitted and held-out events are followed already, an effect that lowers the criterion by this much ...
    pub evident_delta_bic: f64,
    /// ... needs this share only of the held-out ones, which may be mild, ...
    pub evident_held_out_fall_min: f64,
    /// ... and where it lowers the weighted squares of the fitted ones by this share nothing of them: they may not
    /// become worse.
    pub evident_fall: f64,
    /// Where both are followed already, an effect that lowers the criterion by this much ...
    pub confirmed_delta_bic: f64,
    /// ... and the weighted squares of the held-out events by this share needs this share only of either: they confirm
    /// what is small beside the noise that is assumed.
    pub confirmed_fall_min: f64,
    /// Where the held-out events are followed already and the fitted ones are not, an effect may leave at
    /// most this share of what is above the floor.
    pub silent_left_share: f64,
    /// A rival is in the answer set when its criterion is behind the best by at most this share of
    /// the best gain ...
    pub rival_share: f64,
    /// ... and at most this share of the weighted squares that the best leaves ...
    pub rival_share_of_left: f64,
    /// ... with this share of what of it is above the floor: no noise, but what the best does otherwise than the load, ...
    pub rival_share_of_excess: f64,
    /// ... or by at most so much, whatever the two say.
    pub delta_bic_near: f64,
    /// A rival is left out whose held-out events leave more than this many times what those of the best
    /// followed of its rivals leave (or twice the floor, if that is more).
    pub rival_held_out_factor: f64,
    /// Weighted squares per row of a perfect model: what is below twice this is adequate.
    pub floor: f64,
    /// An effect is named where it brings the fit below this many times the floor, ...
    pub reached_floors: f64,
    /// ... where it leaves at most this share of what was above the floor, ...
    pub left_share: f64,
    /// ... below this many times the floor, ...
    pub near_floors: f64,
    /// ... at most this share ...
    pub near_left_share: f64,
    /// ... or at most this share, when ...
    pub decisive_share: f64,
    /// ... every effect outside the answer set leaves at least this many times as much.
    pub decisive_factor: f64,
}

/// Root of the misfit per sample that a perfect model leaves: the floor of an event's failure and of
/// what candidates do to the held-out events. Residuals over noise have another one,
/// [`ERROR_TO_NOISE_FLOOR`](super::diagnose::ERROR_TO_NOISE_FLOOR).
#[must_use]
pub fn misfit_root_floor() -> f64 {
    ClaimOptions::default().floor.sqrt()
}

impl Default for ClaimOptions {
    fn default() -> Self {
        Self {
            delta_bic_min: 30.0,
            held_out_fall_min: 0.10,
            fall_min: 0.05,
            fall_min_at_floor: 0.10,
            distinct_runner_up: 0.6,
            distinct_fall_min: 0.03,
            evident_delta_bic: 500.0,
            evident_held_out_fall_min: 0.01,
            evident_fall: 0.30,
            confirmed_delta_bic: 100.0,
            confirmed_fall_min: 0.03,
            silent_left_share: 0.2,
            rival_share: 0.05,
            rival_share_of_left: 0.03,
            rival_share_of_excess: 0.25,
            delta_bic_near: 10.0,
            rival_held_out_factor: 4.0,
            floor: 0.7,
            reached_floors: 1.3,
            left_share: 0.03,
            near_floors: 3.0,
            near_left_share: 0.2,
            decisive_share: 0.25,
            decisive_factor: 3.0,
        }
    }
}

impl Default for DiagnosisOptions {
    fn default() -> Self {
        let mut identification = IdentificationOptions::default();
        // The plain model only has to be the start of others: one tier is enough.
        identification.search.trust_tech.tiers_max = 1;
        identification.search.trust_tech.evaluations_max = 800;
        Self {
            identification,
            split: EventSplit::default(),
            composed: ComposedFitOptions::default(),
            refits_max: 10,
            claim: ClaimOptions::default(),
            excluded: Vec::new(),
        }
    }
}

/// How far a diagnosis is.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// What is being done, in words.
    pub what: String,
    /// Steps done.
    pub done: usize,
    /// Steps of this round as far as they are known.
    pub of: usize,
}
