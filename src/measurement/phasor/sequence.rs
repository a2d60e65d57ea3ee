//! Symmetrical components of three-phase voltages and currents.

use std::f64::consts::{FRAC_PI_6, TAU};

use super::filter::{Complex, Window};

/// How the voltage channels are connected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Connection {
    /// Phase to ground: a, b, c.
    #[default]
    LineToGround,
    /// Between phases: ab, bc, ca.
    LineToLine,
}

/// Sampled three-phase voltages and currents of one load, in volts and amperes, primary, currents
/// positive into the load.
#[derive(Clone, Debug, PartialEq)]
pub struct Waveforms {
    /// UTC nanoseconds of time zero.
    pub start_ns: i64,
    /// Nominal frequency, Hz.
    pub nominal_hz: f64,
    /// Time of each sample, seconds, increasing.
    pub time_s: Vec<f64>,
    /// Voltages of the three phases, volts; each as long as `time_s`.
    pub voltage_v: [Vec<f64>; 3],
    /// Connection of the voltages.
    pub connection: Connection,
    /// Currents of the three phases, amperes; each as long as `time_s`.
    pub current_a: [Vec<f64>; 3],
}

/// Sequence phasors at one instant: effective values of phase quantities (line to ground), in the
/// frame that turns at nominal frequency from time zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequencePhasors {
    /// Time, seconds.
    pub time_s: f64,
    /// Positive-sequence voltage, volts.
    pub v1: Complex,
    /// Negative-sequence voltage, volts; its conjugate is what turns with the frame.
    pub v2: Complex,
    /// Positive-sequence current, amperes.
    pub i1: Complex,
    /// Negative-sequence current, amperes.
    pub i2: Complex,
}

impl SequencePhasors {
    /// Three-phase positive-sequence power 3 V1 conj(I1), voltamperes.
    #[must_use]
    pub fn power_va(&self) -> Complex {
        (self.v1 * self.i1.conjugate()).scale(3.0)
    }

    /// All quantities times `factor`.
    pub(super) fn scaled(self, factor: f64) -> Self {
        Self {
            time_s: self.time_s,
            v1: self.v1.scale(factor),
            v2: self.v2.scale(factor),
            i1: self.i1.scale(factor),
            i2: self.i2.scale(factor),
        }
    }
}

/// The phasors at `centre_s` from the samples `first..end`; none where they do not cover the
/// window. No correction for frequency.
pub(super) fn at(
    waveforms: &Waveforms,
    first: usize,
    end: usize,
    centre_s: f64,
) -> Option<SequencePhasors> {
    let window = Window::at(
        &waveforms.time_s[first..end],
        centre_s,
        waveforms.nominal_hz,
    )?;
    // The window's phasors refer to its centre; this turns them into the frame of time zero.
    let cycles = waveforms.nominal_hz * centre_s;
    let frame = Complex::polar(1.0, -TAU * cycles.fract());
    let phases = |channels: &[Vec<f64>; 3]| {
        let [a, b, c] = channels;
        [a, b, c].map(|values| window.phasor(&values[first..end]) * frame)
    };
    let (v1, v2) = components(phases(&waveforms.voltage_v));
    let (i1, i2) = components(phases(&waveforms.current_a));
    let (v1, v2) = match waveforms.connection {
        Connection::LineToGround => (v1, v2),
        // Vab1 = sqrt(3) exp(+j 30 deg) Va1 and Vab2 = sqrt(3) exp(-j 30 deg) Va2.
        Connection::LineToLine => {
            let by = |angle| Complex::polar(1.0 / 3.0_f64.sqrt(), angle);
            (v1 * by(-FRAC_PI_6), v2 * by(FRAC_PI_6))
        }
    };
    Some(SequencePhasors {
        time_s: centre_s,
        v1,
        v2,
        i1,
        i2,
    })
}

/// Positive and negative sequence of three phasors: X1 = (A + a B + a^2 C) / 3,
/// X2 = (A + a^2 B + a C) / 3, a = exp(j 120 deg).
fn components([a, b, c]: [Complex; 3]) -> (Complex, Complex) {
    let turn = Complex::polar(1.0, TAU / 3.0);
    let back = turn.conjugate();
    let third = |x: Complex| x.scale(1.0 / 3.0);
    (
        third(a + turn * b + back * c),
        third(a + back * b + turn * c),
    )
}
