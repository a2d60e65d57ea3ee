//! Where a model fails, in pictures: an event with its residuals, residual against voltage, the
//! correlation of both, and the severity ladder. Powers are over P0.

use super::{
    decimate,
    event::padded,
    figure::{Figure, Ink, Mark, Panel, Shape},
    number,
    overview::{extent, short_name, thinned_by_voltage},
};
use crate::diagnosis::{Channel, EventFailure, EventSeries, Quantity, Segment};

const WIDTH_PX: u32 = 620;
/// Points per curve; above it a curve is drawn by its extremes.
const CURVE_POINTS_MAX: usize = 1500;
/// The close-up begins this long before the onset and ends this long after the clearing.
const CLOSE_UP_S: (f64, f64) = (-0.15, 1.2);
/// It is drawn only where it is shorter than this share of the window.
const CLOSE_UP_SHARE_MAX: f64 = 0.5;
/// Half-width of the noise band in standard deviations.
const NOISE_BAND_SIGMA: f64 = 2.0;
const CHANNELS: [Channel; 2] = [Channel::Active, Channel::Reactive];
/// Segments after the onset with colour, shape and words of their own: time in a scatter.
pub(super) const EVENT_SEGMENTS: [(Segment, Ink, Shape, &str, &str); 4] = [
    (
        Segment::During,
        Ink::During,
        Shape::Triangle,
        "triangle",
        "until the clearing",
    ),
    (
        Segment::EarlyRecovery,
        Ink::Early,
        Shape::Dot,
        "dot",
        "the half second after it",
    ),
    (
        Segment::Late,
        Ink::Late,
        Shape::Ring,
        "ring",
        "until 2 s after it",
    ),
    (
        Segment::After,
        Ink::After,
        Shape::Cross,
        "cross",
        "the rest",
    ),
];

/// An event as a whole and, where it shows more, close up; with the residuals of `before` beside.
pub(super) fn event_figures(
    id: &str,
    failure: &EventFailure,
    before: Option<&EventFailure>,
) -> Vec<Figure> {
    let series = &failure.series;
    let first = series.time_s.first().copied().unwrap_or(0.0);
    let last = series.time_s.last().copied().unwrap_or(1.0);
    let whole = (first, last.max(first + f64::EPSILON.sqrt()));
    let close = (
        first.max(CLOSE_UP_S.0),
        last.min(failure.clearing_s.unwrap_or(0.0) + CLOSE_UP_S.1),
    );
    let mut figures = vec![event_figure(format!("{id}-whole"), failure, before, whole)];
    if close.1 - close.0 < CLOSE_UP_SHARE_MAX * (whole.1 - whole.0) {
        figures.push(event_figure(format!("{id}-close"), failure, before, close));
    }
    figures
}

fn event_figure(
    id: String,
    failure: &EventFailure,
    before: Option<&EventFailure>,
    span: (f64, f64),
) -> Figure {
    let view = View::new(failure, before, span);
    let mut panels = vec![view.voltage()];
    for channel in CHANNELS {
        panels.push(view.power(channel));
        panels.push(view.residual(channel));
    }
    Figure {
        id,
        title: format!("Event {}", failure.event),
        description: format!(
            "Voltage, active power measured and modelled, its residual, reactive power, its \
             residual, from {} s to {} s after the onset. {}",
            number::fixed(span.0, 2),
            number::fixed(span.1, 2),
            failure.sentence
        ),
        width_px: WIDTH_PX,
        horizontal: span,
        horizontal_title: "time from onset, s".to_owned(),
        counts: false,
        panels,
    }
}

/// The samples of an event that a figure shows.
struct View<'a> {
    failure: &'a EventFailure,
    series: &'a EventSeries,
    before: Option<&'a EventSeries>,
    span: (f64, f64),
    first: usize,
    end: usize,
}

impl<'a> View<'a> {
    fn new(failure: &'a EventFailure, before: Option<&'a EventFailure>, span: (f64, f64)) -> Self {
        let series = &failure.series;
        let same_length = |series: &&EventSeries| series.len() == failure.series.len();
        Self {
            failure,
            series,
            before: before.map(|before| &before.series).filter(same_length),
            span,
            first: series.time_s.partition_point(|&t| t < span.0),
            end: series.time_s.partition_point(|&t| t <= span.1),
        }
    }

