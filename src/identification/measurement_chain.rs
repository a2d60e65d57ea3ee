//! From what a load draws at the output instants of a simulation to what an instrument reports.
//!
//! A phasor filter acts on voltage and current, and the instrument multiplies what comes out:
//!
//! ```text
//! I = conj(S / u),   u' = sum_j w_j u_j,   S' = u' conj(sum_j w_j I_j) = sum_j c_j S_j,
//! c_j = w_j u' / u_j                                                                    (1)
//! ```
//!
//! For a given voltage that is linear in S, with complex weights: near a jump some of P shows in Q and the
//! other way round. Away from jumps the filter commutes with a load that responds linearly, and u, P
//! and Q are taken as they were measured. Soon after a jump load or generation may be switched, which the filter spreads as well
//! (decision 0126).

use nalgebra::Complex;

use super::phasor_filter::PhasorFilter;
use crate::{load_model::TerminalInput, numerics::Scalar};

mod late;

pub use late::LateReport;

/// The instrument of one event as a sparse linear operator.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasurementChain {
    grid: Grid,
    /// Output instant of each measured sample.
    instants: Vec<usize>,
    /// Samples that the filter changes, in order.
    filtered: Vec<FilteredSample>,
    voltage: Vec<f64>,
    frequency_deviation: Vec<f64>,
}

/// A measured sample near a jump: weights of the output instants under its window.
#[derive(Clone, Debug, PartialEq)]
pub struct FilteredSample {
    /// Number of the sample.
    pub sample: usize,
    first: usize,
    coefficients: Vec<[f64; 2]>,
    unity: [f64; 2],
    square: [f64; 2],
    line: [f64; 2],
}

/// P and Q that an instrument reports of the active powers 1, `v^2 - 1` and `v - 1`; reactive power
/// of the same size gives `[-Q, P]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StaticResponse {
    /// Of 1.
    pub unity: [f64; 2],
    /// Of `v^2 - 1`.
    pub square: [f64; 2],
    /// Of `v - 1`.
    pub line: [f64; 2],
}

/// What a chain is made of.
#[derive(Clone, Copy, Debug)]
pub struct ChainParts<'a> {
    /// The terminal voltage, with dense intervals under every window that holds a jump.
    pub input: &'a TerminalInput,
    /// Shape of the filter.
    pub filter: PhasorFilter,
    /// Half of its width, samples.
    pub half_width: f64,
    /// Instants of the jumps, samples, in order.
    pub jumps: &'a [f64],
    /// The samples that the filter changes.
    pub filtered: &'a [bool],
    /// Relative frequency deviation at the samples.
    pub frequency_deviation: &'a [f64],
}

impl MeasurementChain {
    /// The chain of an event. Cost: the window's output instants for every filtered sample.
    #[must_use]
    pub fn new(parts: &ChainParts<'_>) -> Self {
        let grid = Grid::new(parts);
        let per = parts.input.points_per_sample;
        let points = parts.input.output_points();
        let instants = (0..points.len())
            .filter(|&i| points[i].is_multiple_of(per))
            .collect();
        let filtered = (0..parts.filtered.len())
            .filter(|&k| parts.filtered[k])
            .filter_map(|k| grid.filtered_sample(k))
            .collect();
        let voltage = grid.u.iter().map(|u| u.norm()).collect();
        let last = parts.frequency_deviation.len().saturating_sub(1);
        let frequency_deviation = points
            .iter()
            .map(|&point| {
                let (k, share) = (point / per, (point % per) as f64 / per as f64);
                let (a, b) = (k.min(last), (k + 1).min(last));
                let df = parts.frequency_deviation;
                df[a] + share * (df[b] - df[a])
            })
            .collect();
        Self {
            grid,
            instants,
            filtered,
            voltage,
            frequency_deviation,
        }
    }

    /// `|u|` at every output instant.
    #[must_use]
    pub fn output_voltage(&self) -> &[f64] {
        &self.voltage
    }

    /// Relative frequency deviation at every output instant.
    #[must_use]
    pub fn output_frequency_deviation(&self) -> &[f64] {
        &self.frequency_deviation
    }

    /// Samples that the filter changes, in order.
    #[must_use]
    pub fn filtered(&self) -> &[FilteredSample] {
        &self.filtered
    }

    /// P and Q as the instrument reports them, sample by sample, from P and Q at every output
    /// instant.
    #[must_use]
    pub fn measured<S: Scalar>(&self, active: &[S], reactive: &[S]) -> Vec<[S; 2]> {
        let mut next = self.filtered.iter().peekable();
        self.instants
            .iter()
            .enumerate()
            .map(|(k, &at)| match next.next_if(|f| f.sample == k) {
                Some(filtered) => filtered.measured(active, reactive),
                None => [active[at], reactive[at]],
            })
            .collect()
    }

