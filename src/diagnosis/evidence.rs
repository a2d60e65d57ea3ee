//! What speaks for an effect and what against it: figures in, objections with theirs out. No model here.

use super::options::ClaimOptions;

/// Weighted squares per row on the gate's events, not fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GateEvidence {
    pub(super) before: f64,
    pub(super) after: f64,
}

/// What speaks for one effect.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Evidence {
    /// The instrument, with an error of a size that instruments have: it is the simpler cause.
    pub(super) blamed_first: bool,
    /// Change of the criterion on all judged events.
    pub(super) delta_bic: f64,
    /// Weighted squares per row without it ...
    pub(super) chi_square_before: f64,
    /// ... and with it.
    pub(super) chi_square_after: f64,
    /// It acts in parts between two voltages that no event's lowest one lies between.
    pub(super) unseen_span: bool,
    /// Amplitude over the smallest meaningful one.
    pub(super) amplitude_over_meaningful: f64,
    /// The amplitude that is known best over its stated error; none where none has one, or where that was not asked.
    pub(super) amplitude_over_error: Option<f64>,
    /// An amplitude or shape lies on a bound.
    pub(super) at_bound: bool,
    /// Weighted squares with it.
    pub(super) squares_after: f64,
    /// Against the gate; none where there is none.
    pub(super) gate: Option<GateEvidence>,
    /// Against every event that others surround, foretold in turn; none where the gate alone was asked.
    pub(super) in_turn: Option<GateEvidence>,
    /// What the gating events add to the least misfit of the others, per row of theirs, which by themselves support the
    /// effect; none where they do not, or where that was not asked.
    pub(super) joined: Option<GateEvidence>,
    /// What the criterion gains by the best other effect, over what it gains by this one; where this one leaves next to
    /// nothing of what that one leaves, the share of it.
    pub(super) runner_up: f64,
    /// How much P follows the frequency by it, over what it does by every motor; none where it is no dependence on the
    /// frequency that could be taken for that.
    pub(super) times_every_motor: Option<f64>,
}

impl Evidence {
    /// Whether no other effect comes near.
    pub(super) fn stands_out(&self, options: &ClaimOptions) -> bool {
        self.runner_up <= options.distinct_runner_up
    }

    /// Whether the model follows the events already, the held-out ones too.
    fn is_followed(&self, options: &ClaimOptions) -> bool {
        let adequate = |g: GateEvidence| is_adequate(g.before, options);
        is_adequate(self.chi_square_before, options) && self.gate.is_none_or(adequate)
    }

    /// Whether it does as well as the noise allows.
    pub(super) fn at_floor(&self, options: &ClaimOptions) -> bool {
        self.chi_square_before <= options.floor && self.is_followed(options)
    }

    /// Whether it lowers the misfit as no other effect does, and by far more than a claim needs.
    pub(super) fn is_overwhelming(&self, options: &ClaimOptions) -> bool {
        self.stands_out(options) && self.is_evident(options)
    }

    /// Whether the fitted events alone leave no doubt that it explains something.
    fn is_evident(&self, options: &ClaimOptions) -> bool {
        self.delta_bic <= -options.evident_delta_bic
            && fall(self.chi_square_before, self.chi_square_after) >= options.evident_fall
    }

    /// Whether it is small beside the noise that is assumed, but clear, and no other effect comes near: all events in turn
    /// may confirm it where the held-out ones by themselves do not.
    pub(super) fn may_be_confirmed(&self, options: &ClaimOptions) -> bool {
        self.is_followed(options)
            && self.stands_out(options)
            && self.delta_bic <= -options.confirmed_delta_bic
    }

    /// Whether events that it was not fitted to confirm what is small beside the noise that is assumed. What others come
    /// nearer to is not.
    fn is_confirmed(&self, options: &ClaimOptions) -> bool {
        let falls =
            |gate: GateEvidence| fall(gate.before, gate.after) >= options.confirmed_fall_min;
        self.is_followed(options)
            && self.delta_bic <= -options.confirmed_delta_bic
            && self.runner_up <= CONFIRMED_RUNNER_UP
            && self.gate.is_some_and(falls)
    }

