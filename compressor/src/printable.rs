//! Makes text from files safe for the terminal.

/// A text with control characters and changes of writing direction escaped, such as `\u{1b}`.
pub fn printable(text: &str) -> String {
    let steers = |c: char| {
        c.is_control()
            || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match steers(c) {
            true => out.extend(c.escape_default()),
            false => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_and_all_else_is_unchanged() {
        assert_eq!(
            printable("a\u{1b}[31mb\u{9b}2J\r\n\u{7}\u{202e}"),
            "a\\u{1b}[31mb\\u{9b}2J\\r\\n\\u{7}\\u{202e}"
        );
        let plain = "Hof \"Süd\" – 庭 \\ 100 %";
        assert_eq!(printable(plain), plain);
    }
}
