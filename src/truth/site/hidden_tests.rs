//! What hidden effects do in whole events.

use super::*;
use crate::{measurement::Site, truth::IntegratorOptions};

const ONSET_S: f64 = 1.0;

fn options(effects: Vec<HiddenEffect>) -> SiteOptions {
    let site = Site {
        name: "synthetic".to_owned(),
        s_base_mva: 200.0,
        v_base_kv: 23.0,
        nominal_hz: 60.0,
    };
    SiteOptions {
        events: 3,
        duration_s: 4.0,
        noise: 0.0,
        bad_samples: false,
        effects,
        integrator: IntegratorOptions {
            tolerance: 1e-8,
            ..IntegratorOptions::default()
        },
        ..SiteOptions::new(site, 21)
    }
}

fn hidden(effect: Effect, values: &[(&str, &str)]) -> HiddenEffect {
    let mut hidden = HiddenEffect::drawn(effect, 21);
    for (name, value) in values {
        hidden.set(name, value).unwrap();
    }
    hidden
}

fn plan(kind: EventKind, retained: f64, amount: f64) -> EventPlan {
    EventPlan {
        kind,
        onset_s: ONSET_S,
        retained,
        cycles: if kind.is_fault() { 6.0 } else { 0.0 },
        reclose_s: 0.7,
        amount,
        target: None,
    }
}

fn fault(retained: f64) -> EventPlan {
    plan(EventKind::Fault, retained, 0.0)
}

/// Nodes and operations of one event at the mean operating point.
fn run(options: &SiteOptions, plan: &EventPlan) -> Run {
    let point = OperatingPoint {
        voltage: Phasor::from_polar(1.0, INITIAL_ANGLE_RAD),
        power: Phasor::new(options.active_pu, options.reactive_pu),
        motor_share: options.motor_share,
        zip: options.zip,
    };
    let event = Event {
        options,
        point,
        index: 0,
    };
    event.run(plan).unwrap()
}

fn power_at(run: &Run, time_s: f64) -> Phasor {
    let next = run.nodes.partition_point(|node| node.time_s <= time_s);
    let node = run.nodes[next - 1];
    node.voltage * node.current.conj()
}

/// What the PMU of `options` makes of an event without noise.
fn measured(options: &SiteOptions, plan: &EventPlan) -> Record {
    let run = run(options, plan);
    pmu(options).record(&run.nodes, 0, sample_count(options), &mut Random::new(1))
}

fn powers(run: &Run, part: &str) -> Phasor {
    let own = run.powers.iter().filter(|power| power.part == part);
    own.map(|power| Phasor::new(power.active_pu, power.reactive_pu))
        .sum()
}

fn close(a: Phasor, b: Phasor, tolerance: f64) {
    assert!((a - b).norm() < tolerance, "{a} {b}");
}

#[test]
fn every_effect_starts_at_rest_shows_where_it_shall_and_comes_back_the_same() {
    for effect in Effect::ALL {
        let hiding = SiteOptions {
            events: 2,
            ..options(vec![HiddenEffect::drawn(effect, 5)])
        }
        .leaving_room();
        let site = generate(&hiding, &mut |_| ()).unwrap_or_else(|e| panic!("{effect:?}: {e}"));
        let again = generate(&hiding, &mut |_| ()).unwrap();
        let shows = site.truth.iter().any(|truth| truth.showing == [effect]);
        assert!(shows || effect == Effect::TapChanger, "{effect:?}");
        for ((record, truth), same) in site.records.iter().zip(&site.truth).zip(&again.records) {
            let bits = |record: &Record| -> Vec<_> {
                let samples = record.samples.iter();
                samples
                    .map(|s| (s.voltage_pu.to_bits(), s.active_pu.to_bits()))
                    .collect()
            };
            assert_eq!(bits(record), bits(same), "{effect:?}");
            let first = record.samples[0];
            let drawn = Phasor::new(truth.active_pu, truth.reactive_pu);
            let seen = Phasor::new(first.active_pu, first.reactive_pu);
            // An angle error is all that may turn the power, a ramp all that may move it.
            let expected = match effect {
                Effect::RatioPhaseError => {
                    let angle = hiding.effects[0].value("angle_deg").to_radians();
                    drawn * Phasor::from_polar(1.0, -angle)
                }
                _ => drawn,
            };
            let drift = if effect == Effect::LoadRamp {
                1e-3
            } else {
                1e-8
            };
            assert!(
                (seen - expected).norm() < drift,
                "{effect:?} {seen} {expected}"
            );
            let early = record.samples[40];
            let moved = (early.active_pu - first.active_pu).abs();
            assert!(
                moved < 1e-8 || effect == Effect::LoadRamp,
                "{effect:?} {moved}"
            );
        }
    }
}

