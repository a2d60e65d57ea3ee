//! What the user sees: sentences for people, or lines of JSON for programs.

use std::io::{self, Write};

use super::{scene::Scene, set_in_words};
use crate::{commands::Error, daemon::Daemon};

/// Sentences go to standard output; with `--json` they go to standard error, and standard output
/// holds one line per set and nothing else.
pub(super) struct Stage<'o> {
    json: bool,
    out: &'o mut dyn Write,
    sets: u64,
}

impl<'o> Stage<'o> {
    pub(super) fn new(json: bool, out: &'o mut dyn Write) -> Self {
        Self { json, out, sets: 0 }
    }

    /// Sets that were shown.
    pub(super) const fn sets_shown(&self) -> u64 {
        self.sets
    }

    pub(super) fn say(&mut self, sentence: &str) -> Result<(), Error> {
        if self.json {
            writeln!(io::stderr(), "{sentence}")?;
        } else {
            writeln!(self.out, "{sentence}")?;
            self.out.flush()?;
        }
        Ok(())
    }

    pub(super) fn set(&mut self, document: &str) -> Result<(), Error> {
        self.sets += 1;
        if self.json {
            writeln!(self.out, "{document}")?;
            self.out.flush()?;
            return Ok(());
        }
        self.say(&format!("received: {}", set_in_words(document)))
    }

    pub(super) fn welcome(&mut self, daemon: &Daemon, scene: &Scene) -> Result<(), Error> {
        let endpoints = daemon.endpoints().join(" ");
        let sites: Vec<&str> = scene.plan.sites.iter().map(|s| s.name.as_str()).collect();
        self.say(&format!(
            "loadmodeld {} watches {}",
            env!("CARGO_PKG_VERSION"),
            sites.join(", ")
        ))?;
        if let Some(http) = daemon.http_address() {
            self.say(&format!("  page      http://{http}/"))?;
            self.say(&format!("  metrics   http://{http}/metrics"))?;
        }
        self.say(&format!("  zenoh     {endpoints}"))?;
        self.say(&format!(
            "  subscribe loadmodeld subscribe --endpoint {endpoints}"
        ))?;
        self.say(&format!("  store     {}", scene.store().display()))?;
        for note in &scene.plan.notes {
            self.say(&format!("  note      {note}"))?;
        }
        Ok(())
    }

    pub(super) fn farewell(&mut self, daemon: &Daemon) -> Result<(), Error> {
        let status = daemon.status();
        self.say(&format!(
            "done: {} sets published in this run",
            status.sets_published
        ))
    }
}
