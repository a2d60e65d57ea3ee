//! What a configuration says, by section. Everything here has been checked already.

use std::{collections::BTreeMap, net::SocketAddr, path::PathBuf, time::Duration};

use crate::{
    adapters::c37118::{LoadMapping, PhasorSet, PowerSource},
    disturbance::{DetectorOptions, ScreeningOptions},
    load_model::ParameterRange,
    measurement::{ConcentratorOptions, Site},
};

/// A whole configuration. The default is what `config/loadmodeld.toml` shows.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Config {
    /// `[instance]`
    pub instance: InstanceConfig,
    /// `[zenoh]`
    pub zenoh: ZenohConfig,
    /// `[store]`
    pub store: StoreConfig,
    /// `[http]`
    pub http: HttpConfig,
    /// `[log]`
    pub log: LogConfig,
    /// `[workers]`
    pub workers: WorkersConfig,
    /// `[measurement]`
    pub measurement: MeasurementConfig,
    /// `[detection]`, for sites that do not say otherwise.
    pub detection: DetectorOptions,
    /// `[screening]`, for sites that do not say otherwise.
    pub screening: ScreeningOptions,
    /// `[identification]`
    pub identification: IdentificationConfig,
    /// `[diagnosis]`
    pub diagnosis: DiagnosisConfig,
    /// `[publishing]`
    pub publishing: PublishingConfig,
    /// `[effects]`: files of effects beside those of the catalogue.
    pub effect_files: Vec<PathBuf>,
    /// `[[site]]`, in the order of the file; names are unique.
    pub sites: Vec<SiteConfig>,
}

impl Config {
    /// The site of that name.
    #[must_use]
    pub fn site(&self, name: &str) -> Option<&SiteConfig> {
        self.sites.iter().find(|site| site.site.name == name)
    }

    /// The settings of a site that is not listed: those of the file for all sites.
    #[must_use]
    pub fn for_unlisted(&self, site: Site) -> SiteConfig {
        SiteConfig {
            site,
            concentrator: self.measurement.concentrator.clone(),
            detection: self.detection,
            screening: self.screening,
            structure: self.identification.structure.clone(),
            parameters: Vec::new(),
            parameter_places: Vec::new(),
            recordings: Vec::new(),
            streams: Vec::new(),
        }
    }
}

/// Who this daemon is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InstanceConfig {
    /// Name: one chunk of a key expression, unique among the daemons of a network.
    pub name: String,
    /// Time the daemon may take to stop.
    pub shutdown_grace: Duration,
}

impl Default for InstanceConfig {
    fn default() -> Self {
        Self {
            name: "loadmodeld".to_owned(),
            shutdown_grace: Duration::from_secs(20),
        }
    }
}

/// How the session takes part in the zenoh network; names are zenoh's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ZenohMode {
    /// Talks to others directly.
    #[default]
    Peer,
    /// Talks through a router.
    Client,
    /// Is a router itself.
    Router,
}

/// Where measurements come from and parameter sets go to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ZenohConfig {
    /// Prefix of every key expression.
    pub prefix: String,
    /// How the session takes part in the network.
    pub mode: ZenohMode,
    /// Endpoints to listen on.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
    /// Whether to look for others by multicast.
    pub multicast: bool,
    /// Messages that may wait for the decoder.
    pub intake_messages_max: usize,
    /// Longest wait for the session to close.
    pub close_timeout: Duration,
    /// zenoh's own keys and their values as JSON, inserted last, in this order.
    pub raw: Vec<(String, String)>,
}

impl Default for ZenohConfig {
    fn default() -> Self {
        Self {
            prefix: "loadmodel/v1".to_owned(),
            mode: ZenohMode::Peer,
            listen: vec!["tcp/127.0.0.1:7447".to_owned()],
            connect: Vec::new(),
            multicast: false,
            intake_messages_max: 32_768,
            close_timeout: Duration::from_secs(2),
            raw: Vec::new(),
        }
    }
}

/// Durable memory.
#[derive(Clone, Debug, PartialEq)]
pub struct StoreConfig {
    /// The `SQLite` file.
    pub path: PathBuf,
    /// What is forgotten after how long.
    pub retention: RetentionConfig,
    /// Pause before a failed step of the store is tried again.
    pub retry: Duration,
}

impl Default for StoreConfig {
    fn default() -> Self {
        Self {
            path: PathBuf::from("/var/lib/loadmodeld/loadmodeld.sqlite"),
            retention: RetentionConfig::default(),
            retry: Duration::from_secs(2),
        }
    }
}

