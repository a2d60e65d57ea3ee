//! One diagnosis, on the thread of its job.

use std::sync::Arc;

use super::{clock, inputs::diagnosis_hash, structures::Wanted};
use crate::{
    adapters::{
        http::{Reporter, Stage},
        store::{Store, StoreError, StoredDiagnosis},
    },
    diagnosis::{self, Diagnosis, DiagnosisOptions},
    disturbance::Window,
    identification::{IdentificationError, errors_of_fitted},
    measurement::Site,
    service::{Diagnosed, FitEnd, ServiceOptions},
};

/// What a diagnosis is made from.
pub(super) struct Inputs<'a> {
    pub(super) site: &'a Site,
    pub(super) windows: &'a [Window],
    pub(super) wanted: &'a Wanted,
    pub(super) options: &'a ServiceOptions,
}

/// Diagnoses, unless the same inputs were diagnosed before.
pub(super) fn diagnose(
    store: &dyn Store,
    inputs: &Inputs<'_>,
    reporter: &Reporter,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<FitEnd, StoreError> {
    let ids: Vec<String> = inputs.windows.iter().map(|w| w.id.clone()).collect();
    let Wanted { structure, turn } = inputs.wanted;
    let hash = |turn| diagnosis_hash(&ids, structure, turn, inputs.options);
    let inputs_hash = hash(*turn);
    let name = &inputs.site.name;
    if let Some(known) = store.diagnosis_of(name, &inputs_hash)? {
        return Ok(FitEnd::DiagnosisKnown {
            version: known.version,
        });
    }
    for before in (0..*turn).rev() {
        if let Some(earlier) = store.diagnosis_of(name, &hash(before))?
            && earlier.document.is_some()
        {
            return again(store, &earlier, &inputs_hash);
        }
    }
    let started = clock::instant();
    let options: &DiagnosisOptions = &inputs.options.diagnosis;
    let made = diagnosis::diagnose(
        inputs.site,
        inputs.windows,
        structure,
        options,
        &|progress| {
            tracing::debug!(site = name, ?progress, "diagnosing");
            reporter.stage(Stage {
                what: progress.what,
                done: progress.done,
                of: progress.of,
            });
        },
        cancel,
    );
    Ok(match made {
        Ok(mut diagnosis) => {
            diagnosis.cost.seconds = started.elapsed().as_secs_f64();
            FitEnd::Diagnosed(Arc::new(Diagnosed {
                error_after: error_after(&diagnosis, inputs),
                diagnosis,
                inputs_hash,
            }))
        }
        Err(IdentificationError::Cancelled) => FitEnd::Cancelled,
        Err(error @ IdentificationError::Structure(_)) => FitEnd::Failed {
            error: error.to_string(),
        },
        Err(error) => FitEnd::NoSet {
            reason: error.to_string(),
        },
    })
}

/// Error over noise of the untouched events with the first effect named: what the diagnosis quotes of
/// the structure judged, on the same events and by the same measure. The candidate's own figures are
/// roots of the misfit.
fn error_after(diagnosis: &Diagnosis, inputs: &Inputs<'_>) -> Option<f64> {
    let named = diagnosis.answer_set.first()?;
    let mut candidates = diagnosis.candidates.iter();
    let fitted = candidates.find(|c| c.effect == *named)?.model.as_ref()?;
    let untouched = &diagnosis.events.untouched;
    let windows: Vec<Window> = (inputs.windows.iter())
        .filter(|window| untouched.contains(&window.id))
        .cloned()
        .collect();
    let options = &inputs.options.diagnosis.identification;
    let errors = errors_of_fitted(fitted, &windows, options).ok()?;
    Some(errors.error_to_noise)
}

/// A diagnosis on record, of a structure that the site has come back to: it becomes the newest one.
fn again(
    store: &dyn Store,
    earlier: &StoredDiagnosis,
    inputs_hash: &str,
) -> Result<FitEnd, StoreError> {
    let site = &earlier.site;
    let newest = store.newest_diagnosis(site)?;
    if newest.is_some_and(|newest| newest.version == earlier.version) {
        let version = earlier.version;
        return Ok(FitEnd::DiagnosisKnown { version });
    }
    let now_ns = clock::now_ns();
    let (version, _) = store.repeat_diagnosis(site, earlier.version, inputs_hash, now_ns)?;
    Ok(FitEnd::DiagnosedBefore {
        earlier: earlier.version,
        version,
    })
}
