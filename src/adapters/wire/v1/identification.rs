//! The document of `identify --json` (design, section 11).

use serde::{Deserialize, Serialize};

use super::{
    DirectionProfileV1, ParameterSetV1,
    json::{nullable, ordered},
    parameter_set::decode_without,
    words::outcome_name,
};
use crate::{
    adapters::wire::DocumentError,
    identification::{
        Cost, DirectionOutcome, DirectionRecord, Identification, ParameterSet, Solution,
    },
};

/// Points kept of the objective along one direction: enough for its shape.
const PROFILE_POINTS_MAX: usize = 24;

/// Fields beside those of the parameter set, which its content hash does not cover.
const BESIDE_THE_SET: [&str; 4] = ["solutions", "directions", "cost", "refused"];

/// Reads the parameter set of an identification, or a set by itself, as
/// [`decode_parameter_set`](super::decode_parameter_set) does.
///
/// # Errors
///
/// [`DocumentError`].
pub fn decode_identified_set(document: &str) -> Result<ParameterSet, DocumentError> {
    decode_without(document, &BESIDE_THE_SET)
}

/// Counterpart of [`Identification`]: the parameter set's fields and how it was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IdentificationV1 {
    /// The parameter set.
    #[serde(flatten)]
    pub set: ParameterSetV1,
    /// Every local solution found, best first.
    pub solutions: Vec<SolutionV1>,
    /// Every search direction and its outcome.
    pub directions: Vec<DirectionProfileV1>,
    /// What it cost.
    pub cost: CostV1,
    /// Events that could not be used.
    pub refused: Vec<RefusedV1>,
}

/// An event that could not be used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RefusedV1 {
    /// Event.
    pub event: String,
    /// Why.
    pub reason: String,
}

/// Counterpart of [`Solution`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SolutionV1 {
    /// Number within the fit.
    pub id: usize,
    /// Tier in which it was found; 0 for the start.
    pub tier: usize,
    /// Solution whose direction led here.
    pub found_from: Option<usize>,
    /// Direction number at that solution.
    pub direction: Option<usize>,
    /// Objective.
    #[serde(with = "nullable")]
    pub objective: f64,
    /// Values by name.
    #[serde(with = "ordered")]
    pub parameters: Vec<(String, f64)>,
    /// Search coordinates by name.
    #[serde(with = "ordered")]
    pub coordinates: Vec<(String, f64)>,
    /// Names of the parameters on a bound.
    pub at_bound: Vec<String>,
}

/// Counterpart of [`DirectionRecord`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DirectionV1 {
    /// Solution it started from.
    pub from: usize,
    /// Number of the direction at that solution.
    pub direction: usize,
    /// Where the direction came from.
    pub label: String,
    /// Distance to the exit point in scaled coordinates.
    pub exit_distance: Option<f64>,
    /// `new_solution`, `known_solution`, `no_exit_point` or `local_solver_infeasible`.
    pub outcome: &'static str,
    /// Solution it led to.
    pub solution: Option<usize>,
    /// Without an exit point: distance at which the search ended.
    pub at_distance: Option<f64>,
    /// Without an exit point: whether the objective became non-finite.
    pub diverged: Option<bool>,
}

/// Counterpart of [`Cost`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CostV1 {
    /// Plain simulations of one event.
    pub simulations: u64,
    /// Simulations of one event with sensitivities.
    pub sensitivity_simulations: u64,
    /// Wall-clock seconds.
    #[serde(with = "nullable")]
    pub seconds: f64,
}

impl IdentificationV1 {
    /// The counterpart of `identification`.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`]; no identification is known that causes it.
    pub fn new(identification: &Identification) -> Result<Self, DocumentError> {
        Ok(Self {
            set: ParameterSetV1::new(&identification.set)?,
            solutions: identification
                .solutions
                .iter()
                .map(SolutionV1::from)
                .collect(),
            directions: identification
                .directions
                .iter()
                .map(|record| DirectionProfileV1::from(record).thinned(PROFILE_POINTS_MAX))
                .collect(),
            cost: identification.cost.into(),
            refused: identification
                .refused
                .iter()
                .map(|(event, reason)| RefusedV1 {
                    event: event.clone(),
                    reason: reason.clone(),
                })
                .collect(),
        })
    }

