//! Reading and writing big-endian fields, with their place and name.

use super::{
    error::{EncodeError, Error, Reason},
    frame::FrameKind,
};

/// A position in the bytes of one frame.
#[derive(Clone, Debug)]
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    kind: Option<FrameKind>,
}

impl<'a> Reader<'a> {
    /// Reads `bytes` from the byte `at` on.
    pub(super) const fn new(bytes: &'a [u8], at: usize, kind: Option<FrameKind>) -> Self {
        Self { bytes, at, kind }
    }

    /// Byte of the next field.
    pub(super) const fn offset(&self) -> usize {
        self.at
    }

    pub(super) fn error(&self, offset: usize, field: &'static str, reason: Reason) -> Error {
        Error {
            frame: self.kind,
            offset,
            field,
            reason,
        }
    }

    pub(super) fn slice(&mut self, length: usize, field: &'static str) -> Result<&'a [u8], Error> {
        let left = self.bytes.len().saturating_sub(self.at);
        let end = self.at.checked_add(length);
        let Some(slice) = end.and_then(|end| self.bytes.get(self.at..end)) else {
            let needed = length;
            return Err(self.error(self.at, field, Reason::Ends { needed, left }));
        };
        self.at += length;
        Ok(slice)
    }

    fn array<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], Error> {
        let mut array = [0; N];
        array.copy_from_slice(self.slice(N, field)?);
        Ok(array)
    }

    pub(super) fn u8(&mut self, field: &'static str) -> Result<u8, Error> {
        Ok(self.array::<1>(field)?[0])
    }

    pub(super) fn u16(&mut self, field: &'static str) -> Result<u16, Error> {
        Ok(u16::from_be_bytes(self.array(field)?))
    }

    pub(super) fn i16(&mut self, field: &'static str) -> Result<i16, Error> {
        Ok(i16::from_be_bytes(self.array(field)?))
    }

    pub(super) fn u32(&mut self, field: &'static str) -> Result<u32, Error> {
        Ok(u32::from_be_bytes(self.array(field)?))
    }

    pub(super) fn i32(&mut self, field: &'static str) -> Result<i32, Error> {
        Ok(i32::from_be_bytes(self.array(field)?))
    }

    pub(super) fn f32(&mut self, field: &'static str) -> Result<f32, Error> {
        Ok(f32::from_be_bytes(self.array(field)?))
    }

    pub(super) fn bytes<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], Error> {
        self.array(field)
    }

    /// Everything that is left.
    pub(super) fn rest(&mut self) -> &'a [u8] {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        self.at = self.bytes.len();
        rest
    }

    /// Nothing may be left.
    pub(super) fn end(&self, field: &'static str) -> Result<(), Error> {
        match self.bytes.len().saturating_sub(self.at) {
            0 => Ok(()),
            bytes => Err(self.error(self.at, field, Reason::LeftOver { bytes })),
        }
    }
}

/// A number of channels as its 16-bit field.
pub(super) fn count(field: &'static str, found: usize) -> Result<[u8; 2], EncodeError> {
    let max = usize::from(u16::MAX);
    u16::try_from(found)
        .map(u16::to_be_bytes)
        .map_err(|_| EncodeError::TooMany { field, found, max })
}
