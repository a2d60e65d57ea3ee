//! One more effect on a fitted model: screened where it is absent over a grid of its shapes, then
//! refitted in stages from the best of them.

use super::{
    base::Base,
    candidates::{distinct, promises},
    fit::{ComposedFit, ComposedFitOptions, ROUGH_ABOVE, approached, fit_rows, unfitted},
    refine::refine_rows,
    rows::EventRows,
    screening::{Candidate, Memory, Score, Screening, Step, thresholds},
};
use crate::{
    identification::intake::PreparedEvent,
    load_model::{
        Structure,
        composed::{Accuracy, ComposedModel},
        effect::{Effect, Parameter, Role, Scale},
        effects,
        structure::StructureError,
    },
    numerics::local_solver,
};

/// Candidates from which a refit starts; one more where an ordinary load is a start.
const STARTS: usize = 3;
/// Shares of the proposed amplitude that are tried.
const SHRINKING: [f64; 3] = [1.0, 0.4, 0.1];
/// A start that leaves more than this multiple of what the best one leaves, the effect fitted alone, is
/// not fitted any further.
const STAGED_LEFT_MAX: f64 = 2.0;
/// The same among starts at loads that were not fitted.
const UNFITTED_LEFT_MAX: f64 = 4.0;
/// An effect whose best start is so many times as far as what is wanted, in the screen and fitted alone, is not looked
/// at any further: screens and refits were up to 20 times apart.
const OUT_OF_QUESTION: f64 = 50.0;
/// Where the noise alone leaves more than this per row, the sketch is fitted with what varies from event to
/// event ...
const ENDED_ABOVE: f64 = 10.0;
/// ... from so many starts only.
const ENDED_MAX: usize = 2;
/// What a fit begun at an ordinary load leaves is multiplied by this before it is compared with others.
const HANDICAP: f64 = 1.25;
/// Calls of the objective with which the effect alone is brought near its optimum.
const FIRST_STAGE_EVALUATIONS: u64 = 10;
/// Standard errors below this share of the prior's deviation come from the data.
const DETERMINED: f64 = 0.7;

/// What an effect is mistaken for is taken where that is better by this much.
const MISTAKEN_GAIN: f64 = 1.0;
/// Starts from one origin that leave the same to this share are one.
const SAME_LEFT: f64 = 1e-4;

/// Fits of one structure, from which effects are added to it: to the same or to fewer events than it
/// holds.
pub struct Ground<'a> {
    events: &'a [PreparedEvent],
    structure: &'a Structure,
    rows: Vec<EventRows<'a>>,
    /// With what their screens share; none where an event cannot be simulated.
    origins: Vec<(&'a ComposedFit, Option<Base>)>,
    /// How many of them were fitted to events; those that were not come last.
    fitted: usize,
    /// Coarse.
    options: ComposedFitOptions,
    cancel: &'a (dyn Fn() -> bool + Sync),
}

/// Where a refit starts.
struct Start {
    /// The place of its origin.
    origin: usize,
    /// What it leaves: weighted squares, and later, once it was approached, per row with the noise alone.
    left: f64,
    parameters: Vec<f64>,
    /// The refit from here, where it was made already.
    whole: Option<ComposedFit>,
}

/// Where refits start, or the fit that shows that none leads to what is wanted.
enum Starts {
    Several(Vec<Start>),
    OutOfReach(Option<Box<ComposedFit>>),
}

/// An effect looked for in what the origins leave.
pub struct Screened {
    effect: &'static dyn Effect,
    model: ComposedModel,
    /// Over the grid and from every origin, by its place, most gain first; those from the one that was not fitted
    /// come last.
    candidates: Vec<(usize, Candidate)>,
    /// What the screens from every origin share; none where there was no screen.
    memories: Vec<Option<Memory>>,
}

impl std::fmt::Debug for Screened {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Screened")
            .field("effect", &self.effect.declaration().name)
            .field("candidates", &self.candidates.len())
            .finish_non_exhaustive()
    }
}

impl std::fmt::Debug for Ground<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ground")
            .field("structure", self.structure)
            .field("events", &self.events.len())
            .field("origins", &self.origins.len())
            .finish_non_exhaustive()
    }
}

