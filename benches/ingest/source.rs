//! What is sent: the samples of a quiet load, in each of the forms in which they may arrive.

use loadmodeld::{
    adapters::{
        c37118::{ConfigurationKind, LoadMapping, PhasorSet, Played},
        wire::v1::{encode_batch_cbor, encode_batch_json},
    },
    measurement::{Channel, Quality, Sample, SampleBatch, Site, record::grid_offset_ns},
};

/// A form of samples, and how many go into a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Payload {
    form: Form,
    samples: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    C37118,
    Cbor,
    Json,
}

/// A stream of one load that makes messages.
pub struct Source {
    site: Site,
    played: Played,
    start_ns: i64,
    rate_fps: f64,
    next: usize,
}

pub const STREAM: &str = "pmu";

impl Payload {
    pub fn all(per_message: &[usize]) -> Vec<Self> {
        let of_form = |form| {
            per_message
                .iter()
                .map(move |&samples| Self { form, samples })
        };
        let forms = [Form::C37118, Form::Cbor, Form::Json];
        forms.into_iter().flat_map(of_form).collect()
    }

    pub const fn frames(samples: usize) -> Self {
        Self {
            form: Form::C37118,
            samples,
        }
    }

    pub fn name(&self) -> String {
        let form = match self.form {
            Form::C37118 => "C37.118 frames",
            Form::Cbor => "batch, CBOR",
            Form::Json => "batch, JSON",
        };
        format!("{} {form}", self.samples)
    }

    pub const fn samples(&self) -> usize {
        self.samples
    }
}

pub fn site(name: &str) -> Site {
    Site {
        name: name.to_owned(),
        s_base_mva: 40.0,
        v_base_kv: 110.0,
        nominal_hz: 60.0,
    }
}

pub fn mapping() -> LoadMapping {
    let set = |name: &str| PhasorSet::PositiveSequence(name.to_owned());
    LoadMapping::new(set("V1"), set("I1"))
}

impl Source {
    pub fn new(site: Site, rate_fps: f64, start_ns: i64) -> Self {
        Self {
            played: Played::new(&site, rate_fps, 1).expect("a rate with a code"),
            site,
            start_ns,
            rate_fps,
            next: 0,
        }
    }

    pub fn configuration(&self) -> Vec<u8> {
        let configuration = self.played.configuration(ConfigurationKind::Configuration2);
        configuration.encode().expect("a frame").concat()
    }

    /// UTC nanoseconds of the sample that is next.
    pub fn next_ns(&self) -> i64 {
        self.start_ns + grid_offset_ns(self.next as f64, self.rate_fps)
    }

    /// The next message.
    pub fn message(&mut self, payload: Payload) -> Vec<u8> {
        let samples: Vec<Sample> = (0..payload.samples).map(|_| self.sample()).collect();
        match payload.form {
            Form::C37118 => {
                let frames = samples.iter().map(|sample| self.played.frame(sample));
                let frames = frames.map(|frame| frame.expect("a frame").expect("a sample"));
                frames.collect::<Vec<_>>().concat()
            }
            Form::Cbor => {
                encode_batch_cbor(&self.batch(&samples), self.site.nominal_hz).expect("a batch")
            }
            Form::Json => {
                encode_batch_json(&self.batch(&samples), self.site.nominal_hz).expect("a batch")
            }
        }
    }

    fn sample(&mut self) -> Sample {
        let time_ns = self.next_ns();
        let x = (self.next % 100) as f64 * 1e-6;
        self.next += 1;
        Sample {
            time_ns,
            voltage_pu: 1.0 + x,
            angle_rad: 10.0 * x,
            frequency_hz: 60.0,
            active_pu: 0.8 + x,
            reactive_pu: 0.2 - x,
            negative_sequence_ratio: f64::NAN,
            quality: Quality::GOOD,
        }
    }

    fn batch(&self, samples: &[Sample]) -> SampleBatch {
        let channels = Channel::ALL
            .into_iter()
            .filter(|c| *c != Channel::NegativeSequenceRatio);
        let values = |channel: Channel| samples.iter().map(|s| s.value(channel)).collect();
        SampleBatch {
            site: self.site.name.clone(),
            stream: STREAM.to_owned(),
            sequence: None,
            start_ns: samples[0].time_ns,
            rate_fps: self.rate_fps,
            channels: channels.map(|channel| (channel, values(channel))).collect(),
            quality: vec![Quality::GOOD; samples.len()],
        }
    }
}
