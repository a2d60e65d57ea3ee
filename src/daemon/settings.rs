//! Everything the daemon needs to know before it starts.

use std::{collections::BTreeMap, path::PathBuf};

use crate::{
    adapters::{
        c37118::LoadMapping,
        http::HttpOptions,
        recordings::{comtrade, mapping::RecordingMapping},
        store::{Keep, SqliteOptions},
        wire::v1::{BatchLimits, RecordingLimits},
        zenoh::ZenohOptions,
    },
    load_model::{Ranges, Structure},
    service::{ServiceOptions, SiteOptions},
};

/// Settings of a daemon.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Settings of the core.
    pub service: ServiceOptions,
    /// The sites.
    pub sites: Vec<SiteOptions>,
    /// Bounds and priors of a site's parameters, where its configuration gives any.
    pub ranges: BTreeMap<String, Ranges>,
    /// How each recorder's files are read, by site and recorder. The recorder `*` stands for
    /// every other of its site.
    pub recorders: BTreeMap<(String, String), Recorder>,
    /// How the C37.118 frames of each stream are read, by site and stream. The stream `*` stands for
    /// every other of its site.
    pub streams: BTreeMap<(String, String), LoadMapping>,
    /// Settings of zenoh.
    pub zenoh: ZenohOptions,
    /// Settings of HTTP.
    pub http: HttpOptions,
    /// File of the store.
    pub store_path: PathBuf,
    /// Settings of the store.
    pub store: SqliteOptions,
    /// What retention keeps; none keeps everything.
    pub keep: Option<Keep>,
    /// What a batch may cost.
    pub batch_limits: BatchLimits,
    /// What a recording may cost.
    pub recording_limits: RecordingLimits,
}

/// How the files of a recorder are read.
#[derive(Clone, Debug)]
pub struct Recorder {
    /// Which channels are the load's.
    pub mapping: RecordingMapping,
    /// What the files do not say themselves.
    pub options: comtrade::Options,
}

impl Settings {
    /// The parts of the model that a site has by configuration; those of every model where it is
    /// not configured.
    #[must_use]
    pub fn structure(&self, site: &str) -> Vec<String> {
        let configured = self.sites.iter().find(|s| s.site.name == site);
        configured.map_or_else(
            || Structure::zip_im().names(),
            |site| site.structure.clone(),
        )
    }

    /// The settings by which a site is fitted and diagnosed: those of all, with its own bounds and
    /// priors.
    #[must_use]
    pub fn options_of(&self, site: &str) -> ServiceOptions {
        let mut options = self.service.clone();
        if let Some(ranges) = self.ranges.get(site) {
            for fit in [
                &mut options.identification,
                &mut options.diagnosis.identification,
            ] {
                fit.ranges = ranges.clone();
                let problem = &mut fit.problem;
                ranges.narrow_linear(&mut problem.linear_lower, &mut problem.linear_upper);
            }
        }
        options
    }

    /// The recorder of that name at a site.
    #[must_use]
    pub fn recorder(&self, site: &str, recorder: &str) -> Option<&Recorder> {
        let named = |name: &str| self.recorders.get(&(site.to_owned(), name.to_owned()));
        named(recorder).or_else(|| named("*"))
    }

    /// How the frames of the stream of that name at a site are read, and what the configuration calls it.
    #[must_use]
    pub fn stream(&self, site: &str, stream: &str) -> Option<(&str, &LoadMapping)> {
        let named = |name: &str| {
            let known = self
                .streams
                .get_key_value(&(site.to_owned(), name.to_owned()));
            known.map(|((_, name), mapping)| (name.as_str(), mapping))
        };
        named(stream).or_else(|| named("*"))
    }
}
