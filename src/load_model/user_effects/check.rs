//! Checks on what the expressions of a file compute: nothing at rest, nothing at the neutral
//! amplitude, states slow enough to be integrated, finite power in a dip.

use super::{
    compile::STATES_MAX, declared::OwnedParameter, document::Faults, effect::Formulas,
    program::VARIABLES,
};
use crate::load_model::composed::Step;

/// Power over P0 that counts as nothing: rounding of a few operations on numbers near 1.
const NOTHING: f64 = 1e-12;
/// Slope of a state that counts as nothing, in its unit per s: that rounding over the shortest time.
const NO_SLOPE: f64 = NOTHING * RATE_MAX_PER_S;
/// Fastest rate of a state, 1/s: time constants below 0.5 ms are algebraic for any recorder, and at
/// 25 frames/s the integration resolves no more than 3200/s.
const RATE_MAX_PER_S: f64 = 2000.0;
/// `Q0/P0` of the checks.
const REACTIVE_AT_REST: [f64; 3] = [0.0, 0.3, -0.2];
/// Points within the bounds, besides typical, lower and upper values.
const MIXED_POINTS: u32 = 8;
const STEP_S: f64 = 1.0 / 120.0;
const STEPS: u32 = 120;

/// Checks the formulas over their parameters' bounds; the first fault of each kind is told.
pub(super) fn physics(
    formulas: &Formulas,
    parameters: &[OwnedParameter],
    states: &[(String, String)],
    at: usize,
    faults: &mut Faults,
) {
    let points = points(parameters);
    let too_fast = points.iter().find_map(|p| {
        let rate = formulas.rate_per_s(p);
        (rate.is_nan() || rate > RATE_MAX_PER_S).then(|| {
            let message = format!(
                "a state moves at {rate:.3e} /s with {}",
                named(parameters, p)
            );
            (
                message,
                "at most 2000 /s: raise the lower bound of the time, or leave the state out",
            )
        })
    });
    let checks = [
        too_fast.map(|(m, c)| (m, c.to_owned())),
        points
            .iter()
            .find_map(|p| moved_at_rest(formulas, parameters, states, p)),
    ];
    let bad = checks.iter().any(Option::is_some);
    for (message, cure) in checks.into_iter().flatten() {
        faults.add(at, message, cure);
    }
    if bad {
        return;
    }
    for p in &points {
        let neutral: Vec<f64> = parameters.iter().zip(p).map(neutral).collect();
        let fault = driven(formulas, parameters, &neutral, true)
            .or_else(|| driven(formulas, parameters, p, false));
        if let Some((message, cure)) = fault {
            faults.add(at, message, cure);
            return;
        }
    }
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

fn named(parameters: &[OwnedParameter], values: &[f64]) -> String {
    let pairs = parameters.iter().zip(values);
    let shown: Vec<String> = pairs
        .map(|(p, v)| format!("{} = {v:.4}", p.symbol))
        .collect();
    shown.join(", ")
}

/// Power of the parts of a load at rest, as an expression sees it.
fn variables([voltage, deviation, time_s, reactive]: [f64; 4]) -> [f64; VARIABLES] {
    const MOTOR_SHARE: f64 = 0.4;
    const MOTOR_REACTIVE: f64 = 0.2;
    [
        voltage,
        deviation,
        time_s,
        reactive,
        MOTOR_SHARE * voltage,
        MOTOR_REACTIVE * voltage * voltage,
        (1.0 - MOTOR_SHARE) * voltage,
    ]
}

/// What moves at rest.
fn moved_at_rest(
    formulas: &Formulas,
    parameters: &[OwnedParameter],
    states: &[(String, String)],
    p: &[f64],
) -> Option<(String, String)> {
    for reactive in REACTIVE_AT_REST {
        let mut x = [0.0; STATES_MAX];
        formulas.at_rest(p, reactive, &mut x);
        let with = format!("with {}, q0 = {reactive}", named(parameters, p));
        let slopes = formulas.slopes::<f64, STATES_MAX>(p, &x, [1.0, 0.0], reactive);
        let still = |s: &f64| s.abs() <= NO_SLOPE;
        let moved = slopes
            .iter()
            .zip(&formulas.moving)
            .position(|(s, _)| !still(s));
        if let Some(k) = moved {
            let state = formulas.moving[k];
            let message = format!(
                "at rest state `{}` changes by {:e} per s {with}",
                states.get(state).map_or("", |(name, _)| name.as_str()),
                slopes[k]
            );
            let cure = "its derivative must be 0 at v = 1, df = 0 and its initial value";
            return Some((message, cure.to_owned()));
        }
        let conditions = formulas.conditions_at_rest(p, &x, reactive);
        let holds = |c: &&f64| **c > 0.0 || c.is_nan();
        if let Some(value) = conditions.iter().find(holds) {
            let message = format!("at rest the condition of a timer or latch is {value} {with}");
            let cure = "it must be 0 at v = 1, df = 0: narrow the bounds of its threshold";
            return Some((message, cure.to_owned()));
        }
        let power = formulas.added_power(p, &x, variables([1.0, 0.0, 0.0, reactive]));
        for (name, value) in ["active", "reactive"].iter().zip(power) {
            if value.abs() > NOTHING || value.is_nan() {
                let message = format!("at rest the {name} power added is {value:e} {with}");
                let cure = "it must be 0 at v = 1, df = 0, t = 0; a factor must be 1: subtract its \
                            value there, `v^a - 1`";
                return Some((message, cure.to_owned()));
            }
        }
    }
    None
}

/// What is wrong in a dip with a change of frequency.
fn driven(
    formulas: &Formulas,
    parameters: &[OwnedParameter],
    p: &[f64],
    is_neutral: bool,
) -> Option<(String, String)> {
    const REACTIVE: f64 = 0.3;
    let mut x = [0.0; STATES_MAX];
    formulas.at_rest(p, REACTIVE, &mut x);
    let substeps = (formulas.rate_per_s(p) * STEP_S / 0.5)
        .ceil()
        .clamp(1.0, 64.0);
    for k in 0..STEPS {
        let time_s = f64::from(k) * STEP_S;
        let (voltage, deviation) = dip(time_s);
        let given = variables([voltage, deviation, time_s, REACTIVE]);
        let power = formulas.added_power(p, &x, given);
        let with = || {
            let named = named(parameters, p);
            format!("at v = {voltage:.3}, df = {deviation:.4}, t = {time_s:.3} s with {named}")
        };
        for (name, value) in ["active", "reactive"].iter().zip(power) {
            if !value.is_finite() {
                let message = format!("the {name} power is {value} {}", with());
                let cure = "guard divisions, roots and logarithms with `max` or `clip`";
                return Some((message, cure.to_owned()));
            }
            if is_neutral && value.abs() > NOTHING {
                let message = format!(
                    "with neutral amplitudes the {name} power is {value:e} {}",
                    with()
                );
                let cure = "multiply every term by an amplitude, so that the effect can be absent";
                return Some((message, cure.to_owned()));
            }
        }
        let (next, _) = dip(time_s + STEP_S);
        let step = Step {
            duration_s: STEP_S / substeps,
            phasor: [[voltage, 0.0], [0.5 * (voltage + next), 0.0], [next, 0.0]],
            motor_phasor: [[voltage, 0.0], [0.5 * (voltage + next), 0.0], [next, 0.0]],
            voltage: [voltage, 0.5 * (voltage + next), next],
            frequency_deviation: deviation,
        };
        let mut done = 0.0;
        while done < substeps {
            formulas.advance(p, &mut x[..formulas.states], &step, REACTIVE);
            done += 1.0;
        }
    }
    None
}

/// Voltage and frequency deviation: a deep dip, a slow recovery, a swell.
fn dip(time_s: f64) -> (f64, f64) {
    let voltage = if time_s < 0.1 {
        1.0
    } else if time_s < 0.3 {
        0.45
    } else if time_s < 0.8 {
        0.9 + 0.2 * (time_s - 0.3)
    } else {
        1.08
    };
    (voltage, 0.01 * (9.0 * time_s).sin())
}
