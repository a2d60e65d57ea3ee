//! What an effect leaves when it is missing: ZIP and motor, refitted to the load with the effect in
//! dips of three depths, subtracted from that load.

use nalgebra::{DMatrix, DVector};

use super::{
    decimate::envelope,
    figure::{Figure, Ink, Mark, Panel, ReportError},
};
use crate::load_model::{
    ComposedModel, Drive, Response, SimulationError, Structure, TerminalInput,
    composed::{BASE_PARAMETERS, ModelParameter},
    effect::{Needs, Role},
    effects::find,
    structure::StructureError,
};

const RATE_FPS: f64 = 60.0;
const POINTS: usize = 16;
const REACTIVE_AT_REST: f64 = 0.3;
const NOMINAL_RAD_S: f64 = 376.99;
/// Retained voltage, colour and line of the three dips.
const DIPS: [(f64, Ink, u32); 3] = [
    (0.9, Ink::Rival, 5),
    (0.7, Ink::Measured, 7),
    (0.5, Ink::Model, 9),
];
/// When the dips begin, and how long they last, s: longer than the delays of most relays.
const ONSET_S: f64 = 0.5;
const DIP_S: f64 = 0.15;
/// Shortest and longest time shown after the onset, s.
const AFTER_S: (f64, f64) = (2.5, 60.0);
/// What the voltage stays below V0 for good, and what it lacks at first after the clearing.
const LASTING_DROP: f64 = 0.015;
const SLOW_DROP: f64 = 0.05;
/// What the frequency goes to, relative to nominal, and how fast, s.
const FREQUENCY_DEVIATION: f64 = -0.004;
const FREQUENCY_TIME_S: f64 = 1.0;
/// It goes to so many times the setting of a relay that it switches.
const BEYOND_SETTING: f64 = 1.25;
/// Noise of the refit's weights, and the share of the local range of P and Q that is added near edges:
/// as intake has them.
const NOISE: f64 = 1e-3;
const EDGE_SHARE: [f64; 2] = [0.08, 0.16];
const REFIT_STEPS: usize = 12;
/// Points of a curve outside of the times in which every sample is shown, and these times, s.
const POINTS_SHOWN: usize = 110;
const ALL_SHOWN_S: (f64, f64) = (-0.08, 0.6);
const WIDTH_PX: u32 = 680;

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
/// 10, 30 and 50 % when ZIP and motor are refitted to all three without it, as an SVG file. Without
/// noise. Where the effect needs a voltage above V0, the voltage overshoots after the dips.
///
/// # Errors
///
/// [`PictureError`].
pub fn effect_residuals(effect: &str) -> Result<String, PictureError> {
    let plain = Structure::zip_im();
    let structure = plain.with(effect)?;
    let needs = find(effect).map(|e| e.declaration().needs);
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
    let drawn = study.figure(effect, &residuals).document()?;
    // On a dark page the picture keeps its own ground.
    let ground = "><rect width=\"100%\" height=\"100%\" fill=\"#FFFFFF\"/>";
    Ok(drawn.replacen('>', ground, 1))
}

/// One dip: its voltage, its frequency, and P and Q of the load with the effect at every sample.
struct Dip {
    input: TerminalInput,
    deviation: Vec<f64>,
    /// Output instants that are samples.
    samples: Vec<usize>,
    load: [Vec<f64>; 2],
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
        let after_s = needs.map_or(AFTER_S.0, |n| n.window_s.clamp(AFTER_S.0, AFTER_S.1));
        let highest = needs.and_then(|n| n.voltage_above);
        let parameters = shown_parameters(load);
        let lowest = frequency_reached(load, &parameters);
        let mut dips = Vec::new();
        for (depth, ..) in DIPS {
            let input = dip(depth, after_s, highest);
            let mut dip = Dip {
                deviation: frequency(&input, lowest),
                samples: (input.output_points().iter().enumerate())
                    .filter(|(_, point)| point.is_multiple_of(POINTS))
                    .map(|(place, _)| place)
                    .collect(),
                input,
                load: Default::default(),
            };
            dip.load = dip.channels(&dip.simulate(load, &parameters, &[])?);
            dips.push(dip);
        }
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
            let shorter = [1.0, 0.5, 0.25, 0.1].iter().find_map(|share| {
                let moved = self.moved(&parameters, &step, *share);
                let left = self.left(&moved).ok()?;
                (self.squares(&left) < self.squares(&best)).then_some((moved, left))
            });
            let Some((moved, left)) = shorter else { break };
            (parameters, best) = (moved, left);
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