    /// As compact JSON.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`]; no identification is known that causes it.
    pub fn to_json(&self) -> Result<String, DocumentError> {
        serde_json::to_string(self).map_err(|source| DocumentError::Malformed {
            document: "identification",
            source,
        })
    }
}

impl From<&Solution> for SolutionV1 {
    fn from(solution: &Solution) -> Self {
        Self {
            id: solution.id,
            tier: solution.tier,
            found_from: solution.found_from,
            direction: solution.direction,
            objective: solution.objective,
            parameters: solution.parameters.clone(),
            coordinates: solution.coordinates.clone(),
            at_bound: solution.at_bound.clone(),
        }
    }
}

impl From<&DirectionRecord> for DirectionV1 {
    fn from(record: &DirectionRecord) -> Self {
        let (solution, at_distance, diverged) = match record.outcome {
            DirectionOutcome::NewSolution(id) | DirectionOutcome::KnownSolution(id) => {
                (Some(id), None, None)
            }
            DirectionOutcome::NoExitPoint {
                at_distance,
                diverged,
            } => (None, Some(at_distance), Some(diverged)),
            DirectionOutcome::LocalSolverInfeasible => (None, None, None),
        };
        Self {
            from: record.from,
            direction: record.direction,
            label: record.label.clone(),
            exit_distance: record.exit_distance,
            outcome: outcome_name(record.outcome),
            solution,
            at_distance,
            diverged,
        }
    }
}

impl From<Cost> for CostV1 {
    fn from(cost: Cost) -> Self {
        Self {
            simulations: cost.simulations,
            sensitivity_simulations: cost.sensitivity_simulations,
            seconds: cost.seconds,
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use crate::adapters::wire::v1::examples;

    #[test]
    fn its_set_is_read_again_and_still_held_to_its_hash() {
        let identification = examples::identification();
        let document = IdentificationV1::new(&identification).unwrap();
        let text = document.to_json().unwrap();
        assert_eq!(decode_identified_set(&text).unwrap(), identification.set);
        let alone = serde_json::to_string(&document.set).unwrap();
        assert_eq!(decode_identified_set(&alone).unwrap(), identification.set);
        for other in [
            text.replacen('{', "{\"note\":1,", 1),
            alone.replacen('{', "{\"cost\":1,", 1),
        ] {
            let refused = decode_identified_set(&other);
            assert!(
                matches!(refused, Err(DocumentError::HashDiffers { .. })),
                "{refused:?}"
            );
        }
    }

    #[test]
    fn the_fields_fixed_by_the_design_are_there() {
        let identification = examples::identification();
        let document = IdentificationV1::new(&identification).unwrap();
        let value: Value = serde_json::from_str(&document.to_json().unwrap()).unwrap();
        for pointer in [
            "/structure",
            "/parameters/M/value",
            "/fit/events/0/skill_p",
            "/held_out/eps_q_percent",
            "/error_to_noise",
            "/verdict/status",
            "/solutions/0/found_from",
            "/solutions/0/parameters/M",
            "/directions/0/solution",
            "/cost/simulations",
            "/cost/sensitivity_simulations",
            "/cost/seconds",
        ] {
            assert!(value.pointer(pointer).is_some(), "{pointer}");
        }
        let outcomes: Vec<_> = identification
            .directions
            .iter()
            .map(|record| DirectionV1::from(record).outcome)
            .collect();
        assert_eq!(
            outcomes,
            [
                "new_solution",
                "known_solution",
                "no_exit_point",
                "local_solver_infeasible"
            ]
        );
        assert_eq!(
            value["directions"][2]["at_distance"],
            Value::Null,
            "infinite"
        );
        assert_eq!(value["directions"][2]["diverged"], true);
    }
}
