//! Charts of where a model fails: residual by segment, and how it goes with the voltage.

use super::super::plot::{Chart, Ink, Mark, Panel, padded, span_of};
use crate::diagnosis::{Channel, CrossCorrelation, Segment, SegmentResidual};

const SEGMENTS: [(Segment, &str); 5] = [
    (Segment::Before, "before"),
    (Segment::During, "during"),
    (Segment::EarlyRecovery, "first 0.5 s after"),
    (Segment::Late, "until 2 s after"),
    (Segment::After, "later"),
];

fn bars(
    list: &[SegmentResidual],
    channel: Channel,
    ink: Ink,
    name: &str,
    shift: f64,
    half_width: f64,
) -> Mark {
    let mut x = Vec::new();
    let mut y = Vec::new();
    for (place, (segment, _)) in SEGMENTS.iter().enumerate() {
        let found = list
            .iter()
            .find(|r| r.segment == *segment && r.channel == channel);
        if let Some(residual) = found {
            x.push(place as f64 + shift);
            y.push(residual.to_noise);
        }
    }
    Mark::Bars {
        name: name.to_owned(),
        ink,
        x,
        y,
        base: 0.0,
        half_width,
    }
}

/// Residual over noise by segment, P and Q side by side; of the other model behind it.
pub(super) fn segments(list: &[SegmentResidual], rival: Option<&[SegmentResidual]>) -> Chart {
    let mut marks = vec![
        Mark::Level {
            name: "noise".to_owned(),
            ink: Ink::Mark,
            at: 1.0,
        },
        bars(list, Channel::Active, Ink::Model, "P", -0.2, 0.16),
        bars(list, Channel::Reactive, Ink::Measured, "Q", 0.2, 0.16),
    ];
    if let Some(rival) = rival {
        marks.push(bars(
            rival,
            Channel::Active,
            Ink::Rival,
            "P, the other model",
            -0.2,
            0.05,
        ));
        marks.push(bars(
            rival,
            Channel::Reactive,
            Ink::Third,
            "Q, the other model",
            0.2,
            0.05,
        ));
    }
    let highest = list
        .iter()
        .chain(rival.unwrap_or_default())
        .map(|residual| residual.to_noise)
        .filter(|value| value.is_finite())
        .fold(1.0, f64::max);
    Chart {
        id: "segments".to_owned(),
        title: "Where it fails".to_owned(),
        description: "Root mean square of the residual over the noise, by part of the event; 1 is \
                      what noise alone would give."
            .to_owned(),
        horizontal_title: "part of the event".to_owned(),
        horizontal: (-0.6, 4.6),
        names: SEGMENTS
            .iter()
            .map(|(_, name)| (*name).to_owned())
            .collect(),
        x: Vec::new(),
        linked: None,
        panels: vec![Panel {
            title: "residual over noise".to_owned(),
            height: 170,
            vertical: (0.0, 1.08 * highest),
            logarithmic: false,
            marks,
        }],
    }
}

/// Correlation of the residual with the voltage; none where there is none to draw.
pub(super) fn cross_correlation(list: &[CrossCorrelation]) -> Option<Chart> {
    let x = list.first()?.lags_s.clone();
    let panels = list
        .iter()
        .map(|correlation| {
            let band = vec![correlation.band; correlation.lags_s.len()];
            let mut span = correlation.correlation.clone();
            span.extend([correlation.band, -correlation.band]);
            Panel {
                title: format!("{} residual with the voltage", correlation.channel.name()),
                height: 120,
                vertical: padded(span_of(&span), 0.2),
                logarithmic: false,
                marks: vec![
                    Mark::Band {
                        name: "chance, 95 of 100".to_owned(),
                        ink: Ink::Noise,
                        x: None,
                        low: band.iter().map(|band| -band).collect(),
                        high: band,
                    },
                    Mark::Upright { at: 0.0 },
                    Mark::Line {
                        name: "correlation".to_owned(),
                        ink: Ink::Model,
                        x: None,
                        y: correlation.correlation.clone(),
                        dashed: false,
                    },
                ],
            }
        })
        .collect();
    Some(Chart {
        id: "cross-correlation".to_owned(),
        title: "Does what is left follow the voltage?".to_owned(),
        description: "Correlation of the residual with the voltage deviation at each lag; outside \
                      the band it is more than chance. A positive lag: the residual comes after the \
                      voltage."
            .to_owned(),
        horizontal_title: "lag, s (positive: after the voltage)".to_owned(),
        horizontal: span_of(&x).filter(|(low, high)| low < high).unwrap_or((0.0, 1.0)),
        names: Vec::new(),
        x,
        linked: None,
        panels,
    })
}
