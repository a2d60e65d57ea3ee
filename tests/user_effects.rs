//! Effects from files beside those of the catalogue: the same physics written both ways, and the
//! rules every effect keeps. A process of its own, because effects are registered once.
#![allow(
    clippy::unwrap_used,
    reason = "a test helper that fails should fail the test"
)]

use std::{path::Path, sync::Once};

use clap::Parser;
use loadmodeld::{
    adapters::recordings::site_folder,
    commands::generate::{self, GenerateArgs, GenerateError},
    diagnosis::{Change, DiagnosisOptions, diagnose, improve},
    disturbance::Window,
    identification::{IdentificationOptions, identify},
    load_model::{
        ComposedModel, Drive, Response, SimulationError, Structure, TerminalInput,
        composed::BASE_PARAMETERS,
        effects::{self, RegisterError},
        user_effects::EffectFile,
    },
    measurement::Site,
    truth::{self, SiteOptions},
};

const FREQUENCY: &str = r#"
name = "frequency_from_file"
title = "Static load that depends on the frequency, from a file"
source = "linear frequency factor of the IEEE task force (not verified)"
resembles = ["static_frequency_dependence"]
[needs]
frequency = true
frequency_deviation = 5e-4
[[parameters]]
name = "active_coefficient"
symbol = "Kpf"
unit = "1"
role = "two_sided"
meaningful = 0.3
lower = -1
typical = 1.3
upper = 4
[[parameters]]
name = "reactive_coefficient"
symbol = "Kqf"
unit = "1"
role = "two_sided"
meaningful = 0.3
lower = -3
typical = -0.5
upper = 3
[power]
static_factor = "1 + Kpf*df"
reactive = "Kqf*df*v^2"
"#;

/// Every function, a lag of a lag, and a factor on the motors.
const EVERYTHING: &str = r#"
name = "a_bit_of_everything"
title = "Every function of the format"
source = "made for a test; no physics at all"
[[parameters]]
name = "share"
symbol = "A"
unit = "1"
role = "one_sided"
meaningful = 0.02
lower = 0.0
typical = 0.2
upper = 1.0
[[parameters]]
name = "time_s"
symbol = "T"
unit = "s"
role = "shape"
lower = 0.05
typical = 0.2
upper = 2.0
prior = { deviation = 0.7, scale = "logarithmic" }
[[parameters]]
name = "exponent"
symbol = "n"
unit = "1"
role = "shape"
lower = 0.5
typical = 1.4
upper = 3.0
prior = { deviation = 0.7 }
[[states]]
name = "w"
unit = "1"
initial = "0"
derivative = "(ln(max(v, 0.1)) - w - w^3)/T"
[power]
active = """A*(pow(v, n) - lag(lag(v, T), 2*T)^n + w
  + 0.1*sin(w)*cos(v) + exp(-timer(below(v, 0.7))/T) - 1)"""
reactive = "A*(sqrt(clip(v, 0.2, 2)) - 1 + 0.2*smooth_step(1 - minimum_since_start(v), 0.05, 0.6))"
motor_factor = "1 - A*min(abs(df)*above(v, 0.5), 0.3) - 0.1*A*(maximum_since_start(v) - 1)"
"#;

/// Sound in the dip of the checks, not at a lower voltage.
const FRAGILE: &str = r#"
name = "fragile"
title = "A logarithm that ends at a low voltage"
source = "made for a test; no physics at all"
[[parameters]]
name = "gain"
symbol = "A"
unit = "1"
role = "one_sided"
meaningful = 0.02
lower = 0.0
typical = 0.2
upper = 1.0
[power]
active = "A*(ln(v - 0.4) - ln(0.6))"
reactive = "A*(ln((v - 0.4)/0.6))"
"#;

fn example(name: &str) -> EffectFile {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/effects");
    let text = std::fs::read_to_string(folder.join(name)).unwrap();
    EffectFile::parse(&text).unwrap()
}

fn registered() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        effects::register(vec![
            example("self_disconnection_from_file.toml"),
            example("recovery_from_file.toml"),
            EffectFile::parse(FREQUENCY).unwrap(),
            EffectFile::parse(EVERYTHING).unwrap(),
            EffectFile::parse(FRAGILE).unwrap(),
        ])
        .unwrap();
    });
}

