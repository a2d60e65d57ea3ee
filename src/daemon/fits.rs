//! Fits and diagnoses on threads of their own, each with a flag that cancels it. What a panic would take down is
//! caught and reported: a defect in one fit must not end the service.

use std::{
    collections::HashMap,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
};

use tokio::sync::mpsc::UnboundedSender;

use super::{
    clock,
    convert::job_kind,
    diagnoses::{self, Inputs},
    inputs::inputs_hash,
    settings::Settings,
    structures::{self, Wanted},
};
use crate::{
    adapters::{
        http::{Ongoing, WorkBoard},
        store::{FitId, Store, StoreError, StoredFit},
    },
    disturbance::Window,
    identification::{
        Identification, IdentificationError, InForce, ParameterSet, errors_on, identify,
    },
    measurement::Site,
    service::{Candidate, Claimed, Event, FitEnd, Fitted, ServiceOptions, Work, WorkKind},
};

/// Runs fits. The core bounds how many there are.
#[derive(Debug)]
pub(super) struct Fits {
    store: Arc<dyn Store>,
    settings: Arc<Settings>,
    board: Arc<WorkBoard>,
    events: UnboundedSender<Event>,
    cancel_flags: HashMap<i64, Arc<AtomicBool>>,
}

impl Fits {
    pub(super) fn new(
        store: Arc<dyn Store>,
        settings: Arc<Settings>,
        board: Arc<WorkBoard>,
        events: UnboundedSender<Event>,
    ) -> Self {
        Self {
            store,
            settings,
            board,
            events,
            cancel_flags: HashMap::new(),
        }
    }

    /// Runs a fit; its end comes as an event.
    pub(super) fn run(&mut self, claimed: Claimed) {
        let job = claimed.job();
        let cancel = Arc::new(AtomicBool::new(false));
        // A flag that only the map holds belongs to a fit that has ended.
        self.cancel_flags
            .retain(|_, flag| Arc::strong_count(flag) > 1);
        self.cancel_flags.insert(job, Arc::clone(&cancel));
        let fit = Fit {
            store: Arc::clone(&self.store),
            settings: Arc::clone(&self.settings),
            board: Arc::clone(&self.board),
            job,
            work: claimed.work,
            cancel,
        };
        let events = self.events.clone();
        let thread = thread::Builder::new()
            .name(format!("fit-{job}"))
            .spawn(move || {
                let end = fit.run_caught();
                events.send(Event::FitEnded { job, end }).ok();
            });
        if let Err(error) = thread {
            let end = FitEnd::Failed {
                error: format!("no thread for the fit: {error}"),
            };
            self.events.send(Event::FitEnded { job, end }).ok();
        }
    }

    /// Asks a fit to stop.
    pub(super) fn cancel(&self, job: i64) {
        if let Some(flag) = self.cancel_flags.get(&job) {
            flag.store(true, Ordering::Relaxed);
        }
    }
}

struct Fit {
    store: Arc<dyn Store>,
    settings: Arc<Settings>,
    board: Arc<WorkBoard>,
    job: i64,
    work: Work,
    cancel: Arc<AtomicBool>,
}

impl Fit {
    fn run_caught(&self) -> FitEnd {
        match catch_unwind(AssertUnwindSafe(|| self.run())) {
            Ok(Ok(end)) => end,
            Ok(Err(error)) => FitEnd::Failed {
                error: error.to_string(),
            },
            Err(panic) => FitEnd::Panicked {
                message: words_of(panic.as_ref()),
            },
        }
    }

    fn run(&self) -> Result<FitEnd, StoreError> {
        let windows = self.windows()?;
        let Some(site) = self.site()? else {
            return Ok(no_set(format!(
                "the site `{}` is not known any more",
                self.work.site
            )));
        };
        if windows.is_empty() {
            return Ok(no_set("no waveforms are kept any more".to_owned()));
        }
        let options = &self.settings.options_of(&site.name);
        let wanted = structures::in_force(self.store.as_ref(), &self.settings, &site.name)?;
        let structure = &wanted.structure;
        let reporter = self.board.begin(self.job, self.begun(structure));
        // It is asked between simulations.
        let cancel = || {
            reporter.simulated();
            self.cancel.load(Ordering::Relaxed)
        };
        if self.work.kind == WorkKind::Diagnosis {
            let inputs = Inputs {
                site: &site,
                windows: &windows,
                wanted: &wanted,
                options,
            };
            return diagnoses::diagnose(self.store.as_ref(), &inputs, &reporter, &cancel);
        }
        let ids: Vec<String> = windows.iter().map(|w| w.id.clone()).collect();
        if let Some(known) = self.known(&ids, &wanted, options, &windows)? {
            return Ok(known);
        }
        let inputs_hash = inputs_hash(&ids, structure, self.turn(&wanted), options);
        let started = clock::instant();
        let fitted = identify(&site, &windows, structure, &options.identification, &cancel);
        Ok(match fitted {
            Ok(mut identification) => {
                identification.cost.seconds = started.elapsed().as_secs_f64();
                self.fitted(identification, inputs_hash, &windows)?
            }
            Err(IdentificationError::Cancelled) => FitEnd::Cancelled,
            Err(error @ IdentificationError::Structure(_)) => FitEnd::Failed {
                error: error.to_string(),
            },
            Err(error) => no_set(error.to_string()),
        })
    }

