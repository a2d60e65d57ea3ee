//! What a residual depends on: its means in bins of a quantity.

use super::{
    Channel, Dependence, EventSeries, Quantity, autocorrelation::samples_per_independent_value,
};

const QUANTITIES: [Quantity; 4] = [
    Quantity::Voltage,
    Quantity::VoltageRate,
    Quantity::FrequencyDeviation,
    Quantity::TimeSinceClearing,
];
/// Bins at least and at most.
const BINS: (usize, usize) = (4, 10);
/// Samples in a bin at least.
const BIN_SAMPLES_MIN: usize = 8;
/// Samples each side over which the voltage's rate is taken.
const RATE_REACH: usize = 2;

/// Dependences of both channels on every quantity that moves, strongest first.
pub(super) fn dependences(series: &EventSeries, clearing_s: Option<f64>) -> Vec<Dependence> {
    let mut all: Vec<Dependence> = [Channel::Active, Channel::Reactive]
        .into_iter()
        .flat_map(|channel| {
            QUANTITIES.map(|quantity| dependence(series, clearing_s, channel, quantity))
        })
        .flatten()
        .collect();
    all.sort_by(|a, b| b.explained.total_cmp(&a.explained));
    all
}

/// None with too few samples for four bins or where the quantity does not move.
///
/// How many values are independent is asked of what remains within the bins: the residual itself is slow
/// wherever it follows a quantity that is.
fn dependence(
    series: &EventSeries,
    clearing_s: Option<f64>,
    channel: Channel,
    quantity: Quantity,
) -> Option<Dependence> {
    let in_time: Vec<(f64, f64)> = (0..series.len())
        .filter(|&k| series.tells_of_the_load(channel, k))
        .filter_map(|k| {
            let residual = series.channel(channel).residual(k);
            Some((value(series, clearing_s, quantity, k)?, residual))
        })
        .collect();
    let count = in_time.len();
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| in_time[a].0.total_cmp(&in_time[b].0));
    let pairs: Vec<(f64, f64)> = order.iter().map(|&k| in_time[k]).collect();
    let narrow = equal_counts(&pairs, bin_count(count, f64::INFINITY)?);
    let independent = count as f64 / per_independent_value(&narrow, &order);
    let bins = equal_counts(&pairs, bin_count(count, independent)?);
    if bins.len() < BINS.0 {
        return None;
    }
    let per_value = per_independent_value(&bins, &order);
    Some(Dependence {
        channel,
        quantity,
        explained: explained(&pairs, &bins, count as f64 / per_value),
        bins: bins.iter().map(|bin| summed_up(bin, per_value)).collect(),
    })
}

/// Samples per independent value of what remains within `bins`, whose samples are the `order`-th in time.
fn per_independent_value(bins: &[&[(f64, f64)]], order: &[usize]) -> f64 {
    let remains = bins.iter().flat_map(|bin| {
        let middle = mean(bin, |pair| pair.1);
        bin.iter().map(move |pair| pair.1 - middle)
    });
    let mut in_time = vec![0.0; order.len()];
    for (&place, remains) in order.iter().zip(remains) {
        in_time[place] = remains;
    }
    samples_per_independent_value(&in_time)
}

fn value(
    series: &EventSeries,
    clearing_s: Option<f64>,
    quantity: Quantity,
    k: usize,
) -> Option<f64> {
    let value = match quantity {
        Quantity::Voltage => series.voltage[k],
        Quantity::VoltageRate => {
            let (a, b) = (
                k.saturating_sub(RATE_REACH),
                (k + RATE_REACH).min(series.len() - 1),
            );
            (series.voltage[b] - series.voltage[a]) / (series.time_s[b] - series.time_s[a])
        }
        Quantity::FrequencyDeviation => series.frequency_deviation[k],
        Quantity::TimeSinceClearing => series.time_s[k] - clearing_s.unwrap_or(0.0),
    };
    let counts = value.is_finite() && (quantity != Quantity::TimeSinceClearing || value >= 0.0);
    counts.then_some(value)
}

/// As many bins as samples fill and independent values can tell apart.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "between 0 and the number of samples"
)]
fn bin_count(samples: usize, independent: f64) -> Option<usize> {
    let filled = samples / BIN_SAMPLES_MIN;
    let most = filled.min((independent / 2.0) as usize).max(BINS.0);
    (filled >= BINS.0).then(|| most.min(BINS.1))
}

/// Sorted pairs cut into `count` bins of as nearly equal counts as equal values allow: these stay
/// together.
fn equal_counts(pairs: &[(f64, f64)], count: usize) -> Vec<&[(f64, f64)]> {
    let mut bins = Vec::with_capacity(count);
    let mut from = 0;
    for bin in 1..=count {
        let aimed = (bin * pairs.len() / count).max(from);
        let tied = |pair: &(f64, f64)| aimed > 0 && pair.0 <= pairs[aimed - 1].0;
        let to = aimed + pairs[aimed..].iter().take_while(|pair| tied(pair)).count();
        if to > from {
            bins.push(&pairs[from..to]);
        }
        from = to;
    }
    bins
}

/// `1 - (1 - R^2) (n - 1) / (n - bins)` with the number of independent values for `n`, cut at 0.
fn explained(pairs: &[(f64, f64)], bins: &[&[(f64, f64)]], independent: f64) -> f64 {
    let total = squares_about_mean(pairs);
    let within: f64 = bins.iter().map(|bin| squares_about_mean(bin)).sum();
    let free = independent - bins.len() as f64;
    if total <= 0.0 || free <= 0.0 {
        return 0.0;
    }
    (1.0 - within / total * (independent - 1.0) / free).clamp(0.0, 1.0)
}

fn mean(pairs: &[(f64, f64)], of: fn(&(f64, f64)) -> f64) -> f64 {
    pairs.iter().map(of).sum::<f64>() / pairs.len() as f64
}

fn squares_about_mean(pairs: &[(f64, f64)]) -> f64 {
    let middle = mean(pairs, |pair| pair.1);
    pairs.iter().map(|pair| (pair.1 - middle).powi(2)).sum()
}

fn summed_up(bin: &[(f64, f64)], per_value: f64) -> (f64, f64, f64, usize) {
    let count = bin.len() as f64;
    let variance = squares_about_mean(bin) / (count - 1.0).max(1.0);
    let error = (variance * per_value / count).sqrt();
    (
        mean(bin, |pair| pair.0),
        mean(bin, |pair| pair.1),
        error,
        bin.len(),
    )
}
