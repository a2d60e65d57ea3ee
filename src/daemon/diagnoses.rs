//! One diagnosis, on the thread of its job.

use std::sync::Arc;

use super::{clock, inputs::diagnosis_hash};
use crate::{
    adapters::{
        http::{Reporter, Stage},
        store::{Store, StoreError},
    },
    diagnosis::{self, DiagnosisOptions},
    disturbance::Window,
    identification::IdentificationError,
    measurement::Site,
    service::{Diagnosed, FitEnd, ServiceOptions},
};

/// What a diagnosis is made from.
pub(super) struct Inputs<'a> {
    pub(super) site: &'a Site,
    pub(super) windows: &'a [Window],
    pub(super) structure: &'a [String],
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
    let inputs_hash = diagnosis_hash(&ids, inputs.structure, inputs.options);
    let name = &inputs.site.name;
    if let Some(known) = store.diagnosis_of(name, &inputs_hash)? {
        return Ok(FitEnd::DiagnosisKnown {
            version: known.version,
        });
    }
    let started = clock::instant();
    let options: &DiagnosisOptions = &inputs.options.diagnosis;
    let made = diagnosis::diagnose(
        inputs.site,
        inputs.windows,
        inputs.structure,
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
