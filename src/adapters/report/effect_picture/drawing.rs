//! The panels of a picture.

use super::{
    super::{
        figure::{Figure, Ink, Mark, Panel, Shape},
        number,
    },
    events::{Dip, ONSET_S, SHOWN, time_s},
};

const WIDTH_PX: u32 = 680;
/// How far a curve may be off what it shows, of the height of its panel: half a pixel.
const UNSEEN: f64 = 0.004;
/// A panel reaches so many times as far beyond its curves' range outside of edges as that range is.
const EDGE_REACH: f64 = 1.5;
/// Effects that show at the edges of a dip: nothing is cut off there.
const AT_EDGES: [&str; 5] = [
    "double_cage_rotor",
    "phasor_window",
    "ratio_phase_error",
    "stator_resistance",
    "time_skew",
];
/// A residual of less than this, in percent, is drawn as the nothing it is.
const LEAST_PERCENT: f64 = 0.1;

/// The figure of what is left in the dips; with the course of the frequency where the effect needs it.
pub(super) fn figure(
    effect: &str,
    dips: &[Dip],
    residuals: &[[Vec<f64>; 2]],
    with_frequency: bool,
) -> Figure {
    let end_s = dips
        .first()
        .map_or(0.0, |dip| time_s(dip.samples.len() - 1));
    let percent = |values: &[f64]| values.iter().map(|x| 100.0 * x).collect();
    let channel =
        |c: usize| -> Vec<Vec<f64>> { residuals.iter().map(|left| percent(&left[c])).collect() };
    let key = "dips of 10 % (thin, green), 30 % (blue), 50 % (thick, orange)";
    let voltages: Vec<Vec<f64>> = dips.iter().map(Dip::voltage).collect();
    let mut panels = vec![panel(
        format!("voltage, of V0; {key}"),
        70,
        &voltages,
        false,
    )];
    if with_frequency {
        let deviations: Vec<Vec<f64>> = dips.iter().map(|dip| percent(&dip.frequency())).collect();
        let title = "frequency, deviation in %".to_owned();
        panels.push(panel(title, 70, &deviations, false));
    }
    let reach = if AT_EDGES.contains(&effect) {
        f64::INFINITY
    } else {
        EDGE_REACH
    };
    for (c, name) in ["P", "Q"].into_iter().enumerate() {
        panels.push(residual_panel(name, dips, &channel(c), reach));
    }
    Figure {
        id: format!("residual-{effect}"),
        title: format!("Residual that {effect} leaves when it is missing"),
        description: format!(
            "P and Q of a load with {effect}, minus those of ZIP and motor refitted to the same \
             three dips without it."
        ),
        width_px: WIDTH_PX,
        horizontal: (-ONSET_S, end_s),
        horizontal_title: "time since the onset, s".to_owned(),
        counts: false,
        panels,
    }
}

/// A panel whose scale is that of what lies outside of the edges, with a cross where a curve is cut off there.
fn residual_panel(name: &str, dips: &[Dip], curves: &[Vec<f64>], reach: f64) -> Panel {
    let all = || curves.iter().flatten().copied();
    let apart = dips.iter().zip(curves).flat_map(|(dip, curve)| {
        let apart = curve.iter().enumerate();
        apart.filter_map(|(k, value)| (!dip.is_near_edge(k)).then_some(*value))
    });
    let (low, high) = range(apart);
    let (low, high) = (low.min(-LEAST_PERCENT), high.max(LEAST_PERCENT));
    let reach = reach * (high - low);
    let (lowest, highest) = range(all());
    let shown = (
        lowest.clamp(low - reach, low),
        highest.clamp(high, high + reach),
    );
    let mut title = format!("residual of {name}, % of P0");
    let is_cut = |value: f64| value < shown.0 || value > shown.1;
    if all().any(is_cut) {
        let [lowest, highest] = [lowest, highest].map(|x| number::significant(x, 2));
        title =
            format!("{title}; cut off next to the dip, where it goes from {lowest} to {highest}");
    }
    let cut: Vec<Vec<f64>> = curves
        .iter()
        .map(|curve| curve.iter().map(|x| x.clamp(shown.0, shown.1)).collect())
        .collect();
    let mut panel = panel(title, 130, &cut, true);
    for (curve, shown_as) in curves.iter().zip(&SHOWN) {
        let beyond = curve.iter().enumerate().filter(|(_, x)| is_cut(**x));
        panel.marks.push(Mark::Points {
            points: beyond
                .map(|(k, x)| (time_s(k), x.clamp(shown.0, shown.1)))
                .collect(),
            ink: shown_as.ink,
            shape: Shape::Cross,
            radius_quarter_px: 12,
        });
    }
    panel
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
        (low.min(x), high.max(x))
    })
}

fn panel(title: String, height_px: u32, curves: &[Vec<f64>], is_residual: bool) -> Panel {
    let (low, high) = range(curves.iter().flatten().copied());
    let least = if is_residual { LEAST_PERCENT } else { 0.0 };
    let (low, high) = (low.min(-least), high.max(least));
    let margin = 0.06 * (high - low);
    let mut marks = Vec::new();
    if is_residual {
        marks.push(Mark::Level {
            at: 0.0,
            ink: Ink::Axis,
        });
    }
    for (values, shown) in curves.iter().zip(&SHOWN) {
        let kept = corners(values, UNSEEN * (high - low)).into_iter();
        marks.push(Mark::Line {
            points: kept.map(|k| (time_s(k), values[k])).collect(),
            ink: shown.ink,
            width_quarter_px: shown.width_quarter_px,
        });
    }
    Panel {
        title,
        height_px,
        vertical: (low - margin, high + margin),
        logarithmic: false,
        marks,
    }
}

/// Samples whose polygon is nowhere farther than `unseen` from the values (Ramer, Douglas and Peucker).
fn corners(values: &[f64], unseen: f64) -> Vec<usize> {
    let last = values.len().saturating_sub(1);
    let mut kept = vec![0, last];
    let mut spans = vec![(0, last)];
    while let Some((from, to)) = spans.pop() {
        let slope = (values[to] - values[from]) / (to - from).max(1) as f64;
        let away = |k: usize| (values[k] - values[from] - slope * (k - from) as f64).abs();
        let farthest = (from..=to).max_by(|a, b| away(*a).total_cmp(&away(*b)));
        let Some(farthest) = farthest.filter(|k| away(*k) > unseen) else {
            continue;
        };
        kept.push(farthest);
        spans.extend([(from, farthest), (farthest, to)]);
    }
    kept.sort_unstable();
    kept.dedup();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_keeps_its_corners_and_nothing_else() {
        let stair: Vec<f64> = (0..50).map(|k| f64::from(u8::from(k >= 20))).collect();
        assert_eq!(corners(&stair, 0.01), [0, 19, 20, 49]);
        assert_eq!(corners(&[1.0; 9], 0.01), [0, 8]);
    }
}
