//! Dormand and Prince's explicit Runge-Kutta method of order 5 with an error estimate of order 4
//! adaptive steps, and a continuous extension with which instants inside a step can be found.
//!
//! Source: J. R. Dormand, P. J. Prince, "A family of embedded Runge-Kutta formulae" (1980); step
//! control as in Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", II.4 (4.13).

use super::TruthError;

/// Accuracy of the integration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntegratorOptions {
    /// Error admitted per step, relative to a state and absolute; default 1e-10, above 0.
    pub tolerance: f64,
    /// Longest step, seconds; default 20e-3, above 0.
    pub step_max_s: f64,
    /// Distance of the instants at which phasors are kept, in milliseconds, where the solution
    /// allows steps five times as long; it never is less than 1; default 1.
    pub spacing_max: u32,
}

impl IntegratorOptions {
    /// Milliseconds between the instants kept inside a step of `step_s`.
    pub(super) fn nodes_every(&self, step_s: f64) -> f64 {
        // From one node a millisecond on; five and more nodes in every longer step.
        (step_s / 5e-3)
            .floor()
            .clamp(1.0, f64::from(self.spacing_max.max(1)))
    }
}

impl Default for IntegratorOptions {
    fn default() -> Self {
        Self {
            tolerance: 1e-10,
            step_max_s: 20e-3,
            spacing_max: 1,
        }
    }
}

/// Steps below this length mean that the solution has broken down, seconds.
const STEP_MIN_S: f64 = 1e-10;
/// Longest first step after a jump, seconds: transients of motors begin within milliseconds.
const RESTART_STEP_S: f64 = 2e-3;

const NODES: [f64; 7] = [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];
const STAGES: [&[f64]; 7] = [
    &[],
    &[1.0 / 5.0],
    &[3.0 / 40.0, 9.0 / 40.0],
    &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
    &[
        19_372.0 / 6_561.0,
        -25_360.0 / 2_187.0,
        64_448.0 / 6_561.0,
        -212.0 / 729.0,
    ],
    &[
        9_017.0 / 3_168.0,
        -355.0 / 33.0,
        46_732.0 / 5_247.0,
        49.0 / 176.0,
        -5_103.0 / 18_656.0,
    ],
    &[
        35.0 / 384.0,
        0.0,
        500.0 / 1_113.0,
        125.0 / 192.0,
        -2_187.0 / 6_784.0,
        11.0 / 84.0,
    ],
];
/// Weights of order 5 minus weights of order 4.
const ERROR: [f64; 7] = [
    71.0 / 57_600.0,
    0.0,
    -71.0 / 16_695.0,
    71.0 / 1_920.0,
    -17_253.0 / 339_200.0,
    22.0 / 525.0,
    -1.0 / 40.0,
];

/// Coefficients of the continuous extension of order 4 (Hairer, Norsett, Wanner, II.6, and their
/// program DOPRI5).
const EXTENSION: [f64; 7] = [
    -12_715_105_075.0 / 11_282_082_432.0,
    0.0,
    87_487_479_700.0 / 32_700_410_799.0,
    -10_690_763_975.0 / 1_880_347_072.0,
    701_980_252_875.0 / 199_316_789_632.0,
    -1_453_857_185.0 / 822_651_844.0,
    69_997_945.0 / 29_380_423.0,
];

/// Takes steps that keep a tolerance and knows the solution between their ends.
#[derive(Clone, Debug)]
pub(super) struct Integrator {
    options: IntegratorOptions,
    /// Step to try next, seconds.
    step_s: f64,
    /// Length of the last accepted step, seconds.
    taken_s: f64,
    /// Whether the last slope of the last step is the first one of the next.
    continues: bool,
    stages: Vec<Vec<f64>>,
    before: Vec<f64>,
    trial: Vec<f64>,
}

impl Integrator {
    pub(super) fn new(options: IntegratorOptions, states: usize) -> Self {
        Self {
            options,
            step_s: options.step_max_s,
            taken_s: 0.0,
            continues: false,
            stages: vec![vec![0.0; states]; STAGES.len()],
            before: vec![0.0; states],
            trial: vec![0.0; states],
        }
    }

