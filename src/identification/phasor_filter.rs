//! The filter through which an instrument sees phasors.
//!
//! A phasor is a weighted mean over a window centred on its time stamp. The two shapes here are the
//! ones whose width is fixed by the nominal frequency: the mean over one cycle, and the triangle over
//! two cycles of IEEE C37.118.1-2011, annex C.5 (P class). Longer windows are those of instruments
//! that no model of a load takes for granted (`phasor_window`).

/// Shape of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhasorFilter {
    /// Samples that no window has spread.
    None,
    /// Mean over one nominal cycle.
    OneCycle,
    /// Triangle over two nominal cycles.
    PClass,
    /// A longer window.
    Longer(LongerWindow),
}

/// A window longer than those of the standard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LongerWindow {
    /// Its shape.
    pub shape: WindowShape,
    /// Its whole width, twentieths of a nominal cycle.
    pub twentieths: u16,
}

/// How a longer window weighs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WindowShape {
    /// All alike.
    Mean,
    /// The middle most.
    Triangle,
}

impl LongerWindow {
    /// Its whole width, nominal cycles.
    #[must_use]
    pub fn cycles(self) -> f64 {
        f64::from(self.twentieths) / 20.0
    }

    /// In words.
    #[must_use]
    pub fn in_words(self) -> String {
        let shape = match self.shape {
            WindowShape::Mean => "mean",
            WindowShape::Triangle => "triangle",
        };
        format!("a {shape} over {:.1} nominal cycles", self.cycles())
    }
}

/// Which filter intake takes for granted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterChoice {
    /// What explains the edges of the event best.
    Auto,
    /// Always this one.
    Fixed(PhasorFilter),
}

impl PhasorFilter {
    /// Name in configuration and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::OneCycle => "one_cycle",
            Self::PClass => "p_class",
            Self::Longer(_) => "longer",
        }
    }

    /// Whether samples were spread by a window of the standard.
    #[must_use]
    pub const fn is_of_the_standard(self) -> bool {
        matches!(self, Self::OneCycle | Self::PClass)
    }

    /// Half of the window's width, in nominal cycles.
    pub(super) fn half_width_cycles(self) -> f64 {
        match self {
            Self::None => 0.0,
            Self::OneCycle => 0.5,
            Self::PClass => 1.0,
            Self::Longer(window) => 0.5 * window.cycles(),
        }
    }

    /// Whether the middle of the window weighs most.
    const fn is_triangle(self) -> bool {
        match self {
            Self::None | Self::OneCycle => false,
            Self::PClass => true,
            Self::Longer(window) => matches!(window.shape, WindowShape::Triangle),
        }
    }

    /// Weight at `offset` half widths from the middle, up to a factor.
    pub(super) fn weight(self, offset: f64) -> f64 {
        if self.is_triangle() {
            1.0 - offset.abs()
        } else {
            1.0
        }
    }

    /// Slope of [`Self::weight`], of the side on which `offset` lies.
    pub(super) fn slope(self, offset: f64) -> f64 {
        if self.is_triangle() {
            -offset.signum()
        } else {
            0.0
        }
    }
}
