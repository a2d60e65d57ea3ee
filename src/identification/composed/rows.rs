//! The rows of one event: every used sample of P, then of Q, as residuals and derivative columns.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::{
    covariance::EventCovariance,
    operating_point::{LINEAR_COUNT, LINEAR_FIRST, at_load, at_operating_point},
    sources::Sources,
};
use crate::{
    identification::{
        LateReport, MeasurementChain,
        evaluate::Curves,
        intake::{Elsewhere, PreparedEvent},
        joint_problem::ProblemOptions,
    },
    load_model::{
        TerminalInput,
        composed::{Accuracy, ComposedModel, Drive, Grid, MotorCourse, Response, SimulationError},
        effect::{Place, Role},
        effects,
    },
};

/// Spread of an effect's share from event to event, relative to the share.
const EFFECT_SPREAD_RELATIVE: f64 = 0.06;
/// The same of the motor's share, at most: a motor of next to no share but many times its rating would otherwise
/// explain whatever an event has.
const MOTOR_SPREAD_RELATIVE: f64 = 0.1;

/// What varies from event to event, as standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Of the linear coefficients, relative to P0.
    pub composition: [f64; LINEAR_COUNT],
    /// Of the motor's share relative to that share, where that is less.
    pub motor_share: f64,
    /// Of an effect's share of the load, relative to that share.
    pub effect_share: f64,
}

impl Default for Scatter {
    fn default() -> Self {
        Self {
            composition: ProblemOptions::default().composition_spread,
            motor_share: MOTOR_SPREAD_RELATIVE,
            effect_share: EFFECT_SPREAD_RELATIVE,
        }
    }
}

impl Scatter {
    /// Shares of the spreads: of the composition, and of effects.
    pub(super) fn times(&self, [composition, effects]: [f64; 2]) -> Self {
        Self {
            composition: self.composition.map(|spread| composition * spread),
            motor_share: composition * self.motor_share,
            effect_share: effects * self.effect_share,
        }
    }
}

/// An event with everything that does not change during a fit.
#[derive(Clone, Debug)]
pub(super) struct EventRows<'a> {
    event: &'a PreparedEvent,
    /// Used samples.
    used: Vec<usize>,
    measured: DVector<f64>,
    deviations: Vec<f64>,
    accuracy: Accuracy,
    input: &'a TerminalInput,
    chain: &'a MeasurementChain,
    grid: Arc<Grid>,
    /// The same event with one of its jumps a standard deviation farther.
    elsewhere: Vec<EventRows<'a>>,
}

impl<'a> EventRows<'a> {
    pub(super) fn new(event: &'a PreparedEvent) -> Self {
        Self::with_accuracy(event, Accuracy::Full)
    }

