//! Times of day as people type them, on command lines and in scene files.

/// A time of day in [0, 24] h: `18.5` or `18:30`. `None` for anything else, signs and exponents too.
pub fn clock(text: &str) -> Option<f64> {
    let digits = |t: &str| !t.is_empty() && t.bytes().all(|b| b.is_ascii_digit());
    let hour = match text.split_once(':') {
        Some((hour, minute)) => {
            let minute: u8 =
                minute.parse().ok().filter(|m| *m < 60 && minute.len() == 2 && digits(minute))?;
            hour.parse::<f64>().ok().filter(|_| digits(hour))? + f64::from(minute) / 60.0
        }
        None => text.parse().ok().filter(|_| text.bytes().all(|b| b.is_ascii_digit() || b == b'.'))?,
    };
    (0.0..=24.0).contains(&hour).then_some(hour)
}

/// An hour of the day, as [`clock`] but below 24.
///
/// # Errors
/// What was expected.
pub fn hour(text: &str) -> Result<f64, String> {
    clock(text)
        .filter(|hour| *hour < 24.0)
        .ok_or_else(|| "expected an hour from 0 to below 24, such as 18.05 or 18:03".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hours_are_decimal_or_of_minutes() {
        for (text, expected) in [("18.5", 18.5), ("18:30", 18.5), ("0", 0.0), (".5", 0.5), ("7:03", 7.05)] {
            assert_eq!((clock(text), hour(text)), (Some(expected), Ok(expected)), "{text}");
        }
        assert_eq!(clock("24"), Some(24.0));
        let wrong = [
            "", ".", "24", "24.1", "-1", "+5", "1e1", "nan", "noon", "18:3", "18:60", "18:+3", "1.5:30",
            ":30", "12,13", "0..24", "3..4",
        ];
        for wrong in wrong {
            assert!(hour(wrong).is_err_and(|what| what.contains("18:03")), "{wrong}");
        }
    }
}