/// A dip at 60 frames/s with a phase jump from 0.5 s to 0.75 s and a slow recovery, 2 s.
fn dip(depth: f64) -> TerminalInput {
    const POINTS: usize = 16;
    const SAMPLES: usize = 120;
    let phasor = |i: usize| {
        let t = i as f64 / (60.0 * POINTS as f64);
        let (v, angle) = if t < 0.5 {
            (1.0, 0.0)
        } else if t < 0.75 {
            (depth + 0.02 * (t - 0.5), -0.1)
        } else {
            let late = (-(t - 0.75) / 0.4).exp();
            (1.0 - 0.07 * late, -0.03 * (1.0 - late))
        };
        [v * angle.cos(), v * angle.sin()]
    };
    let grid: Vec<[f64; 2]> = (0..=SAMPLES * POINTS).map(phasor).collect();
    let mut jumps = vec![false; SAMPLES];
    for k in [29, 30, 44, 45] {
        jumps[k] = true;
    }
    TerminalInput {
        real: grid.iter().map(|u| u[0]).collect(),
        imaginary: grid.iter().map(|u| u[1]).collect(),
        points_per_sample: POINTS,
        sample_interval_s: 1.0 / 60.0,
        jumps,
        dense: vec![false; SAMPLES],
        synchronous_speed_rad_s: 376.99,
    }
}

fn model(effects: &[&str]) -> ComposedModel {
    let mut parts = vec!["zip", "induction_motor"];
    parts.extend(effects);
    ComposedModel::new(&Structure::parse(&parts).unwrap())
}

fn simulate(model: &ComposedModel, p: &[f64], wanted: &[usize], depth: f64) -> Response {
    try_to_simulate(model, p, wanted, depth).unwrap()
}

fn try_to_simulate(
    model: &ComposedModel,
    p: &[f64],
    wanted: &[usize],
    depth: f64,
) -> Result<Response, SimulationError> {
    let input = dip(depth);
    let count = input.output_count();
    let deviation: Vec<f64> = (0..count)
        .map(|k| 0.004 * (0.03 * (k as f64 - 30.0).max(0.0)).sin())
        .collect();
    let drive = Drive::new(&input, &deviation, 0.3);
    model.simulate(p, wanted, &drive)
}

