//! Figures as stacked panels over one horizontal axis, drawn by plotters as SVG and then made fit
//! for a page: colours become CSS variables, the root carries title and description.

use std::io;

use maud::{Markup, PreEscaped, html};
use plotters::{
    coord::{Shift, types::RangedCoordf64},
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use super::{labels, number};

/// The SVG back end has whole-number coordinates; drawing larger and letting the view box scale it
/// down keeps curves smooth. Chosen: a quarter of a CSS pixel is below what a screen shows.
const OVERSAMPLING: u32 = 4;
const LABEL_FONT_PX: u32 = 15;
const TITLE_STRIP_PX: u32 = 28;
const TIME_AXIS_PX: u32 = 44;
const VALUE_AXIS_PX: u32 = 70;
const RIGHT_MARGIN_PX: u32 = 20;

/// Why a report could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A figure could not be drawn.
    #[error("cannot draw figure `{figure}`")]
    Drawing {
        /// Identifier of the figure in the page.
        figure: String,
        /// What the drawing library said.
        source: DrawingAreaErrorKind<io::Error>,
    },
}

/// What a stroke stands for; the page's style sheet gives it its colour in light and dark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ink {
    Measured,
    Model,
    Rival,
    Noise,
    Edge,
    Onset,
    Unused,
    During,
    Early,
    Late,
    After,
    Axis,
    Grid,
    Text,
}

impl Ink {
    const ALL: [Self; 14] = [
        Self::Measured,
        Self::Model,
        Self::Rival,
        Self::Noise,
        Self::Edge,
        Self::Onset,
        Self::Unused,
        Self::During,
        Self::Early,
        Self::Late,
        Self::After,
        Self::Axis,
        Self::Grid,
        Self::Text,
    ];

    /// The CSS variable that holds the colour.
    pub(super) const fn variable(self) -> &'static str {
        match self {
            Self::Measured => "var(--measured)",
            Self::Model => "var(--model)",
            Self::Rival => "var(--rival)",
            Self::Noise => "var(--noise)",
            Self::Edge => "var(--edge)",
            Self::Onset => "var(--onset)",
            Self::Unused => "var(--unused)",
            Self::During => "var(--during)",
            Self::Early => "var(--early)",
            Self::Late => "var(--late)",
            Self::After => "var(--after)",
            Self::Axis => "var(--axis)",
            Self::Grid => "var(--grid)",
            Self::Text => "var(--ink)",
        }
    }

    /// The colour plotters draws with; the style sheet replaces it. Curves: Okabe and Ito's
    /// palette, told apart with every common colour vision. Segments of a window: viridis, which
    /// runs from dark to light as time does.
    const fn rgb(self) -> RGBColor {
        match self {
            Self::Measured => RGBColor(0x00, 0x72, 0xB2),
            Self::Model => RGBColor(0xD5, 0x5E, 0x00),
            Self::Rival => RGBColor(0x00, 0x9E, 0x73),
            Self::Noise => RGBColor(0x56, 0xB4, 0xE9),
            Self::Edge => RGBColor(0xF0, 0xE4, 0x42),
            Self::Onset => RGBColor(0xCC, 0x79, 0xA7),
            Self::Unused => RGBColor(0x59, 0x59, 0x59),
            Self::During => RGBColor(0x44, 0x01, 0x54),
            Self::Early => RGBColor(0x31, 0x68, 0x8E),
            Self::Late => RGBColor(0x2A, 0x9D, 0x6A),
            Self::After => RGBColor(0xB8, 0xA4, 0x00),
            Self::Axis => RGBColor(0x80, 0x80, 0x80),
            Self::Grid => RGBColor(0xE0, 0xE0, 0xE0),
            Self::Text => RGBColor(0x1A, 0x1A, 0x1A),
        }
    }
}

/// Shape of a point, so that no meaning rests on colour alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    Dot,
    Ring,
    Triangle,
    Cross,
}

