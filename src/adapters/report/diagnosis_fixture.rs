//! A diagnosis and an improvement for tests: an electronic load that drops out below 0.75 and comes
//! back 0.4 s after the clearing.

use super::fixture::parameter_set;
use crate::{
    diagnosis::{
        Candidate, ChannelSeries, Diagnosis, DiagnosisCost, EffectWorth, EventFailure, EventSeries,
        EventSets, Improvement, ImprovementStep, Status, StructureErrors, Unexplained,
        UnexplainedTerm, Untestable, failure_of_series, pooled,
    },
    identification::{ErrorSummary, ParameterEstimate},
    load_model::effect::Kind,
};

const RATE_FPS: f64 = 60.0;
const NOISE: f64 = 0.001;

/// An event with a dip to `lowest`; the model misses `missed` of P until 0.4 s after the clearing.
pub(crate) fn failure(event: &str, lowest: f64, missed: f64) -> EventFailure {
    let time_s: Vec<f64> = (0..600).map(|k| f64::from(k) / RATE_FPS - 1.0).collect();
    let voltage = |t: f64| match t {
        t if (0.03..0.18).contains(&t) => lowest,
        t if t >= 0.18 => 1.0 - 0.2 * (1.0 - lowest) * (-(t - 0.18) / 0.3).exp(),
        _ => 1.0,
    };
    let noise = |t: f64| NOISE * (1.4 * (t * 1234.5).sin());
    let series = |f: &dyn Fn(f64) -> f64| time_s.iter().map(|&t| f(t)).collect::<Vec<f64>>();
    let lost = |t: f64| {
        if (0.03..0.58).contains(&t) {
            missed
        } else {
            0.0
        }
    };
    let channel = |share: f64| ChannelSeries {
        measured: series(&|t| share * (voltage(t) - lost(t)) + noise(t)),
        model: series(&|t| share * voltage(t)),
        deviation: vec![NOISE; time_s.len()],
    };
    let edge = |t: f64| (t - 0.03).abs() < 0.034 || (t - 0.18).abs() < 0.034;
    failure_of_series(
        event,
        EventSeries {
            voltage: series(&voltage),
            frequency_deviation: series(&|t| -0.001 * t.max(0.0)),
            active: channel(1.0),
            reactive: channel(0.3),
            used: vec![true; time_s.len()],
            near_edge: time_s.iter().map(|&t| edge(t)).collect(),
            jumps_s: vec![0.03, 0.18],
            time_s,
        },
    )
}

fn failures(share: f64) -> Vec<EventFailure> {
    [
        ("event_01", 0.92, 0.0),
        ("event_02", 0.8, 0.01),
        ("event_03", 0.7, 0.05),
        ("event_04", 0.703, 0.055),
        ("event_05", 0.697, 0.06),
        ("event_06", 0.55, 0.09),
    ]
    .map(|(event, lowest, missed)| failure(event, lowest, share * missed))
    .into()
}

fn summary(error_to_noise: f64) -> ErrorSummary {
    ErrorSummary {
        eps_p_percent: 0.1 * error_to_noise,
        eps_q_percent: 0.3 * error_to_noise,
        error_to_noise,
        error_to_noise_away_from_edges: 0.9 * error_to_noise,
        events: Vec::new(),
    }
}

fn errors(error_to_noise: f64) -> StructureErrors {
    StructureErrors {
        fit: summary(0.95 * error_to_noise),
        gate: Some(summary(1.1 * error_to_noise)),
        untouched: Some(summary(error_to_noise)),
    }
}

fn candidate(effect: &str, delta_bic: Option<f64>, declared: bool) -> Candidate {
    let refused = vec!["held-out error falls by 1 % only".to_owned()];
    Candidate {
        effect: effect.to_owned(),
        kind: Kind::Physics,
        score_share: 0.83,
        visibility: 0.6,
        delta_bic,
        held_out_error_before: delta_bic.map(|_| 6.8),
        held_out_error_after: delta_bic.map(|_| 1.21),
        share_of_best_gain: delta_bic.map(|bic| (bic / -5210.0).min(1.0)),
        group: vec![
            "electronic_load_dropout".to_owned(),
            "self_disconnection".to_owned(),
        ],
        would_separate: "deeper dips, and one after which the load comes back late".to_owned(),
        separating_events: Vec::new(),
        parameters: vec![ParameterEstimate {
            name: "share".to_owned(),
            meaning: "share of the load that drops out".to_owned(),
            value: 0.113,
            unit: "1".to_owned(),
            lower: 0.0,
            upper: 1.0,
            standard_error: Some(0.004),
            at_bound: false,
            identifiable: true,
            interval: None,
        }],
        model: None,
        declared,
        refused: if declared { Vec::new() } else { refused },
    }
}

