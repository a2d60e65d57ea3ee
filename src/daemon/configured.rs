//! From the configuration to the settings of each part.

use std::collections::BTreeMap;

use super::{Recorder, Settings, clock::nanoseconds};
use crate::{
    adapters::{
        c37118::LoadMapping,
        http::{HttpOptions, TokenSource},
        recordings::{
            comtrade,
            mapping::{RecordingMapping, ThreePhase},
        },
        store::{Keep, SqliteOptions},
        wire::v1::{BatchLimits, RecordingLimits},
        zenoh::{Mode, ZenohOptions},
    },
    config::{
        Config, IdentificationConfig, RecordingConfig, RetentionConfig, RobustConfig, SiteConfig,
        VoltageConnection, ZenohConfig, ZenohMode, ZipBox,
    },
    diagnosis::DiagnosisOptions,
    identification::{
        DecisionOptions, IdentificationOptions, RobustLoss, Split, joint_problem::PAPER_SHARES,
    },
    load_model::{RangeError, Ranges},
    measurement::phasor::{self, Connection},
    service::{ServiceOptions, SiteOptions},
};

/// Rows that one call of retention deletes at most: some tens of milliseconds of work.
const PRUNE_ROWS_MAX: usize = 500;

/// A configuration asks for what cannot be done.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// Sites that are not listed cannot be taken.
    #[error(
        "measurement.accept_unlisted_sites: a batch does not state the bases of its site, so that \
         every site must be listed"
    )]
    UnlistedSites,
    /// Bounds or priors of a site's parameters cannot be used.
    #[error("site.parameter of `{site}`: {}", list(.sources))]
    Parameters {
        /// The site.
        site: String,
        /// Why not.
        sources: Vec<RangeError>,
    },
}

fn list(errors: &[RangeError]) -> String {
    let words: Vec<String> = errors.iter().map(ToString::to_string).collect();
    words.join("; ")
}

impl Settings {
    /// The settings that a configuration asks for.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] when it asks for what cannot be done.
    pub fn from_config(config: &Config) -> Result<Self, SettingsError> {
        if config.measurement.accept_unlisted_sites {
            return Err(SettingsError::UnlistedSites);
        }
        Ok(Self {
            service: service(config),
            sites: config.sites.iter().map(site).collect(),
            ranges: ranges(&config.sites)?,
            recorders: recorders(&config.sites),
            streams: streams(&config.sites),
            zenoh: zenoh(&config.zenoh),
            http: HttpOptions {
                listen: config.http.listen,
                rows_max: config.http.rows_max,
                open_pages: false,
                token: config
                    .http
                    .token_file
                    .clone()
                    .map_or(TokenSource::Credential, TokenSource::File),
            },
            store_path: config.store.path.clone(),
            store: SqliteOptions::default(),
            keep: keep(&config.store.retention),
            batch_limits: BatchLimits {
                payload_bytes_max: config.measurement.batch_bytes_max,
                samples_max: config.measurement.batch_samples_max,
                ..BatchLimits::default()
            },
            recording_limits: RecordingLimits {
                payload_bytes_max: config.measurement.recording_bytes_max,
                ..RecordingLimits::default()
            },
        })
    }
}

fn service(config: &Config) -> ServiceOptions {
    let (workers, fit) = (&config.workers, &config.identification);
    ServiceOptions {
        instance: config.instance.name.clone(),
        joint_events_min: fit.min_joint_events,
        joint_events_max: fit.max_joint_events,
        settle_ns: nanoseconds(fit.settle),
        workers: workers.count,
        fit_budget_ns: nanoseconds(workers.fit_budget),
        lease_ns: nanoseconds(workers.lease),
        failures_max: workers.failures_max,
        interruptions_max: workers.interruptions_max,
        retry_ns: nanoseconds(workers.retry),
        spool_windows_max: workers.queue_windows_max,
        silence_ns: nanoseconds(config.measurement.silence),
        store_retry_ns: nanoseconds(config.store.retry),
        sweep_ns: nanoseconds(workers.sweep),
        shutdown_grace_ns: nanoseconds(config.instance.shutdown_grace),
        identification: identification(fit),
        diagnose: config.diagnosis.enabled,
        diagnosis_events_min: config.diagnosis.min_events,
        diagnosis: diagnosis(config),
        decision: DecisionOptions {
            allow_unvalidated: config.publishing.allow_unvalidated,
            manual_approval: config.publishing.manual_approval,
        },
    }
}

