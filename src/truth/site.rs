//! A whole synthetic site: several events at one load, each at its own operating point.

use std::f64::consts::TAU;

use super::{
    BadSamples, Effect, EventKind, EventPlan, HiddenEffect, LoadBaseParameters, Operation,
    PartPower, Phasor, Random, SiteOptions, TruthError, Zip,
    compose::{Composed, OperatingPoint, compose, motor_groups},
    excitation::{Excitation, Need},
    network::Grid,
    pmu::Pmu,
    simulation::{Node, Simulation},
};
use crate::measurement::Record;

/// 2026-01-05 03:07:00 UTC, the first event's window; the others follow by [`SPACING_NS`].
const FIRST_START_NS: i64 = 1_767_582_420_000_000_000;
/// 25 hours and 7 minutes: events fall into every hour of the day.
const SPACING_NS: i64 = 90_420_000_000_000;
/// Angle of the terminal voltage before an event, radians: any would do.
const INITIAL_ANGLE_RAD: f64 = -0.32;
/// Share of the events that hold bad samples, where they are wanted.
const BAD_SHARE: f64 = 0.45;
/// By how much a dip that missed its aim is made deeper or milder.
const CORRECTION: f64 = 0.05;
/// How often.
const CORRECTIONS_MAX: usize = 6;

/// What is true of one event.
#[derive(Clone, Debug, PartialEq)]
pub struct EventTruth {
    /// What happened.
    pub plan: EventPlan,
    /// Voltage before the event, pu.
    pub voltage_pu: f64,
    /// Active power before the event, pu.
    pub active_pu: f64,
    /// Reactive power before the event, pu.
    pub reactive_pu: f64,
    /// Share of P that motors drew before the event.
    pub motor_share: f64,
    /// The static load.
    pub zip: Zip,
    /// The paper's parameters of all motors but those of effects, on the load base.
    pub motor: LoadBaseParameters,
    /// What each part of the load drew before the event.
    pub powers: Vec<PartPower>,
    /// What relays and controllers did.
    pub operations: Vec<Operation>,
    /// The hidden effects that act in this event.
    pub showing: Vec<Effect>,
    /// Lowest voltage at the terminals, before filter and noise, pu.
    pub lowest_voltage_pu: f64,
    /// Lowest and highest frequency that the PMU reported, Hz.
    pub frequency_range_hz: (f64, f64),
    /// Bad samples.
    pub bad_samples: Option<BadSamples>,
}

/// A synthetic site.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntheticSite {
    /// What was asked for.
    pub options: SiteOptions,
    /// The paper's motor parameters on the load base at the mean operating point.
    pub motor: LoadBaseParameters,
    /// One record per event.
    pub records: Vec<Record>,
    /// What is true of each, in the same order.
    pub truth: Vec<EventTruth>,
}

/// Makes a site. The same options give the same bytes.
///
/// `progress` is called after every event with the number of events done.
///
/// # Errors
///
/// [`TruthError::OptionOutOfRange`], [`TruthError::ParameterOutOfRange`] and
/// [`TruthError::EffectTwice`] before anything is computed; the others when motors or grid cannot
/// carry the load asked for.
pub fn generate(
    options: &SiteOptions,
    progress: &mut dyn FnMut(usize),
) -> Result<SyntheticSite, TruthError> {
    options.check()?;
    let excitation = Excitation::of(&options.effects, options.excited);
    let mut random = Random::for_part(options.seed, 0);
    let plans = EventPlan::draw(options.events, options.retained, &excitation, &mut random);
    let (mut records, mut truth) = (Vec::new(), Vec::new());
    for (index, mut plan) in plans.into_iter().enumerate() {
        if options.excited {
            plan.outlast(longest_delay_s(&excitation), options.site.nominal_hz);
        }
        let mut random = Random::for_part(options.seed, 1 + index as u64);
        let point = drawn_point(options, &mut random);
        let (record, event) = Event {
            options,
            point,
            index,
        }
        .record(plan, &mut random)?;
        records.push(record);
        truth.push(event);
        progress(index + 1);
    }
    let active_pu = options.active_pu * options.motor_share * motor_groups(&options.effects).0;
    Ok(SyntheticSite {
        options: options.clone(),
        motor: options
            .motor
            .on_load_base(active_pu, nominal_rad_s(options)),
        records,
        truth,
    })
}

fn nominal_rad_s(options: &SiteOptions) -> f64 {
    TAU * options.site.nominal_hz
}

