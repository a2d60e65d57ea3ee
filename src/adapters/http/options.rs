//! Settings of the HTTP server.

use std::{
    net::{Ipv4Addr, SocketAddr},
    path::PathBuf,
};

use super::Token;

/// Settings of the HTTP server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpOptions {
    /// Address to listen on; none switches the server off. Default `127.0.0.1:9464`. Port 0 takes
    /// a free one.
    pub listen: Option<SocketAddr>,
    /// Rows of one answer at most. Default 200, 1 to 10000.
    pub rows_max: usize,
    /// Whether the pages act without asking for the token when reached by an address of this machine:
    /// for demonstrations. Default: no.
    pub open_pages: bool,
    /// The token that whoever changes things must show. Default: the credential, if there is one.
    pub token: TokenSource,
}

/// Where the token comes from.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub enum TokenSource {
    /// The file `http-token` in the directory of systemd's credentials; without one nobody may
    /// change anything.
    #[default]
    Credential,
    /// The first line of a file.
    File(PathBuf),
    /// This one.
    Given(Token),
}

impl Default for HttpOptions {
    fn default() -> Self {
        Self {
            listen: Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 9464))),
            rows_max: 200,
            open_pages: false,
            token: TokenSource::Credential,
        }
    }
}
