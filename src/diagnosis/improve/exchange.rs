//! What earlier steps added gives way to what resembles it.

use super::Stairs;
use crate::{
    diagnosis::{addable::addable, anew::Stop},
    identification::{
        IdentificationError,
        composed::{Baseline, ComposedFit, Ground, refine},
    },
    load_model::effects,
};

/// One gives way to another where the criterion is lower by this much ...
const EXCHANGE_DELTA_BIC: f64 = 10.0;
/// ... and by this share of the weighted squares that are left, which are not independent from sample to sample.
const EXCHANGE_SHARE_OF_LEFT: f64 = 0.03;

impl Stairs<'_> {
    /// Effects of earlier steps give way to what resembles them, where that follows the events better beside
    /// the newest one: before that was there each had to make up for it. A step of its own each.
    pub(super) fn exchange(
        &mut self,
        newest: &str,
        without: &[(String, Baseline)],
    ) -> Result<(), Stop> {
        for (old, fewer) in without {
            let Some((new, next)) = self.better_than(old, fewer)? else {
                continue;
            };
            let step = self.step(
                &next,
                Some(new.clone()),
                vec![old.clone()],
                format!("beside {newest}, {new} follows the events better than {old}"),
            )?;
            if self.worse(&step) {
                continue;
            }
            self.steps.push(step);
            self.at = next;
            // What is known of the other structures was of the one that is no more.
            return Ok(());
        }
        Ok(())
    }

    /// The best of what resembles `old` in its place; none where `old` is.
    fn better_than(
        &self,
        old: &str,
        fewer: &Baseline,
    ) -> Result<Option<(String, Baseline)>, IdentificationError> {
        let (case, options) = (self.case, &self.case.composed);
        let cancel = case.watcher.cancel;
        let values = fewer.with_values_of(&case.judged, &self.at.all, options, cancel);
        // What `old` took of the deep dips may have led everything else astray: from where the mild ones have it, too.
        let origins: Vec<&ComposedFit> = values.iter().chain(fewer.origins()).collect();
        let ground = Ground::new(&case.judged, &fewer.structure, &origins, options, cancel);
        let left: f64 = self.at.all.squares.iter().sum();
        let mut best: Option<(f64, &str, ComposedFit)> = None;
        for new in addable(&fewer.structure, case) {
            if new == old || !alike(old, new) {
                continue;
            }
            case.watcher.says(format!("trying {new} for {old}"), 0, 1);
            let sketched = fewer.sketched(&ground, &ground.screen(new)?, left);
            case.watcher.check()?;
            let Some(fit) = sketched else { continue };
            let criterion = fit.criterion();
            if best.as_ref().is_none_or(|(least, _, _)| criterion < *least) {
                best = Some((criterion, new, fit));
            }
        }
        let Some((_, new, fit)) = best else {
            return Ok(None);
        };
        let fit = refine(&case.judged, fit, new, options, cancel);
        case.watcher.check()?;
        let told = EXCHANGE_DELTA_BIC.max(EXCHANGE_SHARE_OF_LEFT * left);
        if fit.criterion() > self.at.all.criterion() - told {
            return Ok(None);
        }
        let next = fewer.completed(&case.judged, fit, new, options, cancel)?;
        Ok(Some((new.to_owned(), next)))
    }
}

/// Whether one of two effects is declared to resemble the other.
fn alike(one: &str, other: &str) -> bool {
    let pair = effects::find(one).zip(effects::find(other));
    pair.is_some_and(|(one, other)| one.declaration().is_like(other.declaration()))
}