    /// Forgets the slope at the end of the last step: state or equations have changed by a jump.
    pub(super) fn restart(&mut self) {
        self.continues = false;
        self.step_s = self.step_s.min(RESTART_STEP_S);
    }

    /// Takes one step from `time_s`, at most to `limit_s`; the instant reached. The state there is
    /// [`Integrator::reached`].
    ///
    /// # Errors
    ///
    /// What `derivatives` reports at `state`, and [`TruthError::StepTooSmall`].
    pub(super) fn step(
        &mut self,
        (time_s, limit_s): (f64, f64),
        state: &[f64],
        derivatives: &mut impl FnMut(f64, &[f64], &mut [f64]) -> Result<(), TruthError>,
    ) -> Result<f64, TruthError> {
        self.before.copy_from_slice(state);
        if self.continues {
            self.stages.swap(0, STAGES.len() - 1);
        } else {
            derivatives(time_s, state, &mut self.stages[0])?;
        }
        loop {
            let step = self.step_s.min(self.options.step_max_s);
            let reaches_limit = time_s + step >= limit_s;
            let step = if reaches_limit {
                limit_s - time_s
            } else {
                step
            };
            let error = self.try_step(time_s, step, derivatives);
            let next = step * step_factor(error);
            // A short last step says nothing about the step that the solution admits.
            if error > 1.0 || !reaches_limit || next > self.step_s {
                self.step_s = next;
            }
            if error <= 1.0 {
                self.taken_s = step;
                self.continues = true;
                return Ok(if reaches_limit {
                    limit_s
                } else {
                    time_s + step
                });
            }
            if step < STEP_MIN_S {
                return Err(TruthError::StepTooSmall {
                    time_s,
                    step_s: STEP_MIN_S,
                });
            }
        }
    }

    /// The state at the end of the last step.
    pub(super) fn reached(&self) -> &[f64] {
        &self.trial
    }

    /// The state `after_s` seconds after the beginning of the last step, inside it, to order 4.
    pub(super) fn inside(&self, after_s: f64, state: &mut [f64]) {
        let h = self.taken_s;
        let share = (after_s / h).clamp(0.0, 1.0);
        let rest = 1.0 - share;
        let last = STAGES.len() - 1;
        for (k, value) in state.iter_mut().enumerate() {
            let change = self.trial[k] - self.before[k];
            let leaving = h * self.stages[0][k] - change;
            let arriving = change - h * self.stages[last][k] - leaving;
            let slopes = EXTENSION.iter().zip(&self.stages);
            let bend: f64 = slopes.map(|(weight, stage)| weight * stage[k]).sum();
            let inner = leaving + share * (arriving + rest * h * bend);
            *value = self.before[k] + share * (change + rest * inner);
        }
    }

    /// Advances `state` from `from_s` to `to_s`.
    pub(super) fn advance(
        &mut self,
        (from_s, to_s): (f64, f64),
        state: &mut [f64],
        derivatives: &mut impl FnMut(f64, &[f64], &mut [f64]) -> Result<(), TruthError>,
    ) -> Result<(), TruthError> {
        let mut time_s = from_s;
        while time_s < to_s {
            time_s = self.step((time_s, to_s), state, derivatives)?;
            state.copy_from_slice(self.reached());
        }
        Ok(())
    }

    /// Fills `trial` with the state after `step`; the error over the tolerance, infinite where the
    /// derivatives could not be had.
    fn try_step(
        &mut self,
        time_s: f64,
        step: f64,
        derivatives: &mut impl FnMut(f64, &[f64], &mut [f64]) -> Result<(), TruthError>,
    ) -> f64 {
        for stage in 1..STAGES.len() {
            for (k, trial) in self.trial.iter_mut().enumerate() {
                let weights = STAGES[stage].iter().zip(&self.stages);
                let slope: f64 = weights.map(|(weight, stage)| weight * stage[k]).sum();
                *trial = self.before[k] + step * slope;
            }
            let at = time_s + NODES[stage] * step;
            if derivatives(at, &self.trial, &mut self.stages[stage]).is_err() {
                return f64::INFINITY;
            }
        }
        let tolerance = self.options.tolerance;
        let sum: f64 = (0..self.before.len())
            .map(|k| {
                let slopes = ERROR.iter().zip(&self.stages);
                let error: f64 = slopes.map(|(weight, stage)| weight * stage[k]).sum();
                let scale = tolerance * (1.0 + self.before[k].abs().max(self.trial[k].abs()));
                (step * error / scale).powi(2)
            })
            .sum();
        (sum / self.before.len().max(1) as f64).sqrt()
    }
}