    /// The output instant of a sample.
    #[must_use]
    pub fn instant(&self, sample: usize) -> usize {
        self.instants[sample]
    }

    /// What the instrument reports of static load, sample by sample.
    #[must_use]
    pub fn static_responses(&self) -> Vec<StaticResponse> {
        let mut next = self.filtered.iter().peekable();
        self.instants
            .iter()
            .enumerate()
            .map(|(k, &at)| match next.next_if(|f| f.sample == k) {
                Some(filtered) => filtered.static_response(),
                None => StaticResponse::direct(self.voltage[at]),
            })
            .collect()
    }
}

impl StaticResponse {
    /// Without a filter.
    #[must_use]
    pub fn direct(v: f64) -> Self {
        Self {
            unity: [1.0, 0.0],
            square: [v * v - 1.0, 0.0],
            line: [v - 1.0, 0.0],
        }
    }
}

impl FilteredSample {
    /// P and Q that the instrument reports at this sample: equation (1).
    pub fn measured<S: Scalar>(&self, active: &[S], reactive: &[S]) -> [S; 2] {
        let mut sum = [S::constant(0.0), S::constant(0.0)];
        let window = self.first..self.first + self.coefficients.len();
        let powers = active[window.clone()].iter().zip(&reactive[window]);
        for ([re, im], (&p, &q)) in self.coefficients.iter().zip(powers) {
            sum[0] = sum[0] + p * *re - q * *im;
            sum[1] = sum[1] + p * *im + q * *re;
        }
        sum
    }

    /// What the instrument reports of static load at this sample.
    #[must_use]
    pub fn static_response(&self) -> StaticResponse {
        StaticResponse {
            unity: self.unity,
            square: self.square,
            line: self.line,
        }
    }
}

/// Output instants with their voltage, and the filter over them.
#[derive(Clone, Debug, PartialEq)]
struct Grid {
    /// Output instants, samples.
    time: Vec<f64>,
    u: Vec<Complex<f64>>,
    filter: PhasorFilter,
    /// Half of the window's width, samples.
    half_width: f64,
    /// Instants of the jumps, samples, in order.
    jumps: Vec<f64>,
    /// How far on either side of a jump an instant is on neither: the input spreads it over one fine grid interval.
    blurred: f64,
}

/// Simpson's rule, exact for a line times a line, divides by this.
const SIMPSON: f64 = 6.0;

/// A cell between output instants on which power runs straight: from `low` to `high` along the line
/// through instants `a` and `b`.
struct Cell {
    low: f64,
    high: f64,
    a: usize,
    b: usize,
}

impl Grid {
    fn new(parts: &ChainParts<'_>) -> Self {
        let per = parts.input.points_per_sample as f64;
        let points = parts.input.output_points();
        Self {
            filter: parts.filter,
            half_width: parts.half_width,
            jumps: parts.jumps.to_vec(),
            blurred: 0.5 / per + 1e-9,
            time: points.iter().map(|&p| p as f64 / per).collect(),
            u: points
                .iter()
                .map(|&p| Complex::new(parts.input.real[p], parts.input.imaginary[p]))
                .collect(),
        }
    }

    fn filtered_sample(&self, sample: usize) -> Option<FilteredSample> {
        let (first, weights, _) = self.weights(sample as f64)?;
        let u = &self.u[first..first + weights.len()];
        let seen: Complex<f64> = u.iter().zip(&weights).map(|(u, w)| u * w).sum();
        let coefficients: Vec<Complex<f64>> =
            u.iter().zip(&weights).map(|(u, w)| seen / u * w).collect();
        let response = |power: &dyn Fn(f64) -> f64| {
            let sum: Complex<f64> = (coefficients.iter().zip(u))
                .map(|(c, u)| c * power(u.norm()))
                .sum();
            [sum.re, sum.im]
        };
        Some(FilteredSample {
            sample,
            first,
            unity: response(&|_| 1.0),
            square: response(&|v| v * v - 1.0),
            line: response(&|v| v - 1.0),
            coefficients: coefficients.iter().map(|c| [c.re, c.im]).collect(),
        })
    }

