//! The fit of a site from its windows: prepare, split, fit, and where asked for fit again robustly.

use super::{
    Cost, IdentificationError, IdentificationOptions, OperatingPoint, ReactiveTrend, Split,
    composed::{
        Baseline, ComposedFit, ComposedFitOptions, ComposedLoad, baseline, in_order_of,
        left_of_alike, narrowed, refine, without_value,
    },
    edge_exchange::{Exchanges, Sets, at_edges, exchanged, exchanges},
    edge_timing::{align, kept_between},
    evaluate::EventModel,
    fit::{BestOnly, Fit, FitSolution, SearchOptions, check, fit},
    identify::{median_operating_point, prepare_all, reduced_chi_square, split},
    intake::PreparedEvent,
    joint_problem::ProblemOptions,
    phasor_filter::PhasorFilter,
    precision::Precision,
    robust::{RobustLoss, SampleWeights, sample_weights},
    turns::Turns,
};
use crate::{disturbance::Window, load_model::Structure};

/// What the noise alone may leave (weighted squares per row, no event differing from another): where more is left effects
/// are added in other orders, too.
const FOLLOWED: f64 = 0.7;
/// The effect that every motor has. Where the events are followed, the order that begins with it is tried all the same, as
/// what is small shows beside it only.
pub const COMPANION: &str = "stator_resistance";

/// The fit of a site before anything is said of it.
#[derive(Clone, Debug)]
pub struct FittedSite {
    /// What was fitted.
    pub structure: Structure,
    /// Bounds, priors and random effects of the plain part.
    pub problem: ProblemOptions,
    /// The search on the plain part.
    pub found: Fit,
    /// Fitted events, jumps aligned, deviations as the fit used them.
    pub weighted: Vec<PreparedEvent>,
    /// The same events with the deviations that the measurement alone gives.
    pub measured: Vec<PreparedEvent>,
    /// Events held out.
    pub held: Vec<PreparedEvent>,
    /// How the reactive coefficients of all these events go with Q0/P0.
    pub trend: ReactiveTrend,
    /// Where the set refers to.
    pub operating_point: OperatingPoint,
    /// Events that could not be used, with the reason.
    pub refused: Vec<(String, String)>,
    /// The fit of the whole structure, where it has more than the plain path can simulate; `found`
    /// is then the search on its plain part.
    pub composed: Option<ComposedFit>,
    /// Which held-out events were fitted after all, and why.
    pub exchanged: Vec<String>,
}

impl FittedSite {
    pub(super) fn best(&self) -> Result<&FitSolution, IdentificationError> {
        let best = self.found.solutions.first();
        best.ok_or(IdentificationError::NoSolution)
    }

    /// The model of the whole structure; `best` is that of its plain part.
    pub(super) fn model(&self, best: &FitSolution) -> Box<dyn EventModel> {
        match &self.composed {
            None => Box::new(best.model),
            Some(fit) => Box::new(ComposedLoad {
                structure: self.structure.clone(),
                model: fit.model.clone(),
                parameters: fit.parameters.clone(),
            }),
        }
    }

    pub(super) fn precision(&self, best: &FitSolution) -> Precision {
        let chi_square = reduced_chi_square(best, &self.weighted);
        Precision::calibrated(best, &self.weighted, &self.problem, chi_square)
    }

    /// That nothing but the best solution was explored; none where that is only where a composed model began.
    pub(super) fn best_only_note(&self) -> Option<String> {
        let why = self.found.best_only.filter(|_| self.composed.is_none())?;
        let rows: usize = self.weighted.iter().map(PreparedEvent::rows).sum();
        let best = self.found.solutions.first()?;
        let deviations = (2.0 * best.point.objective / rows as f64).sqrt();
        Some(match why {
            BestOnly::NothingDescribes => format!(
                "no solution describes these events (the best leaves {deviations:.0} times the noise per sample): nothing else was explored"
            ),
            BestOnly::MotorsDoNotDiffer => {
                "these events do not tell motors apart: only the best solution was explored"
                    .to_owned()
            }
        })
    }

    /// The longer phasor window that the jumps of the voltage show; none where they show none, or were not asked.
    pub(super) fn window_note(&self) -> Option<String> {
        let filters = self.measured.iter().filter_map(|event| event.filter);
        let longer = filters.filter_map(|filter| match filter {
            PhasorFilter::Longer(window) => Some(window),
            _ => None,
        });
        let window = longer.into_iter().next()?;
        Some(format!(
            "the jumps of the voltage show a phasor window longer than those of the standard, {}, and all events are seen \
             through it",
            window.in_words()
        ))
    }

