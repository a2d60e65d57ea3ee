//! The ASCII data format: one line per sample, `n,timestamp,A1,..,Ak,D1,..,Dm`.

use super::{
    configuration::{Analog, Configuration},
    error::{Error, Part},
    recording::Revision,
    sample_times::{RawTime, Rows},
    text::{self, Line},
};

/// Reads the lines that are there and declared. A blank line between samples is refused, or
/// skipped and counted when `lenient`; blank lines at the end are no matter.
pub(super) fn parse(
    configuration: &Configuration,
    source: &str,
    lenient: bool,
) -> Result<Rows, Error> {
    let declared = configuration.samples();
    // A row takes at least one byte per field, which bounds what is reserved by what is there.
    let fields = 2 + configuration.analog.len() + configuration.digital.len();
    let mut rows = Rows::new(configuration, declared.min(source.len() / fields + 1));
    let mut blanks = Vec::new();
    for line in text::lines(source) {
        if line.text.trim().is_empty() {
            blanks.push(line.number);
            continue;
        }
        if rows.times.len() == declared {
            rows.more_than_declared = true;
            break;
        }
        if let Some(&blank) = blanks.first()
            && !lenient
        {
            const EXPECTED: &str = "a sample number: the line is blank";
            return Err(Error::field(Part::Data, blank, "n", "", EXPECTED));
        }
        rows.blank_lines += blanks.len();
        blanks.clear();
        row(configuration, line, &mut rows)?;
    }
    Ok(rows)
}

fn row(configuration: &Configuration, line: Line<'_>, rows: &mut Rows) -> Result<(), Error> {
    let analog = configuration.analog.len();
    let wanted = 2 + analog + configuration.digital.len();
    let mut fields = line.text.split(',').map(str::trim);
    let number = fields.next().unwrap_or("");
    let stamp = fields.next().unwrap_or("");
    rows.times.push(RawTime {
        number: sample_number(line, number)?,
        stamp: number_or_none(line, || "timestamp".to_owned(), stamp)?,
    });
    let mut found = 2_usize.min(line.text.split(',').count());
    for (channel, column) in configuration.analog.iter().zip(&mut rows.analog) {
        let Some(field) = fields.next() else { break };
        column.push(value(configuration.revision, channel, line, field)?);
        found += 1;
    }
    let index = rows.times.len() - 1;
    for track in rows
        .digital
        .iter_mut()
        .take(wanted.saturating_sub(2 + analog))
    {
        let Some(field) = fields.next() else { break };
        match field {
            "0" => track.push(index, false),
            "1" => track.push(index, true),
            _ => rows.odd_states += 1,
        }
        found += 1;
    }
    let left: Vec<&str> = fields.collect();
    if found == wanted && left.iter().all(|field| field.is_empty()) {
        return Ok(());
    }
    Err(Error::FieldCount {
        part: Part::Data,
        line: line.number,
        found: found + left.len(),
        expected: format!("{wanted}"),
    })
}

fn sample_number(line: Line<'_>, text: &str) -> Result<i64, Error> {
    let number = text.parse();
    number.map_err(|_| Error::field(Part::Data, line.number, "n", text, "a sample number"))
}

fn number_or_none(
    line: Line<'_>,
    field: impl Fn() -> String,
    text: &str,
) -> Result<Option<f64>, Error> {
    if text.is_empty() {
        return Ok(None);
    }
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(Some(value)),
        _ => Err(Error::field(
            Part::Data,
            line.number,
            field(),
            text,
            "a number",
        )),
    }
}

/// The channel's value; NaN for an empty field and for the code that stands for "missing".
fn value(revision: Revision, channel: &Analog, line: Line<'_>, text: &str) -> Result<f64, Error> {
    let missing = if revision == Revision::Y1991 {
        "999999"
    } else {
        "99999"
    };
    if text.trim_start_matches('+') == missing {
        return Ok(f64::NAN);
    }
    let field = || format!("channel {} ({})", channel.number, channel.name);
    let recorded = number_or_none(line, field, text)?;
    Ok(recorded.map_or(f64::NAN, |value| channel.factor * value + channel.offset))
}
