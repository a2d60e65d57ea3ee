//! Sample batches in: what is checked and converted between the bytes and the domain.

use super::{
    BatchError, VERSION, batch_cbor, batch_error::shortened, batch_json, channel_name,
    units::factor_to_own,
};
use crate::{
    adapters::wire::Encoding,
    measurement::{Channel, Quality, SampleBatch, Site, record::grid_offset_ns},
};

/// Longest name of a site or stream, bytes. Chosen; a key expression has room for much more.
const NAME_BYTES_MAX: usize = 128;

/// How far the nominal frequency of a batch may be from the site's, Hz: the two are the same number
/// written twice, so anything visible is a mistake.
const NOMINAL_TOLERANCE_HZ: f64 = 1e-6;

/// Quality bits with a meaning: the STAT word, and what intake sets.
const QUALITY_BITS: u32 =
    0xffff | Quality::MISSING.0 | Quality::NOT_FINITE.0 | Quality::SPIKE.0 | Quality::CLOCK.0;

/// What a batch may cost us at most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatchLimits {
    /// Longest payload, bytes. Default: 4 MiB.
    pub payload_bytes_max: usize,
    /// Most samples in one batch. Default: 20 000, more than five minutes at 60 per second.
    pub samples_max: usize,
    /// Lowest rate, samples per second. Default: 1; below, no disturbance can be seen.
    pub rate_fps_min: f64,
    /// Highest rate, samples per second. Default: 10 000; phasors come at 10 to 240.
    pub rate_fps_max: f64,
}

impl Default for BatchLimits {
    fn default() -> Self {
        Self {
            payload_bytes_max: 4 << 20,
            samples_max: 20_000,
            rate_fps_min: 1.0,
            rate_fps_max: 10_000.0,
        }
    }
}

/// A batch as it was written, before anything in it is believed.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct RawBatch {
    pub(super) version: Option<u64>,
    pub(super) site: Option<String>,
    pub(super) stream: Option<String>,
    pub(super) sequence: Option<u64>,
    pub(super) start_ns: Option<i64>,
    pub(super) rate_fps: Option<f64>,
    pub(super) nominal_hz: Option<f64>,
    pub(super) channels: Option<Vec<RawChannel>>,
    pub(super) quality: Option<Vec<u32>>,
}

/// A channel as it was written; a null is NaN.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RawChannel {
    pub(super) channel: Channel,
    pub(super) unit: String,
    pub(super) values: Vec<f64>,
}

/// Reads a batch of `site`, converts its channels to the domain's units on the site's base and
/// marks every sample with a value that is not finite as [`Quality::NOT_FINITE`] (the
/// negative-sequence ratio excepted: it describes quality itself and may be unknown).
///
/// # Errors
///
/// [`BatchError`]: the whole batch is refused.
pub fn decode_batch(
    payload: &[u8],
    encoding: Encoding,
    site: &Site,
    limits: &BatchLimits,
) -> Result<SampleBatch, BatchError> {
    if payload.len() > limits.payload_bytes_max {
        return Err(BatchError::TooLarge {
            bytes: payload.len(),
            max: limits.payload_bytes_max,
        });
    }
    let raw = match encoding.or_sniffed(payload) {
        Some(Encoding::Json) => batch_json::parse(payload)?,
        Some(Encoding::Cbor) => batch_cbor::parse(payload, limits.samples_max)?,
        Some(Encoding::Unknown) | None => return Err(BatchError::UnknownEncoding),
    };
    believe(raw, site, limits)
}

