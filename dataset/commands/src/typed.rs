//! What people type on command lines: time limits, commands.

use clap::CommandFactory;
use clap::error::ErrorKind;
use std::path::Path;
use std::time::Duration;

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
