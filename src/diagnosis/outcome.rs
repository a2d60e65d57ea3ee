//! What a diagnosis says, and what rounds of it have done.

use crate::{
    identification::{ErrorSummary, FittedStructure, ParameterEstimate, ParameterSet},
    load_model::effect::Kind,
};

use super::{
    separating::SeparatingEvent,
    where_it_fails::{EventFailure, SegmentResidual},
};

/// The answer of a diagnosis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The structure follows the events down to the noise: nothing is missing.
    Adequate,
    /// An effect of the catalogue is missing; the candidates say which.
    MissingEffect,
    /// The instrument, not the load, explains what is left.
    InstrumentSuspect,
    /// Something is missing that no effect of the catalogue describes.
    UnknownEffect,
    /// The events do not allow a judgement; the reasons say why.
    CannotJudge,
}

impl Status {
    /// As JSON writes it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Adequate => "adequate",
            Self::MissingEffect => "missing_effect",
            Self::InstrumentSuspect => "instrument_suspect",
            Self::UnknownEffect => "unknown_effect",
            Self::CannotJudge => "cannot_judge",
        }
    }
}

/// Which events served for what; each list in the order of the data.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EventSets {
    /// Fitted.
    pub fit: Vec<String>,
    /// Held out to decide whether an effect may be declared.
    pub gate: Vec<String>,
    /// In neither: the error quoted comes from these. Empty when there are too few events.
    pub untouched: Vec<String>,
    /// Refused, with the reason.
    pub refused: Vec<(String, String)>,
}

/// Errors of one fitted structure on the three sets of events.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StructureErrors {
    /// On the fitted events.
    pub fit: ErrorSummary,
    /// On the events of the gate.
    pub gate: Option<ErrorSummary>,
    /// On the untouched events.
    pub untouched: Option<ErrorSummary>,
}

impl StructureErrors {
    /// The errors to quote: untouched, else gate, else fit.
    #[must_use]
    pub fn quoted(&self) -> &ErrorSummary {
        let held_out = self.untouched.as_ref().or(self.gate.as_ref());
        held_out.unwrap_or(&self.fit)
    }

    /// Name of the set that [`Self::quoted`] comes from.
    #[must_use]
    pub const fn quoted_set(&self) -> &'static str {
        match (&self.untouched, &self.gate) {
            (Some(_), _) => "untouched",
            (None, Some(_)) => "gate",
            (None, None) => "fitted",
        }
    }

    /// Error over noise on the fitted and gating events together, each set counting by its events.
    pub(super) fn judged_error_to_noise(&self) -> f64 {
        let sets = || std::iter::once(&self.fit).chain(&self.gate);
        let events: usize = sets().map(|set| set.events.len()).sum();
        let square = |set: &ErrorSummary| set.events.len() as f64 * set.error_to_noise.powi(2);
        (sets().map(square).sum::<f64>() / events.max(1) as f64).sqrt()
    }
}

/// An effect that was tried on top of the structure.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Its name in the catalogue.
    pub effect: String,
    /// The load or the instrument.
    pub kind: Kind,
    /// Share of the residual (weighted squares above the noise) that the linear screen explains,
    /// 0 to 1.
    pub score_share: f64,
    /// Share of the effect that the structure cannot mimic by its own parameters, 0 to 1.
    pub visibility: f64,
    /// Change of the Bayesian information criterion over all events by adding it; negative is
    /// better. None where the screen left it out of the refits.
    pub delta_bic: Option<f64>,
    /// Error over noise on the gate's events without it.
    pub held_out_error_before: Option<f64>,
    /// The same with it.
    pub held_out_error_after: Option<f64>,
    /// Share of the best candidate's gain that this one recovers when refitted, 0 to 1.
    pub share_of_best_gain: Option<f64>,
    /// Effects, this one included, that these events do not separate from it.
    pub group: Vec<String>,
    /// What would separate it from the first of the group, the first from the others; empty when it is alone.
    pub would_separate: String,
    /// The ordinary disturbances that would, one for each other effect that one was found for.
    pub separating_events: Vec<SeparatingEvent>,
    /// Its parameters after the refit.
    pub parameters: Vec<ParameterEstimate>,
    /// The refit as a whole, to be simulated again; none without one.
    pub model: Option<FittedStructure>,
    /// Whether it passed every test of a declaration.
    pub declared: bool,
    /// Why it is not declared, with the figure; empty when it is.
    pub refused: Vec<String>,
}

/// What an effect that the structure judged has already is worth to the events.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectWorth {
    /// Its name.
    pub effect: String,
    /// Change of the Bayesian information criterion over all judged events by taking it out; positive
    /// is worse.
    pub delta_bic_without: f64,
    /// Error over noise on the untouched events without it; none where there are none, or no response
    /// in one.
    pub untouched_without: Option<f64>,
    /// Whether the events are described as well without it.
    pub is_superfluous: bool,
}

/// An effect on which these events are silent.
#[derive(Clone, Debug, PartialEq)]
pub struct Untestable {
    /// Its name in the catalogue.
    pub effect: String,
    /// Smallest amplitude that would have shown, in the unit of its first amplitude; infinite where
    /// none within its bounds would have.
    pub smallest_detectable_amplitude: f64,
    /// Smallest amplitude worth reporting.
    pub meaningful_amplitude: f64,
    /// Name and unit of the amplitude.
    pub amplitude: String,
    /// The unit.
    pub unit: String,
    /// What events would test it.
    pub needs: String,
}

