//! The terms a residual may be made of: functions of time that the language of effect files can
//! write, each zero at rest.

/// What a term is about, in an engineer's words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Class {
    /// A function of the present voltage.
    Static,
    /// Follows changes of the voltage within a few cycles.
    Quick,
    /// Lags behind the voltage like a motor does.
    Dynamic,
    /// Follows the voltage over seconds.
    Recovering,
    /// Follows the frequency.
    Frequency,
    /// Load that stays away, or remains, after a dip beyond a threshold.
    Lasting,
    /// The same, coming back with time.
    Returning,
    /// Load that is away while the voltage is low.
    WhileLow,
    /// A slope over the whole window.
    Drift,
}

/// A shape of a term: a threshold or a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shape {
    pub(super) kind: ShapeKind,
    pub(super) value: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ShapeKind {
    Threshold,
    Delay,
    Time,
    Exponent,
}

/// A term with the values of its shapes: voltages in pu of V0, times in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Term {
    /// `v^n - 1`.
    Power { exponent: f64 },
    /// `max(V - v, 0)`.
    Deficit { threshold: f64 },
    /// `max(v - V, 0)`.
    Excess { threshold: f64 },
    /// `below(v, V)`.
    Below { threshold: f64 },
    /// `v - lag(v, T)`.
    Lag { time_s: f64 },
    /// `df`.
    Frequency,
    /// `lag(df, T)`.
    FrequencyLag { time_s: f64 },
    /// `latch(below(v, V), D)`.
    Lost { threshold: f64, delay_s: f64 },
    /// The same times `v^2`.
    LostImpedance { threshold: f64, delay_s: f64 },
    /// The latch times what is left of a ramp that ends after T.
    LostRamp { threshold: f64, time_s: f64 },
    /// The latch times an exponential that falls with T.
    LostDecay { threshold: f64, time_s: f64 },
    /// `max(V - minimum_since_start(v), 0)`.
    Memory { threshold: f64 },
    /// `t`.
    Drift,
}

/// Delay of latches whose other shape is a time: shorter than a cycle, longer than a phasor's jump.
pub(super) const QUICK_DELAY_S: f64 = 0.01;
/// Least voltage of which a power is taken.
pub(super) const POWER_VOLTAGE_MIN: f64 = 0.01;
/// Below this time constant a lag stands for the rate of change of the voltage.
const RATE_TIME_S: f64 = 0.05;
/// Beyond this a lag is a recovery and not a motor.
const RECOVERY_TIME_S: f64 = 1.5;

impl Term {
    pub(super) fn class(&self) -> Class {
        match *self {
            Self::Power { .. } | Self::Deficit { .. } | Self::Excess { .. } => Class::Static,
            Self::Below { .. } => Class::WhileLow,
            Self::Lag { time_s } if time_s < RATE_TIME_S => Class::Quick,
            Self::Lag { time_s } if time_s < RECOVERY_TIME_S => Class::Dynamic,
            Self::Lag { .. } => Class::Recovering,
            Self::Frequency | Self::FrequencyLag { .. } => Class::Frequency,
            Self::Lost { .. } | Self::LostImpedance { .. } | Self::Memory { .. } => Class::Lasting,
            Self::LostRamp { .. } | Self::LostDecay { .. } => Class::Returning,
            Self::Drift => Class::Drift,
        }
    }

    /// Its shapes, in the order of its formula's symbols.
    pub(super) fn shapes(&self) -> Vec<Shape> {
        let shape = |kind, value| Shape { kind, value };
        match *self {
            Self::Power { exponent } => vec![shape(ShapeKind::Exponent, exponent)],
            Self::Deficit { threshold }
            | Self::Excess { threshold }
            | Self::Below { threshold }
            | Self::Memory { threshold } => vec![shape(ShapeKind::Threshold, threshold)],
            Self::Lag { time_s } | Self::FrequencyLag { time_s } => {
                vec![shape(ShapeKind::Time, time_s)]
            }
            Self::Lost { threshold, delay_s } | Self::LostImpedance { threshold, delay_s } => vec![
                shape(ShapeKind::Threshold, threshold),
                shape(ShapeKind::Delay, delay_s),
            ],
            Self::LostRamp { threshold, time_s } | Self::LostDecay { threshold, time_s } => vec![
                shape(ShapeKind::Threshold, threshold),
                shape(ShapeKind::Time, time_s),
            ],
            Self::Frequency | Self::Drift => Vec::new(),
        }
    }