impl Screened {
    /// The best score.
    #[must_use]
    pub fn best(&self) -> Option<&Score> {
        self.candidates.first().map(|(_, best)| &best.score)
    }
}

impl<'a> Ground<'a> {
    /// The origins on `events`.
    #[must_use]
    pub fn new(
        events: &'a [PreparedEvent],
        structure: &'a Structure,
        origins: &[&'a ComposedFit],
        options: &ComposedFitOptions,
        cancel: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        let near = |fit: &&ComposedFit| fit.chi_square_per_row() < ROUGH_ABOVE;
        let accuracy = if origins.first().is_some_and(near) {
            Accuracy::Full
        } else {
            Accuracy::Rough
        };
        let of = |event| EventRows::with_accuracy(event, accuracy);
        let rows: Vec<EventRows<'a>> = events.iter().map(of).collect();
        let with_base = |fit: &&'a ComposedFit| (*fit, Base::new(&rows, fit, &options.scatter));
        Self {
            events,
            structure,
            origins: origins.iter().map(with_base).collect(),
            fitted: origins.len(),
            rows,
            options: options.coarse(),
            cancel,
        }
    }

    /// The same, and refits begin from `ordinary` too: loads that were not fitted, so that what they leave says
    /// nothing of what is missing.
    #[must_use]
    pub fn and_from(mut self, ordinary: impl IntoIterator<Item = &'a ComposedFit>) -> Self {
        for load in ordinary {
            let base = Base::new(&self.rows, load, &self.options.scatter);
            self.origins.push((load, base));
        }
        self
    }

    fn is_unfitted(&self, origin: usize) -> bool {
        origin >= self.fitted
    }

    fn step<'s>(&'s self, origin: usize, screened: &'s Screened) -> Step<'s> {
        Step {
            rows: &self.rows,
            model: &screened.model,
            effect: screened.effect,
            origin: self.origins[origin].0,
            options: &self.options,
            cancel: self.cancel,
        }
    }

    /// Looks for `effect` at every point of its grid; nothing is refitted.
    ///
    /// # Errors
    ///
    /// [`StructureError`] when the effect is not in the catalogue, or excluded by a part of the
    /// structure.
    pub fn screen(&self, effect: &str) -> Result<Screened, StructureError> {
        let mut screened = self.unscreened(effect)?;
        let own = screened.effect.declaration().name;
        let threshold = (screened.effect.threshold())
            .and_then(|name| screened.model.index(&format!("{own}.{name}")))
            .map(|index| &screened.model.parameters()[index].declaration);
        let voltages = threshold.map_or_else(Vec::new, |p| thresholds(self.events, p));
        let (mut candidates, mut memories) = (Vec::new(), Vec::new());
        for (number, (_, base)) in self.origins.iter().enumerate() {
            let memory = base.as_ref().map(|base| {
                let step = self.step(number, &screened);
                let memory = Memory::new(&step);
                let found = Screening::new(&step, base, &memory).screen(&voltages);
                candidates.extend(found.into_iter().map(|c| (number, c)));
                memory
            });
            memories.push(memory);
        }
        // An origin from which even the best candidate leaves more than another leaves without any was
        // fitted to something else: what it gains says nothing.
        let nothing = (self.origins.iter())
            .filter_map(|(_, base)| Some(base.as_ref()?.left()))
            .fold(f64::INFINITY, f64::min);
        candidates.retain(|(number, c)| c.left <= nothing || self.is_unfitted(*number));
        candidates.sort_by(|a, b| {
            let gain = b.1.score.gain.total_cmp(&a.1.score.gain);
            (self.is_unfitted(a.0).cmp(&self.is_unfitted(b.0))).then(gain)
        });
        screened.candidates = candidates;
        screened.memories = memories;
        Ok(screened)
    }

    fn unscreened(&self, effect: &str) -> Result<Screened, StructureError> {
        let extended = self.structure.with(effect)?;
        let not_there = || StructureError::NotThere {
            name: effect.to_owned(),
        };
        Ok(Screened {
            effect: effects::find(effect.trim()).ok_or_else(not_there)?,
            model: ComposedModel::new(&extended),
            candidates: Vec::new(),
            memories: Vec::new(),
        })
    }

    /// Refits with the effect, coarsely and from its best candidates; the best is kept, for [`refine`](super::refine).
    /// `None` where no start could be simulated, no candidate makes it visible, or none wants it with the
    /// sign it can have. It is given up where the weighted squares `wanted` are out of reach; near the events that is
    /// known of all starts once it is known of the first.
    #[must_use]
    pub fn refit(&self, screened: &Screened, wanted: f64) -> Option<ComposedFit> {
        let options = &self.options.wanting(wanted);
        let promising = screened.candidates.iter().filter(|(_, c)| promises(c));
        let mut promising: Vec<(usize, Candidate)> = promising.cloned().collect();
        promising.sort_by(|a, b| a.1.left.total_cmp(&b.1.left));
        // Small steps that come often stand in for large ones that come seldom: each size has a start.
        let mut seen: Vec<(usize, f64)> = Vec::new();
        promising.retain(|(number, candidate)| {
            candidate.size.is_none_or(|size| {
                let new = !seen.contains(&(*number, size));
                seen.push((*number, size));
                new
            })
        });
        let staged = match self.starts(screened, promising, wanted, options) {
            Starts::Several(staged) => staged,
            Starts::OutOfReach(fit) => return fit.map(|fit| *fit),
        };
        let fits = self.near(screened, staged).into_iter();
        let fits = fits.filter_map(|start| {
            let step = self.step(start.origin, screened);
            let whole = start.whole;
            let fit = whole.or_else(|| step.fit(&start.parameters, &step.all(), options))?;
            // What both lead to is no better for having begun farther away.
            let handicap = if self.is_unfitted(start.origin) {
                HANDICAP
            } else {
                1.0
            };
            Some((handicap * evidence(&fit), step, fit))
        });
        let best = fits.min_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, step, fit)| {
            if fit.given_up {
                fit
            } else {
                step.taken_for_another(fit)
            }
        })
    }

    /// Where refits start: from the best candidates, the effect fitted alone.
    fn starts(
        &self,
        screened: &Screened,
        promising: Vec<(usize, Candidate)>,
        wanted: f64,
        options: &ComposedFitOptions,
    ) -> Starts {
        let mut staged: Vec<Start> = Vec::new();
        let sizes = screened.effect.screened_at().len();
        let unfitted = self.origins.len() - self.fitted;
        let starts = STARTS.max(sizes) + unfitted.div_ceil(2);
        for (number, candidate) in distinct(promising, starts) {
            let known = screened.memories.get(number).and_then(Option::as_ref);
            let (Some(base), Some(memory)) = (&self.origins[number].1, known) else {
                continue;
            };
            let step = self.step(number, screened);
            let candidate = Screening::new(&step, base, memory).polish(candidate);
            let from = step.start(&candidate, base);
            let Some(fit) = from.and_then(|from| step.effect_alone(&from)) else {
                continue;
            };
            let left = fit.squares.iter().sum::<f64>();
            let same = |known: &Start| {
                known.origin == number && (known.left - left).abs() < SAME_LEFT * left
            };
            if staged.iter().any(same) {
                continue;
            }
            let mut whole = None;
            if staged.is_empty() && wanted.is_finite() {
                let beyond = OUT_OF_QUESTION * wanted;
                if left > beyond && candidate.left > beyond {
                    return Starts::OutOfReach(step.given_up_at(&fit.parameters).map(Box::new));
                }
                if fit.chi_square_per_row() < ROUGH_ABOVE {
                    whole = step.fit(&fit.parameters, &step.all(), options);
                }
            }
            if let Some(given_up) = whole.take_if(|fit| fit.given_up) {
                return Starts::OutOfReach(Some(Box::new(given_up)));
            }
            staged.push(Start {
                origin: number,
                left,
                parameters: fit.parameters,
                whole,
            });
        }
        Starts::Several(staged)
    }

    /// The starts that lead anywhere, nearest first: far from the events the noise alone tells which do.
    fn near(&self, screened: &Screened, mut staged: Vec<Start>) -> Vec<Start> {
        let least = |starts: &[Start], unfitted: bool| {
            let of_kind = starts
                .iter()
                .filter(|s| !unfitted || self.is_unfitted(s.origin));
            of_kind.map(|s| s.left).fold(f64::INFINITY, f64::min)
        };
        // Ordinary loads have not yet followed.
        let (alone, unfitted) = (least(&staged, false), least(&staged, true));
        staged.retain(|s| {
            if self.is_unfitted(s.origin) {
                s.left <= UNFITTED_LEFT_MAX * unfitted
            } else {
                s.left <= STAGED_LEFT_MAX * alone
            }
        });
        let near = staged.into_iter().filter_map(|start| {
            let step = self.step(start.origin, screened);
            let (parameters, left) = step.approached(&start.parameters)?;
            Some(Start {
                left,
                parameters,
                ..start
            })
        });
        let mut near: Vec<Start> = near.collect();
        near.sort_by(|a, b| a.left.total_cmp(&b.left));
        if near.first().is_some_and(|start| start.left > ENDED_ABOVE) {
            near.truncate(ENDED_MAX);
        }
        near
    }

    /// A refit once more, from its end.
    pub(super) fn again(&self, screened: &Screened, fit: &ComposedFit) -> ComposedFit {
        let effect = screened.effect;
        refine_rows(&self.rows, fit, effect, &self.options, self.cancel)
    }

    /// The fit of the first origin with `effect` in its structure although no candidate promised
    /// anything: its shapes as they are typically, only its amplitudes free beside what was free before,
    /// fitted as `options` say. `None` when it cannot be simulated.
    pub(super) fn include(
        &self,
        screened: &Screened,
        options: &ComposedFitOptions,
    ) -> Option<ComposedFit> {
        let rows: Vec<EventRows<'_>> = self.events.iter().map(EventRows::new).collect();
        let step = Step {
            rows: &rows,
            options,
            ..self.step(0, screened)
        };
        step.include()
    }
}