    fn squares(&self, left: &[[Vec<f64>; 2]]) -> f64 {
        let pairs = self.dips.iter().zip(left);
        pairs
            .flat_map(|(dip, left)| [0, 1].map(|c: usize| (dip.deviations(c), &left[c])))
            .flat_map(|(deviation, left)| deviation.into_iter().zip(left))
            .map(|(deviation, left)| (left / deviation).powi(2))
            .sum()
    }

    /// A step of the Gauss-Newton method.
    fn step(&self, parameters: &[f64]) -> Result<Option<DVector<f64>>, SimulationError> {
        let wanted: Vec<usize> = (0..BASE_PARAMETERS).collect();
        let mut normal = DMatrix::zeros(BASE_PARAMETERS, BASE_PARAMETERS);
        let mut right = DVector::zeros(BASE_PARAMETERS);
        for dip in &self.dips {
            let response = dip.simulate(&self.plain, parameters, &wanted)?;
            let model = dip.channels(&response);
            let slopes = [&response.active_derivatives, &response.reactive_derivatives];
            for c in 0..2 {
                for (k, deviation) in dip.deviations(c).into_iter().enumerate() {
                    let place = dip.samples[k];
                    let row = slopes[c].iter().map(|slope| slope[place] / deviation);
                    let row = DVector::from_iterator(BASE_PARAMETERS, row);
                    right += &row * ((dip.load[c][k] - model[c][k]) / deviation);
                    normal += &row * row.transpose();
                }
            }
        }
        for i in 0..BASE_PARAMETERS {
            normal[(i, i)] *= 1.0 + 1e-6;
        }
        Ok(normal.cholesky().map(|factor| factor.solve(&right)))
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

    fn figure(&self, effect: &str, residuals: &[[Vec<f64>; 2]]) -> Figure {
        let first = self.dips.first();
        let end_s = first.map_or(0.0, |dip| time_s(dip.samples.len() - 1));
        let voltages: Vec<Vec<f64>> = self.dips.iter().map(Dip::voltage).collect();
        let percent = |c: usize| -> Vec<Vec<f64>> {
            let of_dip = |left: &[Vec<f64>; 2]| left[c].iter().map(|x| 100.0 * x).collect();
            residuals.iter().map(of_dip).collect()
        };
        let key = "dips of 10 % (thin, green), 30 % (blue), 50 % (thick, orange)";
        let panels = vec![
            panel(format!("voltage, of V0; {key}"), 70, &voltages, false),
            panel("residual of P, % of P0".to_owned(), 130, &percent(0), true),
            panel("residual of Q, % of P0".to_owned(), 130, &percent(1), true),
        ];
        Figure {
            id: format!("residual-{effect}"),
            title: format!("Residual that {effect} leaves when it is missing"),
            description: format!(
                "P and Q of a load with {effect}, minus those of ZIP and motor refitted to the same \
                 three dips without it."
            ),
            width_px: WIDTH_PX,
            horizontal: (-ONSET_S, end_s),
            horizontal_title: "time since the onset, s".to_owned(),
            counts: false,
            panels,
        }
    }
}

impl Dip {
    fn simulate(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        wanted: &[usize],
    ) -> Result<Response, SimulationError> {
        let drive = Drive::new(&self.input, &self.deviation, REACTIVE_AT_REST);
        model.simulate(parameters, wanted, &drive)
    }