/// As the fits, but for the search: the plain model only has to be the start of others.
fn diagnosis(config: &Config) -> DiagnosisOptions {
    let defaults = DiagnosisOptions::default();
    let fit = identification(&config.identification);
    DiagnosisOptions {
        identification: IdentificationOptions {
            search: defaults.identification.search,
            split: defaults.identification.split.clone(),
            ..fit
        },
        refits_max: config.diagnosis.max_refits,
        ..defaults
    }
}

fn identification(fit: &IdentificationConfig) -> IdentificationOptions {
    let mut options = IdentificationOptions {
        split: Split::Share(fit.hold_out_share),
        ..ServiceOptions::default().identification
    };
    if fit.zip_box == ZipBox::Paper {
        options.problem.static_shares = Some(PAPER_SHARES);
    }
    options.robust = match fit.robust {
        RobustConfig::Off => None,
        RobustConfig::Huber => Some(RobustLoss::HUBER),
        RobustConfig::Cauchy => Some(RobustLoss::CAUCHY),
    };
    options.search.trust_tech.tiers_max = fit.max_tiers;
    options.search.trust_tech.evaluations_max = fit.max_evaluations as u64;
    options
}

fn site(site: &SiteConfig) -> SiteOptions {
    SiteOptions {
        site: site.site.clone(),
        concentrator: site.concentrator.clone(),
        detector: site.detection,
        screening: site.screening,
        structure: site.structure.clone(),
    }
}

/// The ranges of the sites that have any.
fn ranges(sites: &[SiteConfig]) -> Result<BTreeMap<String, Ranges>, SettingsError> {
    let given = sites.iter().filter(|site| !site.parameters.is_empty());
    let of_site = |site: &SiteConfig| {
        let name = site.site.name.clone();
        match Ranges::new(site.parameters.clone()) {
            Ok(ranges) => Ok((name, ranges)),
            Err(sources) => Err(SettingsError::Parameters {
                site: name,
                sources,
            }),
        }
    };
    given.map(of_site).collect()
}

fn recorders(sites: &[SiteConfig]) -> BTreeMap<(String, String), Recorder> {
    let mut recorders = BTreeMap::new();
    for site in sites {
        for recording in &site.recordings {
            let key = (site.site.name.clone(), recording.recorder.clone());
            recorders.insert(key, recorder(recording));
        }
    }
    recorders
}

fn streams(sites: &[SiteConfig]) -> BTreeMap<(String, String), LoadMapping> {
    let of_site = |site: &SiteConfig| {
        let name = site.site.name.clone();
        let streams = site.streams.clone().into_iter();
        streams.map(move |stream| ((name.clone(), stream.stream), stream.mapping))
    };
    sites.iter().flat_map(of_site).collect()
}

fn recorder(recording: &RecordingConfig) -> Recorder {
    let currents = recording.currents.iter().map(|channels| ThreePhase {
        channels: channels.clone(),
        ratio: recording.current_ratio,
        reversed: recording.currents_reversed,
    });
    Recorder {
        mapping: RecordingMapping {
            voltage: ThreePhase {
                channels: recording.voltages.clone(),
                ratio: recording.voltage_ratio,
                reversed: false,
            },
            connection: match recording.connection {
                VoltageConnection::LineToGround => Connection::LineToGround,
                VoltageConnection::LineToLine => Connection::LineToLine,
            },
            currents: currents.collect(),
            apply_skew: recording.apply_skew,
            phasors: phasor::Settings {
                phasors_per_cycle: recording.phasors_per_cycle,
                ..phasor::Settings::default()
            },
        },
        options: comtrade::Options {
            utc_offset_s: Some(recording.utc_offset_s),
            lenient: recording.lenient,
            ..comtrade::Options::default()
        },
    }
}

