//! Dates, times of day and offsets from UTC as recorders write them.

use jiff::civil;

use super::{
    error::{Error, Part},
    recording::{LeapSecond, Note, Revision, TimeCode},
    text::Line,
};

const NANOSECONDS_PER_SECOND: i64 = 1_000_000_000;
/// Digits of a fraction of a second that is written in microseconds.
const MICROSECOND_DIGITS: usize = 6;

/// One of the two time-stamp lines of a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stamp {
    /// Nanoseconds since 1970-01-01 on the clock of the file; none when empty or zero.
    pub(super) civil_ns: Option<i64>,
    /// Whether the fraction has more than six digits: sample stamps then count nanoseconds.
    pub(super) nanoseconds: bool,
}

/// Reads `date,time`. Order of day and month by edition: month first in 1991, day first later.
pub(super) fn stamp(
    line: Line<'_>,
    revision: Revision,
    notes: &mut Vec<Note>,
) -> Result<Stamp, Error> {
    let fields = line.fields();
    let date_text = fields.first().copied().unwrap_or("");
    let time_text = fields.get(1).copied().unwrap_or("");
    let time = time_of_day(line, time_text)?;
    let Some(date) = date(line, date_text, revision, notes)? else {
        notes.push(Note::TimeUnknown { line: line.number });
        return Ok(Stamp {
            civil_ns: None,
            nanoseconds: time.nanoseconds,
        });
    };
    if time.second == 60 {
        notes.push(Note::SecondSixty { line: line.number });
    }
    let days = i64::from((date - civil::date(1970, 1, 1)).get_days());
    let seconds = days * 86_400 + i64::from(time.hour * 3600 + time.minute * 60 + time.second);
    let civil_ns = seconds
        .checked_mul(NANOSECONDS_PER_SECOND)
        .and_then(|ns| ns.checked_add(time.fraction_ns));
    match civil_ns {
        Some(ns) => Ok(Stamp {
            civil_ns: Some(ns),
            nanoseconds: time.nanoseconds,
        }),
        None => Err(bad_date(line, date_text)),
    }
}

fn bad_date(line: Line<'_>, found: &str) -> Error {
    const EXPECTED: &str = "a date (day/month/year; month/day/year in 1991 files)";
    Error::field(Part::Configuration, line.number, "date", found, EXPECTED)
}

/// The date, or none for an empty or zero one.
fn date(
    line: Line<'_>,
    text: &str,
    revision: Revision,
    notes: &mut Vec<Note>,
) -> Result<Option<civil::Date>, Error> {
    if text.is_empty() {
        return Ok(None);
    }
    let parts: Vec<&str> = text.split(['/', '-', '.']).map(str::trim).collect();
    let number = |part: &str| part.parse::<i16>().ok().filter(|n| *n >= 0);
    let [Some(first), Some(second), Some(third)] =
        [0, 1, 2].map(|i| parts.get(i).copied().and_then(number))
    else {
        return Err(bad_date(line, text));
    };
    if parts.len() > 3 {
        return Err(bad_date(line, text));
    }
    let (year, mut month, mut day) = if parts[0].len() == 4 {
        (first, second, third)
    } else if revision == Revision::Y1991 {
        (third, first, second)
    } else {
        (third, second, first)
    };
    if month == 0 || day == 0 || (year <= 1 && month == 1 && day == 1) {
        let zero = [year, month, day].iter().all(|&n| n <= 1);
        return if zero {
            Ok(None)
        } else {
            Err(bad_date(line, text))
        };
    }
    let year = complete_year(line, year, notes);
    if month > 12 && day <= 12 {
        (month, day) = (day, month);
        notes.push(Note::DayAndMonthSwapped { line: line.number });
    }
    let (Ok(month), Ok(day)) = (i8::try_from(month), i8::try_from(day)) else {
        return Err(bad_date(line, text));
    };
    civil::Date::new(year, month, day)
        .map(Some)
        .map_err(|_| bad_date(line, text))
}

/// Completes a year of two digits: 70 to 99 are 19xx, 00 to 69 are 20xx.
fn complete_year(line: Line<'_>, year: i16, notes: &mut Vec<Note>) -> i16 {
    let full = match year {
        0..=69 => year + 2000,
        70..=99 => year + 1900,
        _ => return year,
    };
    notes.push(Note::ShortYear {
        line: line.number,
        year: full,
    });
    full
}

struct TimeOfDay {
    hour: i32,
    minute: i32,
    second: i32,
    fraction_ns: i64,
    nanoseconds: bool,
}

/// Reads `hh:mm:ss[.fraction]`; an empty field is midnight.
fn time_of_day(line: Line<'_>, text: &str) -> Result<TimeOfDay, Error> {
    let bad = || {
        const EXPECTED: &str = "a time of day (hh:mm:ss.ssssss)";
        Error::field(Part::Configuration, line.number, "time", text, EXPECTED)
    };
    let text_or_zero = if text.is_empty() { "0:0:0" } else { text };
    let (clock, fraction) = text_or_zero.split_once('.').unwrap_or((text_or_zero, ""));
    let parts: Vec<i32> = clock
        .split(':')
        .map(|part| part.trim().parse().map_err(|_| bad()))
        .collect::<Result<_, _>>()?;
    let [hour @ 0..=23, minute @ 0..=59, second @ 0..=60] = parts[..] else {
        return Err(bad());
    };
    let fraction = fraction.trim();
    if !fraction.bytes().all(|b| b.is_ascii_digit()) {
        return Err(bad());
    }
    let nine_digits: String = fraction
        .chars()
        .chain("000000000".chars())
        .take(9)
        .collect();
    Ok(TimeOfDay {
        hour,
        minute,
        second,
        fraction_ns: nine_digits.parse().map_err(|_| bad())?,
        nanoseconds: fraction.len() > MICROSECOND_DIGITS,
    })
}