/// Checks everything a parser cannot.
fn believe(raw: RawBatch, site: &Site, limits: &BatchLimits) -> Result<SampleBatch, BatchError> {
    let version = required(raw.version, "v")?;
    if version != VERSION {
        return Err(BatchError::UnknownVersion { found: version });
    }
    let of_site = valid_name(required(raw.site, "site")?, "site")?;
    let stream = valid_name(required(raw.stream, "stream")?, "stream")?;
    if of_site != site.name {
        return Err(BatchError::OtherSite {
            expected: site.name.clone(),
            found: of_site,
        });
    }
    let nominal_hz = required(raw.nominal_hz, "nominal_hz")?;
    let difference_hz = (nominal_hz - site.nominal_hz).abs();
    if difference_hz.is_nan() || difference_hz > NOMINAL_TOLERANCE_HZ {
        return Err(BatchError::NominalDiffers {
            site_hz: site.nominal_hz,
            batch_hz: nominal_hz,
        });
    }
    let rate_fps = valid_rate(required(raw.rate_fps, "rate_fps")?, limits)?;
    let start_ns = required(raw.start_ns, "start_ns")?;
    let raw_channels = required(raw.channels, "channels")?;
    let count = common_length(&raw_channels, limits)?;
    check_times(start_ns, rate_fps, count)?;
    let mut quality = valid_quality(raw.quality, count)?;
    let channels = convert(raw_channels, site, &mut quality)?;
    Ok(SampleBatch {
        site: of_site,
        stream,
        sequence: raw.sequence,
        start_ns,
        rate_fps,
        channels,
        quality,
    })
}

fn required<T>(value: Option<T>, field: &'static str) -> Result<T, BatchError> {
    value.ok_or(BatchError::MissingField { field })
}

/// A name has to be one chunk of a key expression.
fn valid_name(name: String, field: &'static str) -> Result<String, BatchError> {
    let admitted = |c: char| !"/*$?#".contains(c) && !c.is_whitespace() && !c.is_control();
    if (1..=NAME_BYTES_MAX).contains(&name.len()) && name.chars().all(admitted) {
        return Ok(name);
    }
    Err(BatchError::BadName {
        field,
        name: shortened(&name),
        bytes_max: NAME_BYTES_MAX,
    })
}

fn valid_rate(rate_fps: f64, limits: &BatchLimits) -> Result<f64, BatchError> {
    if (limits.rate_fps_min..=limits.rate_fps_max).contains(&rate_fps) {
        return Ok(rate_fps);
    }
    Err(BatchError::BadRate {
        rate_fps,
        min_fps: limits.rate_fps_min,
        max_fps: limits.rate_fps_max,
    })
}

/// The number of samples, the same in every channel.
fn common_length(channels: &[RawChannel], limits: &BatchLimits) -> Result<usize, BatchError> {
    let first = channels.first().ok_or(BatchError::NoChannel)?;
    let expected = first.values.len();
    for (at, channel) in channels.iter().enumerate() {
        if channels[..at].iter().any(|c| c.channel == channel.channel) {
            return Err(BatchError::ChannelTwice {
                channel: channel.channel,
            });
        }
        if channel.values.len() != expected {
            return Err(BatchError::UnequalLengths {
                field: channel_name(channel.channel),
                found: channel.values.len(),
                expected,
            });
        }
    }
    match expected {
        0 => Err(BatchError::NoSample),
        count if count > limits.samples_max => Err(BatchError::TooManySamples {
            max: limits.samples_max,
        }),
        count => Ok(count),
    }
}

/// All samples have to lie between 1970 and the end of 64-bit nanoseconds.
fn check_times(start_ns: i64, rate_fps: f64, count: usize) -> Result<(), BatchError> {
    let span_ns = grid_offset_ns(count as f64, rate_fps);
    if start_ns >= 0 && start_ns.checked_add(span_ns).is_some() {
        Ok(())
    } else {
        Err(BatchError::BadStart { start_ns })
    }
}

fn valid_quality(flags: Option<Vec<u32>>, count: usize) -> Result<Vec<Quality>, BatchError> {
    let Some(flags) = flags else {
        return Ok(vec![Quality::GOOD; count]);
    };
    if flags.len() != count {
        return Err(BatchError::UnequalLengths {
            field: "quality",
            found: flags.len(),
            expected: count,
        });
    }
    if let Some(index) = flags.iter().position(|flag| flag & !QUALITY_BITS != 0) {
        return Err(BatchError::UnknownQuality {
            index,
            flags: flags[index],
        });
    }
    Ok(flags.into_iter().map(Quality).collect())
}