#[test]
fn an_effect_of_size_zero_leaves_the_plain_event() {
    let plain = options(Vec::new());
    let plan = plan(EventKind::FaultAndLineTrip, 0.6, 1.2);
    let reference = measured(&plain, &plan);
    let neutral: [(Effect, &[(&str, &str)]); 17] = [
        (Effect::StatorResistance, &[("resistance_pu", "0")]),
        (
            Effect::StaticFrequencyDependence,
            &[("active", "0"), ("reactive", "0")],
        ),
        (Effect::SecondMotor, &[("share_of_motors", "0")]),
        (Effect::MotorUndervoltageTrip, &[("share_of_motors", "0")]),
        (Effect::ElectronicLoadDropout, &[("share", "0")]),
        (Effect::SelfDisconnection, &[("share", "0")]),
        (Effect::ExponentialRecovery, &[("share", "0")]),
        (Effect::DistributedGeneration, &[("share", "0")]),
        (Effect::FrequencyTrip, &[("share", "0")]),
        (Effect::SpeedDependentTorque, &[("quadratic", "0")]),
        (
            Effect::FeederImpedance,
            &[
                ("resistance_pu", "0"),
                ("reactance_pu", "0"),
                ("capacitor_pu", "0"),
            ],
        ),
        (
            Effect::TapChanger,
            &[("reactance_pu", "0"), ("first_s", "100")],
        ),
        (Effect::SinglePhaseAcStall, &[("share", "0")]),
        (Effect::LowVoltageConversion, &[("below_pu", "0.05")]),
        (
            Effect::LoadRamp,
            &[("active_per_s", "0"), ("reactive_per_s", "0")],
        ),
        (Effect::TimeSkew, &[("skew_s", "0")]),
        (Effect::RatioPhaseError, &[("angle_deg", "0")]),
    ];
    for (effect, values) in neutral {
        let record = measured(&options(vec![hidden(effect, values)]), &plan);
        for (sample, plain) in record.samples.iter().zip(&reference.samples) {
            let power = Phasor::new(sample.active_pu, sample.reactive_pu);
            let expected = Phasor::new(plain.active_pu, plain.reactive_pu);
            // Relays leave nodes of their own, so that straight lines between nodes differ by 1e-5.
            assert!(
                (power - expected).norm() < 3e-5,
                "{effect:?} {power} {expected}"
            );
        }
    }
}

#[test]
fn events_that_shall_not_show_an_effect_do_not() {
    for effect in [
        Effect::SelfDisconnection,
        Effect::StaticFrequencyDependence,
        Effect::TapChanger,
        Effect::ExponentialRecovery,
        Effect::SecondMotor,
    ] {
        let hiding = SiteOptions {
            excited: false,
            ..options(vec![HiddenEffect::drawn(effect, 9)])
        }
        .leaving_room();
        let site = generate(&hiding, &mut |_| ()).unwrap();
        assert!(
            site.truth.iter().all(|t| t.showing.is_empty()),
            "{effect:?}"
        );
    }
}

#[test]
fn a_block_leaves_exactly_its_delay_after_the_voltage_fell() {
    let block = hidden(
        Effect::SelfDisconnection,
        &[
            ("share", "0.15"),
            ("threshold_pu", "0.8"),
            ("delay_s", "0.0437"),
            ("power_factor", "1"),
        ],
    );
    let run = run(&options(vec![block]), &fault(0.6));
    assert_eq!(run.operations.len(), 1);
    let delay_s = run.operations[0].time_s - ONSET_S;
    assert!((delay_s - 0.0437).abs() < 1e-9, "{delay_s}");
    close(
        powers(&run, "self_disconnection"),
        Phasor::new(0.135, 0.0),
        1e-12,
    );
    // What is left at rest: P0 less the block, within what the higher voltage adds.
    let lost = 0.9 - power_at(&run, 3.9).re;
    assert!((lost - 0.135).abs() < 0.02, "{lost}");
}

#[test]
fn a_block_that_waits_for_the_second_dip_leaves_in_it() {
    let block = hidden(
        Effect::SelfDisconnection,
        &[("threshold_pu", "0.8"), ("delay_s", "0.03"), ("dips", "2")],
    );
    let double = plan(EventKind::DoubleFault, 0.65, 1.1);
    let run = run(&options(vec![block.clone()]), &double);
    // Six cycles of 1/60 s, 0.7 s, and the delay.
    let left_s = run.operations[0].time_s - ONSET_S;
    assert!((left_s - (0.1 + 0.7 + 0.03)).abs() < 1e-9, "{left_s}");
    let site = generate(&options(vec![block]), &mut |_| ()).unwrap();
    let showing = site.truth.iter().filter(|truth| !truth.showing.is_empty());
    assert!(showing.count() >= 2);
}

