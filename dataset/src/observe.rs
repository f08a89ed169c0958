//! What a long job reports to its caller. Libraries print nothing: a command's
//! console does; a program that embeds them brings its own [`Observer`].

/// Kind of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// Information.
    Info,
    /// A warning: the job goes on, and something should be looked at.
    Warning,
}

/// Receives messages and progress, from any thread.
///
/// ```
/// use dataset::observe::{Message, Meter, Observer, Silent};
///
/// /// Keeps warnings.
/// #[derive(Default)]
/// struct Warnings(std::sync::Mutex<Vec<String>>);
///
/// impl Observer for Warnings {
///     fn message(&self, kind: Message, text: &str) {
///         if kind == Message::Warning {
///             self.0.lock().unwrap().push(text.to_owned());
///         }
///     }
///     fn meter(&self, task: &str, total: u64) -> Box<dyn Meter> {
///         Silent.meter(task, total)
///     }
/// }
///
/// let warnings = Warnings::default();
/// let observer: &dyn Observer = &warnings;
/// observer.say("reading");
/// observer.warn("the scene has no light");
/// let progress = observer.progress("tracing", 10);
/// progress.advance(1);
/// assert_eq!(*warnings.0.lock().unwrap(), ["the scene has no light"]);
/// ```
pub trait Observer: Sync {
    /// A message of one line.
    fn message(&self, kind: Message, text: &str);

    /// A new task of `total` units.
    fn meter(&self, task: &str, total: u64) -> Box<dyn Meter>;
}

/// Receives the progress of one task until it is dropped.
pub trait Meter: Send + Sync {
    /// `n` more units are done.
    fn advance(&self, n: u64);

    /// A short note, such as the error so far.
    fn note(&self, text: &str);
}

impl dyn Observer + '_ {
    /// Reports information.
    pub fn say(&self, text: impl AsRef<str>) {
        self.message(Message::Info, text.as_ref());
    }

    /// Reports a warning.
    pub fn warn(&self, text: impl AsRef<str>) {
        self.message(Message::Warning, text.as_ref());
    }

    /// Begins a task of `total` units.
    pub fn progress(&self, task: &str, total: u64) -> Box<dyn Meter> {
        self.meter(task, total)
    }
}

/// Ignores everything.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {
    fn message(&self, _: Message, _: &str) {}

    fn meter(&self, _: &str, _: u64) -> Box<dyn Meter> {
        Box::new(Silent)
    }
}

impl Meter for Silent {
    fn advance(&self, _: u64) {}

    fn note(&self, _: &str) {}
}

impl<M: Meter + ?Sized> Meter for Box<M> {
    fn advance(&self, n: u64) {
        (**self).advance(n);
    }

    fn note(&self, text: &str) {
        (**self).note(text);
    }
}

/// A number with its noun: `1 frame`, `2 frames`.
pub fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_no_plural() {
        assert_eq!([0, 1, 2].map(|n| count(n, "frame")), ["0 frames", "1 frame", "2 frames"]);
    }
}
