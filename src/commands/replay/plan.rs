//! What is to be published: site folders and COMTRADE files, read before anything is sent.

use std::{fs, path::Path};

use crate::{
    adapters::{
        recordings::site_folder::{self, SiteFolder},
        wire::v1::{RecordingFiles, encode_recording},
        zenoh::is_chunk,
    },
    commands::Error,
    measurement::{Record, Site},
};

/// What is to be published, in order.
#[derive(Debug, Default)]
pub(in crate::commands) struct Plan {
    pub(in crate::commands) pieces: Vec<Piece>,
    /// Sites of the folders.
    pub(in crate::commands) sites: Vec<Site>,
    /// What the user should know of what was read.
    pub(in crate::commands) notes: Vec<String>,
}

/// One event or one recording.
#[derive(Debug)]
pub(in crate::commands) enum Piece {
    /// An event of a site folder, published as batches.
    Event {
        site: String,
        name: String,
        record: Record,
    },
    /// A COMTRADE recording, published as it is.
    Recording {
        site: String,
        recorder: String,
        payload: Vec<u8>,
    },
}

impl Plan {
    /// Reads a site folder or a COMTRADE file.
    pub(in crate::commands) fn add(
        &mut self,
        path: &Path,
        site: Option<&str>,
        recorder: Option<&str>,
    ) -> Result<(), Error> {
        if path.is_dir() {
            let folder = site_folder::load_events(path)?;
            self.add_folder(folder, path, site)
        } else {
            self.add_recording(path, site, recorder)
        }
    }

    /// Samples in all events.
    pub(in crate::commands) fn sample_count(&self) -> usize {
        let samples = self.pieces.iter().map(|piece| match piece {
            Piece::Event { record, .. } => record.samples.len(),
            Piece::Recording { .. } => 0,
        });
        samples.sum()
    }

    fn add_folder(
        &mut self,
        folder: SiteFolder,
        path: &Path,
        site: Option<&str>,
    ) -> Result<(), Error> {
        let name = site.unwrap_or(&folder.site.name).to_owned();
        if !is_chunk(&name) {
            return Err(Error::Usage(format!(
                "{}: the site's name `{name}` cannot be part of a key: give another with --site",
                path.display()
            )));
        }
        let notes = folder.notes.iter();
        self.notes
            .extend(notes.map(|note| format!("{name}: {note}")));
        self.sites.push(Site {
            name: name.clone(),
            ..folder.site
        });
        let events = folder.events.into_iter().map(|event| Piece::Event {
            site: name.clone(),
            name: event.name,
            record: event.record,
        });
        self.pieces.extend(events);
        Ok(())
    }

    fn add_recording(
        &mut self,
        path: &Path,
        site: Option<&str>,
        recorder: Option<&str>,
    ) -> Result<(), Error> {
        let Some(site) = site else {
            return Err(Error::Usage(format!(
                "{}: say with --site which site the recording belongs to",
                path.display()
            )));
        };
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let recorder = recorder.unwrap_or(&stem);
        if !is_chunk(recorder) {
            return Err(Error::Usage(format!(
                "{}: `{recorder}` cannot be part of a key: give another with --recorder",
                path.display()
            )));
        }
        let payload =
            encode_recording(&files(path, &stem)?).map_err(|source| Error::Recording {
                path: path.to_owned(),
                source,
            })?;
        self.pieces.push(Piece::Recording {
            site: site.to_owned(),
            recorder: recorder.to_owned(),
            payload,
        });
        Ok(())
    }
}

/// The files of a recording: one `.cff`, or `.cfg` and `.dat` side by side, in upper or lower case.
fn files(path: &Path, stem: &str) -> Result<RecordingFiles, Error> {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let companion = |ending: &str| {
        let lower = path.with_extension(ending);
        if lower.exists() {
            lower
        } else {
            path.with_extension(ending.to_uppercase())
        }
    };
    match extension.to_lowercase().as_str() {
        "cff" => Ok(RecordingFiles::Cff(read(path)?)),
        "cfg" | "dat" => Ok(RecordingFiles::CfgDat {
            name: stem.to_owned(),
            cfg: read(&companion("cfg"))?,
            dat: read(&companion("dat"))?,
        }),
        _ => Err(Error::Usage(format!(
            "{}: neither a site folder nor a .cfg, .dat or .cff file",
            path.display()
        ))),
    }
}

fn read(path: &Path) -> Result<Vec<u8>, Error> {
    fs::read(path).map_err(|source| Error::File {
        path: path.to_owned(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_needs_a_site() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("a.cfg");
        fs::write(&file, "").unwrap();
        let error = Plan::default().add(&file, None, None).unwrap_err();
        assert!(
            error.is_usage() && error.to_string().contains("--site"),
            "{error}"
        );
    }

    #[test]
    fn a_missing_companion_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("a.cfg");
        fs::write(&file, "").unwrap();
        let error = Plan::default().add(&file, Some("north"), None).unwrap_err();
        assert!(
            error.to_string().to_lowercase().contains("a.dat"),
            "{error}"
        );
    }

    #[test]
    fn any_other_file_is_wrong_usage() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("notes.txt");
        fs::write(&file, "").unwrap();
        let error = Plan::default().add(&file, Some("north"), None).unwrap_err();
        assert!(error.is_usage(), "{error}");
    }
}
