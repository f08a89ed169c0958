//! Terminal output of all binaries: messages, progress, the JSON line, and the exit code.

use dataset::host::signals;
use dataset::observe::{Message, Meter, Observer};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Options every command takes.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub struct ConsoleArgs {
    /// Print only results and errors.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Print one JSON object on stdout when done (messages go to stderr).
    #[arg(long, global = true)]
    pub json: bool,
    /// Worker threads, 1 to 1024 [default: one per core].
    #[arg(long, global = true, value_name = "N", value_parser = parse_threads)]
    pub threads: Option<u16>,
}

/// `4`; clap's own range would speak of `1..=1024`.
fn parse_threads(text: &str) -> Result<u16, String> {
    let threads = text.parse().ok().filter(|threads| (1..=1024).contains(threads));
    threads.ok_or_else(|| "expected a number of threads from 1 to 1024".to_owned())
}

/// Messages and progress on stderr; silent with `--quiet`.
#[derive(Clone, Copy, Debug)]
pub struct Console {
    /// Print errors only.
    pub quiet: bool,
    /// Print one JSON object when done.
    pub json: bool,
}

/// A progress bar with share, task and remaining time; silent with `--quiet`; plain lines where stderr is not
/// a terminal.
#[derive(Debug)]
pub struct Progress {
    what: String,
    /// Counts and estimates the time left; draws only where stderr is a terminal.
    bar: ProgressBar,
    /// Where stderr is no terminal: when the next plain line is due. `None` if no lines are wanted.
    next_line: Option<Mutex<Instant>>,
}

/// Shortest time between two plain progress lines.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

impl Console {
    /// Applies the options: sets up the thread pool.
    pub fn new(args: ConsoleArgs) -> Self {
        if let Some(threads) = args.threads {
            // Fails only if the pool already exists, as in tests; its setting remains.
            let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
        }
        Console { quiet: args.quiet, json: args.json }
    }

    /// A line of information, on stderr.
    pub fn say(&self, text: impl AsRef<str>) {
        if !self.quiet {
            line(text.as_ref());
        }
    }

    /// A warning (shown also under `--quiet`).
    pub fn warn(&self, text: impl AsRef<str>) {
        line(&format!("warning: {}", text.as_ref()));
    }

    /// An error that does not end the command, such as one of several faults (shown also under `--quiet`).
    pub fn error(&self, error: &dataset::Error) {
        line(&format!("error: {error}"));
    }

    /// A line of the command's answer, such as a row of a table: on stdout, or on stderr where stdout is the
    /// JSON object's; shown also under `--quiet` unless `--json` replaces it.
    pub fn print(&self, text: impl AsRef<str>) {
        if !self.json {
            if let Err(error) = writeln!(std::io::stdout().lock(), "{}", text.as_ref()) {
                *LOST.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = Some(error);
            }
        } else if !self.quiet {
            line(text.as_ref());
        }
    }

    /// A progress bar over `total` units of work.
    pub fn progress(&self, what: &str, total: u64) -> Progress {
        let terminal = std::io::stderr().is_terminal();
        let target = if !self.quiet && terminal {
            ProgressDrawTarget::stderr_with_hz(5)
        } else {
            ProgressDrawTarget::hidden()
        };
        let bar = ProgressBar::with_draw_target(Some(total), target);
        if let Ok(style) =
            ProgressStyle::with_template("{prefix} [{bar:30}] {percent:>3} %  {eta} left  {msg}")
        {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(what.to_owned());
        if !bar.is_hidden() {
            *DRAWN.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = Some(bar.clone());
        }
        let lines = !self.quiet && !terminal;
        let next_line = lines.then(|| Mutex::new(Instant::now() + LINE_INTERVAL));
        Progress { what: what.to_owned(), bar, next_line }
    }

    /// The result of a command: `object` under `--json` (one line on stdout), else nothing.
    ///
    /// # Errors
    /// [`dataset::Error::Io`] if it cannot be written; a reader that closed the pipe is no failure of the
    /// command.
    pub fn result(&self, object: &serde_json::Value) -> dataset::Result<()> {
        let mut out = std::io::stdout().lock();
        let written = match self.json {
            true => writeln!(out, "{object}").and_then(|()| out.flush()),
            // Lines of the answer that were lost before.
            false => LOST.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take().map_or(Ok(()), Err),
        };
        match written {
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
                Err(dataset::Error::io(std::path::Path::new("standard output"))(error))
            }
            _ => Ok(()),
        }
    }
}

impl Observer for Console {
    fn message(&self, kind: Message, text: &str) {
        match kind {
            Message::Info => self.say(text),
            Message::Warning => self.warn(text),
        }
    }

    fn meter(&self, task: &str, total: u64) -> Box<dyn Meter> {
        Box::new(self.progress(task, total))
    }
}

impl Meter for Progress {
    fn advance(&self, n: u64) {
        self.bar.inc(n);
        self.line_when_due();
    }

