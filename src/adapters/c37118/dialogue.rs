//! What a client says to a source, and what it makes of the answers (6.6; annex F of 2011): stop, ask
//! for the configuration, start; ask again when the data do not fit it. No sockets, no clock: bytes
//! and times go in, [`Step`]s come out.

use super::{
    assembler::ConfigurationAssembler,
    configuration::{Configuration, ConfigurationKind},
    data::DataMessage,
    frame::{Command, CommandFrame, Frame, Prefix, Version, decode},
    time::{TimeQuality, Timestamp},
};

/// Parts of a second in the commands' time stamps.
const COMMAND_TIME_BASE: u32 = 1_000_000;

/// Time between "data off" and the request for the configuration, milliseconds. Sources exist that take
/// what one reading brings for a single command (seen: the Python package `synchrophasor` 1.0.0a0).
const SPACING_MS: i64 = 250;

/// How a client talks to a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DialogueOptions {
    /// IDCODE of the stream that commands address. Default 1.
    pub id_code: u16,
    /// Which configuration is asked for. Default CFG-2, which every source can send.
    pub configuration: ConfigurationKind,
    /// Whether commands are sent. A source that sends by itself (over UDP, mostly) needs none; its
    /// frames are then passed on from the first. Default yes.
    pub commanded: bool,
    /// How long an answer is waited for, milliseconds. Default 5000.
    pub answer_ms: i64,
    /// Times the configuration is asked for before the connection is given up. Default 3.
    pub requests_max: u32,
    /// Silence after which a connection that has brought its configuration is given up, milliseconds.
    /// Default 10 000.
    pub silence_ms: i64,
    /// Time between repetitions of the configuration for those who came later, milliseconds. Default
    /// 60 000.
    pub repeat_ms: i64,
}

impl Default for DialogueOptions {
    fn default() -> Self {
        Self {
            id_code: 1,
            configuration: ConfigurationKind::Configuration2,
            commanded: true,
            answer_ms: 5000,
            requests_max: 3,
            silence_ms: 10_000,
            repeat_ms: 60_000,
        }
    }
}

/// What the client is to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Send these bytes to the source.
    Send(Vec<u8>),
    /// Pass this frame on.
    Pass(Vec<u8>),
    /// Pass this configuration on (one frame, or the parts of a CFG-3), and answer with it whoever
    /// asks.
    Configured(Vec<Vec<u8>>),
    /// Close the connection and begin anew.
    GiveUp(Trouble),
}

/// Why a connection is given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trouble {
    /// The source does not answer with a configuration.
    NoConfiguration,
    /// The source has fallen silent.
    Silent,
}

/// What the frames of a source were.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DialogueCounts {
    /// Data frames passed on.
    pub data: u64,
    /// Configurations, complete ones.
    pub configurations: u64,
    /// Those that differed from the one before.
    pub reconfigurations: u64,
    /// Data frames before the configuration: not passed on.
    pub before_configuration: u64,
    /// Data frames of another length or stream than the configuration says: not passed on.
    pub not_as_configured: u64,
    /// Frames that cannot be read although their check word is right: not passed on.
    pub malformed: u64,
    /// Headers, commands and CFG-1: not passed on.
    pub other: u64,
    /// Commands sent.
    pub commands: u64,
}

/// The client's side of one connection after the other to one source.
#[derive(Clone, Debug)]
pub struct Dialogue {
    options: DialogueOptions,
    assembler: ConfigurationAssembler,
    /// Frames of the configuration that is being received, and of the one in force.
    parts: Vec<Vec<u8>>,
    configured: Option<(Configuration, Vec<Vec<u8>>)>,
    /// Whether this connection has brought a configuration.
    running: bool,
    asked_ms: Option<i64>,
    requests: u32,
    heard_ms: i64,
    repeated_ms: i64,
    counts: DialogueCounts,
}

impl Dialogue {
    /// A dialogue before the first connection.
    #[must_use]
    pub fn new(options: DialogueOptions) -> Self {
        Self {
            options,
            assembler: ConfigurationAssembler::new(),
            parts: Vec::new(),
            configured: None,
            running: false,
            asked_ms: None,
            requests: 0,
            heard_ms: 0,
            repeated_ms: 0,
            counts: DialogueCounts::default(),
        }
    }

    /// What was heard so far.
    #[must_use]
    pub const fn counts(&self) -> DialogueCounts {
        self.counts
    }

    /// Whether this connection has brought a configuration.
    #[must_use]
    pub const fn is_running(&self) -> bool {
        self.running
    }

    /// A connection stands. Times are milliseconds UTC.
    pub fn connected(&mut self, now_ms: i64) -> Vec<Step> {
        self.assembler = ConfigurationAssembler::new();
        self.parts.clear();
        self.running = false;
        self.requests = 0;
        self.heard_ms = now_ms;
        if !self.options.commanded {
            return Vec::new();
        }
        self.asked_ms = Some(now_ms - self.options.answer_ms + SPACING_MS);
        self.command(Command::DataOff, now_ms).into_iter().collect()
    }