    /// The event.
    pub(super) fn event(&self) -> &'a PreparedEvent {
        self.event
    }

    pub(super) fn with_accuracy(event: &'a PreparedEvent, accuracy: Accuracy) -> Self {
        let used: Vec<usize> = (0..event.len()).filter(|&k| event.used[k]).collect();
        let both = |p: &[f64], q: &[f64]| stacked(&used, p, q);
        let mut rows = Self {
            measured: DVector::from_vec(both(&event.active, &event.reactive)),
            deviations: both(&event.active_deviation, &event.reactive_deviation),
            used,
            event,
            accuracy,
            input: &event.input,
            chain: &event.chain,
            grid: Arc::new(Grid::new(&event.input, accuracy)),
            elsewhere: Vec::new(),
        };
        let driven_by = |driver: &'a Elsewhere| Self {
            input: &driver.input,
            chain: &driver.chain,
            grid: Arc::new(Grid::new(&driver.input, accuracy)),
            ..rows.clone()
        };
        rows.elsewhere = event.elsewhere().iter().map(driven_by).collect();
        rows
    }

    fn drive(&self) -> Drive<'_> {
        Drive {
            accuracy: self.accuracy,
            grid: Some(&self.grid),
            ..drive(self.event, self.input, self.chain)
        }
    }

    /// Rows of P and Q at every sample.
    pub(super) fn of_samples(&self, active: &[f64], reactive: &[f64]) -> DVector<f64> {
        DVector::from_vec(stacked(&self.used, active, reactive))
    }

    /// What was measured.
    pub(super) fn measured(&self) -> &DVector<f64> {
        &self.measured
    }

    /// Number of rows.
    pub(super) fn count(&self) -> usize {
        self.measured.len()
    }

    /// The piece of time, of length `piece_s`, to which each row belongs.
    pub(super) fn pieces(&self, piece_s: f64) -> Vec<usize> {
        let samples = piece_s * self.event.rate_fps;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most the number of samples"
        )]
        let piece = |k: &usize| (*k as f64 / samples) as usize;
        let once: Vec<usize> = self.used.iter().map(piece).collect();
        once.repeat(2)
    }

    fn simulate(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        wanted: &[usize],
    ) -> Result<Response, SimulationError> {
        let event = self.event;
        let (own, slopes) = at_operating_point(model, parameters, event);
        let mut response = model.simulate(&own, wanted, &self.drive())?;
        let columns = [
            &mut response.active_derivatives,
            &mut response.reactive_derivatives,
        ];
        refer(columns, wanted, &slopes);
        Ok(response)
    }

    /// Measured minus modelled.
    pub(super) fn residual(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
    ) -> Result<DVector<f64>, SimulationError> {
        let response = self.simulate(model, parameters, &[])?;
        let late = self.lateness(model, parameters, &[]);
        let mut rows = DVector::zeros(self.count());
        self.report(
            late.as_ref(),
            &response.active,
            &response.reactive,
            rows.as_mut_slice(),
        );
        self.subtracted(rows.as_mut_slice());
        Ok(rows)
    }

    /// Derivatives of the modelled rows, one column per wanted parameter, and the residual as the
    /// last column.
    pub(super) fn expanded(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        wanted: &[usize],
    ) -> Result<DMatrix<f64>, SimulationError> {
        let sources = Sources::new((model, parameters), wanted, self.event);
        let response = self.simulate(model, parameters, &sources.simulated)?;
        let late = self.lateness(model, parameters, wanted);
        let late = late.as_ref();
        let mut rows = DMatrix::zeros(self.count(), wanted.len() + 1);
        let derivatives = [&response.active_derivatives, &response.reactive_derivatives];
        self.set_columns(&mut rows, &sources, late, derivatives);
        let powers = [&response.active[..], &response.reactive[..]];
        if let Some((late, column)) = late.and_then(|late| Some((late, late.column?))) {
            late.by_delay(&self.used, powers, rows.column_mut(column).as_mut_slice());
        }
        let mut residual = rows.column_mut(wanted.len());
        let residual = residual.as_mut_slice();
        self.report(late, powers[0], powers[1], residual);
        self.subtracted(residual);
        Ok(rows)
    }

    /// Puts what was measured less the rows in their place.
    fn subtracted(&self, rows: &mut [f64]) {
        for (row, measured) in rows.iter_mut().zip(self.measured.iter()) {
            *row = measured - *row;
        }
    }

    fn lateness(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        wanted: &[usize],
    ) -> Option<Lateness> {
        Lateness::new(self.chain, self.event.rate_fps, (model, parameters), wanted)
    }

    fn set_columns(
        &self,
        rows: &mut DMatrix<f64>,
        sources: &Sources,
        late: Option<&Lateness>,
        [active, reactive]: [&Vec<Vec<f64>>; 2],
    ) {
        let mut single = Vec::new();
        for (column, terms) in sources.columns.iter().enumerate() {
            let mut into = rows.column_mut(column);
            let Some(((place, factor), others)) = terms.split_first() else {
                continue;
            };
            self.report(
                late,
                &active[*place],
                &reactive[*place],
                into.as_mut_slice(),
            );
            into *= *factor;
            for (place, factor) in others {
                single.resize(self.count(), 0.0);
                self.report(late, &active[*place], &reactive[*place], &mut single);
                for (row, value) in into.iter_mut().zip(&single) {
                    *row += *factor * value;
                }
            }
        }
    }

    /// The lowest voltage that the load of a model sees, pu.
    pub(super) fn lowest_voltage_at_load_pu(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
    ) -> Result<f64, SimulationError> {
        let (own, _) = at_operating_point(model, parameters, self.event);
        let at_load = model.lowest_voltage_at_load(&own, &self.drive())?;
        Ok(self.event.v0_pu * at_load.unwrap_or_else(|| self.event.input.lowest_voltage()))
    }

    /// The course of the motor where derivatives by the parameters `wanted` are asked for, if that is
    /// of use.
    pub(super) fn motor_course(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        wanted: &[usize],
    ) -> Result<Option<MotorCourse>, SimulationError> {
        let (own, _) = at_operating_point(model, parameters, self.event);
        model.motor_course(&own, wanted, &self.drive())
    }

    /// The derivative columns of [`Self::expanded`] alone, beside a known `motor` where that serves.
    pub(super) fn added(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        wanted: &[usize],
        motor: Option<&MotorCourse>,
    ) -> Result<DMatrix<f64>, SimulationError> {
        if wanted.is_empty() {
            return Ok(DMatrix::zeros(self.count(), 0));
        }
        let by_delay = model.delay().is_some_and(|delay| wanted.contains(&delay));
        if let Some(motor) = motor.filter(|_| !by_delay) {
            let (own, slopes) = at_operating_point(model, parameters, self.event);
            let sources = Sources::new((model, parameters), wanted, self.event);
            let simulated = &sources.simulated;
            let drive = self.drive();
            if let Some([mut active, mut reactive]) =
                model.derivatives_beside(motor, &own, simulated, &drive)?
            {
                refer([&mut active, &mut reactive], simulated, &slopes);
                let late = self.lateness(model, parameters, wanted);
                let mut rows = DMatrix::zeros(self.count(), wanted.len());
                self.set_columns(&mut rows, &sources, late.as_ref(), [&active, &reactive]);
                return Ok(rows);
            }
        }
        let rows = self.expanded(model, parameters, wanted)?;
        Ok(rows.columns(0, wanted.len()).into_owned())
    }

    /// The covariance at a point of the search.
    pub(super) fn covariance(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        scatter: &Scatter,
    ) -> Result<Option<EventCovariance>, SimulationError> {
        let random = random_effects(model, parameters, scatter);
        let wanted: Vec<usize> = random.iter().map(|(index, _)| *index).collect();
        let rows = self.expanded(model, parameters, &wanted)?;
        Ok(self.covariance_of((&rows, &wanted), &random, (model, parameters)))
    }

    /// The covariance at a point of the search, given there the derivative columns of the parameters `wanted`, among
    /// them those that vary, and the residual.
    pub(super) fn covariance_of(
        &self,
        (rows, wanted): (&DMatrix<f64>, &[usize]),
        random: &[(usize, f64)],
        (model, parameters): (&ComposedModel, &[f64]),
    ) -> Option<EventCovariance> {
        self.weighed(&self.random_columns((rows, wanted), random, (model, parameters))?)
    }

    /// The covariance of what varies along these columns and of the noise.
    pub(super) fn weighed(&self, columns: &DMatrix<f64>) -> Option<EventCovariance> {
        EventCovariance::new(&self.deviations, columns)
    }

    /// What varies from event to event, a column of its standard deviation for each: [`Self::covariance_of`].
    pub(super) fn random_columns(
        &self,
        (rows, wanted): (&DMatrix<f64>, &[usize]),
        random: &[(usize, f64)],
        (model, parameters): (&ComposedModel, &[f64]),
    ) -> Option<DMatrix<f64>> {
        let offsets = random.len() + 2;
        let mut columns = DMatrix::zeros(self.count(), offsets + self.elsewhere.len());
        for (column, (index, spread)) in random.iter().enumerate() {
            let place = wanted.iter().position(|w| w == index)?;
            columns.set_column(column, &(rows.column(place) * *spread));
        }
        let outputs = self.chain.output_voltage().len();
        let (one, none) = (vec![1.0; outputs], vec![0.0; outputs]);
        let offset = self.event.operating_point_deviation;
        columns.set_column(random.len(), &(self.stacked(&one, &none) * offset));
        columns.set_column(random.len() + 1, &(self.stacked(&none, &one) * offset));
        for (number, elsewhere) in self.elsewhere.iter().enumerate() {
            // What a model cannot follow elsewhere says nothing of the instant.
            if let Ok(residual) = elsewhere.residual(model, parameters) {
                let moved = residual - rows.column(wanted.len());
                columns.set_column(offsets + number, &moved);
            }
        }
        Some(columns)
    }

    /// How far the composition that the event most probably has is from that of the model, in the standard deviations
    /// that are assumed, the largest of all its parts. `None` when it cannot be simulated.
    pub(super) fn composition_deviation(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        scatter: &Scatter,
    ) -> Option<f64> {
        let covariance = self.covariance(model, parameters, scatter).ok()??;
        let residual = self.residual(model, parameters).ok()?;
        let varying = random_effects(model, parameters, scatter).len();
        let amounts = covariance.amounts(&residual);
        Some(amounts.rows(0, varying).amax())
    }

    /// What the model answers to the event with the composition that the event most probably has; not a
    /// number at samples that are not used. `None` when it cannot be simulated.
    pub(super) fn with_own_composition(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        scatter: &Scatter,
    ) -> Option<Curves> {
        let covariance = self.covariance(model, parameters, scatter).ok()??;
        let residual = self.residual(model, parameters).ok()?;
        let modelled = &self.measured - &residual + covariance.varying(&residual);
        let channel = |rows: &[f64]| {
            let mut values = vec![f64::NAN; self.event.len()];
            for (&k, row) in self.used.iter().zip(rows) {
                values[k] = *row;
            }
            values
        };
        let (active, reactive) = modelled.as_slice().split_at(self.used.len());
        Some(Curves {
            active: channel(active),
            reactive: channel(reactive),
        })
    }

    /// P and Q at the output instants as the instrument reports them, at the used samples.
    fn stacked(&self, active: &[f64], reactive: &[f64]) -> DVector<f64> {
        let mut rows = DVector::zeros(self.count());
        self.report(None, active, reactive, rows.as_mut_slice());
        rows
    }

    /// The same of an instrument that may be late, written to the rows `into`.
    fn report(&self, late: Option<&Lateness>, active: &[f64], reactive: &[f64], into: &mut [f64]) {
        let (chain, (p, q)) = (self.chain, into.split_at_mut(self.used.len()));
        if let Some(late) = late.filter(|late| late.is_late) {
            for ((&k, p), q) in self.used.iter().zip(p).zip(q) {
                [*p, *q] = late.report.measured(k, active, reactive);
            }
            return;
        }
        let mut filtered = chain.filtered().iter().peekable();
        for ((&k, p), q) in self.used.iter().zip(p).zip(q) {
            while filtered.next_if(|f| f.sample < k).is_some() {}
            [*p, *q] = if let Some(filtered) = filtered.next_if(|f| f.sample == k) {
                filtered.measured(active, reactive)
            } else {
                let at = chain.instant(k);
                [active[at], reactive[at]]
            };
        }
    }
}

