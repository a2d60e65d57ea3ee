//! Names of stations and channels: sixteen bytes in CFG-1 and CFG-2 (table 9), a length and UTF-8
//! in CFG-3 (table 12).

use encoding_rs::WINDOWS_1252;

use super::{
    bytes::Reader,
    error::{EncodeError, Error, Reason},
};

/// Bytes of a name in CFG-1 and CFG-2.
pub(super) const FIXED_BYTES: usize = 16;
/// Longest name in CFG-3, bytes.
const VARIABLE_BYTES_MAX: usize = 255;

/// Text that should be ASCII: UTF-8 if it is that, else windows-1252, which devices write whose
/// menus have accents.
pub(super) fn text(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => WINDOWS_1252
            .decode_without_bom_handling(bytes)
            .0
            .into_owned(),
    }
}

/// A name of sixteen bytes without its padding (blanks; some devices write zeros).
pub(super) fn read_fixed(reader: &mut Reader<'_>, field: &'static str) -> Result<String, Error> {
    let bytes = reader.slice(FIXED_BYTES, field)?;
    Ok(text(bytes).trim_end_matches([' ', '\0']).to_owned())
}

pub(super) fn write_fixed(
    out: &mut Vec<u8>,
    name: &str,
    field: &'static str,
) -> Result<(), EncodeError> {
    let (short, _, unmappable) = WINDOWS_1252.encode(name);
    let bytes = if name.len() > FIXED_BYTES && !unmappable {
        &short
    } else {
        name.as_bytes()
    };
    if bytes.len() > FIXED_BYTES {
        return Err(EncodeError::Name {
            field,
            name: name.to_owned(),
            bytes: bytes.len(),
            bytes_max: FIXED_BYTES,
        });
    }
    out.extend(bytes);
    out.extend(std::iter::repeat_n(b' ', FIXED_BYTES - bytes.len()));
    Ok(())
}

/// A name of one length byte and as many bytes of UTF-8.
pub(super) fn read_variable(reader: &mut Reader<'_>, field: &'static str) -> Result<String, Error> {
    let offset = reader.offset();
    let length = usize::from(reader.u8(field)?);
    let bytes = reader.slice(length, field)?;
    std::str::from_utf8(bytes)
        .map(str::to_owned)
        .map_err(|_| reader.error(offset, field, Reason::NotUtf8))
}

pub(super) fn write_variable(
    out: &mut Vec<u8>,
    name: &str,
    field: &'static str,
) -> Result<(), EncodeError> {
    let length = u8::try_from(name.len()).map_err(|_| EncodeError::Name {
        field,
        name: name.to_owned(),
        bytes: name.len(),
        bytes_max: VARIABLE_BYTES_MAX,
    })?;
    out.push(length);
    out.extend(name.as_bytes());
    Ok(())
}