    fn shown<'b>(&self, values: &'b [f64]) -> &'b [f64] {
        values.get(self.first..self.end).unwrap_or(&[])
    }

    fn points(&self, values: &[f64]) -> Vec<(f64, f64)> {
        let shown = self.shown(values);
        decimate::envelope(shown, CURVE_POINTS_MAX)
            .into_iter()
            .map(|k| (self.series.time_s[self.first + k], shown[k]))
            .collect()
    }

    fn curve(&self, values: &[f64], ink: Ink, width_quarter_px: u32) -> Mark {
        Mark::Line {
            points: self.points(values),
            ink,
            width_quarter_px,
        }
    }

    /// Shades over the segments and a line at the onset.
    fn backdrop(&self) -> Vec<Mark> {
        let mut marks = Vec::new();
        for (segment, ink, ..) in EVENT_SEGMENTS {
            let known = (self.failure.segments.iter()).find(|r| r.segment == segment);
            let next = self.series.interval_s();
            let Some((from, to)) = known.map(|r| (r.begin_s, r.end_s + next)) else {
                continue;
            };
            if to > self.span.0 && from < self.span.1 {
                marks.push(Mark::Shade { from, to, ink });
            }
        }
        marks.push(Mark::Upright {
            at: 0.0,
            ink: Ink::Onset,
        });
        marks
    }

    fn voltage(&self) -> Panel {
        let mut marks = self.backdrop();
        marks.push(self.curve(&self.series.voltage, Ink::Measured, 6));
        self.panel(
            "Voltage over V0".to_owned(),
            90,
            &[&self.series.voltage],
            marks,
        )
    }

    fn power(&self, channel: Channel) -> Panel {
        let values = self.series.channel(channel);
        let mut marks = self.backdrop();
        let mut all = vec![values.measured.as_slice(), values.model.as_slice()];
        marks.push(self.curve(&values.measured, Ink::Measured, 8));
        if let Some(before) = self.before {
            let model = before.channel(channel).model.as_slice();
            marks.push(self.curve(model, Ink::Rival, 5));
            all.push(model);
        }
        marks.push(self.curve(&values.model, Ink::Model, 6));
        let title = match channel {
            Channel::Active => "Active power P over P0",
            Channel::Reactive => "Reactive power Q over P0",
        };
        self.panel(title.to_owned(), 165, &all, marks)
    }

    fn panel(&self, title: String, height_px: u32, series: &[&[f64]], marks: Vec<Mark>) -> Panel {
        let shown = series.iter().flat_map(|values| self.shown(values));
        Panel {
            title,
            height_px,
            vertical: padded(extent(shown.copied())),
            logarithmic: false,
            marks,
        }
    }

    fn residual(&self, channel: Channel) -> Panel {
        let of = |series: &EventSeries| -> Vec<f64> {
            let values = series.channel(channel);
            (0..series.len())
                .map(|k| 100.0 * values.residual(k))
                .collect()
        };
        let residual = of(self.series);
        let before = self.before.map(of);
        let band: Vec<f64> = (self.series.channel(channel).deviation.iter())
            .map(|deviation| 100.0 * NOISE_BAND_SIGMA * deviation)
            .collect();
        let half = self.half_range(channel, &residual, before.as_deref(), &band);
        let clamped =
            |values: &[f64]| -> Vec<f64> { values.iter().map(|x| x.clamp(-half, half)).collect() };
        let mut marks = self.backdrop();
        marks.push(Mark::Band {
            points: (self.points(&band).into_iter())
                .filter(|(_, reach)| reach.is_finite())
                .map(|(time, reach)| (time, -reach.min(half), reach.min(half)))
                .collect(),
            ink: Ink::Noise,
        });
        marks.push(Mark::Level {
            at: 0.0,
            ink: Ink::Axis,
        });
        if let Some(before) = &before {
            marks.push(self.curve(&clamped(before), Ink::Rival, 5));
        }
        marks.push(self.curve(&clamped(&residual), Ink::Model, 6));
        let cut = self.shown(&residual).iter().any(|x| x.abs() > half);
        let note = if cut { " (cut off at an edge)" } else { "" };
        Panel {
            title: format!("Residual of {}, % of P0{note}", channel.name()),
            height_px: 110,
            vertical: (-half, half),
            logarithmic: false,
            marks,
        }
    }

    /// Residuals near edges may be far larger than all others, and would flatten them: they do not
    /// set the axis.
    fn half_range(
        &self,
        channel: Channel,
        residual: &[f64],
        before: Option<&[f64]>,
        band: &[f64],
    ) -> f64 {
        let half = (self.first..self.end)
            .filter(|&k| self.series.tells_of_the_load(channel, k))
            .flat_map(|k| {
                [
                    residual[k],
                    before.map_or(0.0, |values| values[k]),
                    1.5 * band[k],
                ]
            })
            .filter(|reach| reach.is_finite())
            .fold(0.0, |half: f64, reach| half.max(reach.abs()));
        if half > 0.0 { 1.1 * half } else { 0.1 }
    }
}