    /// A frame with a right check word arrived.
    pub fn frame(&mut self, bytes: Vec<u8>, now_ms: i64) -> Vec<Step> {
        self.heard_ms = now_ms;
        match decode(&bytes) {
            Ok(Frame::Data(message)) => self.data(&message, bytes, now_ms),
            Ok(Frame::Configuration(configuration))
                if configuration.kind == ConfigurationKind::Configuration2 =>
            {
                self.parts = vec![bytes];
                self.configure(configuration, now_ms)
            }
            Ok(Frame::ConfigurationPart(part)) => {
                if part.is_first() {
                    self.parts.clear();
                }
                self.parts.push(bytes);
                match self.assembler.push(part) {
                    Ok(Some(configuration)) => self.configure(configuration, now_ms),
                    Ok(None) => Vec::new(),
                    Err(_) => {
                        self.parts.clear();
                        self.counts.malformed += 1;
                        Vec::new()
                    }
                }
            }
            Ok(_) => {
                self.counts.other += 1;
                Vec::new()
            }
            Err(_) => {
                self.counts.malformed += 1;
                Vec::new()
            }
        }
    }

    /// Time passed; to be called several times a second while a connection stands.
    pub fn tick(&mut self, now_ms: i64) -> Vec<Step> {
        let waits = self.options.commanded && !self.running;
        if !waits && now_ms - self.heard_ms >= self.options.silence_ms {
            return vec![Step::GiveUp(Trouble::Silent)];
        }
        if self.running {
            return self.repeat(now_ms).into_iter().collect();
        }
        if !self.options.commanded || !self.may_ask(now_ms) {
            return Vec::new();
        }
        if self.requests >= self.options.requests_max {
            return vec![Step::GiveUp(Trouble::NoConfiguration)];
        }
        self.ask(now_ms).into_iter().collect()
    }

    fn data(&mut self, message: &DataMessage, bytes: Vec<u8>, now_ms: i64) -> Vec<Step> {
        if !self.running && self.options.commanded {
            self.counts.before_configuration += 1;
            return Vec::new();
        }
        let Some((configuration, _)) = &self.configured else {
            self.counts.data += 1;
            return vec![Step::Pass(bytes)];
        };
        let Ok(frame) = message.decode(configuration) else {
            self.counts.not_as_configured += 1;
            return self.ask_in_passing(now_ms);
        };
        self.counts.data += 1;
        let changes = frame.pmus.iter().any(|p| p.status.configuration_changes());
        let mut steps = vec![Step::Pass(bytes)];
        if changes {
            steps.extend(self.ask_in_passing(now_ms));
        }
        steps
    }

    fn configure(&mut self, configuration: Configuration, now_ms: i64) -> Vec<Step> {
        self.counts.configurations += 1;
        let frames = std::mem::take(&mut self.parts);
        if let Some((before, _)) = &self.configured
            && !before.says_the_same_as(&configuration)
        {
            self.counts.reconfigurations += 1;
        }
        self.configured = Some((configuration, frames.clone()));
        self.repeated_ms = now_ms;
        let mut steps = vec![Step::Configured(frames)];
        if !self.running {
            self.running = true;
            self.requests = 0;
            if self.options.commanded {
                steps.extend(self.command(Command::DataOn, now_ms));
            }
        }
        steps
    }

    fn repeat(&mut self, now_ms: i64) -> Option<Step> {
        if now_ms - self.repeated_ms < self.options.repeat_ms {
            return None;
        }
        self.repeated_ms = now_ms;
        let (_, frames) = self.configured.as_ref()?;
        Some(Step::Configured(frames.clone()))
    }

    /// Asks for the configuration while data flow, not more often than answers may take.
    fn ask_in_passing(&mut self, now_ms: i64) -> Vec<Step> {
        if !self.options.commanded || !self.may_ask(now_ms) {
            return Vec::new();
        }
        self.ask(now_ms).into_iter().collect()
    }

    fn may_ask(&self, now_ms: i64) -> bool {
        self.asked_ms
            .is_none_or(|asked_ms| now_ms - asked_ms >= self.options.answer_ms)
    }

    fn ask(&mut self, now_ms: i64) -> Option<Step> {
        self.asked_ms = Some(now_ms);
        self.requests += 1;
        let command = match self.options.configuration {
            ConfigurationKind::Configuration1 => Command::SendConfiguration1,
            ConfigurationKind::Configuration2 => Command::SendConfiguration2,
            ConfigurationKind::Configuration3 => Command::SendConfiguration3,
        };
        self.command(command, now_ms)
    }

    /// The last word to a source that is sending; none to one that was never asked to.
    pub fn farewell(&mut self, now_ms: i64) -> Option<Step> {
        (self.running && self.options.commanded)
            .then(|| self.command(Command::DataOff, now_ms))
            .flatten()
    }

    /// None for a time that a frame cannot hold.
    fn command(&mut self, command: Command, now_ms: i64) -> Option<Step> {
        const NANOSECONDS_PER_MS: i64 = 1_000_000;
        let utc_ns = now_ms.saturating_mul(NANOSECONDS_PER_MS);
        let time = Timestamp::from_utc_ns(utc_ns, COMMAND_TIME_BASE, TimeQuality(0))?;
        let prefix = Prefix {
            version: Version::Y2005,
            id_code: self.options.id_code,
            time,
        };
        let bytes = CommandFrame { prefix, command }.encode().ok()?;
        self.counts.commands += 1;
        Some(Step::Send(bytes))
    }
}
