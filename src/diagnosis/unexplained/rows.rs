//! The least squares problem: residual, free columns and terms of every event, each row divided by
//! its noise, slow parts averaged, and what varies from event to event taken out.
//!
//! ```text
//! r = sum_j c_j f_j + N b + U_e g_e + noise,   g_e ~ N(0, S^2)
//! Sigma_e = I + U_e S^2 U_e' = I + Q diag(s^2) Q',   Sigma_e^(-1/2) = I - Q diag(1 - 1/sqrt(1 + s^2)) Q'   (1)
//! ```

use nalgebra::DMatrix;

use super::{response::Driven, term::Term};
use crate::identification::{
    evaluate::Curves, intake::PreparedEvent, joint_problem::ProblemOptions,
};

/// Around edges, and this long after them, every sample is a row of its own, s.
const QUICK_AFTER_EDGE_S: f64 = 0.8;
/// Elsewhere as many samples as fit into this time are averaged, s.
const AVERAGED_S: f64 = 0.1;
/// Spread from event to event of the motor's part, of the model's own response.
const RESPONSE_SPREAD: f64 = 0.05;

/// Columns of P and of Q.
pub(super) type Channels = [Vec<f64>; 2];

/// The rows of all events, one event after the other.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    /// Where each event begins, and the end.
    pub(super) begins: Vec<usize>,
    /// The whitened residual.
    pub(super) residual: Channels,
    /// What the model could take up by itself.
    pub(super) free: [Vec<Vec<f64>>; 2],
    /// One column of each channel for each term.
    pub(super) terms: Vec<Channels>,
    /// Largest absolute value of each term in each event, pu of P0 per unit of its coefficient.
    pub(super) largest: Vec<Vec<f64>>,
}

impl Rows {
    pub(super) fn new(events: &[(&PreparedEvent, &Curves)], terms: &[Term]) -> Self {
        let mut rows = Self {
            begins: vec![0],
            residual: Default::default(),
            free: [vec![Vec::new(); FREE], vec![Vec::new(); FREE]],
            terms: vec![Channels::default(); terms.len()],
            largest: vec![Vec::new(); terms.len()],
        };
        for (event, curves) in events {
            rows.add(event, curves, terms);
        }
        rows
    }

    /// Number of events.
    pub(super) fn events(&self) -> usize {
        self.begins.len() - 1
    }

    /// Rows of one channel.
    pub(super) fn count(&self) -> usize {
        self.residual[0].len()
    }

    /// The rows of some events only.
    pub(super) fn of_events(&self, keep: &dyn Fn(usize) -> bool) -> Self {
        let picked = |column: &Vec<f64>| -> Vec<f64> {
            let events = (0..self.events()).filter(|e| keep(*e));
            events
                .flat_map(|e| column[self.begins[e]..self.begins[e + 1]].iter().copied())
                .collect()
        };
        let mut begins = vec![0];
        for e in (0..self.events()).filter(|e| keep(*e)) {
            let last = begins[begins.len() - 1];
            begins.push(last + self.begins[e + 1] - self.begins[e]);
        }
        let both = |channels: &Channels| [picked(&channels[0]), picked(&channels[1])];
        Self {
            begins,
            residual: both(&self.residual),
            free: [0, 1].map(|c: usize| self.free[c].iter().map(picked).collect()),
            terms: self.terms.iter().map(both).collect(),
            largest: Vec::new(),
        }
    }

    /// The rows with some terms as free columns.
    pub(super) fn with_free(&self, terms: &[Term], is_free: &dyn Fn(&Term) -> bool) -> Self {
        let mut rows = self.clone();
        for (term, columns) in terms.iter().zip(&self.terms) {
            if is_free(term) {
                for (free, column) in rows.free.iter_mut().zip(columns) {
                    free.push(column.clone());
                }
            }
        }
        rows
    }

