//! `loadmodeld generate`: synthetic sites whose truth is known, for tests and training.

use std::{
    io::{self, Write},
    path::PathBuf,
};

use serde_json::json;

use crate::{
    adapters::synthetic::{self, SyntheticError, WrittenSite},
    load_model::effects,
    measurement::Site,
    truth::{self, Effect, EventTruth, HiddenEffect, SiteOptions, SyntheticSite, TruthError},
};

/// Makes a synthetic site: network events, ZIP and induction motor, hidden effects, PMU filter, noise.
///
/// Writes `DIR/SITE/` (site folder) and `DIR/SITE.truth.json` (what is hidden in it). The same
/// options give the same files.
#[derive(Clone, Debug, clap::Args)]
#[allow(
    clippy::struct_excessive_bools,
    reason = "each is a switch of the command line"
)]
pub struct GenerateArgs {
    /// Name of the site.
    #[arg(long, default_value = "synthetic")]
    pub site: String,
    /// Directory in which the site folder is made.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
    /// Seed of every random number.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Effects to hide in it, separated by commas; see --list-effects. Effects of --effect-file are not among them.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub effect: Vec<String>,
    /// Gives a parameter of an effect instead of drawing it; may be repeated, once for each parameter.
    #[arg(long, value_name = "EFFECT.PARAMETER=VALUE")]
    pub set: Vec<String>,
    /// Chooses events that do not show the effects.
    #[arg(long)]
    pub unexcited: bool,
    /// Prints every effect with its parameters and makes nothing.
    #[arg(long)]
    pub list_effects: bool,
    /// Draws motors, grid, shares and operating point from the seed too.
    #[arg(long)]
    pub varied: bool,
    /// Number of events, 1 to 99.
    #[arg(long, default_value_t = 11)]
    pub events: usize,
    /// Frames per second, 10 to 240.
    #[arg(long, default_value_t = 60.0)]
    pub rate: f64,
    /// Length of each window, 4 to 600 s; by default 10 s, or as long as the slowest effect needs.
    #[arg(long, value_name = "SECONDS")]
    pub duration: Option<f64>,
    /// Nominal frequency, Hz.
    #[arg(long, value_name = "HZ", default_value_t = 60.0)]
    pub nominal: f64,
    /// Relative noise of the phasors, 0 to 0.05.
    #[arg(long, default_value_t = 5e-4)]
    pub noise: f64,
    /// Width of the PMU's phasor window in cycles, 0 for none.
    #[arg(long, value_name = "CYCLES", default_value_t = 2.0)]
    pub filter_cycles: f64,
    /// Voltage that the deepest fault retains, 0.3 to 0.96 (dips for a threshold go where it lies).
    #[arg(long, value_name = "PU", default_value_t = 0.50)]
    pub deepest: f64,
    /// Voltage that the mildest fault retains, 0.3 to 0.96.
    #[arg(long, value_name = "PU", default_value_t = 0.92)]
    pub mildest: f64,
    /// Range of the operating point from event to event, 0 to 0.5 (0.12 is +-12 %).
    #[arg(long, default_value_t = 0.12)]
    pub level_spread: f64,
    /// Standard deviation of the load's composition from event to event, 0 to 0.2.
    #[arg(long, default_value_t = 0.02)]
    pub composition_spread: f64,
    /// Leaves out gaps, spikes, flags and other bad samples.
    #[arg(long)]
    pub no_bad_samples: bool,
    /// Power base, MVA.
    #[arg(long, value_name = "MVA", default_value_t = 200.0)]
    pub base_mva: f64,
    /// Voltage base, kV.
    #[arg(long, value_name = "KV", default_value_t = 23.0)]
    pub base_kv: f64,
    /// Mean active power of the load, pu; 0.9 unless --varied.
    #[arg(long, value_name = "PU")]
    pub active_power: Option<f64>,
    /// Mean reactive power of the load, pu; 0.45 unless --varied.
    #[arg(long, value_name = "PU", allow_negative_numbers = true)]
    pub reactive_power: Option<f64>,
    /// Share of the active power that motors draw, 0 to 0.95; 0.45 or what effects leave.
    #[arg(long)]
    pub motor_share: Option<f64>,
    /// Inertia constant of the motors, s; 0.7 unless --varied.
    #[arg(long, value_name = "SECONDS")]
    pub motor_inertia: Option<f64>,
    /// Rotor resistance of the motors, pu of their rating; 0.018 unless --varied.
    #[arg(long, value_name = "PU")]
    pub rotor_resistance: Option<f64>,
    /// Stator resistance of the motors, pu of their rating; 0 by default.
    #[arg(long, value_name = "PU")]
    pub stator_resistance: Option<f64>,
    /// Prints one JSON object instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Why no site was made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GenerateError {
    /// The options or the simulation.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// A `--set` that is none.
    #[error("`--set {given}` must be EFFECT.PARAMETER=VALUE with an effect named by --effect")]
    Setting {
        /// What was given.
        given: String,
    },
    /// A parameter that is given more than once.
    #[error("`--set {path}` is given twice; give every parameter once")]
    SetTwice {
        /// EFFECT.PARAMETER.
        path: String,
    },
    /// An effect of a file.
    #[error(
        "`{name}` is an effect from a file: sites are made by a truth simulator that shares nothing with the models and does not know such effects; see `loadmodeld generate --list-effects` for those that it hides"
    )]
    OfAFile {
        /// The effect.
        name: String,
    },
    /// The files.
    #[error(transparent)]
    Files(#[from] SyntheticError),
    /// The terminal or pipe.
    #[error("cannot write the result")]
    Output(#[from] io::Error),
}

/// Makes the site and says what is in it.
///
/// # Errors
///
/// See [`GenerateError`].
pub fn run(args: &GenerateArgs, out: &mut dyn Write) -> Result<(), GenerateError> {
    if args.list_effects {
        return Ok(list_effects(out)?);
    }
    synthetic::checked_name(&args.site)?;
    let options = options(args)?;
    let progress = indicatif::ProgressBar::new(args.events as u64);
    let made = truth::generate(&options, &mut |done| {
        progress.set_position(done as u64);
    });
    progress.finish_and_clear();
    let site = made?;
    let written = synthetic::write(&site, &args.out)?;
    if args.json {
        writeln!(out, "{}", document(&site, &written))?;
    } else {
        print_table(&site, &written, out)?;
    }
    Ok(())
}

fn options(args: &GenerateArgs) -> Result<SiteOptions, GenerateError> {
    let site = Site {
        name: args.site.clone(),
        s_base_mva: args.base_mva,
        v_base_kv: args.base_kv,
        nominal_hz: args.nominal,
    };
    let base = if args.varied {
        SiteOptions::varied(site, args.seed)
    } else {
        SiteOptions::new(site, args.seed)
    };
    let mut options = SiteOptions {
        events: args.events,
        rate_fps: args.rate,
        noise: args.noise,
        filter_cycles: args.filter_cycles,
        retained: (args.deepest, args.mildest),
        level_spread: args.level_spread,
        composition_spread: args.composition_spread,
        bad_samples: !args.no_bad_samples,
        excited: !args.unexcited,
        ..base.hiding(hidden_effects(args)?).leaving_room()
    };
    for (given, option) in [
        (args.duration, &mut options.duration_s),
        (args.active_power, &mut options.active_pu),
        (args.reactive_power, &mut options.reactive_pu),
        (args.motor_share, &mut options.motor_share),
        (args.motor_inertia, &mut options.motor.inertia_s),
        (args.rotor_resistance, &mut options.motor.rotor_resistance),
        (args.stator_resistance, &mut options.motor.stator_resistance),
    ] {
        *option = given.unwrap_or(*option);
    }
    Ok(options)
}

fn hidden_effects(args: &GenerateArgs) -> Result<Vec<HiddenEffect>, GenerateError> {
    let mut hidden = Vec::new();
    for name in &args.effect {
        let effect = Effect::named(name).map_err(|error| refused(name, error))?;
        hidden.push(HiddenEffect::drawn(effect, args.seed));
    }
    let path = |given: &str| {
        given
            .split_once('=')
            .map(|(path, _)| path.trim().to_owned())
    };
    let mut seen: Vec<String> = Vec::new();
    for path in args.set.iter().filter_map(|given| path(given)) {
        if seen.contains(&path) {
            return Err(GenerateError::SetTwice { path });
        }
        seen.push(path);
    }
    for given in &args.set {
        let setting = given.split_once('=').and_then(|(path, value)| {
            let (effect, parameter) = path.split_once('.')?;
            Some((effect, parameter, value))
        });
        let found = setting.and_then(|(effect, parameter, value)| {
            let hidden = hidden.iter_mut().find(|h| h.effect().name() == effect)?;
            Some((hidden, parameter, value))
        });
        let (effect, parameter, value) = found.ok_or_else(|| GenerateError::Setting {
            given: given.clone(),
        })?;
        effect.set(parameter, value)?;
    }
    Ok(hidden)
}

/// Why there is no such effect here.
fn refused(name: &str, error: TruthError) -> GenerateError {
    if effects::is_registered(name) {
        let name = name.to_owned();
        return GenerateError::OfAFile { name };
    }
    error.into()
}

fn list_effects(out: &mut dyn Write) -> io::Result<()> {
    for effect in Effect::ALL {
        let kind = if effect.is_instrument() {
            " (instrument)"
        } else {
            ""
        };
        writeln!(out, "{}{kind}", effect.name())?;
        for parameter in effect.parameters() {
            let (low, high) = parameter.typical;
            let range = if parameter.choices.is_empty() {
                let sign = if parameter.either_sign { "+-" } else { "" };
                format!("{sign}{low} to {high}")
            } else {
                parameter.choices.join(" | ")
            };
            writeln!(
                out,
                "    {:<26} {:<22} {}",
                parameter.name, range, parameter.meaning
            )?;
        }
    }
    Ok(())
}

fn print_table(site: &SyntheticSite, written: &WrittenSite, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "event  kind        lowest V  frequency, Hz     P0, pu  Q0, pu  Kpm    bad samples      shows"
    )?;
    for (index, truth) in site.truth.iter().enumerate() {
        writeln!(
            out,
            "{:>5}  {:<10}  {:>8.3}  {:>6.3} to {:>6.3}  {:>6.3}  {:>6.3}  {:.3}  {:<15}  {}",
            index + 1,
            truth.plan.kind.name(),
            truth.lowest_voltage_pu,
            truth.frequency_range_hz.0,
            truth.frequency_range_hz.1,
            truth.active_pu,
            truth.reactive_pu,
            truth.motor_share,
            truth.bad_samples.map_or("", |bad| bad.defect.name()),
            shown(truth).join(" "),
        )?;
    }
    for hidden in &site.options.effects {
        write!(out, "hidden: {}", hidden.effect().name())?;
        for (parameter, value) in hidden.values() {
            match parameter.word(value) {
                Some(word) => write!(out, ", {} {word}", parameter.name)?,
                None => write!(out, ", {} {value:.4}", parameter.name)?,
            }
        }
        writeln!(out)?;
    }
    let motor = &site.motor;
    writeln!(
        out,
        "motors on the load base at the mean operating point: M {:.6}, T0' {:.4} s, X {:.4}, X' {:.4}",
        motor.inertia,
        motor.transient_open_circuit_time_constant_s,
        motor.reactance,
        motor.transient_reactance
    )?;
    writeln!(out, "site folder {}", written.folder.display())?;
    writeln!(out, "truth       {}", written.truth.display())
}

