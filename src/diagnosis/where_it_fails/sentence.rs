//! The failure of an event in one sentence.

use super::{Channel, EventSeries};

/// Blocks into which a window is cut before it is scanned; bounds the cost of the scan.
const BLOCKS_MAX: usize = 700;
/// Samples that make one independent value: neighbouring phasors share most of their window.
const SAMPLES_PER_VALUE: f64 = 4.0;
/// Standard errors from which a mean counts as off. Chosen: chance reaches it in less than one of
/// ten thousand events, however many stretches are looked at.
const SIGNIFICANT: f64 = 5.0;
/// Noises below which a mean is not worth a sentence, however long it lasts.
const NOISES_MIN: f64 = 1.0;
/// Error over noise above which an event whose stretches are all in order fails at its edges.
const EDGE_ERROR_MIN: f64 = 1.5;

/// Noises from which a mean over a stretch is grave ...
const GRAVE_NOISES: f64 = 4.0;
/// ... where it lasts so long, s.
const GRAVE_LASTS_S: f64 = 0.1;

/// A stretch over which the measurement lies to one side of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    /// Begin and end, seconds since the onset.
    pub(super) begin_s: f64,
    pub(super) end_s: f64,
    /// Weighted mean of measured minus modelled, over P0.
    pub(super) mean_pu: f64,
    /// Its size over the deviation of a sample.
    pub(super) to_noise: f64,
    /// Its size over its standard error, less what the search among stretches of this length
    /// brings by chance.
    score: f64,
}

/// The failure of an event in one sentence, or that there is none.
pub(super) fn sentence(
    series: &EventSeries,
    clearing_s: Option<f64>,
    error_to_noise: f64,
) -> String {
    let [p, q] = [Channel::Active, Channel::Reactive]
        .map(|channel| (channel, worst_stretch(series, channel, clearing_s)));
    let end_s = series.end_s();
    let tell = |channel: Channel, stretch: &Stretch| told(channel, stretch, clearing_s, end_s);
    let words = match (p, q) {
        ((_, None), (_, None)) if error_to_noise > EDGE_ERROR_MIN => format!(
            "P and Q follow within the noise except near the edges of the voltage; over all samples \
             the residual is {} times the noise.",
            rounded(error_to_noise)
        ),
        ((_, None), (_, None)) => "P and Q follow within the noise.".to_owned(),
        ((p, Some(stretch)), (q, None)) | ((q, None), (p, Some(stretch))) => format!(
            "{}; {} follows within the noise.",
            tell(p, &stretch),
            q.name()
        ),
        ((p, Some(of_p)), (q, Some(of_q))) => {
            format!("{}; {}.", tell(p, &of_p), tell(q, &of_q))
        }
    };
    capitalised(&words)
}

/// The gravest stretch of an event in words; none where no channel has one.
pub(super) fn gravest(series: &EventSeries, clearing_s: Option<f64>) -> Option<String> {
    let stretch = |channel| Some((channel, worst_stretch(series, channel, clearing_s)?));
    let (channel, gravest) = [Channel::Active, Channel::Reactive]
        .into_iter()
        .filter_map(stretch)
        .filter(|(_, s)| s.to_noise >= GRAVE_NOISES && s.end_s - s.begin_s >= GRAVE_LASTS_S)
        .max_by(|a, b| a.1.to_noise.total_cmp(&b.1.to_noise))?;
    Some(told(channel, &gravest, clearing_s, series.end_s()))
}

fn told(channel: Channel, stretch: &Stretch, clearing_s: Option<f64>, end_s: f64) -> String {
    let (origin_s, origin) = match clearing_s {
        Some(clearing_s) if stretch.begin_s >= clearing_s => (clearing_s, "clearing"),
        _ => (0.0, "onset"),
    };
    let (begin, end) = (stretch.begin_s - origin_s, stretch.end_s - origin_s);
    let short = end - begin < 0.2;
    let seconds = |time: f64| {
        let decimals = if short || (0.005..0.095).contains(&time) {
            2
        } else {
            1
        };
        format!("{time:.decimals$}")
    };
    let when = if stretch.end_s >= end_s {
        format!("from {} s after the {origin} to the end", seconds(begin))
    } else {
        format!("{}-{} s after the {origin}", seconds(begin), seconds(end))
    };
    format!(
        "{when} {} is {} % of P0 {} the model, {} times the noise",
        channel.name(),
        rounded(100.0 * stretch.mean_pu.abs()),
        if stretch.mean_pu > 0.0 {
            "above"
        } else {
            "below"
        },
        rounded(stretch.to_noise),
    )
}

