//! Whether a fit holds on events it has not seen.

use super::{
    ChannelVerdict, ErrorSummary, Verdict, VerdictStatus,
    evaluate::{Curves, EventModel},
    intake::PreparedEvent,
};
use crate::load_model::composed::SimulationError;

/// Limits on largest error, mean error and mean absolute error of one segment, pu of P0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentLimits {
    /// Largest absolute error (MXE).
    pub largest: f64,
    /// Absolute value of the mean error (ME).
    pub mean: f64,
    /// Mean absolute error (MAE).
    pub mean_absolute: f64,
}

/// Settings of validation. Defaults of the limits: table of RTE's grid code I16 for models against
/// test data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValidationOptions {
    /// Before insertion and after clearing. Default .08, .04, .07.
    pub quiet: SegmentLimits,
    /// During the fault. Default .10, .05, .08.
    pub during: SegmentLimits,
    /// Time after insertion that is not judged, s. Default 0.02.
    pub excluded_after_insertion_s: f64,
    /// Time after clearing that is not judged, s. Default 0.06.
    pub excluded_after_clearing_s: f64,
    /// Held-out error over training error at most. Default 1.5.
    pub error_ratio_max: f64,
    /// Held-out errors below this multiple of the noise floor pass whatever the training error
    /// is. Default 1.5.
    pub noise_ratio_accepted: f64,
    /// Held-out errors of P and Q below this pass whatever the training error is, percent.
    /// Default 0.2: the accuracy class of good instrument transformers (IEC 61869).
    pub error_accepted_percent: f64,
    /// Slip before the disturbance at most. Default 0.2: ordinary motors run at 0.005 to 0.05, and
    /// far above that the fit uses the motor's equations for something that is no motor.
    pub slip_max: f64,
    /// Deepest fitted dip, relative to V0, below which the motor cannot be seen. Default 0.02.
    pub depth_min: f64,
}

impl Default for ValidationOptions {
    fn default() -> Self {
        Self {
            quiet: SegmentLimits {
                largest: 0.08,
                mean: 0.04,
                mean_absolute: 0.07,
            },
            during: SegmentLimits {
                largest: 0.10,
                mean: 0.05,
                mean_absolute: 0.08,
            },
            excluded_after_insertion_s: 0.02,
            excluded_after_clearing_s: 0.06,
            error_ratio_max: 1.5,
            noise_ratio_accepted: 1.5,
            error_accepted_percent: 0.2,
            slip_max: 0.2,
            depth_min: 0.02,
        }
    }
}

/// Everything validation looks at.
#[derive(Clone, Copy, Debug)]
pub struct Evidence<'a> {
    /// The model.
    pub model: &'a dyn EventModel,
    /// Largest change of the voltage in the events that it was fitted on, of V0.
    pub largest_change_fitted: f64,
    /// Events it was not fitted on.
    pub held_out: &'a [PreparedEvent],
    /// Errors on the fitted events.
    pub fit_errors: &'a ErrorSummary,
    /// Errors on the held-out events.
    pub held_out_errors: Option<&'a ErrorSummary>,
    /// Whether the motor share is determined by the data.
    pub motor_share_determined: bool,
    /// Slip of the motor before the disturbance, pu.
    pub slip: f64,
}

/// Judges a fit.
///
/// # Errors
///
/// [`SimulationError`] when the model cannot be simulated.
pub fn validate(
    evidence: &Evidence<'_>,
    options: &ValidationOptions,
) -> Result<Verdict, SimulationError> {
    let mut channels = Vec::new();
    for event in evidence.held_out {
        let curves = evidence.model.curves(event)?;
        channels.extend(channel_verdicts(event, &curves, options));
    }
    let Some(held_out) = evidence.held_out_errors.filter(|e| !e.events.is_empty()) else {
        let reason = "no held-out event: one event cannot prove a model fitted to it".to_owned();
        return Ok(Verdict {
            status: VerdictStatus::CannotJudge,
            reasons: vec![reason],
            channels,
        });
    };
    let cannot = objections_to_the_data(evidence, options);
    if !cannot.is_empty() {
        return Ok(Verdict {
            status: VerdictStatus::CannotJudge,
            reasons: cannot,
            channels,
        });
    }
    let failures = failures(evidence, held_out, &channels, options);
    let status = if failures.is_empty() {
        VerdictStatus::Pass
    } else {
        VerdictStatus::Fail
    };
    let reasons = if failures.is_empty() {
        vec![format!(
            "held-out error {:.2} % of P and {:.2} % of Q on {} event(s), {:.1} times the noise, \
             better than the static ZIP, within the segment limits",
            held_out.eps_p_percent,
            held_out.eps_q_percent,
            held_out.events.len(),
            held_out.error_to_noise
        )]
    } else {
        failures
    };
    Ok(Verdict {
        status,
        reasons,
        channels,
    })
}

/// Largest change of the voltage in `events`, of V0; 0 where there is none.
#[must_use]
pub fn largest_voltage_change(events: &[PreparedEvent]) -> f64 {
    let changes = (events.iter()).map(|e| (1.0 - e.lowest_voltage).max(e.highest_voltage - 1.0));
    changes.fold(0.0, f64::max)
}

fn objections_to_the_data(evidence: &Evidence<'_>, options: &ValidationOptions) -> Vec<String> {
    let mut reasons = Vec::new();
    let largest = evidence.largest_change_fitted;
    if largest < options.depth_min {
        reasons.push(format!(
            "the largest voltage change fitted is {:.2} % of V0: too small to see a motor",
            100.0 * largest
        ));
    }
    if !evidence.motor_share_determined {
        reasons.push("the data do not determine the motor share Kpm".to_owned());
    }
    reasons
}