/// What the fits of one structure from several starts are compared by: the posterior, and half of
/// `ln N` for every parameter that the data determine better than its prior. A relay that never operates
/// costs nothing, one that follows a single sample must be worth it.
fn evidence(fit: &ComposedFit) -> f64 {
    let determined = (fit.free.iter()).filter(|&&index| {
        let declared = &fit.model.parameters()[index].declaration;
        let scale = match declared.prior.scale {
            Scale::Linear => 1.0,
            Scale::Logarithmic => fit.parameters[index],
        };
        let error = fit.standard_error(index).map(|e| e / scale);
        error.is_none_or(|e| e < DETERMINED * declared.prior.deviation)
    });
    0.5 * fit.minus_twice_log_posterior()
        + 0.5 * (fit.rows.max(1) as f64).ln() * determined.count() as f64
}

impl Step<'_> {
    /// Where a refit starts: what the linear extrapolation proposes or a share of it, with or without
    /// what was fitted before following, whichever leaves least. What a strong extrapolation does to a
    /// motor near its pull-out is not linear; what only shows while everything else stays where it was
    /// is nothing to follow. `None` where none can be simulated.
    pub(super) fn start(&self, candidate: &Candidate, base: &Base) -> Option<Vec<f64>> {
        let score = &candidate.score;
        let at_rest = self.at(&score.shapes);
        let amplitudes = self.own(Parameter::is_amplitude);
        let before = self.free_before();
        let with = |share: f64, follows: bool| {
            let mut from = at_rest.clone();
            for (&index, value) in amplitudes.iter().zip(&score.amplitudes) {
                from[index] = self.started(index, share * value);
            }
            if let (Some(size), Some(&first)) = (candidate.size, amplitudes.first()) {
                // A staircase of smaller steps is another one.
                from[first] = self.started(first, size);
            }
            if follows {
                for (&index, by) in before.iter().zip(candidate.following.iter()) {
                    let declared = self.model.parameters()[index].declaration;
                    from[index] = (from[index] + share * by).clamp(declared.lower, declared.upper);
                }
            }
            from
        };
        let mut best: Option<(f64, Vec<f64>)> = None;
        for share in SHRINKING {
            for follows in [false, true] {
                let from = with(share, follows);
                let Some(left) = base.squares(self.rows, self.model, &from) else {
                    continue;
                };
                if best.as_ref().is_none_or(|(least, _)| left < *least) {
                    best = Some((left, from));
                }
            }
        }
        best.map(|(_, from)| from)
    }

    /// The effect fitted alone, what was fitted before held.
    fn effect_alone(&self, from: &[f64]) -> Option<ComposedFit> {
        let options = ComposedFitOptions {
            rounds_max: 1,
            local: local_solver::Options {
                evaluations_max: FIRST_STAGE_EVALUATIONS,
                ..self.options.local
            },
            ..*self.options
        };
        let own = self.own(Parameter::can_be_free);
        fit_rows(self.rows, self.model, from, &own, &options, self.cancel)
    }

    /// A refit that was given up before it began, at these parameters: what is free in it is what is in others, for
    /// criteria and for fits that go on from it. `None` when they cannot be simulated.
    fn given_up_at(&self, parameters: &[f64]) -> Option<ComposedFit> {
        let all = self.all();
        let (rows, model) = (self.rows, self.model);
        let fit = unfitted(rows, model, parameters, &all, self.options, self.cancel)?;
        Some(ComposedFit {
            given_up: true,
            ..fit
        })
    }

    /// What is free with the effect, as indices.
    fn all(&self) -> Vec<usize> {
        let mut all = self.free_before();
        all.extend(self.all_new());
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Where the noise alone leads from a start, and what is left there; the start where it is near.
    fn approached(&self, from: &[f64]) -> Option<(Vec<f64>, f64)> {
        let free = self.all();
        approached(
            self.rows,
            self.model,
            from,
            &free,
            self.options,
            self.cancel,
        )
    }

    fn include(&self) -> Option<ComposedFit> {
        let mut from = self.neutral();
        let amplitudes = self.own(Parameter::is_amplitude);
        for &index in &amplitudes {
            from[index] = self.started(index, 0.0);
        }
        let mut free = self.free_before();
        free.extend(amplitudes);
        free.sort_unstable();
        self.fit(&from, &free, self.options)
    }

    /// Goes over to what the effect is mistaken for as long as that is better.
    pub(super) fn taken_for_another(&self, fit: ComposedFit) -> ComposedFit {
        let own = self.own(|_| true);
        let mut best = fit;
        loop {
            let values: Vec<f64> = own.iter().map(|&index| best.parameters[index]).collect();
            let others = self.effect.mistaken_for(&values).into_iter();
            let begun = others.filter_map(|values| {
                let mut from = best.parameters.clone();
                for (&index, value) in own.iter().zip(values) {
                    let declared = &self.model.parameters()[index].declaration;
                    from[index] = value.clamp(declared.lower, declared.upper);
                }
                self.fit(&from, &self.all(), self.options)
            });
            let least = begun.min_by(|a, b| evidence(a).total_cmp(&evidence(b)));
            match least.filter(|other| evidence(other) < evidence(&best) - MISTAKEN_GAIN) {
                Some(other) => best = other,
                None => return best,
            }
        }
    }

    fn fit(
        &self,
        from: &[f64],
        free: &[usize],
        options: &ComposedFitOptions,
    ) -> Option<ComposedFit> {
        fit_rows(self.rows, self.model, from, free, options, self.cancel)
    }

    /// Parameters of the effect, shared ones included.
    fn all_new(&self) -> Vec<usize> {
        let known = |name: &str| self.origin.model.index(name).is_some();
        let all = self.model.parameters().iter().enumerate();
        all.filter(|(_, p)| !known(&p.name) && p.declaration.can_be_free())
            .map(|(index, _)| index)
            .collect()
    }

    /// An amplitude to start from: away from its neutral value, where the effect has no slope in
    /// its shapes.
    fn started(&self, index: usize, value: f64) -> f64 {
        let declared = self.model.parameters()[index].declaration;
        let least = match declared.role {
            Role::OneSidedAmplitude { meaningful } | Role::TwoSidedAmplitude { meaningful } => {
                0.5 * meaningful
            }
            Role::Shape | Role::Count | Role::Shared | Role::Base => 0.0,
        };
        let away = if value.abs() < least {
            least.copysign(value)
        } else {
            value
        };
        (declared.neutral + away).clamp(declared.lower, declared.upper)
    }
}
