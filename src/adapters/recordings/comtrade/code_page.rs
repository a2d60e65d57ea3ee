//! Which code page the texts of a file are in.
//!
//! The editions up to 1999 say ASCII and recorders write whatever their country uses. The rule:
//! 0. a byte-order mark says it (UTF-8, UTF-16) and is dropped;
//! 1. valid UTF-8 is UTF-8;
//! 2. otherwise the runs of bytes above 0x7F decide. If every run is made of two-byte GB 2312
//!    characters and most of them are symbols or level-1 (everyday) characters, it is GB 18030:
//!    Russian text fails this by runs of odd length, by lower-case letters, whose codes would be
//!    rare level-2 characters, and, abbreviations of two capitals, by having no code below 0xC0;
//! 3. else, if most of those bytes are Cyrillic letters of windows-1251 and stand next to each
//!    other, not in the middle of a word of ASCII letters, it is windows-1251;
//! 4. else it is windows-1252 (Latin-1): single accented letters among ASCII ones.
//!
//! A caller that knows better names the code page.

use encoding_rs::{Encoding, GB18030, UTF_8, WINDOWS_1251, WINDOWS_1252};

/// Share of bytes or characters that must fit for rules 2 and 3; chosen, and insensitive between
/// 0.6 and 0.95 on Chinese and Russian recorder files.
const SHARE_MIN: f64 = 0.8;

/// The code page of `bytes` by the rule above.
pub(super) fn detect(bytes: &[u8]) -> &'static Encoding {
    if let Some((encoding, _)) = Encoding::for_bom(bytes) {
        return encoding;
    }
    if std::str::from_utf8(bytes).is_ok() {
        return UTF_8;
    }
    let runs = runs(bytes);
    if looks_chinese(&runs) {
        GB18030
    } else if looks_cyrillic(&runs) {
        WINDOWS_1251
    } else {
        WINDOWS_1252
    }
}

/// Bytes above 0x7F that follow one another.
struct Run<'a> {
    bytes: &'a [u8],
    /// Whether there is an ASCII letter right before and right behind.
    within_word: bool,
}

fn runs(bytes: &[u8]) -> Vec<Run<'_>> {
    let letter = |at: Option<usize>| {
        at.and_then(|at| bytes.get(at))
            .is_some_and(u8::is_ascii_alphabetic)
    };
    let mut runs = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let length = bytes[at..].iter().take_while(|b| !b.is_ascii()).count();
        if length > 0 {
            runs.push(Run {
                bytes: &bytes[at..at + length],
                within_word: letter(at.checked_sub(1)) && letter(Some(at + length)),
            });
        }
        at += length + 1;
    }
    runs
}

fn looks_chinese(runs: &[Run<'_>]) -> bool {
    const CYRILLIC_FROM: u8 = 0xc0;
    let (mut pairs, mut everyday, mut told) = (0_usize, 0_usize, false);
    for run in runs {
        if run.bytes.len() % 2 == 1 {
            return false;
        }
        told |= run.bytes.iter().any(|byte| *byte < CYRILLIC_FROM);
        for pair in run.bytes.chunks_exact(2) {
            if pair[0] < 0xa1 || pair[0] > 0xf7 || pair[1] < 0xa1 {
                return false;
            }
            pairs += 1;
            everyday += usize::from(pair[0] <= 0xd7);
        }
    }
    told && everyday as f64 >= SHARE_MIN * pairs as f64
}

fn looks_cyrillic(runs: &[Run<'_>]) -> bool {
    const YO: [u8; 2] = [0xa8, 0xb8];
    let (mut bytes, mut letters) = (0_usize, 0_usize);
    for run in runs {
        bytes += run.bytes.len();
        let fits = run.bytes.iter().filter(|&&b| b >= 0xc0 || YO.contains(&b));
        let word = run.bytes.len() > 1 && !run.within_word;
        letters += if word { fits.count() } else { 0 };
    }
    letters as f64 >= SHARE_MIN * bytes as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn detected_as(text: &str, written_in: &'static Encoding) -> &'static str {
        let (bytes, _, _) = written_in.encode(text);
        detect(&bytes).name()
    }

    #[test]
    fn labels_are_read_in_the_code_page_they_were_written_in() {
        assert_eq!(detected_as("Ua,V", UTF_8), "UTF-8");
        assert_eq!(
            detected_as(
                "220kV\u{6bcd}\u{7ebf}_Ua,1\u{53f7}\u{4e3b}\u{53d8}",
                GB18030
            ),
            "gb18030"
        );
        assert_eq!(
            detected_as(
                "Ua_1\u{421}\u{428}-110_\u{422}\u{41d},\u{440}\u{435}\u{433}\u{438}\u{441}\u{442}\u{440}",
                WINDOWS_1251
            ),
            "windows-1251"
        );
        assert_eq!(
            detected_as("Umspannwerk K\u{f6}ln S\u{fc}d", WINDOWS_1252),
            "windows-1252"
        );
        // Letters side by side in a word, and an abbreviation whose codes are also a Chinese character's.
        assert_eq!(
            detected_as("Gr\u{f6}\u{df}e,1", WINDOWS_1252),
            "windows-1252"
        );
        assert_eq!(
            detected_as("Uc_\u{421}\u{428},1", WINDOWS_1251),
            "windows-1251"
        );
    }
}