    fn add(&mut self, event: &PreparedEvent, curves: &Curves, terms: &[Term]) {
        let driven = Driven::new(event);
        let blocks = blocks(event);
        let functions: Vec<Vec<f64>> = terms.iter().map(|term| driven.measured(term)).collect();
        let static_responses = event.chain.static_responses();
        let rest = [1.0, event.q0_pu / event.p0_pu];
        let channels = [
            (&event.active, &curves.active, &event.active_deviation),
            (&event.reactive, &curves.reactive, &event.reactive_deviation),
        ];
        for (c, (measured, model, deviation)) in channels.into_iter().enumerate() {
            let averaging = Averaging::new(&blocks, deviation);
            let residual: Vec<f64> = measured.iter().zip(model).map(|(y, m)| y - m).collect();
            let square: Vec<f64> = static_responses.iter().map(|s| s.square[0]).collect();
            let line: Vec<f64> = static_responses.iter().map(|s| s.line[0]).collect();
            let response: Vec<f64> = model.iter().map(|m| m - rest[c]).collect();
            let free: [Vec<f64>; FREE] =
                [&square, &line, &response].map(|column| averaging.rows(column));
            let whitening = Whitening::new(event, c, &free, &averaging);
            self.residual[c].extend(whitening.applied(averaging.rows(&residual)));
            for (column, values) in self.free[c].iter_mut().zip(free) {
                column.extend(whitening.applied(values));
            }
            for (column, values) in self.terms.iter_mut().zip(&functions) {
                column[c].extend(whitening.applied(averaging.rows(values)));
            }
        }
        for (largest, values) in self.largest.iter_mut().zip(&functions) {
            largest.push(values.iter().fold(0.0, |m: f64, x| m.max(x.abs())));
        }
        self.begins.push(self.residual[0].len());
    }
}

/// Free columns of a channel: `v^2 - 1`, `v - 1`, and the model's own response.
const FREE: usize = 3;

/// Used samples that make one row each, in order.
fn blocks(event: &PreparedEvent) -> Vec<Vec<usize>> {
    let mut blocks: Vec<Vec<usize>> = Vec::new();
    let mut since_edge_s = f64::INFINITY;
    let mut open = false;
    for k in 0..event.len() {
        since_edge_s = if event.near_edge[k] {
            0.0
        } else {
            since_edge_s + 1.0 / event.rate_fps
        };
        if !event.used[k] {
            continue;
        }
        let quick = since_edge_s < QUICK_AFTER_EDGE_S;
        match blocks.last_mut() {
            Some(block)
                if open && !quick && (block.len() + 1) as f64 <= AVERAGED_S * event.rate_fps =>
            {
                block.push(k);
            }
            _ => blocks.push(vec![k]),
        }
        open = !quick;
    }
    blocks
}

/// Weighted means over blocks of samples, divided by their deviation.
struct Averaging<'a> {
    blocks: &'a [Vec<usize>],
    deviation: &'a [f64],
}

impl<'a> Averaging<'a> {
    fn new(blocks: &'a [Vec<usize>], deviation: &'a [f64]) -> Self {
        Self { blocks, deviation }
    }

    fn rows(&self, values: &[f64]) -> Vec<f64> {
        let row = |block: &Vec<usize>| {
            let weight = |k: usize| self.deviation[k].powi(-2);
            let total: f64 = block.iter().map(|&k| weight(k)).sum();
            let sum: f64 = block.iter().map(|&k| weight(k) * values[k]).sum();
            sum / total.sqrt()
        };
        self.blocks.iter().map(row).collect()
    }
}

/// Takes out what varies from event to event: equation (1).
struct Whitening {
    /// Orthonormal columns.
    basis: Vec<Vec<f64>>,
    /// `1 - 1/sqrt(1 + s^2)` of each.
    taken: Vec<f64>,
}

impl Whitening {
    fn new(
        event: &PreparedEvent,
        channel: usize,
        free: &[Vec<f64>; FREE],
        averaging: &Averaging<'_>,
    ) -> Self {
        // Motor share, c_z, c_i of P, c_z, c_i of Q.
        let spread = ProblemOptions::default().composition_spread;
        let spreads = [
            spread[1 + 2 * channel],
            spread[2 + 2 * channel],
            RESPONSE_SPREAD,
            event.operating_point_deviation,
        ];
        let ones = averaging.rows(&vec![1.0; event.len()]);
        let columns = free.iter().chain(std::iter::once(&ones)).zip(spreads);
        let scaled: Vec<f64> = columns
            .flat_map(|(column, spread)| column.iter().map(move |x| x * spread))
            .collect();
        let svd = DMatrix::from_vec(ones.len(), FREE + 1, scaled).svd(true, false);
        let Some(u) = svd.u else {
            return Self {
                basis: Vec::new(),
                taken: Vec::new(),
            };
        };
        let taken = svd.singular_values.iter();
        Self {
            basis: u
                .column_iter()
                .map(|c| c.iter().copied().collect())
                .collect(),
            taken: taken.map(|s| 1.0 - 1.0 / (1.0 + s * s).sqrt()).collect(),
        }
    }

    fn applied(&self, mut rows: Vec<f64>) -> Vec<f64> {
        let along: Vec<f64> = self.basis.iter().map(|q| dot(q, &rows)).collect();
        for ((q, along), taken) in self.basis.iter().zip(along).zip(&self.taken) {
            for (row, q) in rows.iter_mut().zip(q) {
                *row -= q * along * taken;
            }
        }
        rows
    }
}

pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
