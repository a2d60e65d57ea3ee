//! The registry: the only module, with `adapters::prometheus`, that knows the library behind it.

use std::{
    collections::{BTreeMap, HashMap},
    fmt,
    sync::{Mutex, PoisonError},
};

use prometheus::{
    Gauge, GaugeVec, HistogramOpts, HistogramVec, IntCounter, IntCounterVec, Opts, Registry,
};

use super::{
    CATALOGUE, Declaration, Kind, StreamTable,
    catalogue::{BATCHES, BUILD_INFO, SAMPLE_LAG, SAMPLE_TIMESTAMP, SAMPLES, START_TIMESTAMP},
};

/// Why the registry refused the catalogue.
pub type MetricsError = prometheus::Error;

enum Family {
    Counter(IntCounterVec),
    Gauge(GaugeVec),
    Histogram(HistogramVec),
}

/// The series of a site that move with every batch: to look each up by its labels would cost as much as to decode
/// the batch.
struct BatchSeries {
    batches: IntCounter,
    accepted: IntCounter,
    newest_s: Gauge,
    lag_s: Gauge,
}

/// All metrics of the process.
pub struct Metrics {
    registry: Registry,
    families: BTreeMap<&'static str, Family>,
    streams: StreamTable,
    of_batches: Mutex<HashMap<String, BatchSeries>>,
}

impl fmt::Debug for Metrics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Metrics")
            .field("families", &self.families.len())
            .finish_non_exhaustive()
    }
}

impl Metrics {
    /// A registry with every metric of the catalogue.
    ///
    /// # Errors
    ///
    /// When the catalogue names a metric twice or with an invalid name.
    pub fn new() -> Result<Self, MetricsError> {
        let registry = Registry::new();
        let mut families = BTreeMap::new();
        for declaration in CATALOGUE {
            let family = Family::register(declaration, &registry)?;
            families.insert(declaration.name, family);
        }
        Ok(Self {
            registry,
            families,
            streams: StreamTable::default(),
            of_batches: Mutex::default(),
        })
    }

    /// What came in stream by stream: more than labels should hold.
    #[must_use]
    pub const fn streams(&self) -> &StreamTable {
        &self.streams
    }

    /// Notes what is running and since when.
    pub fn set_process(&self, version: &str, start_s: f64) {
        self.set(&BUILD_INFO, &[version], 1.0);
        self.set(&START_TIMESTAMP, &[], start_s);
    }

    /// Adds to a counter. A metric that is not of the catalogue is ignored.
    pub fn add(&self, metric: &Declaration, labels: &[&str], count: u64) {
        if let Some(Family::Counter(family)) = self.families.get(metric.name)
            && let Ok(counter) = family.get_metric_with_label_values(labels)
        {
            counter.inc_by(count);
        }
    }

    /// A batch of a site with its accepted samples, the time of its newest one, and that one's age.
    pub(super) fn batch(&self, site: &str, accepted: u64, newest_s: f64, lag_s: f64) {
        let mut known = self
            .of_batches
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if !known.contains_key(site) {
            let Some(series) = self.batch_series(site) else {
                return;
            };
            known.insert(site.to_owned(), series);
        }
        if let Some(series) = known.get(site) {
            series.batches.inc();
            series.accepted.inc_by(accepted);
            series.newest_s.set(newest_s);
            series.lag_s.set(lag_s);
        }
    }

    fn batch_series(&self, site: &str) -> Option<BatchSeries> {
        let counter = |metric: &Declaration, labels: &[&str]| match self.families.get(metric.name) {
            Some(Family::Counter(family)) => family.get_metric_with_label_values(labels).ok(),
            _ => None,
        };
        let gauge = |metric: &Declaration| match self.families.get(metric.name) {
            Some(Family::Gauge(family)) => family.get_metric_with_label_values(&[site]).ok(),
            _ => None,
        };
        Some(BatchSeries {
            batches: counter(&BATCHES, &[site])?,
            accepted: counter(&SAMPLES, &[site, "accepted"])?,
            newest_s: gauge(&SAMPLE_TIMESTAMP)?,
            lag_s: gauge(&SAMPLE_LAG)?,
        })
    }

