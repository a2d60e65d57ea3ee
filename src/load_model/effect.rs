//! The contract of a physical effect: what it declares about itself, and where its equations act.
//!
//! An effect is something that may be missing in the model of ZIP and induction motor, or wrong in the instrument. Its
//! declaration is the only place where its name, parameters, bounds and needs are written; configuration, JSON, manual
//! and search read them from there. Its equations act at the places of [`Equations`], in this order:
//!
//! ```text
//! measured phasor u -> gain (angle of a late frequency channel) -> feeder -> taps (tap changer) -> load
//! load: motor (its constants changed by the effect), static part, power added by the effect
//! load -> feeder losses -> power at the measured bus -> instrument -> measured series
//! ```
//!
//! Rules, tested over the whole catalogue by `composed::contract`:
//! - At rest (`u = 1`, no frequency deviation) an effect adds exactly nothing, so P0 and Q0 hold.
//! - With every amplitude at its neutral value the effect is absent, bit for bit.
//! - Derivatives are exact: an equation is written once over [`Elementary`], run with `f64` and [`Sensitivity`].

mod page;
mod parameter;

use std::fmt::Debug;

use super::{
    Infeasible, MotorCoordinates,
    composed::{
        Drive, Feeder, FrequencyCourse, Instant, Motor, MotorDescription, Rest, Seen, Series, Step,
    },
};
use crate::numerics::{Elementary, Sensitivities};

pub use page::{page, parameter_row};
pub use parameter::{
    MOTOR_REACTANCE, Parameter, Prior, Reference, Role, Scale, TYPICAL_MOTOR_REACTANCE,
};

/// Derivatives carried by one pass; more wanted parameters take several passes.
pub const LANES: usize = 8;

/// The scalar of a sensitivity pass.
pub type Sensitivity = Sensitivities<{ LANES / 2 }>;

/// The scalar of a pass with one or two derivatives.
pub type PairSensitivity = Sensitivities<1>;

/// Whether an effect is a property of the load or of the instrument that looks at it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The load.
    Physics,
    /// The instrument; tested first, never reported as physics.
    Instrument,
}

/// A state variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct State {
    /// Name.
    pub name: &'static str,
    /// Unit, `"1"` when dimensionless.
    pub unit: &'static str,
}

/// Where the equations of an effect act; the simulation asks it nowhere else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// [`Equations::motor`].
    Motor,
    /// [`Equations::feeder`].
    Feeder,
    /// [`Equations::gain`], in front of the feeder.
    Gain,
    /// [`Equations::gain`], of an ideal transformer behind the feeder.
    Taps,
    /// [`Equations::frequency`].
    Frequency,
    /// [`Equations::motor_frequency`].
    MotorFrequency,
    /// [`Equations::power`].
    Power,
    /// [`Equations::advance`].
    States,
    /// [`Equations::measure`].
    Measurement,
    /// [`Equations::static_lag_s`].
    StaticLag,
}

/// What the recordings must contain before the effect can be seen at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Needs {
    /// A frequency (or angle) channel.
    pub frequency: bool,
    /// A voltage below this share of V0 somewhere.
    pub voltage_below: Option<f64>,
    /// A voltage above this share of V0 somewhere.
    pub voltage_above: Option<f64>,
    /// A frequency deviation of at least this, pu, outside the edges.
    pub frequency_deviation: Option<f64>,
    /// Length of the window after the event, s.
    pub window_s: f64,
    /// Reporting rate, frames per second.
    pub rate_fps: f64,
    /// What kind of event separates it from those it resembles.
    pub separating_event: &'static str,
}

impl Needs {
    /// A dip, two seconds, any rate.
    pub const A_DIP: Self = Self {
        frequency: false,
        voltage_below: Some(0.95),
        voltage_above: None,
        frequency_deviation: None,
        window_s: 2.0,
        rate_fps: 25.0,
        separating_event: "dips of different depth",
    };
}

/// Another effect that cannot be in the same structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exclusion {
    /// The other's name.
    pub other: &'static str,
    /// Why, as the end of the sentence "cannot be combined, because ...".
    pub reason: &'static str,
}

/// Everything an effect says about itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Declaration {
    /// Name, equal to the file name.
    pub name: &'static str,
    /// Title for people.
    pub title: &'static str,
    /// Physics or instrument.
    pub kind: Kind,
    /// Version of the equations; raised whenever the same parameters give another output.
    pub version: u32,
    /// Parameters, in the order in which the equations get them.
    pub parameters: &'static [Parameter],
    /// States, in the order in which the equations get them.
    pub states: &'static [State],
    /// Where the equations act.
    pub acts_on: &'static [Place],
    /// What it cannot be combined with.
    pub excludes: &'static [Exclusion],
    /// Effects that leave a similar residual.
    pub resembles: &'static [&'static str],
    /// What the recordings must contain.
    pub needs: Needs,
    /// Where equations and values come from, and what was not verified.
    pub source: &'static str,
}

