//! How the commands that talk to a daemon reach it.

use std::path::PathBuf;

use clap::Args;

use super::Error;
use crate::adapters::zenoh::{Mode, ZenohOptions};

/// Where the daemon is.
#[derive(Clone, Debug, Args)]
pub(super) struct ConnectionArgs {
    /// Endpoint of the daemon or router
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    pub(super) endpoint: Vec<String>,
    /// Prefix of every key expression
    #[arg(long, default_value = "loadmodel/v1")]
    pub(super) prefix: String,
    /// Take endpoint, prefix and TLS from this configuration of a daemon
    #[arg(long, value_name = "FILE", conflicts_with_all = ["endpoint", "prefix"])]
    pub(super) config: Option<PathBuf>,
}

impl ConnectionArgs {
    /// A client that talks to the daemon and nobody else.
    pub(super) fn options(&self) -> Result<ZenohOptions, Error> {
        if let Some(path) = &self.config {
            let daemon = super::run::settings(path)?.zenoh;
            let mut connect = daemon.connect;
            connect.extend(daemon.listen.iter().map(|endpoint| reachable(endpoint)));
            return Ok(client(connect, daemon.prefix, daemon.settings));
        }
        Ok(client(
            self.endpoint.clone(),
            self.prefix.clone(),
            Vec::new(),
        ))
    }
}

/// A client of these endpoints.
pub(super) fn client(
    connect: Vec<String>,
    prefix: String,
    settings: Vec<(String, String)>,
) -> ZenohOptions {
    ZenohOptions {
        prefix,
        mode: Mode::Client,
        listen: Vec::new(),
        connect,
        settings,
        ..ZenohOptions::default()
    }
}

/// An endpoint that listens on all addresses is reached on this machine's own.
fn reachable(listen: &str) -> String {
    listen
        .replace("/0.0.0.0:", "/127.0.0.1:")
        .replace("/[::]:", "/[::1]:")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endpoint_on_all_addresses_is_reached_on_loopback() {
        assert_eq!(reachable("tcp/0.0.0.0:7447"), "tcp/127.0.0.1:7447");
        assert_eq!(reachable("tls/[::]:7447"), "tls/[::1]:7447");
        assert_eq!(reachable("tcp/10.0.0.1:7447"), "tcp/10.0.0.1:7447");
    }
}
