//! What an effect leaves when it is missing: ZIP and motor, refitted to the load with the effect in
//! dips of three depths, subtracted from that load.

mod drawing;
mod events;

use nalgebra::{DMatrix, DVector};

use super::figure::ReportError;
use crate::{
    identification::RobustLoss,
    load_model::{
        ComposedModel, SimulationError, Structure,
        composed::{BASE_PARAMETERS, ModelParameter},
        effect::{Declaration, Declared, Needs, Role},
        effects::find,
        structure::StructureError,
    },
};
use events::Dip;

const REFIT_STEPS: usize = 40;
/// Residuals beyond so many deviations (1 % of P0 where the voltage is still) have no more influence: the refit follows what
/// ZIP and motor can do, as a robust fit does.
const BOUNDED_FROM: f64 = 10.0;
/// A step that takes less than this share off the misfit is the last.
const SHARE_LEAST: f64 = 1e-9;

/// What is shown with another value than the typical one: what would happen after the window, thresholds that are the
/// depth of a dip, and a share small enough that the refitted motor does not stall in its place.
const SHOWN_WITH: [(&str, f64); 5] = [
    ("discharge_lighting.restrike_s", 1.5),
    ("motor_undervoltage_trip.return_time_s", 0.3),
    ("motor_undervoltage_trip.trip_voltage", 0.65),
    ("self_disconnection.voltage", 0.65),
    ("single_phase_ac_stall.share", 0.05),
];

