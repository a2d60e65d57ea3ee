//! How much the voltage moves besides its jumps, from the data: the larger, the less it is smoothed.

use super::voltage::{Jump, Measured, Voltage};

/// Third derivatives of ln|V| + j angle that are tried, 1/s^3: from a grid at rest to a swing at
/// 40 rad/s. Each is four times the one before.
const TRIED: [f64; 10] = [
    0.06, 0.25, 1.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0, 16384.0,
];
/// One value holds for this long, seconds ...
const BLOCK_S: f64 = 0.5;
/// ... and is judged over this much more on either side.
const MARGIN_S: f64 = 0.25;
/// What settles after a jump is left to the term of the jump, seconds.
const SETTLING_S: f64 = 0.1;
/// Fewest samples to judge by.
const SAMPLES_MIN: usize = 12;

/// Sets `measured.stiffness`, block by block, to what makes the data most probable. Where too
/// little is undisturbed by jumps it stays as it is.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "times of a window in samples"
)]
pub(super) fn estimate(measured: &mut Measured, jumps: &[Jump]) {
    let samples = |seconds: f64| (seconds / measured.interval_s).round() as usize;
    let (block, margin, settling) = (samples(BLOCK_S).max(1), samples(MARGIN_S), SETTLING_S);
    let last = measured.log.len() - 1;
    let reach = measured.half_width;
    let mut from = 0;
    for index in 0..=jumps.len() {
        let to = jumps.get(index).map_or(last, |jump| {
            (jump.position - reach).floor().max(0.0) as usize
        });
        if let Some(before) = index.checked_sub(1).map(|i| &jumps[i]) {
            let settled = before.position + reach + settling / measured.interval_s;
            from = (settled.ceil() as usize).min(last);
        }
        let mut start = from;
        while start <= to {
            let end = (start + block - 1).min(to);
            let range = (
                start.saturating_sub(margin).max(from),
                (end + margin).min(to),
            );
            if let Some(best) = most_probable(measured, range) {
                measured.stiffness[start..=end].fill(best);
            }
            start = end + 1;
        }
    }
}

fn most_probable(measured: &Measured, (from, to): (usize, usize)) -> Option<f64> {
    let good = (from..=to).filter(|&k| !measured.bad[k]).count();
    if good < SAMPLES_MIN {
        return None;
    }
    let mut local = Measured {
        log: measured.log[from..=to].to_vec(),
        bad: measured.bad[from..=to].to_vec(),
        stiffness: vec![0.0; to - from + 1],
        steep: measured.steep[from..to].to_vec(),
        ..measured.clone()
    };
    let mut best: Option<(f64, f64)> = None;
    for tried in TRIED {
        local.stiffness.fill(tried);
        if let Some(fit) = Voltage::fit(&local, (0, to - from), &[], None)
            && best.is_none_or(|b| fit.evidence < b.0)
        {
            best = Some((fit.evidence, tried));
        }
    }
    best.map(|b| b.1)
}
