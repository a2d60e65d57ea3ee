//! How far the measurement of one event may scatter around a model: independent noise per sample
//! plus what varies from event to event.
//!
//! ```text
//! Sigma = W^-1 + B B',   Sigma^-1 = W - W B (I + B' W B)^-1 B' W        (Woodbury)
//! ```
//!
//! `W` holds the weights of the samples, each column of `B` one random effect times its standard
//! deviation: the composition of the load and the measured operating point of the event.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::numerics::inner_products::{cross, gram};

/// The covariance of one event's rows (P then Q of every used sample), factored.
#[derive(Clone, Debug)]
pub(super) struct EventCovariance {
    /// Square roots of the weights, `1 / deviation`.
    root_weights: DVector<f64>,
    /// Weighted random columns `W^(1/2) B`.
    basis: DMatrix<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl EventCovariance {
    /// From the standard deviations of the rows and the random columns in the rows' units. `None`
    /// when a number is not finite.
    pub(super) fn new(deviations: &[f64], random: &DMatrix<f64>) -> Option<Self> {
        let root_weights =
            DVector::from_iterator(deviations.len(), deviations.iter().map(|d| 1.0 / d));
        let mut basis = random.clone();
        for mut column in basis.column_iter_mut() {
            column.component_mul_assign(&root_weights);
        }
        let size = basis.ncols();
        let inner = DMatrix::identity(size, size) + gram(&basis);
        let factor = inner.cholesky()?;
        Some(Self {
            root_weights,
            basis,
            factor,
        })
    }

    /// `A' Sigma^-1 A` for the columns of `rows`.
    pub(super) fn gram(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let mut whitened = rows.clone();
        for mut column in whitened.column_iter_mut() {
            column.component_mul_assign(&self.root_weights);
        }
        let cross = cross(&self.basis, &whitened);
        gram(&whitened) - cross.tr_mul(&self.factor.solve(&cross))
    }

    /// Columns, ready for products with others of the same event.
    pub(super) fn weighted(&self, columns: &DMatrix<f64>) -> Weighted {
        let mut whitened = columns.clone();
        for mut column in whitened.column_iter_mut() {
            column.component_mul_assign(&self.root_weights);
        }
        let varying = cross(&self.basis, &whitened);
        Weighted {
            solved: self.factor.solve(&varying),
            varying,
            whitened,
        }
    }

    /// `r' Sigma^-1 r`.
    pub(super) fn square(&self, residual: &DVector<f64>) -> f64 {
        let whitened = residual.component_mul(&self.root_weights);
        let cross = self.basis.tr_mul(&whitened);
        whitened.norm_squared() - cross.dot(&self.factor.solve(&cross))
    }

    /// `Sigma^-1 A` for the columns of `rows`.
    pub(super) fn solved_columns(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let mut solved = rows.clone();
        for (mut column, row) in solved.column_iter_mut().zip(rows.column_iter()) {
            column.copy_from(&self.solved(&row.into_owned()));
        }
        solved
    }

    /// `Sigma^-1 r`.
    pub(super) fn solved(&self, residual: &DVector<f64>) -> DVector<f64> {
        let whitened = residual.component_mul(&self.root_weights);
        let amounts = self.factor.solve(&self.basis.tr_mul(&whitened));
        (whitened - &self.basis * amounts).component_mul(&self.root_weights)
    }

    /// `Y' Sigma Y` for the columns `Y` of `rows`: the covariance of `Y' r`.
    pub(super) fn spread_of(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let mut scaled = rows.clone();
        for mut column in scaled.column_iter_mut() {
            column.component_div_assign(&self.root_weights);
        }
        gram(&scaled) + gram(&cross(&self.basis, &scaled))
    }

    /// What each random effect most probably is, in its standard deviations: `(I + B' W B)^-1 B' W r`, the conditional
    /// mean.
    pub(super) fn amounts(&self, residual: &DVector<f64>) -> DVector<f64> {
        let whitened = residual.component_mul(&self.root_weights);
        self.factor.solve(&self.basis.tr_mul(&whitened))
    }

    /// The part of a residual that what varies from event to event most probably is: `B` times its [`Self::amounts`].
    pub(super) fn varying(&self, residual: &DVector<f64>) -> DVector<f64> {
        (&self.basis * self.amounts(residual)).component_div(&self.root_weights)
    }

    /// All products of the random effects and the columns of `rows`, by which covariances with other deviations of the
    /// same effects are at hand.
    pub(super) fn products(&self, rows: &DMatrix<f64>) -> Products {
        let random = self.basis.ncols();
        let mut both = self
            .basis
            .clone()
            .resize_horizontally(random + rows.ncols(), 0.0);
        for (column, row) in rows.column_iter().enumerate() {
            let whitened = row.component_mul(&self.root_weights);
            both.set_column(random + column, &whitened);
        }
        Products {
            random,
            gram: gram(&both),
        }
    }

    /// Logarithm of `det(I + B' W B)`: what the random effects add to the log determinant.
    pub(super) fn log_determinant(&self) -> f64 {
        2.0 * self
            .factor
            .l_dirty()
            .diagonal()
            .iter()
            .map(|d| d.ln())
            .sum::<f64>()
    }
}

/// Columns of an event as its covariance weighs them.
#[derive(Clone, Debug)]
pub(super) struct Weighted {
    /// `W^(1/2) A`.
    whitened: DMatrix<f64>,
    /// `B' W A`, and what the factored inner matrix makes of it.
    varying: DMatrix<f64>,
    solved: DMatrix<f64>,
}

impl Weighted {
    /// `A' Sigma^-1 C` with the columns `C` of `other`, of the same event.
    pub(super) fn product(&self, other: &Self) -> DMatrix<f64> {
        cross(&self.whitened, &other.whitened) - self.varying.tr_mul(&other.solved)
    }
}

/// `[B A]' W [B A]` of the random effects `B` and some columns `A` of an event.
#[derive(Clone, Debug)]
pub(super) struct Products {
    random: usize,
    gram: DMatrix<f64>,
}

impl Products {
    /// `A' Sigma^-1 A`, and what the random effects add to the log determinant, when each of them has so many
    /// times its standard deviation.
    pub(super) fn scaled(&self, times: impl Fn(usize) -> f64) -> Option<(DMatrix<f64>, f64)> {
        let (random, rows) = (self.random, self.gram.ncols() - self.random);
        let times: Vec<f64> = (0..random).map(times).collect();
        let inner = DMatrix::from_fn(random, random, |i, j| {
            f64::from(u8::from(i == j)) + times[i] * self.gram[(i, j)] * times[j]
        });
        let factor = inner.cholesky()?;
        let cross = DMatrix::from_fn(random, rows, |i, j| times[i] * self.gram[(i, random + j)]);
        let own = self.gram.view((random, random), (rows, rows));
        let diagonal = factor.l_dirty().diagonal();
        let root: f64 = diagonal.iter().map(|d| d.ln()).sum();
        Some((own - cross.tr_mul(&factor.solve(&cross)), 2.0 * root))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn woodbury_agrees_with_the_full_inverse() {
        let deviations = [0.5, 1.0, 2.0, 0.25];
        let random = DMatrix::from_row_slice(4, 2, &[1.0, 0.0, 2.0, 1.0, -1.0, 0.5, 0.3, 0.1]);
        let covariance = EventCovariance::new(&deviations, &random).unwrap();
        let mut full = &random * random.transpose();
        for i in 0..4 {
            full[(i, i)] += deviations[i] * deviations[i];
        }
        let rows = DMatrix::from_row_slice(4, 2, &[1.0, 2.0, -1.0, 0.5, 0.2, 0.3, 4.0, -2.0]);
        let inverse = full.clone().try_inverse().unwrap();
        let expected = rows.transpose() * &inverse * &rows;
        assert!((covariance.gram(&rows) - &expected).amax() < 1e-12);
        let [one, both] = [rows.columns(0, 1).into_owned(), rows.clone()];
        let product = covariance
            .weighted(&one)
            .product(&covariance.weighted(&both));
        assert!((product - expected.rows(0, 1)).amax() < 1e-12);
        assert!((covariance.spread_of(&rows) - rows.transpose() * &full * &rows).amax() < 1e-12);
        assert!((covariance.solved_columns(&rows) - &inverse * &rows).amax() < 1e-12);
        let residual: DVector<f64> = rows.column(1).into_owned();
        assert!((covariance.square(&residual) - expected[(1, 1)]).abs() < 1e-12);
        let weighted = covariance.solved(&residual);
        assert!((weighted - &inverse * &residual).amax() < 1e-12);
        let noise = DVector::from_vec(deviations.map(|d| d * d).to_vec());
        let varying = &residual - noise.component_mul(&(&inverse * &residual));
        assert!((covariance.varying(&residual) - varying).amax() < 1e-12);
        let (gram, logarithm) = covariance.products(&rows).scaled(|_| 1.0).unwrap();
        assert!((gram - rows.transpose() * &inverse * &rows).amax() < 1e-12);
        assert!((logarithm - covariance.log_determinant()).abs() < 1e-12);
        let narrower = EventCovariance::new(&deviations, &(&random * 0.25)).unwrap();
        let (gram, logarithm) = covariance.products(&rows).scaled(|_| 0.25).unwrap();
        assert!((gram - narrower.gram(&rows)).amax() < 1e-12);
        assert!((logarithm - narrower.log_determinant()).abs() < 1e-12);
        let weights: f64 = deviations.iter().map(|d| 2.0 * d.ln()).sum();
        let log_determinant = full.determinant().ln() - weights;
        assert!((covariance.log_determinant() - log_determinant).abs() < 1e-12);
    }
}