impl Declaration {
    /// Whether the equations act at a place.
    #[must_use]
    pub fn acts_on(&self, place: Place) -> bool {
        self.acts_on.contains(&place)
    }

    /// The shapes of its own, without shared ones.
    pub fn shapes(&self) -> impl Iterator<Item = &'static Parameter> {
        self.parameters.iter().filter(|p| p.is_shape())
    }

    /// Whether one of two effects is declared to leave a residual similar to the other's.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        self.resembles.contains(&other.name) || other.resembles.contains(&self.name)
    }

    /// Whether these values, in the order of the parameters, make the effect vanish.
    #[must_use]
    pub fn is_neutral(&self, values: &[f64]) -> bool {
        let same = |(p, v): (&Parameter, &f64)| !p.is_amplitude() || p.neutral.eq(v);
        self.parameters.iter().zip(values).all(same)
    }
}

/// Equations of an effect. `p` are its parameters and `x` its states, both in the declared order.
/// Every method has a default that does nothing; only those named in
/// [`Declaration::acts_on`] are called.
pub trait Equations<S: Elementary> {
    /// Changes the constants of the motor before its steady state is computed.
    fn motor(&self, _p: &[S], _motor: &mut MotorDescription<S>) {}

    /// The impedance between the measured bus and the load.
    fn feeder(&self, _p: &[S]) -> Feeder<S> {
        Feeder::none()
    }

    /// A motor besides that of the model. It is computed once per simulation and handed to the other
    /// methods as [`Rest::own_motor`].
    ///
    /// # Errors
    ///
    /// [`Infeasible`] when it has no steady state.
    fn own_motor(&self, _p: &[S], _rest: &Rest<S>) -> Result<Option<Motor<S>>, Infeasible> {
        Ok(None)
    }

    /// The states at rest; they are zero before the call.
    ///
    /// # Errors
    ///
    /// [`Infeasible`] when there is no steady state.
    fn initialise(&self, _p: &[S], _rest: &Rest<S>, _x: &mut [S]) -> Result<(), Infeasible> {
        Ok(())
    }

    /// The fastest rate of the states as they are, 1/s: the steps to the next sample resolve it. Jumps
    /// and relays do not count.
    fn rate_per_s(&self, _p: &[S], _x: &[S], _rest: &Rest<S>) -> f64 {
        0.0
    }

    /// Complex factor on the phasor, 1 at rest.
    fn gain(&self, _p: &[S], _x: &[S], _frequency_deviation: S, _rest: &Rest<S>) -> [S; 2] {
        [S::constant(1.0), S::constant(0.0)]
    }

    /// Changes the frequency deviation (pu, at the output instants) that the other effects see.
    fn frequency(&self, _p: &[S], _time_s: &[f64], _deviation: &mut [S]) {}

    /// Time constant of the lag through which the static load sees its voltage, s.
    fn static_lag_s(&self, _p: &[S]) -> S {
        S::constant(0.0)
    }

    /// Takes the states over one step.
    fn advance(&self, _p: &[S], _x: &mut [S], _step: &Step<S>, _rest: &Rest<S>) {}

    /// Changes what every motor sees of the network's frequency, at the output instants.
    fn motor_frequency(&self, _p: &[S], _course: &FrequencyCourse<'_, S>, _seen: &mut [Seen<S>]) {}

    /// Active and reactive power added, over P0, zero at rest.
    fn power(&self, _p: &[S], _x: &[S], _at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        [S::constant(0.0); 2]
    }

    /// Changes the measured series.
    fn measure(&self, _p: &[S], _series: &mut Series<'_, S>) {}
}

/// Where an expression of an effect has no finite value in an event.
#[derive(Clone, Debug, PartialEq)]
pub struct NoValue {
    /// The expression: its key and its text.
    pub what: String,
    /// Voltage over V0 there.
    pub voltage: f64,
    /// Time since the first sample, s.
    pub time_s: f64,
}

/// What every effect file implements beside its equations.
pub trait Declared: Debug + Send + Sync {
    /// The declaration.
    fn declaration(&self) -> &'static Declaration;

    /// Name of the shape that is the voltage below which the effect begins, if there is one. Recordings
    /// say of it little more than between which of their dips it lies, so a search tries a value in
    /// each gap and not those of the grid.
    fn threshold(&self) -> Option<&'static str> {
        None
    }

    /// Name of the shape that is the width of the band of voltages below [`Self::threshold`] in which the effect
    /// acts in part, if there is one.
    fn span(&self) -> Option<&'static str> {
        None
    }