/// Something drawn in a panel, in data coordinates.
#[derive(Clone, Debug)]
pub(super) enum Mark {
    /// A curve; a point that is not finite breaks it.
    Line {
        points: Vec<(f64, f64)>,
        ink: Ink,
        width_quarter_px: u32,
    },
    Points {
        points: Vec<(f64, f64)>,
        ink: Ink,
        shape: Shape,
        radius_quarter_px: u32,
    },
    /// The area between two curves given as `(x, lower, upper)`.
    Band {
        points: Vec<(f64, f64, f64)>,
        ink: Ink,
    },
    /// A strip over the panel's whole height.
    Strip { from: f64, to: f64, ink: Ink },
    /// The same, fainter: what lies behind everything.
    Shade { from: f64, to: f64, ink: Ink },
    /// A line over the panel's whole height.
    Upright { at: f64, ink: Ink },
    /// A line over the panel's whole width.
    Level { at: f64, ink: Ink },
    /// Names the point `at`; goes beside it to where it covers nothing.
    Label { at: (f64, f64), text: String },
}

/// One panel of a figure.
#[derive(Clone, Debug)]
pub(super) struct Panel {
    pub(super) title: String,
    pub(super) height_px: u32,
    pub(super) vertical: (f64, f64),
    /// Whether vertical coordinates are decimal logarithms of what the ticks shall say.
    pub(super) logarithmic: bool,
    pub(super) marks: Vec<Mark>,
}

/// Panels over one horizontal axis.
#[derive(Clone, Debug)]
pub(super) struct Figure {
    /// Unique in the page.
    pub(super) id: String,
    pub(super) title: String,
    pub(super) description: String,
    pub(super) width_px: u32,
    pub(super) horizontal: (f64, f64),
    pub(super) horizontal_title: String,
    /// Whether the horizontal axis counts: its ticks are whole numbers.
    pub(super) counts: bool,
    pub(super) panels: Vec<Panel>,
}

impl Figure {
    /// The figure as an inline `<svg>` element.
    ///
    /// # Errors
    ///
    /// [`ReportError::Drawing`] when plotters refuses.
    pub(super) fn markup(&self) -> Result<Markup, ReportError> {
        let size = (
            self.width_px * OVERSAMPLING,
            self.height_px() * OVERSAMPLING,
        );
        let mut drawn = String::new();
        self.draw(SVGBackend::with_string(&mut drawn, size))
            .map_err(|source| ReportError::Drawing {
                figure: self.id.clone(),
                source,
            })?;
        let (title_id, description_id) =
            (format!("{}-title", self.id), format!("{}-desc", self.id));
        Ok(html! {
            svg viewBox={ "0 0 " (size.0) " " (size.1) } role="img"
                aria-labelledby={ (title_id) " " (description_id) } {
                title id=(title_id) { (self.title) }
                desc id=(description_id) { (self.description) }
                (PreEscaped(body(&drawn)))
            }
        })
    }

    /// The figure as an SVG file of its own, with its colours written out.
    ///
    /// # Errors
    ///
    /// [`ReportError::Drawing`] when plotters refuses.
    pub(super) fn document(&self) -> Result<String, ReportError> {
        let mut svg = self.markup()?.into_string();
        for ink in Ink::ALL {
            let RGBColor(r, g, b) = ink.rgb();
            svg = svg.replace(ink.variable(), &format!("#{r:02X}{g:02X}{b:02X}"));
        }
        let root = "<svg xmlns=\"http://www.w3.org/2000/svg\" font-family=\"sans-serif\" \
                    style=\"background:white\" ";
        Ok(svg.replacen("<svg ", root, 1) + "\n")
    }

    fn height_px(&self) -> u32 {
        let panels: u32 = self
            .panels
            .iter()
            .map(|panel| panel.height_px + TITLE_STRIP_PX)
            .sum();
        panels + TIME_AXIS_PX
    }

