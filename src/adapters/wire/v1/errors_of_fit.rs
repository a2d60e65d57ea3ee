//! Errors of a model against measurements (design, section 11).

use serde::{Deserialize, Serialize};

use super::json::nullable;
use crate::identification::{ErrorSummary, EventErrors};

/// Counterpart of [`ErrorSummary`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorSummaryV1 {
    /// As [`ErrorSummary::eps_p_percent`].
    #[serde(with = "nullable")]
    pub eps_p_percent: f64,
    /// As [`ErrorSummary::eps_q_percent`].
    #[serde(with = "nullable")]
    pub eps_q_percent: f64,
    /// As [`ErrorSummary::error_to_noise`].
    #[serde(with = "nullable")]
    pub error_to_noise: f64,
    /// As [`ErrorSummary::error_to_noise_away_from_edges`].
    #[serde(with = "nullable")]
    pub error_to_noise_away_from_edges: f64,
    /// Event by event.
    pub events: Vec<EventErrorsV1>,
}

/// Counterpart of [`EventErrors`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EventErrorsV1 {
    /// Event.
    pub event: String,
    /// As [`EventErrors::eps_p_percent`].
    #[serde(with = "nullable")]
    pub eps_p_percent: f64,
    /// As [`EventErrors::eps_q_percent`].
    #[serde(with = "nullable")]
    pub eps_q_percent: f64,
    /// As [`EventErrors::event_eps_p_percent`].
    #[serde(with = "nullable")]
    pub event_eps_p_percent: f64,
    /// As [`EventErrors::event_eps_q_percent`].
    #[serde(with = "nullable")]
    pub event_eps_q_percent: f64,
    /// As [`EventErrors::event_q_to_s0_percent`].
    #[serde(with = "nullable")]
    pub event_q_to_s0_percent: f64,
    /// As [`EventErrors::skill_p`].
    #[serde(with = "nullable")]
    pub skill_p: f64,
    /// As [`EventErrors::skill_q`].
    #[serde(with = "nullable")]
    pub skill_q: f64,
    /// As [`EventErrors::skill_over_constant_p`].
    #[serde(with = "nullable")]
    pub skill_over_constant_p: f64,
    /// As [`EventErrors::skill_over_constant_q`].
    #[serde(with = "nullable")]
    pub skill_over_constant_q: f64,
    /// As [`EventErrors::error_to_noise`].
    #[serde(with = "nullable")]
    pub error_to_noise: f64,
    /// As [`EventErrors::error_to_noise_away_from_edges`].
    #[serde(with = "nullable")]
    pub error_to_noise_away_from_edges: f64,
    /// As [`EventErrors::lowest_voltage`].
    #[serde(with = "nullable")]
    pub lowest_voltage: f64,
}

impl From<&ErrorSummary> for ErrorSummaryV1 {
    fn from(summary: &ErrorSummary) -> Self {
        Self {
            eps_p_percent: summary.eps_p_percent,
            eps_q_percent: summary.eps_q_percent,
            error_to_noise: summary.error_to_noise,
            error_to_noise_away_from_edges: summary.error_to_noise_away_from_edges,
            events: summary.events.iter().map(EventErrorsV1::from).collect(),
        }
    }
}

impl From<ErrorSummaryV1> for ErrorSummary {
    fn from(summary: ErrorSummaryV1) -> Self {
        Self {
            eps_p_percent: summary.eps_p_percent,
            eps_q_percent: summary.eps_q_percent,
            error_to_noise: summary.error_to_noise,
            error_to_noise_away_from_edges: summary.error_to_noise_away_from_edges,
            events: summary.events.into_iter().map(EventErrors::from).collect(),
        }
    }
}

impl From<&EventErrors> for EventErrorsV1 {
    fn from(errors: &EventErrors) -> Self {
        Self {
            event: errors.event.clone(),
            eps_p_percent: errors.eps_p_percent,
            eps_q_percent: errors.eps_q_percent,
            event_eps_p_percent: errors.event_eps_p_percent,
            event_eps_q_percent: errors.event_eps_q_percent,
            event_q_to_s0_percent: errors.event_q_to_s0_percent,
            skill_p: errors.skill_p,
            skill_q: errors.skill_q,
            skill_over_constant_p: errors.skill_over_constant_p,
            skill_over_constant_q: errors.skill_over_constant_q,
            error_to_noise: errors.error_to_noise,
            error_to_noise_away_from_edges: errors.error_to_noise_away_from_edges,
            lowest_voltage: errors.lowest_voltage,
        }
    }
}

impl From<EventErrorsV1> for EventErrors {
    fn from(errors: EventErrorsV1) -> Self {
        Self {
            event: errors.event,
            eps_p_percent: errors.eps_p_percent,
            eps_q_percent: errors.eps_q_percent,
            event_eps_p_percent: errors.event_eps_p_percent,
            event_eps_q_percent: errors.event_eps_q_percent,
            event_q_to_s0_percent: errors.event_q_to_s0_percent,
            skill_p: errors.skill_p,
            skill_q: errors.skill_q,
            skill_over_constant_p: errors.skill_over_constant_p,
            skill_over_constant_q: errors.skill_over_constant_q,
            error_to_noise: errors.error_to_noise,
            error_to_noise_away_from_edges: errors.error_to_noise_away_from_edges,
            lowest_voltage: errors.lowest_voltage,
        }
    }
}