    /// Name of the shape that is how long the voltage has to stay below [`Self::threshold`], where what begins then goes on
    /// whether or not it stays there, if there is one.
    fn pick_up(&self) -> Option<&'static str> {
        None
    }

    /// Names of the shapes that are how long after [`Self::pick_up`] the first contact parts, and how long after that the
    /// last, if there are such.
    fn parting(&self) -> Option<[&'static str; 2]> {
        None
    }

    /// Names of threshold and span where the first is nothing but the voltage at which a band begins.
    fn band(&self) -> Option<[&'static str; 2]> {
        Some([self.threshold()?, self.span()?])
    }

    /// Names of the shapes that are deviations of the frequency at which the effect begins, below and above: settings of
    /// relays, as a threshold is. A search tries those that the events reach, one side after the other, and not those of the
    /// grid.
    fn frequency_thresholds(&self) -> &'static [&'static str] {
        &[]
    }

    /// Sizes of the first amplitude at which a screen should look, where what happens at a small one says
    /// nothing of a real one (a tap changer whose steps are too small never ends). Empty: the
    /// derivative at the neutral value serves. Where of some shapes one size does nothing in an event, none does.
    fn screened_at(&self) -> &'static [f64] {
        &[]
    }

    /// Name of the parameter, in s, by which an instrument reports P and Q late, in whatever else it does. Where
    /// a simulation leaves that to its caller ([`Drive::leaves_delay`](crate::load_model::Drive)), [`Equations::measure`] is not called.
    fn delay(&self) -> Option<&'static str> {
        None
    }

    /// Name of the shape that counts the dips of an event ([`Role::Count`]), if there is one. A search tries the grid with as
    /// many as any event has.
    fn counts_dips(&self) -> Option<&'static str> {
        None
    }

    /// Names of shapes that decide how often something happens in an event, not how: another event is foretold
    /// by them to a step. What is judged without an event has them as with it.
    fn bracketed(&self) -> &'static [&'static str] {
        &[]
    }

    /// Other values of the effect's parameters that do nearly the same, with a hill between: a fit that has
    /// ended at `_values` goes on from them. None for most effects.
    fn mistaken_for(&self, _values: &[f64]) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// Names of an amplitude and of a shape `e`, where the amplitude of an event with the active power P0
    /// (pu of the site's base) is the parameter times `P0^-e`: 0 for what is a share of the load, 1 for
    /// what stays the same whatever the load. The equations get the amplitude of the event.
    fn load_exponent(&self) -> Option<[&'static str; 2]> {
        None
    }

    /// Name of a shape that is a change by Q0/P0: the equations get it times what Q0/P0 is in the event above that of the site.
    fn by_reactive_ratio(&self) -> Option<&'static str> {
        None
    }

    /// Values of the shapes (those of [`Declaration::shapes`], in order) at which a screen should
    /// look for the effect while its amplitude is zero and the shapes cannot be estimated. May
    /// depend on the motor found so far.
    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        vec![self.declaration().shapes().map(|p| p.typical).collect()]
    }

    /// Parameters, as indices into those declared, of which only [`Equations::power`] and
    /// [`Equations::measure`] make use, so that no state depends on them. Their derivatives cost no integration. By default all of an effect that acts nowhere else.
    fn beside_the_states(&self) -> Vec<usize> {
        const BESIDE: [Place; 2] = [Place::Power, Place::Measurement];
        let declared = self.declaration();
        if declared.acts_on.iter().all(|place| BESIDE.contains(place)) {
            (0..declared.parameters.len()).collect()
        } else {
            Vec::new()
        }
    }

    /// Where the equations have no finite value with these parameters while the load sees the measured voltage; asked for
    /// when a simulation has failed. None where they say nothing of it.
    fn no_value(&self, _p: &[f64], _drive: &Drive<'_>) -> Option<NoValue> {
        None
    }
}

/// An effect as the catalogue holds it: its declaration and its equations for the scalars of a simulation.
pub trait Effect: Declared {
    /// The equations for values.
    fn plain(&self) -> &dyn Equations<f64>;
    /// The equations for values and [`LANES`] derivatives.
    fn with_sensitivities(&self) -> &dyn Equations<Sensitivity>;
    /// The equations for values and two derivatives.
    fn with_two(&self) -> &dyn Equations<PairSensitivity>;
}

impl<E> Effect for E
where
    E: Declared + Equations<f64> + Equations<Sensitivity> + Equations<PairSensitivity>,
{
    fn plain(&self) -> &dyn Equations<f64> {
        self
    }

    fn with_sensitivities(&self) -> &dyn Equations<Sensitivity> {
        self
    }

    fn with_two(&self) -> &dyn Equations<PairSensitivity> {
        self
    }
}