    fn draw(&self, backend: SVGBackend<'_>) -> Result<(), DrawingAreaErrorKind<io::Error>> {
        let root = backend.into_drawing_area();
        let mut top = 0;
        for (number, panel) in self.panels.iter().enumerate() {
            let last = number + 1 == self.panels.len();
            let axis_px = if last { TIME_AXIS_PX } else { 0 };
            let height = panel.height_px + TITLE_STRIP_PX + axis_px;
            let area = root.clone().shrink(
                (0, top * OVERSAMPLING),
                (self.width_px * OVERSAMPLING, height * OVERSAMPLING),
            );
            self.draw_panel(&area, panel, axis_px)?;
            top += height;
        }
        root.present()
    }

    fn draw_panel(
        &self,
        area: &DrawingArea<SVGBackend<'_>, Shift>,
        panel: &Panel,
        axis_px: u32,
    ) -> Result<(), DrawingAreaErrorKind<io::Error>> {
        let title = text_style(LABEL_FONT_PX, Ink::Text);
        let left = i32::try_from(VALUE_AXIS_PX * OVERSAMPLING).unwrap_or(0);
        area.draw_text(&panel.title, &title, (left, 28))?;
        let mut chart = ChartBuilder::on(area)
            .margin_top(TITLE_STRIP_PX * OVERSAMPLING)
            .margin_right(RIGHT_MARGIN_PX * OVERSAMPLING)
            .x_label_area_size(axis_px * OVERSAMPLING)
            .y_label_area_size(VALUE_AXIS_PX * OVERSAMPLING)
            .build_cartesian_2d(
                self.horizontal.0..self.horizontal.1,
                panel.vertical.0..panel.vertical.1,
            )?;
        for mark in panel.marks.iter().filter(|mark| mark.lies_behind()) {
            draw_mark(&mut chart, mark, (self.horizontal, panel.vertical))?;
        }
        let horizontal_decimals = number::decimals_for_span(self.horizontal.1 - self.horizontal.0);
        let vertical_decimals = number::decimals_for_span(panel.vertical.1 - panel.vertical.0);
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(Ink::Grid.rgb().stroke_width(OVERSAMPLING))
            .axis_style(Ink::Axis.rgb().stroke_width(OVERSAMPLING))
            .label_style(text_style(LABEL_FONT_PX, Ink::Text))
            .set_all_tick_mark_size(4 * OVERSAMPLING)
            .x_labels(9)
            .y_labels(if panel.height_px < 100 { 5 } else { 7 })
            .x_desc(if axis_px > 0 {
                self.horizontal_title.as_str()
            } else {
                ""
            })
            .x_label_formatter(&|x| {
                if !self.counts {
                    number::fixed(*x, horizontal_decimals)
                } else if (x - x.round()).abs() < 1e-9 {
                    number::fixed(*x, 0)
                } else {
                    String::new()
                }
            })
            .y_label_formatter(&|y| {
                if panel.logarithmic {
                    number::significant(10_f64.powf(*y), 2)
                } else {
                    number::fixed(*y, vertical_decimals)
                }
            })
            .draw()?;
        for mark in panel.marks.iter().filter(|mark| !mark.lies_behind()) {
            draw_mark(&mut chart, mark, (self.horizontal, panel.vertical))?;
        }
        self.draw_labels(&mut chart, panel)
    }

