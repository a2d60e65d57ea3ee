//! Every metric by name. `docs/metrics.md` shows the same list and a test holds the two equal.

/// What a metric is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Only grows.
    Counter,
    /// Moves both ways.
    Gauge,
    /// Counts values by size, in these upper bounds, thousandths of the metric's unit.
    Histogram(&'static [u32]),
}

impl Kind {
    /// Name in the documentation.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Counter => "counter",
            Self::Gauge => "gauge",
            Self::Histogram(_) => "histogram",
        }
    }
}

/// A metric as it is declared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Declaration {
    /// Name, with prefix, unit and, for a counter, `_total`.
    pub name: &'static str,
    /// What it is.
    pub kind: Kind,
    /// Labels, in order. `site` and `stream` hold configured names only; all others hold closed lists.
    pub labels: &'static [&'static str],
    /// What it counts, in one sentence.
    pub help: &'static str,
}

const fn counter(
    name: &'static str,
    labels: &'static [&'static str],
    help: &'static str,
) -> Declaration {
    Declaration {
        name,
        kind: Kind::Counter,
        labels,
        help,
    }
}

const fn gauge(
    name: &'static str,
    labels: &'static [&'static str],
    help: &'static str,
) -> Declaration {
    Declaration {
        name,
        kind: Kind::Gauge,
        labels,
        help,
    }
}

/// Upper bounds of the time from arrival to detector, milliseconds; what is wanted is 50 in 99 of 100 cases.
const INTAKE_BOUNDS_MS: &[u32] = &[1, 2, 5, 10, 20, 30, 50, 100, 200, 500, 1_000, 5_000, 20_000];
/// Upper bounds of the durations of fits, milliseconds: from a static fit to the default budget.
const FIT_BOUNDS_MS: &[u32] = &[
    1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000,
];