#[test]
fn a_relay_that_sees_the_voltage_glide_through_its_level_picks_up_on_it() {
    // While the fault lasts motors slow down and the voltage sinks. The level lies where the plain
    // event has it between two nodes.
    let deep = fault(0.7);
    let plain = run(&options(Vec::new()), &deep);
    let magnitude = |time_s: f64| {
        let next = plain.nodes.partition_point(|node| node.time_s <= time_s);
        let (a, b) = (plain.nodes[next - 1], plain.nodes[next]);
        let share = (time_s - a.time_s) / (b.time_s - a.time_s);
        (a.voltage + (b.voltage - a.voltage) * share).norm()
    };
    let crossing_s = ONSET_S + 0.050_37;
    assert!(magnitude(crossing_s - 0.01) > magnitude(crossing_s));
    assert!(magnitude(crossing_s) > magnitude(crossing_s + 0.01));
    let level = magnitude(crossing_s).to_string();
    let block = hidden(
        Effect::SelfDisconnection,
        &[
            ("share", "0.000001"),
            ("threshold_pu", &level),
            ("delay_s", "0"),
        ],
    );
    let found_s = run(&options(vec![block]), &deep).operations[0].time_s;
    // Straight lines between nodes: 1e-6 pu at a slope of 0.1 pu/s is 1e-5 s.
    assert!((found_s - crossing_s).abs() < 3e-5, "{found_s}");
}

#[test]
fn tripped_motors_stay_away_or_coast_and_come_back() {
    let trip = |reconnects: &str| {
        let motors = hidden(
            Effect::MotorUndervoltageTrip,
            &[
                ("share_of_motors", "0.5"),
                ("threshold_pu", "0.75"),
                ("delay_s", "0.03"),
                ("reconnects", reconnects),
                ("reconnect_pu", "0.85"),
                ("reconnect_delay_s", "0.2"),
            ],
        );
        run(&options(vec![motors]), &fault(0.6))
    };
    let (gone, back) = (trip("no"), trip("yes"));
    let motors_pu = 0.9 * 0.45 * 0.5;
    let lost = 0.9 - power_at(&gone, 3.9).re;
    assert!((lost - motors_pu).abs() < 0.02, "{lost} {motors_pu}");
    let actions: Vec<_> = back.operations.iter().map(|o| o.action).collect();
    assert_eq!(actions, ["drop", "return"]);
    // Re-accelerating motors draw more than before, and in the end what they drew before.
    let again_s = back.operations[1].time_s;
    assert!(power_at(&back, again_s + 0.05).re > 1.05 * 0.9);
    assert!((power_at(&back, 3.9).re - 0.9).abs() < 0.01);
}

#[test]
fn generation_that_ceases_raises_the_net_load_and_ramps_back() {
    let generation = hidden(
        Effect::DistributedGeneration,
        &[
            ("share", "0.3"),
            ("behaviour", "momentary_cessation"),
            ("threshold_pu", "0.8"),
            ("delay_s", "0"),
            ("recovery_delay_s", "0.2"),
            ("ramp_s", "1.0"),
        ],
    );
    let run = run(&options(vec![generation]), &fault(0.6));
    close(
        powers(&run, "distributed_generation"),
        Phasor::new(-0.27, 0.0),
        1e-12,
    );
    let after = |s: f64| power_at(&run, ONSET_S + 0.1 + s).re - 0.9;
    assert!((after(0.15) - 0.27).abs() < 0.05, "{}", after(0.15));
    // Halfway along the ramp half of it is back.
    assert!((after(0.7) - 0.135).abs() < 0.03, "{}", after(0.7));
    assert!(after(2.0).abs() < 0.01, "{}", after(2.0));
}

#[test]
fn stalled_air_conditioners_draw_several_times_their_power_until_they_trip() {
    let motors = hidden(
        Effect::SinglePhaseAcStall,
        &[
            ("share", "0.15"),
            ("stall_pu", "0.6"),
            ("stall_delay_s", "0.033"),
            ("restarting", "0"),
        ],
    );
    let hiding = SiteOptions {
        duration_s: 25.0,
        motor_share: 0.3,
        ..options(vec![motors])
    };
    let run = run(&hiding, &fault(0.45));
    assert_eq!(run.operations[0].action, "stall");
    assert!((run.operations[0].time_s - ONSET_S - 0.033).abs() < 1e-9);
    let stalled = power_at(&run, ONSET_S + 1.0).re - 0.9 * 0.85;
    assert!(stalled > 2.0 * 0.135, "{stalled}");
    let trips = run.operations.iter().filter(|o| o.action == "thermal trip");
    assert_eq!(trips.count(), 2, "the first and the last");
    assert!((power_at(&run, 24.9).re - 0.9 * 0.85).abs() < 0.02);
}

