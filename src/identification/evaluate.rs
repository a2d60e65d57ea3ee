//! Simulating a fitted model on an event and measuring how far it is from the measurement.

use nalgebra::{DMatrix, DVector};

use super::{
    ErrorSummary, EventErrors, IdentificationError,
    gram::{at_rest, linear_rows, motor_change, own_reactive},
    intake::PreparedEvent,
    joint_problem::reactive_at_rest,
};
use crate::load_model::{
    Infeasible, LinearCoefficients, MotorCoordinates, MotorOutput, composed::SimulationError,
};

/// A fitted model of any structure: what it draws in an event, as the instrument reports it.
pub trait EventModel: Sync + std::fmt::Debug {
    /// Simulates the model on an event.
    ///
    /// # Errors
    ///
    /// [`SimulationError`] when the model has no steady state or no finite response.
    fn curves(&self, event: &PreparedEvent) -> Result<Curves, SimulationError>;

    /// Which of its parts has no finite value in an event that has no response; none where that is not known.
    fn without_value(&self, _event: &PreparedEvent) -> Option<IdentificationError> {
        None
    }
}

impl EventModel for FittedModel {
    fn curves(&self, event: &PreparedEvent) -> Result<Curves, SimulationError> {
        Ok(self.simulate(event)?)
    }
}

/// The plain model of ZIP and motor, which can be simulated on any prepared event: everything the
/// data determine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedModel {
    /// The motor.
    pub motor: MotorCoordinates<f64>,
    /// Shares and static part, relative to P0.
    pub linear: LinearCoefficients,
}

/// Coefficients of a static model.
const STATIC: usize = 4;

/// Static ZIP coefficients of P and Q fitted to some events: the model to be better than.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StaticModel {
    /// `c_z`, `c_i` of P, then of Q.
    coefficients: [f64; STATIC],
}

/// P and Q of one event over P0.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// Active power over P0.
    pub active: Vec<f64>,
    /// Reactive power over P0.
    pub reactive: Vec<f64>,
}

impl FittedModel {
    /// Simulates the model on an event.
    ///
    /// # Errors
    ///
    /// [`Infeasible`] when the motor has no steady state.
    pub fn simulate(&self, event: &PreparedEvent) -> Result<Curves, Infeasible> {
        let mut out = MotorOutput::default();
        self.motor.simulate(&event.input, &mut out)?;
        let rest = reactive_at_rest(&self.motor);
        let beta = self.linear.to_array();
        let motor = motor_change(event, &out, rest);
        let (active, reactive) = motor
            .iter()
            .zip(event.chain.static_responses())
            .map(|(motor, load)| {
                let rows = linear_rows(*motor, &load);
                let [p, q] = rows.map(|row| row.iter().zip(beta).map(|(a, b)| a * b).sum::<f64>());
                let [own_p, own_q] = own_reactive(event, &rows);
                let [p0, q0] = at_rest(event, &load);
                (p0 + (p + own_p), q0 + (q + own_q))
            })
            .unzip();
        let mut curves = Curves { active, reactive };
        curves.shift_to(event);
        Ok(curves)
    }
}

impl Curves {
    /// Where there was no rest before the event, moves the curves by the offset of the operating
    /// point that the data make most likely.
    pub(super) fn shift_to(&mut self, event: &PreparedEvent) {
        if event.steady_start {
            return;
        }
        let Self { active, reactive } = self;
        shift(active, &event.active, &event.active_deviation, event);
        shift(reactive, &event.reactive, &event.reactive_deviation, event);
    }
}

impl StaticModel {
    /// Least squares of `c_z (v^2 - 1) + c_i (v - 1)` for P and Q over the used samples, through the
    /// measurement chain.
    #[must_use]
    pub fn fit(events: &[PreparedEvent]) -> Self {
        let mut gram = DMatrix::zeros(STATIC, STATIC);
        let mut right = DVector::zeros(STATIC);
        for event in events {
            for (k, load) in event.chain.static_responses().iter().enumerate() {
                if !event.used[k] {
                    continue;
                }
                let rest = at_rest(event, load);
                let measured = [event.active[k], event.reactive[k]];
                let deviations = [event.active_deviation[k], event.reactive_deviation[k]];
                let rows = linear_rows([0.0; 2], load);
                for channel in 0..2 {
                    let deviation = deviations[channel];
                    let row = DVector::from_column_slice(&rows[channel][1..]) / deviation;
                    gram += &row * row.transpose();
                    right += row * ((measured[channel] - rest[channel]) / deviation);
                }
            }
        }
        // A shallow event cannot tell the two apart: the pseudo-inverse shares between them.
        let solution = gram.svd(true, true).solve(&right, 1e-9);
        let coefficients = solution.map_or([0.0; STATIC], |x| std::array::from_fn(|i| x[i]));
        Self { coefficients }
    }

    fn simulate(&self, event: &PreparedEvent) -> Curves {
        let (active, reactive) = event
            .chain
            .static_responses()
            .iter()
            .map(|load| {
                let [p, q] = linear_rows([0.0; 2], load).map(|row| {
                    let terms = row[1..].iter().zip(self.coefficients);
                    terms.map(|(a, b)| a * b).sum::<f64>()
                });
                let [p0, q0] = at_rest(event, load);
                (p0 + p, q0 + q)
            })
            .unzip();
        Curves { active, reactive }
    }
}

