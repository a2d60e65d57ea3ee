//! The configuration part (`.cfg`): what the data hold.

use super::{
    error::{Error, Part},
    recording::{DataFormat, Note, Revision, Scaling, TimeCode},
    text::{self, Line},
    timestamp::{self, Stamp},
};

/// A decoded configuration.
#[derive(Clone, Debug)]
pub(super) struct Configuration {
    pub(super) station: String,
    pub(super) recorder: String,
    pub(super) revision: Revision,
    pub(super) analog: Vec<Analog>,
    pub(super) digital: Vec<Digital>,
    pub(super) nominal_hz: Option<f64>,
    /// Declared rates in order; a rate of zero means "by the time stamps".
    pub(super) rates: Vec<Rate>,
    pub(super) start: Stamp,
    pub(super) trigger: Stamp,
    pub(super) format: DataFormat,
    /// Factor on the time stamps of the data.
    pub(super) time_multiplier: f64,
    pub(super) time_code: Option<TimeCode>,
    pub(super) notes: Vec<Note>,
}

/// An analog channel line: value = `factor` * recorded + `offset`, in `unit`.
#[derive(Clone, Debug)]
pub(super) struct Analog {
    pub(super) number: u32,
    pub(super) name: String,
    pub(super) phase: String,
    pub(super) circuit: String,
    pub(super) unit: String,
    pub(super) factor: f64,
    pub(super) offset: f64,
    /// Smallest recorded value, as declared.
    pub(super) lowest: Option<f64>,
    pub(super) skew_us: f64,
    pub(super) primary: Option<f64>,
    pub(super) secondary: Option<f64>,
    pub(super) scaling: Scaling,
}

/// A digital channel line.
#[derive(Clone, Debug)]
pub(super) struct Digital {
    pub(super) number: u32,
    pub(super) name: String,
    pub(super) phase: String,
    pub(super) circuit: String,
    pub(super) normal: Option<bool>,
}

/// A sampling-rate line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rate {
    /// Samples per second.
    pub(super) rate_hz: f64,
    /// Number of the last sample at this rate, counted from 1.
    pub(super) last: usize,
}

impl Configuration {
    /// Number of samples the configuration declares.
    pub(super) fn samples(&self) -> usize {
        self.rates.last().map_or(0, |rate| rate.last)
    }

    /// Seconds per unit of the time stamps of the data.
    pub(super) fn stamp_unit_s(&self) -> f64 {
        let nanoseconds = self.start.nanoseconds || self.trigger.nanoseconds;
        self.time_multiplier * if nanoseconds { 1e-9 } else { 1e-6 }
    }
}

/// Reads a configuration.
pub(super) fn parse(source: &str) -> Result<Configuration, Error> {
    let mut reader = Reader::new(source);
    let (station, recorder, revision) = reader.identification()?;
    let (analog_count, digital_count) = reader.channel_counts()?;
    // Channels are pushed one line at a time: a count without lines ends at the end of the text.
    let mut analog = Vec::new();
    for _ in 0..analog_count {
        analog.push(reader.analog()?);
    }
    let mut digital = Vec::new();
    for _ in 0..digital_count {
        digital.push(reader.digital()?);
    }
    let nominal_hz = reader.nominal_hz()?;
    let rates = reader.rates()?;
    let start = reader.stamp("first-sample time", revision)?;
    let trigger = reader.stamp("trigger time", revision)?;
    let format = reader.format()?;
    let time_multiplier = reader.time_multiplier(revision)?;
    let time_code = reader.time_code(revision)?;
    Ok(Configuration {
        station,
        recorder,
        revision,
        analog,
        digital,
        nominal_hz,
        rates,
        start,
        trigger,
        format,
        time_multiplier,
        time_code,
        notes: reader.notes,
    })
}

struct Reader<'a> {
    lines: Vec<Line<'a>>,
    next: usize,
    notes: Vec<Note>,
}

impl<'a> Reader<'a> {
    fn new(source: &'a str) -> Self {
        Self {
            lines: text::lines(source).collect(),
            next: 0,
            notes: Vec::new(),
        }
    }