    /// Labels last, so that nothing is drawn over them.
    fn draw_labels(
        &self,
        chart: &mut Chart<'_, '_>,
        panel: &Panel,
    ) -> Result<(), DrawingAreaErrorKind<io::Error>> {
        let (left, right) = self.horizontal;
        let (bottom, top) = panel.vertical;
        let width = f64::from(self.width_px - VALUE_AXIS_PX - RIGHT_MARGIN_PX);
        let height = f64::from(panel.height_px);
        let to_px = |(x, y): (f64, f64)| {
            let across = (x - left) / (right - left);
            (across * width, (top - y) / (top - bottom) * height)
        };
        let from_px = |(x, y): (f64, f64)| {
            let across = left + x / width * (right - left);
            (across, top - y / height * (top - bottom))
        };
        let labels: Vec<((f64, f64), &str)> = (panel.marks.iter())
            .filter_map(|mark| match mark {
                Mark::Label { at, text } if at.0.is_finite() && at.1.is_finite() => {
                    Some((to_px(*at), text.as_str()))
                }
                _ => None,
            })
            .collect();
        let marks: Vec<(f64, f64)> = (panel.marks.iter())
            .flat_map(|mark| match mark {
                Mark::Points { points, .. } if !labels.is_empty() => points.as_slice(),
                _ => &[],
            })
            .map(|point| to_px(*point))
            .collect();
        for (placed, (_, text)) in labels::place(&labels, &marks, (width, height))
            .into_iter()
            .zip(&labels)
        {
            if let Some(leader) = placed.leader {
                let style = Ink::Axis.rgb().stroke_width(3);
                chart.draw_series([PathElement::new(leader.map(from_px).to_vec(), style)])?;
            }
            let style =
                text_style(LABEL_FONT_PX - 2, Ink::Text).pos(Pos::new(HPos::Left, VPos::Center));
            let at = from_px(placed.at);
            chart.draw_series([Text::new((*text).to_owned(), at, style)])?;
        }
        Ok(())
    }
}

impl Mark {
    /// Whether the mark is drawn before the grid.
    const fn lies_behind(&self) -> bool {
        matches!(
            self,
            Self::Strip { .. } | Self::Shade { .. } | Self::Band { .. }
        )
    }
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// `ranges` are the horizontal and the vertical range of the panel.
fn draw_mark(
    chart: &mut Chart<'_, '_>,
    mark: &Mark,
    ranges: ((f64, f64), (f64, f64)),
) -> Result<(), DrawingAreaErrorKind<io::Error>> {
    let ((left, right), (bottom, top)) = ranges;
    match mark {
        Mark::Line {
            points,
            ink,
            width_quarter_px,
        } => {
            let style = ink.rgb().stroke_width(*width_quarter_px);
            for run in unbroken(points) {
                chart.draw_series([PathElement::new(run.to_vec(), style)])?;
            }
        }
        Mark::Points {
            points,
            ink,
            shape,
            radius_quarter_px,
        } => draw_points(chart, points, *ink, *shape, *radius_quarter_px)?,
        Mark::Band { points, ink } => {
            let lower = points.iter().map(|&(x, lower, _)| (x, lower));
            let upper = points.iter().rev().map(|&(x, _, upper)| (x, upper));
            let outline: Vec<_> = lower.chain(upper).collect();
            chart.draw_series([Polygon::new(outline, ink.rgb().mix(0.3).filled())])?;
        }
        Mark::Strip { from, to, ink } => {
            let corners = [(from.max(left), bottom), (to.min(right), top)];
            chart.draw_series([Rectangle::new(corners, ink.rgb().mix(0.3).filled())])?;
        }
        Mark::Shade { from, to, ink } => {
            let corners = [(from.max(left), bottom), (to.min(right), top)];
            chart.draw_series([Rectangle::new(corners, ink.rgb().mix(0.15).filled())])?;
        }
        Mark::Upright { at, ink } => {
            let style = ink.rgb().stroke_width(6);
            chart.draw_series([PathElement::new(vec![(*at, bottom), (*at, top)], style)])?;
        }
        Mark::Level { at, ink } => {
            let style = ink.rgb().stroke_width(4);
            chart.draw_series([PathElement::new(vec![(left, *at), (right, *at)], style)])?;
        }
        // Drawn when all of the panel is known.
        Mark::Label { .. } => {}
    }
    Ok(())
}

fn draw_points(
    chart: &mut Chart<'_, '_>,
    points: &[(f64, f64)],
    ink: Ink,
    shape: Shape,
    radius: u32,
) -> Result<(), DrawingAreaErrorKind<io::Error>> {
    let style = ink.rgb();
    let finite = points
        .iter()
        .copied()
        .filter(|(x, y)| x.is_finite() && y.is_finite());
    match shape {
        Shape::Dot => chart.draw_series(finite.map(|p| Circle::new(p, radius, style.filled())))?,
        Shape::Ring => {
            chart.draw_series(finite.map(|p| Circle::new(p, radius, style.stroke_width(6))))?
        }
        Shape::Triangle => {
            chart.draw_series(finite.map(|p| TriangleMarker::new(p, radius, style.filled())))?
        }
        Shape::Cross => {
            chart.draw_series(finite.map(|p| Cross::new(p, radius, style.stroke_width(6))))?
        }
    };
    Ok(())
}

fn text_style(size_px: u32, ink: Ink) -> TextStyle<'static> {
    // The SVG back end divides the size by 1.24 (plotters-svg `draw_text`).
    let size = f64::from(size_px * OVERSAMPLING) * 1.24;
    let mut style = TextStyle::from(("sans-serif", size).into_font());
    style.color = ink.rgb().to_backend_color();
    style
}

