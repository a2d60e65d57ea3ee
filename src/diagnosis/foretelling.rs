//! What fits say of events that they have not seen.

use super::{
    case::Case,
    event_sets::{in_turn, not_foretold},
    evidence::GateEvidence,
};
use crate::identification::{
    IdentificationError,
    composed::{self, ComposedFit, ComposedFitOptions, RISE_OF_LEFT, RelaySetting, SettingOf},
    intake::PreparedEvent,
    relay_edges::{has_dip, lowest_pu},
};

/// Of the events that an effect is asked to foretell at most this share may be left out.
const OPEN_SHARE: f64 = 0.25;

/// As [`RISE_OF_LEFT`], of delays of a relay whose voltage the events leave open: with it, how long a dip has to last is
/// open, too.
const RISE_OF_DELAYS: f64 = 0.03;

/// The events that are `open`, where they are few of those foretold: an effect that foretells many of them badly only
/// bends to what it was fitted to.
fn few(mut open: Vec<bool>, foretold: &[Option<f64>]) -> Vec<bool> {
    let count = open.iter().filter(|open| **open).count();
    let asked = foretold.iter().flatten().count();
    if count as f64 > OPEN_SHARE * asked as f64 {
        open.fill(false);
    }
    open
}

/// Whether a fit leaves at most two standard errors or this share more of its events than another one of the same.
fn as_near(fit: &ComposedFit, other: &ComposedFit, share: f64) -> bool {
    let [left, least] = [fit, other].map(|fit| fit.squares.iter().sum::<f64>());
    composed::follows_as_well(left, least, share)
}

