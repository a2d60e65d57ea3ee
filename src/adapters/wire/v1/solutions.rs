//! The document of `solutions --json`: everything a search left behind.

use serde::Serialize;

use super::identification::{CostV1, DirectionV1, SolutionV1};
use crate::{
    adapters::wire::DocumentError,
    identification::{
        DirectionRecord, Identification,
        scan_comparison::{ScanComparison, ScanMinimum},
        solution::Ended,
    },
};

/// Every solution, every direction with the objective along it, and what a scan says of them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SolutionsV1 {
    /// Site.
    pub site: String,
    /// Fitted events.
    pub fitted_events: Vec<String>,
    /// Every local solution found, best first.
    pub solutions: Vec<SolutionV1>,
    /// Every search direction.
    pub directions: Vec<DirectionProfileV1>,
    /// `nothing_new`, `tiers_exhausted`, `evaluations_exhausted`, `no_solution` or `cancelled`.
    pub ended: &'static str,
    /// The check against a scan, where one was asked for.
    pub scan: Option<ScanV1>,
    /// What it cost.
    pub cost: CostV1,
}

/// A direction with the objective along it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DirectionProfileV1 {
    /// As in `identify --json`.
    #[serde(flatten)]
    pub direction: DirectionV1,
    /// The exit point in search coordinates.
    pub exit_point: Option<Vec<f64>>,
    /// Distance and objective at every point of the exit-point search.
    pub profile: Vec<[f64; 2]>,
}

/// Counterpart of [`ScanComparison`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScanV1 {
    /// Cells along ln alpha, ln nu and kappa.
    pub cells: [usize; 3],
    /// Compared up to this multiple of the lowest objective.
    pub within: f64,
    /// The scan's minima, lowest first.
    pub minima: Vec<ScanMinimumV1>,
    /// Solutions that only the search found.
    pub only_search: Vec<usize>,
    /// Calls of the objective the check cost.
    pub evaluations: u64,
}

/// Counterpart of [`ScanMinimum`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScanMinimumV1 {
    /// Objective.
    pub objective: f64,
    /// ln alpha, ln nu, kappa.
    pub coordinates: [f64; 3],
    /// The solution of the search that it is; null where the search missed it.
    pub solution: Option<usize>,
}

impl SolutionsV1 {
    /// The counterpart of what `identification` holds of its search.
    #[must_use]
    pub fn new(identification: &Identification) -> Self {
        Self {
            site: identification.set.site.clone(),
            fitted_events: identification.set.fitted_events.clone(),
            solutions: (identification.solutions.iter())
                .map(SolutionV1::from)
                .collect(),
            directions: (identification.directions.iter())
                .map(DirectionProfileV1::from)
                .collect(),
            ended: ended_name(identification.ended),
            scan: identification.scan.as_ref().map(ScanV1::from),
            cost: identification.cost.into(),
        }
    }

    /// As compact JSON.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`]; no search is known that causes it.
    pub fn to_json(&self) -> Result<String, DocumentError> {
        serde_json::to_string(self).map_err(|source| DocumentError::Malformed {
            document: "solutions",
            source,
        })
    }
}

impl DirectionProfileV1 {
    /// With at most about `points_max` points of the profile, among them its first and its last.
    #[must_use]
    pub fn thinned(mut self, points_max: usize) -> Self {
        let count = self.profile.len();
        let step = count.div_ceil(points_max.max(1)).max(1);
        let kept = self.profile.iter().enumerate();
        self.profile = kept
            .filter(|(k, _)| k % step == 0 || k + 1 == count)
            .map(|(_, point)| *point)
            .collect();
        self
    }
}

impl From<&DirectionRecord> for DirectionProfileV1 {
    fn from(record: &DirectionRecord) -> Self {
        Self {
            direction: record.into(),
            exit_point: record
                .exit_point
                .as_ref()
                .map(|x| x.iter().copied().collect()),
            profile: record
                .profile
                .iter()
                .map(|&(d, value)| [d, value])
                .collect(),
        }
    }
}

impl From<&ScanComparison> for ScanV1 {
    fn from(scan: &ScanComparison) -> Self {
        Self {
            cells: scan.cells,
            within: scan.within,
            minima: scan.minima.iter().map(ScanMinimumV1::from).collect(),
            only_search: scan.only_search.clone(),
            evaluations: scan.evaluations,
        }
    }
}

impl From<&ScanMinimum> for ScanMinimumV1 {
    fn from(minimum: &ScanMinimum) -> Self {
        Self {
            objective: minimum.objective,
            coordinates: minimum.coordinates,
            solution: minimum.solution,
        }
    }
}

/// The word for the end of a search.
#[must_use]
pub const fn ended_name(ended: Ended) -> &'static str {
    match ended {
        Ended::NothingNew { .. } => "nothing_new",
        Ended::TiersExhausted { .. } => "tiers_exhausted",
        Ended::EvaluationsExhausted { .. } => "evaluations_exhausted",
        Ended::NoSolution => "no_solution",
        Ended::Cancelled => "cancelled",
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use crate::adapters::wire::v1::examples;

    #[test]
    fn a_direction_carries_its_profile_beside_the_fields_of_identify() {
        let document = SolutionsV1::new(&examples::identification());
        let value: Value = serde_json::from_str(&document.to_json().unwrap()).unwrap();
        for pointer in [
            "/solutions/0/tier",
            "/directions/0/outcome",
            "/directions/0/profile/1/1",
            "/directions/0/exit_point/0",
            "/scan/minima/0/solution",
            "/cost/simulations",
        ] {
            assert!(value.pointer(pointer).is_some(), "{pointer}");
        }
        assert_eq!(value["ended"], "nothing_new");
    }
}