/// Batches taken in, by site.
pub const BATCHES: Declaration = counter(
    "loadmodeld_batches_total",
    &["site"],
    "Sample batches taken in.",
);
/// Samples by what became of them.
pub const SAMPLES: Declaration = counter(
    "loadmodeld_samples_total",
    &["site", "outcome"],
    "Samples by what became of them: accepted, late, duplicate, out_of_order, unusable, missing, skipped, refused; and by what their source says of them: invalid, stale, not_finite, unsynchronised.",
);
/// Batches lost on the way.
pub const BATCHES_LOST: Declaration = counter(
    "loadmodeld_batches_lost_total",
    &["site"],
    "Batches that had not arrived when a later one did, seen from gaps in the streams' own running numbers.",
);
/// Batches that were counted as lost and came.
pub const BATCHES_FOUND: Declaration = counter(
    "loadmodeld_batches_found_total",
    &["site"],
    "Batches counted as lost that arrived after all, out of order or late.",
);
/// Steps of a stream's time.
pub const TIME_STEPS: Declaration = counter(
    "loadmodeld_time_steps_total",
    &["site", "kind"],
    "Times a site's time grid began anew: forward, backward (a step in time), jump (forward by an hour or more, a hundred times as far as the clock of arrivals: another recording or a clock set anew), rate (another reporting rate), grid (stamps drifted off the grid), restart (data go on where an earlier run of the service ended, with a gap).",
);
/// Silences.
pub const SILENCES: Declaration = counter(
    "loadmodeld_silences_total",
    &["site"],
    "Times all streams of a site had been silent for longer than measurement.silence_s.",
);
/// Recordings taken in.
pub const RECORDINGS: Declaration = counter(
    "loadmodeld_recordings_total",
    &["site"],
    "Disturbance recordings taken in.",
);
/// Payloads that could not be decoded.
pub const PAYLOADS_REFUSED: Declaration = counter(
    "loadmodeld_payloads_refused_total",
    &["source", "reason"],
    "Payloads refused, by source (measurement, recording) and reason.",
);
/// Frames of C37.118 streams.
pub const FRAMES: Declaration = counter(
    "loadmodeld_frames_total",
    &["site", "stream", "outcome"],
    "C37.118 frames, by stream as the configuration calls it, by what became of them: sample, configuration, reconfiguration, other, no_configuration, not_as_configured, not_mapped, no_time, bad_checksum, malformed.",
);
/// Time on the way to the detector.
pub const INTAKE_SECONDS: Declaration = Declaration {
    name: "loadmodeld_intake_seconds",
    kind: Kind::Histogram(INTAKE_BOUNDS_MS),
    labels: &[],
    help: "Time from the arrival of a measurement message to behind the detector, by message.",
};
/// Messages dropped by a full intake queue.
pub const MESSAGES_DROPPED: Declaration = counter(
    "loadmodeld_messages_dropped_total",
    &["source"],
    "Messages dropped because the intake queue was full, by source (measurement, recording, query).",
);
/// Time of the newest sample.
pub const SAMPLE_TIMESTAMP: Declaration = gauge(
    "loadmodeld_newest_sample_timestamp_seconds",
    &["site"],
    "Time stamp of the newest sample of a site, seconds since 1970.",
);
/// Age of the newest sample on arrival.
pub const SAMPLE_LAG: Declaration = gauge(
    "loadmodeld_sample_lag_seconds",
    &["site"],
    "Age of a site's newest sample when it arrived.",
);
/// Disturbances found.
pub const WINDOWS: Declaration = counter(
    "loadmodeld_windows_total",
    &["site"],
    "Disturbance windows cut out and put on durable storage for the first time.",
);
/// Disturbances by how they were closed.
pub const WINDOWS_CLOSED: Declaration = counter(
    "loadmodeld_windows_closed_total",
    &["closing"],
    "Disturbance windows cut out, by why they were closed.",
);
/// Disturbances by the verdict of screening.
pub const WINDOWS_SCREENED: Declaration = counter(
    "loadmodeld_windows_screened_total",
    &["site", "verdict"],
    "Disturbance windows by the verdict of screening: usable, refused.",
);
/// Objections of screening.
pub const SCREENING_REFUSALS: Declaration = counter(
    "loadmodeld_screening_refusals_total",
    &["reason"],
    "Objections of screening that forbid the use of a window, by reason.",
);
/// Windows lost.
pub const WINDOWS_DROPPED: Declaration = counter(
    "loadmodeld_windows_dropped_total",
    &[],
    "Disturbance windows lost because the store refused them until the spool was full or the service ended.",
);
/// Windows waiting for the store.
pub const WINDOWS_SPOOLED: Declaration = gauge(
    "loadmodeld_windows_spooled",
    &[],
    "Disturbance windows in memory that are not on durable storage yet.",
);
/// Event summaries published.
pub const EVENTS_ANNOUNCED: Declaration = counter(
    "loadmodeld_events_announced_total",
    &[],
    "Event summaries put on their key.",
);
/// Fits by result.
pub const FITS: Declaration = counter(
    "loadmodeld_fits_total",
    &["site", "result"],
    "Fits by result: pass, fail, cannot_judge, error.",
);
/// Fits that did not end by themselves.
pub const FITS_INTERRUPTED: Declaration = counter(
    "loadmodeld_fits_interrupted_total",
    &["reason"],
    "Fits that did not end by themselves, by reason: budget, shutdown, lease_lost, panic.",
);
/// Duration of fits.
pub const FIT_SECONDS: Declaration = Declaration {
    name: "loadmodeld_fit_seconds",
    kind: Kind::Histogram(FIT_BOUNDS_MS),
    labels: &[],
    help: "Wall-clock time of fits that ended by themselves.",
};
/// Simulations.
pub const SIMULATIONS: Declaration = counter(
    "loadmodeld_simulations_total",
    &["kind"],
    "Simulations of one event, by kind: plain, sensitivity.",
);
/// Fits running.
pub const WORKERS_BUSY: Declaration = gauge("loadmodeld_workers_busy", &[], "Fits running now.");
/// Jobs by state.
pub const JOBS: Declaration = gauge(
    "loadmodeld_jobs",
    &["state"],
    "Jobs in the store by state: queued, claimed, parked.",
);
/// Age of the oldest due job.
pub const JOB_AGE: Declaration = gauge(
    "loadmodeld_oldest_due_job_age_seconds",
    &[],
    "Age of the oldest job that is due.",
);
/// Jobs parked.
pub const JOBS_PARKED: Declaration = counter(
    "loadmodeld_jobs_parked_total",
    &[],
    "Jobs that failed too often and wait for a person.",
);
/// Decisions.
pub const DECISIONS: Declaration = counter(
    "loadmodeld_decisions_total",
    &["site", "decision"],
    "Decisions on candidate sets: publish, publish_unvalidated, await_approval, reject.",
);
/// Sets published.
pub const SETS_PUBLISHED: Declaration = counter(
    "loadmodeld_sets_published_total",
    &["site"],
    "Parameter sets put on their key.",
);
/// Version of the newest published set.
pub const SET_VERSION: Declaration = gauge(
    "loadmodeld_set_version",
    &["site"],
    "Version of the newest set published by this process.",
);
/// When the newest set was published.
pub const SET_TIMESTAMP: Declaration = gauge(
    "loadmodeld_set_published_timestamp_seconds",
    &["site"],
    "When the newest set was published, seconds since 1970.",
);
/// Error of the newest candidate on held-out events.
pub const HELD_OUT_ERROR: Declaration = gauge(
    "loadmodeld_held_out_error_percent",
    &["site", "channel"],
    "Error of the newest candidate on its held-out events, by channel (p, q).",
);
/// Held-out error over error in the fit.
pub const HELD_OUT_RATIO: Declaration = gauge(
    "loadmodeld_held_out_to_fit_ratio",
    &["site"],
    "Error to noise of the newest candidate on held-out events over the same in the fit.",
);
/// Error over noise of the newest candidate.
pub const ERROR_TO_NOISE: Declaration = gauge(
    "loadmodeld_error_to_noise_ratio",
    &["site"],
    "Residual over noise floor of the newest candidate on the fitted events.",
);
/// Upper bounds of errors over noise: from a perfect model to one that follows nothing.
const ERROR_BOUNDS: &[u32] = &[
    1_000, 2_000, 3_000, 5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000,
];