/// How late the instrument of an event is under some parameters.
struct Lateness {
    report: LateReport,
    /// Whether it is late at all: on time is on time to the last bit.
    is_late: bool,
    rate_fps: f64,
    /// Where among the wanted derivatives that by the delay is.
    column: Option<usize>,
}

impl Lateness {
    /// None where the instrument is on time and nobody asks what it would be otherwise.
    fn new(
        chain: &MeasurementChain,
        rate_fps: f64,
        (model, parameters): (&ComposedModel, &[f64]),
        wanted: &[usize],
    ) -> Option<Self> {
        let delay = model.delay()?;
        let column = wanted.iter().position(|w| *w == delay);
        let is_late = parameters[delay].abs() > 0.0;
        (is_late || column.is_some()).then(|| Self {
            report: chain.late(parameters[delay] * rate_fps),
            is_late,
            rate_fps,
            column,
        })
    }

    /// Derivatives of the rows by the delay, 1/s.
    fn by_delay(&self, used: &[usize], [active, reactive]: [&[f64]; 2], into: &mut [f64]) {
        let (p, q) = into.split_at_mut(used.len());
        for ((&k, p), q) in used.iter().zip(p).zip(q) {
            let slopes = self.report.by_delay(k, active, reactive);
            [*p, *q] = slopes.map(|slope| self.rate_fps * slope);
        }
    }
}