fn zenoh(zenoh: &ZenohConfig) -> ZenohOptions {
    ZenohOptions {
        prefix: zenoh.prefix.clone(),
        mode: match zenoh.mode {
            ZenohMode::Peer => Mode::Peer,
            ZenohMode::Client => Mode::Client,
            ZenohMode::Router => Mode::Router,
        },
        listen: zenoh.listen.clone(),
        connect: zenoh.connect.clone(),
        multicast: zenoh.multicast,
        settings: zenoh.raw.clone(),
        intake_messages_max: zenoh.intake_messages_max,
        close_timeout_ms: u64::try_from(zenoh.close_timeout.as_millis()).unwrap_or(u64::MAX),
    }
}

/// None when everything is kept for ever.
fn keep(retention: &RetentionConfig) -> Option<Keep> {
    let RetentionConfig {
        waveforms,
        windows,
        fits,
        jobs,
    } = *retention;
    let limited = [waveforms, windows, fits, jobs].iter().any(Option::is_some);
    let age_ns = |age: Option<std::time::Duration>| age.map_or(i64::MAX, nanoseconds);
    limited.then(|| Keep {
        waveforms_ns: age_ns(waveforms),
        windows_ns: age_ns(windows),
        fits_ns: age_ns(fits),
        jobs_ns: age_ns(jobs),
        rows_max: PRUNE_ROWS_MAX,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_configuration_asks_for_the_default_settings() {
        let settings = Settings::from_config(&Config::default()).unwrap();
        assert_eq!(settings.zenoh, ZenohOptions::default());
        assert_eq!(settings.http, HttpOptions::default());
        assert_eq!(settings.batch_limits, BatchLimits::default());
        assert_eq!(settings.recording_limits, RecordingLimits::default());
        assert_eq!(settings.service, ServiceOptions::default());
        assert!(settings.keep.is_none());
    }

    #[test]
    fn unlisted_sites_are_refused_in_words() {
        let mut config = Config::default();
        config.measurement.accept_unlisted_sites = true;
        let error = Settings::from_config(&config).unwrap_err();
        assert!(error.to_string().contains("accept_unlisted_sites"));
    }

    #[test]
    fn a_sites_own_bounds_are_those_of_its_fits_and_diagnoses_and_of_no_other() {
        let text = r#"
            [[site]]
            name = "north"
            s_base_mva = 40
            v_base_kv = 110
            nominal_hz = 50
            [[site.parameter]]
            name = "motor_share"
            lower = 0.3
            [[site.parameter]]
            name = "second_motor.inertia_s"
            centre = 0.4
            deviation = 0.1
        "#;
        let config = Config::parse(text, "test").unwrap();
        let settings = Settings::from_config(&config).unwrap();
        let north = settings.options_of("north");
        for fit in [&north.identification, &north.diagnosis.identification] {
            assert_eq!(fit.problem.linear_lower[0].to_bits(), 0.3_f64.to_bits());
            let known = fit.ranges.of("second_motor.inertia_s").unwrap();
            assert_eq!(known.centre, Some(0.4));
        }
        assert_eq!(settings.options_of("south"), settings.service);
    }

    #[test]
    fn an_unnamed_recorder_is_read_like_the_sites_star() {
        let text = r#"
            [[site]]
            name = "north"
            s_base_mva = 40
            v_base_kv = 110
            nominal_hz = 50
            [[site.recording]]
            voltages = ["UA", "UB", "UC"]
            currents = ["IA", "IB", "IC"]
            current_sign = -1
        "#;
        let config = Config::parse(text, "test").unwrap();
        let settings = Settings::from_config(&config).unwrap();
        let recorder = settings.recorder("north", "dfr-7").unwrap();
        assert!(recorder.mapping.currents[0].reversed);
        assert!(settings.recorder("south", "dfr-7").is_none());
    }
}