/// Diagnoses by status.
pub const DIAGNOSES: Declaration = counter(
    "loadmodeld_diagnoses_total",
    &["status"],
    "Diagnoses by status: adequate, missing_effect, instrument_suspect, unknown_effect, cannot_judge, error.",
);
/// Effects named.
pub const DIAGNOSED_EFFECTS: Declaration = counter(
    "loadmodeld_diagnosed_effects_total",
    &["effect"],
    "Diagnoses that name an effect, by the first one named: names of the catalogue and of effect files.",
);
/// Error over noise of what was diagnosed, both stages on the same events.
pub const DIAGNOSIS_ERROR_TO_NOISE: Declaration = Declaration {
    name: "loadmodeld_diagnosis_error_to_noise_ratio",
    kind: Kind::Histogram(ERROR_BOUNDS),
    labels: &["stage"],
    help: "Residual over noise floor of diagnosed models: before, and after with the first effect named, on untouched events; no after without any.",
};
/// Duration of diagnoses.
pub const DIAGNOSIS_SECONDS: Declaration = Declaration {
    name: "loadmodeld_diagnosis_seconds",
    kind: Kind::Histogram(FIT_BOUNDS_MS),
    labels: &[],
    help: "Wall-clock time of diagnoses.",
};
/// Changes of structures.
pub const STRUCTURE_CHANGES: Declaration = counter(
    "loadmodeld_structure_changes_total",
    &["origin"],
    "Changes of which model a site is to have, by origin: configuration, command_line, http.",
);
/// Actions of people on sets.
pub const SET_ACTIONS: Declaration = counter(
    "loadmodeld_set_actions_total",
    &["action"],
    "What people did with parameter sets: approve, refuse, roll_back.",
);
/// Connections that waited for a place.
pub const HTTP_CONNECTIONS_DELAYED: Declaration = counter(
    "loadmodeld_http_connections_delayed_total",
    &[],
    "HTTP connections that waited for a place because as many as are allowed were open.",
);
/// Failures of publishing.
pub const PUBLISH_ERRORS: Declaration = counter(
    "loadmodeld_publish_errors_total",
    &["what"],
    "Publications that zenoh refused: set, event, diagnosis.",
);
/// Queries for parameter sets and diagnoses.
pub const QUERIES: Declaration = counter(
    "loadmodeld_queries_total",
    &["outcome"],
    "Queries for parameter sets and diagnoses: answered, not_found, malformed, failed.",
);
/// Errors of the store.
pub const STORE_ERRORS: Declaration = counter(
    "loadmodeld_store_errors_total",
    &["reason"],
    "Operations the store refused, by reason.",
);
/// Size of the store.
pub const STORE_BYTES: Declaration = gauge("loadmodeld_store_bytes", &[], "Size of the store.");
/// What the store's disk has left.
pub const STORE_DISK_FREE_BYTES: Declaration = gauge(
    "loadmodeld_store_disk_free_bytes",
    &[],
    "Space that the disk of the store has left for the service.",
);
/// Rows deleted by retention.
pub const STORE_PRUNED: Declaration = counter(
    "loadmodeld_store_pruned_total",
    &["what"],
    "What retention deleted: waveforms, windows, fits, jobs.",
);
/// Longest step of the loop.
pub const LOOP_STEP: Declaration = gauge(
    "loadmodeld_loop_step_seconds_max",
    &[],
    "Longest time the loop spent on one event since the last tick.",
);
/// Start of the process.
pub const START_TIMESTAMP: Declaration = gauge(
    "loadmodeld_start_timestamp_seconds",
    &[],
    "When the process started, seconds since 1970; changes count restarts.",
);
/// What is running.
pub const BUILD_INFO: Declaration = gauge(
    "loadmodeld_build_info",
    &["version"],
    "Always 1; the label says what is running.",
);

