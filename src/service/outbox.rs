//! The commands that one event gives rise to, in order.

use super::Command;
use crate::telemetry::Occurrence;

/// Collects commands.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    commands: Vec<Command>,
}

impl Outbox {
    pub(super) fn push(&mut self, command: Command) {
        self.commands.push(command);
    }

    pub(super) fn report(&mut self, occurrence: impl Occurrence + 'static) {
        self.commands.push(Command::Report(Box::new(occurrence)));
    }

    pub(super) fn into_commands(self) -> Vec<Command> {
        self.commands
    }
}
