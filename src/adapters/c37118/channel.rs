//! The channels of a PMU: names, kinds and factors from the recorded number to the quantity.

use super::data::{Number, Phasor};
use crate::measurement::phasor::Complex;

/// Volts or amperes per unit of PHUNIT (table 9).
const PHASOR_UNIT: f64 = 1e-5;

/// What a phasor is a phasor of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhasorQuantity {
    /// Volts.
    Voltage,
    /// Amperes.
    Current,
    /// A reserved code of CFG-1 or CFG-2.
    Reserved(u8),
}

/// Phase or sequence of a phasor as CFG-3 states it (table 11, PHSCALE, third byte).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhasorComponent {
    /// Code 0.
    ZeroSequence,
    /// Code 1.
    PositiveSequence,
    /// Code 2.
    NegativeSequence,
    /// Code 4.
    PhaseA,
    /// Code 5.
    PhaseB,
    /// Code 6.
    PhaseC,
    /// Codes 3 and 7.
    Reserved(u8),
}

impl PhasorComponent {
    pub(super) const fn from_code(code: u8) -> Self {
        match code & 0x07 {
            0 => Self::ZeroSequence,
            1 => Self::PositiveSequence,
            2 => Self::NegativeSequence,
            4 => Self::PhaseA,
            5 => Self::PhaseB,
            6 => Self::PhaseC,
            code => Self::Reserved(code),
        }
    }

    pub(super) const fn code(self) -> u8 {
        match self {
            Self::ZeroSequence => 0,
            Self::PositiveSequence => 1,
            Self::NegativeSequence => 2,
            Self::PhaseA => 4,
            Self::PhaseB => 5,
            Self::PhaseC => 6,
            Self::Reserved(code) => code & 0x07,
        }
    }
}

/// How the numbers of a phasor become volts or amperes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PhasorScaling {
    /// CFG-1 and CFG-2 (PHUNIT): an integer is in steps of this many 1e-5 V or A (24 bits); a
    /// floating-point number is in volts or amperes already.
    PerBit(u32),
    /// CFG-3 (PHSCALE): X' = `factor` X exp(-j `angle_rad`), integer or floating point.
    Affine {
        /// Bits that say how the data were modified.
        modification: u16,
        /// Phase or sequence.
        component: PhasorComponent,
        /// Byte at the users' disposal.
        user: u8,
        /// Y, to primary volts or amperes.
        factor: f32,
        /// Angle taken off, radians.
        angle_rad: f32,
    },
}

/// A phasor channel.
#[derive(Clone, Debug, PartialEq)]
pub struct PhasorChannel {
    /// Name, without padding.
    pub name: String,
    /// Voltage or current.
    pub quantity: PhasorQuantity,
    /// From numbers to volts or amperes.
    pub scaling: PhasorScaling,
}

impl PhasorChannel {
    /// The phasor in volts or amperes (effective value), at its angle to UTC at nominal frequency;
    /// not a number where the source marked it as absent.
    #[must_use]
    pub fn value(&self, phasor: Phasor) -> Complex {
        let (numbers, integer) = phasor.numbers();
        match self.scaling {
            PhasorScaling::PerBit(units) if integer => {
                numbers.scale(f64::from(units) * PHASOR_UNIT)
            }
            PhasorScaling::PerBit(_) => numbers,
            PhasorScaling::Affine {
                factor, angle_rad, ..
            } => numbers * Complex::polar(f64::from(factor), -f64::from(angle_rad)),
        }
    }

    /// Phase or sequence, where a CFG-3 states it.
    #[must_use]
    pub const fn component(&self) -> Option<PhasorComponent> {
        match self.scaling {
            PhasorScaling::Affine { component, .. } => Some(component),
            PhasorScaling::PerBit(_) => None,
        }
    }
}

/// What an analog channel samples (table 9, ANUNIT).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnalogKind {
    /// Code 0: an instantaneous value.
    PointOnWave,
    /// Code 1: an effective value.
    Effective,
    /// Code 2: a peak value.
    Peak,
    /// Reserved (to 64) or agreed between users.
    Other(u8),
}

/// How the numbers of an analog channel become a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AnalogScaling {
    /// CFG-1 and CFG-2 (ANUNIT): what the factor (24 bits, signed) means is agreed between users.
    User {
        /// What is sampled.
        kind: AnalogKind,
        /// The agreed number.
        factor: i32,
    },
    /// CFG-3 (ANSCALE): X' = `factor` X + `offset`.
    Affine {
        /// M.
        factor: f32,
        /// B.
        offset: f32,
    },
}

/// An analog channel.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalogChannel {
    /// Name, without padding.
    pub name: String,
    /// From numbers to the quantity.
    pub scaling: AnalogScaling,
}

impl AnalogChannel {
    /// The value: scaled where a CFG-3 says how, else the number as sent; not a number where the
    /// source marked it as absent.
    #[must_use]
    pub fn value(&self, number: Number) -> f64 {
        match self.scaling {
            AnalogScaling::User { .. } => number.value(),
            AnalogScaling::Affine { factor, offset } => {
                f64::from(factor).mul_add(number.value(), f64::from(offset))
            }
        }
    }
}

/// A word of sixteen contacts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DigitalWord {
    /// Names from bit 0 to bit 15.
    pub names: [String; 16],
    /// Word whose exclusive or with the data is zero when all is normal.
    pub normal: u16,
    /// Bits that are in use.
    pub valid: u16,
}