    /// Which events changed places because they lie at the edge of a relay, and the held-out ones that still do.
    pub(super) fn edge_notes(&self) -> Vec<String> {
        let open = at_edges(self).into_iter();
        let open = open
            .map(|(event, why)| format!("{} {why}: its error says nothing of the model", event.id));
        self.exchanged.iter().cloned().chain(open).collect()
    }

    /// How many samples a robust fit all but set aside; none for an ordinary fit.
    pub(super) fn robust_note(&self) -> Option<String> {
        let (mut aside, mut used) = (0, 0);
        for (weighted, measured) in self.weighted.iter().zip(&self.measured) {
            let halved = |w: &[f64], m: &[f64], k: usize| w[k] * w[k] > 2.0 * m[k] * m[k];
            for k in (0..measured.len()).filter(|&k| measured.used[k]) {
                used += 1;
                aside += usize::from(
                    halved(&weighted.active_deviation, &measured.active_deviation, k)
                        || halved(
                            &weighted.reactive_deviation,
                            &measured.reactive_deviation,
                            k,
                        ),
                );
            }
        }
        (aside > 0).then(|| format!("robust fit: {aside} of {used} samples count less than half"))
    }
}

/// Prepares, splits and fits, as [`identify`](super::identify()) does.
///
/// # Errors
///
/// See [`IdentificationError`].
pub(super) fn fit_site(
    windows: &[Window],
    structure: &[String],
    options: &IdentificationOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<FittedSite, IdentificationError> {
    let intake = options.intake.for_parts(structure);
    let structure = Structure::parse(structure)?.with_ranges(options.ranges.clone());
    let (events, refused) = prepare_all(windows, &intake);
    if events.is_empty() {
        return Err(IdentificationError::NoUsableEvent { refused });
    }
    let sets = split(events, &options.split)?;
    let mut done = fit_sets(sets.clone(), &structure, options, cancel)?;
    if let Split::Share(_) = options.split
        && let Some(Exchanges { moves, told }) = exchanges(&done)
    {
        // Once. Where the other events cannot be fitted, the first ones were.
        match fit_sets(exchanged(sets, &moves), &structure, options, cancel) {
            Ok(mut again) => {
                let (cost, spent) = (&mut again.found.cost, done.found.cost);
                cost.simulations += spent.simulations;
                cost.sensitivity_simulations += spent.sensitivity_simulations;
                done = FittedSite {
                    exchanged: told,
                    ..again
                };
            }
            Err(IdentificationError::Cancelled) => return Err(IdentificationError::Cancelled),
            Err(_) => {}
        }
    }
    Ok(FittedSite { refused, ..done })
}

fn fit_sets(
    (fitted, held): Sets,
    structure: &Structure,
    options: &IdentificationOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<FittedSite, IdentificationError> {
    let problem = options.problem;
    let begun = fit_aligned(fitted, problem, &options.search, cancel)?;
    let (aligned, measured) = match options.robust {
        None => {
            let measured = begun.events.clone();
            (begun, measured)
        }
        Some(loss) => fit_again_robustly(begun, (problem, loss), &options.search, cancel)?,
    };
    let AlignedFit {
        found,
        events: weighted,
        trend,
    } = aligned;
    let held = held.iter().map(|event| trend.applied_to(event)).collect();
    let composed = compose(structure, &found, &problem, &weighted, cancel)?;
    Ok(FittedSite {
        structure: structure.clone(),
        composed,
        problem,
        operating_point: median_operating_point(&measured),
        found,
        weighted,
        measured,
        held,
        trend,
        refused: Vec::new(),
        exchanged: Vec::new(),
    })
}

/// Adds what the plain path cannot simulate, effect after effect, to the search's best solution, and
/// fits everything together. Where that does not follow the events, each of the effects is added last, too; where it does, the
/// companion is added first.
fn compose(
    structure: &Structure,
    found: &Fit,
    problem: &ProblemOptions,
    events: &[PreparedEvent],
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Option<ComposedFit>, IdentificationError> {
    let plain = structure.plain_part();
    if plain == *structure {
        return Ok(None);
    }
    let best = found.solutions.first();
    let best = best.ok_or_else(|| failed(cancel))?;
    let options = ComposedFitOptions::default();
    let begun = baseline(events, &plain, best, problem, &options, cancel);
    let begun = begun.ok_or_else(|| failed(cancel))?;
    let mut missing = structure.names();
    missing.retain(|name| !plain.contains(name));
    let fit = built_up(&begun, &missing, events, &options, cancel)?.all;
    let mut best = narrowed(events, &fit, &options, cancel);
    let left = |fit: &ComposedFit| left_of_alike(events, fit, &options).unwrap_or(f64::INFINITY);
    let relay = structure.effects().any(|e| e.threshold().is_some());
    let newest = missing.last().cloned().unwrap_or_default();
    for _ in 1..missing.len() {
        if !relay {
            break;
        }
        missing.rotate_left(1);
        let companion_first = missing.first().is_some_and(|name| name == COMPANION);
        if left(&best) < FOLLOWED && !companion_first {
            continue;
        }
        // An order that leads nowhere leaves what the others led to.
        let other = match built_up(&begun, &missing, events, &options, cancel) {
            Err(IdentificationError::Cancelled) => return Err(IdentificationError::Cancelled),
            other => other.ok().map(|built| built.all),
        };
        let other = other.and_then(|fit| in_order_of(structure, &fit, events, &options, cancel));
        let other = other.map(|fit| refine(events, fit, &newest, &options, cancel));
        let other = other.map(|fit| narrowed(events, &fit, &options, cancel));
        best = other
            .filter(|other| left(other) < left(&best))
            .unwrap_or(best);
    }
    Ok(Some(best))
}

/// `begun` with the `missing` effects, one after the other.
fn built_up(
    begun: &Baseline,
    missing: &[String],
    events: &[PreparedEvent],
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Baseline, IdentificationError> {
    let mut built = begun.clone();
    for effect in missing {
        let next = built.with(events, effect, options, cancel)?;
        built = next.ok_or_else(|| match failed(cancel) {
            IdentificationError::NoSolution => {
                without_value(events, &built.structure, &built.all, effect)
                    .unwrap_or(IdentificationError::NoSolution)
            }
            other => other,
        })?;
    }
    Ok(built)
}

fn failed(cancel: &(dyn Fn() -> bool + Sync)) -> IdentificationError {
    if cancel() {
        IdentificationError::Cancelled
    } else {
        IdentificationError::NoSolution
    }
}

/// Fits again with the weights that the fit before gives the samples, until they settle: cheap local
/// fits first, then one full search.
fn fit_again_robustly(
    begun: AlignedFit,
    (problem, loss): (ProblemOptions, RobustLoss),
    search: &SearchOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<(AlignedFit, Vec<PreparedEvent>), IdentificationError> {
    const ROUNDS_MAX: usize = 12;
    const SETTLED: f64 = 0.05;
    let (mut found, mut measured) = (begun.found, begun.events);
    let mut local = *search;
    local.trust_tech.tiers_max = 0;
    let mut spent = found.cost;
    let mut before: Option<Vec<SampleWeights>> = None;
    for round in 1.. {
        let best = found.solutions.first();
        let model = best.ok_or(IdentificationError::NoSolution)?.model;
        let weights = measured
            .iter()
            .map(|e| sample_weights(&model, e, &problem, loss))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|_| IdentificationError::NoSolution)?;
        let change = before.map_or(1.0, |old| {
            let pairs = weights.iter().zip(&old);
            pairs.map(|(a, b)| a.largest_change(b)).fold(0.0, f64::max)
        });
        let last = change < SETTLED || round == ROUNDS_MAX;
        let weighted = weights.iter().zip(&measured).map(|(w, e)| w.applied_to(e));
        let how = if last { search } else { &local };
        let mut again = fit_aligned(weighted.collect(), problem, how, cancel)?;
        spent.simulations += again.found.cost.simulations;
        spent.sensitivity_simulations += again.found.cost.sensitivity_simulations;
        again.found.cost = spent;
        for (plain, aligned) in measured.iter_mut().zip(&again.events) {
            let positions: Vec<f64> = aligned.edges.iter().map(|e| e.position).collect();
            *plain = again
                .trend
                .applied_to(&plain.with_edge_positions(&positions));
        }
        if last {
            return Ok((again, measured));
        }
        found = again.found;
        before = Some(weights);
    }
    Err(IdentificationError::NoSolution)
}

/// A fit with the events as it sees them.
#[derive(Clone, Debug)]
pub struct AlignedFit {
    /// The fit.
    pub found: Fit,
    /// The events, their jumps aligned, their reactive coefficients on the trend.
    pub events: Vec<PreparedEvent>,
    /// That trend, as it was found before the last search.
    pub trend: ReactiveTrend,
}

/// Fits, and where voltage jumps lie between unfiltered samples, fits again with the instants that
/// explain P and Q best, until objective and instants settle. Of several events the last search is made with
/// their [`ReactiveTrend`]. Events that no local solution follows to within
/// [`SearchOptions::explored_below_per_row`] are not explored.
///
/// # Errors
///
/// [`IdentificationError::NoSolution`] when the search finds nothing, [`IdentificationError::Cancelled`]
/// when the caller asked to stop.
pub fn fit_aligned(
    mut events: Vec<PreparedEvent>,
    problem: ProblemOptions,
    search: &SearchOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<AlignedFit, IdentificationError> {
    const ROUNDS_MAX: usize = 12;
    let mut turns = Turns::default();
    let mut spent = Cost::default();
    let mut trend = ReactiveTrend::default();
    let open = events.iter().any(PreparedEvent::instants_unseen);
    let several = events.len() > 1;
    // Where the jumps are and what goes with Q0 is settled by local solutions alone, and explored from there.
    let mut exploring = !open && !several && search.explored_below_per_row.is_infinite();
    let rows: usize = events.iter().map(PreparedEvent::rows).sum();
    for round in 1.. {
        let how = if exploring {
            search.unchecked()
        } else {
            search.sketch()
        };
        let found = fit(&events, problem, &how, cancel);
        if cancel() {
            return Err(IdentificationError::Cancelled);
        }
        let mut found = found.ok_or(IdentificationError::NoSolution)?;
        spent.simulations += found.cost.simulations;
        spent.sensitivity_simulations += found.cost.sensitivity_simulations;
        found.cost = spent;
        let Some(best) = found.solutions.first() else {
            break;
        };
        let objective = best.point.objective;
        let next = open.then(|| {
            let aligned = |event: &PreparedEvent| {
                if event.instants_unseen() {
                    align(&best.model, event)
                } else {
                    event.clone()
                }
            };
            let aligned: Vec<_> = events.iter().map(aligned).collect();
            turns.next(objective, &instants(&events), &instants(&aligned))
        });
        let settled = next.as_ref().is_none_or(|next| next.settled) || round % ROUNDS_MAX == 0;
        let near = 2.0 * objective < search.explored_below_per_row * rows as f64;
        if settled && !exploring {
            trend = ReactiveTrend::between(best, &events, &problem);
        }
        match next {
            _ if settled && !exploring && near => {
                events = on_trend(&events, &trend);
                exploring = true;
            }
            Some(next) if !settled => events = with_instants(&events, &next.instants),
            _ => {
                if !exploring {
                    found.best_only = found.best_only.or(Some(BestOnly::NothingDescribes));
                }
                found.scan = check(&events, problem, search, &found.solutions, cancel);
                events = on_trend(&events, &trend);
                return Ok(AlignedFit {
                    found,
                    events,
                    trend,
                });
            }
        }
    }
    Err(IdentificationError::NoSolution)
}

fn on_trend(events: &[PreparedEvent], trend: &ReactiveTrend) -> Vec<PreparedEvent> {
    events.iter().map(|event| trend.applied_to(event)).collect()
}

/// The instants of all jumps, event after event.
fn instants(events: &[PreparedEvent]) -> Vec<f64> {
    let edges = events.iter().flat_map(|event| &event.edges);
    edges.map(|edge| edge.position).collect()
}

/// The events with their jumps at these instants, each kept between its samples.
fn with_instants(events: &[PreparedEvent], instants: &[f64]) -> Vec<PreparedEvent> {
    let mut instants = instants.iter();
    let mut moved = |event: &PreparedEvent| {
        let pairs = event.edges.iter().zip(instants.by_ref());
        let positions: Vec<f64> = pairs.map(|(edge, at)| kept_between(edge, *at)).collect();
        if event.instants_unseen() {
            event.with_edge_positions(&positions)
        } else {
            event.clone()
        }
    };
    events.iter().map(&mut moved).collect()
}