    /// Whether the held-out events have nothing to show: they are followed already, while the fitted ones
    /// are far from it, or hold next to nothing of what is left there. What has a threshold may not have operated
    /// in any of them, and what they do leave may be something else's.
    fn gate_is_silent(&self, gate: GateEvidence, options: &ClaimOptions) -> bool {
        let little = gate.before < SILENT_SHARE * self.chi_square_before;
        !is_adequate(self.chi_square_before, options)
            && (is_adequate(gate.before, options) || little)
    }
}

/// What is confirmed gains no less than the best other effect gains divided by this: rivals are confirmed too.
const CONFIRMED_RUNNER_UP: f64 = 1.25;
/// Held-out events that leave less than this share of what the fitted ones leave show nothing of it.
const SILENT_SHARE: f64 = 0.02;
/// Where they fall by this many times what a claim needs, they are not silent after all.
const SILENT_FALLS: f64 = 2.0;

/// A dependence on the frequency that is so many times that of every motor is one of its own.
const MORE_THAN_EVERY_MOTOR: f64 = 1.5;

/// At the floor an amplitude is so many stated errors.
const KNOWN_AMPLITUDE: f64 = 3.0;

/// A model that leaves less than this many times the floor is adequate.
pub(super) const ADEQUATE_FLOORS: f64 = 2.0;

/// Whether what a model leaves counts as adequate, unless events depart from it for a while.
pub(super) fn is_adequate(chi_square: f64, options: &ClaimOptions) -> bool {
    chi_square < ADEQUATE_FLOORS * options.floor
}

/// Share by which a value falls. What cannot be simulated has an infinite misfit.
fn fall(before: f64, after: f64) -> f64 {
    if !after.is_finite() {
        -1.0
    } else if before.is_infinite() {
        1.0
    } else if before > 0.0 {
        (before - after) / before
    } else {
        -1.0
    }
}

/// In words that a value falls, rises, or has become infinite.
fn moves(before: f64, after: f64) -> String {
    let percent = 100.0 * fall(before, after);
    if !after.is_finite() {
        "has become infinite".to_owned()
    } else if percent < 0.0 {
        format!("rises by {:.1} %", -percent)
    } else {
        format!("falls by {percent:.1} %")
    }
}

/// Share by which a claim lowers the weighted squares of the fitted events.
fn needed_fall(evidence: &Evidence, options: &ClaimOptions) -> f64 {
    if !evidence.at_floor(options) {
        options.fall_min
    } else if evidence.stands_out(options) {
        options.distinct_fall_min
    } else if evidence.is_confirmed(options) {
        options.confirmed_fall_min
    } else {
        options.fall_min_at_floor
    }
}

/// The same of the held-out events. Where they are followed, an effect that stands out needs no more there
/// than of the fitted ones, and one that lowers the criterion by far in these next to nothing: the held-out ones may be
/// mild.
fn needed_held_out_fall(evidence: &Evidence, options: &ClaimOptions) -> f64 {
    if !evidence.is_followed(options) {
        options.held_out_fall_min
    } else if evidence.delta_bic <= -options.evident_delta_bic {
        options.evident_held_out_fall_min
    } else if evidence.is_confirmed(options) {
        options.confirmed_fall_min
    } else if evidence.stands_out(options) {
        needed_fall(evidence, options)
    } else {
        options.held_out_fall_min
    }
}

/// Whether nothing but the gate speaks against an effect.
pub(super) fn is_refused_by_gate_alone(evidence: &Evidence, options: &ClaimOptions) -> bool {
    let refused = objections(evidence, options);
    let of_gate = evidence
        .gate
        .and_then(|gate| of_the_gate(evidence, gate, options));
    of_gate.is_some() && refused.len() == 1
}