fn longest_delay_s(excitation: &Excitation) -> f64 {
    let delays = excitation.needs.iter().map(|need| match need {
        Need::Dips(threshold) => threshold.lasting_s,
        _ => 0.0,
    });
    delays.fold(0.0, f64::max)
}

fn drawn_point(options: &SiteOptions, random: &mut Random) -> OperatingPoint {
    let level = 1.0 + random.between(-options.level_spread, options.level_spread);
    let mut varied = |value: f64| value * (1.0 + options.composition_spread * random.normal());
    let power = Phasor::new(
        options.active_pu * level,
        varied(options.reactive_pu * level),
    );
    let motor_share = varied(options.motor_share).clamp(0.0, 0.95);
    let zip = Zip {
        active_impedance: varied(options.zip.active_impedance),
        active_current: varied(options.zip.active_current),
        reactive_impedance: varied(options.zip.reactive_impedance),
        reactive_current: varied(options.zip.reactive_current),
    };
    let (lowest_pu, highest_pu) = options.voltage_range_pu;
    OperatingPoint {
        voltage: Phasor::from_polar(random.between(lowest_pu, highest_pu), INITIAL_ANGLE_RAD),
        power,
        motor_share,
        zip,
    }
}

/// One event of a site.
struct Event<'a> {
    options: &'a SiteOptions,
    point: OperatingPoint,
    index: usize,
}

/// What a simulation gave.
struct Run {
    nodes: Vec<Node>,
    operations: Vec<Operation>,
    powers: Vec<PartPower>,
}

impl Event<'_> {
    fn record(
        &self,
        mut plan: EventPlan,
        random: &mut Random,
    ) -> Result<(Record, EventTruth), TruthError> {
        let (options, point) = (self.options, &self.point);
        let run = self.run_until_aim_is_met(&mut plan)?;
        let pmu = pmu(options);
        let start_ns = FIRST_START_NS + SPACING_NS * i64::try_from(self.index).unwrap_or(0);
        let mut record = pmu.record(&run.nodes, start_ns, sample_count(options), random);
        let bad_samples = bad_samples(options, &plan, random);
        let frequency_range_hz = frequency_range(&record);
        if let Some(bad) = bad_samples {
            bad.apply(&mut record);
        }
        let motors_pu = point.motor_share * point.power.re * motor_groups(&options.effects).0;
        let mut truth = EventTruth {
            plan,
            voltage_pu: point.voltage.norm(),
            active_pu: point.power.re,
            reactive_pu: point.power.im,
            motor_share: point.motor_share,
            zip: point.zip,
            motor: options
                .motor
                .on_load_base(motors_pu, nominal_rad_s(options)),
            lowest_voltage_pu: lowest_voltage(&run.nodes),
            powers: run.powers,
            operations: run.operations,
            showing: Vec::new(),
            frequency_range_hz,
            bad_samples,
        };
        let hidden = options.effects.iter();
        truth.showing = hidden
            .filter(|hidden| acts(hidden, &truth))
            .map(HiddenEffect::effect)
            .collect();
        Ok((record, truth))
    }

    /// Simulates the event, and again deeper or milder while its dip has missed its aim. A dip that
    /// the grid cannot carry is made milder, too.
    fn run_until_aim_is_met(&self, plan: &mut EventPlan) -> Result<Run, TruthError> {
        let mut outcome = self.run(plan);
        for _ in 0..CORRECTIONS_MAX {
            let again = match &outcome {
                Ok(run) => plan.correct(self.has_acted(plan, run), CORRECTION),
                Err(TruthError::NoNetworkSolution { .. } | TruthError::StepTooSmall { .. })
                    if plan.kind.is_fault() =>
                {
                    plan.retained = (plan.retained + 2.0 * CORRECTION).min(0.96);
                    true
                }
                Err(_) => false,
            };
            if !again {
                break;
            }
            let before = outcome;
            outcome = self.run(plan);
            // Deeper than the grid can carry: the last dip that it could is kept.
            if outcome.is_err() && before.is_ok() {
                plan.retained += CORRECTION;
                return before;
            }
        }
        outcome
    }

    fn has_acted(&self, plan: &EventPlan, run: &Run) -> bool {
        let Some((effect, _)) = plan.target else {
            return false;
        };
        let hidden = self.options.effects.iter().find(|h| h.effect() == effect);
        hidden.is_some_and(|hidden| operated(hidden, &run.operations, lowest_voltage(&run.nodes)))
    }

    fn run(&self, plan: &EventPlan) -> Result<Run, TruthError> {
        let (options, point) = (self.options, &self.point);
        let nominal_rad_s = nominal_rad_s(options);
        let current = (point.power / point.voltage).conj();
        let grid = Grid::at_operating_point(options.network, point.voltage, current, nominal_rad_s);
        let switchings = plan.switchings(&grid, point.voltage, current, options.site.nominal_hz);
        let Composed {
            load,
            terminal,
            powers,
        } = compose(point, options.motor, &options.effects, nominal_rad_s)?;
        let mut simulation = Simulation::new(grid, load, terminal, options.integrator);
        let end_s = options.duration_s + pmu(options).margin_s();
        let nodes = simulation.run(end_s, &switchings)?;
        Ok(Run {
            nodes,
            operations: simulation.log,
            powers,
        })
    }
}

