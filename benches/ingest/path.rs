//! Payload to detector on one thread: decode, concentrate, detect.

use loadmodeld::{
    adapters::{
        c37118::{FrameIntake, starts_as_frame},
        wire::{
            Encoding,
            v1::{BatchLimits, decode_batch},
        },
    },
    disturbance::{Detector, DetectorOptions},
    measurement::{Concentrator, ConcentratorOptions, SampleBatch},
};

use super::{
    clock::cpu_seconds,
    source::{Payload, STREAM, Source, mapping, site},
};

const SAMPLES: usize = 60_000;
/// Samples before the measurement begins: the concentrator's lag time and the detector's history.
const WARM_UP: usize = 6_000;
const RATE_FPS: f64 = 60.0;
const START_NS: i64 = 1_700_000_000_000_000_000;

pub struct Cost {
    pub message_bytes: usize,
    pub cpu_s_per_sample: f64,
}

pub fn cost(payload: &Payload) -> Cost {
    let site = site("bench");
    let mut source = Source::new(site.clone(), RATE_FPS, START_NS);
    let configuration = source.configuration();
    let messages: Vec<Vec<u8>> = (0..(SAMPLES + WARM_UP) / payload.samples())
        .map(|_| source.message(*payload))
        .collect();
    let mut intake = FrameIntake::new(&site, STREAM, &mapping());
    intake.take(&configuration);
    let mut concentrator = Concentrator::new(&site, ConcentratorOptions::default());
    let mut detector = Detector::new(&site, DetectorOptions::default());
    let limits = BatchLimits::default();
    let (mut begun, mut released) = (0.0, 0);
    let warm = WARM_UP / payload.samples();
    for (at, message) in messages.iter().enumerate() {
        if at == warm {
            (begun, released) = (cpu_seconds(), 0);
        }
        let batches: Vec<SampleBatch> = if starts_as_frame(message) {
            intake.take(message).batches
        } else {
            vec![decode_batch(message, Encoding::Unknown, &site, &limits).expect("a batch")]
        };
        for batch in &batches {
            concentrator.push(batch);
            for run in concentrator.drain() {
                released += run.samples.len();
                assert!(detector.push_run(&run).is_empty(), "the load is quiet");
            }
        }
    }
    let cpu_s = cpu_seconds() - begun;
    let sent = (messages.len() - warm) * payload.samples();
    assert!(released >= sent, "{released} of {sent} came through");
    Cost {
        message_bytes: messages[warm].len(),
        cpu_s_per_sample: cpu_s / sent as f64,
    }
}