/// Why this effect may not be declared, each with its figure; empty when it may.
pub(super) fn objections(evidence: &Evidence, options: &ClaimOptions) -> Vec<String> {
    let mut list = Vec::new();
    if evidence.delta_bic > -options.delta_bic_min {
        list.push(format!(
            "the criterion changes by {:.0}; a claim needs -{:.0}",
            evidence.delta_bic, options.delta_bic_min
        ));
    }
    let own = fall(evidence.chi_square_before, evidence.chi_square_after);
    let needed = needed_fall(evidence, options);
    if own < needed {
        list.push(format!(
            "the misfit of the fitted events {}; a claim needs a fall by {:.0} %",
            moves(evidence.chi_square_before, evidence.chi_square_after),
            100.0 * needed
        ));
    }
    if evidence.amplitude_over_meaningful < 1.0 {
        list.push(format!(
            "its amplitude is {:.2} of the smallest one worth reporting",
            evidence.amplitude_over_meaningful
        ));
    }
    list.extend(as_every_motor_does(evidence, options));
    list.extend(hardly_known(evidence, options));
    list.extend(
        evidence
            .gate
            .and_then(|gate| of_the_gate(evidence, gate, options)),
    );
    list
}

/// At the floor what every motor does at another frequency shows as well, and what is no more than that is no effect of its
/// own.
fn as_every_motor_does(evidence: &Evidence, options: &ClaimOptions) -> Option<String> {
    let times = evidence.times_every_motor?;
    let alike = (0.0..MORE_THAN_EVERY_MOTOR).contains(&times);
    (alike && evidence.at_floor(options)).then(|| {
        format!(
            "P follows the frequency by it {times:.1} times as much as by every motor; a claim needs {MORE_THAN_EVERY_MOTOR} times"
        )
    })
}

/// At the floor what bends to the model's own errors lowers the misfit as well, but its size is not known.
fn hardly_known(evidence: &Evidence, options: &ClaimOptions) -> Option<String> {
    let times = evidence.amplitude_over_error?;
    (times < KNOWN_AMPLITUDE && evidence.at_floor(options)).then(|| {
        format!(
            "its amplitude is {times:.1} times its stated error; where the model leaves no more than the noise a claim needs {KNOWN_AMPLITUDE} times"
        )
    })
}

/// What the gate says against an effect.
fn of_the_gate(evidence: &Evidence, gate: GateEvidence, options: &ClaimOptions) -> Option<String> {
    let held_out = fall(gate.before, gate.after);
    let needed = needed_held_out_fall(evidence, options);
    // What single events leave open, all of them in turn may not, nor the gating ones joined to the others.
    let falls_by = |share: f64| move |g: GateEvidence| fall(g.before, g.after) >= share;
    let foretold = (evidence.in_turn).is_some_and(falls_by(options.held_out_fall_min))
        || evidence.joined.is_some_and(falls_by(needed));
    let is_silent = evidence.gate_is_silent(gate, options);
    if is_silent {
        let speaks = held_out >= SILENT_FALLS * options.held_out_fall_min;
        let left = left_share(evidence, options);
        if !speaks && left > options.silent_left_share {
            return Some(format!(
                "the held-out events show nothing of it, and of what the fitted ones show it leaves {:.0} %; a claim needs at most {:.0} %",
                100.0 * left,
                100.0 * options.silent_left_share
            ));
        }
    } else if !(evidence.is_followed(options) && evidence.is_evident(options)) {
        return (held_out < needed && !foretold).then(|| {
            format!(
                "the misfit of the held-out events {}; a claim needs a fall by {:.0} %",
                moves(gate.before, gate.after),
                100.0 * needed
            )
        });
    }
    // They may not excite it at all, and need only stay followed. Not for NaN, either.
    let kept = is_adequate(gate.after, options) || gate.after <= gate.before;
    (!kept && !foretold).then(|| {
        format!(
            "the held-out events, followed without it ({:.2} per sample), are not with it ({:.2})",
            gate.before, gate.after
        )
    })
}

/// What is left above the floor, as a share of what was.
fn left_share(evidence: &Evidence, options: &ClaimOptions) -> f64 {
    let left = (evidence.chi_square_after - options.floor).max(0.0);
    left / (evidence.chi_square_before - options.floor).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
pub(super) mod tests;
