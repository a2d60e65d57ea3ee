//! Which code page the texts of a file are in.
//!
//! The editions up to 1999 say ASCII and recorders write whatever their country uses. The rule:
//! 0. a byte-order mark says it (UTF-8, UTF-16) and is dropped;
//! 1. valid UTF-8 is UTF-8;
//! 2. otherwise the runs of bytes above 0x7F decide. If every run is made of two-byte GB 2312
//!    characters and most of them are symbols or level-1 (everyday) characters, it is GB 18030:
//!    Russian text fails this by runs of odd length and by lower-case letters, whose codes would
//!    be rare level-2 characters;
//! 3. else, if most of those bytes are Cyrillic letters of windows-1251 and stand next to each
//!    other, it is windows-1251;
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
    let runs: Vec<&[u8]> = bytes
        .split(u8::is_ascii)
        .filter(|run| !run.is_empty())
        .collect();
    if looks_chinese(&runs) {
        GB18030
    } else if looks_cyrillic(&runs) {
        WINDOWS_1251
    } else {
        WINDOWS_1252
    }
}

fn looks_chinese(runs: &[&[u8]]) -> bool {
    let (mut pairs, mut everyday) = (0_usize, 0_usize);
    for run in runs {
        if run.len() % 2 == 1 {
            return false;
        }
        for pair in run.chunks_exact(2) {
            if pair[0] < 0xa1 || pair[0] > 0xf7 || pair[1] < 0xa1 {
                return false;
            }
            pairs += 1;
            everyday += usize::from(pair[0] <= 0xd7);
        }
    }
    pairs > 0 && everyday as f64 >= SHARE_MIN * pairs as f64
}

fn looks_cyrillic(runs: &[&[u8]]) -> bool {
    const YO: [u8; 2] = [0xa8, 0xb8];
    let (mut bytes, mut letters) = (0_usize, 0_usize);
    for run in runs {
        bytes += run.len();
        let fits = run.iter().filter(|&&b| b >= 0xc0 || YO.contains(&b));
        letters += if run.len() > 1 { fits.count() } else { 0 };
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
    }
}
