//! A deterministic scan of a box: the objective at the centre of every cell of a regular grid.
//!
//! The other way to look for minima: no path, no neighbourhood, only resolution. It gives a global
//! search its starts and checks afterwards that the search missed nothing of the grid's size.

use nalgebra::DVector;
use rayon::prelude::*;

use super::{Bounds, Objective};

/// Points asked for together: a multiple of what an objective may evaluate side by side, and little
/// enough that a scan can be cancelled.
const BATCH: usize = 64;

/// Objective at the cells' centres.
#[derive(Clone, Debug, PartialEq)]
pub struct GridScan {
    bounds: Bounds,
    cells: Vec<usize>,
    /// Last coordinate fastest; infinite where the objective does not exist.
    values: Vec<f64>,
}

/// Evaluates `objective` at the centres of `cells[i]` equal cells along each coordinate `i` of the
/// finite box `bounds`, on the current rayon pool; the result does not depend on its threads. After
/// a cancellation the cells that were left out count as not existing.
pub fn scan(
    objective: &dyn Objective,
    bounds: &Bounds,
    cells: &[usize],
    cancel: &(dyn Fn() -> bool + Sync),
) -> GridScan {
    let mut grid = GridScan {
        bounds: bounds.clone(),
        cells: cells.to_vec(),
        values: Vec::new(),
    };
    let indices: Vec<usize> = (0..grid.len()).collect();
    let batches: Vec<Vec<f64>> = (indices.par_chunks(BATCH))
        .map(|some| {
            if cancel() {
                return vec![f64::INFINITY; some.len()];
            }
            let points: Vec<_> = some.iter().map(|&index| grid.point(index)).collect();
            let finite = |value: Option<f64>| value.filter(|v| v.is_finite());
            let values = objective.values(&points).into_iter();
            values
                .map(|value| finite(value).unwrap_or(f64::INFINITY))
                .collect()
        })
        .collect();
    grid.values = batches.concat();
    grid
}

impl GridScan {
    /// Number of cells.
    pub fn len(&self) -> usize {
        self.cells.iter().product()
    }

    /// Whether there is no cell.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Objective in a cell; infinite where it does not exist.
    pub fn value(&self, index: usize) -> f64 {
        self.values[index]
    }

    /// Centre of a cell.
    pub fn point(&self, index: usize) -> DVector<f64> {
        let place = self.place(index);
        DVector::from_fn(self.cells.len(), |i, _| {
            let share = (place[i] as f64 + 0.5) / self.cells[i] as f64;
            self.bounds.lower[i] + share * (self.bounds.upper[i] - self.bounds.lower[i])
        })
    }

    /// Cells that are not above any of their neighbours, diagonal ones included, lowest first; of
    /// equal neighbours the first.
    pub fn minima(&self) -> Vec<usize> {
        let mut minima: Vec<usize> = (0..self.len())
            .filter(|&index| self.values[index].is_finite() && self.is_minimum(index))
            .collect();
        minima.sort_by(|&a, &b| self.values[a].total_cmp(&self.values[b]).then(a.cmp(&b)));
        minima
    }

    fn is_minimum(&self, index: usize) -> bool {
        let place = self.place(index);
        let neighbours = 3_usize.pow(u32::try_from(place.len()).unwrap_or(u32::MAX));
        (0..neighbours).all(|number| {
            let Some(other) = self.neighbour(&place, number) else {
                return true;
            };
            let (here, there) = (self.values[index], self.values[other]);
            here < there || (here <= there && index <= other)
        })
    }

    /// Neighbour `number` of a cell: its digits to base 3 are the steps -1, 0, 1 along each
    /// coordinate. None outside the box.
    fn neighbour(&self, place: &[usize], mut number: usize) -> Option<usize> {
        let mut index = 0;
        for (&at, &cells) in place.iter().zip(&self.cells) {
            let moved = (at + number % 3).checked_sub(1).filter(|m| *m < cells)?;
            index = index * cells + moved;
            number /= 3;
        }
        Some(index)
    }

    fn place(&self, mut index: usize) -> Vec<usize> {
        let mut place = vec![0; self.cells.len()];
        for (at, cells) in place.iter_mut().zip(&self.cells).rev() {
            *at = index % cells;
            index /= cells;
        }
        place
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::test_functions::{HIMMELBLAU, HIMMELBLAU_MINIMA, bounds};

    #[test]
    fn the_cells_of_every_minimum_of_himmelblau_stand_out() {
        let area = bounds(&[-5.0; 2], &[5.0; 2]);
        let grid = scan(&HIMMELBLAU, &area, &[20, 16], &|| false);
        assert_eq!(grid.len(), 320);
        let minima: Vec<_> = grid.minima().iter().map(|&i| grid.point(i)).collect();
        assert_eq!(minima.len(), 4, "{minima:?}");
        for (x, _) in HIMMELBLAU_MINIMA {
            let is_near = |m: &DVector<f64>| (m[0] - x[0]).hypot(m[1] - x[1]) < 0.7;
            assert!(minima.iter().any(is_near), "{x:?}: {minima:?}");
        }
    }

    #[test]
    fn a_plateau_has_one_minimum_and_a_hole_has_none() {
        let flat = crate::numerics::test_functions::Smooth {
            of: |[x, y]: [f64; 2]| {
                (x < 0.5).then_some(crate::numerics::test_functions::Derivatives {
                    value: y * 0.0,
                    gradient: [0.0; 2],
                    hessian: [[0.0; 2]; 2],
                })
            },
        };
        let grid = scan(&flat, &bounds(&[0.0; 2], &[1.0; 2]), &[4, 4], &|| false);
        assert_eq!(grid.minima().len(), 1);
        assert!(grid.value(15).is_infinite());
    }
}