fn shown(truth: &EventTruth) -> Vec<&'static str> {
    truth.showing.iter().map(|effect| effect.name()).collect()
}

fn document(site: &SyntheticSite, written: &WrittenSite) -> serde_json::Value {
    let events: Vec<_> = site
        .truth
        .iter()
        .map(|truth| {
            json!({
                "kind": truth.plan.kind.name(),
                "lowest_voltage_pu": truth.lowest_voltage_pu,
                "bad_samples": truth.bad_samples.map(|bad| bad.defect.name()),
                "shows": shown(truth),
            })
        })
        .collect();
    let hidden = site.options.effects.iter();
    let effects: Vec<_> = hidden.map(|hidden| hidden.effect().name()).collect();
    json!({
        "site": site.options.site.name,
        "seed": site.options.seed,
        "folder": written.folder.display().to_string(),
        "truth": written.truth.display().to_string(),
        "effects": effects,
        "events": events,
    })
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Program {
        #[command(flatten)]
        args: GenerateArgs,
    }

    fn args(rest: &[&str], out: &std::path::Path) -> GenerateArgs {
        let fixed = ["generate", "--events", "2", "--duration", "4", "--out"];
        let all = fixed
            .iter()
            .map(std::ffi::OsString::from)
            .chain([out.as_os_str().to_owned()])
            .chain(rest.iter().map(std::ffi::OsString::from));
        Program::try_parse_from(all).unwrap().args
    }

    #[test]
    fn the_same_command_writes_the_same_files() {
        let places = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let texts = places.map(|place| {
            run(&args(&["--seed", "3"], place.path()), &mut Vec::new()).unwrap();
            [
                "synthetic/event_01.csv",
                "synthetic/site.json",
                "synthetic.truth.json",
            ]
            .map(|file| std::fs::read_to_string(place.path().join(file)).unwrap())
        });
        assert_eq!(texts[0], texts[1]);
    }

    #[test]
    fn the_defaults_of_the_command_are_those_of_the_simulator() {
        let args = Program::try_parse_from(["generate"]).unwrap().args;
        let made = options(&args).unwrap();
        assert_eq!(made, SiteOptions::new(made.site.clone(), 1));
    }

    #[test]
    fn effects_are_hidden_with_the_parameters_given() {
        let place = tempfile::tempdir().unwrap();
        let hiding = [
            "--effect",
            "self_disconnection,time_skew",
            "--set",
            "self_disconnection.share=0.15",
            "--json",
        ];
        let mut out = Vec::new();
        run(&args(&hiding, place.path()), &mut out).unwrap();
        let document: serde_json::Value = serde_json::from_slice(&out).unwrap();
        assert_eq!(
            document["effects"],
            json!(["self_disconnection", "time_skew"])
        );
        let truth = std::fs::read_to_string(place.path().join("synthetic.truth.json")).unwrap();
        let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
        let hidden = &truth["parameters"]["effects"]["self_disconnection"];
        assert_eq!(hidden["share"], 0.15);
    }

    #[test]
    fn a_setting_without_its_effect_is_refused_by_name() {
        let place = tempfile::tempdir().unwrap();
        let wrong = args(&["--set", "tap_changer.step=0.01"], place.path());
        let error = run(&wrong, &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("`--set tap_changer.step=0.01`"), "{error}");
        let unknown = args(&["--effect", "gremlins"], place.path());
        let error = run(&unknown, &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("no effect is called `gremlins`"), "{error}");
        let twice = ["--effect", "time_skew", "--set", "time_skew.skew_s=0.01"];
        let twice: Vec<&str> = twice.iter().chain(&twice[2..]).copied().collect();
        let error = run(&args(&twice, place.path()), &mut Vec::new()).unwrap_err();
        assert!(matches!(&error, GenerateError::SetTwice { path } if path == "time_skew.skew_s"));
    }

    #[test]
    fn an_effect_of_motors_needs_motors() {
        let place = tempfile::tempdir().unwrap();
        for effect in ["second_motor", "motor_undervoltage_trip"] {
            let without = args(&["--effect", effect, "--motor-share", "0"], place.path());
            let error = run(&without, &mut Vec::new()).unwrap_err().to_string();
            assert!(
                error.contains(effect) && error.contains("the motor share is 0"),
                "{error}"
            );
        }
        let recovery = ["--effect", "exponential_recovery", "--motor-share", "0"];
        let options = options(&args(&recovery, place.path())).unwrap();
        assert!(options.motor_share.abs() < f64::EPSILON);
    }

    #[test]
    fn every_effect_is_listed_with_its_parameters() {
        let place = tempfile::tempdir().unwrap();
        let mut out = Vec::new();
        run(&args(&["--list-effects"], place.path()), &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        for effect in Effect::ALL {
            assert!(text.contains(effect.name()));
        }
        assert!(text.contains("momentary_cessation | trip | ride_through"));
    }

    #[test]
    fn json_names_folder_truth_and_events() {
        let place = tempfile::tempdir().unwrap();
        let mut out = Vec::new();
        run(&args(&["--json", "--site", "s1"], place.path()), &mut out).unwrap();
        let document: serde_json::Value = serde_json::from_slice(&out).unwrap();
        assert_eq!(document["site"], "s1");
        assert_eq!(document["events"].as_array().unwrap().len(), 2);
        let folder = document["folder"].as_str().unwrap();
        assert!(std::path::Path::new(folder).join("site.json").exists());
    }

    #[test]
    fn a_bad_option_is_an_error_that_names_it_and_writes_nothing() {
        let place = tempfile::tempdir().unwrap();
        let wrong = args(&["--motor-share", "1.2"], place.path());
        let error = run(&wrong, &mut Vec::new()).unwrap_err();
        assert_eq!(error.to_string(), "motor share must be 0 to 0.95, got 1.2");
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);
    }
}
