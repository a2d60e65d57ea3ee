//! The terminal voltage behind its measurement: smooth between jumps, seen through the phasor
//! filter, with noise.
//!
//! Unknown are the values `l = ln|V| + j angle` at the sample instants, for every piece between two
//! jumps its own, a little beyond them. Between nodes l is cubic. They minimise
//!
//! ```text
//! sum_k |m_k - (F exp l)_k|^2 / |m_k sigma|^2 + sum_k |third difference of l|^2 / tau_k^2        (1)
//! ```
//!
//! with m the measured phasors, sigma their relative noise, F the filter near jumps and 1 elsewhere
//! (a filter and a load that both respond linearly commute), and tau the size of third differences
//! to be expected: `kappa h^3` from the motion of the grid, and more after a jump while fluxes
//! settle. This is a smoothing spline whose stiffness varies. A missing sample has no term.

use nalgebra::Complex;

use super::super::phasor_filter::PhasorFilter;
use crate::numerics::banded::BandedSolution;

mod terms;

use terms::{Term, Terms};

pub(super) type Log = Complex<f64>;

/// A jump of the phasor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Jump {
    /// The step between samples `anchor` and `anchor + 1` is its steepest.
    pub(super) anchor: usize,
    /// Instant, in samples, less than two from the anchor.
    pub(super) position: f64,
    /// From before what spreads it to after, in l.
    pub(super) change: Log,
}

impl Jump {
    /// Size in l.
    pub(super) fn size(&self) -> f64 {
        self.change.norm()
    }
}

/// Nodes kept before and after the anchor on the far side of a jump, so that its instant may move.
const BEYOND_BEFORE: usize = 2;
const BEYOND_AFTER: usize = 3;
/// Gauss-Newton rounds of (1); the second already corrects by less than the noise.
const ROUNDS: usize = 3;
/// Time after a jump during which the filter is taken into account beyond its own width, seconds.
const SETTLING_S: f64 = 0.035;
/// A relay that a jump of the voltage makes operate does so within this time; what it switches is a jump of the load behind the
/// same filter.
const SWITCHED_WITHIN_S: f64 = 0.2;
/// What follows a jump, relative to it: fluxes that settle, within 20 ms ...
const FAST: (f64, f64) = (0.2, 0.02);
/// ... and rotors that swing at 30 rad/s, within 0.1 s. Sizes of ordinary motors, chosen generously: they
/// only limit smoothing.
const SWING: (f64, f64, f64) = (0.1, 30.0, 0.1);
/// Stiffest smoothing: third differences of this share of the noise. Bounds the condition of (1).
const STIFFEST: f64 = 1e-4;

/// What is known of the voltage before (1) is solved.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Measured {
    /// ln|V| + j angle of each sample.
    pub(super) log: Vec<Log>,
    /// Samples without a term.
    pub(super) bad: Vec<bool>,
    /// Relative noise of a part of V.
    pub(super) noise: f64,
    /// Seconds between samples.
    pub(super) interval_s: f64,
    /// Third derivative to be expected at each sample, 1/s^3.
    pub(super) stiffness: Vec<f64>,
    /// For each step between samples, the size of a motion that is no jump but steeper than
    /// the rest; 0 for ordinary steps.
    pub(super) steep: Vec<f64>,
    /// Half width of the filter over one sample interval.
    pub(super) half_width: f64,
    /// Its shape.
    pub(super) filter: PhasorFilter,
    /// Instants of jumps are sought once and roughly: which window they show is asked, not when they were.
    pub(super) rough: bool,
}

/// A piece between two jumps: nodes at samples `first`, `first + 1`, ...
#[derive(Clone, Debug, PartialEq)]
struct Piece {
    first: usize,
    /// Index of its first node among all nodes.
    offset: usize,
    nodes: usize,
}

