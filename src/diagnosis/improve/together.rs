//! Steps that are taken together or not at all.

use super::{Higher, Seen, Stairs, claimed};
use crate::{
    diagnosis::{anew::Stop, outcome::Diagnosis, round::Second, worse::is_worse},
    identification::composed::{Baseline, ComposedFit},
};

impl Stairs<'_> {
    /// Adds an effect after the companions beside which it was found, where it is worth nothing by itself. Whether that
    /// lowers the criterion; if not, all stays as it was.
    pub(super) fn accompanied(
        &mut self,
        with: &Baseline,
        effect: &str,
        fit: Option<&ComposedFit>,
        found: &Diagnosis,
    ) -> Result<bool, Stop> {
        let Some(fit) = fit else {
            return Ok(false);
        };
        let before = (self.at.clone(), self.steps.clone());
        let mut names = with.structure.names();
        names.retain(|name| !before.0.structure.contains(name) && name != effect);
        let beside = format!("{effect} is found beside it, and worth nothing without it");
        let companions = names.iter().map(|name| (name.as_str(), &with.all, &beside));
        let effect = (effect, fit, &found.summary);
        for (name, fit, reason) in companions.chain([effect]) {
            let Ok(higher) = self.higher(name, Some(fit), reason)? else {
                (self.at, self.steps) = before;
                return Ok(false);
            };
            self.take(name, higher)?;
        }
        if self.at.all.criterion() >= before.0.all.criterion() {
            (self.at, self.steps) = before;
            return Ok(false);
        }
        self.diagnoses.push(found.clone());
        Ok(true)
    }

    /// A step that alone follows events that are not fitted worse may be the first of two: it is taken where a second one
    /// leads to errors no worse than those without either: the one that was found with it, or what is found beside it.
    /// Whether it was.
    pub(super) fn beyond(
        &mut self,
        first: Higher,
        found: &Diagnosis,
        known: Option<&Second>,
    ) -> Result<bool, Stop> {
        let before = (self.at.clone(), self.steps.clone());
        let no_worse = |both: &Higher| {
            let start = before.1.last();
            start.is_none_or(|start| !is_worse(&start.errors, &both.step.errors))
        };
        self.at = first.next;
        self.steps.push(first.step);
        if let Some(Second { name, fit }) = known
            && self.at.structure.with(name).is_ok()
            && let Ok(both) = self.higher(name, Some(fit), &found.summary)?
            && no_worse(&both)
        {
            self.diagnoses.push(found.clone());
            self.take(name, both)?;
            return Ok(true);
        }
        if let Some((second, both)) = self.second_step()?
            && no_worse(&both)
            && let Some(effect) = claimed(&second)
        {
            self.diagnoses.extend([found.clone(), second]);
            self.take(&effect, both)?;
            return Ok(true);
        }
        (self.at, self.steps) = before;
        Ok(false)
    }

    /// What is found beside a step that is on trial, and the step that adds it.
    fn second_step(&mut self) -> Result<Option<(Diagnosis, Higher)>, Stop> {
        let seen = match self.round() {
            Ok(seen) => seen,
            Err(Stop::Failed(error)) if error.is_of_the_model() => return Ok(None),
            Err(error) => return Err(error),
        };
        let Seen {
            diagnosis: second,
            fit,
            ..
        } = seen;
        let Some(effect) = claimed(&second) else {
            return Ok(None);
        };
        let both = self.higher(&effect, fit.as_ref(), &second.summary)?;
        Ok(both.ok().map(|both| (second, both)))
    }
}