/// How long things are kept; none is for ever. Parameter sets and decisions are always kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct RetentionConfig {
    /// Waveforms of windows, by onset.
    pub waveforms: Option<Duration>,
    /// Summaries of windows, by onset.
    pub windows: Option<Duration>,
    /// Documents of fits.
    pub fits: Option<Duration>,
    /// Finished jobs.
    pub jobs: Option<Duration>,
}

/// Page, metrics and health.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpConfig {
    /// Address to listen on; none switches the server off.
    pub listen: Option<SocketAddr>,
    /// Rows of one answer at most.
    pub rows_max: usize,
    /// File of the token; none: the credential of systemd, if there is one.
    pub token_file: Option<PathBuf>,
}

impl Default for HttpConfig {
    fn default() -> Self {
        Self {
            listen: Some(SocketAddr::from(([127, 0, 0, 1], 9464))),
            rows_max: 200,
            token_file: None,
        }
    }
}

/// How log lines are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum LogFormatConfig {
    /// To the journal under systemd, else as text.
    #[default]
    Auto,
    /// Lines of text on standard error.
    Text,
    /// One JSON object per line on standard error.
    Json,
}

/// Logging.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogConfig {
    /// Lowest level, or a filter such as `info,zenoh=warn`.
    pub level: String,
    /// How log lines are written.
    pub format: LogFormatConfig,
}

impl Default for LogConfig {
    fn default() -> Self {
        Self {
            level: "info,zenoh=warn".to_owned(),
            format: LogFormatConfig::Auto,
        }
    }
}

/// Fits and their queue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorkersConfig {
    /// Fits that run at one time.
    pub count: usize,
    /// Longest time one fit may take.
    pub fit_budget: Duration,
    /// Lease of a job.
    pub lease: Duration,
    /// Failures after which a job is parked.
    pub failures_max: u32,
    /// Disappearances of its holder after which a job is parked.
    pub interruptions_max: u32,
    /// Pause before a failed job is tried again.
    pub retry: Duration,
    /// Windows that may wait in memory for the store.
    pub queue_windows_max: usize,
    /// Time between looks at the store for work that was left behind.
    pub sweep: Duration,
}

impl Default for WorkersConfig {
    fn default() -> Self {
        Self {
            count: 1,
            fit_budget: Duration::from_mins(15),
            lease: Duration::from_mins(1),
            failures_max: 3,
            interruptions_max: 5,
            retry: Duration::from_mins(1),
            queue_windows_max: 256,
            sweep: Duration::from_mins(5),
        }
    }
}

/// Intake of samples.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasurementConfig {
    /// Whether samples of sites that are not listed are taken.
    pub accept_unlisted_sites: bool,
    /// Silence after which a site's stream is taken to its end.
    pub silence: Duration,
    /// Largest batch, bytes.
    pub batch_bytes_max: usize,
    /// Most samples in a batch.
    pub batch_samples_max: usize,
    /// Largest recording, bytes.
    pub recording_bytes_max: usize,
    /// For sites that do not say otherwise.
    pub concentrator: ConcentratorOptions,
}

impl Default for MeasurementConfig {
    fn default() -> Self {
        Self {
            accept_unlisted_sites: false,
            silence: Duration::from_secs(5),
            batch_bytes_max: 4 << 20,
            batch_samples_max: 20_000,
            recording_bytes_max: 64 << 20,
            concentrator: ConcentratorOptions::default(),
        }
    }
}

/// Bounds of the ZIP coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ZipBox {
    /// What measured appliances need.
    #[default]
    Wide,
    /// The reference paper's, 0.1 to 0.9.
    Paper,
}

/// How samples with large residuals are weighted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum RobustConfig {
    /// Least squares.
    #[default]
    Off,
    /// Huber's loss.
    Huber,
    /// Cauchy's loss.
    Cauchy,
}

/// The fit.
#[derive(Clone, Debug, PartialEq)]
pub struct IdentificationConfig {
    /// Parts of the model.
    pub structure: Vec<String>,
    /// Usable events from which on a site is fitted jointly.
    pub min_joint_events: usize,
    /// Events that enter a joint fit, newest first.
    pub max_joint_events: usize,
    /// Quiet time after the last event of a site before it is fitted jointly.
    pub settle: Duration,
    /// Share of the events that is held out.
    pub hold_out_share: f64,
    /// Bounds of the ZIP coefficients.
    pub zip_box: ZipBox,
    /// Weights of samples with large residuals.
    pub robust: RobustConfig,
    /// Tiers of the search.
    pub max_tiers: usize,
    /// Calls of the objective one search may cost.
    pub max_evaluations: usize,
}