fn convert(
    raw: Vec<RawChannel>,
    site: &Site,
    quality: &mut [Quality],
) -> Result<Vec<(Channel, Vec<f64>)>, BatchError> {
    let mut channels = Vec::with_capacity(raw.len());
    for RawChannel {
        channel,
        unit,
        mut values,
    } in raw
    {
        let factor = factor_to_own(channel, &unit, site).ok_or_else(|| BatchError::WrongUnit {
            channel,
            unit: shortened(&unit),
        })?;
        for (value, quality) in values.iter_mut().zip(quality.iter_mut()) {
            *value *= factor;
            if !value.is_finite() {
                *value = f64::NAN;
                if channel != Channel::NegativeSequenceRatio {
                    *quality = *quality | Quality::NOT_FINITE;
                }
            }
        }
        channels.push((channel, values));
    }
    Ok(channels)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::adapters::wire::v1::{encode_batch_cbor, encode_batch_json, examples};

    fn decode(payload: &[u8]) -> Result<SampleBatch, BatchError> {
        decode_batch(
            payload,
            Encoding::Unknown,
            &examples::site(),
            &BatchLimits::default(),
        )
    }

    fn document() -> Value {
        json!({
            "v": 1, "site": "site-01", "stream": "pmu-1", "sequence": 3,
            "start_ns": 1_770_873_060_000_000_000_u64, "rate_fps": 60, "nominal_hz": 60,
            "channels": [
                {"channel": "voltage", "unit": "kV", "values": [23, 11.5]},
                {"channel": "angle", "unit": "deg", "values": [90, -180]},
                {"channel": "active_power", "unit": "MW", "values": [100, 50]},
                {"channel": "reactive_power", "unit": "MVAr", "values": [20, -20]},
            ],
            "comment": "unknown fields are passed over",
        })
    }

    fn with(field: &str, value: Value) -> Vec<u8> {
        let mut document = document();
        document[field] = value;
        document.to_string().into_bytes()
    }

    fn with_channel(channel: &str, unit: &str, values: impl Into<Value>) -> Vec<u8> {
        let values: Value = values.into();
        with(
            "channels",
            json!([{"channel": channel, "unit": unit, "values": values}]),
        )
    }

    #[test]
    fn a_batch_comes_back_bit_by_bit_in_both_encodings() {
        let batch = examples::batch();
        let cbor = encode_batch_cbor(&batch, 60.0).unwrap();
        let json = encode_batch_json(&batch, 60.0).unwrap();
        assert_eq!(decode(&cbor).unwrap(), batch);
        assert_eq!(decode(&json).unwrap(), batch);
        assert!(cbor.len() < json.len());
    }

    #[test]
    fn values_are_converted_to_the_base_of_the_site() {
        let batch = decode(document().to_string().as_bytes()).unwrap();
        let expected = [
            (Channel::VoltagePu, [1.0, 0.5]),
            (
                Channel::AngleRad,
                [std::f64::consts::FRAC_PI_2, -std::f64::consts::PI],
            ),
            (Channel::ActivePu, [0.5, 0.25]),
            (Channel::ReactivePu, [0.1, -0.1]),
        ];
        for ((channel, values), (expected_channel, expected)) in batch.channels.iter().zip(expected)
        {
            assert_eq!(*channel, expected_channel);
            for (value, expected) in values.iter().zip(expected) {
                // Two roundings, one of the factor and one of the product.
                assert!(
                    (value - expected).abs() <= 4.0 * f64::EPSILON,
                    "{channel:?}"
                );
            }
        }
        assert_eq!(batch.quality, [Quality::GOOD; 2]);
    }

    #[test]
    fn a_null_marks_its_sample_and_no_other() {
        let batch = decode(&with_channel("voltage", "pu", json!([1, null, 1]))).unwrap();
        assert!(batch.channels[0].1[1].is_nan());
        assert_eq!(
            batch.quality,
            [Quality::GOOD, Quality::NOT_FINITE, Quality::GOOD]
        );
        let mut unbalance = examples::batch();
        unbalance.channels[0].1[0] = f64::INFINITY;
        unbalance.channels[5].1[2] = f64::NAN;
        let batch = decode(&encode_batch_cbor(&unbalance, 60.0).unwrap()).unwrap();
        assert!(batch.quality[0].contains(Quality::NOT_FINITE));
        assert_eq!(batch.quality[2], unbalance.quality[2]);
    }

    #[test]
    fn a_start_in_digits_is_the_same_start() {
        let batch = decode(&with("start_ns", json!("1770873060000000001"))).unwrap();
        assert_eq!(batch.start_ns, 1_770_873_060_000_000_001);
    }

    #[test]
    fn every_mistake_has_its_reason() {
        let voltage = |value: Value| with_channel("voltage", "pu", value);
        let twice = json!([
            {"channel": "voltage", "unit": "pu", "values": [1]},
            {"channel": "voltage", "unit": "pu", "values": [1]},
        ]);
        let uneven = json!([
            {"channel": "voltage", "unit": "pu", "values": [1, 1]},
            {"channel": "frequency", "unit": "Hz", "values": [60]},
        ]);
        let mistakes: Vec<(Vec<u8>, &str)> = vec![
            (b"".to_vec(), "unknown_encoding"),
            (b"time_s,v_pu".to_vec(), "unknown_encoding"),
            (vec![0; 100], "unknown_encoding"),
            (b"{\"v\":1".to_vec(), "malformed"),
            (b"{}".to_vec(), "missing_field"),
            (b"\xa0".to_vec(), "missing_field"),
            (b"\xa1\x00\x02".to_vec(), "unknown_version"),
            (with("v", json!(2)), "unknown_version"),
            (b"{\"v\":2,\"site\":7}".to_vec(), "unknown_version"),
            (with("v", json!("1")), "malformed"),
            (with("site", json!("a/b")), "bad_name"),
            (with("site", json!("")), "bad_name"),
            (with("site", json!("x".repeat(129))), "bad_name"),
            (with("stream", json!("*")), "bad_name"),
            (with("site", json!("site-02")), "other_site"),
            (with("nominal_hz", json!(50)), "nominal_differs"),
            (with("nominal_hz", Value::Null), "missing_field"),
            (with("rate_fps", json!(0)), "bad_rate"),
            (with("rate_fps", json!(-60)), "bad_rate"),
            (with("rate_fps", json!(1e12)), "bad_rate"),
            (with("start_ns", json!(-1)), "bad_start"),
            (with("start_ns", json!(i64::MAX)), "bad_start"),
            (with("start_ns", json!("now")), "malformed"),
            (with("start_ns", json!(1.5)), "malformed"),
            (with("channels", json!([])), "no_channel"),
            (with_channel("current", "A", json!([1])), "unknown_channel"),
            (with("channels", twice), "channel_twice"),
            (with_channel("voltage", "V", json!([1])), "wrong_unit"),
            (
                with_channel("active_power", "MVAr", json!([1])),
                "wrong_unit",
            ),
            (with("channels", uneven), "unequal_lengths"),
            (with("quality", json!([0])), "unequal_lengths"),
            (with("quality", json!([0, 0x4000_0000])), "unknown_quality"),
            (voltage(json!([])), "no_sample"),
            (voltage(json!(vec![1; 20_001])), "too_many_samples"),
            (voltage(json!(["1"])), "malformed"),
            (vec![b' '; (4 << 20) + 1], "too_large"),
        ];
        for (payload, label) in mistakes {
            let error = decode(&payload).unwrap_err();
            let shown = String::from_utf8_lossy(&payload[..payload.len().min(300)]);
            assert_eq!(error.label(), label, "{error}: {shown}");
        }
    }

    #[test]
    fn messages_name_what_is_wrong_and_what_is_accepted() {
        let message = |payload: &[u8]| decode(payload).unwrap_err().to_string();
        assert_eq!(
            message(&with_channel("voltage", "mV", json!([1]))),
            "channel `voltage` cannot be in `mV`; accepted: pu, kV (line to line)"
        );
        assert_eq!(
            message(&with("rate_fps", json!(0))),
            "a rate of 0 samples per second is outside 1 to 10000"
        );
        let told = message(&with("start_ns", json!(1e19)));
        assert!(
            told.starts_with("the batch is not a well-formed JSON document: start_ns is no whole"),
            "{told}"
        );
    }

    #[test]
    fn a_file_of_zeros_is_refused_whatever_it_is_said_to_be() {
        for encoding in [Encoding::Cbor, Encoding::Json, Encoding::Unknown] {
            let limits = BatchLimits::default();
            assert!(decode_batch(&[0; 4096], encoding, &examples::site(), &limits).is_err());
        }
    }

    #[test]
    fn no_mutant_panics_or_gets_through_inconsistent() {
        let batch = examples::batch();
        let seeds = [
            encode_batch_cbor(&batch, 60.0).unwrap(),
            encode_batch_json(&batch, 60.0).unwrap(),
            document().to_string().into_bytes(),
            named_cbor(),
        ];
        let mut random = Xorshift(0x9e37_79b9_7f4a_7c15);
        let mut accepted = 0_u32;
        for round in 0..60_000 {
            let mut payload = seeds[round % seeds.len()].clone();
            mutate(&mut payload, &mut random);
            for encoding in [Encoding::Unknown, Encoding::Cbor] {
                let limits = BatchLimits::default();
                let Ok(batch) = decode_batch(&payload, encoding, &examples::site(), &limits) else {
                    continue;
                };
                accepted += 1;
                assert!(!batch.is_empty() && batch.rate_fps > 0.0);
                assert!(batch.channels.iter().all(|(_, v)| v.len() == batch.len()));
            }
        }
        // Enough mutants must be half right for the test to reach the depths of the decoder.
        assert!(accepted > 1_000, "{accepted}");
    }

    /// The document with names as keys, of indefinite length, with half floats.
    fn named_cbor() -> Vec<u8> {
        let mut encoder = minicbor::Encoder::new(Vec::new());
        encoder.tag(minicbor::data::Tag::new(55_799)).unwrap();
        encoder.begin_map().unwrap();
        encoder.str("v").unwrap().u8(1).unwrap();
        encoder.str("site").unwrap().str("site-01").unwrap();
        encoder.str("stream").unwrap().str("s").unwrap();
        encoder.str("start_ns").unwrap().u64(1).unwrap();
        encoder.str("rate_fps").unwrap().u8(60).unwrap();
        encoder.str("nominal_hz").unwrap().f32(60.0).unwrap();
        encoder.str("channels").unwrap().begin_array().unwrap();
        encoder.begin_map().unwrap().str("values").unwrap();
        encoder.begin_array().unwrap().null().unwrap();
        // 1.5 as a half float, then 1 as an integer.
        encoder.writer_mut().extend_from_slice(&[0xf9, 0x3e, 0x00]);
        encoder.u8(1).unwrap().end().unwrap();
        encoder.str("unit").unwrap().str("pu").unwrap();
        encoder.str("channel").unwrap().str("voltage").unwrap();
        encoder.end().unwrap().end().unwrap().end().unwrap();
        encoder.into_writer()
    }

    #[test]
    fn cbor_with_names_and_indefinite_lengths_is_read() {
        let batch = decode(&named_cbor()).unwrap();
        assert_eq!(batch.sequence, None);
        let values = &batch.channels[0].1;
        assert!(values[0].is_nan());
        assert_eq!(values[1..], [1.5, 1.0]);
        assert_eq!(batch.quality[0], Quality::NOT_FINITE);
    }

    struct Xorshift(u64);

    impl Xorshift {
        fn below(&mut self, bound: usize) -> usize {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            usize::try_from(self.0 >> 33).unwrap() % bound.max(1)
        }
    }

    /// One to three of: a changed byte, a removed, a doubled or an inserted stretch, a cut.
    fn mutate(payload: &mut Vec<u8>, random: &mut Xorshift) {
        for _ in 0..=random.below(3) {
            if payload.is_empty() {
                return;
            }
            let at = random.below(payload.len());
            let end = (at + 1 + random.below(9)).min(payload.len());
            match random.below(8) {
                0..4 => payload[at] = u8::try_from(random.below(256)).unwrap(),
                4 => drop(payload.drain(at..end)),
                5 => {
                    let stretch = payload[at..end].to_vec();
                    payload.splice(at..at, stretch);
                }
                6 => payload.insert(at, [0x1b, 0xff, 0x9b, 0x7f, b'9'][random.below(5)]),
                _ => payload.truncate(at),
            }
        }
    }
}
