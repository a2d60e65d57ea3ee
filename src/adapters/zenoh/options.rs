//! Settings of the zenoh session and of what is put through it.

/// How the session takes part in the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Mode {
    /// Talks to others directly; the default.
    #[default]
    Peer,
    /// Talks through a router.
    Client,
    /// Is a router itself.
    Router,
}

impl Mode {
    /// Every mode.
    pub const ALL: [Self; 3] = [Self::Peer, Self::Client, Self::Router];

    /// Name in the configuration, which is zenoh's own.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Peer => "peer",
            Self::Client => "client",
            Self::Router => "router",
        }
    }
}

/// Settings of the zenoh session. The defaults reach nobody outside this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ZenohOptions {
    /// Prefix of every key expression. Default `loadmodel/v1`.
    pub prefix: String,
    /// How the session takes part in the network. Default [`Mode::Peer`].
    pub mode: Mode,
    /// Endpoints to listen on. Default `tcp/127.0.0.1:7447`; empty in client mode.
    pub listen: Vec<String>,
    /// Endpoints to connect to. Default none.
    pub connect: Vec<String>,
    /// Whether to look for others by multicast. Default no.
    pub multicast: bool,
    /// Further settings of zenoh: its own key (`transport/link/tls/root_ca_certificate`,
    /// `access_control`) and the value as JSON. Applied last, in this order.
    pub settings: Vec<(String, String)>,
    /// Messages that wait for the decoder; beyond it they are dropped and counted. Default 32768,
    /// half a second of a thousand streams of 60 frames/s; 128 to 1000000.
    pub intake_messages_max: usize,
    /// Longest wait for the session to close, milliseconds. Default 2000.
    pub close_timeout_ms: u64,
}

impl Default for ZenohOptions {
    fn default() -> Self {
        Self {
            prefix: "loadmodel/v1".to_owned(),
            mode: Mode::Peer,
            listen: vec!["tcp/127.0.0.1:7447".to_owned()],
            connect: Vec::new(),
            multicast: false,
            settings: Vec::new(),
            intake_messages_max: 32_768,
            close_timeout_ms: 2000,
        }
    }
}
