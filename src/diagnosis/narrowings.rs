//! Fits as they are quoted, once for each: what decides, what a report says and what a step of `improve` quotes are the
//! same fits.

use std::sync::{Mutex, PoisonError};

use crate::identification::composed::ComposedFit;

/// So many are remembered, the last ones.
const REMEMBERED: usize = 16;

/// A fit, the events that gate where it was asked for without them, and what came of it.
#[derive(Clone)]
struct Known {
    of: ComposedFit,
    gates: Option<Vec<bool>>,
    narrowed: ComposedFit,
}

/// The narrowed fits of a case.
#[derive(Default)]
pub(super) struct Narrowings(Mutex<Vec<Known>>);

impl Narrowings {
    /// What `fit` was narrowed to, on the events that do not gate where `gates` are given.
    pub(super) fn known(&self, fit: &ComposedFit, gates: Option<&[bool]>) -> Option<ComposedFit> {
        let list = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let same = |known: &&Known| known.gates.as_deref() == gates && is_same(&known.of, fit);
        list.iter().find(same).map(|known| known.narrowed.clone())
    }

    /// Remembers that.
    pub(super) fn remember(
        &self,
        fit: &ComposedFit,
        gates: Option<&[bool]>,
        narrowed: &ComposedFit,
    ) {
        let mut list = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if list.len() >= REMEMBERED {
            list.remove(0);
        }
        list.push(Known {
            of: fit.clone(),
            gates: gates.map(<[bool]>::to_vec),
            narrowed: narrowed.clone(),
        });
    }
}

/// Whether two fits are the same to the last bit in all that narrowing looks at.
fn is_same(one: &ComposedFit, other: &ComposedFit) -> bool {
    let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    one.free == other.free
        && one.objective.to_bits() == other.objective.to_bits()
        && bits(&one.parameters) == bits(&other.parameters)
        && bits(&one.squares) == bits(&other.squares)
        && one.covariance == other.covariance
        && one.model.effect_names().eq(other.model.effect_names())
}