/// Why there is no picture of an effect.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// No effect of that name.
    #[error(transparent)]
    Structure(#[from] StructureError),
    /// The load cannot be simulated.
    #[error("no picture of `{effect}`")]
    Simulation {
        /// The effect.
        effect: String,
        /// Why.
        source: SimulationError,
    },
    /// The figure could not be drawn.
    #[error(transparent)]
    Drawing(#[from] ReportError),
}

/// The residual of P and Q, in percent of P0, that `effect` with its typical parameters leaves in dips of
/// 10, 30 and 50 % when ZIP and motor are refitted to all three without it, as an SVG file. Weighted as intake does, without
/// noise. Where the effect needs a voltage above V0, the voltage overshoots after the dips.
///
/// # Errors
///
/// [`PictureError`].
pub fn effect_residuals(effect: &str) -> Result<String, PictureError> {
    let plain = Structure::zip_im();
    let structure = plain.with(effect)?;
    let declaration = find(effect).map(Declared::declaration);
    let needs = declaration.map(|d| d.needs);
    let study = Study::new(
        ComposedModel::new(&plain),
        &ComposedModel::new(&structure),
        needs.as_ref(),
    )
    .and_then(|study| study.residuals().map(|residuals| (study, residuals)));
    let (study, residuals) = study.map_err(|source| PictureError::Simulation {
        effect: effect.to_owned(),
        source,
    })?;
    let with_frequency = declaration.is_some_and(follows_frequency);
    let mut figure = drawing::figure(effect, &study.dips, &residuals, with_frequency);
    let stated = SHOWN_WITH.iter().filter_map(|(name, value)| {
        let (owner, own) = name.split_once('.')?;
        (owner == effect).then(|| format!("{own} = {value}"))
    });
    let stated: Vec<String> = stated.collect();
    if !stated.is_empty() {
        let axis = figure.horizontal_title;
        figure.horizontal_title = format!("{axis}; shown with {}", stated.join(" and "));
    }
    let drawn = figure.document()?;
    // On a dark page the picture keeps its own ground.
    let ground = "><rect width=\"100%\" height=\"100%\" fill=\"#FFFFFF\"/>";
    Ok(drawn.replacen('>', ground, 1))
}

struct Study {
    plain: ComposedModel,
    dips: Vec<Dip>,
}

impl Study {
    fn new(
        plain: ComposedModel,
        load: &ComposedModel,
        needs: Option<&Needs>,
    ) -> Result<Self, SimulationError> {
        let dips = Dip::all(load, &shown_parameters(load), needs)?;
        Ok(Self { plain, dips })
    }

    /// What is left of P and Q in each dip after the refit.
    fn residuals(&self) -> Result<Vec<[Vec<f64>; 2]>, SimulationError> {
        let mut parameters = self.plain.typical();
        let mut best = self.left(&parameters)?;
        for _ in 0..REFIT_STEPS {
            let Some(step) = self.step(&parameters)? else {
                break;
            };
            let before = self.misfit(&best);
            let shorter = [1.0, 0.5, 0.25, 0.1, 0.02].iter().find_map(|share| {
                let moved = self.moved(&parameters, &step, *share);
                let left = self.left(&moved).ok()?;
                (self.misfit(&left) < before).then_some((moved, left))
            });
            let Some((moved, left)) = shorter else { break };
            (parameters, best) = (moved, left);
            if self.misfit(&best) > before * (1.0 - SHARE_LEAST) {
                break;
            }
        }
        Ok(best)
    }

    fn left(&self, parameters: &[f64]) -> Result<Vec<[Vec<f64>; 2]>, SimulationError> {
        let of_dip = |dip: &Dip| {
            let model = dip.channels(&dip.simulate(&self.plain, parameters, &[])?);
            Ok([0, 1].map(|c: usize| {
                let pairs = dip.load[c].iter().zip(&model[c]);
                pairs.map(|(load, model)| load - model).collect()
            }))
        };
        self.dips.iter().map(of_dip).collect()
    }

    /// What the refit makes least: squares, of residuals beyond [`BOUNDED_FROM`] their tangent.
    fn misfit(&self, left: &[[Vec<f64>; 2]]) -> f64 {
        let pairs = self.dips.iter().zip(left);
        pairs
            .flat_map(|(dip, left)| [0, 1].map(|c: usize| (dip.deviations(c), &left[c])))
            .flat_map(|(deviation, left)| deviation.into_iter().zip(left))
            .map(|(deviation, left)| {
                let u = (left / deviation).abs();
                let bounded = u.min(BOUNDED_FROM);
                bounded * (2.0 * u - bounded)
            })
            .sum()
    }

    /// A step of the Gauss-Newton method; what would leave its bounds stays on them.
    fn step(&self, parameters: &[f64]) -> Result<Option<DVector<f64>>, SimulationError> {
        let wanted: Vec<usize> = (0..BASE_PARAMETERS).collect();
        let mut normal = DMatrix::zeros(BASE_PARAMETERS, BASE_PARAMETERS);
        let mut right = DVector::zeros(BASE_PARAMETERS);
        let loss = RobustLoss::Huber {
            tuning: BOUNDED_FROM,
        };
        for dip in &self.dips {
            let response = dip.simulate(&self.plain, parameters, &wanted)?;
            let model = dip.channels(&response);
            let slopes = [&response.active_derivatives, &response.reactive_derivatives];
            for c in 0..2 {
                for (k, deviation) in dip.deviations(c).into_iter().enumerate() {
                    let place = dip.samples[k];
                    let left = (dip.load[c][k] - model[c][k]) / deviation;
                    let root = loss.weight(left).sqrt();
                    let row = slopes[c]
                        .iter()
                        .map(|slope| root * slope[place] / deviation);
                    let row = DVector::from_iterator(BASE_PARAMETERS, row);
                    right += &row * (root * left);
                    normal += &row * row.transpose();
                }
            }
        }
        for i in 0..BASE_PARAMETERS {
            normal[(i, i)] *= 1.0 + 1e-6;
        }
        let leaves = |step: &DVector<f64>, i: usize| {
            let bounds = &self.plain.parameters()[i].declaration;
            (parameters[i] <= bounds.lower && step[i] < 0.0)
                || (parameters[i] >= bounds.upper && step[i] > 0.0)
        };
        // Each round holds at least one more parameter.
        for _ in 0..=BASE_PARAMETERS {
            let Some(factor) = normal.clone().cholesky() else {
                return Ok(None);
            };
            let step = factor.solve(&right);
            let outward: Vec<usize> = (0..BASE_PARAMETERS).filter(|i| leaves(&step, *i)).collect();
            if outward.is_empty() {
                return Ok(Some(step));
            }
            for i in outward {
                normal.row_mut(i).fill(0.0);
                normal.column_mut(i).fill(0.0);
                normal[(i, i)] = 1.0;
                right[i] = 0.0;
            }
        }
        Ok(None)
    }

    /// The parameters after a share of a step, within their bounds.
    fn moved(&self, parameters: &[f64], step: &DVector<f64>, share: f64) -> Vec<f64> {
        let declared = self.plain.parameters().iter();
        let pairs = parameters.iter().zip(step.iter()).zip(declared);
        let moved = pairs.map(|((value, step), p)| {
            (value + share * step).clamp(p.declaration.lower, p.declaration.upper)
        });
        // What the refit holds stays as it is.
        moved
            .chain(parameters.iter().skip(step.len()).copied())
            .collect()
    }
}

/// Whether an effect shows with the frequency, or is taken for one that does.
fn follows_frequency(declaration: &Declaration) -> bool {
    let like = declaration.resembles.iter().filter_map(|name| find(name));
    declaration.needs.frequency || like.into_iter().any(|e| e.declaration().needs.frequency)
}

/// Typical values, or those of [`SHOWN_WITH`]; an amplitude of either sign that is typically absent is three times as large
/// as what is worth reporting.
fn shown_parameters(model: &ComposedModel) -> Vec<f64> {
    let shown = |parameter: &ModelParameter| {
        let p = &parameter.declaration;
        let stated = SHOWN_WITH.iter().find(|(name, _)| parameter.name == *name);
        match (stated, p.role) {
            (Some((_, value)), _) => *value,
            (
                None,
                Role::TwoSidedAmplitude { meaningful } | Role::OneSidedAmplitude { meaningful },
            ) if parameter.effect.is_some() && (p.typical - p.neutral).abs() < meaningful => {
                (p.neutral + 3.0 * meaningful).min(p.upper)
            }
            _ => p.typical,
        }
    };
    model.parameters().iter().map(shown).collect()
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::{events::time_s, *};
    use crate::load_model::{
        effects::{catalogue, is_registered},
        general_forms,
    };

    /// Coordinates are quarters of a pixel: libraries of mathematics differ in the last bit, which may
    /// turn a rounding.
    const APART_MAX: f64 = 8.0;

    fn manual() -> PathBuf {
        // Relative to the project root, unless the module was given an absolute path.
        let here = Path::new(env!("CARGO_MANIFEST_DIR")).join(file!());
        here.ancestors().nth(4).unwrap().join("docs")
    }

    /// A picture as texts between numbers, and the numbers.
    fn parts(picture: &str) -> (String, Vec<f64>) {
        let mut texts = String::new();
        let mut numbers = Vec::new();
        let is_number = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
        for piece in picture.split_inclusive(|c: char| !is_number(c)) {
            let number = piece.trim_end_matches(|c: char| !is_number(c));
            if let Ok(value) = number.parse() {
                numbers.push(value);
                texts.push_str(&piece[number.len()..]);
            } else {
                texts.push_str(piece);
            }
        }
        (texts, numbers)
    }

    #[test]
    fn every_effect_has_a_current_picture() {
        let listed = catalogue().iter().map(|e| ("effects", e));
        let forms = general_forms::all().iter().map(|e| ("general-forms", e));
        for (directory, effect) in listed.chain(forms) {
            let effect = effect.declaration().name;
            if is_registered(effect) {
                continue;
            }
            let drawn = effect_residuals(effect).unwrap();
            assert!(drawn.len() < 30_000, "{effect}: {} bytes", drawn.len());
            let path = manual().join(directory).join(effect).with_extension("svg");
            if std::env::var_os("UPDATE_DOCS").is_some() {
                std::fs::write(&path, &drawn).unwrap();
            }
            let found = std::fs::read_to_string(&path).unwrap_or_default();
            let ((texts, numbers), (expected_texts, expected)) = (parts(&found), parts(&drawn));
            let same = texts == expected_texts
                && numbers.len() == expected.len()
                && numbers
                    .iter()
                    .zip(&expected)
                    .all(|(x, y)| (x - y).abs() <= APART_MAX);
            assert!(
                same,
                "{} is stale: run UPDATE_DOCS=1 cargo test every_effect_has_a_current_picture",
                path.display()
            );
        }
    }

    fn study(effect: Option<&str>) -> Study {
        let plain = Structure::zip_im();
        let load = effect.map_or(plain.clone(), |name| plain.with(name).unwrap());
        let needs = effect.and_then(find).map(|e| e.declaration().needs);
        let plain = ComposedModel::new(&plain);
        Study::new(plain, &ComposedModel::new(&load), needs.as_ref()).unwrap()
    }

    /// The residuals of a channel in each dip, from one second after the onset on.
    fn late(study: &Study, channel: usize) -> Vec<Vec<f64>> {
        let residuals = study.residuals().unwrap();
        let from = study.dips[0].samples.len();
        let from = (0..from).find(|k| time_s(*k) > 1.0).unwrap();
        residuals
            .iter()
            .map(|r| r[channel][from..].to_vec())
            .collect()
    }

    #[test]
    fn what_zip_and_motor_are_by_themselves_leaves_nothing() {
        let study = study(None);
        let residuals = study.residuals().unwrap();
        assert!(study.misfit(&residuals) < 1e-12);
    }

    #[test]
    fn a_relay_between_two_depths_shows_in_the_deeper_one() {
        let study = study(Some("self_disconnection"));
        let (active, reactive) = (late(&study, 0), late(&study, 1));
        let last = |dip: usize| *active[dip].last().unwrap();
        assert!(last(0).abs() < 0.01 && last(1).abs() < 0.01);
        assert!((last(2) + 0.1).abs() < 0.01, "{}", last(2));
        assert!(reactive.iter().flatten().all(|q| q.abs() < 0.005));
    }

    #[test]
    fn what_drifts_is_a_slope_in_every_dip() {
        for residual in late(&study(Some("load_ramp")), 0) {
            let span_s = (residual.len() - 1) as f64 / 60.0;
            let slope = (residual[residual.len() - 1] - residual[0]) / span_s;
            assert!((slope - 0.002).abs() < 0.000_5, "{slope}");
        }
    }

    #[test]
    fn what_goes_with_the_frequency_is_not_taken_for_a_change_of_voltage() {
        let study = study(Some("static_frequency_dependence"));
        for (dip, residual) in study.dips.iter().zip(late(&study, 0)) {
            let frequency = dip.frequency();
            let ratio = residual[residual.len() - 1] / frequency[frequency.len() - 1];
            // Kpf 1.3 on a static part of 0.6.
            assert!((ratio - 0.78).abs() < 0.2, "{ratio}");
        }
    }

    #[test]
    fn an_unknown_effect_is_named() {
        let error = effect_residuals("perpetual_motion")
            .unwrap_err()
            .to_string();
        assert!(error.contains("perpetual_motion"), "{error}");
    }
}
