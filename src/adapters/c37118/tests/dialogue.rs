//! A client's side of the conversation, event by event.

use super::fixture::{configuration, data, formats};
use crate::adapters::c37118::{
    Command, Configuration, ConfigurationKind, Dialogue, DialogueOptions, Frame, Status, Step,
    Trouble, decode,
};

const START_MS: i64 = 1_700_000_000_000;

fn configured(format: usize) -> Configuration {
    configuration(
        ConfigurationKind::Configuration2,
        &formats()[format..=format],
    )
}

fn data_bytes(configuration: &Configuration) -> Vec<u8> {
    data(configuration).encode(configuration).unwrap()
}

/// The commands among the steps.
fn commands(steps: &[Step]) -> Vec<Command> {
    let sent = steps.iter().filter_map(|step| match step {
        Step::Send(bytes) => Some(bytes),
        _ => None,
    });
    sent.map(|bytes| match decode(bytes).unwrap() {
        Frame::Command(frame) => frame.command,
        other => panic!("{other:?}"),
    })
    .collect()
}

fn running() -> (Dialogue, Configuration) {
    let (mut dialogue, configuration) = (Dialogue::new(DialogueOptions::default()), configured(15));
    dialogue.connected(START_MS - 250);
    dialogue.tick(START_MS);
    dialogue.frame(configuration.encode().unwrap().remove(0), START_MS + 100);
    (dialogue, configuration)
}

#[test]
fn a_source_is_stopped_asked_and_started() {
    let mut dialogue = Dialogue::new(DialogueOptions::default());
    let steps = dialogue.connected(START_MS);
    assert_eq!(commands(&steps), [Command::DataOff]);
    // Not in one breath: there are sources that would hear the first command only.
    assert_eq!(dialogue.tick(START_MS + 249), []);
    let steps = dialogue.tick(START_MS + 250);
    assert_eq!(commands(&steps), [Command::SendConfiguration2]);
    let configuration = configured(15);
    assert_eq!(dialogue.frame(data_bytes(&configuration), START_MS), []);
    let frame = configuration.encode().unwrap().remove(0);
    let steps = dialogue.frame(frame.clone(), START_MS + 10);
    assert_eq!(steps[0], Step::Configured(vec![frame]));
    assert_eq!(commands(&steps), [Command::DataOn]);
    let bytes = data_bytes(&configuration);
    let steps = dialogue.frame(bytes.clone(), START_MS + 20);
    assert_eq!(steps, [Step::Pass(bytes)]);
    let counts = dialogue.counts();
    assert_eq!(
        (counts.before_configuration, counts.data, counts.commands),
        (1, 1, 3)
    );
}

#[test]
fn a_source_that_does_not_answer_is_asked_three_times_and_given_up() {
    let mut dialogue = Dialogue::new(DialogueOptions::default());
    dialogue.connected(START_MS - 250);
    assert_eq!(commands(&dialogue.tick(START_MS)).len(), 1);
    for answer in [1, 2] {
        assert_eq!(dialogue.tick(START_MS + answer * 5000 - 1), []);
        let steps = dialogue.tick(START_MS + answer * 5000);
        assert_eq!(commands(&steps), [Command::SendConfiguration2]);
    }
    assert_eq!(
        dialogue.tick(START_MS + 15_000),
        [Step::GiveUp(Trouble::NoConfiguration)]
    );
}

#[test]
fn silence_ends_a_connection_and_the_next_one_begins_anew() {
    let (mut dialogue, configuration) = running();
    dialogue.frame(data_bytes(&configuration), START_MS + 200);
    assert_eq!(dialogue.tick(START_MS + 10_199), []);
    let steps = dialogue.tick(START_MS + 10_200);
    assert_eq!(steps, [Step::GiveUp(Trouble::Silent)]);
    let steps = dialogue.connected(START_MS + 11_000);
    assert_eq!(commands(&steps), [Command::DataOff]);
    assert!(!dialogue.is_running());
}

