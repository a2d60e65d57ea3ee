//! Effect files on the disk.

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

use crate::load_model::user_effects::FILE_BYTES_MAX;

/// The text of an effect file; of a longer one than allowed a little more than allowed, so that it is
/// refused for its size.
///
/// # Errors
///
/// When the file cannot be read or is no text.
pub fn read(path: &Path) -> io::Result<String> {
    let mut bytes = Vec::new();
    let limit = FILE_BYTES_MAX as u64 + 1;
    File::open(path)?.take(limit).read_to_end(&mut bytes)?;
    if bytes.len() > FILE_BYTES_MAX {
        // Refused for its size, whatever the limit has cut.
        return Ok(String::from_utf8_lossy(&bytes).into_owned());
    }
    String::from_utf8(bytes).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
}