/// A diagnosis that declares an effect with a rival not to be told from it.
pub(crate) fn diagnosis() -> Diagnosis {
    let failures = failures(1.0);
    let names = |numbers: &[usize]| numbers.iter().map(|n| format!("event_{n:02}")).collect();
    Diagnosis {
        site: "site-<02>".to_owned(),
        structure: vec!["zip".to_owned(), "induction_motor".to_owned()],
        status: Status::MissingEffect,
        summary: "A load that drops out below 0.75 pu is missing.".to_owned(),
        reasons: vec!["the residual is 6.2 times the noise".to_owned()],
        events: EventSets {
            fit: names(&[1, 3, 6]),
            gate: names(&[2, 4]),
            untouched: names(&[5]),
            refused: vec![("event_07".to_owned(), "no power".to_owned())],
        },
        baseline: errors(6.2),
        noise_floor: 0.85,
        segments: pooled(&failures),
        failures,
        effects: vec![
            EffectWorth {
                effect: "stator_resistance".to_owned(),
                delta_bic_without: 412.0,
                untouched_without: Some(7.9),
                is_superfluous: false,
            },
            EffectWorth {
                effect: "time_skew".to_owned(),
                delta_bic_without: -5.6,
                untouched_without: Some(6.2),
                is_superfluous: true,
            },
        ],
        candidates: vec![
            candidate("electronic_load_dropout", Some(-5210.0), true),
            candidate("self_disconnection", Some(-5190.0), false),
            candidate("second_motor", None, false),
        ],
        answer_set: vec![
            "electronic_load_dropout".to_owned(),
            "self_disconnection".to_owned(),
        ],
        untestable: vec![Untestable {
            effect: "saturation".to_owned(),
            smallest_detectable_amplitude: 0.4,
            meaningful_amplitude: 0.02,
            amplitude: "share".to_owned(),
            unit: "1".to_owned(),
            needs: "events above 1.1 pu".to_owned(),
        }],
        unexplained: Some(Unexplained {
            signature: "P falls with the voltage and returns at once.".to_owned(),
            terms: vec![UnexplainedTerm {
                formula: "lag(v - 1, 0.2)".to_owned(),
                channel: "P",
                coefficient: 0.04,
                share: 0.7,
            }],
            effect_file: Some("dp = \"a*v\"\n".to_owned()),
            general_form: None,
        }),
        model: None,
        cost: DiagnosisCost::default(),
    }
}

/// One step that adds the effect.
pub(crate) fn improvement() -> Improvement {
    let first = diagnosis();
    let mut last = diagnosis();
    last.status = Status::Adequate;
    last.structure.push("electronic_load_dropout".to_owned());
    last.failures = failures(0.02);
    last.segments = pooled(&last.failures);
    last.candidates.clear();
    last.answer_set.clear();
    last.unexplained = None;
    let step =
        |structure: &[String], added: Option<&str>, error, parameter_count| ImprovementStep {
            structure: structure.to_vec(),
            added: added.map(str::to_owned),
            dropped: Vec::new(),
            reason: "the residual falls on events not fitted".to_owned(),
            errors: errors(error),
            failures: failures(if added.is_some() { 0.02 } else { 1.0 }),
            parameter_count,
            delta_bic: if added.is_some() { -5210.0 } else { 0.0 },
            set: parameter_set(),
        };
    Improvement {
        site: first.site.clone(),
        steps: vec![
            step(&first.structure, None, 6.2, 8),
            step(&last.structure, Some("electronic_load_dropout"), 1.1, 12),
        ],
        last,
        diagnoses: vec![first],
    }
}