    fn line(&mut self, field: &'static str) -> Result<Line<'a>, Error> {
        let line = self.lines.get(self.next).copied();
        self.next += 1;
        line.ok_or(Error::MissingLine {
            part: Part::Configuration,
            line: self.next,
            field,
        })
    }

    /// A line at the end that may be absent or empty.
    fn optional_line(&mut self) -> Option<Line<'a>> {
        let line = self.lines.get(self.next).copied()?;
        self.next += 1;
        (!line.text.trim().is_empty()).then_some(line)
    }

    fn identification(&mut self) -> Result<(String, String, Revision), Error> {
        let line = self.line("station")?;
        let fields = line.fields();
        if fields.len() < 2 {
            return Err(field_count(line, fields.len(), "2 or 3"));
        }
        let station = fields[0].to_owned();
        if fields.len() == 2 {
            return Ok((station, fields[1].to_owned(), Revision::Y1991));
        }
        let last = fields.len() - 1;
        let recorder = fields[1..last].join(",");
        if fields[last].is_empty() {
            return Ok((station, recorder, Revision::Y1991));
        }
        let year: u16 = line.parse("rev_year", fields[last], "a year")?;
        let revision = match year {
            1900..=1991 => Revision::Y1991,
            1992..=2012 => Revision::Y1999,
            2013..=2100 => Revision::Y2013,
            _ => {
                let part = Part::Configuration;
                let found = fields[last];
                return Err(Error::field(part, line.number, "rev_year", found, "a year"));
            }
        };
        if revision.year() != year {
            self.notes.push(Note::UnusualRevision {
                year,
                read_as: revision,
            });
        }
        Ok((station, recorder, revision))
    }

    /// `total,##A,##D`; the letters decide which count is which.
    fn channel_counts(&mut self) -> Result<(u64, u64), Error> {
        const EXPECTED: &str = "a count followed by A or D";
        let line = self.line("channel counts")?;
        let fields = line.fields();
        if fields.len() < 3 {
            return Err(field_count(line, fields.len(), "3"));
        }
        let total: u64 = line.parse("total channels", fields[0], "a count")?;
        let (mut analog, mut digital) = (0_u64, 0_u64);
        for field in fields[1..].iter().filter(|field| !field.is_empty()) {
            let (count, slot) = if let Some(count) = field.strip_suffix(['A', 'a']) {
                (count, &mut analog)
            } else if let Some(count) = field.strip_suffix(['D', 'd']) {
                (count, &mut digital)
            } else {
                let part = Part::Configuration;
                return Err(Error::field(
                    part,
                    line.number,
                    "channel counts",
                    field,
                    EXPECTED,
                ));
            };
            *slot = line.parse("channel counts", count, EXPECTED)?;
        }
        let sum = analog.saturating_add(digital);
        if sum == 0 {
            return Err(Error::Empty { what: "channels" });
        }
        if sum != total {
            self.notes.push(Note::ChannelTotal { total, sum });
        }
        Ok((analog, digital))
    }

    fn analog(&mut self) -> Result<Analog, Error> {
        let line = self.line("analog channel")?;
        let mut fields = line.fields();
        while fields.len() > 13 && fields.last() == Some(&"") {
            fields.pop();
        }
        if !(10..=13).contains(&fields.len()) {
            return Err(field_count(line, fields.len(), "13 (10 in 1991 files)"));
        }
        let positive = |value: Option<f64>| value.filter(|v| *v > 0.0);
        let lowest = line.optional_number("min", fields.get(8))?;
        line.optional_number("max", fields.get(9))?;
        Ok(Analog {
            number: line.parse("An", fields[0], "a channel number")?,
            name: fields[1].to_owned(),
            phase: fields[2].to_owned(),
            circuit: fields[3].to_owned(),
            unit: fields[4].to_owned(),
            factor: line.number("a", fields[5])?,
            offset: line.optional_number("b", fields.get(6))?.unwrap_or(0.0),
            lowest,
            skew_us: line.optional_number("skew", fields.get(7))?.unwrap_or(0.0),
            primary: positive(line.optional_number("primary", fields.get(10))?),
            secondary: positive(line.optional_number("secondary", fields.get(11))?),
            scaling: match fields.get(12).copied().unwrap_or("") {
                "P" | "p" => Scaling::Primary,
                "S" | "s" => Scaling::Secondary,
                _ => Scaling::Unstated,
            },
        })
    }