    fn begun(&self, structure: &[String]) -> Ongoing {
        Ongoing {
            kind: job_kind(self.work.kind),
            site: self.work.site.clone(),
            subject: self.work.subject.clone(),
            structure: structure.to_vec(),
            since_ns: clock::now_ns(),
            simulations: 0,
            stage: None,
        }
    }

    fn fitted(
        &self,
        identification: Identification,
        inputs_hash: String,
        windows: &[Window],
    ) -> Result<FitEnd, StoreError> {
        let in_force = self.in_force(&identification.set, windows)?;
        Ok(FitEnd::Fitted(Arc::new(Fitted {
            identification,
            inputs_hash,
            in_force,
        })))
    }

    fn windows(&self) -> Result<Vec<Window>, StoreError> {
        match self.work.kind {
            WorkKind::Event => Ok(self.store.window(&self.work.subject)?.into_iter().collect()),
            WorkKind::Site | WorkKind::Diagnosis => self
                .store
                .usable_windows(&self.work.site, self.settings.service.joint_events_max),
        }
    }

    fn site(&self) -> Result<Option<Site>, StoreError> {
        let mut sites = self.store.sites()?.into_iter();
        Ok(sites.find(|site| site.name == self.work.site))
    }

    /// The fit of the same inputs, if one is on record: whoever made it died before the decision,
    /// or the site comes back to a structure that these events were fitted with before. Then the
    /// fit is kept once more, to be decided on again.
    fn known(
        &self,
        windows: &[String],
        wanted: &Wanted,
        options: &ServiceOptions,
        data: &[Window],
    ) -> Result<Option<FitEnd>, StoreError> {
        let kind = job_kind(self.work.kind);
        let turn = self.turn(wanted);
        let hash = |turn| inputs_hash(windows, &wanted.structure, turn, options);
        let on_record = |turn| -> Result<Option<(FitId, ParameterSet)>, StoreError> {
            let stored = self.store.fit_of(kind, &self.work.subject, &hash(turn))?;
            Ok(stored.and_then(|stored| Some((stored.id, readable_set(&stored)?))))
        };
        let mut earlier = None;
        for before in (0..turn).rev() {
            earlier = on_record(before)?;
            if earlier.is_some() {
                break;
            }
        }
        let again = earlier.is_some();
        let (fit, set) = match (on_record(turn)?, earlier) {
            (Some(known), _) => known,
            (None, Some((fit, set))) => {
                let now_ns = clock::now_ns();
                let (copy, _) = self.store.repeat_fit(fit, &hash(turn), now_ns)?;
                (copy, set)
            }
            (None, None) => return Ok(None),
        };
        let in_force = self.in_force(&set, data)?;
        Ok(Some(FitEnd::Known {
            fit: fit.0,
            candidate: Arc::new(Candidate { set, in_force }),
            again,
        }))
    }

    /// Which time it is that the structure is taken up. The fit of one event is not decided on: one
    /// is enough.
    fn turn(&self, wanted: &Wanted) -> usize {
        match self.work.kind {
            WorkKind::Event => 0,
            WorkKind::Site | WorkKind::Diagnosis => wanted.turn,
        }
    }

    /// The newest set of the site and its errors on the events that the candidate was not fitted
    /// on: the two are compared on the same ground.
    fn in_force(
        &self,
        candidate: &ParameterSet,
        windows: &[Window],
    ) -> Result<Option<InForce>, StoreError> {
        if self.work.kind == WorkKind::Event {
            return Ok(None);
        }
        let Some(stored) = self.store.newest_set(&self.work.site)? else {
            return Ok(None);
        };
        let set = match stored.set() {
            Ok(set) => set,
            Err(error) => {
                tracing::warn!(site = stored.site, version = stored.version, %error,
                    "the set in force cannot be read and does not count");
                return Ok(None);
            }
        };
        let held_out: Vec<Window> = windows
            .iter()
            .filter(|w| candidate.held_out_events.contains(&w.id))
            .cloned()
            .collect();
        let options = &self.settings.service.identification;
        let on_candidates_held_out = if held_out.is_empty() {
            None
        } else {
            errors_on(&set, &held_out, options).ok()
        };
        Ok(Some(InForce {
            set,
            on_candidates_held_out,
        }))
    }
}

fn readable_set(stored: &StoredFit) -> Option<ParameterSet> {
    match stored.set() {
        Ok(set) => set,
        Err(error) => {
            tracing::warn!(fit = stored.id.0, %error, "a fit on record cannot be read");
            None
        }
    }
}

const fn no_set(reason: String) -> FitEnd {
    FitEnd::NoSet { reason }
}

fn words_of(panic: &(dyn std::any::Any + Send)) -> String {
    panic
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned())
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned())
}
