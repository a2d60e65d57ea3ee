//! The filter through which an instrument sees phasors.
//!
//! A phasor is a weighted mean over a window centred on its time stamp. The two shapes here are the
//! ones whose width is fixed by the nominal frequency: the mean over one cycle, and the triangle over
//! two cycles of IEEE C37.118.1-2011, annex C.5 (P class).

/// Shape of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhasorFilter {
    /// Samples that no window has spread.
    None,
    /// Mean over one nominal cycle.
    OneCycle,
    /// Triangle over two nominal cycles.
    PClass,
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
        }
    }

    /// Half of the window's width, in nominal cycles.
    pub(super) const fn half_width_cycles(self) -> f64 {
        match self {
            Self::None => 0.0,
            Self::OneCycle => 0.5,
            Self::PClass => 1.0,
        }
    }

    /// Weight at `offset` half widths from the middle, up to a factor.
    pub(super) fn weight(self, offset: f64) -> f64 {
        match self {
            Self::None | Self::OneCycle => 1.0,
            Self::PClass => 1.0 - offset.abs(),
        }
    }

    /// Slope of [`Self::weight`], of the side on which `offset` lies.
    pub(super) fn slope(self, offset: f64) -> f64 {
        match self {
            Self::None | Self::OneCycle => 0.0,
            Self::PClass => -offset.signum(),
        }
    }
}