/// Reads the two last lines of a 2013 configuration: `time_code,local_code` and
/// `tmq_code,leapsec`.
pub(super) fn time_code(codes: Line<'_>, quality: Option<Line<'_>>) -> Result<TimeCode, Error> {
    let fields = codes.fields();
    let utc_offset_s = offset_s(codes, "time_code", fields.first().copied().unwrap_or(""))?;
    let local_offset_s = offset_s(codes, "local_code", fields.get(1).copied().unwrap_or(""))?;
    let quality_fields = quality.map(Line::fields).unwrap_or_default();
    let quality_line = quality.map_or(codes.number, |line| line.number);
    let bad = |field, found, expected| {
        Error::field(Part::Configuration, quality_line, field, found, expected)
    };
    let quality = match quality_fields.first().copied().unwrap_or("") {
        "" => None,
        text => match u8::from_str_radix(text, 16) {
            Ok(code @ 0..=15) => Some(code),
            _ => return Err(bad("tmq_code", text, "a hexadecimal digit")),
        },
    };
    let leap_second = match quality_fields.get(1).copied().unwrap_or("") {
        "0" => LeapSecond::None,
        "1" => LeapSecond::Inserted,
        "2" => LeapSecond::Removed,
        "" | "3" => LeapSecond::Unknown,
        text => return Err(bad("leapsec", text, "0, 1, 2 or 3")),
    };
    Ok(TimeCode {
        utc_offset_s,
        local_offset_s,
        quality,
        leap_second,
    })
}

/// Seconds east of UTC from `-5h30`, `+9`, `5:45`, `0`; none for `x` and for an empty field.
fn offset_s(line: Line<'_>, field: &'static str, text: &str) -> Result<Option<i32>, Error> {
    let bad = || {
        const EXPECTED: &str = "an offset from UTC (-5h30, +9, 0 or x)";
        Error::field(Part::Configuration, line.number, field, text, EXPECTED)
    };
    if text.is_empty() || text.eq_ignore_ascii_case("x") {
        return Ok(None);
    }
    let (sign, digits) = match text.strip_prefix('-') {
        Some(rest) => (-1, rest),
        None => (1, text.strip_prefix('+').unwrap_or(text)),
    };
    let (hours, minutes) = digits
        .split_once(['h', 'H', 't', 'T', ':'])
        .unwrap_or((digits, ""));
    let minutes = if minutes.is_empty() { "0" } else { minutes };
    match (hours.parse::<i32>(), minutes.parse::<i32>()) {
        (Ok(hours @ 0..=14), Ok(minutes @ 0..=59)) => {
            Ok(Some(sign * (hours * 3600 + minutes * 60)))
        }
        _ => Err(bad()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, revision: Revision) -> (Result<Stamp, Error>, Vec<Note>) {
        let mut notes = Vec::new();
        let stamp = stamp(Line { number: 9, text }, revision, &mut notes);
        (stamp, notes)
    }

    #[test]
    fn month_comes_first_in_1991_and_a_two_digit_year_is_completed() {
        let (stamp, notes) = read("09/17/15,10:52:52.987545", Revision::Y1991);
        // 2015-09-17T10:52:52Z is 1_442_487_172 s after 1970.
        assert_eq!(stamp.unwrap().civil_ns, Some(1_442_487_172_987_545_000));
        assert_eq!(
            notes,
            [Note::ShortYear {
                line: 9,
                year: 2015
            }]
        );
    }

    #[test]
    fn nine_digits_of_a_second_mean_nanoseconds_and_second_sixty_is_the_next_minute() {
        let (stamp, _) = read("17/02/2021,17:37:12.422969065", Revision::Y2013);
        assert!(stamp.unwrap().nanoseconds);
        let (leap, notes) = read("31/12/2016,23:59:60.5", Revision::Y2013);
        assert_eq!(leap.unwrap().civil_ns, Some(1_483_228_800_500_000_000));
        assert_eq!(notes, [Note::SecondSixty { line: 9 }]);
    }

    #[test]
    fn an_impossible_date_is_refused_and_the_only_possible_order_is_taken() {
        assert!(read("09/44/2025,15:44:15.167", Revision::Y1999).0.is_err());
        assert!(read("31/02/2025,15:44:15.167", Revision::Y1999).0.is_err());
        let (stamp, notes) = read("02/13/2020,00:00:00", Revision::Y1999);
        assert!(stamp.unwrap().civil_ns.is_some());
        assert_eq!(notes, [Note::DayAndMonthSwapped { line: 9 }]);
    }

    #[test]
    fn a_zero_date_is_an_unknown_time() {
        let (stamp, _) = read("00/00/0000,00:00:00.000000", Revision::Y1999);
        assert_eq!(stamp.unwrap().civil_ns, None);
    }

    #[test]
    fn offsets_from_utc_are_read_as_the_standard_writes_them() {
        let line = Line {
            number: 1,
            text: "",
        };
        let read = |text| offset_s(line, "time_code", text);
        assert_eq!(read("-5h30").unwrap(), Some(-19_800));
        assert_eq!(read("+9").unwrap(), Some(32_400));
        assert_eq!(read("x").unwrap(), None);
        assert!(read("25h").is_err());
    }
}
