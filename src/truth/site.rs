//! A whole synthetic site: several events at one load, each at its own operating point.

use std::f64::consts::TAU;

use super::{
    BadSamples, EventPlan, IntegratorOptions, LoadBaseParameters, MotorCircuit, Network, Phasor,
    Random, TruthError, Zip,
    load::{Load, Part},
    motor::Motor,
    network::Grid,
    pmu::Pmu,
    simulation::{Node, Simulation},
    static_load::StaticLoad,
};
use crate::measurement::{Record, Site};

/// 2026-01-05 03:07:00 UTC, the first event's window; the others follow by [`SPACING_NS`].
const FIRST_START_NS: i64 = 1_767_582_420_000_000_000;
/// 25 hours and 7 minutes: events fall into every hour of the day.
const SPACING_NS: i64 = 90_420_000_000_000;
/// Angle of the terminal voltage before an event, radians: any would do.
const INITIAL_ANGLE_RAD: f64 = -0.32;
/// Share of the events that hold bad samples, where they are wanted.
const BAD_SHARE: f64 = 0.45;

/// What a synthetic site shall be like.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteOptions {
    /// The site and its bases.
    pub site: Site,
    /// Seed of every random number.
    pub seed: u64,
    /// Number of events, 1 to 99; default 11.
    pub events: usize,
    /// Reports per second, 10 to 240; default 60.
    pub rate_fps: f64,
    /// Length of a window, 4 to 120 s; default 10.
    pub duration_s: f64,
    /// Relative noise of the phasors, 0 to 0.05; default 0.0005.
    pub noise: f64,
    /// Width of the PMU's window in nominal cycles, 0 to 6, 0 for none; default 2.
    pub filter_cycles: f64,
    /// Mean active power of the load, pu, 0.05 to 2; default 0.9.
    pub active_pu: f64,
    /// Mean reactive power of the load, pu, -1 to 2; default 0.45.
    pub reactive_pu: f64,
    /// Half-width of the range of the operating point, 0 to 0.5; default 0.12.
    pub level_spread: f64,
    /// Range of the voltage before an event, pu, within 0.8 to 1.2; default 0.985 to 1.005.
    pub voltage_range_pu: (f64, f64),
    /// Standard deviation of the motor's share and of the ZIP shares from event to event, 0 to 0.2;
    /// default 0.02.
    pub composition_spread: f64,
    /// Whether some events hold bad samples; default yes.
    pub bad_samples: bool,
    /// Share of P that motors draw before an event, 0 to 0.95; default 0.45.
    pub motor_share: f64,
    /// The motors, on their own base.
    pub motor: MotorCircuit,
    /// The static load.
    pub zip: Zip,
    /// The grid.
    pub network: Network,
    /// Accuracy of the integration.
    pub integrator: IntegratorOptions,
}

impl SiteOptions {
    /// The defaults for `site` and `seed`.
    #[must_use]
    pub fn new(site: Site, seed: u64) -> Self {
        Self {
            site,
            seed,
            events: 11,
            rate_fps: 60.0,
            duration_s: 10.0,
            noise: 5e-4,
            filter_cycles: 2.0,
            active_pu: 0.9,
            reactive_pu: 0.45,
            level_spread: 0.12,
            voltage_range_pu: (0.985, 1.005),
            composition_spread: 0.02,
            bad_samples: true,
            motor_share: 0.45,
            motor: MotorCircuit::default(),
            zip: Zip {
                active_impedance: 0.35,
                active_current: 0.35,
                reactive_impedance: 0.6,
                reactive_current: 0.2,
            },
            network: Network::default(),
            integrator: IntegratorOptions::default(),
        }
    }

    fn check(&self) -> Result<(), TruthError> {
        let ranges = self
            .measurement_ranges()
            .into_iter()
            .chain(self.load_ranges())
            .chain(self.voltage_ranges());
        for (option, given, low, high, required) in ranges {
            if !(low..=high).contains(&given) {
                return Err(TruthError::OptionOutOfRange {
                    option,
                    given,
                    required,
                });
            }
        }
        Ok(())
    }

    fn measurement_ranges(&self) -> [Range; 8] {
        let site = &self.site;
        [
            ("events", self.events as f64, 1.0, 99.0, "1 to 99"),
            ("rate", self.rate_fps, 10.0, 240.0, "10 to 240 frames/s"),
            ("duration", self.duration_s, 4.0, 120.0, "4 to 120 s"),
            ("noise", self.noise, 0.0, 0.05, "0 to 0.05"),
            ("filter cycles", self.filter_cycles, 0.0, 6.0, "0 to 6"),
            (
                "nominal frequency",
                site.nominal_hz,
                16.0,
                400.0,
                "16 to 400 Hz",
            ),
            (
                "power base",
                site.s_base_mva,
                1e-6,
                1e6,
                "0.000001 to 1000000 MVA",
            ),
            (
                "voltage base",
                site.v_base_kv,
                1e-3,
                2e3,
                "0.001 to 2000 kV",
            ),
        ]
    }

    fn voltage_ranges(&self) -> [Range; 2] {
        let (lowest, highest) = self.voltage_range_pu;
        let range = "0.8 to 1.2 pu";
        [
            ("lowest voltage before an event", lowest, 0.8, 1.2, range),
            ("highest voltage before an event", highest, 0.8, 1.2, range),
        ]
    }

