//! `loadmodeld generate`: synthetic sites whose truth is known, for tests and training.

use std::{
    io::{self, Write},
    path::PathBuf,
};

use serde_json::json;

use crate::{
    adapters::synthetic::{self, SyntheticError, WrittenSite},
    measurement::Site,
    truth::{self, MotorCircuit, SiteOptions, SyntheticSite, TruthError},
};

/// Makes a synthetic site: network events, ZIP and induction motor, PMU filter, noise.
///
/// Writes `DIR/SITE/` (site folder) and `DIR/SITE.truth.json` (what is hidden in it). The same
/// options give the same files.
#[derive(Clone, Debug, clap::Args)]
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
    /// Number of events, 1 to 99.
    #[arg(long, default_value_t = 11)]
    pub events: usize,
    /// Frames per second, 10 to 240.
    #[arg(long, default_value_t = 60.0)]
    pub rate: f64,
    /// Length of each window, 4 to 120 s.
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    pub duration: f64,
    /// Nominal frequency, Hz.
    #[arg(long, value_name = "HZ", default_value_t = 60.0)]
    pub nominal: f64,
    /// Relative noise of the phasors, 0 to 0.05.
    #[arg(long, default_value_t = 5e-4)]
    pub noise: f64,
    /// Width of the PMU's phasor window in cycles, 0 for none.
    #[arg(long, value_name = "CYCLES", default_value_t = 2.0)]
    pub filter_cycles: f64,
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
    /// Mean active power of the load, pu.
    #[arg(long, value_name = "PU", default_value_t = 0.9)]
    pub active_power: f64,
    /// Mean reactive power of the load, pu.
    #[arg(
        long,
        value_name = "PU",
        allow_negative_numbers = true,
        default_value_t = 0.45
    )]
    pub reactive_power: f64,
    /// Share of the active power that motors draw, 0 to 0.95.
    #[arg(long, default_value_t = 0.45)]
    pub motor_share: f64,
    /// Inertia constant of the motors, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.7)]
    pub motor_inertia: f64,
    /// Rotor resistance of the motors, pu of their rating.
    #[arg(long, value_name = "PU", default_value_t = 0.018)]
    pub rotor_resistance: f64,
    /// Stator resistance of the motors, pu of their rating.
    #[arg(long, value_name = "PU", default_value_t = 0.0)]
    pub stator_resistance: f64,
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
    synthetic::checked_name(&args.site)?;
    let progress = indicatif::ProgressBar::new(args.events as u64);
    let made = truth::generate(&options(args), &mut |done| {
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

fn options(args: &GenerateArgs) -> SiteOptions {
    let site = Site {
        name: args.site.clone(),
        s_base_mva: args.base_mva,
        v_base_kv: args.base_kv,
        nominal_hz: args.nominal,
    };
    SiteOptions {
        events: args.events,
        rate_fps: args.rate,
        duration_s: args.duration,
        noise: args.noise,
        filter_cycles: args.filter_cycles,
        active_pu: args.active_power,
        reactive_pu: args.reactive_power,
        level_spread: args.level_spread,
        composition_spread: args.composition_spread,
        bad_samples: !args.no_bad_samples,
        motor_share: args.motor_share,
        motor: MotorCircuit {
            inertia_s: args.motor_inertia,
            rotor_resistance: args.rotor_resistance,
            stator_resistance: args.stator_resistance,
            ..MotorCircuit::default()
        },
        ..SiteOptions::new(site, args.seed)
    }
}

fn print_table(site: &SyntheticSite, written: &WrittenSite, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "event  kind        lowest V  frequency, Hz     P0, pu  Q0, pu  Kpm    bad samples"
    )?;
    for (index, truth) in site.truth.iter().enumerate() {
        writeln!(
            out,
            "{:>5}  {:<10}  {:>8.3}  {:>6.3} to {:>6.3}  {:>6.3}  {:>6.3}  {:.3}  {}",
            index + 1,
            truth.plan.kind.name(),
            truth.lowest_voltage_pu,
            truth.frequency_range_hz.0,
            truth.frequency_range_hz.1,
            truth.active_pu,
            truth.reactive_pu,
            truth.motor_share,
            truth.bad_samples.map_or("", |bad| bad.defect.name()),
        )?;
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

fn document(site: &SyntheticSite, written: &WrittenSite) -> serde_json::Value {
    let events: Vec<_> = site
        .truth
        .iter()
        .map(|truth| {
            json!({
                "kind": truth.plan.kind.name(),
                "lowest_voltage_pu": truth.lowest_voltage_pu,
                "bad_samples": truth.bad_samples.map(|bad| bad.defect.name()),
            })
        })
        .collect();
    json!({
        "site": site.options.site.name,
        "seed": site.options.seed,
        "folder": written.folder.display().to_string(),
        "truth": written.truth.display().to_string(),
        "effects": [],
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
        let made = options(&args);
        assert_eq!(made, SiteOptions::new(made.site.clone(), 1));
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
