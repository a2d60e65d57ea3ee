//! The other end: one request to a service's `/api/v1`, for the command line.

use std::{
    io::{self, Read, Write},
    net::{TcpStream, ToSocketAddrs},
    time::Duration,
};

/// Longest wait for the connection, and for each part of the answer.
const PATIENCE: Duration = Duration::from_secs(20);
/// Bytes of an answer at most.
const ANSWER_BYTES_MAX: u64 = 16 << 20;

/// What is asked of a service.
#[derive(Clone, Copy, Debug)]
pub struct Call<'a> {
    /// Address of the service, `http://HOST:PORT`.
    pub server: &'a str,
    /// Path, `/api/v1/...`.
    pub path: &'a str,
    /// Token, for what changes something.
    pub token: Option<&'a str>,
    /// JSON to be posted; none asks for the path.
    pub body: Option<&'a str>,
}

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CallError {
    /// The address is of another kind.
    #[error(
        "`{server}` is not of the form http://HOST:PORT (put a local end of TLS before others)"
    )]
    Address {
        /// Address.
        server: String,
    },
    /// The service cannot be reached, or ends in mid-sentence.
    #[error("cannot talk to {server}: {source}")]
    Connection {
        /// Address.
        server: String,
        /// What the system said.
        source: io::Error,
    },
    /// The answer is not HTTP.
    #[error("{server} does not speak HTTP")]
    NotHttp {
        /// Address.
        server: String,
    },
    /// The service refuses.
    #[error("{server} refuses ({status}): {reason}")]
    Refused {
        /// Address.
        server: String,
        /// Status of HTTP.
        status: u16,
        /// Why, in its words.
        reason: String,
    },
}

impl Call<'_> {
    /// Asks, and returns the body of the answer.
    ///
    /// # Errors
    ///
    /// [`CallError`].
    pub fn answer(&self) -> Result<String, CallError> {
        let server = || self.server.to_owned();
        let host = self
            .server
            .strip_prefix("http://")
            .map(|rest| rest.trim_end_matches('/'))
            .filter(|host| !host.is_empty() && !host.contains(['/', '@', '?', ' ']))
            .ok_or_else(|| CallError::Address { server: server() })?;
        let answer = self
            .exchange(host)
            .map_err(|source| CallError::Connection {
                server: server(),
                source,
            })?;
        let (status, body) =
            understood(&answer).ok_or_else(|| CallError::NotHttp { server: server() })?;
        if (200..300).contains(&status) {
            return Ok(body.to_owned());
        }
        Err(CallError::Refused {
            server: server(),
            status,
            reason: reason(body),
        })
    }

    /// HTTP/1.0: the service closes the connection where its answer ends.
    fn exchange(&self, host: &str) -> io::Result<String> {
        let with_port = if host.rsplit_once(':').is_some_and(|(_, port)| {
            !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit())
        }) {
            host.to_owned()
        } else {
            format!("{host}:80")
        };
        let mut stream = connect(&with_port)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        let method = if self.body.is_some() { "POST" } else { "GET" };
        let mut request = format!("{method} {} HTTP/1.0\r\nHost: {host}\r\n", self.path);
        if let Some(token) = self.token {
            request = format!("{request}Authorization: Bearer {token}\r\n");
        }
        if let Some(body) = self.body {
            let bytes = body.len();
            let head = format!("Content-Type: application/json\r\nContent-Length: {bytes}\r\n");
            request.push_str(&head);
        }
        request.push_str("\r\n");
        request.push_str(self.body.unwrap_or_default());
        stream.write_all(request.as_bytes())?;
        let mut answer = Vec::new();
        stream.take(ANSWER_BYTES_MAX).read_to_end(&mut answer)?;
        Ok(String::from_utf8_lossy(&answer).into_owned())
    }
}

fn connect(host: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(io::ErrorKind::NotFound, "the name has no address");
    for address in host.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Status and body.
fn understood(answer: &str) -> Option<(u16, &str)> {
    let (head, body) = answer.split_once("\r\n\r\n")?;
    let rest = head.strip_prefix("HTTP/1.")?;
    let status = rest.split(' ').nth(1)?.parse().ok()?;
    Some((status, body))
}

/// What an answer of ours says is wrong, or the answer as it is.
fn reason(body: &str) -> String {
    let document: serde_json::Value = serde_json::from_str(body).unwrap_or_default();
    let told = document.get("error").and_then(|error| error.as_str());
    told.unwrap_or(body).chars().take(1000).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn call(server: &str) -> Result<String, CallError> {
        Call {
            server,
            path: "/",
            token: None,
            body: None,
        }
        .answer()
    }

    #[test]
    fn an_address_of_another_kind_is_refused() {
        for server in [
            "https://host",
            "host:80",
            "http://",
            "http://a/b",
            "http://u@h",
        ] {
            assert!(
                matches!(call(server), Err(CallError::Address { .. })),
                "{server}"
            );
        }
    }

    #[test]
    fn an_answer_is_taken_apart() {
        let answer = "HTTP/1.0 403 Forbidden\r\na: b\r\n\r\n{\"error\":\"read-only\"}";
        let (status, body) = understood(answer).unwrap();
        assert_eq!((status, reason(body).as_str()), (403, "read-only"));
        assert_eq!(understood("SSH-2.0"), None);
    }
}