/// Residuals of P and Q against voltage, coloured and shaped by segment; for a single event with
/// its means by voltage.
pub(super) fn against_voltage(id: &str, failures: &[&EventFailure]) -> Figure {
    let voltages = told(failures, Channel::Active).map(|(failure, k)| failure.series.voltage[k]);
    Figure {
        id: id.to_owned(),
        title: "Residual against voltage".to_owned(),
        description: format!(
            "Measured minus modelled power against the voltage at the same instant in {} events, \
             samples near voltage edges left out; colour and shape by time since the clearing.",
            failures.len()
        ),
        width_px: WIDTH_PX,
        horizontal: padded(extent(voltages)),
        horizontal_title: "voltage over V0".to_owned(),
        counts: false,
        panels: CHANNELS.map(|channel| scatter(failures, channel)).into(),
    }
}

fn told<'a>(
    failures: &'a [&EventFailure],
    channel: Channel,
) -> impl Iterator<Item = (&'a EventFailure, usize)> {
    failures.iter().flat_map(move |failure| {
        let series = &failure.series;
        (0..series.len())
            .filter(move |&k| series.tells_of_the_load(channel, k) && series.voltage[k].is_finite())
            .map(move |k| (*failure, k))
    })
}

fn scatter(failures: &[&EventFailure], channel: Channel) -> Panel {
    let mut marks = vec![Mark::Level {
        at: 0.0,
        ink: Ink::Axis,
    }];
    let mut most: f64 = 0.0;
    // The latest first, so that the few samples of a dip lie on top.
    for (segment, ink, shape, ..) in EVENT_SEGMENTS.into_iter().rev() {
        let points: Vec<(f64, f64)> = told(failures, channel)
            .filter(|(failure, k)| failure.segment_of(*k) == segment)
            .map(|(failure, k)| {
                let residual = failure.series.channel(channel).residual(k);
                (failure.series.voltage[k], 100.0 * residual)
            })
            .collect();
        most = points.iter().fold(most, |most, p| most.max(p.1.abs()));
        marks.push(Mark::Points {
            points: thinned_by_voltage(&points),
            ink,
            shape,
            radius_quarter_px: if shape == Shape::Triangle { 12 } else { 8 },
        });
    }
    if let [failure] = failures {
        marks.extend(means_by_voltage(failure, channel));
    }
    Panel {
        title: format!("Residual of {}, % of P0", channel.name()),
        height_px: 150,
        vertical: padded((-most, most)),
        logarithmic: false,
        marks,
    }
}

fn means_by_voltage(failure: &EventFailure, channel: Channel) -> Option<Mark> {
    let found = (failure.dependences.iter())
        .find(|d| d.channel == channel && d.quantity == Quantity::Voltage)?;
    Some(Mark::Line {
        points: found
            .bins
            .iter()
            .map(|bin| (bin.0, 100.0 * bin.1))
            .collect(),
        ink: Ink::Model,
        width_quarter_px: 8,
    })
}

