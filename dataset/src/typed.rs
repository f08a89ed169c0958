//! What people type on command lines: hours, time limits, commands.

use clap::CommandFactory;
use clap::error::ErrorKind;
use std::path::Path;
use std::time::Duration;

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

/// A time limit: `90s`, `5m`, `2h`.
///
/// # Errors
/// What was expected, for a time below a second or without a unit.
pub fn time_limit(text: &str) -> Result<Duration, String> {
    let units = [("s", 1.0), ("m", 60.0), ("h", 3600.0)];
    let found = units
        .iter()
        .find_map(|(unit, seconds)| Some(text.strip_suffix(unit)?.trim().parse::<f64>().ok()? * seconds));
    let seconds = found.filter(|s| (1.0..=1e7).contains(s));
    seconds
        .map(Duration::from_secs_f64)
        .ok_or_else(|| "expected a time from 1s to 2777h, such as 90s, 5m or 2h".to_owned())
}

/// Ends the process with what was meant where the first argument is nearly the name of a command, for
/// programs whose first argument may also be a path; `expected` is what that is, such as "a dataset's
/// folder".
pub fn refuse_misspelt<Cli: CommandFactory>(expected: &str) {
    let mut command = Cli::command();
    if let Some(typed) = std::env::args().nth(1)
        && let Some(meant) = misspelt(&typed, &command)
    {
        let what =
            format!("'{typed}' is neither a command nor {expected}; did you mean the command '{meant}'?");
        command.error(ErrorKind::InvalidSubcommand, what).exit();
    }
}

/// The command that a misspelt argument was meant to be, if no file has its name.
fn misspelt(typed: &str, command: &clap::Command) -> Option<String> {
    if typed.starts_with('-') || Path::new(typed).exists() {
        return None;
    }
    let names = command.get_subcommands().map(|command| command.get_name());
    let near = names.map(|name| (strsim::damerau_levenshtein(name, typed), name)).min()?;
    (1..=2).contains(&near.0).then(|| near.1.to_owned())
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

    #[test]
    fn time_limits_have_a_unit_and_last_a_second() {
        for (text, seconds) in [("90s", 90), ("5m", 300), ("2h", 7200), ("0.5h", 1800), ("1 s", 1)] {
            assert_eq!(time_limit(text), Ok(Duration::from_secs(seconds)), "{text}");
        }
        for wrong in ["0s", "5", "-5m", "0.5s", "1d", "nans", "infh", "s", ""] {
            assert!(time_limit(wrong).is_err_and(|what| what.contains("such as 90s")), "{wrong}");
        }
    }

    #[test]
    fn a_command_misspelt_is_recognised() {
        let command = clap::Command::new("bake").subcommand(clap::Command::new("preview"));
        for (typed, meant) in [("preveiw", Some("preview")), ("previw", Some("preview")), ("yard.toml", None)]
        {
            assert_eq!(misspelt(typed, &command).as_deref(), meant, "{typed}");
        }
        for not in ["preview", "--preveiw"] {
            assert_eq!(misspelt(not, &command), None);
        }
    }
}