#[test]
fn taps_move_one_by_one_until_the_voltage_is_inside_the_deadband() {
    let taps = hidden(
        Effect::TapChanger,
        &[
            ("step", "0.01"),
            ("deadband_pu", "0.012"),
            ("first_s", "1.5"),
            ("next_s", "0.5"),
            ("reactance_pu", "0.1"),
        ],
    );
    let hiding = SiteOptions {
        duration_s: 8.0,
        ..options(vec![taps])
    };
    let run = run(&hiding, &plan(EventKind::CapacitorOut, 1.0, 0.3));
    let times: Vec<_> = run.operations.iter().map(|o| o.time_s - ONSET_S).collect();
    assert!(times.len() >= 2, "{times:?}");
    assert!(
        (times[0] - 1.5).abs() < 1e-9 && (times[1] - 2.0).abs() < 1e-9,
        "{times:?}"
    );
    // Raising the load's voltage raises a load of impedance and current.
    assert!(power_at(&run, 2.6).re > power_at(&run, 2.4).re + 1e-4);
}

#[test]
fn what_is_measured_before_a_feeder_is_the_load_and_its_losses() {
    let feeder = hidden(
        Effect::FeederImpedance,
        &[
            ("resistance_pu", "0.03"),
            ("reactance_pu", "0.1"),
            ("capacitor_pu", "0.05"),
        ],
    );
    let run = run(&options(vec![feeder]), &fault(0.7));
    let load: Phasor = run
        .powers
        .iter()
        .map(|power| Phasor::new(power.active_pu, power.reactive_pu))
        .sum();
    // |I|^2 = 0.9^2 + 0.45^2 = 1.0125 at 1 pu: losses 0.030375 + j 0.10125.
    close(load, Phasor::new(0.9 - 0.030_375, 0.45 - 0.101_25), 1e-12);
    close(power_at(&run, 0.5), Phasor::new(0.9, 0.45), 1e-9);
    assert!(powers(&run, "feeder_capacitor").im < -0.03);
}

#[test]
fn lamps_go_out_and_strike_again_and_contactors_close_again() {
    for effect in [Effect::DischargeLighting, Effect::ContactorDropout] {
        let run = run(&options(vec![hidden(effect, &[])]), &fault(0.45));
        let count = |action| run.operations.iter().filter(|o| o.action == action).count();
        assert_eq!((count("drop"), count("return")), (24, 24), "{effect:?}");
        assert!((power_at(&run, 3.9).re - 0.9).abs() < 0.01);
    }
}

#[test]
fn a_recovering_load_follows_its_equation_along_the_voltage_of_the_event() {
    // dx/dt = -x/T + P0 (1 - v^2), P = x/T + P0 v^2, integrated here by the trapezoidal rule along
    // the voltages of the nodes; what else draws power is ZIP with the shares of the site.
    let recovering = hidden(
        Effect::ExponentialRecovery,
        &[
            ("share", "0.6"),
            ("steady_active", "0"),
            ("transient_active", "2"),
            ("time_constant_s", "1"),
        ],
    );
    let hiding = SiteOptions {
        motor_share: 0.0,
        duration_s: 6.0,
        ..options(vec![recovering])
    };
    let run = run(&hiding, &plan(EventKind::FaultAndLineTrip, 0.7, 1.6));
    let (own, rest) = (
        powers(&run, "exponential_recovery").re,
        powers(&run, "static").re,
    );
    let (z, i) = (hiding.zip.active_impedance, hiding.zip.active_current);
    let (mut x, mut worst) = (0.0, 0.0_f64);
    for pair in run.nodes.windows(2) {
        let step_s = pair[1].time_s - pair[0].time_s;
        let [before, after] = [0, 1].map(|k| own * (1.0 - pair[k].voltage.norm_sqr()));
        x = (x * (1.0 - 0.5 * step_s) + 0.5 * step_s * (before + after)) / (1.0 + 0.5 * step_s);
        let v = pair[1].voltage.norm();
        let expected = x + own * v * v + rest * (z * v * v + i * v + 1.0 - z - i);
        let drawn = (pair[1].voltage * pair[1].current.conj()).re;
        worst = worst.max((drawn - expected).abs());
    }
    assert!(worst < 1e-6, "{worst:e}");
    assert!(x.abs() > 1e-3, "the test must move something: {x}");
}