    /// P and Q at the samples.
    fn channels(&self, response: &Response) -> [Vec<f64>; 2] {
        [&response.active, &response.reactive]
            .map(|channel| self.samples.iter().map(|&k| channel[k]).collect())
    }

    fn voltage(&self) -> Vec<f64> {
        let real = self.input.real.iter().step_by(POINTS);
        let imaginary = self.input.imaginary.iter().step_by(POINTS);
        real.zip(imaginary).map(|(x, y)| x.hypot(*y)).collect()
    }

    /// Deviation of every sample of a channel: noise, and more near edges.
    fn deviations(&self, channel: usize) -> Vec<f64> {
        let load = &self.load[channel];
        (0..load.len())
            .map(|k| {
                let near = &load[k.saturating_sub(2)..(k + 3).min(load.len())];
                let low = near.iter().copied().fold(f64::INFINITY, f64::min);
                let high = near.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                NOISE + EDGE_SHARE[channel] * (high - low)
            })
            .collect()
    }
}

fn panel(title: String, height_px: u32, curves: &[Vec<f64>], has_zero: bool) -> Panel {
    let values = || curves.iter().flatten().copied();
    let (low, high) = (
        values().fold(f64::INFINITY, f64::min),
        values().fold(f64::NEG_INFINITY, f64::max),
    );
    // A residual of less than a tenth of a percent is drawn as the nothing it is.
    let least = if has_zero { 0.1 } else { 0.0 };
    let (low, high) = (low.min(-least), high.max(least));
    let margin = 0.06 * (high - low);
    let mut marks = Vec::new();
    if has_zero {
        marks.push(Mark::Level {
            at: 0.0,
            ink: Ink::Axis,
        });
    }
    for (values, (_, ink, width_quarter_px)) in curves.iter().zip(DIPS) {
        let mut shown = envelope(values, POINTS_SHOWN);
        shown.extend(
            (0..values.len()).filter(|&k| (ALL_SHOWN_S.0..=ALL_SHOWN_S.1).contains(&time_s(k))),
        );
        shown.sort_unstable();
        shown.dedup();
        let shown = shown.into_iter();
        marks.push(Mark::Line {
            points: shown.map(|k| (time_s(k), values[k])).collect(),
            ink,
            width_quarter_px,
        });
    }
    Panel {
        title,
        height_px,
        vertical: (low - margin, high + margin),
        logarithmic: false,
        marks,
    }
}

/// Seconds since the onset.
fn time_s(sample: usize) -> f64 {
    sample as f64 / RATE_FPS - ONSET_S
}

/// Typical values; an amplitude of either sign that is typically absent is three times as large as what
/// is worth reporting.
fn shown_parameters(model: &ComposedModel) -> Vec<f64> {
    let shown = |parameter: &ModelParameter| {
        let p = &parameter.declaration;
        match p.role {
            Role::TwoSidedAmplitude { meaningful } | Role::OneSidedAmplitude { meaningful }
                if parameter.effect.is_some() && (p.typical - p.neutral).abs() < meaningful =>
            {
                (p.neutral + 3.0 * meaningful).min(p.upper)
            }
            _ => p.typical,
        }
    };
    model.parameters().iter().map(shown).collect()
}

/// The phasor of a dip with phase jumps.
fn dip(depth: f64, after_s: f64, highest: Option<f64>) -> TerminalInput {
    let samples = 1
        + (1..=100_000_u32)
            .take_while(|k| f64::from(*k) <= (ONSET_S + after_s) * RATE_FPS)
            .count();
    let swell = highest.map_or(0.0, |v| v - 1.0 + 2.0 * LASTING_DROP);
    let phasor = |i: usize| {
        let time_s = i as f64 / (RATE_FPS * POINTS as f64) - ONSET_S;
        let (magnitude, angle) = if time_s < 0.0 {
            (1.0, 0.0)
        } else if time_s < DIP_S {
            (depth, -0.2 * (1.0 - depth))
        } else {
            let slow = (-(time_s - DIP_S) / 0.3).exp();
            let late = (-(time_s - DIP_S) / 0.8).exp();
            let deep = (1.0 - depth) / 0.5;
            let lacking = LASTING_DROP + SLOW_DROP * deep * slow;
            (1.0 - lacking + swell * (late - slow), -0.02 * (1.0 - slow))
        };
        [magnitude * angle.cos(), magnitude * angle.sin()]
    };
    let grid: Vec<[f64; 2]> = (0..=(samples - 1) * POINTS).map(phasor).collect();
    let edge = |k: usize, reach: f64| {
        let begins = k as f64 / RATE_FPS - ONSET_S;
        let interval_s = 1.0 / RATE_FPS;
        [0.0, DIP_S].iter().any(|at| {
            (begins - reach * interval_s..=begins + (1.0 + reach) * interval_s).contains(at)
        })
    };
    TerminalInput {
        real: grid.iter().map(|u| u[0]).collect(),
        imaginary: grid.iter().map(|u| u[1]).collect(),
        points_per_sample: POINTS,
        sample_interval_s: 1.0 / RATE_FPS,
        jumps: (0..samples - 1).map(|k| edge(k, 0.01)).collect(),
        dense: (0..samples - 1).map(|k| edge(k, 3.0)).collect(),
        synchronous_speed_rad_s: NOMINAL_RAD_S,
    }
}

/// What the frequency goes to: beyond the settings of relays that it switches.
fn frequency_reached(load: &ComposedModel, parameters: &[f64]) -> f64 {
    let settings = load.effect_names().filter_map(find).flat_map(|effect| {
        let own = effect.declaration().name;
        let names = effect.frequency_thresholds().iter();
        names.filter_map(move |name| load.index(&format!("{own}.{name}")))
    });
    let beyond = settings.map(|index| -BEYOND_SETTING * parameters[index]);
    beyond.fold(FREQUENCY_DEVIATION, f64::min)
}

/// The frequency sinks after the onset, at every output instant.
fn frequency(input: &TerminalInput, reached: f64) -> Vec<f64> {
    let points = input.output_points().into_iter();
    let fine_s = input.sample_interval_s / input.points_per_sample as f64;
    points
        .map(|point| {
            let since_s = (point as f64 * fine_s - ONSET_S).max(0.0);
            reached * (1.0 - (-since_s / FREQUENCY_TIME_S).exp())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::*;
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

    #[test]
    fn what_zip_and_motor_are_by_themselves_leaves_nothing() {
        let plain = ComposedModel::new(&Structure::zip_im());
        let study = Study::new(plain.clone(), &plain, None).unwrap();
        let residuals = study.residuals().unwrap();
        assert!(study.squares(&residuals) < 1e-12);
    }

    #[test]
    fn a_relay_between_two_depths_shows_in_the_deeper_one() {
        let plain = Structure::zip_im();
        let load = ComposedModel::new(&plain.with("self_disconnection").unwrap());
        let study = Study::new(ComposedModel::new(&plain), &load, None).unwrap();
        // V_th is 0.7: the last sample of the deepest dip lacks the block, whatever the refit does.
        let last = |dip: usize| *study.dips[dip].load[0].last().unwrap();
        assert!(
            (last(0) - last(2) - 0.1).abs() < 0.01,
            "{} {}",
            last(0),
            last(2)
        );
        let residuals = study.residuals().unwrap();
        let largest = |dip: usize| {
            residuals[dip][0]
                .iter()
                .fold(0.0_f64, |m, x| m.max(x.abs()))
        };
        assert!(largest(2) > 0.03);
    }

    #[test]
    fn an_unknown_effect_is_named() {
        let error = effect_residuals("perpetual_motion")
            .unwrap_err()
            .to_string();
        assert!(error.contains("perpetual_motion"), "{error}");
    }
}
