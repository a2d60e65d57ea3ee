//! Positive definite banded systems with complex unknowns, as local smoothing makes them.

use nalgebra::Complex;

/// A Hermitian matrix whose entries vanish further than `half_bandwidth` from the diagonal, with a
/// right-hand side: the normal equations of a least-squares problem whose rows touch only
/// neighbouring unknowns.
#[derive(Clone, Debug)]
pub struct BandedNormalEquations {
    size: usize,
    half_bandwidth: usize,
    /// Row i holds columns `i - half_bandwidth ..= i`.
    lower: Vec<Complex<f64>>,
    /// The first column of each row that any equation touches: what lies before it stays zero in the factor as well.
    first: Vec<usize>,
    right: Vec<Complex<f64>>,
}

/// The solution of banded normal equations.
#[derive(Clone, Debug)]
pub struct BandedSolution {
    /// The unknowns.
    pub x: Vec<Complex<f64>>,
    /// Logarithm of the determinant of the matrix.
    pub ln_determinant: f64,
    half_bandwidth: usize,
    first: Vec<usize>,
    factor: Vec<Complex<f64>>,
}

impl BandedNormalEquations {
    /// No rows yet.
    #[must_use]
    pub fn new(size: usize, half_bandwidth: usize) -> Self {
        let zero = Complex::new(0.0, 0.0);
        Self {
            size,
            half_bandwidth,
            lower: vec![zero; size * (half_bandwidth + 1)],
            first: (0..size).collect(),
            right: vec![zero; size],
        }
    }

    /// Adds the equation `sum_j coefficients[j] x[first + j] = target` with a weight.
    ///
    /// `coefficients` holds at most `half_bandwidth + 1` numbers and ends within the unknowns.
    pub fn add(
        &mut self,
        first: usize,
        coefficients: &[Complex<f64>],
        target: Complex<f64>,
        weight: f64,
    ) {
        let width = self.half_bandwidth + 1;
        for (i, a) in coefficients.iter().enumerate() {
            let scaled = a.conj() * weight;
            let row = first + i;
            self.first[row] = self.first[row].min(first);
            self.right[row] += scaled * target;
            let origin = row * width + self.half_bandwidth;
            for (j, b) in coefficients[..=i].iter().enumerate() {
                self.lower[origin - (i - j)] += scaled * b;
            }
        }
    }

    /// [`Self::add`] with real coefficients.
    pub fn add_real(
        &mut self,
        first: usize,
        coefficients: &[f64],
        target: Complex<f64>,
        weight: f64,
    ) {
        let width = self.half_bandwidth + 1;
        for (i, a) in coefficients.iter().enumerate() {
            let scaled = a * weight;
            let row = first + i;
            self.first[row] = self.first[row].min(first);
            self.right[row] += target * scaled;
            let origin = row * width + self.half_bandwidth;
            for (j, b) in coefficients[..=i].iter().enumerate() {
                self.lower[origin - (i - j)].re += scaled * b;
            }
        }
    }

    /// Solves by Cholesky's method within each row's own band, at most `O(size half_bandwidth^2)`; `None` where the matrix
    /// is not positive definite.
    #[must_use]
    pub fn solve(mut self) -> Option<BandedSolution> {
        let (band, width) = (self.half_bandwidth, self.half_bandwidth + 1);
        let mut ln_determinant = 0.0;
        for i in 0..self.size {
            let from = self.first[i];
            for j in from..=i {
                let common = from.max(self.first[j]);
                // Where column 0 of each row would be.
                let [own, other] = [i, j].map(|row| row * width + band - row);
                let mut value = self.lower[own + j];
                let left = &self.lower[own + common..own + j];
                let right = &self.lower[other + common..other + j];
                for (left, right) in left.iter().zip(right) {
                    value -= left * right.conj();
                }
                let diagonal = self.lower[other + j].re;
                self.lower[own + j] = if i == j {
                    if !(value.re > 0.0 && value.re.is_finite()) {
                        return None;
                    }
                    ln_determinant += value.re.ln();
                    Complex::new(value.re.sqrt(), 0.0)
                } else {
                    value / diagonal
                };
            }
        }
        let mut solution = BandedSolution {
            x: std::mem::take(&mut self.right),
            ln_determinant,
            half_bandwidth: band,
            first: self.first,
            factor: self.lower,
        };
        solution.substitute();
        Some(solution)
    }
}

impl BandedSolution {
    fn substitute(&mut self) {
        let (band, width, size) = (self.half_bandwidth, self.half_bandwidth + 1, self.x.len());
        for i in 0..size {
            let from = self.first[i];
            let row = &self.factor[(i + 1) * width - 1 - (i - from)..(i + 1) * width];
            let mut value = self.x[i];
            for (factor, x) in row.iter().zip(&self.x[from..i]) {
                value -= factor * x;
            }
            self.x[i] = value / row[i - from].re;
        }
        for i in (0..size).rev() {
            let mut value = self.x[i];
            for k in i + 1..(i + width).min(size) {
                value -= self.factor[k * width + band + i - k].conj() * self.x[k];
            }
            self.x[i] = value / self.factor[i * width + band].re;
        }
    }