/// The voltage of a run of samples.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Voltage {
    from: usize,
    to: usize,
    jumps: Vec<Jump>,
    pieces: Vec<Piece>,
    nodes: Vec<Log>,
    /// Twice the negative logarithm of the marginal likelihood, up to a constant.
    pub(super) evidence: f64,
    /// (1) at the solution.
    pub(super) objective: f64,
    /// Variance of either part of each node; empty until asked for.
    variance: Vec<f64>,
}

impl Measured {
    /// Samples within reach of a jump: the filter matters to them.
    pub(super) fn in_reach(&self, jumps: &[Jump], sample: usize) -> bool {
        if self.filter == PhasorFilter::None {
            return false;
        }
        let settling = (SETTLING_S / self.interval_s).max(1.0);
        jumps.iter().any(|jump| {
            let after = sample as f64 - jump.position;
            (-(self.half_width + 1.0)..=self.half_width + settling).contains(&after)
        })
    }

    /// Samples that the filter changes: those in reach of a jump, and those over which it may spread what a jump has
    /// switched.
    pub(super) fn changes(&self, jumps: &[Jump], sample: usize) -> bool {
        let switched = |jump: &Jump| {
            let after_s = (sample as f64 - jump.position) * self.interval_s;
            (0.0..=SWITCHED_WITHIN_S).contains(&after_s)
        };
        self.in_reach(jumps, sample)
            || self.filter != PhasorFilter::None && jumps.iter().any(switched)
    }

    /// Samples whose filter window holds a jump.
    pub(super) fn spread(&self, jump: &Jump, sample: usize) -> bool {
        (sample as f64 - jump.position).abs() < self.half_width
    }

    fn third_difference(&self, after: Option<&Jump>, sample: usize) -> f64 {
        let h = self.interval_s;
        let mut square = (self.stiffness[sample] * h.powi(3)).powi(2);
        if let Some(jump) = after {
            let since_s = ((sample as f64 + 1.5 - jump.position) * h).max(0.0);
            let fast = FAST.0 * (1.0 - (-h / FAST.1).exp()).powi(3) * (-since_s / FAST.1).exp();
            let swing = SWING.0 * (SWING.1 * h).min(1.0).powi(3) * (-since_s / SWING.2).exp();
            square += (jump.size() * (fast + swing)).powi(2);
        }
        let last = (sample + 3).min(self.steep.len());
        let steep = self.steep[sample.min(last)..last]
            .iter()
            .fold(0.0_f64, |m, s| m.max(*s));
        square += 4.0 * steep * steep;
        square.sqrt().max(STIFFEST * self.noise)
    }
}

impl Voltage {
    /// Minimises (1) over samples `from..=to` with these jumps, in order; `start` may hold a
    /// neighbouring solution with the same anchors. `None` where the samples do not determine it.
    pub(super) fn fit(
        measured: &Measured,
        (from, to): (usize, usize),
        jumps: &[Jump],
        start: Option<&Self>,
    ) -> Option<Self> {
        let mut voltage = Self::initial(measured, (from, to), jumps, start);
        let curved = (from..=to).any(|k| measured.in_reach(jumps, k));
        let terms = Terms::new(&voltage, measured);
        let mut last = None;
        for _ in 0..if curved { ROUNDS } else { 1 } {
            let solution = terms.normal_equations(&voltage, measured).solve()?;
            voltage.nodes.clone_from(&solution.x);
            last = Some(solution);
        }
        voltage.finish(measured, &terms, &last?);
        Some(voltage)
    }

    fn initial(
        measured: &Measured,
        (from, to): (usize, usize),
        jumps: &[Jump],
        start: Option<&Self>,
    ) -> Self {
        let mut pieces: Vec<Piece> = Vec::with_capacity(jumps.len() + 1);
        let mut offset = 0;
        for index in 0..=jumps.len() {
            let first = index.checked_sub(1).map_or(from, |i| {
                jumps[i].anchor.saturating_sub(BEYOND_BEFORE).max(from)
            });
            let last = jumps
                .get(index)
                .map_or(to, |jump| (jump.anchor + BEYOND_AFTER).min(to));
            let nodes = last.saturating_sub(first) + 1;
            pieces.push(Piece {
                first,
                offset,
                nodes,
            });
            offset += nodes;
        }
        let nodes = match start {
            Some(start) if start.nodes.len() == offset => start.nodes.clone(),
            _ => raw_nodes(measured, jumps, &pieces),
        };
        Self {
            from,
            to,
            jumps: jumps.to_vec(),
            pieces,
            nodes,
            evidence: f64::INFINITY,
            objective: f64::INFINITY,
            variance: Vec::new(),
        }
    }

