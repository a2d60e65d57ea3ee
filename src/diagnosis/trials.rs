//! Every effect of the catalogue tried on top of a fitted structure: screened by its linear score,
//! the best refitted, and those that may be claimed held against the gate.

use super::{
    case::Case,
    claim::{Evidence, GateEvidence, objections},
    options::DiagnosisOptions,
};
use crate::{
    identification::{
        IdentificationError, ParameterEstimate,
        composed::{self, Baseline, ComposedFit, Score},
        composed_parameters,
    },
    load_model::{
        Structure,
        effect::{Declaration, Kind, Role},
        effects,
    },
};

/// A score below this many times the logarithm of the number of rows cannot win by any criterion.
const HOPELESS_GAIN: f64 = 1.0;
/// So many of the best trials are held against the gate, whatever else speaks against them.
const GATED_MIN: usize = 3;

/// One effect on top of a structure.
pub(super) struct Trial {
    pub(super) declaration: &'static Declaration,
    /// Its best score.
    pub(super) score: Score,
    /// Share of the baseline's weighted squares that the score would remove.
    pub(super) score_share: f64,
    /// The refit on all judged events.
    pub(super) fit: Option<ComposedFit>,
    /// Figures for the decision; none without a refit.
    pub(super) evidence: Option<Evidence>,
}

impl Trial {
    pub(super) fn name(&self) -> &'static str {
        self.declaration.name
    }

    pub(super) fn delta_bic(&self) -> f64 {
        self.evidence
            .as_ref()
            .map_or(f64::INFINITY, |e| e.delta_bic)
    }
}

/// A structure as rounds see it: fitted to all judged events, and its misfit on the gate.
pub(super) struct Fitted {
    pub(super) baseline: Baseline,
    pub(super) gate: Option<f64>,
}

impl Fitted {
    pub(super) fn new(case: &Case<'_>, baseline: Baseline) -> Self {
        let gate = case.gate_misfit(&baseline.all);
        Self { baseline, gate }
    }

    pub(super) fn chi_square(&self) -> f64 {
        self.baseline.all.chi_square_per_row()
    }
}

/// Tries every effect that may be added, best first: refitted ones by the criterion, then the others
/// by their score.
pub(super) fn trials(
    case: &Case<'_>,
    base: &Fitted,
    names: &[&'static str],
) -> Result<Vec<Trial>, IdentificationError> {
    let mut list = screened(case, base, names)?;
    let rows = base.baseline.all.rows as f64;
    let worth = |t: &Trial| t.score.gain > HOPELESS_GAIN * rows.ln();
    let refits = list
        .iter()
        .filter(|t| worth(t))
        .count()
        .min(case.options.refits_max);
    for (done, trial) in list
        .iter_mut()
        .filter(|t| worth(t))
        .take(refits)
        .enumerate()
    {
        case.watcher
            .says(format!("trying {}", trial.name()), done, refits);
        refit(case, base, trial)?;
    }
    list.sort_by(|a, b| {
        let by_criterion = a.delta_bic().total_cmp(&b.delta_bic());
        by_criterion.then_with(|| b.score.gain.total_cmp(&a.score.gain))
    });
    for (place, trial) in list.iter_mut().enumerate() {
        case.watcher.check()?;
        let claimable = |e: &Evidence| objections(e, &case.options.claim).is_empty();
        // Whatever might be claimed is held against the gate; of the others the best are, for the table.
        if place < GATED_MIN || trial.evidence.as_ref().is_some_and(claimable) {
            hold_against_gate(case, base, trial);
        }
    }
    Ok(list)
}

/// Effects that may be added to a structure.
pub(super) fn addable(structure: &Structure, options: &DiagnosisOptions) -> Vec<&'static str> {
    let all = effects::catalogue().iter().map(|e| e.declaration().name);
    let may = |name: &&'static str| {
        !options.excluded.iter().any(|x| x == name) && structure.with(name).is_ok()
    };
    all.filter(may).collect()
}

fn screened(
    case: &Case<'_>,
    base: &Fitted,
    names: &[&'static str],
) -> Result<Vec<Trial>, IdentificationError> {
    let baseline = &base.baseline;
    let squares: f64 = baseline.all.squares.iter().sum();
    let mut list = Vec::with_capacity(names.len());
    for (done, name) in names.iter().enumerate() {
        case.watcher.check()?;
        case.watcher
            .says(format!("looking for {name}"), done, names.len());
        let origins = baseline.origins();
        let scores = composed::screen(
            &case.judged,
            &baseline.structure,
            &origins,
            name,
            &case.options.composed,
            case.watcher.cancel,
        )?;
        let (Some(effect), Some(score)) = (effects::find(name), scores.into_iter().next()) else {
            continue;
        };
        list.push(Trial {
            declaration: effect.declaration(),
            score_share: (score.gain / squares.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0),
            score,
            fit: None,
            evidence: None,
        });
    }
    list.sort_by(|a, b| b.score.gain.total_cmp(&a.score.gain));
    Ok(list)
}

fn refit(case: &Case<'_>, base: &Fitted, trial: &mut Trial) -> Result<(), IdentificationError> {
    let baseline = &base.baseline;
    let added = baseline.extended(
        &case.judged,
        trial.name(),
        &case.options.composed,
        case.watcher.cancel,
    )?;
    case.watcher.check()?;
    let Some(added) = added else { return Ok(()) };
    let before = &baseline.all;
    let (value, meaningful) = amplitude(trial.declaration, &added);
    trial.evidence = Some(Evidence {
        physics: trial.declaration.kind == Kind::Physics,
        delta_bic: added.criterion() - before.criterion(),
        chi_square_before: before.chi_square_per_row(),
        chi_square_after: added.chi_square_per_row(),
        amplitude_over_meaningful: value / meaningful,
        at_bound: composed_parameters(&added, trial.name())
            .iter()
            .any(|p| p.at_bound && at_wrong_end(trial.declaration, p)),
        squares_after: added.squares.iter().sum(),
        gate: None,
    });
    trial.fit = Some(added);
    Ok(())
}

fn hold_against_gate(case: &Case<'_>, base: &Fitted, trial: &mut Trial) {
    let after = trial.fit.as_ref().and_then(|fit| case.gate_misfit(fit));
    if let (Some(before), Some(after), Some(evidence)) = (base.gate, after, &mut trial.evidence) {
        evidence.gate = Some(GateEvidence { before, after });
    }
}

/// Whether a parameter lies on a bound that says the effect has to be stretched to describe the data:
/// not an amplitude that is absent, and not a shape whose bound is a case of its own.
fn at_wrong_end(declaration: &Declaration, estimate: &ParameterEstimate) -> bool {
    let declared = declaration
        .parameters
        .iter()
        .find(|p| estimate.name.rsplit('.').next() == Some(p.name));
    declared.is_some_and(|p| {
        p.is_amplitude() && (estimate.value - p.neutral).abs() > 0.5 * (p.upper - p.neutral)
    })
}

/// The amplitude that is largest against the smallest meaningful one, and that one.
pub(super) fn amplitude(declaration: &Declaration, fit: &ComposedFit) -> (f64, f64) {
    let sizes = declaration.parameters.iter().filter_map(|p| {
        let (Role::OneSidedAmplitude { meaningful } | Role::TwoSidedAmplitude { meaningful }) =
            p.role
        else {
            return None;
        };
        let index = fit
            .model
            .index(&format!("{}.{}", declaration.name, p.name))?;
        Some(((fit.parameters[index] - p.neutral).abs(), meaningful))
    });
    sizes
        .max_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)))
        .unwrap_or((0.0, 1.0))
}
