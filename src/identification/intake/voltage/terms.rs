//! The terms of (1): all of them but the values at the nodes is the same in every round, and is found once.

use std::ops::Range;

use nalgebra::Complex;

use super::{Log, Measured, Voltage};
use crate::numerics::banded::BandedNormalEquations;

/// What the terms are made of, whatever the values at the nodes.
pub(super) struct Terms {
    /// Of the samples that have one.
    of_samples: Vec<Term>,
    points: Vec<Point>,
    /// First node and expected size of every third difference.
    pub(super) third_differences: Vec<(usize, f64)>,
}

/// The term of a sample.
pub(super) struct Term {
    sample: usize,
    /// The nodes it depends on: one where the filter does not matter.
    nodes: Range<usize>,
    /// The points of the filter around it; none where it does not matter.
    points: Range<usize>,
}

/// A point of a quadrature: its weight and the nodes that make l there.
pub(super) struct Point {
    weight: f64,
    nodes: (usize, [f64; 4]),
    /// Whether it is the one before, with another weight: where one panel ends and the next begins.
    is_again: bool,
}

impl Terms {
    pub(super) fn new(voltage: &Voltage, measured: &Measured) -> Self {
        let mut points = Vec::new();
        let of_samples = (voltage.from..=voltage.to)
            .filter(|&k| !measured.bad[k])
            .map(|k| Term::new(voltage, measured, k, &mut points))
            .collect();
        Self {
            of_samples,
            points,
            third_differences: voltage.third_differences(measured),
        }
    }

    /// Linearised rows of (1) at the present nodes.
    pub(super) fn normal_equations(
        &self,
        voltage: &Voltage,
        measured: &Measured,
    ) -> BandedNormalEquations {
        let precision = measured.noise.powi(-2);
        let widest = self.of_samples.iter().map(|term| term.nodes.len()).max();
        let band = (widest.unwrap_or(1) - 1).max(3);
        let mut equations = BandedNormalEquations::new(voltage.nodes.len(), band);
        let mut coefficients: Vec<Log> = Vec::with_capacity(band + 1);
        for term in &self.of_samples {
            let first = term.nodes.start;
            if term.points.is_empty() {
                let target = measured.log[term.sample];
                equations.add_real(first, &[1.0], target, precision);
            } else {
                let points = &self.points[term.points.clone()];
                let target = term.linearised(voltage, measured, points, &mut coefficients);
                equations.add(first, &coefficients, target, precision);
            }
        }
        let third = [-1.0, 3.0, -3.0, 1.0];
        let zero = Complex::new(0.0, 0.0);
        for (node, size) in &self.third_differences {
            equations.add_real(*node, &third, zero, size.powi(-2));
        }
        equations
    }

    /// [`Voltage::residual`] of every sample with a term.
    pub(super) fn residuals<'a>(
        &'a self,
        voltage: &'a Voltage,
        measured: &'a Measured,
    ) -> impl Iterator<Item = Complex<f64>> + 'a {
        let of = |term: &'a Term| term.residual(voltage, measured, &self.points);
        self.of_samples.iter().map(of)
    }
}

impl Term {
    /// Of a sample; the points of its filter are added to `points`.
    pub(super) fn new(
        voltage: &Voltage,
        measured: &Measured,
        sample: usize,
        points: &mut Vec<Point>,
    ) -> Self {
        let begun = points.len();
        if measured.in_reach(&voltage.jumps, sample) {
            add_quadrature(voltage, measured, sample as f64, points);
        }
        let first = points[begun..].iter().map(|q| q.nodes.0).min();
        let end = points[begun..].iter().map(|q| q.nodes.0 + 4).max();
        let nodes = if let Some((first, end)) = first.zip(end) {
            first..end.min(voltage.nodes.len())
        } else {
            let node = voltage.node_of(sample);
            node..node + 1
        };
        Self {
            sample,
            nodes,
            points: begun..points.len(),
        }
    }

    /// Measured over modelled phasor minus one, to first order.
    pub(super) fn residual(
        &self,
        voltage: &Voltage,
        measured: &Measured,
        points: &[Point],
    ) -> Complex<f64> {
        let log = measured.log[self.sample];
        if self.points.is_empty() {
            return log - voltage.nodes[self.nodes.start];
        }
        let own = &points[self.points.clone()];
        let seen: Complex<f64> = parts(voltage, log, own).map(|(_, part)| part).sum();
        Complex::new(1.0, 0.0) - seen
    }

    /// A row of (1) for a filtered sample: coefficients of its nodes, and what they should sum to.
    fn linearised(
        &self,
        voltage: &Voltage,
        measured: &Measured,
        points: &[Point],
        coefficients: &mut Vec<Log>,
    ) -> Log {
        let zero = Complex::new(0.0, 0.0);
        coefficients.clear();
        coefficients.resize(self.nodes.len(), zero);
        let (mut modelled, mut linear) = (zero, zero);
        // Relative to the measured phasor, so that the noise is the same everywhere.
        for (q, part) in parts(voltage, measured.log[self.sample], points) {
            modelled += part;
            for (node, share) in (q.nodes.0..self.nodes.end).zip(q.nodes.1) {
                let shared = part * share;
                coefficients[node - self.nodes.start] += shared;
                linear += shared * voltage.nodes[node];
            }
        }
        linear + 1.0 - modelled
    }
}

/// Each point with its part of the filtered phasor over the measured one, of which `log` is the logarithm.
fn parts<'a>(
    voltage: &'a Voltage,
    log: Log,
    points: &'a [Point],
) -> impl Iterator<Item = (&'a Point, Complex<f64>)> {
    let mut there = Complex::new(0.0, 0.0);
    points.iter().map(move |q| {
        if !q.is_again {
            there = (voltage.at_nodes(q.nodes) - log).exp();
        }
        (q, there * q.weight)
    })
}

/// Adds points and weights of the filter around `time`, split at jumps; the weights sum to 1.
fn add_quadrature(voltage: &Voltage, measured: &Measured, time: f64, points: &mut Vec<Point>) {
    /// Longest panel of Simpson's rule, samples.
    const PANEL: f64 = 0.5;
    let begun = points.len();
    let half = measured.half_width;
    let (low, high) = (
        (time - half).max(voltage.from as f64),
        (time + half).min(voltage.to as f64),
    );
    let mut ends = vec![low, time.clamp(low, high), high];
    ends.extend(
        voltage
            .jumps
            .iter()
            .map(|j| j.position)
            .filter(|p| *p > low && *p < high),
    );
    ends.sort_by(f64::total_cmp);
    let mut total = 0.0;
    for pair in ends.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let length = b - a;
        if length <= 0.0 {
            continue;
        }
        let piece = &voltage.pieces[voltage.piece_at(0.5 * (a + b))];
        let panels = (length / PANEL).ceil().max(1.0);
        let mut left = a;
        while left < b - 1e-9 {
            let right = (left + length / panels).min(b);
            for (t, share) in [(left, 1.0), (0.5 * (left + right), 4.0), (right, 1.0)] {
                let weight =
                    measured.filter.weight((t - time) / half) * share * (right - left) / 6.0;
                total += weight;
                let is_again = t <= left && left > a;
                let nodes = match points.last() {
                    Some(last) if is_again => last.nodes,
                    _ => piece.interpolation(t),
                };
                points.push(Point {
                    weight,
                    nodes,
                    is_again,
                });
            }
            left = right;
        }
    }
    for point in &mut points[begun..] {
        point.weight /= total;
    }
}