/// Cross-correlation of residual and voltage with its band; none where there is no correlation.
pub(super) fn correlation(id: &str, failure: &EventFailure) -> Option<Figure> {
    let lags = &failure.cross_correlations.first()?.lags_s;
    let span = padded(extent(lags.iter().copied()));
    let panels = (failure.cross_correlations.iter())
        .map(|found| {
            let ends = [span.0, span.1].map(|lag| (lag, -found.band, found.band));
            let points = found
                .lags_s
                .iter()
                .copied()
                .zip(found.correlation.iter().copied());
            Panel {
                title: format!(
                    "Correlation of the residual of {} with V",
                    found.channel.name()
                ),
                height_px: 120,
                vertical: (-1.05, 1.05),
                logarithmic: false,
                marks: vec![
                    Mark::Band {
                        points: ends.to_vec(),
                        ink: Ink::Noise,
                    },
                    Mark::Level {
                        at: 0.0,
                        ink: Ink::Axis,
                    },
                    Mark::Upright {
                        at: 0.0,
                        ink: Ink::Onset,
                    },
                    Mark::Line {
                        points: points.collect(),
                        ink: Ink::Model,
                        width_quarter_px: 6,
                    },
                ],
            }
        })
        .collect();
    Some(Figure {
        id: id.to_owned(),
        title: format!("Residual and voltage in event {}", failure.event),
        description: "Correlation of the residual with the voltage deviation against the lag; \
                      inside the band 95 of 100 values lie where both have nothing to do with each \
                      other."
            .to_owned(),
        width_px: WIDTH_PX,
        horizontal: span,
        horizontal_title: "lag, s; positive: the residual follows the voltage".to_owned(),
        counts: false,
        panels,
    })
}

/// Root of the misfit of every event against its lowest voltage; with `before`, from there to here.
pub(super) fn ladder(
    failures: &[EventFailure],
    before: Option<&[EventFailure]>,
    untouched: &dyn Fn(&str) -> bool,
    floor: f64,
) -> Figure {
    let height = |failure: &EventFailure| failure.error_to_noise.max(1e-3).log10();
    let earlier = |event: &str| before?.iter().find(|failure| failure.event == event);
    let finite: Vec<&EventFailure> = failures
        .iter()
        .filter(|f| f.lowest_voltage.is_finite())
        .collect();
    let floor = floor.log10();
    let mut marks = vec![Mark::Level {
        at: floor,
        ink: Ink::Onset,
    }];
    let mut heights = vec![floor, 0.0];
    for failure in &finite {
        let at = (failure.lowest_voltage, height(failure));
        heights.push(at.1);
        if let Some(from) = earlier(&failure.event).map(height) {
            heights.push(from);
            marks.push(Mark::Line {
                points: vec![(at.0, from), at],
                ink: Ink::Rival,
                width_quarter_px: 4,
            });
            marks.push(Mark::Points {
                points: vec![(at.0, from)],
                ink: Ink::Rival,
                shape: Shape::Ring,
                radius_quarter_px: 16,
            });
        }
        let (ink, shape, radius_quarter_px) = if untouched(&failure.event) {
            (Ink::Model, Shape::Triangle, 22)
        } else {
            (Ink::Measured, Shape::Dot, 16)
        };
        marks.push(Mark::Points {
            points: vec![at],
            ink,
            shape,
            radius_quarter_px,
        });
        marks.push(Mark::Label {
            at,
            text: short_name(&failure.event),
        });
    }
    Figure {
        id: "severity".to_owned(),
        title: "Severity ladder".to_owned(),
        description: format!(
            "Root of the misfit per sample (residual over the deviation that each sample has in the \
             fit) of {} events against their lowest voltage; triangles untouched, dots all \
             others{}; the line is what a perfect model leaves.",
            finite.len(),
            before.map_or("", |_| ", rings before")
        ),
        width_px: WIDTH_PX,
        horizontal: padded(extent(finite.iter().map(|f| f.lowest_voltage))),
        horizontal_title: "lowest voltage over voltage before the event".to_owned(),
        counts: false,
        panels: vec![Panel {
            title: "Root of misfit per sample, event part".to_owned(),
            height_px: 300,
            vertical: padded(extent(heights.into_iter())),
            logarithmic: true,
            marks,
        }],
    }
}