impl Case<'_> {
    /// Whether there are events to hold a claim against.
    pub(super) fn has_gate(&self) -> bool {
        self.gates.contains(&true)
    }

    /// The model of `fit` fitted again to the fitted events alone, as what decides must not have
    /// been fitted. `None` when it cannot be simulated there.
    fn without_gate(&self, fit: &ComposedFit, options: &ComposedFitOptions) -> Option<ComposedFit> {
        self.unseen_by(&self.part(false), fit, options)
    }

    /// The same of these events alone, but for what they leave open: frequencies at which something switches are those of
    /// `fit` where the events are followed as well with them, and so are voltages ([`Self::open_levels_held`]).
    fn unseen_by(
        &self,
        events: &[PreparedEvent],
        fit: &ComposedFit,
        options: &ComposedFitOptions,
    ) -> Option<ComposedFit> {
        let own = self.fitted_to(events, fit, options)?;
        let held = composed::with_frequency_levels_of(&own, fit);
        let held = held.and_then(|held| self.fitted_to(events, &held, options));
        let own = held
            .filter(|held| as_near(held, &own, RISE_OF_LEFT))
            .unwrap_or(own);
        let held = self.open_levels_held(events, &own, fit, options);
        Some(held.unwrap_or(own))
    }

    /// `own`, a fit to these events, fitted again with the voltages and delays of its relays that the events leave open as they
    /// are in `fit`: where one lies between a dip that operated a relay and one that did not, by depth or by how long it
    /// lasts, an event between them cannot be foretold, and says nothing against the model. So with all settings of such a
    /// relay, where the events are followed as well with those of `fit`. Of a relay that counts dips only events tell that
    /// have as many. `None` where none is open.
    fn open_levels_held(
        &self,
        events: &[PreparedEvent],
        own: &ComposedFit,
        fit: &ComposedFit,
        options: &ComposedFitOptions,
    ) -> Option<ComposedFit> {
        let open = |setting: &RelaySetting| {
            let [one, other] = setting.values;
            let between = |value: f64| one.min(other) < value && value < one.max(other);
            let shows = |e: &PreparedEvent| match setting.of {
                SettingOf::Level => between(lowest_pu(e)),
                SettingOf::PickUp { level_pu } => between(e.longest_below_s(level_pu)),
            };
            !events.iter().any(|e| has_dip(e, setting.dip) && shows(e))
        };
        let starts = composed::with_levels_of(own, fit, open)?;
        let [levels, settings] = starts.map(|start| self.fitted_to(events, &start, options));
        let levels = levels?;
        let settings = settings.filter(|settings| as_near(settings, &levels, RISE_OF_DELAYS));
        Some(settings.unwrap_or(levels))
    }

    /// The model of `fit` fitted again to these events, but for what events only bracket.
    fn fitted_to(
        &self,
        events: &[PreparedEvent],
        fit: &ComposedFit,
        options: &ComposedFitOptions,
    ) -> Option<ComposedFit> {
        let bracketed = |index: &usize| composed::is_bracketed(&fit.model.parameters()[*index]);
        let free: Vec<usize> = (fit.free.iter().copied())
            .filter(|index| !bracketed(index))
            .collect();
        composed::fit(
            events,
            &fit.model,
            &fit.parameters,
            &free,
            options,
            self.watcher.cancel,
        )
    }

    /// The model of `fit` as it is quoted and published: with what is assumed to vary between events, however closely they are
    /// looked at.
    pub(super) fn narrowed(&self, fit: &ComposedFit) -> ComposedFit {
        if let Some(known) = self.narrowings.known(fit, None) {
            return known;
        }
        let options = &self.options.composed;
        let found = composed::narrowed(&self.judged, fit, options, self.watcher.cancel);
        self.remembered(fit, None, found)
    }

    /// What a fit was narrowed to, remembered unless it was cut short.
    fn remembered(
        &self,
        fit: &ComposedFit,
        gates: Option<&[bool]>,
        found: ComposedFit,
    ) -> ComposedFit {
        if !(self.watcher.cancel)() {
            self.narrowings.remember(fit, gates, &found);
        }
        found
    }

    /// The same without the gate. Whether a voltage is open is asked once more of where the narrowing took it.
    pub(super) fn narrowed_without_gate(
        &self,
        fit: &ComposedFit,
    ) -> Result<ComposedFit, IdentificationError> {
        let gates = Some(self.gates.as_slice());
        if let Some(known) = self.narrowings.known(fit, gates) {
            return Ok(known);
        }
        let options = &self.options.composed;
        let fitted = self.part(false);
        let narrowed =
            |own: ComposedFit| composed::narrowed(&fitted, &own, options, self.watcher.cancel);
        let own = narrowed((self.without_gate(fit, options)).ok_or_else(|| self.failed())?);
        let held = self.open_levels_held(&fitted, &own, fit, options);
        Ok(self.remembered(fit, gates, held.map_or(own, narrowed)))
    }

    /// Weighted squares per row of the gating events, which the fit that is judged has not seen (coarsely
    /// fitted: it begins where all events together led), composition of each event free to vary; infinite when
    /// they cannot be simulated. `None` without such events.
    pub(super) fn gate_misfit(&self, fit: &ComposedFit) -> Option<f64> {
        if !self.has_gate() {
            return None;
        }
        let gate = self.part(true);
        let scatter = &self.composed.scatter;
        let squares = self
            .without_gate(fit, &self.composed.coarse())
            .and_then(|fit| composed::squares(&gate, &fit.model, &fit.parameters, scatter));
        let rows: usize = gate.iter().map(PreparedEvent::rows).sum();
        Some(squares.map_or(f64::INFINITY, |s| {
            s.iter().sum::<f64>() / rows.max(1) as f64
        }))
    }

    /// Weighted squares per row of the events that others surround in depth ([`in_turn`]), each foretold by fits to others,
    /// without (`before`) and with (`after`) an effect. Without those that the effect follows but does not foretell
    /// ([`not_foretold`]): how is left open by the others, and they say nothing of it. `None` without a gate.
    pub(super) fn in_turn(
        &self,
        before: &ComposedFit,
        after: &ComposedFit,
    ) -> Option<GateEvidence> {
        if !self.has_gate() {
            return None;
        }
        let depths: Vec<f64> = self.judged.iter().map(|e| e.lowest_voltage).collect();
        let folds = in_turn(&self.gates, &depths);
        let [before, with] = [before, after].map(|fit| self.foretold_in_turn(fit, &folds));
        let open = few(not_foretold(&with, &self.per_row(after)), &with);
        let mut sums = [0.0; 3];
        for (event, (before, after)) in before.into_iter().zip(with).enumerate() {
            if let (Some(before), Some(after), false) = (before, after, open[event]) {
                let rows = self.judged[event].rows() as f64;
                sums = [
                    sums[0] + rows * before,
                    sums[1] + rows * after,
                    sums[2] + rows,
                ];
            }
        }
        (sums[2] > 0.0).then(|| GateEvidence {
            before: sums[0] / sums[2],
            after: sums[1] / sums[2],
        })
    }

    /// What the gating events add to the least misfit of the others, per row of theirs, without (`before`) and with
    /// (`after`) an effect that the others support by themselves; `None` where they do not, and without a gate.
    ///
    /// With the residuals `r` that a fit to the others leaves of the gating events, their covariance `Sigma`, their derivatives
    /// `J` by the parameters, and the covariance `C` of these, it is `r' (Sigma + J C J')^-1 r` to second order: what the
    /// others leave open of the parameters is not held against the effect.
    pub(super) fn joined(&self, before: &ComposedFit, after: &ComposedFit) -> Option<GateEvidence> {
        if !self.has_gate() {
            return None;
        }
        let others = self.part(false);
        let own = |fit| self.fitted_to(&others, fit, &self.composed);
        let (without, with) = (own(before)?, own(after)?);
        let is_supported =
            with.criterion() <= without.criterion() - self.options.claim.delta_bic_min;
        let rows: usize = self.part(true).iter().map(PreparedEvent::rows).sum();
        let added = |all: &ComposedFit, own: &ComposedFit| {
            2.0 * (all.objective - own.objective) / rows.max(1) as f64
        };
        is_supported.then(|| GateEvidence {
            before: added(before, &without),
            after: added(after, &with),
        })
    }

    /// Of each event of some fold what a fit to those outside the fold leaves of it, per row.
    fn foretold_in_turn(&self, fit: &ComposedFit, folds: &[Vec<bool>]) -> Vec<Option<f64>> {
        let mut all = vec![None; self.judged.len()];
        for held in folds.iter().filter(|held| held.contains(&true)) {
            let others: Vec<PreparedEvent> = (self.judged.iter().zip(held))
                .filter(|(_, held)| !**held)
                .map(|(event, _)| event.clone())
                .collect();
            let own = self.unseen_by(&others, fit, &self.composed.coarse());
            let own = match own {
                Some(own) => self.foretold(&own, held),
                None => held
                    .iter()
                    .map(|held| held.then_some(f64::INFINITY))
                    .collect(),
            };
            for (known, own) in all.iter_mut().zip(own) {
                *known = known.or(own);
            }
        }
        all
    }

    /// Weighted squares per row that a fit to all judged events leaves of each.
    pub(super) fn per_row(&self, fit: &ComposedFit) -> Vec<f64> {
        let rows = self.judged.iter().map(PreparedEvent::rows);
        let squares = fit.squares.iter().zip(rows);
        squares
            .map(|(squares, rows)| squares / rows.max(1) as f64)
            .collect()
    }

    /// Weighted squares per row that a fit leaves of each judged event that was `held` out of it, infinite where it has no
    /// response; none of the others.
    pub(super) fn foretold(&self, fit: &ComposedFit, held: &[bool]) -> Vec<Option<f64>> {
        let scatter = &self.composed.scatter;
        let of = |event: &PreparedEvent| {
            let one = std::slice::from_ref(event);
            let squares = composed::squares(one, &fit.model, &fit.parameters, scatter);
            let own = squares.and_then(|s| s.first().copied());
            own.map_or(f64::INFINITY, |own| own / event.rows().max(1) as f64)
        };
        let both = self.judged.iter().zip(held);
        both.map(|(event, held)| held.then(|| of(event))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::few;

    #[test]
    fn an_effect_that_foretells_many_events_badly_is_excused_from_none() {
        let foretold = [Some(1.0), Some(1.0), Some(90.0), Some(1.0), None];
        let open = |of: [bool; 5]| few(of.to_vec(), &foretold);
        let one = [false, false, true, false, false];
        assert_eq!(open(one), one);
        assert_eq!(open([false, true, true, false, false]), [false; 5]);
    }
}
