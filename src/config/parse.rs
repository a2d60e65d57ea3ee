//! From the text to the settings, section by section.

use std::{net::SocketAddr, path::PathBuf};

use toml::de::{DeTable, DeValue};

use super::{
    Config, DiagnosisConfig, HttpConfig, IdentificationConfig, InstanceConfig, LogConfig,
    LogFormatConfig, MeasurementConfig, PublishingConfig, RobustConfig, StoreConfig, WorkersConfig,
    ZenohConfig, ZenohMode, ZipBox,
    problems::{Problem, place},
    section::{Findings, Section},
    site,
};
use crate::{
    disturbance::{DetectorOptions, ScreeningOptions, VoltageReference},
    measurement::ConcentratorOptions,
};

/// Reads as much as can be read, and says what could not be.
pub(super) fn config(text: &str) -> (Config, Findings) {
    let (table, errors) = DeTable::parse_recoverable(text);
    let mut findings = Findings::default();
    for error in errors {
        let (line, column) = place(text, error.span().map_or(0, |span| span.start));
        findings.problems.push(Problem {
            line,
            column,
            key: String::new(),
            message: error.message().to_owned(),
            allowed: None,
        });
    }
    let mut config = Config::default();
    let mut root = Section::root(text, &table);
    findings.add(instance(root.section("instance"), &mut config.instance));
    findings.add(zenoh(root.section("zenoh"), &mut config.zenoh));
    findings.add(store(root.section("store"), &mut config.store));
    findings.add(http(root.section("http"), &mut config.http));
    findings.add(log(root.section("log"), &mut config.log));
    findings.add(workers(root.section("workers"), &mut config.workers));
    findings.add(measurement(
        root.section("measurement"),
        &mut config.measurement,
    ));
    findings.add(detection(root.section("detection"), &mut config.detection));
    findings.add(screening(root.section("screening"), &mut config.screening));
    findings.add(identification(
        root.section("identification"),
        &mut config.identification,
    ));
    findings.add(diagnosis(root.section("diagnosis"), &mut config.diagnosis));
    findings.add(effects(root.section("effects"), &mut config.effect_files));
    findings.add(publishing(
        root.section("publishing"),
        &mut config.publishing,
    ));
    let sites = site::sites(root.sections("site"), &mut config);
    findings.add(sites);
    findings.add(root.finish());
    (config, findings)
}

fn instance(mut section: Section<'_>, to: &mut InstanceConfig) -> Findings {
    section.text("name", &mut to.name, site::chunk);
    section.seconds("shutdown_grace_s", &mut to.shutdown_grace, (1.0, 600.0));
    section.finish()
}

fn zenoh(mut section: Section<'_>, to: &mut ZenohConfig) -> Findings {
    const MODES: [(&str, ZenohMode); 3] = [
        ("peer", ZenohMode::Peer),
        ("client", ZenohMode::Client),
        ("router", ZenohMode::Router),
    ];
    section.text("prefix", &mut to.prefix, key_prefix);
    section.choice("mode", &mut to.mode, &MODES);
    section.texts("listen", &mut to.listen, endpoint);
    section.texts("connect", &mut to.connect, endpoint);
    section.flag("multicast", &mut to.multicast);
    section.count(
        "intake_messages_max",
        &mut to.intake_messages_max,
        (128, 1_000_000),
    );
    section.seconds("close_timeout_s", &mut to.close_timeout, (0.1, 60.0));
    if let Some(raw) = section.any_table("raw") {
        to.raw = raw
            .iter()
            .map(|(key, value)| (key.get_ref().to_string(), json(value.get_ref()).to_string()))
            .collect();
    }
    if to.mode == ZenohMode::Client && to.connect.is_empty() {
        section.object(
            "mode",
            "a client has nothing to connect to",
            "an endpoint in zenoh.connect, or mode = \"peer\"",
        );
    }
    if to.mode == ZenohMode::Client && !section.is_present("listen") {
        to.listen.clear();
    }
    section.finish()
}

fn store(mut section: Section<'_>, to: &mut StoreConfig) -> Findings {
    const DAYS: (f64, f64) = (1.0, 36_500.0);
    section.text("path", &mut to.path, path);
    let keep = &mut to.retention;
    section.days_or_ever("keep_waveforms_days", &mut keep.waveforms, DAYS);
    section.days_or_ever("keep_windows_days", &mut keep.windows, DAYS);
    section.days_or_ever("keep_fits_days", &mut keep.fits, DAYS);
    section.days_or_ever("keep_jobs_days", &mut keep.jobs, DAYS);
    section.seconds("retry_s", &mut to.retry, (0.1, 3600.0));
    section.finish()
}

