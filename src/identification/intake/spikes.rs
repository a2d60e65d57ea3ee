//! Isolated spikes: one sample that both its neighbours contradict while they agree with each
//! other. A voltage spike that P and Q do not follow, or a P or Q spike that V does not follow, is
//! a fault of the instrument.

use super::series::{Series, noise_sigma};

/// A spike stands out by this many noise deviations plus [`SPIKE_LEAST`]. Chosen: far above noise.
const SPIKE_SIGMAS: f64 = 12.0;
/// Least height of a spike, relative to the channel's size.
const SPIKE_LEAST: f64 = 0.03;
/// The neighbours agree to within this share of the spike.
const NEIGHBOURS_AGREE: f64 = 0.35;
/// A voltage change above this explains a change of P or Q.
const VOLTAGE_EXPLAINS: f64 = 0.02;

/// Marks spikes as bad and bridges them; returns how many.
pub(super) fn remove(series: &mut Series) -> usize {
    let n = series.len();
    let size = |x: &[f64]| {
        let magnitudes: Vec<f64> = x.iter().map(|y| y.abs()).collect();
        super::series::median(&magnitudes).max(1e-6)
    };
    let active_size = size(&series.active).max(size(&series.reactive));
    let voltage_size = size(&series.voltage);
    let mut spikes = Vec::new();
    for k in 1..n.saturating_sub(1) {
        if series.bad[k - 1] || series.bad[k] || series.bad[k + 1] {
            continue;
        }
        let voltage_moves = moves(&series.voltage, k);
        let power_moves = moves(&series.active, k).max(moves(&series.reactive, k)) / active_size;
        let in_voltage = stands_out(&series.voltage, k, voltage_size);
        let in_power = stands_out(&series.active, k, active_size)
            || stands_out(&series.reactive, k, active_size);
        if (in_power && voltage_moves < VOLTAGE_EXPLAINS)
            || (in_voltage && power_moves < 0.3 * voltage_moves)
        {
            spikes.push(k);
        }
    }
    for &k in &spikes {
        series.bad[k] = true;
    }
    if !spikes.is_empty() {
        series.bridge_again();
    }
    spikes.len()
}

fn moves(x: &[f64], k: usize) -> f64 {
    (x[k] - x[k - 1]).abs().max((x[k] - x[k + 1]).abs())
}

fn stands_out(x: &[f64], k: usize, size: f64) -> bool {
    let (left, right) = (x[k] - x[k - 1], x[k] - x[k + 1]);
    // Cheap tests first: the noise is estimated only for the few samples that pass them.
    left * right > 0.0
        && left.abs().min(right.abs()) > SPIKE_LEAST * size
        && (x[k + 1] - x[k - 1]).abs() < NEIGHBOURS_AGREE * left.abs()
        && left.abs().min(right.abs()) > SPIKE_SIGMAS * noise_sigma(x) + SPIKE_LEAST * size
}
