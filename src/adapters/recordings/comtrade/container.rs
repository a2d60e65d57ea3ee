//! The single-file container (`.cff`) of the 2013 edition: sections under header lines such as
//! `--- file type: CFG ---` and `--- file type: DAT BINARY: 702 ---`.

use super::{
    error::{Error, Part},
    recording::DataFormat,
};

/// The two sections that are needed, as bytes.
#[derive(Debug)]
pub(super) struct Sections<'a> {
    pub(super) configuration: &'a [u8],
    pub(super) data: &'a [u8],
    pub(super) data_format: Option<DataFormat>,
}

#[derive(Debug)]
enum Header {
    Configuration,
    Information,
    Data {
        format: Option<DataFormat>,
        bytes: Option<usize>,
    },
}

/// Finds the sections.
pub(super) fn split(bytes: &[u8]) -> Result<Sections<'_>, Error> {
    let mut configuration: Option<(usize, usize)> = None;
    let mut open: Option<usize> = None;
    let (mut at, mut number) = (0, 0);
    // People rule off their notes with dashes.
    let mut free_text = false;
    while at < bytes.len() {
        let end = bytes[at..].iter().position(|&b| b == b'\n');
        let next = end.map_or(bytes.len(), |length| at + length + 1);
        number += 1;
        let line = &bytes[at..next];
        let header = if free_text && !has_words_of_header(line) {
            None
        } else {
            header(number, line)?
        };
        if let Some(header) = &header {
            free_text = matches!(header, Header::Information);
        }
        if header.is_some()
            && let Some(start) = open.take()
        {
            configuration = Some((start, at));
        }
        match header {
            Some(Header::Configuration) => open = Some(next),
            Some(Header::Data {
                format,
                bytes: length,
            }) => {
                let data = data_section(number, &bytes[next..], length)?;
                let Some((start, end)) = configuration else {
                    return Err(missing("a configuration section before the data"));
                };
                return Ok(Sections {
                    configuration: &bytes[start..end],
                    data,
                    data_format: format,
                });
            }
            Some(Header::Information) | None => {}
        }
        at = next;
    }
    Err(missing(if configuration.is_none() && open.is_none() {
        "a line '--- file type: CFG ---'"
    } else {
        "a line '--- file type: DAT .. ---'"
    }))
}

fn missing(what: &'static str) -> Error {
    Error::MissingLine {
        part: Part::Container,
        line: 1,
        field: what,
    }
}

fn data_section(line: usize, rest: &[u8], length: Option<usize>) -> Result<&[u8], Error> {
    const EXPECTED: &str = "at most the bytes that follow";
    match length {
        None => Ok(rest),
        Some(length) => rest.get(..length).ok_or_else(|| {
            let found = format!("{length}, {} left", rest.len());
            Error::field(Part::Container, line, "data length", &found, EXPECTED)
        }),
    }
}

/// Whether a line says what a header says, well or badly.
fn has_words_of_header(line: &[u8]) -> bool {
    let text = String::from_utf8_lossy(line).to_ascii_uppercase();
    text.contains("FILE") && text.contains("TYPE")
}

/// Reads a header line; none for any other line. A line with the dashes of a header that is not
/// one is refused: its section would be read as part of the one before.
fn header(number: usize, line: &[u8]) -> Result<Option<Header>, Error> {
    let Some(text) = line
        .get(..line.len().min(100))
        .and_then(|line| std::str::from_utf8(line).ok())
        .map(|text| text.trim_start_matches('\u{feff}').trim())
    else {
        return Ok(None);
    };
    if !text.starts_with("---") {
        return Ok(None);
    }
    let bad = || {
        const EXPECTED: &str = "a section header such as '--- file type: CFG ---'";
        Error::field(Part::Container, number, "header", text, EXPECTED)
    };
    let upper = text.trim_matches('-').trim().to_ascii_uppercase();
    let rest = upper
        .strip_prefix("FILE TYPE")
        .ok_or_else(bad)?
        .trim_start();
    let rest = rest.strip_prefix(':').ok_or_else(bad)?;
    let (kind, length) = rest.split_once(':').unwrap_or((rest, ""));
    let mut words = kind.split_whitespace();
    match words.next() {
        Some("CFG") => Ok(Some(Header::Configuration)),
        Some("INF" | "HDR") => Ok(Some(Header::Information)),
        Some("DAT") => {
            let format = match words.next() {
                Some(name) => Some(DataFormat::from_name(name).ok_or_else(bad)?),
                None => None,
            };
            let bytes = match length.trim() {
                "" => None,
                digits => Some(digits.parse().map_err(|_| bad())?),
            };
            Ok(Some(Header::Data { format, bytes }))
        }
        _ => Err(bad()),
    }
}
