//! Effect files on the disk.

use std::{
    fs::{self, File},
    io::{self, Read},
    path::Path,
};

use crate::load_model::user_effects::FILE_BYTES_MAX;

/// The text of an effect file; of a longer one than allowed a little more than allowed, so that it is
/// refused for its size. Only regular files are read: of a pipe or device nobody knows when it ends.
///
/// # Errors
///
/// When the file cannot be read, is no regular file, or is no text in UTF-8.
pub fn read(path: &Path) -> io::Result<String> {
    // To open a pipe waits for whoever writes to it.
    if !fs::metadata(path)?.is_file() {
        let what = if path.is_dir() {
            "a directory"
        } else {
            "a pipe or device"
        };
        return Err(refused(format!(
            "{what}, and only regular files are read; name a file on the disk"
        )));
    }
    let mut bytes = Vec::new();
    let limit = FILE_BYTES_MAX as u64 + 1;
    File::open(path)?.take(limit).read_to_end(&mut bytes)?;
    text(&bytes).map_err(refused)
}

fn refused(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

fn text(bytes: &[u8]) -> Result<String, String> {
    const MARK: &[u8] = &[0xef, 0xbb, 0xbf];
    let known = |start: &[u8]| bytes.starts_with(start);
    if known(&[0xff, 0xfe]) || known(&[0xfe, 0xff]) {
        return Err("a text in UTF-16; save it as UTF-8".to_owned());
    }
    if let Some(at) = bytes.iter().position(|byte| *byte == 0) {
        return Err(format!(
            "no text: byte {} is 0; an effect file is a TOML text in UTF-8",
            at + 1
        ));
    }
    let too_long = bytes.len() > FILE_BYTES_MAX;
    let own = bytes.strip_prefix(MARK).unwrap_or(bytes);
    match std::str::from_utf8(own) {
        Ok(text) => Ok(text.to_owned()),
        // Refused for its size, whatever the limit has cut.
        Err(error) if too_long && error.error_len().is_none() => {
            Ok(String::from_utf8_lossy(own).into_owned())
        }
        Err(error) => {
            let at = error.valid_up_to();
            let before = String::from_utf8_lossy(&own[..at]);
            let line = 1 + before.matches('\n').count();
            Err(format!(
                "no text in UTF-8: line {line} holds the byte 0x{:02x}; save it as UTF-8",
                own.get(at).copied().unwrap_or(0)
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(bytes: &[u8]) -> String {
        text(bytes).unwrap_err()
    }

    #[test]
    fn what_is_no_text_is_told_with_what_it_is() {
        assert!(told(b"\xff\xfen\0a\0").contains("UTF-16; save it as UTF-8"));
        assert!(told(b"PK\x03\x04\0\0").contains("byte 5 is 0"));
        assert!(told(b"a = 1\ntitle = \"\xe9\"").contains("line 2 holds the byte 0xe9"));
        assert_eq!(text(b"\xef\xbb\xbfa = 1").unwrap(), "a = 1");
        let long = vec![b'#'; FILE_BYTES_MAX + 1];
        assert_eq!(text(&long).unwrap().len(), FILE_BYTES_MAX + 1);
    }

    #[test]
    fn only_regular_files_are_read() {
        let directory = tempfile::tempdir().unwrap();
        let error = read(directory.path()).unwrap_err().to_string();
        assert!(error.starts_with("a directory"), "{error}");
        let pipe = directory.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if made.is_ok_and(|status| status.success()) {
            let error = read(&pipe).unwrap_err().to_string();
            assert!(error.starts_with("a pipe"), "{error}");
        }
        let device = read(Path::new("/dev/zero")).unwrap_err().to_string();
        assert!(device.starts_with("a pipe or device"), "{device}");
        assert!(read(&directory.path().join("absent")).is_err());
    }
}