fn largest_difference(x: &[f64], y: &[f64]) -> f64 {
    assert_eq!(x.len(), y.len());
    let pairs = x.iter().zip(y);
    pairs.map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

#[test]
fn a_file_and_a_built_in_effect_of_the_same_physics_agree() {
    registered();
    // The built-in lag takes the voltage as straight over half a step, the file's Runge-Kutta step as
    // a parabola: apart by about h^2 v''/12 over the time constant.
    for (file, built_in, tolerance) in [
        ("recovery_from_file", "exponential_recovery", 2e-6),
        ("frequency_from_file", "static_frequency_dependence", 1e-15),
    ] {
        let (one, other) = (model(&[file]), model(&[built_in]));
        assert_eq!(one.typical(), other.typical(), "{file}");
        assert_eq!(one.neutral(), other.neutral(), "{file}");
        let own = |m: &ComposedModel| -> Vec<_> {
            let of_effect = &m.parameters()[BASE_PARAMETERS..];
            of_effect
                .iter()
                .map(|p| (p.declaration.prior, p.declaration.role))
                .collect()
        };
        assert_eq!(own(&one), own(&other), "{file}");
        let wanted: Vec<usize> = (0..one.parameters().len()).collect();
        let mut p = one.typical();
        if file == "recovery_from_file" {
            p[10] = 0.15;
        }
        for depth in [0.5, 0.8] {
            let [x, y] = [&one, &other].map(|m| simulate(m, &p, &wanted, depth));
            let apart = largest_difference(&x.active, &y.active)
                .max(largest_difference(&x.reactive, &y.reactive));
            assert!(apart <= tolerance, "{file}: {apart:e}");
            for k in wanted.iter().copied() {
                let of_active = [&x, &y].map(|r| &r.active_derivatives[k]);
                let apart = largest_difference(of_active[0], of_active[1]);
                assert!(apart <= 100.0 * tolerance, "{file} by {k}: {apart:e}");
            }
        }
    }
}

#[test]
fn derivatives_of_every_function_agree_with_differences() {
    registered();
    let model = model(&["a_bit_of_everything"]);
    let p = model.typical();
    let wanted: Vec<usize> = (0..p.len()).collect();
    let exact = simulate(&model, &p, &wanted, 0.437);
    for i in wanted {
        let h = 2e-7 * p[i].abs().max(0.05);
        let at = |by: f64| {
            let mut moved = p.clone();
            moved[i] += by;
            simulate(&model, &moved, &[], 0.437)
        };
        let (plus, minus) = (at(h), at(-h));
        let channels = [
            (&plus.active, &minus.active, &exact.active_derivatives[i]),
            (
                &plus.reactive,
                &minus.reactive,
                &exact.reactive_derivatives[i],
            ),
        ];
        for (plus, minus, exact) in channels {
            let largest = exact.iter().fold(0.0_f64, |m, d| m.max(d.abs()));
            for k in 0..exact.len() {
                let difference = (plus[k] - minus[k]) / (2.0 * h);
                let error = (exact[k] - difference).abs();
                let name = &model.parameters()[i].name;
                assert!(error < 2e-6 * (1.0 + largest), "{name} at {k}: {error:e}");
            }
        }
    }
}

#[test]
fn at_rest_and_at_neutral_nothing_is_added() {
    registered();
    let plain = model(&[]);
    let base = simulate(&plain, &plain.typical(), &[0, 3], 0.5);
    for effect in effects::catalogue().iter().map(|e| e.declaration()) {
        if !effects::is_registered(effect.name) {
            continue;
        }
        let model = model(&[effect.name]);
        let quiet = simulate(&model, &model.neutral(), &[], 0.5);
        assert_eq!(quiet.active, base.active, "{}", effect.name);
        // With the amplitude wanted the equations are run, and vanish.
        let wanted = [0, BASE_PARAMETERS];
        let present = simulate(&model, &model.neutral(), &wanted, 0.5);
        let by_motor = [&present.active_derivatives[0], &base.active_derivatives[0]];
        assert!(largest_difference(by_motor[0], by_motor[1]) < 3e-4);
        assert!(present.active_derivatives[1].iter().any(|d| d.abs() > 1e-6));
        let still = simulate(&model, &model.typical(), &[], 0.5);
        for k in 0..29 {
            assert!((still.active[k] - 1.0).abs() < 1e-11, "{}", effect.name);
        }
    }
}

#[test]
fn files_come_behind_the_catalogue_by_name_and_only_once() {
    registered();
    let names: Vec<&str> = effects::catalogue()
        .iter()
        .map(|e| e.declaration().name)
        .collect();
    let expected = [
        "a_bit_of_everything",
        "fragile",
        "frequency_from_file",
        "recovery_from_file",
        "self_disconnection_from_file",
    ];
    assert_eq!(names[names.len() - 5..], expected);
    assert!(!effects::is_registered("second_motor"));
    let again = effects::register(vec![]);
    assert_eq!(again, Err(RegisterError::InUse));
    let with_name = |name: &str| {
        let text = FREQUENCY.replace("frequency_from_file", name);
        EffectFile::parse(&text).unwrap()
    };
    let taken = effects::register(vec![with_name("second_motor")]);
    assert!(matches!(taken, Err(RegisterError::Known { .. })));
    let taken = effects::register(vec![with_name("zip")]);
    assert!(matches!(taken, Err(RegisterError::Known { .. })));
    let twice = effects::register(vec![with_name("x"), with_name("x")]);
    assert!(matches!(twice, Err(RegisterError::Twice { .. })));
    let lost = FREQUENCY.replace("\"static_frequency_dependence\"", "\"nothing\"");
    let lost = effects::register(vec![EffectFile::parse(&lost).unwrap()]);
    assert!(matches!(lost, Err(RegisterError::UnknownOther { .. })));
    let many = (0..40).map(|k| with_name(&format!("x{k}"))).collect();
    assert_eq!(
        effects::register(many),
        Err(RegisterError::TooMany { count: 40 })
    );
}

#[test]
fn user_effects_compose_with_all_others() {
    registered();
    for effect in effects::catalogue().iter().map(|e| e.declaration().name) {
        if effect == "recovery_from_file" {
            continue;
        }
        let model = model(&["recovery_from_file", effect]);
        let out = simulate(&model, &model.neutral(), &[8], 0.6);
        assert!(
            out.active_derivatives[0].iter().all(|d| d.is_finite()),
            "{effect}"
        );
    }
}

#[test]
fn what_is_not_a_number_ends_the_simulation_with_an_error() {
    registered();
    let model = model(&["fragile"]);
    let p = model.typical();
    assert!(try_to_simulate(&model, &p, &[], 0.5).is_ok());
    // At neutral the value is that of the plain model; the derivative by the gain is not a number.
    let wanted = [BASE_PARAMETERS];
    for (p, wanted) in [(p, &[][..]), (model.neutral(), &wanted[..])] {
        let outcome = try_to_simulate(&model, &p, wanted, 0.35);
        assert!(matches!(outcome, Err(SimulationError::NotFinite { .. })));
    }
}

/// Four events, the deepest of which dips below what `fragile` can take.
fn a_site_with_a_deep_dip() -> (Site, Vec<Window>) {
    let site = Site {
        name: "deep".to_owned(),
        s_base_mva: 200.0,
        v_base_kv: 23.0,
        nominal_hz: 60.0,
    };
    let options = SiteOptions {
        events: 4,
        duration_s: 4.0,
        rate_fps: 30.0,
        retained: (0.33, 0.9),
        bad_samples: false,
        ..SiteOptions::new(site.clone(), 5)
    };
    let mut made = truth::generate(&options, &mut |_| ()).unwrap();
    for sample in made.records.iter_mut().flat_map(|r| &mut r.samples) {
        // No grid holds its load at such a voltage, so the dips are made deeper than they were.
        sample.voltage_pu = 1.0 - 1.35 * (1.0 - sample.voltage_pu);
    }
    let windows = made.records.iter().zip(1..).map(|(record, number)| Window {
        id: format!("event_{number:02}"),
        ..site_folder::window(&made.options.site, record)
    });
    (site, windows.collect())
}

#[test]
fn an_effect_without_a_value_is_named_with_its_expression_and_the_voltage() {
    registered();
    let (site, windows) = a_site_with_a_deep_dip();
    let parts = |names: &[&str]| names.iter().map(|&n| n.to_owned()).collect::<Vec<_>>();
    let names_it = |told: &str| {
        for words in [
            "`fragile`",
            "active = \"A*(ln(v - 0.4)",
            "event_0",
            "of V0",
            "max(",
        ] {
            assert!(told.contains(words), "{words}: {told}");
        }
    };
    let whole = parts(&["zip", "induction_motor", "fragile"]);
    let options = IdentificationOptions::default();
    let error = identify(&site, &windows, &whole, &options, &|| false).unwrap_err();
    names_it(&error.to_string());
    let plain = parts(&["zip", "induction_motor"]);
    let all = effects::catalogue().iter().map(|e| e.declaration().name);
    let options = DiagnosisOptions {
        excluded: all.filter(|n| *n != "fragile").map(str::to_owned).collect(),
        ..DiagnosisOptions::default()
    };
    let found = diagnose(&site, &windows, &plain, &options, &|_| (), &|| false).unwrap();
    let listed = found.untestable.iter().find(|u| u.effect == "fragile");
    names_it(&listed.unwrap().needs);
    let found = diagnose(&site, &windows, &whole, &options, &|_| (), &|| false).unwrap();
    names_it(&found.summary);
    let change = Change::ByHand {
        add: parts(&["fragile"]),
        remove: Vec::new(),
    };
    let added = improve(&site, &windows, &plain, &change, &options, &|_| (), &|| {
        false
    });
    names_it(&added.unwrap_err().to_string());
}

#[derive(Parser)]
struct Generate {
    #[command(flatten)]
    args: GenerateArgs,
}

#[test]
fn generated_sites_do_not_know_effects_from_files() {
    registered();
    let asked = ["generate", "--effect", "recovery_from_file"];
    let Generate { args } = Generate::try_parse_from(asked).unwrap();
    let error = generate::run(&args, &mut Vec::new()).unwrap_err();
    assert!(matches!(&error, GenerateError::OfAFile { name } if name == "recovery_from_file"));
    assert!(error.to_string().contains("truth simulator"), "{error}");
}
