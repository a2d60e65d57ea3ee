//! The global search over a joint problem: deterministic starts, Trust-Tech, solutions named apart.

use super::{
    Cost, DirectionRecord,
    evaluate::FittedModel,
    intake::PreparedEvent,
    joint_problem::{JointPoint, JointProblem, OUTER, ProblemOptions},
    paper_problem::{PAPER, PaperProblem, Scale},
    scan_comparison::{ScanCheck, ScanComparison},
    search::{self, Located},
};
use crate::numerics::trust_tech::{self, Ended};

/// In which unknowns the search is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Formulation {
    /// Three nonlinear coordinates in a box, the linear coefficients solved for at each point.
    #[default]
    Reduced,
    /// The paper's nine parameters in the box (14) under (13), with slack variables (4)-(5); `M`,
    /// `T0'`, `X` and `X'` in logarithms.
    Paper,
    /// The same with all nine as they are: the paper to the letter.
    PaperLinear,
}

/// Settings of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchOptions {
    /// In which unknowns the search is made. Default reduced.
    pub formulation: Formulation,
    /// Settings of Trust-Tech.
    pub trust_tech: trust_tech::Options,
    /// Cells of the scan whose minima are the starts, along ln alpha, ln nu and kappa. Default 6, 8
    /// and 4; each 1 to 100.
    pub start_cells: [usize; OUTER],
    /// How many of the scan's minima become starts at most. Default 8; 1 to 64.
    pub starts_max: usize,
    /// Cells of a second, finer scan where solutions compete: where more than one is worth exploring
    /// once the tiers have ended. Its minima are further starts. Default 12, 16 and 8.
    pub second_start_cells: [usize; OUTER],
    /// Starts from that scan at most. Default 24; 0 for no second scan.
    pub second_starts_max: usize,
    /// Whether what was found is held against a scan of its own afterwards. Default off.
    pub check: ScanCheck,
    /// Fits whose best local solution leaves more than this (weighted squares per row) are not
    /// explored: what else there is describes them no better. Default infinite.
    pub explored_below_per_row: f64,
}

impl Default for SearchOptions {
    fn default() -> Self {
        let mut options = trust_tech::Options {
            tiers_max: 20,
            step: 0.04,
            gradient_steps: 1,
            // What lies behind a local solution with half as much squared error again describes
            // another load; where it lies exactly is of no interest either.
            explore_within: 1.5,
            coarse_decrease_relative: 5e-3,
            evaluations_max: 4000,
            ..trust_tech::Options::default()
        };
        // The objective is a sum of squares of some thousand samples: a relative decrease below
        // 1e-8 moves no parameter by a hundredth of its standard error.
        options.local.decrease_relative = 1e-8;
        // ... and so does one of a millionth, the objective being half a chi-square: without noise it tends to 0.
        options.local.decrease_absolute = 1e-6;
        options.local.step_relative = 1e-7;
        options.local.evaluations_max = 120;
        Self {
            formulation: Formulation::Reduced,
            trust_tech: options,
            start_cells: [6, 8, 4],
            starts_max: 8,
            second_start_cells: [12, 16, 8],
            second_starts_max: 24,
            check: ScanCheck::Off,
            explored_below_per_row: f64::INFINITY,
        }
    }
}

impl SearchOptions {
    /// The local solutions of the scan alone.
    #[must_use]
    pub fn sketch(&self) -> Self {
        let trust_tech = trust_tech::Options {
            tiers_max: 0,
            ..self.trust_tech
        };
        Self {
            trust_tech,
            second_starts_max: 0,
            ..self.unchecked()
        }
    }

    /// Without the check.
    #[must_use]
    pub fn unchecked(&self) -> Self {
        Self {
            check: ScanCheck::Off,
            ..*self
        }
    }

    /// The defaults of a formulation. With the paper's: one start, its plain form of Trust-Tech
    /// (slacks, constant step, one sign of each eigenvector), every solution explored.
    #[must_use]
    pub fn of(formulation: Formulation) -> Self {
        let reduced = Self::default();
        if formulation == Formulation::Reduced {
            return reduced;
        }
        let mut local = reduced.trust_tech.local;
        local.evaluations_max = 300;
        Self {
            formulation,
            trust_tech: trust_tech::Options {
                local,
                evaluations_max: 20_000,
                ..trust_tech::Options::paper()
            },
            second_starts_max: 0,
            ..reduced
        }
    }
}

/// A local solution of a joint fit.
#[derive(Clone, Debug)]
pub struct FitSolution {
    /// How it was found; in outer coordinates whatever the formulation.
    pub found: trust_tech::FoundSolution,
    /// Everything at that point.
    pub point: JointPoint,
    /// The model.
    pub model: FittedModel,
    /// With the paper's formulation: its nine parameters and the names of those on a bound of (14).
    pub paper: Option<([f64; PAPER], Vec<String>)>,
}

/// The outcome of a joint fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Local solutions, best first.
    pub solutions: Vec<FitSolution>,
    /// Every direction, in order of exploration.
    pub directions: Vec<DirectionRecord>,
    /// Why the search ended.
    pub ended: Ended,
    /// Why nothing but the best solution was explored, where that is so.
    pub best_only: Option<BestOnly>,
    /// What a scan says of it, where one was asked for.
    pub scan: Option<ScanComparison>,
    /// Cost, the scan's check not included.
    pub cost: Cost,
}

/// Why nothing but the best solution was explored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BestOnly {
    /// It leaves more than ten standard deviations per sample of several events, or more than was asked to be explored.
    NothingDescribes,
    /// Half of the motors that the box is scanned with leave hardly more than the best of them.
    MotorsDoNotDiffer,
}

/// Fits the events jointly. `None` when no start is feasible.
#[must_use]
pub fn fit(
    events: &[PreparedEvent],
    problem: ProblemOptions,
    options: &SearchOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Fit> {
    let problem = JointProblem::new(events, problem, cancel);
    let Located {
        mut solutions,
        directions,
        ended,
        best_only,
    } = match options.formulation {
        Formulation::Reduced => search::reduced(&problem, options, cancel),
        Formulation::Paper => {
            let paper = paper_problem(&problem, Scale::Logarithmic);
            search::paper(&problem, &paper, options, cancel)
        }
        Formulation::PaperLinear => {
            let paper = paper_problem(&problem, Scale::Linear);
            search::paper(&problem, &paper, options, cancel)
        }
    };
    solutions.sort_by(|a, b| {
        a.point
            .objective
            .total_cmp(&b.point.objective)
            .then(a.found.id.cmp(&b.found.id))
    });
    let (simulations, sensitivity_simulations) = problem.simulations();
    if solutions.is_empty() {
        return None;
    }
    let scan = check(events, *problem.options(), options, &solutions, cancel);
    Some(Fit {
        solutions,
        directions,
        ended,
        best_only,
        scan,
        cost: Cost {
            simulations,
            sensitivity_simulations,
            seconds: 0.0,
        },
    })
}

/// Holds the solutions of a fit against a scan, when the options ask for it.
#[must_use]
pub fn check(
    events: &[PreparedEvent],
    problem: ProblemOptions,
    options: &SearchOptions,
    solutions: &[FitSolution],
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<ScanComparison> {
    let cells = options.check.cells()?;
    let problem = JointProblem::new(events, problem, cancel);
    Some(ScanComparison::new(
        &problem, solutions, cells, options, cancel,
    ))
}

fn paper_problem<'a>(problem: &'a JointProblem<'a>, scale: Scale) -> PaperProblem<'a> {
    let base = super::identify::median_operating_point(problem.events());
    PaperProblem::new(problem, base, scale)
}
