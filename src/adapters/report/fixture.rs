//! Comparisons and a parameter set for the tests of the report: an exponential answer to a
//! rectangular dip, and a model that misses a little of it.

use crate::identification::{
    Bases, Comparison, ErrorSummary, EventErrors, Judgement, OperatingPoint, ParameterEstimate,
    ParameterSet, Verdict, VerdictStatus,
};

const RATE_FPS: f64 = 60.0;
const ONSET_S: f64 = 1.5;
const DIP_S: f64 = 0.2;
const NOISE_PU: f64 = 0.001;

/// An event of 10 s with a dip to `lowest` from 0 s to 0.2 s.
pub(crate) fn comparison(event: &str, lowest: f64) -> Comparison {
    let time_s: Vec<_> = (0..600)
        .map(|k| f64::from(k) / RATE_FPS - ONSET_S)
        .collect();
    let within = |t: f64| (0.0..DIP_S).contains(&t);
    let noise = |t: f64| NOISE_PU * (t * 1234.5).sin();
    let answer = |t: f64| {
        if t < DIP_S {
            0.0
        } else {
            (-(t - DIP_S) / 0.3).exp()
        }
    };
    let per_sample = |f: &dyn Fn(f64) -> f64| time_s.iter().map(|&t| f(t)).collect::<Vec<_>>();
    let active = |t: f64| {
        if within(t) {
            0.9 * lowest
        } else {
            0.9 + 0.2 * answer(t)
        }
    };
    let reactive = |t: f64| 0.5 * active(t) - 0.1;
    let dipped = |t: f64| if within(t) { lowest } else { 1.0 };
    Comparison {
        event: event.to_owned(),
        onset_ns: 1_775_797_861_500_000_000,
        voltage_pu: per_sample(&dipped),
        frequency_hz: per_sample(&|t| 60.0 - 0.05 * answer(t)),
        active_measured_pu: per_sample(&|t| active(t) + noise(t)),
        active_model_pu: per_sample(&|t| active(t) + 0.01 * answer(t)),
        reactive_measured_pu: per_sample(&|t| reactive(t) + noise(t)),
        reactive_model_pu: per_sample(&reactive),
        active_noise_pu: vec![NOISE_PU; time_s.len()],
        reactive_noise_pu: vec![NOISE_PU; time_s.len()],
        used: vec![true; time_s.len()],
        near_edge: time_s
            .iter()
            .map(|t| t.abs() < 0.034 || (t - DIP_S).abs() < 0.034)
            .collect(),
        errors: errors(event, lowest),
        time_s,
    }
}

/// An event of which nothing is left.
pub(crate) fn without_samples(event: &str) -> Comparison {
    Comparison {
        event: event.to_owned(),
        onset_ns: 0,
        time_s: Vec::new(),
        voltage_pu: Vec::new(),
        frequency_hz: Vec::new(),
        active_measured_pu: Vec::new(),
        active_model_pu: Vec::new(),
        reactive_measured_pu: Vec::new(),
        reactive_model_pu: Vec::new(),
        active_noise_pu: Vec::new(),
        reactive_noise_pu: Vec::new(),
        used: Vec::new(),
        near_edge: Vec::new(),
        errors: errors(event, f64::NAN),
    }
}

fn errors(event: &str, lowest_voltage: f64) -> EventErrors {
    EventErrors {
        event: event.to_owned(),
        eps_p_percent: 0.21,
        eps_q_percent: 0.62,
        event_eps_p_percent: 0.25,
        event_eps_q_percent: 0.71,
        event_q_to_s0_percent: 0.22,
        skill_p: 0.97,
        skill_q: 0.91,
        skill_over_constant_p: 0.99,
        skill_over_constant_q: 0.98,
        error_to_noise: 2.1,
        error_to_noise_away_from_edges: 1.1,
        lowest_voltage,
    }
}

/// A set fitted on `event_01` and `event_02` and validated on `event_03`.
pub(crate) fn parameter_set() -> ParameterSet {
    let summary = |events: &[&str]| ErrorSummary {
        eps_p_percent: 0.21,
        eps_q_percent: 0.62,
        error_to_noise: 2.1,
        error_to_noise_away_from_edges: 1.1,
        events: events.iter().map(|event| errors(event, 0.8)).collect(),
    };
    ParameterSet {
        site: "site-<02>".to_owned(),
        version: 3,
        structure: vec!["zip".to_owned(), "induction_motor".to_owned()],
        structure_versions: vec![1, 1],
        parameters: vec![
            estimate("M", "inertia", 0.0021, true),
            ParameterEstimate {
                standard_error: None,
                identifiable: false,
                interval: Some((0.9, 3.1)),
                ..estimate("X", "open-circuit reactance", 1.7, false)
            },
        ],
        derived: vec![estimate(
            "H",
            "inertia constant on the motor's base",
            0.61,
            false,
        )],
        bases: Bases {
            s_base_mva: 200.0,
            v_base_kv: 23.0,
            nominal_hz: 60.0,
        },
        operating_point: OperatingPoint {
            v0_pu: 0.993,
            p0_pu: 0.9,
            q0_pu: 0.275,
        },
        fitted_events: vec!["event_01".to_owned(), "event_02".to_owned()],
        held_out_events: vec!["event_03".to_owned()],
        fit: summary(&["event_01", "event_02"]),
        held_out: Some(summary(&["event_03"])),
        verdict: Verdict {
            status: VerdictStatus::Pass,
            reasons: vec!["held-out error 1.04 x the error in the fit".to_owned()],
            channels: Vec::new(),
        },
        rank: 8,
        condition: 412.0,
        inflation: Vec::new(),
        notes: Vec::new(),
        software_version: "0.1.0".to_owned(),
    }
}

/// What [`parameter_set`] shows on the events of its own fit.
pub(crate) fn judgement() -> Judgement {
    let set = parameter_set();
    Judgement {
        site: set.site,
        fitted: Some(set.fit),
        held_out: set.held_out,
        others: None,
        verdict: set.verdict,
        warnings: Vec::new(),
    }
}

fn estimate(name: &str, meaning: &str, value: f64, at_bound: bool) -> ParameterEstimate {
    ParameterEstimate {
        name: name.to_owned(),
        meaning: meaning.to_owned(),
        value,
        unit: "1".to_owned(),
        lower: 0.001,
        upper: 4.0,
        standard_error: Some(0.01 * value),
        at_bound,
        identifiable: true,
        interval: None,
    }
}