fn http(mut section: Section<'_>, to: &mut HttpConfig) -> Findings {
    section.text("listen", &mut to.listen, |text| {
        if text.is_empty() {
            return Ok(None);
        }
        text.parse::<SocketAddr>().map(Some).map_err(|_| {
            "an address and a port such as \"127.0.0.1:9464\", or \"\" for none".into()
        })
    });
    section.count("rows_max", &mut to.rows_max, (1, 10_000));
    section.text("token_file", &mut to.token_file, |text| {
        Ok((!text.is_empty()).then(|| PathBuf::from(text)))
    });
    section.finish()
}

fn log(mut section: Section<'_>, to: &mut LogConfig) -> Findings {
    const FORMATS: [(&str, LogFormatConfig); 3] = [
        ("auto", LogFormatConfig::Auto),
        ("text", LogFormatConfig::Text),
        ("json", LogFormatConfig::Json),
    ];
    section.text("level", &mut to.level, |text| {
        tracing_subscriber::EnvFilter::try_new(text)
            .map(|_| text.to_owned())
            .map_err(|_| {
                "error, warn, info, debug, trace, or a filter such as \"info,zenoh=warn\"".into()
            })
    });
    section.choice("format", &mut to.format, &FORMATS);
    section.finish()
}

fn workers(mut section: Section<'_>, to: &mut WorkersConfig) -> Findings {
    section.count("count", &mut to.count, (1, 64));
    section.seconds("fit_budget_s", &mut to.fit_budget, (1.0, 86_400.0));
    section.seconds("lease_s", &mut to.lease, (5.0, 3600.0));
    section.count("failures_max", &mut to.failures_max, (1, 100));
    section.count("interruptions_max", &mut to.interruptions_max, (1, 100));
    section.seconds("retry_s", &mut to.retry, (0.0, 86_400.0));
    section.count("queue_windows_max", &mut to.queue_windows_max, (1, 10_000));
    section.seconds("sweep_s", &mut to.sweep, (1.0, 86_400.0));
    section.finish()
}

fn measurement(mut section: Section<'_>, to: &mut MeasurementConfig) -> Findings {
    section.flag("accept_unlisted_sites", &mut to.accept_unlisted_sites);
    section.seconds("silence_s", &mut to.silence, (0.1, 3600.0));
    section.count(
        "batch_bytes_max",
        &mut to.batch_bytes_max,
        (1 << 10, 1 << 30),
    );
    section.count(
        "batch_samples_max",
        &mut to.batch_samples_max,
        (1, 1_000_000),
    );
    section.count(
        "recording_bytes_max",
        &mut to.recording_bytes_max,
        (1 << 10, 1 << 30),
    );
    concentrator(&mut section, &mut to.concentrator);
    section.finish()
}

/// The keys of the concentrator, for all sites and for one.
pub(super) fn concentrator(section: &mut Section<'_>, to: &mut ConcentratorOptions) {
    let mut lag_ms = to.lag_s * 1e3;
    let (shortest, longest) = ConcentratorOptions::LAG_S;
    section.number("lag_ms", &mut lag_ms, (shortest * 1e3, longest * 1e3));
    to.lag_s = lag_ms / 1e3;
    section.number(
        "gap_restart_s",
        &mut to.gap_restart_s,
        ConcentratorOptions::GAP_RESTART_S,
    );
    section.number(
        "grid_tolerance_share",
        &mut to.grid_tolerance_share,
        ConcentratorOptions::GRID_TOLERANCE_SHARE,
    );
    section.number(
        "off_grid_restart_s",
        &mut to.off_grid_restart_s,
        ConcentratorOptions::OFF_GRID_RESTART_S,
    );
    if to.gap_restart_s < to.lag_s {
        section.object(
            "gap_restart_s",
            "a gap shorter than the lag time cannot be told from lateness",
            &format!("at least lag_ms, which is {} s", to.lag_s),
        );
    }
}

