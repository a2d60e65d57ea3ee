//! Between a model's parameters and the unknowns of a search.

use nalgebra::DVector;

use crate::{
    load_model::{
        composed::{ComposedModel, ModelParameter},
        effect::{Prior, Scale},
    },
    numerics::Bounds,
};

/// The free parameters of a fit as unknowns: logarithms where the declaration's prior is
/// logarithmic, the parameter itself elsewhere. The others keep the value they were given.
#[derive(Clone, Debug)]
pub struct Coordinates {
    free: Vec<Unknown>,
    values: Vec<f64>,
}

/// One unknown.
#[derive(Clone, Debug)]
struct Unknown {
    index: usize,
    logarithmic: bool,
    lower: f64,
    upper: f64,
    prior: Prior,
}

impl Unknown {
    fn new(index: usize, parameter: &ModelParameter) -> Self {
        let declared = parameter.declaration;
        let logarithmic = declared.prior.scale == Scale::Logarithmic;
        let scaled = |x: f64| if logarithmic { x.ln() } else { x };
        Self {
            index,
            logarithmic,
            lower: scaled(declared.lower),
            upper: scaled(declared.upper),
            prior: declared.prior,
        }
    }

    fn to_unknown(&self, value: f64) -> f64 {
        let x = if self.logarithmic { value.ln() } else { value };
        x.clamp(self.lower, self.upper)
    }

    fn to_parameter(&self, x: f64) -> f64 {
        if self.logarithmic { x.exp() } else { x }
    }

    /// Derivative of the parameter with respect to the unknown.
    fn slope(&self, value: f64) -> f64 {
        if self.logarithmic { value } else { 1.0 }
    }

    fn centre(&self) -> f64 {
        let centre = self.prior.centre;
        if self.logarithmic {
            centre.ln()
        } else {
            centre
        }
    }

    fn precision(&self) -> f64 {
        self.prior.deviation.powi(-2)
    }
}

impl Coordinates {
    /// The unknowns `free` (indices into the model's parameters, ascending) around `values`.
    #[must_use]
    pub fn new(model: &ComposedModel, values: &[f64], free: &[usize]) -> Self {
        let parameters = model.parameters();
        let unknowns = free.iter().filter(|i| **i < parameters.len());
        Self {
            free: unknowns.map(|&i| Unknown::new(i, &parameters[i])).collect(),
            values: values.to_vec(),
        }
    }

    /// Number of unknowns.
    #[must_use]
    pub fn count(&self) -> usize {
        self.free.len()
    }

    /// Indices of the free parameters.
    #[must_use]
    pub fn indices(&self) -> Vec<usize> {
        self.free.iter().map(|u| u.index).collect()
    }

    /// The unknowns of a parameter vector, moved into their bounds.
    #[must_use]
    pub fn unknowns(&self, parameters: &[f64]) -> DVector<f64> {
        let values = self.free.iter().map(|u| u.to_unknown(parameters[u.index]));
        DVector::from_iterator(self.free.len(), values)
    }

    /// The parameter vector of some unknowns.
    #[must_use]
    pub fn parameters(&self, x: &DVector<f64>) -> Vec<f64> {
        let mut values = self.values.clone();
        for (unknown, x) in self.free.iter().zip(x.iter()) {
            values[unknown.index] = unknown.to_parameter(*x);
        }
        values
    }

    /// Derivative of each free parameter with respect to its unknown.
    pub(super) fn slopes(&self, parameters: &[f64]) -> Vec<f64> {
        let slope = |u: &Unknown| u.slope(parameters[u.index]);
        self.free.iter().map(slope).collect()
    }

    /// Bounds of the unknowns.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let side = |value: fn(&Unknown) -> f64| {
            DVector::from_iterator(self.free.len(), self.free.iter().map(value))
        };
        Bounds {
            lower: side(|u| u.lower),
            upper: side(|u| u.upper),
        }
    }

    /// Centres of the priors.
    pub(super) fn centres(&self) -> DVector<f64> {
        DVector::from_iterator(self.free.len(), self.free.iter().map(Unknown::centre))
    }

    /// Half the squared distance from the priors, its gradient, and the precisions.
    pub(super) fn prior(&self, x: &DVector<f64>) -> (f64, DVector<f64>, DVector<f64>) {
        let count = self.free.len();
        let precisions = self.free.iter().map(Unknown::precision);
        let precision = DVector::from_iterator(count, precisions);
        let gradient = DVector::from_fn(count, |i, _| {
            let away = x[i] - self.free[i].centre();
            if precision[i] > 0.0 {
                precision[i] * away
            } else {
                0.0
            }
        });
        let value = (0..count)
            .filter(|&i| precision[i] > 0.0)
            .map(|i| 0.5 * gradient[i] * gradient[i] / precision[i])
            .sum();
        (value, gradient, precision)
    }
}