    /// First output instant and the weights of it and those that follow in the mean over the window
    /// around `time`, which sum to 1, and the sum that they were divided by.
    fn weights(&self, time: f64) -> Option<(usize, Vec<f64>, f64)> {
        let (low, high) = (time - self.half_width, time + self.half_width);
        let end = self.time.len();
        // Two more instants each side for the lines that are extended to a jump.
        let first = self.time.partition_point(|t| *t <= low).saturating_sub(3);
        let last = (self.time.partition_point(|t| *t < high) + 2).min(end.checked_sub(1)?);
        let mut weights = vec![0.0; last + 1 - first];
        self.integrate(time, first, &mut weights, |offset, _| {
            self.filter.weight(offset)
        });
        let total: f64 = weights.iter().sum();
        for weight in &mut weights {
            *weight /= total;
        }
        (total > 0.0).then_some((first, weights, total))
    }

    /// Derivatives of [`Self::weights`] with respect to `time`.
    fn weight_slopes(&self, time: f64, first: usize, weights: &[f64], total: f64) -> Vec<f64> {
        let half = self.half_width;
        let mut slopes = vec![0.0; weights.len()];
        self.integrate(time, first, &mut slopes, |_, within| {
            -self.filter.slope(within) / half
        });
        // What enters the window on one side and leaves it on the other.
        let cells = self.cells(first, first + weights.len() - 1);
        for (edge, sign) in [(time + half, 1.0), (time - half, -1.0)] {
            let height = SIMPSON * sign * self.filter.weight((edge - time) / half);
            if let Some(cell) = cells.iter().find(|c| c.low <= edge && edge <= c.high) {
                let along = self.along(cell, edge);
                slopes[cell.a - first] += height * (1.0 - along);
                slopes[cell.b - first] += height * along;
            }
        }
        let change: f64 = slopes.iter().sum::<f64>() / total;
        let both = slopes.iter().zip(weights);
        both.map(|(slope, weight)| slope / total - weight * change)
            .collect()
    }

    /// Adds to the place of each instant [`SIMPSON`] times the integral of its share of the power times a kernel, over
    /// the window. The kernel gets the distance from `time` in half widths, and one within the same half of the window.
    fn integrate(
        &self,
        time: f64,
        first: usize,
        into: &mut [f64],
        kernel: impl Fn(f64, f64) -> f64,
    ) {
        let half = self.half_width;
        let (low, high) = (time - half, time + half);
        for cell in self.cells(first, first + into.len() - 1) {
            let (a, b) = (cell.low.max(low), cell.high.min(high));
            let middle = time.clamp(a.min(b), b);
            for (from, to) in [(a, middle), (middle, b)] {
                if to <= from {
                    continue;
                }
                let centre = 0.5 * (from + to);
                let within = (centre - time) / half;
                for (t, share) in [(from, 1.0), (centre, 4.0), (to, 1.0)] {
                    let weight = kernel((t - time) / half, within) * share * (to - from);
                    let along = self.along(&cell, t);
                    into[cell.a - first] += weight * (1.0 - along);
                    into[cell.b - first] += weight * along;
                }
            }
        }
    }

    /// How far a time is along the line of a cell.
    fn along(&self, cell: &Cell, time: f64) -> f64 {
        let (a, b) = (self.time[cell.a], self.time[cell.b]);
        if cell.a == cell.b {
            0.0
        } else {
            (time - a) / (b - a)
        }
    }

    /// Whether the voltage jumps between an output instant and the next.
    fn jumps_between(&self, left: usize) -> bool {
        self.jump_between(left).is_some()
    }

    fn jump_between(&self, left: usize) -> Option<f64> {
        let (from, to) = (self.time[left], self.time[left + 1]);
        let mut jumps = self.jumps.iter().copied();
        jumps.find(|p| *p + self.blurred > from && *p - self.blurred < to)
    }

    /// The cells between instants `first` and `last`; at a jump the lines of both sides are
    /// extended to it.
    fn cells(&self, first: usize, last: usize) -> Vec<Cell> {
        let blurred = self.blurred;
        let mut cells = Vec::with_capacity(last - first + 4);
        let mut j = first;
        while j < last {
            let jump = self.jump_between(j);
            let Some(jump) = jump else {
                cells.push(Cell {
                    low: self.time[j],
                    high: self.time[j + 1],
                    a: j,
                    b: j + 1,
                });
                j += 1;
                continue;
            };
            let left = if self.time[j] > jump - blurred {
                j.saturating_sub(1).max(first)
            } else {
                j
            };
            let right = (j + 1..=last)
                .find(|&i| self.time[i] >= jump + blurred)
                .unwrap_or(last);
            cells.retain(|cell: &Cell| cell.high <= self.time[left] + 1e-12);
            cells.push(Cell {
                low: self.time[left],
                high: jump,
                a: left.saturating_sub(1).max(first),
                b: left,
            });
            cells.push(Cell {
                low: jump,
                high: self.time[right],
                a: right,
                b: (right + 1).min(last),
            });
            j = right;
        }
        cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) const SAMPLES: usize = 21;
    pub(super) const PER: usize = 32;

