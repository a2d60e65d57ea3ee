//! Every effect of the catalogue tried on top of a fitted structure: screened by its linear score,
//! the best refitted, and those that may be claimed held against the gate.

use super::{
    case::Case,
    claim::{Evidence, GateEvidence},
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
/// Trials that are held against the gate at most.
const GATED_MAX: usize = 5;

/// One effect on top of a structure.
pub(super) struct Trial {
    pub(super) declaration: &'static Declaration,
    /// Its best score.
    pub(super) score: Score,
    /// Share of the baseline's weighted squares that the score would remove.
    pub(super) score_share: f64,
    /// The refit on all judged events and, where there is one, on the mild ones.
    pub(super) refit: Option<Baseline>,
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

    pub(super) fn fit(&self) -> Option<&ComposedFit> {
        self.refit.as_ref().map(|r| &r.all)
    }
}

/// Misfit of a fitted structure on the gate, the gate's events not having been fitted.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GateMisfit {
    pub(super) squares: Vec<f64>,
    pub(super) rows: usize,
}

/// A structure as rounds see it: fitted to all judged events, and its misfit on the gate.
pub(super) struct Fitted {
    pub(super) baseline: Baseline,
    pub(super) gate: Option<GateMisfit>,
}

impl Fitted {
    pub(super) fn new(case: &Case<'_>, baseline: Baseline) -> Self {
        let gate = gate_misfit(case, &baseline.all);
        Self { baseline, gate }
    }

    pub(super) fn chi_square(&self) -> f64 {
        self.baseline.all.chi_square_per_row()
    }
}

pub(super) fn gate_misfit(case: &Case<'_>, fit: &ComposedFit) -> Option<GateMisfit> {
    let training = case.without_gate(fit)?;
    let (squares, rows) = case.gate_squares(&training)?;
    Some(GateMisfit { squares, rows })
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
    for trial in list.iter_mut().take(GATED_MAX) {
        case.watcher.check()?;
        hold_against_gate(case, base, trial);
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
            refit: None,
            evidence: None,
        });
    }
    list.sort_by(|a, b| b.score.gain.total_cmp(&a.score.gain));
    Ok(list)
}

fn refit(case: &Case<'_>, base: &Fitted, trial: &mut Trial) -> Result<(), IdentificationError> {
    let baseline = &base.baseline;
    let added = baseline.with(
        &case.judged,
        trial.name(),
        &case.options.composed,
        case.watcher.cancel,
    )?;
    case.watcher.check()?;
    let Some(added) = added else { return Ok(()) };
    let before = &baseline.all;
    let (value, meaningful) = amplitude(trial.declaration, &added.all);
    trial.evidence = Some(Evidence {
        physics: trial.declaration.kind == Kind::Physics,
        delta_bic: added.all.criterion() - before.criterion(),
        chi_square_before: before.chi_square_per_row(),
        chi_square_after: added.all.chi_square_per_row(),
        amplitude_over_meaningful: value / meaningful,
        at_bound: composed_parameters(&added.all, trial.name())
            .iter()
            .any(|p| p.at_bound && at_wrong_end(trial.declaration, p)),
        squares_after: added.all.squares.iter().sum(),
        gate: None,
    });
    trial.refit = Some(added);
    Ok(())
}

fn hold_against_gate(case: &Case<'_>, base: &Fitted, trial: &mut Trial) {
    let (Some(before), Some(fit)) = (&base.gate, trial.fit()) else {
        return;
    };
    let after = gate_misfit(case, fit);
    if let Some(evidence) = &mut trial.evidence {
        evidence.gate = Some(GateEvidence {
            before: per_row(before),
            after: after.as_ref().map_or(f64::INFINITY, per_row),
        });
    }
}

fn per_row(misfit: &GateMisfit) -> f64 {
    misfit.squares.iter().sum::<f64>() / misfit.rows.max(1) as f64
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