/// Moves a modelled curve by the offset of the operating point that the data make most likely: where
/// there was no rest before the event, P0 and Q0 are as unknown as the fit took them to be.
fn shift(model: &mut [f64], measured: &[f64], deviation: &[f64], event: &PreparedEvent) {
    let (mut top, mut bottom) = (0.0, event.operating_point_deviation.powi(-2));
    for k in (0..event.len()).filter(|&k| event.used[k]) {
        let weight = deviation[k].powi(-2);
        top += weight * (measured[k] - model[k]);
        bottom += weight;
    }
    let offset = top / bottom;
    for y in model {
        *y += offset;
    }
}

/// Sums needed for the errors of one event, and to add events up.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    square_error: [f64; 2],
    square_measured: [f64; 2],
    event_square_error: [f64; 2],
    event_square_measured: [f64; 2],
    event_static_error: [f64; 2],
    event_constant_error: [f64; 2],
    event_samples: f64,
    to_noise: f64,
    to_noise_count: f64,
    to_noise_away: f64,
    to_noise_away_count: f64,
}

/// Errors of a model on events.
///
/// # Errors
///
/// [`SimulationError`] when the model cannot be simulated.
pub fn errors(
    model: &dyn EventModel,
    reference: &StaticModel,
    events: &[PreparedEvent],
) -> Result<ErrorSummary, SimulationError> {
    let mut total = Sums::default();
    let mut each = Vec::with_capacity(events.len());
    for event in events {
        let sums = event_sums(event, &model.curves(event)?, &reference.simulate(event));
        total.add(&sums);
        each.push(sums.into_errors(event));
    }
    let percent = |c: usize| 100.0 * ratio_root(total.square_error[c], total.square_measured[c]);
    Ok(ErrorSummary {
        eps_p_percent: percent(0),
        eps_q_percent: percent(1),
        error_to_noise: ratio_root(total.to_noise, total.to_noise_count),
        error_to_noise_away_from_edges: ratio_root(total.to_noise_away, total.to_noise_away_count),
        events: each,
    })
}

fn event_sums(event: &PreparedEvent, model: &Curves, reference: &Curves) -> Sums {
    let mut sums = Sums::default();
    let rest = [1.0, event.q0_pu / event.p0_pu];
    let noise = [event.active_noise, event.reactive_noise];
    for k in (0..event.len()).filter(|&k| event.used[k]) {
        let measured = [event.active[k], event.reactive[k]];
        let modelled = [model.active[k], model.reactive[k]];
        let static_only = [reference.active[k], reference.reactive[k]];
        let in_event = k >= event.event_start;
        for c in 0..2 {
            // In pu of the load base, so that events of different size add up as in the paper.
            let scale = event.p0_pu * event.p0_pu;
            let square = |x: f64| scale * (measured[c] - x) * (measured[c] - x);
            sums.square_error[c] += square(modelled[c]);
            sums.square_measured[c] += square(0.0);
            if in_event {
                sums.event_square_error[c] += square(modelled[c]);
                sums.event_square_measured[c] += square(0.0);
                sums.event_static_error[c] += square(static_only[c]);
                sums.event_constant_error[c] += square(rest[c]);
                let to_noise = ((measured[c] - modelled[c]) / noise[c]).powi(2);
                sums.to_noise += to_noise;
                sums.to_noise_count += 1.0;
                if !event.near_edge[k] {
                    sums.to_noise_away += to_noise;
                    sums.to_noise_away_count += 1.0;
                }
            }
        }
        if in_event {
            sums.event_samples += 1.0;
        }
    }
    sums
}

impl Sums {
    fn add(&mut self, other: &Self) {
        for c in 0..2 {
            self.square_error[c] += other.square_error[c];
            self.square_measured[c] += other.square_measured[c];
        }
        self.to_noise += other.to_noise;
        self.to_noise_count += other.to_noise_count;
        self.to_noise_away += other.to_noise_away;
        self.to_noise_away_count += other.to_noise_away_count;
    }

    fn into_errors(self, event: &PreparedEvent) -> EventErrors {
        let percent =
            |top: [f64; 2], bottom: [f64; 2], c: usize| 100.0 * ratio_root(top[c], bottom[c]);
        let skill = |reference: [f64; 2], c: usize| {
            if reference[c] > 0.0 {
                1.0 - self.event_square_error[c] / reference[c]
            } else {
                0.0
            }
        };
        let apparent_square = event.p0_pu * event.p0_pu + event.q0_pu * event.q0_pu;
        EventErrors {
            event: event.id.clone(),
            eps_p_percent: percent(self.square_error, self.square_measured, 0),
            eps_q_percent: percent(self.square_error, self.square_measured, 1),
            event_eps_p_percent: percent(self.event_square_error, self.event_square_measured, 0),
            event_eps_q_percent: percent(self.event_square_error, self.event_square_measured, 1),
            event_q_to_s0_percent: 100.0
                * ratio_root(
                    self.event_square_error[1],
                    self.event_samples * apparent_square,
                ),
            skill_p: skill(self.event_static_error, 0),
            skill_q: skill(self.event_static_error, 1),
            skill_over_constant_p: skill(self.event_constant_error, 0),
            skill_over_constant_q: skill(self.event_constant_error, 1),
            error_to_noise: ratio_root(self.to_noise, self.to_noise_count),
            error_to_noise_away_from_edges: ratio_root(
                self.to_noise_away,
                self.to_noise_away_count,
            ),
            lowest_voltage: event.lowest_voltage,
        }
    }
}

fn ratio_root(top: f64, bottom: f64) -> f64 {
    if bottom > 0.0 {
        (top / bottom).sqrt()
    } else {
        0.0
    }
}
