//! The document of `profile --json`.

use serde::Serialize;

use super::{VERSION, json::nullable};
use crate::{
    adapters::wire::DocumentError,
    identification::{
        Profile, SiteProfile,
        profile::{ConfidenceInterval, Limit, ProfilePoint},
    },
};

/// Counterpart of [`SiteProfile`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SiteProfileV1 {
    /// Version of this format: 1.
    pub v: u64,
    /// Site.
    pub site: String,
    /// Parts of the model.
    pub structure: Vec<String>,
    /// Events the fit used.
    pub fitted_events: Vec<String>,
    /// The profiles.
    pub profiles: Vec<ProfileV1>,
}

/// Counterpart of [`Profile`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProfileV1 {
    /// Name of the quantity.
    pub parameter: String,
    /// What it is.
    pub meaning: String,
    /// Unit, `1` when dimensionless.
    pub unit: String,
    /// Value at the solution.
    #[serde(with = "nullable")]
    pub estimate: f64,
    /// Standard error, for comparison.
    #[serde(with = "nullable")]
    pub standard_error: f64,
    /// Calibration of the variance.
    #[serde(with = "nullable")]
    pub variance_factor: f64,
    /// Negative where a better solution than the fit's was met on the way.
    #[serde(with = "nullable")]
    pub fall: f64,
    /// Confidence intervals, the narrower first.
    pub intervals: Vec<ConfidenceIntervalV1>,
    /// Points in order of value.
    pub points: Vec<ProfilePointV1>,
}

/// Counterpart of [`ConfidenceInterval`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ConfidenceIntervalV1 {
    /// Confidence level, 0 to 1.
    #[serde(with = "nullable")]
    pub level: f64,
    /// Lower end.
    pub lower: LimitV1,
    /// Upper end.
    pub upper: LimitV1,
}

/// Counterpart of [`Limit`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LimitV1 {
    /// Value.
    #[serde(with = "nullable")]
    pub value: f64,
    /// `reached`; `bound` where a bound ends the profile below the level; `open` where it was not
    /// followed further.
    pub end: &'static str,
}

/// Counterpart of [`ProfilePoint`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProfilePointV1 {
    /// Value of the quantity.
    #[serde(with = "nullable")]
    pub value: f64,
    /// Rise of the misfit, in units in which 3.84 is the 95 % level.
    #[serde(with = "nullable")]
    pub rise: f64,
    /// The eight coordinates there.
    pub coordinates: Vec<f64>,
    /// Reactance on the motor's own base there.
    #[serde(with = "nullable")]
    pub x_motor_base: f64,
}

impl SiteProfileV1 {
    /// The document as JSON.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`]; no profile is known that causes it.
    pub fn to_json(&self) -> Result<String, DocumentError> {
        serde_json::to_string(self).map_err(|source| DocumentError::Malformed {
            document: "profile",
            source,
        })
    }
}

impl From<&SiteProfile> for SiteProfileV1 {
    fn from(found: &SiteProfile) -> Self {
        Self {
            v: VERSION,
            site: found.site.clone(),
            structure: found.structure.clone(),
            fitted_events: found.events.clone(),
            profiles: found.profiles.iter().map(ProfileV1::from).collect(),
        }
    }
}

impl From<&Profile> for ProfileV1 {
    fn from(profile: &Profile) -> Self {
        Self {
            parameter: profile.name.clone(),
            meaning: profile.meaning.clone(),
            unit: profile.unit.clone(),
            estimate: profile.estimate,
            standard_error: profile.standard_error,
            variance_factor: profile.variance_factor,
            fall: profile.fall,
            intervals: profile.intervals.iter().map(Into::into).collect(),
            points: profile.points.iter().map(Into::into).collect(),
        }
    }
}

impl From<&ConfidenceInterval> for ConfidenceIntervalV1 {
    fn from(interval: &ConfidenceInterval) -> Self {
        Self {
            level: interval.level,
            lower: interval.lower.into(),
            upper: interval.upper.into(),
        }
    }
}

impl From<Limit> for LimitV1 {
    fn from(limit: Limit) -> Self {
        Self {
            value: limit.value(),
            end: match limit {
                Limit::Reached(_) => "reached",
                Limit::Bound(_) => "bound",
                Limit::Open(_) => "open",
            },
        }
    }
}

impl From<&ProfilePoint> for ProfilePointV1 {
    fn from(point: &ProfilePoint) -> Self {
        Self {
            value: point.value,
            rise: point.rise,
            coordinates: point.coordinates.clone(),
            x_motor_base: point.x_motor_base,
        }
    }
}