/// Every metric.
pub const CATALOGUE: &[Declaration] = &[
    BATCHES,
    SAMPLES,
    BATCHES_LOST,
    BATCHES_FOUND,
    TIME_STEPS,
    SILENCES,
    RECORDINGS,
    PAYLOADS_REFUSED,
    FRAMES,
    INTAKE_SECONDS,
    MESSAGES_DROPPED,
    SAMPLE_TIMESTAMP,
    SAMPLE_LAG,
    WINDOWS,
    WINDOWS_CLOSED,
    WINDOWS_SCREENED,
    SCREENING_REFUSALS,
    WINDOWS_DROPPED,
    WINDOWS_SPOOLED,
    EVENTS_ANNOUNCED,
    FITS,
    FITS_INTERRUPTED,
    FIT_SECONDS,
    SIMULATIONS,
    WORKERS_BUSY,
    JOBS,
    JOB_AGE,
    JOBS_PARKED,
    DECISIONS,
    SETS_PUBLISHED,
    SET_VERSION,
    SET_TIMESTAMP,
    HELD_OUT_ERROR,
    HELD_OUT_RATIO,
    ERROR_TO_NOISE,
    DIAGNOSES,
    DIAGNOSED_EFFECTS,
    DIAGNOSIS_ERROR_TO_NOISE,
    DIAGNOSIS_SECONDS,
    STRUCTURE_CHANGES,
    SET_ACTIONS,
    HTTP_CONNECTIONS_DELAYED,
    PUBLISH_ERRORS,
    QUERIES,
    STORE_ERRORS,
    STORE_BYTES,
    STORE_DISK_FREE_BYTES,
    STORE_PRUNED,
    LOOP_STEP,
    START_TIMESTAMP,
    BUILD_INFO,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_follow_the_convention_and_are_unique() {
        for (at, metric) in CATALOGUE.iter().enumerate() {
            assert!(metric.name.starts_with("loadmodeld_"), "{}", metric.name);
            assert_eq!(
                metric.kind == Kind::Counter,
                metric.name.ends_with("_total"),
                "{}",
                metric.name
            );
            assert!(metric.help.ends_with('.'), "{}", metric.name);
            assert!(CATALOGUE[..at].iter().all(|m| m.name != metric.name));
        }
    }

    #[test]
    fn the_documentation_lists_exactly_these_metrics() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/metrics.md");
        let table = documentation_table();
        let text = std::fs::read_to_string(path).unwrap_or_default();
        if std::env::var_os("UPDATE_DOCS").is_some() {
            let (before, _) = text.split_once(TABLE_START).unwrap();
            let (_, after) = text.split_once(TABLE_END).unwrap();
            let new = format!("{before}{TABLE_START}\n{table}{TABLE_END}{after}");
            std::fs::write(path, new).unwrap();
            return;
        }
        assert!(
            text.contains(&table),
            "docs/metrics.md is out of date: run `UPDATE_DOCS=1 cargo test --lib telemetry`"
        );
    }

    const TABLE_START: &str = "<!-- metrics: start -->";
    const TABLE_END: &str = "<!-- metrics: end -->";

    fn documentation_table() -> String {
        let mut rows = vec!["| name | kind | labels | meaning |".to_owned()];
        rows.push("|---|---|---|---|".to_owned());
        rows.extend(CATALOGUE.iter().map(|m| {
            format!(
                "| `{}` | {} | {} | {} |",
                m.name,
                m.kind.name(),
                m.labels.join(", "),
                m.help
            )
        }));
        rows.join("\n") + "\n"
    }
}