fn step_factor(error: f64) -> f64 {
    if error.is_finite() {
        (0.9 * error.max(1e-10).powf(-0.2)).clamp(0.2, 5.0)
    } else {
        0.2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x' = -x + sin t, x(0) = 1: x = 1.5 exp(-t) + (sin t - cos t)/2.
    fn error_at_tolerance(tolerance: f64, step_max_s: f64) -> f64 {
        let options = IntegratorOptions {
            tolerance,
            step_max_s,
            ..IntegratorOptions::default()
        };
        let mut state = [1.0];
        Integrator::new(options, 1)
            .advance((0.0, 3.0), &mut state, &mut |t, x, dx| {
                dx[0] = -x[0] + t.sin();
                Ok(())
            })
            .unwrap();
        let exact = 1.5 * (-3.0_f64).exp() + (3.0_f64.sin() - 3.0_f64.cos()) / 2.0;
        (state[0] - exact).abs()
    }

    #[test]
    fn the_solution_of_a_linear_equation_is_met_within_the_tolerance() {
        let error = error_at_tolerance(1e-10, 1.0);
        assert!(error < 1e-9, "{error:e}");
    }

    #[test]
    fn halving_the_step_divides_the_error_by_thirty_two() {
        let (coarse, fine) = (error_at_tolerance(1.0, 0.2), error_at_tolerance(1.0, 0.1));
        let ratio = coarse / fine;
        // Order 5: 2^5 = 32; the next order's term moves it by a few.
        assert!(
            (24.0..42.0).contains(&ratio),
            "{coarse:e} / {fine:e} = {ratio}"
        );
    }

    #[test]
    fn inside_a_step_the_solution_is_known_to_order_four() {
        let worst_inside = |step_s: f64| {
            let options = IntegratorOptions {
                tolerance: 1.0,
                step_max_s: step_s,
                ..IntegratorOptions::default()
            };
            let mut integrator = Integrator::new(options, 1);
            let reached = integrator
                .step((0.0, 10.0), &[1.0], &mut |t, x, dx| {
                    dx[0] = -x[0] + t.sin();
                    Ok(())
                })
                .unwrap();
            assert!((reached - step_s).abs() < 1e-15);
            (1..10).fold(0.0_f64, |worst, tenth| {
                let t = 0.1 * f64::from(tenth) * step_s;
                let mut state = [0.0];
                integrator.inside(t, &mut state);
                let exact = 1.5 * (-t).exp() + (t.sin() - t.cos()) / 2.0;
                worst.max((state[0] - exact).abs())
            })
        };
        let (coarse, fine) = (worst_inside(0.2), worst_inside(0.1));
        // One step of an extension of order 4: an error in the fifth power, 2^5 = 32.
        assert!(
            (20.0..45.0).contains(&(coarse / fine)),
            "{coarse:e} / {fine:e}"
        );
        assert!(fine < 1e-7, "{fine:e}");
    }

    #[test]
    fn a_solution_that_blows_up_is_an_error_with_its_time() {
        let mut state = [1.0];
        let outcome = Integrator::new(IntegratorOptions::default(), 1).advance(
            (0.0, 2.0),
            &mut state,
            &mut |_, x, dx| {
                dx[0] = x[0] * x[0];
                Ok(())
            },
        );
        let Err(TruthError::StepTooSmall { time_s, .. }) = outcome else {
            panic!("{outcome:?}");
        };
        assert!((time_s - 1.0).abs() < 1e-3, "x = 1/(1 - t): {time_s}");
    }
}
