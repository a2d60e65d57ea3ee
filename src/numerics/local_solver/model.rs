//! The quadratic model of an objective around a point of a box.

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

use crate::numerics::{Bounds, objective::Expansion};

/// Smallest scale of a coordinate relative to the largest, both per width of the box. Keeps a
/// coordinate of which the objective does not depend from dividing by zero.
const SCALE_RELATIVE_MIN: f64 = 1e-12;
/// Ridge, relative to the scale, with which the undamped model is solved: far above rounding
/// (1e-16), far below any curvature that a difference of two doubles can show.
const RIDGE_RELATIVE: f64 = 1e-13;
/// Scaled eigenvalue below which the curvature is negative and not just rounding.
const NEGATIVE_CURVATURE: f64 = -1e-8;

/// The quadratic model of the objective around one iterate, and its box.
pub(super) struct Model<'a> {
    pub(super) at: &'a Expansion,
    pub(super) x: &'a DVector<f64>,
    pub(super) bounds: &'a Bounds,
    /// `D`: the curvature's diagonal, kept away from 0.
    pub(super) scale: DVector<f64>,
    /// Coordinates that are not held on a bound.
    pub(super) free: Vec<usize>,
}

impl Model<'_> {
    /// Decrease that the undamped model promises on the free coordinates, `g'inv(H)g / 2`; none
    /// when the curvature is not positive semidefinite.
    pub(super) fn promise(&self) -> Option<f64> {
        let gradient = select(&self.at.gradient, &self.free);
        let step = self.factor(&self.free, RIDGE_RELATIVE)?.solve(&gradient);
        Some(0.5 * gradient.dot(&step))
    }

    /// The same with the curvature's diagonal alone.
    pub(super) fn gradient_promise(&self) -> f64 {
        let gradient = &self.at.gradient;
        let terms = self
            .free
            .iter()
            .map(|&i| gradient[i].powi(2) / self.scale[i]);
        0.5 * terms.sum::<f64>()
    }

    /// Minimiser of the damped model over the box. Coordinates that would leave it are put on the
    /// bound, the one farthest out first, and the others solved again.
    pub(super) fn damped_step(&self, damping: f64) -> Option<DVector<f64>> {
        let Expansion {
            gradient,
            curvature,
            ..
        } = self.at;
        let mut step = DVector::zeros(gradient.len());
        let mut free = self.free.clone();
        while !free.is_empty() {
            let right = DVector::from_fn(free.len(), |row, _| {
                let i = free[row];
                -gradient[i] - self.pinned_pull(curvature, i, &free, &step)
            });
            let solved = self.factor(&free, damping)?.solve(&right);
            for (row, &i) in free.iter().enumerate() {
                step[i] = solved[row];
            }
            let Some(row) = self.farthest_out(&free, &step) else {
                break;
            };
            let i = free.remove(row);
            step[i] = self.bounds.clamp(i, self.x[i] + step[i]) - self.x[i];
        }
        Some(step)
    }

    /// `sum over j not free of H_ij s_j`.
    fn pinned_pull(&self, h: &DMatrix<f64>, i: usize, free: &[usize], step: &DVector<f64>) -> f64 {
        let pinned = self.free.iter().filter(|j| !free.contains(j));
        pinned.map(|&j| h[(i, j)] * step[j]).sum()
    }

    /// Position within `free` of the coordinate that the step carries farthest out of the box,
    /// measured in units of what it had left.
    fn farthest_out(&self, free: &[usize], step: &DVector<f64>) -> Option<usize> {
        let mut farthest = None;
        let mut shortest_fraction = 1.0;
        for (row, &i) in free.iter().enumerate() {
            let room = if step[i] > 0.0 {
                self.bounds.upper[i] - self.x[i]
            } else {
                self.bounds.lower[i] - self.x[i]
            };
            if step[i].abs() > room.abs() && room.abs() / step[i].abs() < shortest_fraction {
                shortest_fraction = room.abs() / step[i].abs();
                farthest = Some(row);
            }
        }
        farthest
    }

    /// `-(g's + s'Hs / 2)`.
    pub(super) fn decrease(&self, step: &DVector<f64>) -> f64 {
        let curved = &self.at.curvature * step;
        -(self.at.gradient.dot(step) + 0.5 * curved.dot(step))
    }

    /// Cholesky factor of `H + damping D` on the coordinates `free`.
    fn factor(&self, free: &[usize], damping: f64) -> Option<Cholesky<f64, nalgebra::Dyn>> {
        let h = &self.at.curvature;
        let damped = DMatrix::from_fn(free.len(), free.len(), |row, column| {
            let (i, j) = (free[row], free[column]);
            h[(i, j)] + if i == j { damping * self.scale[i] } else { 0.0 }
        });
        Cholesky::new(damped)
    }

    /// Direction of the most negative curvature on the free coordinates, if there is any.
    pub(super) fn most_negative_curvature(&self) -> Option<DVector<f64>> {
        let h = &self.at.curvature;
        let scaled = DMatrix::from_fn(self.free.len(), self.free.len(), |row, column| {
            let (i, j) = (self.free[row], self.free[column]);
            h[(i, j)] / (self.scale[i] * self.scale[j]).sqrt()
        });
        if scaled.is_empty() {
            return None;
        }
        let eigen = SymmetricEigen::new(scaled);
        let lowest = eigen.eigenvalues.imin();
        if eigen.eigenvalues[lowest] >= NEGATIVE_CURVATURE {
            return None;
        }
        let mut direction = DVector::zeros(h.nrows());
        for (row, &i) in self.free.iter().enumerate() {
            direction[i] = eigen.eigenvectors[(row, lowest)] / self.scale[i].sqrt();
        }
        Some(direction)
    }
}

/// Diagonal of the curvature, no smaller than a fraction of its largest entry per width of the box.
pub(super) fn scale(curvature: &DMatrix<f64>, spans: &DVector<f64>) -> DVector<f64> {
    let n = spans.len();
    let largest = (0..n)
        .map(|i| curvature[(i, i)].abs() * spans[i].powi(2))
        .fold(0.0, f64::max);
    let floor = if largest > 0.0 {
        SCALE_RELATIVE_MIN * largest
    } else {
        1.0
    };
    DVector::from_fn(n, |i, _| {
        curvature[(i, i)].abs().max(floor / spans[i].powi(2))
    })
}

/// Coordinates that a descent step may move: all but those on a bound with the way down outside.
pub(super) fn free_coordinates(
    x: &DVector<f64>,
    gradient: &DVector<f64>,
    bounds: &Bounds,
) -> Vec<usize> {
    (0..x.len())
        .filter(|&i| {
            let held_below = x[i] <= bounds.lower[i] && gradient[i] >= 0.0;
            let held_above = x[i] >= bounds.upper[i] && gradient[i] <= 0.0;
            !(held_below || held_above)
        })
        .collect()
}

fn select(vector: &DVector<f64>, indices: &[usize]) -> DVector<f64> {
    DVector::from_fn(indices.len(), |row, _| vector[indices[row]])
}