    /// A dip of complex voltage that begins at `jump` samples, with dense intervals around it.
    pub(super) fn dip(jump: f64) -> TerminalInput {
        let u: Vec<Complex<f64>> = (0..=(SAMPLES - 1) * PER)
            .map(|i| {
                let late = (i as f64 / PER as f64 - jump) * PER as f64 + 0.5;
                let after = Complex::from_polar(0.6, -0.1);
                (after - 1.0) * late.clamp(0.0, 1.0) + 1.0
            })
            .collect();
        TerminalInput {
            real: u.iter().map(|u| u.re).collect(),
            imaginary: u.iter().map(|u| u.im).collect(),
            points_per_sample: PER,
            sample_interval_s: 1.0 / 60.0,
            jumps: vec![false; SAMPLES - 1],
            dense: (0..SAMPLES - 1).map(|k| (6..15).contains(&k)).collect(),
            synchronous_speed_rad_s: 377.0,
        }
    }

    fn chain(input: &TerminalInput, jump: f64) -> MeasurementChain {
        let filtered: Vec<bool> = (0..SAMPLES).map(|k| (8..=12).contains(&k)).collect();
        MeasurementChain::new(&ChainParts {
            input,
            filter: PhasorFilter::PClass,
            half_width: 1.0,
            jumps: &[jump],
            filtered: &filtered,
            frequency_deviation: &[0.0; SAMPLES],
        })
    }

    #[test]
    fn constant_power_behind_a_triangle_agrees_with_the_integral() {
        for jump in [10.0, 10.013, 10.3, 10.5, 10.99] {
            let input = dip(jump);
            let chain = chain(&input, jump);
            let load = Complex::new(1.0, 0.3);
            let count = input.output_count();
            let seen = chain.measured(&vec![load.re; count], &vec![load.im; count]);
            let after = Complex::from_polar(0.6, -0.1);
            for (k, seen) in seen.iter().enumerate() {
                // Share of the triangle's area after the jump.
                let x = (k as f64 - jump).clamp(-1.0, 1.0);
                let share = if x < 0.0 {
                    0.5 * (1.0 + x) * (1.0 + x)
                } else {
                    1.0 - 0.5 * (1.0 - x) * (1.0 - x)
                };
                let voltage = after * share + (1.0 - share);
                let current = (load / after).conj() * share + load.conj() * (1.0 - share);
                let power = voltage * current.conj();
                let error = (power - Complex::new(seen[0], seen[1])).norm();
                assert!(error < 1e-9, "jump at {jump}, sample {k}: {error:e}");
            }
        }
    }

    #[test]
    fn static_responses_are_what_the_chain_makes_of_static_load() {
        let input = dip(10.3);
        let chain = chain(&input, 10.3);
        let square: Vec<f64> = chain.output_voltage().iter().map(|v| v * v - 1.0).collect();
        let none = vec![0.0; square.len()];
        let seen = chain.measured(&square, &none);
        let crossed = chain.measured(&none, &square);
        for (k, response) in chain.static_responses().iter().enumerate() {
            assert!((response.square[0] - seen[k][0]).abs() < 1e-12);
            assert!((response.square[1] - seen[k][1]).abs() < 1e-12);
            assert!((crossed[k][0] + response.square[1]).abs() < 1e-12);
            assert!((crossed[k][1] - response.square[0]).abs() < 1e-12);
        }
    }

    #[test]
    fn derivatives_pass_like_values() {
        use crate::numerics::Dual;
        let input = dip(10.3);
        let chain = chain(&input, 10.3);
        let p: Vec<Dual<1>> = (0..input.output_count())
            .map(|i| Dual::variable(0.1 * i as f64, 0))
            .collect();
        let values: Vec<f64> = p.iter().map(|p| p.value).collect();
        let ones = vec![1.0; p.len()];
        let none = vec![0.0; p.len()];
        let dual = chain.measured(&p, &vec![Dual::constant(0.0); p.len()]);
        let (plain, slope) = (chain.measured(&values, &none), chain.measured(&ones, &none));
        for k in 0..SAMPLES {
            assert_eq!(dual[k][0].value.to_bits(), plain[k][0].to_bits());
            assert!((dual[k][1].derivatives[0] - slope[k][1]).abs() < 1e-12);
        }
    }
}