    fn note(&self, text: &str) {
        self.bar.set_message(text.to_owned());
    }
}

impl Progress {
    /// One plain line, if the last is long enough ago and no other thread is about to write it.
    fn line_when_due(&self) {
        let Some(Ok(mut next)) = self.next_line.as_ref().map(Mutex::try_lock) else { return };
        let now = Instant::now();
        if now < *next {
            return;
        }
        *next = now + LINE_INTERVAL;
        line(&self.plain());
    }

    /// The plain line: task, share, remaining time, note.
    fn plain(&self) -> String {
        let (done, total) = (self.bar.position(), self.bar.length().unwrap_or(0).max(1));
        let left = indicatif::HumanDuration(self.bar.eta());
        let note = self.bar.message();
        let percent = (100 * done.min(total)) / total;
        format!("{}: {percent} %, {left:#} left  {note}", self.what).trim_end().to_owned()
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if !self.bar.is_hidden() {
            *DRAWN.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = None;
        }
        self.bar.finish_and_clear();
    }
}

/// Ends the process with code 2 if an argument is not UTF-8. Such a name could be opened, but not be stated
/// in JSON and reports, which are written when the work is done. For binaries, before arguments are parsed.
pub fn refuse_arguments_not_utf8<Cli: clap::CommandFactory>() {
    let text = |argument: std::ffi::OsString| argument.into_string().err();
    if let Some((number, argument)) = (0..).zip(std::env::args_os()).find_map(|(i, a)| Some((i, text(a)?))) {
        let what = format!("argument {number}, {argument:?}, is not UTF-8; rename the file or folder");
        Cli::command().error(clap::error::ErrorKind::InvalidUtf8, what).exit();
    }
}

/// Makes Ctrl-C, a termination request and a closing terminal end the process within a fifth of a second,
/// with exit code 130, 143 or 129. For binaries, once, at the start of `main`.
pub fn catch_interrupts() {
    signals::catch(|error| line(&format!("error: {error}")));
}

/// Prints an error with its causes and gives the exit code of a failed command,
/// [`dataset::Error::exit_code`].
pub fn fail(error: &dataset::Error) -> ExitCode {
    let is_interrupted = matches!(error, dataset::Error::Interrupted);
    if is_interrupted && !signals::is_first_to_say() {
        return ExitCode::from(signals::exit_code());
    }
    line(&format!("error: {error}"));
    // The message of an I/O error already ends with what the system said; deeper causes follow.
    let mut cause = std::error::Error::source(error).and_then(std::error::Error::source);
    while let Some(deeper) = cause {
        line(&format!("  because: {deeper}"));
        cause = deeper.source();
    }
    ExitCode::from(if is_interrupted { signals::exit_code() } else { error.exit_code() })
}

/// Why a line of the answer could not be written.
static LOST: Mutex<Option<std::io::Error>> = Mutex::new(None);

/// The bar that is drawn now; lines are written above it.
static DRAWN: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Writes one line to stderr; a closed stderr is not an error.
fn line(text: &str) {
    let drawn = DRAWN.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone();
    let write = || _ = writeln!(std::io::stderr().lock(), "{text}");
    match drawn {
        Some(bar) => bar.suspend(write),
        None => write(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SILENT: Console = Console { quiet: true, json: false };

    #[test]
    fn progress_counts_from_any_thread_and_takes_more_than_its_total() {
        let progress = SILENT.progress("work", 10);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..5).for_each(|_| progress.advance(1)));
            }
        });
        progress.note("done");
        assert_eq!(progress.bar.position(), 20);
        let text = progress.plain();
        assert!(text.starts_with("work: 100 %, ") && text.ends_with(" left  done"), "{text}");
        // A bar over nothing does not divide by zero.
        let text = SILENT.progress("nothing", 0).plain();
        assert!(text.starts_with("nothing: 0 %, ") && text.ends_with(" left"), "{text}");
    }

    #[test]
    fn a_plain_line_is_written_when_due_and_no_sooner() {
        let mut progress = SILENT.progress("work", 10);
        // Never where no lines are wanted.
        assert!(progress.next_line.is_none());
        let due = |progress: &Progress| *progress.next_line.as_ref().unwrap().lock().unwrap();
        let later = Instant::now() + LINE_INTERVAL;
        progress.next_line = Some(Mutex::new(later));
        progress.advance(1);
        assert_eq!(due(&progress), later);
        let now = Instant::now();
        progress.next_line = Some(Mutex::new(now));
        progress.advance(1);
        assert!(due(&progress) >= now + LINE_INTERVAL);
    }

    #[test]
    fn exit_codes() {
        assert_eq!(format!("{:?}", fail(&dataset::Error::Interrupted)), format!("{:?}", ExitCode::from(130)));
        assert_eq!(
            format!("{:?}", fail(&dataset::Error::invalid("a", "b"))),
            format!("{:?}", ExitCode::FAILURE)
        );
    }
}
