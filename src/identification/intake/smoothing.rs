//! Adaptive smoothing of the terminal phasor and its reconstruction between samples.
//!
//! ln|V| + j angle is fitted by local quadratics over about +-0.1 s, over less where the quadratic
//! does not follow, and not at all where even the shortest window does not. A window never reaches
//! across an edge. Without this the noise of V and angle biases Kpm low: it is multiplied by
//! Kpm / X' inside the motor.

use super::{edges::Edge, series::Series};

/// Longest half window, seconds.
const HALF_WINDOW_S: f64 = 0.1;
/// A window is accepted while its residual stays below this multiple of the noise.
const RESIDUAL_LIMIT: f64 = 1.5;
/// Least noise assumed, so that noiseless data are smoothed where they are smooth.
const NOISE_LEAST: f64 = 2e-5;

/// Log-phasor of one sample: ln|V|, angle.
pub(super) type LogPhasor = [f64; 2];

/// Smooths within the runs between edges.
pub(super) fn smooth(
    raw: &[LogPhasor],
    series: &Series,
    at_edge: &[bool],
    noise: f64,
) -> Vec<LogPhasor> {
    let mut out = raw.to_vec();
    let mut start = 0;
    for k in 0..=at_edge.len() {
        let cut = k == at_edge.len() || at_edge[k];
        if cut {
            smooth_run(&mut out, raw, series, start..k + 1, noise.max(NOISE_LEAST));
            start = k + 1;
        }
    }
    out
}

fn smooth_run(
    out: &mut [LogPhasor],
    raw: &[LogPhasor],
    series: &Series,
    run: std::ops::Range<usize>,
    noise: f64,
) {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a tenth of a second holds between 1 and some thousand samples"
    )]
    let longest = ((HALF_WINDOW_S * series.rate_fps).round() as usize).max(3);
    let halves = [longest, (2 * longest) / 3, longest / 3, 2];
    for k in run.clone() {
        for half in halves {
            let from = k.saturating_sub(half).max(run.start);
            let to = (k + half + 1).min(run.end);
            let used: Vec<usize> = (from..to).filter(|&i| !series.bad[i]).collect();
            if used.len() < 5 {
                continue;
            }
            let Some((value, residual)) = local_quadratic(raw, &used, k, half) else {
                continue;
            };
            if residual < RESIDUAL_LIMIT * noise || series.bad[k] {
                out[k] = value;
                break;
            }
        }
    }
}

/// Least-squares quadratic through `used`, its value at `k`, and the residual deviation per part.
fn local_quadratic(
    raw: &[LogPhasor],
    used: &[usize],
    k: usize,
    half: usize,
) -> Option<(LogPhasor, f64)> {
    let x = |i: usize| (i as f64 - k as f64) / half.max(1) as f64;
    let mut gram = nalgebra::Matrix3::<f64>::zeros();
    let mut right = nalgebra::Matrix3x2::<f64>::zeros();
    for &i in used {
        let row = nalgebra::Vector3::new(1.0, x(i), x(i) * x(i));
        gram += row * row.transpose();
        right += row * nalgebra::RowVector2::new(raw[i][0], raw[i][1]);
    }
    let fit = gram.cholesky()?.solve(&right);
    let sum: f64 = used
        .iter()
        .map(|&i| {
            let row = nalgebra::RowVector3::new(1.0, x(i), x(i) * x(i));
            let model = row * fit;
            (raw[i][0] - model[0]).powi(2) + (raw[i][1] - model[1]).powi(2)
        })
        .sum();
    let freedom = 2.0 * (used.len() as f64 - 3.0).max(1.0);
    Some(([fit[(0, 0)], fit[(0, 1)]], (sum / freedom).sqrt()))
}

/// The phasor between samples: cubic in ln|V| and angle where neighbouring steps are ordinary; at an
/// edge, both sides extended to the instant of the jump; linear in a run of steps that is no single
/// jump. Returns real and imaginary parts, `points`
/// per sample interval.
///
/// The jump itself is spread over one fine interval, linearly, which keeps its time integral
/// whatever its place on the fine grid.
pub(super) fn reconstruct(
    smooth: &[LogPhasor],
    at_edge: &[bool],
    edges: &[Edge],
    points: usize,
) -> (Vec<f64>, Vec<f64>) {
    let n = smooth.len();
    let fine = n.saturating_sub(1) * points + 1;
    let (mut real, mut imaginary) = (Vec::with_capacity(fine), Vec::with_capacity(fine));
    let mut put = |[log, angle]: LogPhasor| {
        let v = log.exp();
        real.push(v * angle.cos());
        imaginary.push(v * angle.sin());
    };
    let mut next_edge = 0;
    for k in 0..n.saturating_sub(1) {
        while next_edge < edges.len() && edges[next_edge].right <= k {
            next_edge += 1;
        }
        let edge = edges.get(next_edge).filter(|e| e.left <= k);
        let (left, right) = (
            slope_at(smooth, at_edge, k),
            slope_at(smooth, at_edge, k + 1),
        );
        for j in 0..points {
            let x = j as f64 / points as f64;
            put(match edge {
                Some(edge) => across(smooth, edge, k as f64 + x, points),
                None if at_edge[k] => {
                    std::array::from_fn(|c| smooth[k][c] + x * (smooth[k + 1][c] - smooth[k][c]))
                }
                None => std::array::from_fn(|c| {
                    hermite(smooth[k][c], smooth[k + 1][c], left[c], right[c], x)
                }),
            });
        }
    }
    if let Some(last) = smooth.last() {
        put(*last);
    }
    (real, imaginary)
}

