//! The voltage at which grid and load agree.

use super::{
    Phasor, TruthError,
    load::{Load, Terminal},
    network::{Grid, MACHINE_STATES},
};

/// What grid and load agree on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Solution {
    /// Voltage at the load itself, pu.
    pub(super) terminal: Phasor,
    /// Voltage where it is measured, pu.
    pub(super) voltage: Phasor,
    /// Current where it is measured, pu.
    pub(super) current: Phasor,
}

/// Newton's method on `V - a (V_open - Z a I(V)) = 0`, `a` the ratio of the taps.
///
/// The Jacobian comes from differences and is kept as long as it works: from one stage of the
/// integrator to the next it hardly changes.
#[derive(Clone, Debug)]
pub(super) struct Solver {
    /// Last solution, from which the next search starts.
    voltage: Phasor,
    jacobian: Option<Jacobian>,
}

/// Derivatives of the mismatch along the real and the imaginary axis.
#[derive(Clone, Copy, Debug)]
struct Jacobian {
    along_re: Phasor,
    along_im: Phasor,
}

impl Jacobian {
    fn of(mismatch: &impl Fn(Phasor) -> Phasor, voltage: Phasor, left: Phasor) -> Self {
        const DIFFERENCE_PU: f64 = 1e-7;
        let along = |step: Phasor| (mismatch(voltage + step) - left) / DIFFERENCE_PU;
        Self {
            along_re: along(Phasor::new(DIFFERENCE_PU, 0.0)),
            along_im: along(Phasor::new(0.0, DIFFERENCE_PU)),
        }
    }

    fn step(&self, left: Phasor) -> Phasor {
        let (re, im) = (self.along_re, self.along_im);
        let determinant = re.re * im.im - im.re * re.im;
        Phasor::new(
            (left.re * im.im - im.re * left.im) / determinant,
            (re.re * left.im - left.re * re.im) / determinant,
        )
    }
}

impl Solver {
    pub(super) fn starting_from(voltage: Phasor) -> Self {
        Self {
            voltage,
            jacobian: None,
        }
    }

    /// The solution nearest to the last one.
    ///
    /// # Errors
    ///
    /// [`TruthError::NoNetworkSolution`].
    pub(super) fn solve(
        &mut self,
        grid: &Grid,
        load: &Load,
        state: &[f64],
        time_s: f64,
    ) -> Result<Solution, TruthError> {
        let (machines, parts) = state.split_at(MACHINE_STATES);
        let (open, behind) = grid.seen_from_load(machines);
        let ratio = load.supply.ratio();
        let impedance = (behind + load.supply.impedance) * ratio;
        let current = |voltage| load.current(Terminal { time_s, voltage }, parts);
        let mismatch = |voltage| voltage - ratio * (open - impedance * current(voltage));
        let terminal = self.root(&mismatch, time_s)?;
        let drawn = ratio * current(terminal);
        Ok(Solution {
            terminal,
            voltage: open - behind * drawn,
            current: drawn,
        })
    }

    fn root(
        &mut self,
        mismatch: &impl Fn(Phasor) -> Phasor,
        time_s: f64,
    ) -> Result<Phasor, TruthError> {
        const MISMATCH_MAX_PU: f64 = 1e-12;
        const ITERATIONS_MAX: usize = 60;
        let mut voltage = self.voltage;
        let mut left = mismatch(voltage);
        for _ in 0..ITERATIONS_MAX {
            if left.norm() <= MISMATCH_MAX_PU {
                self.voltage = voltage;
                return Ok(voltage);
            }
            if let Some(kept) = self.jacobian {
                let next = voltage - kept.step(left);
                let left_next = mismatch(next);
                // A kept Jacobian that gains less than a digit is worth less than a new one.
                if left_next.norm() < 0.1 * left.norm() {
                    (voltage, left) = (next, left_next);
                    continue;
                }
            }
            let fresh = Jacobian::of(mismatch, voltage, left);
            (voltage, left) = damped(voltage, fresh.step(left), left.norm(), mismatch);
            self.jacobian = Some(fresh);
        }
        self.jacobian = None;
        Err(TruthError::NoNetworkSolution {
            time_s,
            mismatch_pu: left.norm(),
        })
    }
}

/// The point along Newton's step, halved until the mismatch falls, and its mismatch.
fn damped(
    voltage: Phasor,
    step: Phasor,
    mismatch_before: f64,
    mismatch: &impl Fn(Phasor) -> Phasor,
) -> (Phasor, Phasor) {
    let mut factor = 1.0;
    loop {
        let next = voltage - step * factor;
        let left = mismatch(next);
        if left.norm() < mismatch_before || factor < 1e-3 {
            return (next, left);
        }
        factor *= 0.5;
    }
}