/// The keys of the detector, for all sites and for one.
pub(super) fn detection(mut section: Section<'_>, to: &mut DetectorOptions) -> Findings {
    type Is = DetectorOptions;
    let references = VoltageReference::ALL.map(|reference| (reference.name(), reference));
    section.number("pre_trigger_s", &mut to.pre_trigger_s, Is::PRE_TRIGGER_S);
    section.number("post_trigger_s", &mut to.post_trigger_s, Is::POST_TRIGGER_S);
    section.number("longest_s", &mut to.longest_s, Is::LONGEST_S);
    section.choice("voltage_reference", &mut to.voltage_reference, &references);
    section.number(
        "reference_time_constant_s",
        &mut to.reference_time_constant_s,
        Is::REFERENCE_TIME_CONSTANT_S,
    );
    section.number_or_none("dip_ratio", &mut to.dip_ratio, Is::DIP_RATIO);
    section.number_or_none("swell_ratio", &mut to.swell_ratio, Is::SWELL_RATIO);
    section.number(
        "hysteresis_ratio",
        &mut to.hysteresis_ratio,
        Is::HYSTERESIS_RATIO,
    );
    section.number_or_none("step_pu", &mut to.step_pu, Is::STEP_PU);
    section.number_or_none("phase_jump_deg", &mut to.phase_jump_deg, Is::PHASE_JUMP_DEG);
    section.number("step_time_s", &mut to.step_time_s, Is::STEP_TIME_S);
    section.number("base_time_s", &mut to.base_time_s, Is::BASE_TIME_S);
    section.number("noise_factor", &mut to.noise_factor, Is::NOISE_FACTOR);
    section.number_or_none(
        "frequency_deviation_hz",
        &mut to.frequency_deviation_hz,
        Is::FREQUENCY_DEVIATION_HZ,
    );
    section.number_or_none("rocof_hz_per_s", &mut to.rocof_hz_per_s, Is::ROCOF_HZ_PER_S);
    section.number("rocof_time_s", &mut to.rocof_time_s, Is::ROCOF_TIME_S);
    section.count(
        "confirm_samples",
        &mut to.confirm_samples,
        Is::CONFIRM_SAMPLES,
    );
    if to.longest_s < to.pre_trigger_s + to.post_trigger_s {
        section.object(
            "longest_s",
            "no window could end by recovery",
            &format!(
                "at least pre_trigger_s + post_trigger_s, which is {}",
                to.pre_trigger_s + to.post_trigger_s
            ),
        );
    }
    section.finish()
}

/// The keys of screening, for all sites and for one.
pub(super) fn screening(mut section: Section<'_>, to: &mut ScreeningOptions) -> Findings {
    type Is = ScreeningOptions;
    section.number(
        "voltage_change_min_pu",
        &mut to.voltage_change_min_pu,
        Is::SHARE,
    );
    section.number(
        "frequency_change_min_hz",
        &mut to.frequency_change_min_hz,
        Is::FREQUENCY_CHANGE_MIN_HZ,
    );
    section.number("usable_share_min", &mut to.usable_share_min, Is::SHARE);
    section.number_or_none("unbalance_mark", &mut to.unbalance_mark, Is::SHARE);
    section.number_or_none("unbalance_refuse", &mut to.unbalance_refuse, Is::SHARE);
    section.number("reverse_power_max", &mut to.reverse_power_max, Is::SHARE);
    section.number(
        "explained_share_min",
        &mut to.explained_share_min,
        Is::SHARE,
    );
    section.number(
        "unexplained_power_max",
        &mut to.unexplained_power_max,
        Is::UNEXPLAINED_POWER_MAX,
    );
    section.number("pre_event_s", &mut to.pre_event_s, Is::PRE_EVENT_S);
    section.number(
        "pre_event_cycles_min",
        &mut to.pre_event_cycles_min,
        Is::PRE_EVENT_CYCLES_MIN,
    );
    section.number(
        "pre_event_range_max_pu",
        &mut to.pre_event_range_max_pu,
        Is::SHARE,
    );
    section.flag("refuse_unsteady", &mut to.refuse_unsteady);
    section.number("active_min_pu", &mut to.active_min_pu, Is::SHARE);
    section.finish()
}

fn diagnosis(mut section: Section<'_>, to: &mut DiagnosisConfig) -> Findings {
    section.flag("enabled", &mut to.enabled);
    section.count("min_events", &mut to.min_events, (1, 1000));
    section.count("max_refits", &mut to.max_refits, (1, 100));
    section.finish()
}