/// Whether a relay of the effect has operated, or its law has changed.
fn operated(hidden: &HiddenEffect, operations: &[Operation], lowest_voltage_pu: f64) -> bool {
    if hidden.effect() == Effect::LowVoltageConversion {
        return lowest_voltage_pu < hidden.value("below_pu");
    }
    let name = hidden.effect().name();
    operations.iter().any(|operation| operation.part == name)
}

/// Whether the effect shows in the event: a relay has operated, the frequency or the voltage has
/// stayed away, or the dip was deep enough for effects that are there at any depth.
fn acts(hidden: &HiddenEffect, truth: &EventTruth) -> bool {
    let kind = truth.plan.kind;
    let deep = truth.lowest_voltage_pu < DEEP * truth.voltage_pu;
    let stays = !matches!(kind, EventKind::Fault);
    match hidden.effect() {
        Effect::LoadRamp | Effect::RatioPhaseError | Effect::FrequencyTracking => true,
        Effect::ExponentialRecovery => stays,
        Effect::Saturation => stays || deep,
        Effect::FrequencyTrip => truth
            .operations
            .iter()
            .any(|o| o.part == hidden.effect().name()),
        effect => match Need::of(hidden) {
            Need::Dips(_) | Need::Sustained => {
                operated(hidden, &truth.operations, truth.lowest_voltage_pu)
            }
            Need::Frequency => {
                let moved = matches!(kind, EventKind::GeneratorTrip | EventKind::LoadRejection);
                moved || (deep && effect == Effect::SpeedDependentTorque)
            }
            Need::Depths | Need::Nothing => deep,
        },
    }
}

/// Voltage over that before the event below which effects without a threshold show.
const DEEP: f64 = 0.85;

fn pmu(options: &SiteOptions) -> Pmu {
    let mut pmu = Pmu::sound(
        options.rate_fps,
        options.site.nominal_hz,
        options.filter_cycles,
        options.noise,
    );
    for hidden in &options.effects {
        match hidden.effect() {
            Effect::TimeSkew => pmu.skew_s = hidden.value("skew_s"),
            Effect::PhasorWindow => pmu.filter_cycles = hidden.value("cycles"),
            Effect::RatioPhaseError => {
                pmu.angle_error_rad = hidden.value("angle_deg").to_radians();
            }
            Effect::FrequencyTracking => {
                pmu.frequency_lag_s = hidden.value("lag_s");
                pmu.frequency_span_cycles = hidden.value("span_cycles");
            }
            _ => {}
        }
    }
    pmu
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "rate and duration are checked: at most 240 x 600"
)]
fn sample_count(options: &SiteOptions) -> usize {
    (options.duration_s * options.rate_fps).round() as usize + 1
}

/// Bad samples for about half of the events, from half a second after the onset on.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "rate and onset are checked: far below the range of usize, and positive"
)]
fn bad_samples(options: &SiteOptions, plan: &EventPlan, random: &mut Random) -> Option<BadSamples> {
    let earliest = ((plan.onset_s + 0.5) * options.rate_fps) as usize;
    let wanted = random.uniform() < BAD_SHARE;
    let drawn = BadSamples::draw(random, earliest, sample_count(options));
    drawn.filter(|_| wanted && options.bad_samples)
}

fn lowest_voltage(nodes: &[Node]) -> f64 {
    nodes
        .iter()
        .map(|node| node.voltage.norm())
        .fold(f64::INFINITY, f64::min)
}

fn frequency_range(record: &Record) -> (f64, f64) {
    record
        .samples
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), sample| {
            (low.min(sample.frequency_hz), high.max(sample.frequency_hz))
        })
}

