//! Settings of the service core.

use crate::{
    diagnosis::DiagnosisOptions,
    disturbance::{DetectorOptions, ScreeningOptions},
    identification::{DecisionOptions, IdentificationOptions},
    measurement::{ConcentratorOptions, Site},
};

const SECOND_NS: i64 = 1_000_000_000;
/// Fits that leave more than this (weighted squares per row: ten times the noise) are not explored: no further
/// solution would describe such an event, and each costs half a minute (decision 0087).
const EXPLORED_BELOW_PER_ROW: f64 = 100.0;

/// Settings of the service core. Durations in nanoseconds, because the core is given nanoseconds.
#[derive(Clone, Debug, PartialEq)]
pub struct ServiceOptions {
    /// Name of this instance, one chunk of a key expression; it holds leases and signs decisions.
    /// Default `loadmodeld`.
    pub instance: String,
    /// Usable events from which on a site is fitted jointly. Default 4, at least 1: with one
    /// event there is nothing to hold out, and the set can only be published as unvalidated.
    pub joint_events_min: usize,
    /// Events that enter a joint fit, newest first. Default 40, 1 to 1000.
    pub joint_events_max: usize,
    /// Quiet time after the last event of a site before it is fitted jointly, so that a burst of
    /// events makes one fit. Default 30 s.
    pub settle_ns: i64,
    /// Fits that run at one time. Default 1, 1 to 64.
    pub workers: usize,
    /// Longest time one fit may take before it is cancelled and counted as failed. Default 900 s.
    pub fit_budget_ns: i64,
    /// Lease of a job; it is extended every third of it. Default 60 s.
    pub lease_ns: i64,
    /// Failures after which a job is parked. Default 3.
    pub failures_max: u32,
    /// Interruptions (its holder disappeared) after which a job is parked. Default 5.
    pub interruptions_max: u32,
    /// Pause before a failed job is tried again. Default 60 s.
    pub retry_ns: i64,
    /// Windows that wait in memory for the store, one per site at least; the oldest is dropped (and counted)
    /// beyond it. Default 256, 1 to 10000.
    pub spool_windows_max: usize,
    /// Silence after which a site's stream is taken to its end: samples that wait for others are
    /// released and an open window is closed. Default 5 s.
    pub silence_ns: i64,
    /// Pause before a failed step of the store is tried again. Default 2 s.
    pub store_retry_ns: i64,
    /// Time between looks at the store for work that was left behind. Default 300 s.
    pub sweep_ns: i64,
    /// Time the service may take to stop. Default 20 s.
    pub shutdown_grace_ns: i64,
    /// Settings of the fit.
    pub identification: IdentificationOptions,
    /// Settings of the decision.
    pub decision: DecisionOptions,
    /// Whether sites are diagnosed in the background. Default yes.
    pub diagnose: bool,
    /// Usable events from which on a site is diagnosed. Default 4, at least 1.
    pub diagnosis_events_min: usize,
    /// Settings of the diagnosis.
    pub diagnosis: DiagnosisOptions,
}

impl Default for ServiceOptions {
    fn default() -> Self {
        Self {
            instance: "loadmodeld".to_owned(),
            joint_events_min: 2,
            joint_events_max: 40,
            settle_ns: 30 * SECOND_NS,
            workers: 1,
            fit_budget_ns: 900 * SECOND_NS,
            lease_ns: 60 * SECOND_NS,
            failures_max: 3,
            interruptions_max: 5,
            retry_ns: 60 * SECOND_NS,
            spool_windows_max: 256,
            silence_ns: 5 * SECOND_NS,
            store_retry_ns: 2 * SECOND_NS,
            sweep_ns: 300 * SECOND_NS,
            shutdown_grace_ns: 20 * SECOND_NS,
            identification: unattended(),
            decision: DecisionOptions::default(),
            diagnose: true,
            diagnosis_events_min: 4,
            diagnosis: DiagnosisOptions::default(),
        }
    }
}

/// Fits that nobody waits for.
fn unattended() -> IdentificationOptions {
    let mut options = IdentificationOptions::default();
    options.search.explored_below_per_row = EXPLORED_BELOW_PER_ROW;
    options
}

/// A site and how its measurements are treated.
#[derive(Clone, Debug)]
pub struct SiteOptions {
    /// The site.
    pub site: Site,
    /// How its streams are put together.
    pub concentrator: ConcentratorOptions,
    /// What is a disturbance.
    pub detector: DetectorOptions,
    /// Which disturbances can be used.
    pub screening: ScreeningOptions,
    /// Parts of the model that is fitted until somebody says otherwise.
    pub structure: Vec<String>,
}
