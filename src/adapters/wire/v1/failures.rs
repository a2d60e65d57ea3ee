//! Where a model fails: residuals by segment, what they depend on, one sentence per event.

use serde::{Deserialize, Serialize};

use super::{diagnosis::all, json::nullable};
use crate::diagnosis::{CrossCorrelation, Dependence, EventFailure, SegmentResidual};

/// Counterpart of [`SegmentResidual`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SegmentResidualV1 {
    /// `before`, `during`, `early_recovery`, `late` or `after`.
    pub segment: String,
    /// `P` or `Q`.
    pub channel: String,
    /// Begin, seconds since the onset.
    #[serde(with = "nullable")]
    pub begin_s: f64,
    /// End, seconds since the onset.
    #[serde(with = "nullable")]
    pub end_s: f64,
    /// Used samples.
    pub samples: usize,
    /// Mean of measured minus model, pu of P0.
    #[serde(with = "nullable")]
    pub mean_pu: f64,
    /// Root mean square, pu of P0.
    #[serde(with = "nullable")]
    pub rms_pu: f64,
    /// Root mean square over the noise floor.
    #[serde(with = "nullable")]
    pub to_noise: f64,
}

/// Counterpart of [`EventFailure`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EventFailureV1 {
    /// Event.
    pub event: String,
    /// The failure in one sentence, or that there is none.
    pub sentence: String,
    /// Lowest voltage, pu of the pre-event voltage.
    #[serde(with = "nullable")]
    pub lowest_voltage: f64,
    /// Largest relative frequency deviation, signed.
    #[serde(with = "nullable")]
    pub frequency_deviation: f64,
    /// Error over noise of the event part.
    #[serde(with = "nullable")]
    pub error_to_noise: f64,
    /// Instant of the clearing, seconds since the onset; null where the voltage steps, ramps or
    /// swings without one.
    pub clearing_s: Option<f64>,
    /// Residuals by segment and channel.
    pub segments: Vec<SegmentResidualV1>,
    /// Dependences, strongest first.
    pub dependences: Vec<DependenceV1>,
    /// Cross-correlations of P and Q with the voltage.
    pub cross_correlations: Vec<CrossCorrelationV1>,
}

/// Counterpart of [`Dependence`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DependenceV1 {
    /// `P` or `Q`.
    pub channel: String,
    /// `voltage`, `voltage_rate`, `frequency_deviation` or `time_since_clearing`.
    pub quantity: String,
    /// As [`Dependence::explained`].
    #[serde(with = "nullable")]
    pub explained: f64,
    /// Means of the residual in bins of the quantity.
    pub bins: Vec<BinV1>,
}

/// One bin of a dependence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BinV1 {
    /// Centre, in the quantity's unit.
    #[serde(with = "nullable")]
    pub centre: f64,
    /// Mean residual, pu of P0.
    #[serde(with = "nullable")]
    pub mean_pu: f64,
    /// Its standard error, pu of P0.
    #[serde(with = "nullable")]
    pub standard_error_pu: f64,
    /// Number of samples.
    pub samples: usize,
}

/// Counterpart of [`CrossCorrelation`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CrossCorrelationV1 {
    /// `P` or `Q`.
    pub channel: String,
    /// Lags, seconds; positive: the residual follows the voltage.
    pub lags_s: Vec<f64>,
    /// Correlation at each lag; null where there is none.
    pub correlation: Vec<Option<f64>>,
    /// As [`CrossCorrelation::band`].
    #[serde(with = "nullable")]
    pub band: f64,
}

impl From<&SegmentResidual> for SegmentResidualV1 {
    fn from(residual: &SegmentResidual) -> Self {
        Self {
            segment: residual.segment.name().to_owned(),
            channel: residual.channel.name().to_owned(),
            begin_s: residual.begin_s,
            end_s: residual.end_s,
            samples: residual.samples,
            mean_pu: residual.mean_pu,
            rms_pu: residual.rms_pu,
            to_noise: residual.to_noise,
        }
    }
}

impl From<&EventFailure> for EventFailureV1 {
    fn from(failure: &EventFailure) -> Self {
        Self {
            event: failure.event.clone(),
            sentence: failure.sentence.clone(),
            lowest_voltage: failure.lowest_voltage,
            frequency_deviation: failure.frequency_deviation,
            error_to_noise: failure.error_to_noise,
            clearing_s: failure.clearing_s,
            segments: all(&failure.segments),
            dependences: all(&failure.dependences),
            cross_correlations: all(&failure.cross_correlations),
        }
    }
}

impl From<&Dependence> for DependenceV1 {
    fn from(dependence: &Dependence) -> Self {
        Self {
            channel: dependence.channel.name().to_owned(),
            quantity: dependence.quantity.name().to_owned(),
            explained: dependence.explained,
            bins: all(&dependence.bins),
        }
    }
}

impl From<&(f64, f64, f64, usize)> for BinV1 {
    fn from((centre, mean_pu, standard_error_pu, samples): &(f64, f64, f64, usize)) -> Self {
        Self {
            centre: *centre,
            mean_pu: *mean_pu,
            standard_error_pu: *standard_error_pu,
            samples: *samples,
        }
    }
}

impl From<&CrossCorrelation> for CrossCorrelationV1 {
    fn from(correlation: &CrossCorrelation) -> Self {
        let values = correlation.correlation.iter();
        Self {
            channel: correlation.channel.name().to_owned(),
            lags_s: correlation.lags_s.clone(),
            correlation: values.map(|r| r.is_finite().then_some(*r)).collect(),
            band: correlation.band,
        }
    }
}