    /// First node and expected size of every third difference.
    fn third_differences(&self, measured: &Measured) -> Vec<(usize, f64)> {
        let mut list = Vec::with_capacity(self.nodes.len());
        for (index, piece) in self.pieces.iter().enumerate() {
            let after = index.checked_sub(1).map(|i| &self.jumps[i]);
            for i in 0..piece.nodes.saturating_sub(3) {
                let size = measured.third_difference(after, piece.first + i);
                list.push((piece.offset + i, size));
            }
        }
        list
    }

    fn finish(&mut self, measured: &Measured, terms: &Terms, solution: &BandedSolution) {
        let mut sum = 0.0;
        for residual in terms.residuals(self, measured) {
            sum += (residual / measured.noise).norm_sqr();
        }
        let mut ln_prior = 0.0;
        for &(node, size) in &terms.third_differences {
            let x = &self.nodes[node..node + 4];
            let third = x[3] - x[0] + (x[1] - x[2]) * 3.0;
            sum += third.norm_sqr() / (size * size);
            ln_prior += size.ln();
        }
        self.objective = sum;
        // Two real unknowns per complex one.
        self.evidence = sum + 2.0 * solution.ln_determinant + 4.0 * ln_prior;
    }

    /// Fills in the variances of the nodes. A smoothed sample is never less certain than the sample
    /// by itself, whatever the recurrence for the inverse's diagonal loses to rounding where the
    /// stiffness ranges over many decades.
    pub(super) fn with_variances(mut self, measured: &Measured) -> Option<Self> {
        let terms = Terms::new(&self, measured);
        let equations = terms.normal_equations(&self, measured);
        self.variance = equations.solve()?.variances();
        let alone = measured.noise * measured.noise;
        for sample in (self.from..=self.to).filter(|&k| !measured.bad[k]) {
            let node = self.node_of(sample);
            let known = self.variance[node];
            if !(0.0..=alone).contains(&known) {
                self.variance[node] = alone;
            }
        }
        Some(self)
    }

    /// Measured over modelled phasor minus one, to first order.
    pub(super) fn residual(&self, measured: &Measured, sample: usize) -> Complex<f64> {
        let mut points = Vec::new();
        let term = Term::new(self, measured, sample, &mut points);
        term.residual(self, measured, &points)
    }

    /// The jumps.
    pub(super) fn jumps(&self) -> &[Jump] {
        &self.jumps
    }

    /// How far l jumps at jump number `index`.
    pub(super) fn height(&self, index: usize) -> Log {
        let time = self.jumps[index].position;
        let side = |piece: &Piece| self.at_nodes(piece.interpolation(time));
        side(&self.pieces[index + 1]) - side(&self.pieces[index])
    }

    /// The same along the whole change around it and as a share of that.
    pub(super) fn share_of_change(&self, index: usize) -> f64 {
        let change = self.jumps[index].change;
        (self.height(index) * change.conj()).re / change.norm_sqr()
    }

    fn piece_at(&self, time: f64) -> usize {
        self.jumps.iter().filter(|j| j.position <= time).count()
    }

    fn node_of(&self, sample: usize) -> usize {
        let piece = &self.pieces[self.piece_at(sample as f64)];
        let inside = sample.clamp(piece.first, piece.first + piece.nodes - 1);
        piece.offset + inside - piece.first
    }

    /// l at a sample, on the side of the jump where its time stamp lies.
    pub(super) fn at_sample(&self, sample: usize) -> Log {
        self.nodes[self.node_of(sample)]
    }