#[cfg(test)]
mod hidden_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::Site;

    fn options(seed: u64) -> SiteOptions {
        let site = Site {
            name: "synthetic".to_owned(),
            s_base_mva: 200.0,
            v_base_kv: 23.0,
            nominal_hz: 60.0,
        };
        SiteOptions {
            events: 3,
            duration_s: 4.0,
            ..SiteOptions::new(site, seed)
        }
    }

    fn made(options: &SiteOptions) -> SyntheticSite {
        generate(options, &mut |_| ()).unwrap()
    }

    /// The records as bits: missing values compare as equal.
    fn bits(site: &SyntheticSite) -> Vec<[u64; 5]> {
        let samples = site.records.iter().flat_map(|record| &record.samples);
        samples
            .map(|s| {
                [
                    s.voltage_pu,
                    s.angle_rad,
                    s.frequency_hz,
                    s.active_pu,
                    s.reactive_pu,
                ]
                .map(f64::to_bits)
            })
            .collect()
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes_and_another_seed_another_site() {
        let first = made(&options(1));
        assert_eq!(bits(&first), bits(&made(&options(1))));
        assert_ne!(bits(&first), bits(&made(&options(2))));
    }

    #[test]
    fn windows_begin_at_their_operating_point_and_faults_reach_their_depth() {
        let quiet = SiteOptions {
            noise: 0.0,
            bad_samples: false,
            ..options(3)
        };
        let site = made(&quiet);
        for (record, truth) in site.records.iter().zip(&site.truth) {
            let first = record.samples[0];
            assert!((first.voltage_pu - truth.voltage_pu).abs() < 1e-9);
            assert!((first.active_pu - truth.active_pu).abs() < 1e-9);
            assert!((first.reactive_pu - truth.reactive_pu).abs() < 1e-9);
            assert!((first.frequency_hz - 60.0).abs() < 1e-6);
            if truth.plan.kind.is_fault() {
                let kept = truth.lowest_voltage_pu / truth.voltage_pu;
                // The fault is sized for a load like an impedance; motors pull it further down.
                assert!((kept - truth.plan.retained).abs() < 0.15, "{truth:?}");
            }
        }
    }

    #[test]
    fn a_generator_trip_lowers_the_frequency_and_the_voltage_recovers_after_faults() {
        let site = made(&SiteOptions {
            noise: 0.0,
            bad_samples: false,
            duration_s: 6.0,
            ..options(4)
        });
        let (lowest, _) = site.truth[2].frequency_range_hz;
        assert!((59.2..59.9).contains(&lowest), "{lowest}");
        let last = site.records[0].samples[360];
        let ratio = last.voltage_pu / site.truth[0].voltage_pu;
        assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
        let active = last.active_pu / site.truth[0].active_pu;
        assert!((active - 1.0).abs() < 0.05, "{active}");
    }

    #[test]
    fn the_operating_point_stays_within_its_spread() {
        let site = made(&SiteOptions {
            events: 8,
            ..options(5)
        });
        for truth in &site.truth {
            let level = truth.active_pu / 0.9;
            assert!((level - 1.0).abs() <= 0.12, "{level}");
        }
    }

    #[test]
    fn the_defaults_lie_inside_the_papers_box() {
        let site = made(&options(6));
        let inside = |value: f64, low: f64, high: f64| assert!((low..=high).contains(&value));
        for motor in site
            .truth
            .iter()
            .map(|truth| truth.motor)
            .chain([site.motor])
        {
            inside(motor.inertia, 0.001, 10.0);
            inside(motor.transient_open_circuit_time_constant_s, 0.001, 4.0);
            inside(motor.reactance, 0.001, 4.0);
            inside(motor.transient_reactance, 0.001, 4.0);
        }
        for zip in site.truth.iter().map(|truth| truth.zip) {
            inside(zip.active_impedance, 0.1, 0.9);
            inside(1.0 - zip.active_impedance - zip.active_current, 0.1, 0.9);
            inside(zip.reactive_impedance, 0.1, 0.9);
            inside(
                1.0 - zip.reactive_impedance - zip.reactive_current,
                0.1,
                4.0,
            );
        }
    }

    #[test]
    fn an_option_out_of_range_is_named() {
        let wrong = SiteOptions {
            noise: 0.5,
            ..options(1)
        };
        let error = generate(&wrong, &mut |_| ()).unwrap_err();
        assert_eq!(error.to_string(), "noise must be 0 to 0.05, got 0.5");
        let nan = SiteOptions {
            duration_s: f64::NAN,
            ..options(1)
        };
        assert!(generate(&nan, &mut |_| ()).is_err());
    }

    #[test]
    fn progress_is_told_after_every_event() {
        let mut told = Vec::new();
        generate(&options(1), &mut |done| told.push(done)).unwrap();
        assert_eq!(told, [1, 2, 3]);
    }
}