/// One term of a description of what nothing in the catalogue explains.
#[derive(Clone, Debug, PartialEq)]
pub struct UnexplainedTerm {
    /// The term as a formula, in the variables of effects written in files.
    pub formula: String,
    /// `"P"` or `"Q"`.
    pub channel: &'static str,
    /// Its coefficient, pu of P0.
    pub coefficient: f64,
    /// Share of the residual's squares that it explains on top of the terms before it.
    pub share: f64,
}

/// A general form that explains what no effect of the catalogue does: a kind of dynamics, not a device.
#[derive(Clone, Debug, PartialEq)]
pub struct GeneralForm {
    /// Its name, with which it can be added to a structure.
    pub name: String,
    /// What it does, in words.
    pub title: String,
    /// Weighted squares per sample of all fitted and gating events without it.
    pub misfit_before: f64,
    /// The same with it.
    pub misfit_after: f64,
    /// Change of the Bayesian information criterion by it.
    pub delta_bic: f64,
    /// Error over noise on the gate's events without it; none without a gate.
    pub held_out_error_before: Option<f64>,
    /// The same with it.
    pub held_out_error_after: Option<f64>,
    /// Its parameters after the fit.
    pub parameters: Vec<ParameterEstimate>,
    /// The fit as a whole, to be simulated again.
    pub model: FittedStructure,
    /// It as an effect file with the fitted values.
    pub effect_file: String,
}

/// What is missing but not in the catalogue.
#[derive(Clone, Debug, PartialEq)]
pub struct Unexplained {
    /// What the residual looks like, in a sentence.
    pub signature: String,
    /// A sparse description, most important term first.
    pub terms: Vec<UnexplainedTerm>,
    /// A ready file for `--effect-file` that adds these terms; none where no term explains much.
    pub effect_file: Option<String>,
    /// The general form that explains most; none where none explains more than the effects of the catalogue.
    pub general_form: Option<GeneralForm>,
}

/// What a diagnosis cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DiagnosisCost {
    /// Joint simulations of all events.
    pub simulations: u64,
    /// Effects refitted.
    pub refits: u64,
    /// Wall-clock time; 0 until the caller fills it in.
    pub seconds: f64,
}

/// A diagnosis.
#[derive(Clone, Debug, PartialEq)]
pub struct Diagnosis {
    /// Site.
    pub site: String,
    /// The structure judged.
    pub structure: Vec<String>,
    /// The answer.
    pub status: Status,
    /// The answer in one sentence.
    pub summary: String,
    /// Each reason with its figure.
    pub reasons: Vec<String>,
    /// Events by use.
    pub events: EventSets,
    /// Errors of the structure judged.
    pub baseline: StructureErrors,
    /// Error over noise that a perfect model would have.
    pub noise_floor: f64,
    /// Residuals by segment and channel, all events together.
    pub segments: Vec<SegmentResidual>,
    /// Where it fails, event by event.
    pub failures: Vec<EventFailure>,
    /// What the effects that the structure has already are worth, in their order; of an improvement
    /// those that it was begun with or that were added by hand.
    pub effects: Vec<EffectWorth>,
    /// Candidates, best first.
    pub candidates: Vec<Candidate>,
    /// The declared effect and those not separable from it, best first; empty when none is.
    pub answer_set: Vec<String>,
    /// Effects on which these events are silent.
    pub untestable: Vec<Untestable>,
    /// What no effect of the catalogue explains.
    pub unexplained: Option<Unexplained>,
    /// The fit of the structure judged, to be simulated again; none where nothing could be judged.
    pub model: Option<FittedStructure>,
    /// Cost.
    pub cost: DiagnosisCost,
}

/// One step of the staircase.
#[derive(Clone, Debug, PartialEq)]
pub struct ImprovementStep {
    /// Structure fitted in this step.
    pub structure: Vec<String>,
    /// The effect that this step added; none for the first step and for one that only dropped.
    pub added: Option<String>,
    /// Effects that this step dropped: superfluous, or the added one took their place.
    pub dropped: Vec<String>,
    /// Why.
    pub reason: String,
    /// Errors.
    pub errors: StructureErrors,
    /// Where the structure fails, event by event; fitted to all events but the untouched.
    pub failures: Vec<EventFailure>,
    /// Number of free parameters.
    pub parameter_count: usize,
    /// Bayesian information criterion over all events relative to the first step.
    pub delta_bic: f64,
    /// The set of this step, validated, with version 0.
    pub set: ParameterSet,
}

/// Rounds of diagnosis and addition.
#[derive(Clone, Debug, PartialEq)]
pub struct Improvement {
    /// Site.
    pub site: String,
    /// The staircase, the structure at the start first.
    pub steps: Vec<ImprovementStep>,
    /// The diagnosis of the last structure.
    pub last: Diagnosis,
    /// Diagnoses of structures before the last, in their order; a step that exchanged one effect for another
    /// has none.
    pub diagnoses: Vec<Diagnosis>,
}
