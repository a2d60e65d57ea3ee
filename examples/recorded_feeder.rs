//! A feeder of a disturbance recording as a site folder, for `identify`, `diagnose` and `improve`.
//!
//! ```text
//! cargo run --release --example recorded_feeder -- RECORDING.cfg FEEDER V_BASE_KV DIRECTORY [PARTS]
//! loadmodeld improve DIRECTORY --add saturation
//! ```
//!
//! FEEDER is a part of the names of its current channels. With PARTS the recording is cut into so many
//! events of equal length: one event alone leaves nothing to hold a model against.
#![allow(clippy::print_stdout, reason = "an example speaks to whoever runs it")]

use std::{error::Error, path::Path};

use loadmodeld::{
    adapters::recordings::{
        comtrade::{self, Options},
        grouping,
        site_folder::{self, FolderEvent, Intake},
    },
    measurement::{Record, Site},
};

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let (file, feeder, v_base_kv, directory, parts) = match words.as_slice() {
        [file, feeder, v_base_kv, directory] => (file, feeder, v_base_kv, directory, 1),
        [file, feeder, v_base_kv, directory, parts] => {
            (file, feeder, v_base_kv, directory, parts.parse()?)
        }
        _ => return Err("give RECORDING.cfg FEEDER V_BASE_KV DIRECTORY [PARTS]".into()),
    };
    let recording = comtrade::read(Path::new(file), &Options::default())?;
    let proposals = grouping::propose(&recording, &grouping::group(&recording));
    let has = |channels: &[String; 3]| channels.iter().all(|c| c.contains(feeder.as_str()));
    let chosen = proposals
        .iter()
        .find(|p| p.mapping.currents.iter().any(|c| has(&c.channels)))
        .ok_or("no load of that feeder; `loadmodeld inspect` shows the channels")?;
    let site = Site {
        name: feeder.clone(),
        s_base_mva: 10.0,
        v_base_kv: v_base_kv.parse()?,
        nominal_hz: recording.nominal_hz.unwrap_or(50.0),
    };
    let record = chosen.mapping.record(&recording, &site)?;
    let rate_fps = record.rate_fps;
    let length = record.samples.len().div_ceil(std::cmp::max(parts, 1));
    let events: Vec<FolderEvent> = record
        .samples
        .chunks(length)
        .enumerate()
        .map(|(k, samples)| {
            let ahead_s = (k * length) as f64 / rate_fps;
            #[allow(
                clippy::cast_possible_truncation,
                reason = "nanoseconds of a recording"
            )]
            let start_ns = record.start_ns + (1e9 * ahead_s) as i64;
            FolderEvent {
                name: format!("event_{:02}", k + 1),
                utc_ns: Some(start_ns),
                record: Record {
                    start_ns,
                    samples: samples.to_vec(),
                    ..record.clone()
                },
                intake: Intake::default(),
            }
        })
        .collect();
    site_folder::write(Path::new(directory), &site, rate_fps, &events)?;
    println!("{} events of {feeder} in {directory}", events.len());
    Ok(())
}
