//! Checks on what the expressions of a file compute: nothing at rest, nothing at the neutral
//! amplitude, states slow enough to be integrated, finite power in a dip.

use super::{
    compile::STATES_MAX,
    course::{Point, variables},
    declared::OwnedParameter,
    document::Faults,
    effect::Formulas,
    problem::Fault,
    program::VARIABLES,
    written::Written,
};
use crate::load_model::effect::Role;

/// Power over P0 that counts as nothing: rounding of a few operations on numbers near 1.
const NOTHING: f64 = 1e-12;
/// Slope of a state that counts as nothing, in its unit per s: that rounding over the shortest time.
const NO_SLOPE: f64 = NOTHING * RATE_MAX_PER_S;
/// Fastest rate of a state, 1/s: time constants below 0.5 ms are algebraic for any recorder, and at
/// 25 frames/s the integration resolves no more than 3200/s.
const RATE_MAX_PER_S: f64 = 2000.0;
/// `Q0/P0` of the checks.
const REACTIVE_AT_REST: [f64; 3] = [0.0, 0.3, -0.2];
/// The same of the courses.
const REACTIVE: f64 = 0.3;
/// Points within the bounds, besides typical, lower and upper values.
const MIXED_POINTS: u32 = 8;
const STEP_S: f64 = 1.0 / 120.0;
const STEPS: u32 = 120;
/// Voltage of the dip in which power must be finite, ...
const DIP: f64 = 0.45;
/// ... and down to which it should be.
const DEEPEST: f64 = 0.1;

const GUARD: &str = "guard roots, logarithms and divisions with `max` or `clip`, as in \
                     `sqrt(max(v - 0.44, 0))`";

/// The formulas with what messages need.
struct Checked<'a> {
    formulas: &'a Formulas,
    parameters: &'a [OwnedParameter],
    /// Names and units, those of functions included.
    states: &'a [(String, String)],
}

/// Checks the formulas over their parameters' bounds; the first fault of each kind is told. Where there is
/// none, it returns what is not finite below the dip of the checks: sites that never dip as deep can do with it.
pub(super) fn physics(
    formulas: &Formulas,
    parameters: &[OwnedParameter],
    states: &[(String, String)],
    faults: &mut Faults,
) -> Option<Fault> {
    let checked = Checked {
        formulas,
        parameters,
        states,
    };
    let points = points(parameters);
    let checks = [
        points.iter().find_map(|p| checked.too_fast(p)),
        points.iter().find_map(|p| checked.moved_at_rest(p)),
    ];
    let bad = checks.iter().any(Option::is_some);
    checks.into_iter().flatten().for_each(|f| faults.push(f));
    if bad {
        return None;
    }
    let dip = dip();
    for p in &points {
        let neutral: Vec<f64> = parameters.iter().zip(p).map(neutral).collect();
        let fault =
            (checked.driven(&neutral, &dip, true)).or_else(|| checked.driven(p, &dip, false));
        if let Some(fault) = fault {
            faults.push(fault);
            return None;
        }
    }
    let fall = fall();
    points.iter().find_map(|p| checked.below_the_dip(p, &fall))
}

/// What is not a number is not nothing.
fn is_something(power: f64) -> bool {
    power.is_nan() || power.abs() > NOTHING
}

fn neutral((p, value): (&OwnedParameter, &f64)) -> f64 {
    if p.numbers.is_amplitude() {
        p.numbers.neutral
    } else {
        *value
    }
}

/// Typical, lower and upper values, and some in between (a Weyl sequence).
fn points(parameters: &[OwnedParameter]) -> Vec<Vec<f64>> {
    let all = |f: &dyn Fn(&OwnedParameter) -> f64| parameters.iter().map(f).collect();
    let mut points = vec![
        all(&|p| p.numbers.typical),
        all(&|p| p.numbers.lower),
        all(&|p| p.numbers.upper),
    ];
    for k in 1..=MIXED_POINTS {
        let mixed = parameters.iter().enumerate().map(|(i, p)| {
            // Square roots of primes are independent over the rationals.
            const PRIMES: [f64; 12] = [
                2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0, 31.0, 37.0,
            ];
            let share = (f64::from(k) * PRIMES[i % PRIMES.len()].sqrt()).fract();
            p.numbers.lower + share * (p.numbers.upper - p.numbers.lower)
        });
        points.push(mixed.collect());
    }
    points
}

/// Active and reactive power, and the factors that are part of each.
const POWERS: [(&str, &[&str]); 2] = [
    ("active", &["motor_factor", "static_factor"]),
    ("reactive", &["motor_factor"]),
];