/// The runs of finite points, each of at least two.
fn unbroken(points: &[(f64, f64)]) -> impl Iterator<Item = &[(f64, f64)]> {
    points
        .split(|(x, y)| !(x.is_finite() && y.is_finite()))
        .filter(|run| run.len() > 1)
}

/// What plotters drew, without its root element, with CSS variables for colours and without
/// attributes that say what holds anyway. A value in quotes cannot come from a text: those are
/// escaped.
fn body(drawn: &str) -> String {
    let inner = drawn
        .split_once(">\n")
        .map_or(drawn, |(_, inner)| inner)
        .trim_end()
        .trim_end_matches("</svg>");
    let mut body = inner
        .replace(" opacity=\"1\"", "")
        .replace(" font-family=\"sans-serif\"", "")
        .replace(" stroke=\"none\" stroke-width=\"1\"", "");
    for ink in Ink::ALL {
        let RGBColor(r, g, b) = ink.rgb();
        let literal = format!("=\"#{r:02X}{g:02X}{b:02X}\"");
        body = body.replace(&literal, &format!("=\"{}\"", ink.variable()));
    }
    body
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(marks: Vec<Mark>) -> Figure {
        Figure {
            id: "f".to_owned(),
            title: "<script>".to_owned(),
            description: "a & b".to_owned(),
            width_px: 600,
            horizontal: (0.0, 1.0),
            horizontal_title: "time, s".to_owned(),
            counts: false,
            panels: vec![Panel {
                title: "<b>V</b>, pu".to_owned(),
                height_px: 100,
                vertical: (0.0, 1.0),
                logarithmic: false,
                marks,
            }],
        }
    }

    #[test]
    fn texts_of_a_figure_are_escaped() {
        let svg = figure(Vec::new()).markup().unwrap().into_string();
        assert!(!svg.contains("<script>") && !svg.contains("<b>"), "{svg}");
        assert!(svg.contains("&lt;script&gt;") && svg.contains("a &amp; b"));
    }

    #[test]
    fn every_colour_is_a_variable_of_the_style_sheet() {
        let line = Mark::Line {
            points: vec![(0.0, 0.1), (1.0, 0.9)],
            ink: Ink::Model,
            width_quarter_px: 6,
        };
        let svg = figure(vec![line]).markup().unwrap().into_string();
        assert!(svg.contains("stroke=\"var(--model)\""), "{svg}");
        assert!(!svg.contains("=\"#"), "{svg}");
    }

    #[test]
    fn a_missing_point_breaks_a_curve_in_two() {
        let points = [
            (0.0, 1.0),
            (1.0, 1.0),
            (2.0, f64::NAN),
            (3.0, 1.0),
            (4.0, 1.0),
        ];
        let lengths: Vec<_> = unbroken(&points).map(<[_]>::len).collect();
        assert_eq!(lengths, [2, 2]);
    }
}
