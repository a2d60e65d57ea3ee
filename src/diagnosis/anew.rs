//! Beginning anew with other sets of events, where what was found says that the first ones do not serve.

use super::{
    case::{Case, Watcher},
    event_sets::Changes,
    options::DiagnosisOptions,
};
use crate::{
    disturbance::Window,
    identification::{IdentificationError, composed::Baseline},
    load_model::Structure,
    measurement::Site,
};

/// Why what is done with a case ends early.
pub(super) enum Stop {
    /// It begins anew with these changes, too.
    Anew(Changes),
    Failed(IdentificationError),
}

impl From<IdentificationError> for Stop {
    fn from(error: IdentificationError) -> Self {
        Self::Failed(error)
    }
}

/// What is asked: a structure on the events of a site.
#[derive(Clone, Copy)]
pub(super) struct Asked<'a> {
    pub(super) site: &'a Site,
    pub(super) windows: &'a [Window],
    pub(super) structure: &'a Structure,
    pub(super) options: &'a DiagnosisOptions,
    pub(super) watcher: Watcher<'a>,
}

/// Does something with the events and the fits of the structure to them, anew as often as their sets are changed.
pub(super) fn with_settled_events<T>(
    asked: &Asked<'_>,
    done_with: impl Fn(&Case<'_>, Baseline) -> Result<T, Stop>,
) -> Result<T, IdentificationError> {
    let Asked {
        site,
        windows,
        structure,
        options,
        watcher,
    } = *asked;
    let mut changes = Changes::default();
    loop {
        let mut case = Case::new(site, windows, structure, options, &changes, watcher)?;
        let base = case.baseline(structure)?;
        case.settle_uses(&base)?;
        match done_with(&case, base) {
            Ok(done) => return Ok(done),
            Err(Stop::Failed(error)) => return Err(error),
            // Ends: every change takes an event out of what may be changed.
            Err(Stop::Anew(more)) => changes.extend(more),
        }
    }
}

impl Case<'_> {
    /// That there is nothing to change.
    pub(super) fn anew_with(&self, changes: Changes) -> Result<(), Stop> {
        let Some(first) = changes.told().next() else {
            return Ok(());
        };
        self.watcher.says(format!("beginning anew: {first}"), 0, 1);
        Err(Stop::Anew(changes))
    }
}