fn capitalised(words: &str) -> String {
    let mut characters = words.chars();
    let first = characters.next().map(|first| first.to_ascii_uppercase());
    first.into_iter().chain(characters).collect()
}

/// Two significant digits, without an exponent.
fn rounded(value: f64) -> String {
    match value {
        value if value >= 9.95 => format!("{value:.0}"),
        value if value >= 0.995 => format!("{value:.1}"),
        value if value >= 0.0995 => format!("{value:.2}"),
        value => format!("{value:.3}"),
    }
}

/// The stretch of the event part over which the mean of the residual stands out most: the largest
/// `|sum w r| / sqrt(sum w)` of all stretches (the likelihood ratio of a shifted mean), less
/// `sqrt(2 ln(e N / n))`, which chance brings among the stretches of `n` of `N` samples (Duembgen and
/// Spokoiny, Annals of Statistics 29, 2001). Stretches do not cross the clearing.
pub(super) fn worst_stretch(
    series: &EventSeries,
    channel: Channel,
    clearing_s: Option<f64>,
) -> Option<Stretch> {
    let told: Vec<usize> = (0..series.len())
        .filter(|&k| series.tells_of_the_load(channel, k))
        .collect();
    let cut = clearing_s.map_or(0, |at| told.partition_point(|&k| series.time_s[k] < at));
    let per_block = told.len().div_ceil(BLOCKS_MAX).max(1);
    let (before, after) = told.split_at(cut);
    [before, after]
        .into_iter()
        .filter_map(|part| {
            let blocks: Vec<Block> = part
                .chunks(per_block)
                .map(|samples| Block::new(series, channel, samples))
                .collect();
            most_significant(&blocks)
        })
        .max_by(|a, b| a.score.total_cmp(&b.score))
}

/// Sums over a few neighbouring samples.
#[derive(Clone, Copy, Debug, Default)]
struct Block {
    begin_s: f64,
    end_s: f64,
    samples: f64,
    weight: f64,
    weighted_residual: f64,
}

impl Block {
    fn new(series: &EventSeries, channel: Channel, samples: &[usize]) -> Self {
        let values = series.channel(channel);
        let time = |k: Option<&usize>| k.map_or(0.0, |&k| series.time_s[k]);
        let mut block = Self {
            begin_s: time(samples.first()),
            end_s: time(samples.last()),
            samples: samples.len() as f64,
            ..Self::default()
        };
        for &k in samples {
            let weight = values.deviation[k].powi(-2);
            block.weight += weight;
            block.weighted_residual += weight * values.residual(k);
        }
        block
    }

    /// The mean over its standard error.
    fn errors(&self) -> f64 {
        let mean_pu = self.weighted_residual / self.weight;
        mean_pu.abs() * (self.weight / SAMPLES_PER_VALUE).sqrt()
    }

    fn stretch(&self, samples: f64) -> Stretch {
        let mean_pu = self.weighted_residual / self.weight;
        let errors = self.errors();
        let chance = (2.0 * (1.0 + (samples / self.samples).ln())).sqrt();
        Stretch {
            begin_s: self.begin_s,
            end_s: self.end_s,
            mean_pu,
            to_noise: mean_pu.abs() * (self.weight / self.samples).sqrt(),
            score: errors - chance,
        }
    }
}

fn most_significant(blocks: &[Block]) -> Option<Stretch> {
    let samples: f64 = blocks.iter().map(|block| block.samples).sum();
    let mut best: Option<Stretch> = None;
    for first in 0..blocks.len() {
        let mut sums = Block {
            begin_s: blocks[first].begin_s,
            ..Block::default()
        };
        for block in &blocks[first..] {
            sums.end_s = block.end_s;
            sums.samples += block.samples;
            sums.weight += block.weight;
            sums.weighted_residual += block.weighted_residual;
            // What chance brings only lowers a score.
            if sums.errors() <= best.map_or(SIGNIFICANT, |best| best.score) {
                continue;
            }
            let stretch = sums.stretch(samples);
            let counts = stretch.score >= SIGNIFICANT && stretch.to_noise >= NOISES_MIN;
            if counts && best.is_none_or(|best| stretch.score > best.score) {
                best = Some(stretch);
            }
        }
    }
    best
}