    /// The diagonal of the inverse: variances of the unknowns where the weights are inverse
    /// variances. By Takahashi's recurrence within the band, `O(size half_bandwidth^2)`.
    #[must_use]
    pub fn variances(&self) -> Vec<f64> {
        let (band, width, size) = (self.half_bandwidth, self.half_bandwidth + 1, self.x.len());
        let zero = Complex::new(0.0, 0.0);
        // inverse[i * width + d] = Z[i, i + d].
        let mut inverse = vec![zero; size * width];
        let z = |inverse: &[Complex<f64>], i: usize, j: usize| {
            if i <= j {
                inverse[i * width + (j - i)]
            } else {
                inverse[j * width + (i - j)].conj()
            }
        };
        for i in (0..size).rev() {
            let pivot = self.factor[i * width + band].re;
            let end = (i + width).min(size);
            for j in (i..end).rev() {
                let mut sum = zero;
                for k in i + 1..end {
                    // L^H Z = L^-1: row i of L^H holds conj(L[k, i]).
                    sum += self.factor[k * width + band + i - k].conj() * z(&inverse, k, j);
                }
                let own = if i == j { 1.0 / pivot } else { 0.0 };
                inverse[i * width + (j - i)] = (Complex::new(own, 0.0) - sum) / pivot;
            }
        }
        (0..size).map(|i| inverse[i * width].re).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// Rows of equations as they are added, and the same system in full.
    struct Both {
        banded: BandedNormalEquations,
        matrix: DMatrix<Complex<f64>>,
        right: DVector<Complex<f64>>,
    }

    impl Both {
        fn new(size: usize, half_bandwidth: usize) -> Self {
            Self {
                banded: BandedNormalEquations::new(size, half_bandwidth),
                matrix: DMatrix::zeros(size, size),
                right: DVector::zeros(size),
            }
        }

        fn add(
            &mut self,
            first: usize,
            row: &[Complex<f64>],
            (target, weight): (Complex<f64>, f64),
        ) {
            self.banded.add(first, row, target, weight);
            self.add_in_full(first, row, (target, weight));
        }

        fn add_real(&mut self, first: usize, row: &[f64], (target, weight): (Complex<f64>, f64)) {
            self.banded.add_real(first, row, target, weight);
            let row: Vec<Complex<f64>> = row.iter().map(|x| Complex::new(*x, 0.0)).collect();
            self.add_in_full(first, &row, (target, weight));
        }

        fn add_in_full(
            &mut self,
            first: usize,
            row: &[Complex<f64>],
            (target, weight): (Complex<f64>, f64),
        ) {
            for (i, a) in row.iter().enumerate() {
                self.right[first + i] += a.conj() * target * weight;
                for (j, b) in row.iter().enumerate() {
                    self.matrix[(first + i, first + j)] += a.conj() * b * weight;
                }
            }
        }

        /// Solution, variances and determinant, banded and in full.
        fn agree(self) {
            let solution = self.banded.solve().unwrap();
            let inverse = self.matrix.clone().try_inverse().unwrap();
            let expected = &inverse * self.right;
            for (i, variance) in solution.variances().into_iter().enumerate() {
                assert!((solution.x[i] - expected[i]).norm() < 1e-9);
                assert!((variance - inverse[(i, i)].re).abs() < 1e-9);
            }
            let determinant = self.matrix.determinant();
            assert!((solution.ln_determinant - determinant.re.ln()).abs() < 1e-9);
        }
    }

    #[test]
    fn a_banded_solution_agrees_with_a_dense_one() {
        let size = 9;
        let mut both = Both::new(size, 3);
        for k in 0..12_usize {
            let row = [0, 1, 2, 3].map(|j| {
                let x = (7 * k + 3 * j) as f64;
                Complex::new(x.sin(), (1.7 * x).cos())
            });
            let target = Complex::new(k as f64, 1.0 - k as f64);
            both.add(k % (size - 3), &row, (target, 0.5 + 0.1 * k as f64));
        }
        both.agree();
    }

    #[test]
    fn rows_with_bands_of_their_own_and_real_ones_agree_with_a_dense_solution() {
        let size = 12;
        let mut both = Both::new(size, 4);
        let target = |k: usize| Complex::new((k as f64).cos(), 0.3 * k as f64);
        for k in 0..size {
            both.add_real(k, &[1.5], (target(k), 2.0));
        }
        for first in [0, 1, 6] {
            both.add_real(first, &[-1.0, 3.0, -3.0, 1.0], (target(first), 0.7));
        }
        let wide = [0.4, -0.2, 1.1, 0.9, -0.5].map(|x| Complex::new(x, 1.0 - x));
        both.add(5, &wide, (target(5), 3.0));
        both.agree();
    }

    #[test]
    fn an_unknown_without_an_equation_has_no_solution() {
        let mut banded = BandedNormalEquations::new(2, 1);
        let one = Complex::new(1.0, 0.0);
        banded.add(0, &[one], one, 1.0);
        assert!(banded.solve().is_none());
    }
}
