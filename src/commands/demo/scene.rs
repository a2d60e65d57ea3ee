//! What the demonstration is made of: recordings, a place for the store, settings.

use std::{
    collections::BTreeMap,
    fs,
    io::Read,
    net::{SocketAddr, TcpListener},
    path::{Path, PathBuf},
    thread,
};

use tempfile::TempDir;

use crate::{
    adapters::{
        bundled,
        http::{HttpOptions, Token, TokenSource},
        store::SqliteOptions,
        wire::v1::{BatchLimits, RecordingLimits},
        zenoh::ZenohOptions,
    },
    commands::{Error, replay::Plan},
    daemon::Settings,
    disturbance::{DetectorOptions, ScreeningOptions},
    load_model::Structure,
    measurement::ConcentratorOptions,
    service::{ServiceOptions, SiteOptions},
};

const SECOND_NS: i64 = 1_000_000_000;
/// Name of the store's file.
const STORE_FILE: &str = "loadmodeld.sqlite";
/// Fits at one time at most: each uses several threads of its own.
const WORKERS_MAX: usize = 2;

/// Recordings and a place for the store.
#[derive(Debug)]
pub(super) struct Scene {
    pub(super) plan: Plan,
    store: PathBuf,
    /// Deleted when the scene is dropped.
    _temporary: TempDir,
}

impl Scene {
    /// Reads the recordings and makes the directories.
    pub(super) fn set(data: &[PathBuf], state: Option<&Path>) -> Result<Self, Error> {
        let temporary = tempfile::tempdir()?;
        let folders = if data.is_empty() {
            bundled::extract_all_to(&temporary.path().join("recordings"))?
        } else {
            data.iter()
                .map(|path| site_folders(path))
                .collect::<Result<Vec<_>, _>>()?
                .concat()
        };
        let mut plan = Plan::default();
        for folder in &folders {
            plan.add(folder, None, None)?;
        }
        let directory = state.unwrap_or_else(|| temporary.path());
        fs::create_dir_all(directory).map_err(|source| Error::File {
            path: directory.to_owned(),
            source,
        })?;
        Ok(Self {
            plan,
            store: directory.join(STORE_FILE),
            _temporary: temporary,
        })
    }

    pub(super) fn store(&self) -> &Path {
        &self.store
    }

    /// The defaults, with the waits that make sense in live time cut short.
    pub(super) fn settings(&self, http: SocketAddr) -> Settings {
        let cores = thread::available_parallelism().map_or(1, usize::from);
        let service = ServiceOptions {
            instance: "demo".to_owned(),
            settle_ns: 4 * SECOND_NS,
            silence_ns: 2 * SECOND_NS,
            retry_ns: 2 * SECOND_NS,
            workers: cores.min(WORKERS_MAX),
            ..ServiceOptions::default()
        };
        let sites = self.plan.sites.iter().map(|site| SiteOptions {
            site: site.clone(),
            concentrator: ConcentratorOptions::default(),
            detector: DetectorOptions::default(),
            screening: ScreeningOptions::default(),
            structure: Structure::zip_im().names(),
        });
        Settings {
            service,
            sites: sites.collect(),
            ranges: BTreeMap::new(),
            recorders: BTreeMap::new(),
            streams: BTreeMap::new(),
            zenoh: ZenohOptions {
                listen: vec!["tcp/127.0.0.1:0".to_owned()],
                ..ZenohOptions::default()
            },
            http: HttpOptions {
                listen: Some(free(http)),
                open_pages: http.ip().is_loopback(),
                token: token_of_its_own(),
                ..HttpOptions::default()
            },
            store_path: self.store.clone(),
            store: SqliteOptions::default(),
            keep: None,
            batch_limits: BatchLimits::default(),
            recording_limits: RecordingLimits::default(),
        }
    }
}

/// A token that nobody is told: the page on this machine needs none, and nothing else may act. Where
/// the system gives no random bytes, the page is read-only.
fn token_of_its_own() -> TokenSource {
    let mut bytes = [0; 32];
    let read = fs::File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut bytes));
    let digit = |value: u8| char::from_digit(u32::from(value), 16).unwrap_or('0');
    let pairs = bytes
        .iter()
        .flat_map(|byte| [digit(byte >> 4), digit(byte & 15)]);
    let text: String = pairs.collect();
    match (read, Token::new(&text)) {
        (Ok(()), Ok(token)) => TokenSource::Given(token),
        _ => TokenSource::default(),
    }
}

/// A site folder itself, or the site folders in a directory, by name.
fn site_folders(path: &Path) -> Result<Vec<PathBuf>, Error> {
    if path.join("site.json").exists() {
        return Ok(vec![path.to_owned()]);
    }
    let failed = |source| Error::File {
        path: path.to_owned(),
        source,
    };
    let mut folders = Vec::new();
    for entry in fs::read_dir(path).map_err(failed)? {
        let folder = entry.map_err(failed)?.path();
        if folder.join("site.json").exists() {
            folders.push(folder);
        }
    }
    if folders.is_empty() {
        return Err(Error::Usage(format!("{}: no site folder", path.display())));
    }
    folders.sort();
    Ok(folders)
}

/// The address, with any free port when this one is taken.
fn free(address: SocketAddr) -> SocketAddr {
    match TcpListener::bind(address) {
        Ok(_) => address,
        Err(_) => SocketAddr::new(address.ip(), 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_that_is_taken_is_replaced_by_a_free_one() {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = taken.local_addr().unwrap();
        assert_eq!(free(address).port(), 0);
        drop(taken);
        assert_eq!(free(address), address);
    }

    #[test]
    fn a_directory_without_site_folders_is_wrong_usage() {
        let empty = tempfile::tempdir().unwrap();
        assert!(site_folders(empty.path()).unwrap_err().is_usage());
    }
}