#[test]
fn a_ramp_begins_with_the_window() {
    let ramp = hidden(
        Effect::LoadRamp,
        &[("active_per_s", "0.01"), ("reactive_per_s", "0")],
    );
    let run = run(&options(vec![ramp]), &fault(0.7));
    // 1 % of the static part per second, at a voltage that hardly moves.
    let risen = power_at(&run, 0.9).re - power_at(&run, 0.0).re;
    let expected = 0.009 * powers(&run, "static").re;
    assert!((risen / expected - 1.0).abs() < 0.05, "{risen} {expected}");
}

#[test]
fn instruments_do_to_the_record_what_their_names_say() {
    let deep = fault(0.6);
    let plain = measured(&options(Vec::new()), &deep);
    let with =
        |effect, values: &[(&str, &str)]| measured(&options(vec![hidden(effect, values)]), &deep);
    let late = with(
        Effect::TimeSkew,
        &[("skew_s", &(2.0_f64 / 60.0).to_string())],
    );
    let turned = with(Effect::RatioPhaseError, &[("angle_deg", "1")]);
    for k in 2..plain.samples.len() {
        let (seen, two_before) = (&late.samples[k], &plain.samples[k - 2]);
        assert!((seen.active_pu - two_before.active_pu).abs() < 1e-9);
        assert!((seen.voltage_pu - plain.samples[k].voltage_pu).abs() < 1e-12);
        let (seen, right) = (&turned.samples[k], &plain.samples[k]);
        let right = Phasor::new(right.active_pu, right.reactive_pu);
        let seen = Phasor::new(seen.active_pu, seen.reactive_pu);
        close(
            seen,
            right * Phasor::from_polar(1.0, -1.0_f64.to_radians()),
            1e-12,
        );
    }
    // Windows of six cycles see a fault three cycles before it, windows of two one cycle before.
    let wide = with(Effect::PhasorWindow, &[("cycles", "6")]);
    let two_before = 60 - 2;
    assert!((plain.samples[two_before].voltage_pu - 1.0).abs() < 1e-9);
    assert!((wide.samples[two_before].voltage_pu - 1.0).abs() > 1e-3);
    // A frequency with a lag of 0.2 s has not yet followed one frame after the edge, and a short
    // span makes its spike higher.
    let largest = |record: &Record| {
        let samples = record.samples.iter();
        samples
            .map(|s| (s.frequency_hz - 60.0).abs())
            .fold(0.0, f64::max)
    };
    let lagging = with(
        Effect::FrequencyTracking,
        &[("lag_s", "0.2"), ("span_cycles", "1")],
    );
    let spiky = with(
        Effect::FrequencyTracking,
        &[("lag_s", "0"), ("span_cycles", "0.25")],
    );
    assert!(largest(&lagging) < 0.5 * largest(&plain));
    assert!(largest(&spiky) > 1.2 * largest(&plain));
}

#[test]
fn a_frequency_that_stays_away_moves_the_loads_that_follow_it() {
    let kind = plan(EventKind::GeneratorTrip, 1.0, 1.2);
    let at_end = |effects| {
        let hiding = SiteOptions {
            duration_s: 6.0,
            ..options(effects)
        };
        let record = measured(&hiding, &kind);
        let last = record.samples[record.samples.len() - 30];
        (
            last.active_pu,
            last.voltage_pu,
            (last.frequency_hz - 60.0) / 60.0,
        )
    };
    let (plain, voltage, deviation) = at_end(Vec::new());
    assert!(deviation < -0.002, "{deviation}");
    let following = hidden(
        Effect::StaticFrequencyDependence,
        &[("active", "2"), ("reactive", "0")],
    );
    let (power, other_voltage, other_deviation) = at_end(vec![following]);
    // Static P is 0.9 (1 - 0.45); the voltage and the frequency are hardly others.
    let expected = 0.9 * 0.55 * 2.0 * other_deviation;
    assert!((voltage - other_voltage).abs() < 2e-3);
    assert!(
        (power - plain - expected).abs() < 0.3 * expected.abs(),
        "{power} {plain} {expected}"
    );
    // Torque with the square of the speed: P of motors by 2 df.
    let fan = hidden(Effect::SpeedDependentTorque, &[("quadratic", "1")]);
    let (power, _, other_deviation) = at_end(vec![fan]);
    let expected = 0.9 * 0.45 * 2.0 * other_deviation;
    assert!(
        (power - plain - expected).abs() < 0.3 * expected.abs(),
        "{power} {plain} {expected}"
    );
}
