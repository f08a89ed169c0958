//! Text files that other programs wrote: their encodings and line ends.

use std::borrow::Cow;

/// The text of a file: UTF-16 where a byte order mark says so, UTF-8 with or without one; any other is taken
/// for Latin-1, in which every byte is a character.
pub(crate) fn decode(bytes: &[u8]) -> Cow<'_, str> {
    match bytes {
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        [0xef, 0xbb, 0xbf, rest @ ..] => eight_bits(rest),
        _ => eight_bits(bytes),
    }
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Cow<'_, str> {
    let units: Vec<u16> = bytes.as_chunks::<2>().0.iter().map(|&pair| unit(pair)).collect();
    String::from_utf16_lossy(&units).into()
}

fn eight_bits(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => bytes.iter().map(|&byte| char::from(byte)).collect::<String>().into(),
    }
}

/// The lines of a text, which LF, CR LF or CR ends.
pub(crate) fn lines(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let text = rest?;
        let Some(end) = text.find(['\r', '\n']) else {
            rest = None;
            return Some(text);
        };
        let (line, after) = text.split_at(end);
        rest = Some(after.strip_prefix("\r\n").unwrap_or(&after[1..]));
        Some(line)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_are_told_by_their_marks() {
        let utf16 = |mark: u16, bytes: fn(u16) -> [u8; 2]| -> Vec<u8> {
            [mark].into_iter().chain("é1\n".encode_utf16()).flat_map(bytes).collect()
        };
        for bytes in [
            "é1\n".as_bytes(),
            b"\xef\xbb\xbf\xc3\xa91\n",
            b"\xe91\n",
            &utf16(0xfeff, u16::to_le_bytes),
            &utf16(0xfeff, u16::to_be_bytes),
        ] {
            assert_eq!(decode(bytes), "é1\n");
        }
        assert_eq!(decode(b"\xff\xfea"), "");
        assert_eq!(decode(b""), "");
    }

    #[test]
    fn lines_end_in_three_ways() {
        for text in ["a\n\nb\n", "a\r\n\r\nb\r\n", "a\r\rb\r", "a\r\n\rb\n"] {
            assert_eq!(lines(text).collect::<Vec<_>>(), ["a", "", "b", ""], "{text:?}");
        }
        assert_eq!(lines("").collect::<Vec<_>>(), [""]);
    }
}
