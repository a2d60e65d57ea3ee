//! How far a model is from a measurement: the numbers every report quotes.

/// Errors of one event.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EventErrors {
    /// Event identifier (window id, or file stem of a site folder).
    pub event: String,
    /// `100 sqrt(sum (y_m - y)^2 / sum y_m^2)` of P, percent, as in the paper's Tables 1 and 3.
    pub eps_p_percent: f64,
    /// The same of Q.
    pub eps_q_percent: f64,
    /// The same of P over the event part of the window (from the onset on).
    pub event_eps_p_percent: f64,
    /// The same of Q over the event part.
    pub event_eps_q_percent: f64,
    /// Root mean square error of Q over the event part relative to S0, percent.
    pub event_q_to_s0_percent: f64,
    /// `1 - (error / error of the best static ZIP)^2` of P over the event part: above 0 the
    /// dynamic model earns its place.
    pub skill_p: f64,
    /// The same of Q.
    pub skill_q: f64,
    /// `1 - (error / error of a constant)^2` of P over the event part.
    pub skill_over_constant_p: f64,
    /// The same of Q.
    pub skill_over_constant_q: f64,
    /// Root mean square of residual over noise floor, both channels, event part.
    pub error_to_noise: f64,
    /// The same without the samples within two cycles of a voltage edge.
    pub error_to_noise_away_from_edges: f64,
    /// Lowest voltage of the event, pu of the pre-event voltage.
    pub lowest_voltage: f64,
}

/// Errors of a set of events.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ErrorSummary {
    /// As [`EventErrors::eps_p_percent`], over all samples of all events.
    pub eps_p_percent: f64,
    /// As [`EventErrors::eps_q_percent`], over all samples of all events.
    pub eps_q_percent: f64,
    /// Root mean square of residual over noise floor over all events, event parts.
    pub error_to_noise: f64,
    /// The same without the samples within two cycles of a voltage edge.
    pub error_to_noise_away_from_edges: f64,
    /// Event by event, in the order of the data.
    pub events: Vec<EventErrors>,
}