    /// Standard deviation of either part of l at a sample.
    pub(super) fn deviation_at_sample(&self, sample: usize) -> f64 {
        self.variance[self.node_of(sample)].max(0.0).sqrt()
    }

    fn at_nodes(&self, (first, shares): (usize, [f64; 4])) -> Log {
        // A short piece has fewer nodes than shares; the missing ones are zero.
        self.nodes[first..]
            .iter()
            .zip(shares)
            .map(|(node, share)| node * share)
            .sum()
    }

    /// l at any time, samples.
    pub(super) fn at(&self, time: f64) -> Log {
        self.at_nodes(self.pieces[self.piece_at(time)].interpolation(time))
    }

    /// l at any time, with jumps spread linearly over one part in `points` of a sample interval,
    /// which keeps their time integral wherever they lie on a grid that fine.
    pub(super) fn on_grid(&self, time: f64, points: usize) -> Log {
        let near = self
            .jumps
            .iter()
            .position(|j| ((time - j.position) * points as f64).abs() < 0.5);
        let Some(index) = near else {
            return self.at(time);
        };
        let share = (time - self.jumps[index].position) * points as f64 + 0.5;
        let side = |piece: &Piece| self.at_nodes(piece.interpolation(time));
        let (low, high) = (side(&self.pieces[index]), side(&self.pieces[index + 1]));
        low + (high - low) * share
    }
}

impl Piece {
    /// First node and the shares of four nodes in l at `time`: cubic with the slopes of
    /// parabolas through three nodes, parabolic in the outer intervals.
    fn interpolation(&self, time: f64) -> (usize, [f64; 4]) {
        let last = self.nodes - 1;
        if last == 0 {
            return (self.offset, [1.0, 0.0, 0.0, 0.0]);
        }
        let x = time - self.first as f64;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the nodes of the piece"
        )]
        let left = x.floor().clamp(0.0, (last - 1) as f64) as usize;
        let x = x - left as f64;
        if last == 1 {
            return (self.offset, [1.0 - x, x, 0.0, 0.0]);
        }
        let (x2, x3) = (x * x, x * x * x);
        // Shares of the nodes left - 1, left, left + 1, left + 2.
        let inner = [
            0.5 * (-x3 + 2.0 * x2 - x),
            0.5 * (3.0 * x3 - 5.0 * x2 + 2.0),
            0.5 * (-3.0 * x3 + 4.0 * x2 + x),
            0.5 * (x3 - x2),
        ];
        let parabola = |x: f64| {
            [
                0.5 * (x - 1.0) * (x - 2.0),
                x * (2.0 - x),
                0.5 * x * (x - 1.0),
            ]
        };
        if left == 0 {
            let [a, b, c] = parabola(x);
            (self.offset, [a, b, c, 0.0])
        } else if left + 1 == last {
            let [a, b, c] = parabola(x + 1.0);
            (self.offset + left - 1, [a, b, c, 0.0])
        } else {
            (self.offset + left - 1, inner)
        }
    }
}

/// Nodes at measured values where no jump is within the filter, else at the nearest such value.
fn raw_nodes(measured: &Measured, jumps: &[Jump], pieces: &[Piece]) -> Vec<Log> {
    let mut nodes = Vec::new();
    for (index, piece) in pieces.iter().enumerate() {
        let opened = index.checked_sub(1).map(|i| &jumps[i]);
        let closed = jumps.get(index);
        let clean: Vec<usize> = (piece.first..piece.first + piece.nodes)
            .filter(|&k| {
                let t = k as f64;
                opened.is_none_or(|j| t >= j.position + measured.half_width)
                    && closed.is_none_or(|j| t <= j.position - measured.half_width)
            })
            .collect();
        let middle = piece.first + piece.nodes / 2;
        for k in piece.first..piece.first + piece.nodes {
            let nearest = clean.iter().min_by_key(|&&c| c.abs_diff(k));
            nodes.push(measured.log[nearest.copied().unwrap_or(middle)]);
        }
    }
    nodes
}
