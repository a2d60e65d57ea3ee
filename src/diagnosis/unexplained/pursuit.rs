//! Orthogonal least squares with groups: term after term, the one that with its coefficients of P
//! and of Q takes most off what is left.

use nalgebra::{DMatrix, DVector};

use super::{
    rows::{Rows, dot},
    term::Term,
};

/// Most terms: a fourth would not fit into the states and parameters of an effect file.
pub(super) const TERMS_MAX: usize = 3;
/// States of an effect file.
const STATES_MAX: usize = 8;
/// A term of which less than this share (squared) is left after what is chosen says nothing new.
const NEW_MIN: f64 = 0.01;
/// Thresholds whose gain is within this share of the best, or this absolute gain, are alike: the one in
/// the middle is taken, because the best lies at the edge of what the events bracket.
const ALIKE: f64 = 0.01;
const ALIKE_ABSOLUTE: f64 = 3.0;

/// A term as it was chosen.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Step {
    pub(super) term: usize,
    /// Lowest and highest threshold that do as well.
    pub(super) thresholds: Option<[f64; 2]>,
    /// What it took off the squares of P and of Q.
    pub(super) gains: [f64; 2],
    /// Price of its parameters by the Bayesian information criterion.
    pub(super) price: f64,
}

/// The path of a pursuit.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Path {
    /// Squares of both channels before the first term, the free columns fitted.
    pub(super) squares: f64,
    pub(super) steps: Vec<Step>,
}

/// Chooses terms until no one pays for its parameters.
pub(super) fn pursue(rows: &Rows, terms: &[Term]) -> Path {
    let mut residual = rows.residual.clone();
    let mut columns = rows.terms.clone();
    let whole: Vec<[f64; 2]> = columns
        .iter()
        .map(|c| [0, 1].map(|i: usize| square(&c[i])))
        .collect();
    for c in 0..2 {
        for direction in orthonormal(&rows.free[c]) {
            remove(&mut residual[c], &direction);
            for column in &mut columns {
                remove(&mut column[c], &direction);
            }
        }
    }
    let mut path = Path {
        squares: square(&residual[0]) + square(&residual[1]),
        steps: Vec::new(),
    };
    let mut states = 0;
    while path.steps.len() < TERMS_MAX {
        let gains: Vec<[f64; 2]> = (0..terms.len())
            .map(|j| {
                let fits = states + terms[j].states() <= STATES_MAX;
                let known = path.steps.iter().any(|s| s.term == j);
                [0, 1].map(|c: usize| {
                    let left = square(&columns[j][c]);
                    if !fits || known || left <= NEW_MIN * whole[j][c] || left <= 0.0 {
                        0.0
                    } else {
                        dot(&columns[j][c], &residual[c]).powi(2) / left
                    }
                })
            })
            .collect();
        let left = square(&residual[0]) + square(&residual[1]);
        let Some(step) = best(&gains, terms, 2 * rows.count(), left) else {
            break;
        };
        states += terms[step.term].states();
        for c in 0..2 {
            let direction = unit(&columns[step.term][c]);
            remove(&mut residual[c], &direction);
            for column in &mut columns {
                remove(&mut column[c], &direction);
            }
        }
        path.steps.push(step);
    }
    path
}

/// The term with the best criterion, if it pays.
fn best(gains: &[[f64; 2]], terms: &[Term], rows: usize, left: f64) -> Option<Step> {
    let count = rows.max(1) as f64;
    let scale = (left / count).max(1.0);
    let price = |j: usize| {
        let parameters = 2 + terms[j].shapes().len();
        scale * (parameters as f64 * count.ln() + 2.0 * (terms.len() as f64).ln())
    };
    let worth = |j: usize| gains[j][0] + gains[j][1] - price(j);
    let first = (0..terms.len()).max_by(|&a, &b| worth(a).total_cmp(&worth(b)).then(b.cmp(&a)))?;
    let most = gains[first][0] + gains[first][1];
    if worth(first) <= 0.0 {
        return None;
    }
    let slack = (ALIKE * most).max(ALIKE_ABSOLUTE * scale);
    let alike: Vec<usize> = (0..terms.len())
        .filter(|&j| terms[j].differs_in_threshold_only(&terms[first]))
        .filter(|&j| gains[j][0] + gains[j][1] >= most - slack)
        .collect();
    let term = if terms[first].threshold().is_some() {
        alike[alike.len() / 2]
    } else {
        first
    };
    let thresholds = alike.iter().filter_map(|&j| terms[j].threshold());
    let bracket = thresholds.fold(None, |bracket: Option<[f64; 2]>, t| {
        let [low, high] = bracket.unwrap_or([t, t]);
        Some([low.min(t), high.max(t)])
    });
    Some(Step {
        term,
        thresholds: bracket,
        gains: gains[term],
        price: price(term),
    })
}

/// Coefficients of the free columns, then of the terms, for one channel.
pub(super) fn coefficients(rows: &Rows, channel: usize, chosen: &[usize]) -> Vec<f64> {
    let columns = columns(rows, channel, chosen);
    let flat: Vec<f64> = columns.iter().flat_map(|c| c.iter().copied()).collect();
    let matrix = DMatrix::from_vec(rows.count(), columns.len(), flat);
    let right = DVector::from_column_slice(&rows.residual[channel]);
    let mut normal = matrix.tr_mul(&matrix);
    let largest = normal.diagonal().amax().max(f64::MIN_POSITIVE);
    for i in 0..normal.nrows() {
        // A column that is zero in these events gets the coefficient zero.
        normal[(i, i)] += 1e-10 * normal[(i, i)] + 1e-14 * largest;
    }
    let solution = normal.cholesky().map(|f| f.solve(&matrix.tr_mul(&right)));
    solution.map_or_else(|| vec![0.0; columns.len()], |x| x.iter().copied().collect())
}

/// Squares left by given coefficients of the terms, the free columns fitted.
pub(super) fn squares(rows: &Rows, channel: usize, chosen: &[usize], coefficients: &[f64]) -> f64 {
    let mut left = rows.residual[channel].clone();
    for (&term, coefficient) in chosen.iter().zip(coefficients) {
        for (left, x) in left.iter_mut().zip(&rows.terms[term][channel]) {
            *left -= coefficient * x;
        }
    }
    for direction in orthonormal(&rows.free[channel]) {
        remove(&mut left, &direction);
    }
    square(&left)
}

fn columns<'a>(rows: &'a Rows, channel: usize, chosen: &[usize]) -> Vec<&'a Vec<f64>> {
    let terms = chosen.iter().map(|&j| &rows.terms[j][channel]);
    rows.free[channel].iter().chain(terms).collect()
}

fn orthonormal(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for column in columns {
        let mut rest = column.clone();
        for known in &basis {
            remove(&mut rest, known);
        }
        if square(&rest) > 1e-12 * square(column) && square(&rest) > 0.0 {
            basis.push(unit(&rest));
        }
    }
    basis
}

fn square(x: &[f64]) -> f64 {
    dot(x, x)
}

fn unit(x: &[f64]) -> Vec<f64> {
    let length = square(x).sqrt();
    if length > 0.0 {
        x.iter().map(|x| x / length).collect()
    } else {
        x.to_vec()
    }
}

/// Takes the part along a unit vector out.
fn remove(x: &mut [f64], direction: &[f64]) {
    let along = dot(x, direction);
    for (x, d) in x.iter_mut().zip(direction) {
        *x -= along * d;
    }
}
