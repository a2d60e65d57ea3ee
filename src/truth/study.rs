//! Many sites quickly, in memory, for tests and studies.

use super::{
    Effect, HiddenEffect, IntegratorOptions, Random, SiteOptions, SyntheticSite, TruthError,
    generate,
};
use crate::measurement::Site;

/// What the sites of a study have in common.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyShape {
    /// Effects hidden in each site, with parameters of its own; none for plain sites.
    pub effects: Vec<Effect>,
    /// Whether the events show the effects.
    pub excited: bool,
    /// Number of events, 1 to 99.
    pub events: usize,
    /// Length of a window, s; effects that are slow make it longer.
    pub duration_s: f64,
    /// Reports per second.
    pub rate_fps: f64,
    /// Nominal frequency, Hz.
    pub nominal_hz: f64,
    /// Relative noise of the phasors.
    pub noise: f64,
    /// Whether some events hold bad samples.
    pub bad_samples: bool,
    /// Stator resistance of half of the sites, pu of the motors' base: loads have it, and models
    /// of the third order do not.
    pub stator_resistance: f64,
    /// Standard deviation of the composition from event to event, relative.
    pub composition_spread: f64,
}

impl Default for StudyShape {
    /// Ten events of ten seconds, 60 frames/s, 0.1 % noise, as in independent sites.
    fn default() -> Self {
        Self {
            effects: Vec::new(),
            excited: true,
            events: 10,
            duration_s: 10.0,
            rate_fps: 60.0,
            nominal_hz: 60.0,
            noise: 1e-3,
            bad_samples: true,
            stator_resistance: 0.012,
            composition_spread: 0.02,
        }
    }
}

/// First part of the random numbers that sites of a study use for their seeds.
const STUDY_PARTS: u64 = 3_000_000;
/// Looser than a site on disk: the error stays far below the noise.
const STUDY_TOLERANCE: f64 = 1e-7;

/// Straight lines over 4 ms where nothing is quick: 2e-5 pu at 0.5 Hz from nominal.
const STUDY_SPACING: u32 = 4;

/// Site `number` of the study that `seed` begins: another load, another grid, other events, other
/// parameters of the same effects. The same arguments give the same bytes.
///
/// # Errors
///
/// As [`generate`].
pub fn study_site(seed: u64, number: u64, shape: &StudyShape) -> Result<SyntheticSite, TruthError> {
    let mut random = Random::for_part(seed, STUDY_PARTS + number);
    let own_seed = random.bits();
    let site = Site {
        name: format!("study-{seed}-{number}"),
        s_base_mva: 200.0,
        v_base_kv: 23.0,
        nominal_hz: shape.nominal_hz,
    };
    let mut options = SiteOptions {
        events: shape.events,
        duration_s: shape.duration_s,
        rate_fps: shape.rate_fps,
        noise: shape.noise,
        bad_samples: shape.bad_samples,
        excited: shape.excited,
        composition_spread: shape.composition_spread,
        integrator: IntegratorOptions {
            tolerance: STUDY_TOLERANCE,
            spacing_max: STUDY_SPACING,
            ..IntegratorOptions::default()
        },
        ..SiteOptions::varied(site, own_seed)
    };
    if random.uniform() < 0.5 {
        options.motor.stator_resistance = shape.stator_resistance;
    }
    let effects = shape.effects.iter();
    let hidden = effects.map(|effect| HiddenEffect::drawn(*effect, own_seed));
    let options = options.hiding(hidden.collect()).leaving_room();
    generate(&options, &mut |_| ())
}

/// The sites of the study that `seed` begins, one after the other, without end.
pub fn study_sites(
    seed: u64,
    shape: &StudyShape,
) -> impl Iterator<Item = Result<SyntheticSite, TruthError>> + '_ {
    (0..).map(move |number| study_site(seed, number, shape))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sites_of_a_study_differ_from_each_other_and_are_the_same_again() {
        let shape = StudyShape {
            events: 1,
            duration_s: 4.0,
            noise: 0.0,
            bad_samples: false,
            effects: vec![Effect::SelfDisconnection],
            ..StudyShape::default()
        };
        let sites: Vec<_> = study_sites(5, &shape).take(3).map(Result::unwrap).collect();
        let again = study_site(5, 2, &shape).unwrap();
        let powers = |site: &SyntheticSite| -> Vec<_> {
            let samples = site.records[0].samples.iter();
            samples.map(|s| s.active_pu.to_bits()).collect()
        };
        assert_eq!(powers(&sites[2]), powers(&again));
        assert_eq!(sites[2].truth, again.truth);
        assert_ne!(sites[0].options.motor, sites[1].options.motor);
        assert_ne!(sites[0].options.effects, sites[1].options.effects);
    }
}