/// What a model's instrument reports of its power at the output instants, sample by sample.
pub(super) fn reported(
    event: &PreparedEvent,
    model: &ComposedModel,
    parameters: &[f64],
    response: &Response,
) -> Vec<[f64; 2]> {
    let (active, reactive) = (&response.active, &response.reactive);
    match Lateness::new(&event.chain, event.rate_fps, (model, parameters), &[]) {
        Some(late) => (0..event.len())
            .map(|k| late.report.measured(k, active, reactive))
            .collect(),
        None => event.chain.measured(active, reactive),
    }
}

/// Turns derivatives by parameters on the base of an event into those by the declared ones.
fn refer([active, reactive]: [&mut Vec<Vec<f64>>; 2], wanted: &[usize], slopes: &[f64]) {
    for ((active, reactive), index) in active.iter_mut().zip(reactive).zip(wanted) {
        for derivative in active.iter_mut().chain(reactive) {
            *derivative *= slopes[*index];
        }
    }
}

/// What drives a composed model in an event.
pub(super) fn drive<'a>(
    event: &PreparedEvent,
    input: &'a TerminalInput,
    chain: &'a MeasurementChain,
) -> Drive<'a> {
    Drive {
        leaves_delay: true,
        at_load: at_load(event),
        ..Drive::new(
            input,
            chain.output_frequency_deviation(),
            event.q0_pu / event.p0_pu,
        )
    }
}

