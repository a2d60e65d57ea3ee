//! Charts of the pages: stacked panels over one horizontal axis.
//!
//! One description serves three readers: `svg` draws it on the server, so that a page without
//! scripts tells everything; `json` gives it to `static/chart.js`, which draws the same with zoom
//! and read-out; `table` lists the numbers behind it.

mod json;
mod scale;
mod svg;
mod table;

pub(super) use json::charts_json;
pub(super) use scale::{padded, span_of};
pub(super) use svg::{figure, has_figure};

/// What a stroke stands for; `static/app.css` gives it its colour in light and dark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ink {
    /// A measurement.
    Measured,
    /// The model in force.
    Model,
    /// The model it is compared with.
    Rival,
    /// A third series.
    Third,
    /// Noise, a band of chance.
    Noise,
    /// The surroundings of a voltage edge.
    Edge,
    /// A moment or a level that is pointed out.
    Mark,
    /// What was not used.
    Unused,
}

impl Ink {
    /// Name in the style sheet and in JSON.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Model => "model",
            Self::Rival => "rival",
            Self::Third => "third",
            Self::Noise => "noise",
            Self::Edge => "edge",
            Self::Mark => "mark",
            Self::Unused => "unused",
        }
    }
}

/// Shape of a point, so that no meaning rests on colour alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// A filled dot.
    Dot,
    /// A ring.
    Ring,
}

impl Shape {
    /// Name in JSON.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Dot => "dot",
            Self::Ring => "ring",
        }
    }
}

/// Something drawn in a panel, in data coordinates. Where `x` is none, the chart's own is meant.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Mark {
    /// A curve; a value that is not finite breaks it.
    Line {
        name: String,
        ink: Ink,
        x: Option<Vec<f64>>,
        y: Vec<f64>,
        dashed: bool,
    },
    /// Points; `shade` is 0 to 1 for each where the colour tells something of its own.
    Points {
        name: String,
        ink: Ink,
        shape: Shape,
        x: Option<Vec<f64>>,
        y: Vec<f64>,
        shade: Option<Vec<f64>>,
    },
    /// The area between two curves.
    Band {
        name: String,
        ink: Ink,
        x: Option<Vec<f64>>,
        low: Vec<f64>,
        high: Vec<f64>,
    },
    /// Bars from `base` upwards or downwards.
    Bars {
        name: String,
        ink: Ink,
        x: Vec<f64>,
        y: Vec<f64>,
        base: f64,
        half_width: f64,
    },
    /// A strip over the panel's whole height.
    Strip {
        name: String,
        from: f64,
        to: f64,
        ink: Ink,
    },
    /// A line over the panel's whole height.
    Upright { at: f64 },
    /// A line over the panel's whole width.
    Level { name: String, ink: Ink, at: f64 },
    /// A word at a point, to its right.
    Label { x: f64, y: f64, text: String },
}

impl Mark {
    /// Name and ink for the legend; none for a mark that needs no explanation.
    pub(super) fn legend(&self) -> Option<(&str, Ink)> {
        match self {
            Self::Line { name, ink, .. }
            | Self::Points { name, ink, .. }
            | Self::Band { name, ink, .. }
            | Self::Bars { name, ink, .. }
            | Self::Strip { name, ink, .. }
            | Self::Level { name, ink, .. } => (!name.is_empty()).then_some((name, *ink)),
            Self::Upright { .. } | Self::Label { .. } => None,
        }
    }

    /// Whether it is drawn before the others.
    pub(super) const fn lies_behind(&self) -> bool {
        matches!(
            self,
            Self::Strip { .. } | Self::Band { .. } | Self::Upright { .. } | Self::Level { .. }
        )
    }
}

/// One panel of a chart.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Panel {
    /// What is drawn, with its unit.
    pub(super) title: String,
    /// Height of the plotted area, CSS pixels.
    pub(super) height: u32,
    /// Lowest and highest value shown.
    pub(super) vertical: (f64, f64),
    /// Whether vertical coordinates are decimal logarithms of what the ticks shall say.
    pub(super) logarithmic: bool,
    /// What is drawn.
    pub(super) marks: Vec<Mark>,
}

/// Panels over one horizontal axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Chart {
    /// Unique in its page.
    pub(super) id: String,
    /// What it shows, in a few words.
    pub(super) title: String,
    /// What it shows, in a sentence, for those who do not see it.
    pub(super) description: String,
    /// Quantity and unit of the horizontal axis.
    pub(super) horizontal_title: String,
    /// Lowest and highest horizontal value shown.
    pub(super) horizontal: (f64, f64),
    /// Names of the places 0, 1, 2 ... where the axis has no numbers.
    pub(super) names: Vec<String>,
    /// Horizontal values shared by marks without their own.
    pub(super) x: Vec<f64>,
    /// Charts of one page with the same word zoom together.
    pub(super) linked: Option<&'static str>,
    /// The panels, from above.
    pub(super) panels: Vec<Panel>,
}

impl Chart {
    /// The horizontal values of a mark.
    pub(super) fn x_of<'a>(&'a self, own: Option<&'a Vec<f64>>) -> &'a [f64] {
        own.map_or(&self.x, Vec::as_slice)
    }

    /// Each name of the legend once, in order.
    pub(super) fn legend(&self) -> Vec<(&str, Ink)> {
        let mut entries: Vec<(&str, Ink)> = Vec::new();
        for entry in self
            .panels
            .iter()
            .flat_map(|p| &p.marks)
            .filter_map(Mark::legend)
        {
            if !entries.contains(&entry) {
                entries.push(entry);
            }
        }
        entries
    }
}

#[cfg(test)]
pub(super) fn example() -> Chart {
    Chart {
        id: "c".to_owned(),
        title: "<script>".to_owned(),
        description: "a & b".to_owned(),
        horizontal_title: "time, s".to_owned(),
        horizontal: (0.0, 2.0),
        names: Vec::new(),
        x: vec![0.0, 1.0, 2.0],
        linked: Some("time"),
        panels: vec![Panel {
            title: "V, pu".to_owned(),
            height: 100,
            vertical: (0.0, 1.0),
            logarithmic: false,
            marks: vec![
                Mark::Line {
                    name: "measured".to_owned(),
                    ink: Ink::Measured,
                    x: None,
                    y: vec![1.0, f64::NAN, 0.5],
                    dashed: false,
                },
                Mark::Label {
                    x: 1.0,
                    y: 0.5,
                    text: "<b>".to_owned(),
                },
            ],
        }],
    }
}