    /// Its formula with the values of its shapes.
    pub(super) fn formula(&self) -> String {
        let values: Vec<String> = self.shapes().iter().map(written).collect();
        self.formula_with(&values)
    }

    /// Its formula with these texts in place of its shapes.
    pub(super) fn formula_with(&self, shapes: &[String]) -> String {
        let shape = |k: usize| shapes.get(k).map_or("", String::as_str);
        let (a, b) = (shape(0), shape(1));
        let quick = written(&Shape {
            kind: ShapeKind::Delay,
            value: QUICK_DELAY_S,
        });
        match self {
            Self::Power { .. } => format!("(max(v, {POWER_VOLTAGE_MIN})^{a} - 1)"),
            Self::Deficit { .. } => format!("max({a} - v, 0)"),
            Self::Excess { .. } => format!("max(v - {a}, 0)"),
            Self::Below { .. } => format!("below(v, {a})"),
            Self::Lag { .. } => format!("(v - lag(v, {a}))"),
            Self::Frequency => "df".to_owned(),
            Self::FrequencyLag { .. } => format!("lag(df, {a})"),
            Self::Lost { .. } => format!("latch(below(v, {a}), {b})"),
            Self::LostImpedance { .. } => format!("latch(below(v, {a}), {b})*v^2"),
            Self::LostRamp { .. } => {
                let latch = format!("latch(below(v, {a}), {quick})");
                format!("{latch}*clip(1 - timer({latch})/{b}, 0, 1)")
            }
            Self::LostDecay { .. } => {
                let latch = format!("latch(below(v, {a}), {quick})");
                format!("{latch}*exp(-timer({latch})/{b})")
            }
            Self::Memory { .. } => format!("max({a} - minimum_since_start(v), 0)"),
            Self::Drift => "t".to_owned(),
        }
    }

    /// States it takes in an effect file.
    pub(super) fn states(&self) -> usize {
        match self {
            Self::Lag { .. } | Self::FrequencyLag { .. } | Self::Memory { .. } => 1,
            Self::Lost { .. } | Self::LostImpedance { .. } => 2,
            Self::LostRamp { .. } | Self::LostDecay { .. } => 3,
            _ => 0,
        }
    }

    /// Whether a motor of other parameters would add something like it.
    pub(super) fn is_like_a_motor(&self) -> bool {
        matches!(self.class(), Class::Quick | Class::Dynamic)
    }

    /// Unit of its coefficient.
    pub(super) fn coefficient_unit(&self) -> &'static str {
        match self {
            Self::Drift => "1/s",
            _ => "1",
        }
    }

    /// Whether the other differs in the threshold alone.
    pub(super) fn differs_in_threshold_only(&self, other: &Self) -> bool {
        let rest = |term: &Self| -> Vec<Shape> {
            let shapes = term.shapes().into_iter();
            shapes.filter(|s| s.kind != ShapeKind::Threshold).collect()
        };
        std::mem::discriminant(self) == std::mem::discriminant(other) && rest(self) == rest(other)
    }

    /// Its threshold, where it has one.
    pub(super) fn threshold(&self) -> Option<f64> {
        let found = self.shapes().into_iter();
        let mut thresholds = found.filter(|s| s.kind == ShapeKind::Threshold);
        thresholds.next().map(|s| s.value)
    }
}

/// The value of a shape in the language of effect files.
fn written(shape: &Shape) -> String {
    match shape.kind {
        ShapeKind::Threshold | ShapeKind::Exponent => format!("{}", shape.value),
        ShapeKind::Delay | ShapeKind::Time => format!("{}s", shape.value),
    }
}
