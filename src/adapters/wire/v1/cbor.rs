//! Reading CBOR of a known shape: maps with numeric keys whose names are accepted as well, arrays of
//! definite or indefinite length. Nothing is allocated for a length before its items are there.

use minicbor::{Decoder, data::Type, decode::Error};

use super::half::from_half;

/// RFC 8949, 3.4.6: "what follows is CBOR".
const SELF_DESCRIBED: u64 = 55_799;

/// A reader of one document.
pub(super) struct Reader<'b> {
    pub(super) decoder: Decoder<'b>,
}

impl<'b> Reader<'b> {
    pub(super) fn new(document: &'b [u8]) -> Self {
        Self {
            decoder: Decoder::new(document),
        }
    }

    /// Reads the map that is the whole document, as [`Self::map`].
    pub(super) fn document<E: From<Error>>(
        &mut self,
        fields: &[&str],
        read: impl FnMut(&mut Self, usize) -> Result<(), E>,
    ) -> Result<(), E> {
        if self.decoder.datatype()? == Type::Tag && self.decoder.tag()?.as_u64() != SELF_DESCRIBED {
            return Err(Error::message("a document has no tag but 55799").into());
        }
        self.map(fields, read)?;
        if self.decoder.position() < self.decoder.input().len() {
            let error = Error::message("bytes after the end of the document");
            return Err(error.at(self.decoder.position()).into());
        }
        Ok(())
    }

    /// Reads a map; `read` gets the index in `fields` of each key. Unknown keys are passed over, a
    /// key that comes twice is refused.
    pub(super) fn map<E: From<Error>>(
        &mut self,
        fields: &[&str],
        mut read: impl FnMut(&mut Self, usize) -> Result<(), E>,
    ) -> Result<(), E> {
        let count = self.decoder.map()?;
        let mut seen = 0_u32;
        self.items(count, |reader| {
            let at = reader.decoder.position();
            let Some(field) = reader.key(fields)? else {
                return Ok(reader.decoder.skip()?);
            };
            if seen & (1 << field) != 0 {
                return Err(Error::message("a key comes twice").at(at).into());
            }
            seen |= 1 << field;
            read(reader, field)
        })
    }

    /// Reads an array; `read` is called before each item.
    pub(super) fn array<E: From<Error>>(
        &mut self,
        read: impl FnMut(&mut Self) -> Result<(), E>,
    ) -> Result<(), E> {
        let count = self.decoder.array()?;
        self.items(count, read)
    }

    /// Any number CBOR can hold; null and undefined are NaN.
    pub(super) fn number(&mut self) -> Result<f64, Error> {
        let decoder = &mut self.decoder;
        match decoder.datatype()? {
            Type::F16 => self.half(),
            Type::F32 | Type::F64 => decoder.f64(),
            Type::Null => decoder.null().map(|()| f64::NAN),
            Type::Undefined => decoder.undefined().map(|()| f64::NAN),
            _ => decoder.int().map(|int| i128::from(int) as f64),
        }
    }

    /// What `read` reads; none for null.
    pub(super) fn optional<T, E: From<Error>>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<Option<T>, E> {
        if self.decoder.datatype()? == Type::Null {
            self.decoder.null()?;
            return Ok(None);
        }
        read(self).map(Some)
    }

    fn key(&mut self, fields: &[&str]) -> Result<Option<usize>, Error> {
        if self.decoder.datatype()? == Type::String {
            let name = self.decoder.str()?;
            return Ok(fields.iter().position(|field| *field == name));
        }
        let number = i128::from(self.decoder.int()?);
        Ok(usize::try_from(number).ok().filter(|at| *at < fields.len()))
    }

    /// Calls `read` for each item. Every item takes at least one byte, so a length that lies ends
    /// with the input.
    fn items<E: From<Error>>(
        &mut self,
        count: Option<u64>,
        mut read: impl FnMut(&mut Self) -> Result<(), E>,
    ) -> Result<(), E> {
        let Some(count) = count else {
            while self.decoder.datatype()? != Type::Break {
                read(self)?;
            }
            self.decoder.set_position(self.decoder.position() + 1);
            return Ok(());
        };
        for _ in 0..count {
            read(self)?;
        }
        Ok(())
    }

    /// minicbor reads half floats only with a further crate.
    fn half(&mut self) -> Result<f64, Error> {
        let at = self.decoder.position();
        let Some(&[_, high, low]) = self.decoder.input().get(at..at + 3) else {
            return Err(Error::end_of_input());
        };
        self.decoder.set_position(at + 3);
        Ok(from_half(u16::from_be_bytes([high, low])))
    }
}
