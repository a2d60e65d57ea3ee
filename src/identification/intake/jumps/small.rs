//! Jumps that stand out too little for an edge, as a capacitor leaves that is switched: taken where the voltage needs them.
//!
//! Behind a window of two cycles the steepest step of a jump is half to three quarters of it, by where the samples lie.
//! Smoothed over, such a jump leaves a spike of P and Q many times the noise.

use super::{
    AROUND, Jump, Located, MOTION_S, Measured, PhasorFilter, Voltage, candidates, cluster,
};

/// A jump is taken where without it this much more is left of the voltage around it. It makes two pieces of one, and so
/// takes seven squares of noise alone, of the steps that stand out more.
const NEEDED_SMALL: f64 = 40.0;

/// The small jumps that the voltage needs, away from steep steps and from each other, and what they and the steps that
/// are none leave of it. None is taken that only one or two samples hold, nor behind a longer window.
pub(super) fn located(measured: &Measured, steep: &[bool], small: &[bool]) -> (Vec<Located>, f64) {
    let apart = apart(measured);
    let is_clear = |k: usize| {
        let around = k.saturating_sub(apart)..(k + apart + 1).min(steep.len());
        !steep[around].contains(&true)
    };
    let steps: Vec<bool> = (0..small.len()).map(|k| small[k] && is_clear(k)).collect();
    let mut largest_first = candidates(measured, &steps);
    largest_first.sort_by(|a, b| b.size().total_cmp(&a.size()).then(a.anchor.cmp(&b.anchor)));
    let mut taken: Vec<Located> = Vec::new();
    let mut left = 0.0;
    for jump in largest_first {
        if taken
            .iter()
            .any(|other| other.jump.anchor.abs_diff(jump.anchor) <= apart)
        {
            continue;
        }
        let (own, squares) = with_or_without(measured, &jump);
        taken.extend(own);
        left += squares;
    }
    (taken, left)
}

/// Steps that a small jump is away from others: what is looked at of either does not meet.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a filter spans a handful of samples"
)]
fn apart(measured: &Measured) -> usize {
    let reach = measured.half_width.ceil() as usize;
    let motion = (MOTION_S / measured.interval_s).round() as usize;
    2 * reach + AROUND + motion
}

/// The jump where it is needed and explained, and what is left of the voltage around it.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a filter spans a handful of samples"
)]
fn with_or_without(measured: &Measured, jump: &Jump) -> (Option<Located>, f64) {
    let reach = measured.half_width.ceil() as usize;
    let last = measured.log.len() - 1;
    let range = (
        jump.anchor.saturating_sub(reach + AROUND),
        (jump.anchor + reach + AROUND + 1).min(last),
    );
    let without =
        Voltage::fit(measured, range, &[], None).map_or(f64::INFINITY, |fit| fit.objective);
    let is_standard = measured.filter != PhasorFilter::None && !measured.is_longer();
    if !is_standard || measured.has_short_window() {
        return (None, without);
    }
    let (found, left) = cluster(measured, range, std::slice::from_ref(jump));
    let found = found.into_iter().find(|own| own.explained);
    match found {
        Some(own) if left + NEEDED_SMALL <= without => (Some(own), left),
        _ => (None, without),
    }
}