impl Default for IdentificationConfig {
    fn default() -> Self {
        Self {
            structure: vec!["zip".to_owned(), "induction_motor".to_owned()],
            min_joint_events: 2,
            max_joint_events: 40,
            settle: Duration::from_secs(30),
            hold_out_share: 0.33,
            zip_box: ZipBox::Wide,
            robust: RobustConfig::Off,
            max_tiers: 20,
            max_evaluations: 4000,
        }
    }
}

/// Diagnoses in the background.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiagnosisConfig {
    /// Whether sites are diagnosed.
    pub enabled: bool,
    /// Usable events from which on a site is diagnosed.
    pub min_events: usize,
    /// Effects that are refitted of those that the screen puts first.
    pub max_refits: usize,
}

impl Default for DiagnosisConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            min_events: 4,
            max_refits: 10,
        }
    }
}

/// What is published.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct PublishingConfig {
    /// Publish a set that could not be judged, marked as unvalidated.
    pub allow_unvalidated: bool,
    /// Wait for a person's approval of a set that passed.
    pub manual_approval: bool,
}

/// One `[[site]]`.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteConfig {
    /// Name and bases.
    pub site: Site,
    /// Intake.
    pub concentrator: ConcentratorOptions,
    /// Detection.
    pub detection: DetectorOptions,
    /// Screening.
    pub screening: ScreeningOptions,
    /// Parts of the model, until somebody says otherwise.
    pub structure: Vec<String>,
    /// Bounds and priors of parameters, as the file gives them.
    pub parameters: Vec<ParameterRange>,
    /// Where the keys of each of them are in the file: line and character, from 1.
    pub parameter_places: Vec<BTreeMap<&'static str, (usize, usize)>>,
    /// How recorders' files are read; names are unique within the site.
    pub recordings: Vec<RecordingConfig>,
    /// How C37.118 frames are read; names are unique within the site.
    pub streams: Vec<StreamConfig>,
}

/// One `[[site.c37118]]`: which channels of a PMU's stream are the load's.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamConfig {
    /// The stream; `*` is every stream of the site that is not named.
    pub stream: String,
    /// The channels.
    pub mapping: LoadMapping,
}

impl Default for StreamConfig {
    /// The stream's only PMU, primary values; its channels have to be named.
    fn default() -> Self {
        let voltage = PhasorSet::PositiveSequence(String::new());
        let power = PowerSource::Currents(Vec::new());
        Self {
            stream: "*".to_owned(),
            mapping: LoadMapping {
                power,
                ..LoadMapping::new(voltage.clone(), voltage)
            },
        }
    }
}

/// How three-phase voltages are connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum VoltageConnection {
    /// Phase to ground: a, b, c.
    #[default]
    LineToGround,
    /// Between phases: ab, bc, ca.
    LineToLine,
}

/// One `[[site.recording]]`: which channels of a recorder's files are the load's.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingConfig {
    /// The recorder; `*` is every recorder of the site that is not named.
    pub recorder: String,
    /// Names or numbers of the voltage channels, phases a, b, c in the order of rotation.
    pub voltages: [String; 3],
    /// How the voltages are connected.
    pub connection: VoltageConnection,
    /// Names or numbers of the current channels of each feeder that adds up to the load.
    pub currents: Vec<[String; 3]>,
    /// Whether the recorded currents are positive out of the load.
    pub currents_reversed: bool,
    /// From the recorded to the primary voltage; none: by the file's ratings.
    pub voltage_ratio: Option<f64>,
    /// From the recorded to the primary current; none: by the file's ratings.
    pub current_ratio: Option<f64>,
    /// Phasors per nominal cycle.
    pub phasors_per_cycle: f64,
    /// Whether each channel is shifted by the skew its line states.
    pub apply_skew: bool,
    /// Offset of the recorder's clock from UTC for files that do not say, seconds east.
    pub utc_offset_s: i32,
    /// Whether a recording whose data end early is read as far as it goes.
    pub lenient: bool,
}

impl Default for RecordingConfig {
    fn default() -> Self {
        Self {
            recorder: "*".to_owned(),
            voltages: Default::default(),
            connection: VoltageConnection::LineToGround,
            currents: Vec::new(),
            currents_reversed: false,
            voltage_ratio: None,
            current_ratio: None,
            phasors_per_cycle: 4.0,
            apply_skew: false,
            utc_offset_s: 0,
            lenient: false,
        }
    }
}
