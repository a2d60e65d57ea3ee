//! The site folders that travel inside the program, so that `demo` and the examples run on a
//! machine that has nothing else. `demo-data/README.md` says where they come from.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use include_dir::{Dir, include_dir};

static DEMO_DATA: Dir<'static> = include_dir!("$CARGO_MANIFEST_DIR/demo-data");

/// Name of a site folder's description.
const DESCRIPTION_FILE: &str = "site.json";

/// One bundled site folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BundledSite {
    /// Name of the folder, which is also the site's name.
    pub name: &'static str,
    /// Text of `site.json`.
    pub description: &'static str,
    /// File name and text of each event, in the order of the names.
    pub events: Vec<(&'static str, &'static str)>,
}

/// Why bundled recordings could not be written to disk.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BundledError {
    /// A directory or file could not be written.
    #[error("cannot write bundled recording to {}", .path.display())]
    Write {
        /// What was to be written.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// Every bundled site, in the order of the names.
#[must_use]
pub fn sites() -> Vec<BundledSite> {
    let mut sites: Vec<_> = DEMO_DATA.dirs().filter_map(site_in).collect();
    sites.sort_by_key(|site| site.name);
    sites
}

impl BundledSite {
    /// Writes this site below `parent` as the folder `parent/<name>`, which it returns. Files that
    /// exist are replaced.
    ///
    /// # Errors
    ///
    /// [`BundledError::Write`] naming the path that could not be written.
    pub fn extract_to(&self, parent: &Path) -> Result<PathBuf, BundledError> {
        let folder = parent.join(self.name);
        let failed = |path: &Path| {
            let path = path.to_path_buf();
            move |source| BundledError::Write { path, source }
        };
        fs::create_dir_all(&folder).map_err(failed(&folder))?;
        let files = [(DESCRIPTION_FILE, self.description)];
        for (name, text) in files.into_iter().chain(self.events.iter().copied()) {
            let path = folder.join(name);
            fs::write(&path, text).map_err(failed(&path))?;
        }
        Ok(folder)
    }
}

/// Writes every bundled site below `parent`; the folders written, in the order of the names.
///
/// # Errors
///
/// [`BundledError::Write`] naming the path that could not be written.
pub fn extract_all_to(parent: &Path) -> Result<Vec<PathBuf>, BundledError> {
    sites().iter().map(|site| site.extract_to(parent)).collect()
}

fn site_in(folder: &Dir<'static>) -> Option<BundledSite> {
    let mut description = None;
    let mut events = Vec::new();
    for file in folder.files() {
        let (name, text) = (file_name(file.path())?, file.contents_utf8()?);
        if name == DESCRIPTION_FILE {
            description = Some(text);
        } else if Path::new(name).extension().is_some_and(|e| e == "csv") {
            events.push((name, text));
        }
    }
    events.sort_unstable_by_key(|(name, _)| *name);
    Some(BundledSite {
        name: file_name(folder.path())?,
        description: description?,
        events,
    })
}

fn file_name(path: &'static Path) -> Option<&'static str> {
    path.file_name()?.to_str()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bundled_site_names_itself_and_carries_the_events_it_lists() {
        let names: Vec<_> = sites().iter().map(|site| site.name).collect();
        assert_eq!(names, ["demo", "demo2", "site-02", "site-14"]);
        for site in sites() {
            let document: serde_json::Value = serde_json::from_str(site.description).unwrap();
            assert_eq!(document["site"], site.name);
            let listed: Vec<_> = document["events"]
                .as_array()
                .unwrap()
                .iter()
                .map(|event| event["file"].as_str().unwrap())
                .collect();
            let carried: Vec<_> = site.events.iter().map(|(name, _)| *name).collect();
            assert_eq!(carried, listed, "{}", site.name);
            for (name, text) in &site.events {
                assert!(
                    text.starts_with("time_s,v_pu,angle_deg,freq_hz,p_pu,q_pu,stat"),
                    "{}/{name}",
                    site.name
                );
            }
        }
    }

    #[test]
    fn an_extracted_site_is_byte_for_byte_what_was_bundled() {
        let parent = tempfile::tempdir().unwrap();
        let folders = extract_all_to(parent.path()).unwrap();
        for (site, folder) in sites().iter().zip(&folders) {
            let description = fs::read_to_string(folder.join("site.json")).unwrap();
            assert_eq!(description, site.description);
            for (name, text) in &site.events {
                assert_eq!(&fs::read_to_string(folder.join(name)).unwrap(), text);
            }
            assert_eq!(fs::read_dir(folder).unwrap().count(), site.events.len() + 1);
        }
    }

    #[test]
    fn no_truth_travels_with_the_recordings() {
        assert!(DEMO_DATA.get_file("truth.json").is_none());
        for site in sites() {
            assert!(!site.description.contains("effects"), "{}", site.name);
            assert!(!site.description.contains("zip_im"), "{}", site.name);
        }
    }

    #[test]
    fn writing_into_a_file_names_the_path() {
        let parent = tempfile::NamedTempFile::new().unwrap();
        let error = sites()[0].extract_to(parent.path()).unwrap_err();
        assert!(error.to_string().contains("demo"), "{error}");
    }
}
