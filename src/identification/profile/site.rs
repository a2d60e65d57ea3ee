//! The profile of a site: fit, then follow.

use super::{Profile, ProfileInput, ProfileOptions, UnknownQuantity, profile};
use crate::{
    disturbance::Window,
    identification::{IdentificationError, IdentificationOptions, site_fit::fit_site},
    load_model::LoadBase,
    measurement::Site,
};

/// Profiles of quantities of one fit.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteProfile {
    /// Site.
    pub site: String,
    /// Parts of the model.
    pub structure: Vec<String>,
    /// Events the fit used.
    pub events: Vec<String>,
    /// Events that could not be used, with the reason.
    pub refused: Vec<(String, String)>,
    /// The profiles, in the order asked for.
    pub profiles: Vec<Profile>,
}

/// Why there is no profile.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ProfileError {
    /// The fit.
    #[error(transparent)]
    Identification(#[from] IdentificationError),
    /// The quantity.
    #[error(transparent)]
    Unknown(#[from] UnknownQuantity),
}

/// Fits a site as [`identify`](crate::identification::identify()) does and follows the profile of each
/// of the quantities `names`. `progress` is told the quantity and the number of its points.
///
/// # Errors
///
/// [`ProfileError`]; a name that is not known is found before anything is fitted.
pub fn profile_site(
    site: &Site,
    windows: &[Window],
    structure: &[String],
    names: &[String],
    (options, follow): (&IdentificationOptions, &ProfileOptions),
    progress: &(dyn Fn(&str, usize) + Sync),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<SiteProfile, ProfileError> {
    for name in names {
        super::target::Target::named(name, &options.problem)?;
    }
    let fitted = fit_site(windows, structure, options, cancel)?;
    let best = fitted.best()?;
    let precision = fitted.precision(best);
    let operating_point = &fitted.operating_point;
    let input = ProfileInput {
        solution: best,
        precision: &precision,
        events: &fitted.weighted,
        problem: &fitted.problem,
        base: LoadBase {
            v0_pu: operating_point.v0_pu,
            p0_pu: operating_point.p0_pu,
            q0_pu: operating_point.q0_pu,
            nominal_hz: site.nominal_hz,
        },
    };
    let mut profiles = Vec::with_capacity(names.len());
    for name in names {
        let tell = |points: usize| progress(name, points);
        profiles.push(profile(&input, name, follow, &tell, cancel)?);
        if cancel() {
            return Err(IdentificationError::Cancelled.into());
        }
    }
    Ok(SiteProfile {
        site: site.name.clone(),
        structure: fitted.structure.names(),
        events: fitted.measured.iter().map(|e| e.id.clone()).collect(),
        refused: fitted.refused.clone(),
        profiles,
    })
}
