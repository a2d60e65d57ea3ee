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

    /// The form and the count as one argument.
    pub fn code(&self) -> String {
        let form = match self.form {
            Form::C37118 => "c37118",
            Form::Cbor => "cbor",
            Form::Json => "json",
        };
        format!("{form}:{}", self.samples)
    }

    pub fn of_code(code: &str) -> Self {
        let (form, samples) = code.split_once(':').expect("FORM:SAMPLES");
        let form = match form {
            "c37118" => Form::C37118,
            "cbor" => Form::Cbor,
            "json" => Form::Json,
            _ => panic!("no form {form}: c37118, cbor or json"),
        };
        Self {
            form,
            samples: samples.parse().expect("a number of samples"),
        }
    }
}

/// A message that was made once and is given another time for each use.
pub struct Template {
    bytes: Vec<u8>,
    form: Form,
    rate_fps: f64,
    /// Where frames begin, or where the start of a batch is written.
    places: Vec<usize>,
}

impl Template {
    pub fn new(site: &Site, rate_fps: f64, payload: Payload) -> Self {
        // Any time whose bytes occur once in a batch.
        const MARK_NS: i64 = 0x1234_5678_9abc_def0;
        let mut source = Source::new(site.clone(), rate_fps, MARK_NS);
        let bytes = source.message(payload);
        let places = match payload.form {
            Form::C37118 => (0..payload.samples)
                .map(|k| k * bytes.len() / payload.samples)
                .collect(),
            Form::Cbor => {
                let mark = MARK_NS.to_be_bytes();
                let at = |n: &usize| bytes[*n..].starts_with(&mark);
                (0..bytes.len()).filter(at).collect()
            }
            Form::Json => panic!("JSON is not sent by template: its numbers have no fixed length"),
        };
        let mut template = Self {
            bytes,
            form: payload.form,
            rate_fps,
            places,
        };
        let later_ns = 1_700_000_000_123_456_000;
        let whole = Source::new(site.clone(), rate_fps, later_ns).message(payload);
        assert!(
            template.at(later_ns) == whole,
            "a template is what it stands for"
        );
        template
    }

    /// The message with its first sample at `first_ns`.
    pub fn at(&mut self, first_ns: i64) -> &[u8] {
        if self.form == Form::Cbor {
            let at = self.places[0];
            self.bytes[at..at + 8].copy_from_slice(&first_ns.to_be_bytes());
            return &self.bytes;
        }
        let size = self.bytes.len() / self.places.len();
        for (k, &at) in self.places.iter().enumerate() {
            let microseconds = (first_ns + grid_offset_ns(k as f64, self.rate_fps) + 500) / 1000;
            let (second, fraction) = (microseconds / 1_000_000, microseconds % 1_000_000);
            let word = |value: i64| u32::try_from(value).expect("before 2106").to_be_bytes();
            let frame = &mut self.bytes[at..at + size];
            frame[6..10].copy_from_slice(&word(second));
            frame[11..14].copy_from_slice(&word(fraction)[1..]);
            let check = check_word(&frame[..size - 2]);
            frame[size - 2..].copy_from_slice(&check);
        }
        &self.bytes
    }
}

/// CRC-CCITT, four bits at a time.
fn check_word(bytes: &[u8]) -> [u8; 2] {
    const TABLE: [u16; 16] = {
        let mut table = [0_u16; 16];
        let mut n = 1;
        while n < 16 {
            table[n] = if n & 1 == 1 {
                table[n - 1] ^ 0x1021
            } else {
                double(table[n / 2])
            };
            n += 1;
        }
        table
    };
    const fn double(crc: u16) -> u16 {
        (crc << 1) ^ (if crc & 0x8000 == 0 { 0 } else { 0x1021 })
    }
    let step = |crc: u16, four: u8| (crc << 4) ^ TABLE[usize::from((crc >> 12) as u8 ^ four)];
    let crc = bytes
        .iter()
        .fold(0xffff, |crc, byte| step(step(crc, byte >> 4), byte & 15));
    crc.to_be_bytes()
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
