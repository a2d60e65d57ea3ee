//! A server with a store of one site, for tests.

use std::{net::SocketAddr, sync::Arc};

use tempfile::TempDir;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    task::JoinHandle,
};

use crate::{
    adapters::{
        http::{self, Actions, Context, Health, Token},
        store::{NewStructure, Origin, SqliteOptions, SqliteStore, Store, StructureChange},
        wire::v1::examples,
    },
    telemetry::Metrics,
};

pub(super) const TOKEN: &str = "0123456789abcdef";

pub(super) struct Server {
    address: SocketAddr,
    task: JoinHandle<()>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) store: Arc<SqliteStore>,
    /// An event of `site-01` with waveforms.
    pub(super) event: String,
    _directory: TempDir,
}

pub(super) struct Answer {
    pub(super) status: u16,
    pub(super) head: String,
    pub(super) body: String,
}

impl Drop for Server {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Server {
    pub(super) async fn start() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("store.sqlite");
        let store = SqliteStore::open(&path, &SqliteOptions::default()).unwrap();
        store.save_site(&examples::site(), 1).unwrap();
        let plain = ["zip", "induction_motor"].map(str::to_owned).to_vec();
        let structure = NewStructure {
            site: "site-01",
            change: &StructureChange::Set(plain),
            origin: Origin::Configuration,
            actor: "the configuration",
            comment: "",
        };
        store.change_structure(&structure, 1).unwrap();
        let window = examples::window("site-01-19700101T000000.000Z");
        store.save_window(&window, 2).unwrap();
        let health = Health::new(|| 0);
        health.set_store(true);
        health.set_zenoh(true);
        let metrics = Arc::new(Metrics::new().unwrap());
        let store = Arc::new(store);
        let context = Arc::new(Context {
            store: Arc::clone(&store) as Arc<dyn Store>,
            metrics: Arc::clone(&metrics),
            health: Arc::new(health),
            actions: Actions::new(Token::new(TOKEN).ok(), |_| {}),
            open_pages: false,
            rows_max: 100,
        });
        let (listener, address) = http::bind(SocketAddr::from(([127, 0, 0, 1], 0)))
            .await
            .unwrap();
        let task = tokio::spawn(async move {
            http::serve(listener, context, std::future::pending()).await;
        });
        Self {
            address,
            task,
            metrics,
            store,
            event: window.id,
            _directory: directory,
        }
    }

    pub(super) fn origin(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Asks, and reads the answer to its end, or its beginning when it has none.
    pub(super) async fn ask(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &str,
    ) -> Answer {
        let mut stream = TcpStream::connect(self.address).await.unwrap();
        let request = self.head(method, path, headers, body.len()) + body;
        stream.write_all(request.as_bytes()).await.unwrap();
        Self::answer(stream, path).await
    }

    /// Says that a body of so many bytes is to come and reads the answer without sending it.
    pub(super) async fn announce(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        bytes: usize,
    ) -> Answer {
        let mut stream = TcpStream::connect(self.address).await.unwrap();
        let request = self.head(method, path, headers, bytes);
        stream.write_all(request.as_bytes()).await.unwrap();
        Self::answer(stream, path).await
    }

    fn head(&self, method: &str, path: &str, headers: &[(&str, &str)], bytes: usize) -> String {
        let mut request = format!(
            "{method} {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\nContent-Length: {bytes}\r\n",
            self.address,
        );
        for (name, value) in headers {
            for part in [*name, ": ", *value, "\r\n"] {
                request.push_str(part);
            }
        }
        request.push_str("\r\n");
        request
    }

    async fn answer(mut stream: TcpStream, path: &str) -> Answer {
        let mut bytes = Vec::new();
        if path.ends_with("/updates") {
            // It has no end of its own: up to the first change, or to the end of a refusal.
            while !String::from_utf8_lossy(&bytes).contains("event: change") {
                if stream.read_buf(&mut bytes).await.unwrap() == 0 {
                    break;
                }
            }
        } else {
            stream.read_to_end(&mut bytes).await.unwrap();
        }
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or((&text, ""));
        let status = head
            .split(' ')
            .nth(1)
            .and_then(|word| word.parse().ok())
            .unwrap_or(0);
        Answer {
            status,
            head: head.to_owned(),
            body: body.to_owned(),
        }
    }

    pub(super) async fn get(&self, path: &str) -> Answer {
        self.ask("GET", path, &[], "").await
    }
}
