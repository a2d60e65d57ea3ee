//! Which terms are tried on these events.

use super::term::{QUICK_DELAY_S, Term};
use crate::identification::{evaluate::Curves, intake::PreparedEvent};

/// Exponents beside 1 and 2, which the model has.
const EXPONENTS: [f64; 4] = [0.5, 3.0, 5.0, 8.0];
/// Thresholds, pu of V0.
const THRESHOLDS: [f64; 13] = [
    0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.84, 0.88, 0.91, 0.94,
];
const EXCESS_THRESHOLDS: [f64; 3] = [1.01, 1.03, 1.06];
/// Delays of relays, s.
const DELAYS_S: [f64; 3] = [QUICK_DELAY_S, 0.05, 0.12];
/// Times after which load has come back, s.
const RETURN_TIMES_S: [f64; 6] = [0.2, 0.5, 1.0, 2.0, 5.0, 12.0];
/// Time constants of lags, s.
const LAG_TIMES_S: [f64; 11] = [
    0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.7, 1.5, 4.0, 12.0, 40.0,
];
/// Time constants of lags of the frequency, s.
const FREQUENCY_TIMES_S: [f64; 3] = [0.2, 0.8, 3.0];
/// A threshold counts as crossed from this far below it, pu.
const CROSSED_BY: f64 = 0.01;
/// Longest time, of the window.
const TIME_OF_WINDOW: f64 = 2.0;

/// The terms that differ from nothing in some event.
pub(super) fn terms(events: &[(&PreparedEvent, &Curves)]) -> Vec<Term> {
    let lowest = events.iter().map(|(e, _)| e.lowest_voltage);
    let lowest = lowest.fold(f64::INFINITY, f64::min);
    let highest = events.iter().map(|(e, _)| e.highest_voltage);
    let highest = highest.fold(0.0, f64::max);
    let windows = events.iter().map(|(e, _)| e.len() as f64 / e.rate_fps);
    let longest_s = TIME_OF_WINDOW * windows.fold(0.0, f64::max);
    let thresholds = || THRESHOLDS.into_iter().filter(|t| lowest < t - CROSSED_BY);
    let mut terms: Vec<Term> = Vec::new();
    terms.extend(EXPONENTS.map(|exponent| Term::Power { exponent }));
    terms.extend(thresholds().map(|threshold| Term::Deficit { threshold }));
    let exceeded = EXCESS_THRESHOLDS.into_iter();
    let exceeded = exceeded.filter(|t| highest > t + CROSSED_BY);
    terms.extend(exceeded.map(|threshold| Term::Excess { threshold }));
    terms.extend(thresholds().map(|threshold| Term::Below { threshold }));
    let lags = LAG_TIMES_S.into_iter().filter(|t| *t < longest_s);
    terms.extend(lags.map(|time_s| Term::Lag { time_s }));
    terms.push(Term::Frequency);
    terms.extend(FREQUENCY_TIMES_S.map(|time_s| Term::FrequencyLag { time_s }));
    for delay_s in DELAYS_S {
        terms.extend(thresholds().map(|threshold| Term::Lost { threshold, delay_s }));
        terms.extend(thresholds().map(|threshold| Term::LostImpedance { threshold, delay_s }));
    }
    for time_s in RETURN_TIMES_S.into_iter().filter(|t| *t < longest_s) {
        terms.extend(thresholds().map(|threshold| Term::LostRamp { threshold, time_s }));
        terms.extend(thresholds().map(|threshold| Term::LostDecay { threshold, time_s }));
    }
    terms.extend(thresholds().map(|threshold| Term::Memory { threshold }));
    terms.push(Term::Drift);
    terms
}
