//! Lines and fields of the text parts.

use std::str::FromStr;

use super::error::{Error, Part};

/// One line and its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line<'a> {
    /// Number within its part, from 1.
    pub(super) number: usize,
    /// Content without the line end.
    pub(super) text: &'a str,
}

/// The lines of `text`, ended by LF, CR LF or CR; the end-of-file mark 0x1A ends the text.
pub(super) fn lines(text: &str) -> impl Iterator<Item = Line<'_>> {
    let text = text.split('\u{1a}').next().unwrap_or("");
    let end = if text.contains('\n') { '\n' } else { '\r' };
    text.split(end).enumerate().map(|(index, text)| Line {
        number: index + 1,
        text: text.trim_end_matches('\r'),
    })
}

impl<'a> Line<'a> {
    /// The comma-separated fields, white space trimmed.
    pub(super) fn fields(self) -> Vec<&'a str> {
        self.text.split(',').map(str::trim).collect()
    }

    /// Parses one field of the configuration, or says what it should have been.
    pub(super) fn parse<T: FromStr>(
        self,
        field: &'static str,
        text: &str,
        expected: &'static str,
    ) -> Result<T, Error> {
        text.trim().parse().map_err(|_| {
            Error::field(
                Part::Configuration,
                self.number,
                field,
                text.trim(),
                expected,
            )
        })
    }

    /// Parses one field of the configuration that must be a finite number.
    pub(super) fn number(self, field: &'static str, text: &str) -> Result<f64, Error> {
        const EXPECTED: &str = "a number";
        let value: f64 = self.parse(field, text, EXPECTED)?;
        if value.is_finite() {
            Ok(value)
        } else {
            let part = Part::Configuration;
            Err(Error::field(part, self.number, field, text, EXPECTED))
        }
    }

    /// Like [`Line::number`], but an absent or empty field is none.
    pub(super) fn optional_number(
        self,
        field: &'static str,
        text: Option<&&str>,
    ) -> Result<Option<f64>, Error> {
        match text.map(|text| text.trim()) {
            None | Some("") => Ok(None),
            Some(text) => self.number(field, text).map(Some),
        }
    }
}