    /// Sets a gauge. A metric that is not of the catalogue is ignored.
    pub fn set(&self, metric: &Declaration, labels: &[&str], value: f64) {
        if let Some(Family::Gauge(family)) = self.families.get(metric.name)
            && let Ok(gauge) = family.get_metric_with_label_values(labels)
        {
            gauge.set(value);
        }
    }

    /// Adds one value to a histogram. A metric that is not of the catalogue is ignored.
    pub fn observe(&self, metric: &Declaration, labels: &[&str], value: f64) {
        if let Some(Family::Histogram(family)) = self.families.get(metric.name)
            && let Ok(histogram) = family.get_metric_with_label_values(labels)
        {
            histogram.observe(value);
        }
    }

    /// Value of a counter or gauge, number of values of a histogram; 0 for what was never moved.
    pub fn value(&self, metric: &Declaration, labels: &[&str]) -> f64 {
        match self.families.get(metric.name) {
            Some(Family::Counter(family)) => family
                .get_metric_with_label_values(labels)
                .map_or(0.0, |c| c.get() as f64),
            Some(Family::Gauge(family)) => family
                .get_metric_with_label_values(labels)
                .map_or(0.0, |g| g.get()),
            Some(Family::Histogram(family)) => family
                .get_metric_with_label_values(labels)
                .map_or(0.0, |h| h.get_sample_count() as f64),
            None => 0.0,
        }
    }

    /// Everything, for rendering.
    pub fn gather(&self) -> Vec<prometheus::proto::MetricFamily> {
        self.registry.gather()
    }
}

impl Family {
    fn register(declared: &Declaration, registry: &Registry) -> Result<Self, prometheus::Error> {
        match declared.kind {
            Kind::Counter => {
                let family = IntCounterVec::new(declared.opts(), declared.labels)?;
                registry.register(Box::new(family.clone()))?;
                if declared.labels.is_empty() {
                    family.get_metric_with_label_values::<&str>(&[])?;
                }
                Ok(Self::Counter(family))
            }
            Kind::Gauge => {
                let family = GaugeVec::new(declared.opts(), declared.labels)?;
                registry.register(Box::new(family.clone()))?;
                if declared.labels.is_empty() {
                    family.get_metric_with_label_values::<&str>(&[])?;
                }
                Ok(Self::Gauge(family))
            }
            Kind::Histogram(bounds) => {
                let options = HistogramOpts::from(declared.opts())
                    .buckets(bounds.iter().map(|bound| f64::from(*bound) / 1e3).collect());
                let family = HistogramVec::new(options, declared.labels)?;
                registry.register(Box::new(family.clone()))?;
                Ok(Self::Histogram(family))
            }
        }
    }
}

impl Declaration {
    fn opts(&self) -> Opts {
        Opts::new(self.name, self.help)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::telemetry::catalogue::{FIT_SECONDS, SAMPLES, WINDOWS_DROPPED};

    #[test]
    fn what_is_added_is_what_is_read() {
        let metrics = Metrics::new().unwrap();
        metrics.add(&SAMPLES, &["north", "late"], 3);
        metrics.observe(&FIT_SECONDS, &[], 4.0);
        assert!((metrics.value(&SAMPLES, &["north", "late"]) - 3.0).abs() < f64::EPSILON);
        assert!((metrics.value(&FIT_SECONDS, &[]) - 1.0).abs() < f64::EPSILON);
    }

    #[test]
    fn a_counter_without_labels_is_there_before_anything_happened() {
        let metrics = Metrics::new().unwrap();
        assert!(
            metrics
                .gather()
                .iter()
                .any(|f| f.name() == WINDOWS_DROPPED.name)
        );
    }

    #[test]
    fn wrong_labels_are_ignored() {
        let metrics = Metrics::new().unwrap();
        metrics.add(&SAMPLES, &["north"], 3);
        assert!(metrics.value(&SAMPLES, &["north"]).abs() < f64::EPSILON);
    }
}
