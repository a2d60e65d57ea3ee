//! Frames in messages, from the first data frame without a configuration to a changed one.

use super::fixture::{configuration, data, formats};
use crate::{
    adapters::c37118::{
        Configuration, ConfigurationKind, DataFrame, FrameCounts, FrameIntake, FrameOutcome,
        LoadMapping, PhasorSet, Status, Taken, starts_as_frame,
    },
    measurement::{Quality, Site},
};

fn intake() -> FrameIntake {
    let phases = |kind: char| PhasorSet::Phases(['A', 'B', 'C'].map(|p| format!("{kind}{p}")));
    let site = Site {
        name: "north".to_owned(),
        s_base_mva: 30.0,
        v_base_kv: 20.0 * 3.0_f64.sqrt(),
        nominal_hz: 50.0,
    };
    FrameIntake::new(&site, "pmu", &LoadMapping::new(phases('V'), phases('I')))
}

fn configured(format: usize) -> Configuration {
    configuration(
        ConfigurationKind::Configuration2,
        &formats()[format..=format],
    )
}

/// Data frame number `k` at 50 frames/s.
fn frame(configuration: &Configuration, k: u32) -> DataFrame {
    let mut frame = data(configuration);
    frame.prefix.time.fraction = k * 20_000;
    frame
}

fn bytes(configuration: &Configuration, k: u32) -> Vec<u8> {
    frame(configuration, k).encode(configuration).unwrap()
}

fn counted(taken: &Taken) -> Vec<(&'static str, u64)> {
    let all = FrameOutcome::ALL.map(|outcome| (outcome.label(), taken.counts.of(outcome)));
    all.into_iter().filter(|(_, count)| *count > 0).collect()
}

#[test]
fn data_before_a_configuration_are_counted_and_ask_for_it() {
    let (mut intake, configuration) = (intake(), configured(15));
    let taken = intake.take(&bytes(&configuration, 0));
    assert_eq!(counted(&taken), [("no_configuration", 1)]);
    assert!(taken.wants_configuration && taken.batches.is_empty());

    let taken = intake.take(&configuration.encode().unwrap()[0]);
    assert_eq!(counted(&taken), [("configuration", 1)]);
    let taken = intake.take(&bytes(&configuration, 1));
    assert_eq!(counted(&taken), [("sample", 1)]);
    assert!(!taken.wants_configuration && taken.trouble.is_none());
    let batch = &taken.batches[0];
    assert_eq!(
        (batch.site.as_str(), batch.stream.as_str()),
        ("north", "pmu")
    );
    assert_eq!((batch.len(), batch.rate_fps), (1, 50.0));
    assert_eq!(batch.start_ns % 1_000_000_000, 20_000_000);
    assert!((batch.channels[0].1[0] - 1.0).abs() < 1e-4, "{batch:?}");
}

#[test]
fn several_frames_of_one_message_are_one_batch_and_a_gap_cuts_it() {
    let (mut intake, configuration) = (intake(), configured(15));
    let mut message = configuration.encode().unwrap().remove(0);
    for k in [0, 1, 2, 10, 11] {
        message.extend(bytes(&configuration, k));
    }
    let taken = intake.take(&message);
    assert_eq!(counted(&taken), [("sample", 5), ("configuration", 1)]);
    let lengths: Vec<usize> = taken
        .batches
        .iter()
        .map(crate::measurement::batch::SampleBatch::len)
        .collect();
    assert_eq!(lengths, [3, 2]);
}

#[test]
fn a_changed_configuration_is_taken_over_and_one_that_does_not_fit_is_asked_for() {
    let (mut intake, before, after) = (intake(), configured(15), configured(0));
    intake.take(&before.encode().unwrap()[0]);
    let taken = intake.take(&bytes(&after, 0));
    assert_eq!(counted(&taken), [("not_as_configured", 1)]);
    assert!(taken.wants_configuration);
    let taken = intake.take(&after.encode().unwrap()[0]);
    assert_eq!(counted(&taken), [("reconfiguration", 1)]);
    let taken = intake.take(&after.encode().unwrap()[0]);
    assert_eq!(counted(&taken), [("configuration", 1)]);
    assert_eq!(counted(&intake.take(&bytes(&after, 0))), [("sample", 1)]);
}

#[test]
fn a_source_that_announces_a_change_is_asked_and_still_used() {
    let (mut intake, configuration) = (intake(), configured(15));
    intake.take(&configuration.encode().unwrap()[0]);
    let mut frame = frame(&configuration, 0);
    frame.pmus[0].status = Status(0x0400);
    let taken = intake.take(&frame.encode(&configuration).unwrap());
    assert_eq!(counted(&taken), [("sample", 1)]);
    assert!(taken.wants_configuration);
    assert_eq!(taken.batches[0].quality, [Quality(0x0400)]);
}

#[test]
fn a_stream_that_lacks_a_mapped_channel_says_so() {
    let (mut intake, mut configuration) = (intake(), configured(15));
    configuration.pmus[0].phasors[0].name = "other".to_owned();
    intake.take(&configuration.encode().unwrap()[0]);
    let taken = intake.take(&bytes(&configuration, 0));
    assert_eq!(counted(&taken), [("not_mapped", 1)]);
    assert!(taken.trouble.unwrap().1.contains("`VA`"));
}

#[test]
fn damaged_frames_are_told_apart_and_the_sound_ones_used() {
    let (mut intake, configuration) = (intake(), configured(15));
    let mut message = configuration.encode().unwrap().remove(0);
    let mut damaged = bytes(&configuration, 0);
    damaged[20] ^= 1;
    message.extend(damaged);
    message.extend(bytes(&configuration, 1));
    message.extend([0xaa, 0x01, 0, 0]);
    let taken = intake.take(&message);
    let expected = [
        ("sample", 1),
        ("configuration", 1),
        ("bad_checksum", 1),
        ("malformed", 1),
    ];
    assert_eq!(counted(&taken), expected);
    assert_eq!(taken.trouble.unwrap().0, FrameOutcome::BadChecksum);
    let mut all = FrameCounts::default();
    all.add(&taken.counts);
    assert_eq!(all, taken.counts);
}

#[test]
fn a_cbor_map_of_ten_pairs_is_no_frame() {
    // Ten pairs, the first key 0, 1 or the text "v".
    for head in [
        [0xaa, 0x00, 0x01, 0x01],
        [0xaa, 0x01, 0x65, 0x6e],
        [0xaa, 0x61, 0x76, 0x01],
    ] {
        let mut payload = head.to_vec();
        payload.resize(200, 0);
        assert!(!starts_as_frame(&payload), "{head:x?}");
    }
    assert!(starts_as_frame(&bytes(&configured(0), 0)));
    assert!(!starts_as_frame(&[0xaa]));
}
