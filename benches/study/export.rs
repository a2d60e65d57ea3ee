//! The problems as files, for programs in other languages.

use std::{error::Error, fmt::Write as _, fs, path::Path};

use serde_json::json;

use super::{Settings, problems};

/// Writes `problems.json` and per problem the samples (`NAME.csv`: time, voltage phasor, P and Q over
/// P0) and the voltage between them (`NAME_voltage.csv`, straight lines between its points).
pub fn write(directory: &Path, settings: &Settings) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(directory)?;
    let mut list = Vec::new();
    for index in settings.indices() {
        let problem = problems::problem(settings.seed, index);
        let event = &problem.event;
        let mut samples = String::from("time_s,voltage_re,voltage_im,active,reactive\n");
        for k in 0..event.len() {
            let at = k * event.input.points_per_sample;
            let time_s = k as f64 * event.input.sample_interval_s;
            let (re, im) = (event.input.real[at], event.input.imaginary[at]);
            writeln!(
                samples,
                "{time_s},{re},{im},{},{}",
                event.active[k], event.reactive[k]
            )?;
        }
        let mut voltage = String::from("voltage_re,voltage_im\n");
        for (re, im) in event.input.real.iter().zip(&event.input.imaginary) {
            writeln!(voltage, "{re},{im}")?;
        }
        fs::write(directory.join(format!("{}.csv", event.id)), samples)?;
        fs::write(directory.join(format!("{}_voltage.csv", event.id)), voltage)?;
        list.push(json!({
            "name": event.id,
            "family": problem.truth.family.name(),
            "noise": problem.noise,
            "deviation": event.active_deviation[0],
            "q0_over_p0": problem.truth.q0_over_p0,
            "parameters": problem.truth.parameters.values(),
            "second_motor": problem.truth.second_motor.map(|p| p.values()),
            "dip_depth": problem.disturbance.depth,
            "dip_duration_s": problem.disturbance.duration_s,
        }));
    }
    let text = serde_json::to_string_pretty(&json!({
        "seed": settings.seed,
        "order": "M, T0', X, X', Kpm, Pz, Pp, Qz, Qp on the load base",
        "points_per_sample": problems::POINTS_PER_SAMPLE,
        "problems": list,
    }))?;
    fs::write(directory.join("problems.json"), text)?;
    Ok(())
}