fn failures(
    evidence: &Evidence<'_>,
    held_out: &ErrorSummary,
    channels: &[ChannelVerdict],
    options: &ValidationOptions,
) -> Vec<String> {
    let mut reasons = Vec::new();
    for c in channels.iter().filter(|c| !c.within_limits) {
        reasons.push(format!(
            "{} {} {}: largest {:.3}, mean {:.3}, mean absolute {:.3} pu of P0 exceed the limits",
            c.event, c.channel, c.segment, c.mxe_pu, c.me_pu, c.mae_pu
        ));
    }
    if evidence.slip > options.slip_max {
        reasons.push(format!(
            "implausible motor: slip {:.2} before the disturbance",
            evidence.slip
        ));
    }
    let pairs = [
        (
            "P",
            held_out.eps_p_percent,
            evidence.fit_errors.eps_p_percent,
        ),
        (
            "Q",
            held_out.eps_q_percent,
            evidence.fit_errors.eps_q_percent,
        ),
    ];
    for (channel, held, fitted) in pairs {
        let near_noise = held_out.error_to_noise <= options.noise_ratio_accepted;
        let small = held <= options.error_accepted_percent;
        if held > options.error_ratio_max * fitted && !near_noise && !small {
            reasons.push(format!(
                "held-out error of {channel} {held:.2} % is more than {} times the fit's {fitted:.2} %",
                options.error_ratio_max
            ));
        }
    }
    let total = |skill: fn(&super::EventErrors) -> f64| {
        held_out.events.iter().map(skill).sum::<f64>() / held_out.events.len() as f64
    };
    for (channel, skill) in [("P", total(|e| e.skill_p)), ("Q", total(|e| e.skill_q))] {
        if skill <= 0.0 && held_out.error_to_noise > options.noise_ratio_accepted {
            reasons.push(format!(
                "no better than the static ZIP on held-out {channel}: mean skill {skill:.2}"
            ));
        }
    }
    reasons
}

/// Sample range of a segment and its name.
struct Segment {
    name: &'static str,
    samples: std::ops::Range<usize>,
}

/// Before the event, during the fault and after clearing, without the times that are not judged.
/// An event without a fault (a step, a swing) has no "during".
fn segments(event: &PreparedEvent, options: &ValidationOptions) -> Vec<Segment> {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "tens of milliseconds hold a few samples"
    )]
    let samples = |seconds: f64| (seconds * event.rate_fps).ceil() as usize;
    let n = event.len();
    // The event part begins with the margin before the first edge: insertion is the first sample
    // that has left rest.
    let inserted = (event.event_start..n)
        .find(|&k| (event.voltage[k] - 1.0).abs() > 0.01)
        .unwrap_or(event.event_start);
    let mut list = vec![Segment {
        name: "before",
        samples: 0..event.event_start,
    }];
    let after_from = match clearing(event, inserted) {
        Some(cleared) => {
            let from = (inserted + samples(options.excluded_after_insertion_s)).min(cleared);
            list.push(Segment {
                name: "during",
                samples: from..cleared,
            });
            cleared + samples(options.excluded_after_clearing_s)
        }
        None => inserted + samples(options.excluded_after_insertion_s),
    };
    list.push(Segment {
        name: "after",
        samples: after_from.min(n)..n,
    });
    list
}

/// First sample after which a dip of at least 3 % has recovered by 70 %, if it did within 2 s.
fn clearing(event: &PreparedEvent, inserted: usize) -> Option<usize> {
    let v = &event.voltage;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "two seconds hold some hundred samples"
    )]
    let horizon = (inserted + (2.0 * event.rate_fps) as usize).min(v.len());
    let (lowest, depth) =
        (inserted..horizon)
            .map(|k| (k, 1.0 - v[k]))
            .fold(
                (inserted, 0.0),
                |best, next| if next.1 > best.1 { next } else { best },
            );
    if depth < 0.03 {
        return None;
    }
    (lowest..horizon).find(|&k| v[k] > 1.0 - 0.3 * depth)
}

fn channel_verdicts(
    event: &PreparedEvent,
    curves: &Curves,
    options: &ValidationOptions,
) -> Vec<ChannelVerdict> {
    let mut list = Vec::new();
    for segment in segments(event, options) {
        let limits = if segment.name == "during" {
            &options.during
        } else {
            &options.quiet
        };
        let pairs = [
            ("P", &event.active, &curves.active),
            ("Q", &event.reactive, &curves.reactive),
        ];
        for (channel, measured, modelled) in pairs {
            let errors: Vec<f64> = segment
                .samples
                .clone()
                // A phasor filter smears what lies within two cycles of an edge.
                .filter(|&k| event.used[k] && !event.near_edge[k])
                .map(|k| modelled[k] - measured[k])
                .collect();
            if errors.is_empty() {
                continue;
            }
            let count = errors.len() as f64;
            let mxe = errors.iter().fold(0.0_f64, |m, e| m.max(e.abs()));
            let me = (errors.iter().sum::<f64>() / count).abs();
            let mae = errors.iter().map(|e| e.abs()).sum::<f64>() / count;
            list.push(ChannelVerdict {
                event: event.id.clone(),
                channel,
                segment: segment.name,
                mxe_pu: mxe,
                me_pu: me,
                mae_pu: mae,
                within_limits: mxe <= limits.largest
                    && me <= limits.mean
                    && mae <= limits.mean_absolute,
            });
        }
    }
    list
}