/// P, then Q, at these samples.
fn stacked(used: &[usize], active: &[f64], reactive: &[f64]) -> Vec<f64> {
    let active = used.iter().map(|&k| active[k]);
    active.chain(used.iter().map(|&k| reactive[k])).collect()
}

/// The parameters that vary from event to event, with the standard deviation of each.
pub(super) fn random_effects(
    model: &ComposedModel,
    parameters: &[f64],
    scatter: &Scatter,
) -> Vec<(usize, f64)> {
    let linear = LINEAR_FIRST..LINEAR_FIRST + LINEAR_COUNT;
    let mut composition = scatter.composition;
    composition[0] = composition[0].min(scatter.motor_share * parameters[LINEAR_FIRST]);
    let composition = linear.zip(composition);
    let shares = shares(model, parameters);
    let shares = shares
        .into_iter()
        .map(|(index, value)| (index, scatter.effect_share * value.abs()));
    composition.chain(shares).collect()
}

/// Amplitudes that are shares of the load and not absent: they vary with its composition.
fn shares(model: &ComposedModel, parameters: &[f64]) -> Vec<(usize, f64)> {
    let is_share = |p: &crate::load_model::composed::ModelParameter| {
        let one_sided = matches!(p.declaration.role, Role::OneSidedAmplitude { .. });
        let effect = p.effect.and_then(effects::find);
        one_sided && effect.is_some_and(|e| e.declaration().acts_on(Place::Power))
    };
    let all = model.parameters().iter().zip(parameters).enumerate();
    all.filter(|(_, (p, value))| is_share(p) && !p.declaration.neutral.eq(*value))
        .map(|(index, (_, value))| (index, *value))
        .collect()
}
