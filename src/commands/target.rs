//! Whether a result can be written, asked before it is computed.

use std::{fs, io, path::Path};

/// Tries to open a file for writing without changing it; one that was not there is not there
/// afterwards. What is no file (a pipe, a device) is left alone.
///
/// # Errors
///
/// What the system said.
pub(super) fn can_be_written(path: &Path) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
        Ok(found) if found.is_file() => fs::OpenOptions::new().append(true).open(path).map(drop),
        Ok(_) => Ok(()),
        Err(_) => {
            fs::File::create_new(path)?;
            fs::remove_file(path)
        }
    }
}

/// Makes a directory where there is none, and tries to write a file into it.
///
/// # Errors
///
/// What the system said.
pub(super) fn can_take_files(directory: &Path) -> io::Result<()> {
    fs::create_dir_all(directory)?;
    can_be_written(&directory.join(format!(".loadmodeld-{}", std::process::id())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn asking_leaves_no_trace() {
        let parent = tempfile::tempdir().unwrap();
        let file = parent.path().join("r.html");
        can_be_written(&file).unwrap();
        assert!(!file.exists());
        fs::write(&file, "old").unwrap();
        can_be_written(&file).unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "old");
        let directory = parent.path().join("figures/more");
        can_take_files(&directory).unwrap();
        assert_eq!(fs::read_dir(&directory).unwrap().count(), 0);
    }

    #[test]
    fn what_cannot_be_written_is_told() {
        let parent = tempfile::tempdir().unwrap();
        assert!(can_be_written(parent.path()).is_err());
        assert!(can_be_written(&parent.path().join("none/r.html")).is_err());
        let file = parent.path().join("file");
        fs::write(&file, "").unwrap();
        assert!(can_take_files(&file).is_err());
    }
}
