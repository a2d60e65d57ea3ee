//! Settings of the HTTP server.

use std::net::{Ipv4Addr, SocketAddr};

/// Settings of the HTTP server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HttpOptions {
    /// Address to listen on; none switches the server off. Default `127.0.0.1:9464`. Port 0 takes
    /// a free one.
    pub listen: Option<SocketAddr>,
    /// Rows of one answer at most. Default 200, 1 to 10000.
    pub rows_max: usize,
}

impl Default for HttpOptions {
    fn default() -> Self {
        Self {
            listen: Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 9464))),
            rows_max: 200,
        }
    }
}