/// What an expression sees besides parameters.
struct Seen<'a> {
    x: &'a [f64],
    given: [f64; VARIABLES],
}

impl Checked<'_> {
    fn named(&self, values: &[f64]) -> String {
        let pairs = self.parameters.iter().zip(values);
        let shown: Vec<String> = pairs
            .map(|(p, v)| format!("{} = {v:.4}", p.symbol))
            .collect();
        shown.join(", ")
    }

    /// How a message calls a state, and where the expression is that moves it.
    fn state(&self, index: usize) -> (String, usize) {
        let name = self.states.get(index).map_or("", |(name, _)| name.as_str());
        let derivative = format!("derivative of state `{name}`");
        if let Some(written) = self.formulas.of_key(&derivative) {
            return (format!("state `{name}`"), written.at);
        }
        let mut written = self.formulas.written.iter();
        let owner = written.find(|w| w.kept.contains(&index));
        let key = owner.map_or("the file", |w| w.key.as_str());
        let at = owner.map_or(0, |w| w.at);
        (format!("a state kept by a function in `{key}`"), at)
    }

    fn too_fast(&self, p: &[f64]) -> Option<Fault> {
        let (rate, moving) = self.formulas.fastest(p);
        if rate <= RATE_MAX_PER_S {
            return None;
        }
        let index = self.formulas.moving.get(moving).copied().unwrap_or(0);
        let (state, at) = self.state(index);
        let with = self.named(p);
        if !rate.is_finite() {
            let message = format!("the rate of {state} is {rate} at v = 1, 0.6 or 0.1 with {with}");
            return Some(Fault::new(at, message, GUARD));
        }
        let message = format!("{state} moves at {rate:.3e} /s with {with}");
        let cure = "at most 2000 /s: raise the lower bound of the time, or leave the state out";
        Some(Fault::new(at, message, cure))
    }

    /// What moves at rest.
    fn moved_at_rest(&self, p: &[f64]) -> Option<Fault> {
        let formulas = self.formulas;
        REACTIVE_AT_REST.into_iter().find_map(|reactive| {
            let mut x = [0.0; STATES_MAX];
            formulas.at_rest(p, reactive, &mut x);
            let with = format!("with {}, q0 = {reactive}", self.named(p));
            let rest = Point::REST;
            let seen = Seen {
                x: &x,
                given: variables(&rest, reactive),
            };
            (self.state_at_rest(p, &seen, reactive, &with))
                .or_else(|| self.power_at_rest(p, &seen, &with))
        })
    }

    fn state_at_rest(
        &self,
        p: &[f64],
        seen: &Seen<'_>,
        reactive: f64,
        with: &str,
    ) -> Option<Fault> {
        let formulas = self.formulas;
        let slopes = formulas.slopes::<f64, STATES_MAX>(p, seen.x, [1.0, 0.0], reactive);
        let still = |slope: f64| slope.abs() <= NO_SLOPE;
        let mut slopes = slopes.iter().zip(&formulas.moving);
        if let Some((slope, &index)) = slopes.find(|(slope, _)| !still(**slope)) {
            let (state, at) = self.state(index);
            let message = format!("at rest {state} changes by {slope:e} per s {with}");
            let cure = "its derivative must be 0 at v = 1, df = 0 and its initial value";
            let cure = if slope.is_finite() { cure } else { GUARD };
            return Some(Fault::new(at, message, cure));
        }
        let conditions = formulas.conditions_at_rest(p, seen.x, reactive);
        let holds = |(_, c): &(usize, f64)| *c > 0.0 || c.is_nan();
        let (index, value) = conditions.into_iter().find(holds)?;
        let (_, at) = self.state(index);
        let message = format!("at rest the condition of a timer or latch is {value} {with}");
        let cure = "it must be 0 at v = 1, df = 0: narrow the bounds of its threshold";
        let cure = if value.is_nan() { GUARD } else { cure };
        Some(Fault::new(at, message, cure))
    }

    fn power_at_rest(&self, p: &[f64], seen: &Seen<'_>, with: &str) -> Option<Fault> {
        let (power, value) = self.added(p, seen, is_something)?;
        let name = POWERS[power].0;
        let message = format!("at rest the {name} power added is {value:e} {with}");
        let cure = if value.is_finite() {
            "it must be 0 at v = 1, df = 0, t = 0; a factor must be 1: subtract its value there, \
             `v^a - 1`"
        } else {
            GUARD
        };
        Some(Fault::new(self.place(p, seen, power), message, cure))
    }

    /// Which power, 0 active or 1 reactive, is as asked for, and its value.
    fn added(
        &self,
        p: &[f64],
        seen: &Seen<'_>,
        asked: impl Fn(f64) -> bool,
    ) -> Option<(usize, f64)> {
        let power = self.formulas.added_power(p, seen.x, seen.given);
        power
            .into_iter()
            .enumerate()
            .find(|(_, value)| asked(*value))
    }

    /// Where the expression is that makes a power other than nothing.
    fn place(&self, p: &[f64], seen: &Seen<'_>, power: usize) -> usize {
        let (name, factors) = POWERS[power];
        let adds = |written: &&Written| {
            let value = written.value(p, seen.x, seen.given);
            let neutral = if written.key == name { 0.0 } else { 1.0 };
            is_something(value - neutral)
        };
        let part = |written: &&Written| {
            let key = written.key.as_str();
            key == name || factors.contains(&key)
        };
        let mut parts = self.formulas.written.iter().filter(part);
        let first = parts.clone().next();
        parts.find(adds).or(first).map_or(0, |written| written.at)
    }

    /// What is wrong on a course.
    fn driven(&self, p: &[f64], course: &[Point], is_neutral: bool) -> Option<Fault> {
        self.formulas.through(p, REACTIVE, course, |at, x| {
            let seen = Seen {
                x,
                given: variables(at, REACTIVE),
            };
            let with = || format!("{at} with {}", self.named(p));
            if let Some((power, value)) = self.added(p, &seen, |value| !value.is_finite()) {
                let name = POWERS[power].0;
                let message = format!("the {name} power is {value} {}", with());
                let culprit = self.formulas.not_finite(p, x, seen.given);
                let place = culprit.map_or_else(|| self.place(p, &seen, power), |w| w.at);
                return Some(Fault::new(place, message, GUARD));
            }
            let present = |value: f64| is_neutral && value.abs() > NOTHING;
            let (power, value) = self.added(p, &seen, present)?;
            if let Some(fault) = self.neutral_is_not_nothing() {
                return Some(fault);
            }
            let name = POWERS[power].0;
            let message = format!(
                "with neutral amplitudes the {name} power is {value:e} {}",
                with()
            );
            let cure = "multiply every term by an amplitude, so that the effect can be absent";
            Some(Fault::new(self.place(p, &seen, power), message, cure))
        })
    }

    /// An amplitude from a lower bound other than 0, which is its neutral value.
    fn neutral_is_not_nothing(&self) -> Option<Fault> {
        let p = self.parameters.iter().find(|p| {
            let one_sided = matches!(p.numbers.role, Role::OneSidedAmplitude { .. });
            one_sided && p.numbers.neutral.abs() > 0.0
        })?;
        let message = format!(
            "the effect is not absent at the lower bound {} of the one-sided amplitude `{}`",
            p.numbers.lower, p.symbol
        );
        let cure = "that bound is its neutral value: set `lower` to where the effect is absent, \
                    mostly 0, or make it two_sided";
        Some(Fault::new(p.lower_at, message, cure))
    }

    /// What is not finite on a fall of the voltage below the dip of the checks.
    fn below_the_dip(&self, p: &[f64], fall: &[Point]) -> Option<Fault> {
        let (written, at) = self.formulas.without_value(p, REACTIVE, fall)?;
        let message = format!(
            "{} has no finite value {at} with {}; no event that dips as deep can be simulated with it",
            written.shown(),
            self.named(p)
        );
        Some(Fault::new(written.at, message, GUARD))
    }
}

fn course(voltage: impl Fn(f64) -> f64) -> Vec<Point> {
    let point = |k: u32| {
        let time_s = f64::from(k) * STEP_S;
        Point {
            time_s,
            voltage: voltage(time_s),
            deviation: 0.01 * (9.0 * time_s).sin(),
        }
    };
    (0..STEPS).map(point).collect()
}

/// A dip, a slow recovery, a swell.
fn dip() -> Vec<Point> {
    course(|time_s| {
        if time_s < 0.1 {
            1.0
        } else if time_s < 0.3 {
            DIP
        } else if time_s < 0.8 {
            0.9 + 0.2 * (time_s - 0.3)
        } else {
            1.08
        }
    })
}

/// A fall from the dip of the checks to the deepest voltage.
fn fall() -> Vec<Point> {
    course(|time_s| {
        if time_s < 0.1 {
            1.0
        } else {
            (DIP - 0.4 * (time_s - 0.1)).max(DEEPEST)
        }
    })
}