    fn load_ranges(&self) -> [Range; 13] {
        let motor = &self.motor;
        let reactance = "0.001 to 100 pu";
        [
            ("active power", self.active_pu, 0.05, 2.0, "0.05 to 2 pu"),
            ("reactive power", self.reactive_pu, -1.0, 2.0, "-1 to 2 pu"),
            ("level spread", self.level_spread, 0.0, 0.5, "0 to 0.5"),
            (
                "composition spread",
                self.composition_spread,
                0.0,
                0.2,
                "0 to 0.2",
            ),
            ("motor share", self.motor_share, 0.0, 0.95, "0 to 0.95"),
            (
                "motor inertia",
                motor.inertia_s,
                1e-3,
                100.0,
                "0.001 to 100 s",
            ),
            (
                "stator resistance",
                motor.stator_resistance,
                0.0,
                1.0,
                "0 to 1 pu",
            ),
            (
                "rotor resistance",
                motor.rotor_resistance,
                1e-4,
                1.0,
                "0.0001 to 1 pu",
            ),
            (
                "stator reactance",
                motor.stator_reactance,
                1e-3,
                100.0,
                reactance,
            ),
            (
                "rotor reactance",
                motor.rotor_reactance,
                1e-3,
                100.0,
                reactance,
            ),
            (
                "magnetising reactance",
                motor.magnetising_reactance,
                1e-3,
                100.0,
                reactance,
            ),
            ("load factor", motor.load_factor, 1e-2, 2.0, "0.01 to 2"),
            (
                "tolerance",
                self.integrator.tolerance,
                1e-14,
                1e-2,
                "1e-14 to 0.01",
            ),
        ]
    }
}

/// Name, value, least, largest, and the range in words.
type Range = (&'static str, f64, f64, f64, &'static str);

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
    /// The paper's motor parameters on the load base.
    pub motor: LoadBaseParameters,
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
/// [`TruthError::OptionOutOfRange`] before anything is computed; the others when motors or grid
/// cannot carry the load asked for.
pub fn generate(
    options: &SiteOptions,
    progress: &mut dyn FnMut(usize),
) -> Result<SyntheticSite, TruthError> {
    options.check()?;
    let mut random = Random::for_part(options.seed, 0);
    let plans = EventPlan::draw(options.events, &mut random);
    let (mut records, mut truth) = (Vec::new(), Vec::new());
    for (index, plan) in plans.into_iter().enumerate() {
        let mut random = Random::for_part(options.seed, 1 + index as u64);
        let point = OperatingPoint::draw(options, &mut random);
        let (record, event) = one_event(options, plan, point, index, &mut random)?;
        records.push(record);
        truth.push(event);
        progress(index + 1);
    }
    let active_pu = options.active_pu * options.motor_share;
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

/// The load before one event.
#[derive(Clone, Copy, Debug)]
struct OperatingPoint {
    voltage: Phasor,
    power: Phasor,
    motor_share: f64,
    zip: Zip,
}

impl OperatingPoint {
    fn draw(options: &SiteOptions, random: &mut Random) -> Self {
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
        Self {
            voltage: Phasor::from_polar(random.between(lowest_pu, highest_pu), INITIAL_ANGLE_RAD),
            power,
            motor_share,
            zip,
        }
    }

    /// The load at this point: static part and motors.
    fn load(&self, options: &SiteOptions) -> Result<Load, TruthError> {
        let mut parts: Vec<Box<dyn Part>> = Vec::new();
        let mut rest = self.power;
        if self.motor_share > 0.0 {
            let active_pu = self.motor_share * self.power.re;
            let motor = Motor::at_operating_point(
                options.motor,
                active_pu,
                self.voltage,
                nominal_rad_s(options),
            )?;
            let current = motor.current(self.voltage, &motor.initial_state());
            rest -= self.voltage * current.conj();
            parts.push(Box::new(motor));
        }
        parts.push(Box::new(StaticLoad {
            zip: self.zip,
            initial_voltage_pu: self.voltage.norm(),
            initial: rest,
        }));
        Ok(Load { parts })
    }
}

fn one_event(
    options: &SiteOptions,
    plan: EventPlan,
    point: OperatingPoint,
    index: usize,
    random: &mut Random,
) -> Result<(Record, EventTruth), TruthError> {
    let pmu = Pmu {
        rate_fps: options.rate_fps,
        nominal_hz: options.site.nominal_hz,
        filter_cycles: options.filter_cycles,
        noise: options.noise,
    };
    let current = (point.power / point.voltage).conj();
    let nominal_rad_s = nominal_rad_s(options);
    let grid = Grid::at_operating_point(options.network, point.voltage, current, nominal_rad_s);
    let switchings = plan.switchings(&grid, point.voltage, current, options.site.nominal_hz);
    let load = point.load(options)?;
    let nodes = Simulation::new(grid, load, point.voltage, options.integrator)
        .run(options.duration_s + pmu.margin_s(), &switchings)?;

    let start_ns = FIRST_START_NS + SPACING_NS * i64::try_from(index).unwrap_or(0);
    let mut record = pmu.record(&nodes, start_ns, sample_count(options), random);
    let bad_samples = bad_samples(options, &plan, random);
    let frequency_range_hz = frequency_range(&record);
    if let Some(bad) = bad_samples {
        bad.apply(&mut record);
    }
    let truth = EventTruth {
        plan,
        voltage_pu: point.voltage.norm(),
        active_pu: point.power.re,
        reactive_pu: point.power.im,
        motor_share: point.motor_share,
        zip: point.zip,
        motor: options
            .motor
            .on_load_base(point.motor_share * point.power.re, nominal_rad_s),
        lowest_voltage_pu: lowest_voltage(&nodes),
        frequency_range_hz,
        bad_samples,
    };
    Ok((record, truth))
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "rate and duration are checked: at most 240 x 120"
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
mod tests {
    use super::*;

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