#[test]
fn data_that_do_not_fit_make_it_ask_again_but_not_at_every_frame() {
    let (mut dialogue, _) = running();
    let other = configured(0);
    let asked = |dialogue: &mut Dialogue, at_ms| {
        commands(&dialogue.frame(data_bytes(&other), START_MS + at_ms)).len()
    };
    // The configuration was asked for at the start: an answer may take 5 s.
    assert_eq!(asked(&mut dialogue, 4900), 0);
    assert_eq!(asked(&mut dialogue, 5000), 1);
    assert_eq!(asked(&mut dialogue, 5020), 0);
    let steps = dialogue.frame(other.encode().unwrap().remove(0), START_MS + 5100);
    assert!(
        matches!(steps[..], [Step::Configured(_)]),
        "already started"
    );
    let steps = dialogue.frame(data_bytes(&other), START_MS + 5120);
    assert!(matches!(steps[..], [Step::Pass(_)]));
    let counts = dialogue.counts();
    assert_eq!((counts.not_as_configured, counts.reconfigurations), (3, 1));
}

#[test]
fn an_announced_change_is_passed_on_and_asked_about() {
    let (mut dialogue, configuration) = running();
    let mut frame = data(&configuration);
    frame.pmus[0].status = Status(0x0400);
    let bytes = frame.encode(&configuration).unwrap();
    let steps = dialogue.frame(bytes, START_MS + 6000);
    assert!(matches!(steps[0], Step::Pass(_)));
    assert_eq!(commands(&steps), [Command::SendConfiguration2]);
}

#[test]
fn the_configuration_is_repeated_for_those_who_come_later() {
    let (mut dialogue, configuration) = running();
    let frame = configuration.encode().unwrap();
    dialogue.frame(data_bytes(&configuration), START_MS + 60_000);
    assert_eq!(dialogue.tick(START_MS + 60_099), []);
    let steps = dialogue.tick(START_MS + 60_100);
    assert_eq!(steps, [Step::Configured(frame)]);
    assert_eq!(dialogue.tick(START_MS + 60_200), []);
}

#[test]
fn a_source_that_sends_by_itself_is_only_listened_to() {
    let mut dialogue = Dialogue::new(DialogueOptions {
        commanded: false,
        ..DialogueOptions::default()
    });
    assert_eq!(dialogue.connected(START_MS), []);
    let configuration = configured(15);
    let bytes = data_bytes(&configuration);
    assert_eq!(dialogue.frame(bytes.clone(), START_MS), [Step::Pass(bytes)]);
    let frame = configuration.encode().unwrap().remove(0);
    let steps = dialogue.frame(frame.clone(), START_MS);
    assert_eq!(steps, [Step::Configured(vec![frame])]);
    assert_eq!(
        dialogue.frame(data_bytes(&configured(0)), START_MS + 9000),
        []
    );
    assert_eq!(dialogue.counts().commands, 0);
    assert_eq!(dialogue.farewell(START_MS), None);
}

#[test]
fn a_configuration_in_parts_is_handed_on_whole() {
    let frames = configuration_of_parts().encode().unwrap();
    assert!(frames.len() > 1, "one frame only");
    let mut dialogue = Dialogue::new(DialogueOptions {
        configuration: ConfigurationKind::Configuration3,
        ..DialogueOptions::default()
    });
    dialogue.connected(START_MS - 250);
    let steps = dialogue.tick(START_MS);
    assert_eq!(commands(&steps), [Command::SendConfiguration3]);
    let (last, first) = frames.split_last().unwrap();
    for frame in first {
        assert_eq!(dialogue.frame(frame.clone(), START_MS), []);
    }
    let steps = dialogue.frame(last.clone(), START_MS);
    assert_eq!(steps[0], Step::Configured(frames.clone()));
}

/// A CFG-3 of so many PMUs that one frame does not hold it.
fn configuration_of_parts() -> Configuration {
    let formats = vec![formats()[15]; 200];
    configuration(ConfigurationKind::Configuration3, &formats)
}