fn effects(mut section: Section<'_>, to: &mut Vec<PathBuf>) -> Findings {
    section.texts("files", to, path);
    section.finish()
}

/// The names of a model's parts; whether there are such parts is known once effect files have been
/// read.
pub(super) fn structure(section: &mut Section<'_>, to: &mut Vec<String>) {
    section.texts("structure", to, |text| {
        let named = !text.is_empty()
            && text
                .chars()
                .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
        if named {
            Ok(text.to_owned())
        } else {
            Err("names of model parts such as \"zip\", \"induction_motor\"".into())
        }
    });
    if to.is_empty() {
        section.object(
            "structure",
            "a model needs a part",
            "at least one name of a model part",
        );
    }
}

fn identification(mut section: Section<'_>, to: &mut IdentificationConfig) -> Findings {
    const LOSSES: [(&str, RobustConfig); 3] = [
        ("off", RobustConfig::Off),
        ("huber", RobustConfig::Huber),
        ("cauchy", RobustConfig::Cauchy),
    ];
    const BOXES: [(&str, ZipBox); 2] = [("wide", ZipBox::Wide), ("paper", ZipBox::Paper)];
    structure(&mut section, &mut to.structure);
    section.count("min_joint_events", &mut to.min_joint_events, (1, 1000));
    section.count("max_joint_events", &mut to.max_joint_events, (1, 1000));
    section.seconds("settle_s", &mut to.settle, (0.0, 86_400.0));
    section.number("hold_out_share", &mut to.hold_out_share, (0.0, 0.9));
    section.choice("zip_box", &mut to.zip_box, &BOXES);
    section.choice("robust", &mut to.robust, &LOSSES);
    section.count("max_tiers", &mut to.max_tiers, (0, 20));
    section.count(
        "max_evaluations",
        &mut to.max_evaluations,
        (10, 100_000_000),
    );
    if to.max_joint_events < to.min_joint_events {
        section.object(
            "max_joint_events",
            "no site could ever be fitted jointly",
            &format!(
                "at least min_joint_events, which is {}",
                to.min_joint_events
            ),
        );
    }
    section.finish()
}

fn publishing(mut section: Section<'_>, to: &mut PublishingConfig) -> Findings {
    section.flag("allow_unvalidated", &mut to.allow_unvalidated);
    section.flag("manual_approval", &mut to.manual_approval);
    section.finish()
}

fn path(text: &str) -> Result<PathBuf, String> {
    if text.is_empty() {
        Err("the path of a file".into())
    } else {
        Ok(PathBuf::from(text))
    }
}

fn key_prefix(text: &str) -> Result<String, String> {
    if text.split('/').all(|chunk| site::chunk(chunk).is_ok()) {
        Ok(text.to_owned())
    } else {
        Err("chunks joined by \"/\", such as \"loadmodel/v1\"".into())
    }
}

/// The transports that are built in: see `Cargo.toml`.
fn endpoint(text: &str) -> Result<String, String> {
    let address = text
        .strip_prefix("tcp/")
        .or_else(|| text.strip_prefix("tls/"))
        .unwrap_or_default();
    let port = address
        .split('#')
        .next()
        .and_then(|address| address.rsplit_once(':'))
        .filter(|(host, _)| !host.is_empty())
        .and_then(|(_, port)| port.parse::<u16>().ok());
    match port {
        Some(_) => Ok(text.to_owned()),
        None => Err("\"tcp/HOST:PORT\" or \"tls/HOST:PORT\"".into()),
    }
}

/// A TOML value as zenoh takes it.
fn json(value: &DeValue<'_>) -> serde_json::Value {
    match value {
        DeValue::String(text) => text.as_ref().into(),
        DeValue::Boolean(flag) => (*flag).into(),
        DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix())
            .map_or(serde_json::Value::Null, Into::into),
        DeValue::Float(float) => float
            .as_str()
            .parse::<f64>()
            .map_or(serde_json::Value::Null, Into::into),
        DeValue::Datetime(time) => time.to_string().into(),
        DeValue::Array(array) => array
            .iter()
            .map(|element| json(element.get_ref()))
            .collect(),
        DeValue::Table(table) => table
            .iter()
            .map(|(key, value)| (key.get_ref().to_string(), json(value.get_ref())))
            .collect(),
    }
}