    /// `Dn,ch_id,ph,ccbm,y`, or `Dn,ch_id,y` in 1991 files; recorders leave trailing fields away.
    fn digital(&mut self) -> Result<Digital, Error> {
        let line = self.line("digital channel")?;
        let fields = line.fields();
        if fields.len() < 2 {
            return Err(field_count(line, fields.len(), "5 (3 in 1991 files)"));
        }
        let (phase, circuit, normal) = match fields.len() {
            2 => ("", "", ""),
            3 => ("", "", fields[2]),
            4 => (fields[2], fields[3], ""),
            _ => (fields[2], fields[3], fields[4]),
        };
        let normal = match normal {
            "0" => Some(false),
            "1" => Some(true),
            _ => None,
        };
        Ok(Digital {
            number: line.parse("Dn", fields[0], "a channel number")?,
            name: fields[1].to_owned(),
            phase: phase.to_owned(),
            circuit: circuit.to_owned(),
            normal,
        })
    }

    fn nominal_hz(&mut self) -> Result<Option<f64>, Error> {
        let line = self.line("lf")?;
        let value = line.optional_number("lf", line.fields().first())?;
        Ok(value.filter(|hz| *hz > 0.0))
    }

    fn rates(&mut self) -> Result<Vec<Rate>, Error> {
        let line = self.line("nrates")?;
        let text = line.fields().first().copied().unwrap_or("");
        let count: u32 = line.parse("nrates", text, "a count")?;
        let mut rates: Vec<Rate> = Vec::new();
        for _ in 0..count.max(1) {
            let line = self.line("samp,endsamp")?;
            let fields = line.fields();
            if fields.len() < 2 {
                return Err(field_count(line, fields.len(), "2"));
            }
            let rate_hz = line.number("samp", fields[0])?;
            let last: usize = line.parse("endsamp", fields[1], "a sample number")?;
            let previous = rates.last().map_or(0, |rate| rate.last);
            if rate_hz < 0.0 || last < previous {
                let (field, found, expected) = if rate_hz < 0.0 {
                    ("samp", fields[0], "a rate of zero or more")
                } else {
                    ("endsamp", fields[1], "at least the previous endsamp")
                };
                let part = Part::Configuration;
                return Err(Error::field(part, line.number, field, found, expected));
            }
            let rate_hz = if count == 0 { 0.0 } else { rate_hz };
            rates.push(Rate { rate_hz, last });
        }
        if rates.last().is_none_or(|rate| rate.last == 0) {
            return Err(Error::Empty { what: "samples" });
        }
        Ok(rates)
    }

    fn stamp(&mut self, field: &'static str, revision: Revision) -> Result<Stamp, Error> {
        let line = self.line(field)?;
        timestamp::stamp(line, revision, &mut self.notes)
    }

    fn format(&mut self) -> Result<DataFormat, Error> {
        let line = self.line("ft")?;
        let text = line.fields().first().copied().unwrap_or("");
        DataFormat::from_name(text).ok_or_else(|| {
            const EXPECTED: &str = "ASCII, BINARY, BINARY32 or FLOAT32";
            Error::field(Part::Configuration, line.number, "ft", text, EXPECTED)
        })
    }

    fn time_multiplier(&mut self, revision: Revision) -> Result<f64, Error> {
        let Some(line) = self.optional_line() else {
            if revision >= Revision::Y1999 {
                self.notes.push(Note::LinesAbsent { field: "timemult" });
            }
            return Ok(1.0);
        };
        let text = line.fields().first().copied().unwrap_or("");
        let value = line.number("timemult", text)?;
        if value > 0.0 {
            Ok(value)
        } else {
            const EXPECTED: &str = "a positive number";
            Err(Error::field(
                Part::Configuration,
                line.number,
                "timemult",
                text,
                EXPECTED,
            ))
        }
    }

    fn time_code(&mut self, revision: Revision) -> Result<Option<TimeCode>, Error> {
        if revision < Revision::Y2013 {
            return Ok(None);
        }
        let Some(codes) = self.optional_line() else {
            self.notes.push(Note::LinesAbsent { field: "time_code" });
            return Ok(None);
        };
        let quality = self.optional_line();
        if quality.is_none() {
            self.notes.push(Note::LinesAbsent { field: "tmq_code" });
        }
        timestamp::time_code(codes, quality).map(Some)
    }
}

fn field_count(line: Line<'_>, found: usize, expected: &str) -> Error {
    Error::FieldCount {
        part: Part::Configuration,
        line: line.number,
        found,
        expected: expected.to_owned(),
    }
}