/// The log-phasor at time `t` (in samples) within an edge: parabolas through the three samples on
/// either side, extended to the jump.
fn across(smooth: &[LogPhasor], edge: &Edge, t: f64, points: usize) -> LogPhasor {
    let last = smooth.len() - 1;
    let low = parabola(
        smooth,
        [
            edge.left,
            edge.left.saturating_sub(1),
            edge.left.saturating_sub(2),
        ],
        t,
    );
    let high = parabola(
        smooth,
        [
            edge.right,
            (edge.right + 1).min(last),
            (edge.right + 2).min(last),
        ],
        t,
    );
    let share = ((t - edge.position) * points as f64 + 0.5).clamp(0.0, 1.0);
    [
        low[0] + share * (high[0] - low[0]),
        low[1] + share * (high[1] - low[1]),
    ]
}

/// Newton's interpolation through three samples; constant where two of them coincide.
fn parabola(smooth: &[LogPhasor], [a, b, c]: [usize; 3], t: f64) -> LogPhasor {
    if a == b || b == c {
        return smooth[a];
    }
    let x = |k: usize| k as f64;
    std::array::from_fn(|i| {
        let slope = |p: usize, q: usize| (smooth[q][i] - smooth[p][i]) / (x(q) - x(p));
        let curvature = (slope(b, c) - slope(a, b)) / (x(c) - x(a));
        smooth[a][i] + slope(a, b) * (t - x(a)) + curvature * (t - x(a)) * (t - x(b))
    })
}

/// Slope per sample at `k`: central where both neighbouring steps are ordinary, one-sided next to
/// an edge.
fn slope_at(smooth: &[LogPhasor], at_edge: &[bool], k: usize) -> LogPhasor {
    let step = |i: usize| {
        [
            smooth[i + 1][0] - smooth[i][0],
            smooth[i + 1][1] - smooth[i][1],
        ]
    };
    let left = (k > 0 && !at_edge[k - 1]).then(|| step(k - 1));
    let right = (k < at_edge.len() && !at_edge[k]).then(|| step(k));
    match (left, right) {
        (Some(a), Some(b)) => [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])],
        (Some(a), None) => a,
        (None, Some(b)) => b,
        (None, None) => [0.0, 0.0],
    }
}

fn hermite(a: f64, b: f64, slope_a: f64, slope_b: f64, x: f64) -> f64 {
    let (x2, x3) = (x * x, x * x * x);
    (2.0 * x3 - 3.0 * x2 + 1.0) * a
        + (x3 - 2.0 * x2 + x) * slope_a
        + (3.0 * x2 - 2.0 * x3) * b
        + (x3 - x2) * slope_b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reconstruction_passes_through_the_samples_and_follows_a_parabola() {
        let smooth: Vec<LogPhasor> = (0..8)
            .map(|k| [0.01 * f64::from(k * k), -0.02 * f64::from(k)])
            .collect();
        let (re, im) = reconstruct(&smooth, &[false; 7], &[], 4);
        let at = |i: usize| (re[i].hypot(im[i]).ln(), im[i].atan2(re[i]));
        assert!((at(12).0 - 0.09).abs() < 1e-12);
        // Half way between samples 3 and 4: (3.5)^2 * 0.01.
        assert!((at(14).0 - 0.1225).abs() < 1e-12);
        assert!((at(14).1 + 0.07).abs() < 1e-12);
    }

    #[test]
    fn an_edge_is_not_rounded_by_its_neighbours() {
        let smooth = [[0.0, 0.0], [0.0, 0.0], [-0.5, 0.0], [-0.5, 0.0]];
        let edge = Edge {
            left: 1,
            right: 2,
            position: 1.5,
        };
        let (re, _) = reconstruct(&smooth, &[false, true, false], &[edge], 4);
        assert!(re[..=5].iter().all(|v| (v - 1.0).abs() < 1e-12));
        assert!(re[7..].iter().all(|v| (v - (-0.5_f64).exp()).abs() < 1e-12));
    }
}
