//! All errors, each with what a user needs to fix it. All texts are in this file.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::near;

/// A text of a file or another tool as one line that can be shown: control characters escaped.
pub fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() { line.extend(c.escape_debug()) } else { line.push(c) }
    }
    line
}

/// A number in a message: the shortest digits that give exactly this number, with an exponent if it would otherwise be
/// a row of zeros.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number(pub f64);

impl Number {
    /// Magnitudes from the first up to the second are written out.
    const WRITTEN_OUT: std::ops::Range<f64> = 1e-4..1e9;
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Number(value) = *self;
        // LowerExp would show these two as Display does, and a zero as 0e0.
        if value == 0.0 || !value.is_finite() || Self::WRITTEN_OUT.contains(&value.abs()) {
            // No sign at zero.
            return fmt::Display::fmt(&(value + 0.0), f);
        }
        fmt::LowerExp::fmt(&value, f)
    }
}

/// Reasons why a set of parameters, a structure or a start is refused, one per line.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Invalid {
    reasons: Vec<String>,
}

impl Invalid {
    /// One reason: the variable, what it is, and what is allowed.
    pub fn new(variable: impl fmt::Display, value: impl fmt::Display, allowed: impl fmt::Display) -> Self {
        Invalid::because(format_args!("{variable} = {value}: {allowed}"))
    }

    /// One reason in free words.
    pub fn because(reason: impl fmt::Display) -> Self {
        // What comes from a file may hold line ends; a reason is one line.
        Invalid { reasons: vec![reason.to_string().split_whitespace().collect::<Vec<_>>().join(" ")] }
    }

    /// No reason yet; see [`Invalid::into_result`].
    pub fn none() -> Self {
        Invalid::default()
    }

    /// Adds the name of the part that they are about.
    pub(crate) fn within(self, part: &str) -> Self {
        self.reworded(|reason| format!("{part}: {reason}"))
    }

    /// Rewords each reason.
    pub(crate) fn reworded(self, word: impl Fn(String) -> String) -> Self {
        Invalid { reasons: self.reasons.into_iter().map(word).collect() }
    }

    /// Adds the time at which they were found, s.
    pub(crate) fn at(self, time: f64) -> Self {
        self.reworded(|reason| format!("{reason} (at t = {} s)", Number(time)))
    }

    /// Adds the reasons of another.
    pub fn and(&mut self, other: Invalid) {
        self.reasons.extend(other.reasons);
    }

    /// `Ok` when there is no reason.
    ///
    /// # Errors
    /// Itself, when there is one.
    pub fn into_result(self) -> Result<(), Invalid> {
        if self.reasons.is_empty() { Ok(()) } else { Err(self) }
    }

    /// The reasons.
    pub fn reasons(&self) -> &[String] {
        &self.reasons
    }
}

impl fmt::Display for Invalid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.reasons.join("; "))
    }
}

impl std::error::Error for Invalid {}

/// Reasons why a communication step could not be finished. Time and state are as before the step.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StepError {
    /// A value grew beyond any use: the loop is unstable.
    #[error(
        "{variable} = {value:e} at t = {} s: the simulation diverges. \
         Check the gains and the loop, or take a smaller communication step",
        Number(*.time)
    )]
    Diverged {
        /// The variable.
        variable: String,
        /// Its value.
        value: f64,
        /// Time, s.
        time: f64,
    },
    /// No step size meets the tolerance: the equations jump without an event, or have a pole.
    #[error(
        "no step size reaches the relative tolerance {tolerance:e} from {variable} = {value:e} at t = {} s (last tried \
         {step:e} s). The equations may be singular there, or the simulation diverges",
        Number(*.time)
    )]
    StepTooSmall {
        /// Time, s.
        time: f64,
        /// The step that was tried last, s.
        step: f64,
        /// The tolerance asked for.
        tolerance: f64,
        /// The state with the largest error.
        variable: String,
        /// Its value.
        value: f64,
    },
    /// The stiff method was asked for where it can't go.
    #[error(
        "a derivative of der({variable}) by states or time is no number at t = {} s, and the stiff method needs \
         it: set integration_method to automatic or explicit",
        Number(*.time)
    )]
    NoJacobian {
        /// The state whose rate it is.
        variable: String,
        /// Time, s.
        time: f64,
    },
    /// The step needs more work than allowed.
    #[error(
        "{events} events and {substeps} substeps reached only t = {} s of a communication step of {} s, with all the \
         work that work_limit allows. The system changes too fast for this step: take a smaller one or a larger \
         work_limit. If it is stiff and integration_method is explicit, take another method{}",
        Number(*.time), Number(*.step), followed
    )]
    TooMuchWork {
        /// Number of events on the way.
        events: usize,
        /// Number of substeps.
        substeps: usize,
        /// Time that they reached, s.
        time: f64,
        /// The communication step, s.
        step: f64,
        /// The mode that limited the substeps, if any, as the end of the message.
        followed: String,
    },
    /// Events of one indicator accumulate.
    #[error(
        "the events of {indicator} accumulate at t = {time} s: {events} so far, the last {close} of them with no time \
         between (Zeno behaviour). If it is a contact, let it rest: when the speed after an event is small, \
         set a discrete variable that makes the equations hold it. If it is a switch, add hysteresis"
    )]
    Accumulation {
        /// The indicator.
        indicator: String,
        /// Number of its events.
        events: u64,
        /// Number of these with no time between them.
        close: u64,
        /// Time, s.
        time: f64,
    },
    /// An event has stopped the motion across its indicator's zero, and it goes on through.
    #[error(
        "event {events} of {indicator} at t = {time} s stops the motion, but afterwards the motion goes on \
         through zero. Set a discrete variable in the event that makes the equations hold the stopped states"
    )]
    GoesThrough {
        /// The indicator.
        indicator: String,
        /// Number of this event among its events.
        events: u64,
        /// Time, s.
        time: f64,
    },
    /// Events follow each other without time going on.
    #[error("more than {events} events at t = {} s: the system switches without end (Zeno behaviour)", Number(*.time))]
    TooManyEvents {
        /// Number of events.
        events: usize,
        /// Time, s.
        time: f64,
    },
    /// The equations don't hold at the end of the step, as the system itself reports.
    #[error("{0}")]
    Unsound(Invalid),
    /// There is no valid start from these parameters and inputs.
    #[error("{0}")]
    Invalid(#[from] Invalid),
    /// Tunable parameters are refused; the last valid ones are in force.
    #[error("parameters refused, the last valid ones are in force again: {0}")]
    Parameters(Invalid),
}

/// Everything that an exporter's or runner's user can meet.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A description (TOML) that can't be used.
    #[error("{}: {reason}", file.display())]
    Description {
        /// The file.
        file: PathBuf,
        /// Key, value and what is allowed.
        reason: String,
    },
    /// A file that can't be read or written.
    #[error("{}: {source}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// An archive that isn't an FMU of version 2.0, or not a sound one.
    #[error("{}: {reason}", file.display())]
    Archive {
        /// The file.
        file: PathBuf,
        /// The problem.
        reason: String,
    },
    /// A loop that can't be closed.
    #[error("{}: {reason}", file.display())]
    Loop {
        /// The file.
        file: PathBuf,
        /// The problem.
        reason: String,
    },
    /// A unit that answered with an error while a loop ran.
    #[error("{unit}: {function} failed at t = {} s: {message}", Number(*.time))]
    Unit {
        /// The unit in the loop.
        unit: String,
        /// The function that failed.
        function: &'static str,
        /// Time, s.
        time: f64,
        /// Its log message.
        message: String,
    },
    /// An argument of a command that can't be used with its others.
    #[error("{0}")]
    Argument(Invalid),
    /// A name that isn't there.
    #[error("there is no {what} named `{name}`{}; {}", present(name), near::choice(name, known, all))]
    Unknown {
        /// Kind of thing that was looked for.
        what: &'static str,
        /// The name asked for.
        name: String,
        /// The names that exist.
        known: Vec<String>,
        /// Command that shows all of them, for a message that lists some; empty if there is none.
        all: &'static str,
    },
    /// The source folder, where something is to be taken from it.
    #[error("{}: {reason}", file.display())]
    Source {
        /// The file in it.
        file: PathBuf,
        /// The problem.
        reason: String,
    },
    /// The shared library that goes into the FMUs is missing or doesn't answer.
    #[error("{0}")]
    Library(String),
}

/// Addition to the message where a name is that of a file or a folder.
fn present(name: &str) -> &'static str {
    let is_path = name.contains(['.', '/']) && Path::new(name).exists();
    if is_path { " (the file or folder of this name is not one)" } else { "" }
}

impl Error {
    /// A name that isn't among those that exist; `all` is what shows all of these.
    pub fn unknown(
        what: &'static str,
        name: &str,
        known: impl IntoIterator<Item = impl Into<String>>,
        all: &'static str,
    ) -> Self {
        Error::Unknown { what, name: name.to_owned(), known: known.into_iter().map(Into::into).collect(), all }
    }

    /// Names the file in an error of the file system.
    pub fn file(file: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Error {
        let file = file.into();
        move |source| Error::File { file, source }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_messages_are_short_and_are_the_same_number_when_read_back() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (0.1, "0.1"),
            (-1234.5, "-1234.5"),
            (1e-4, "0.0001"),
            (1e-300, "1e-300"),
            (-2.5e-5, "-2.5e-5"),
            (999_999_999.0, "999999999"),
            (1e9, "1e9"),
            (f64::MAX, "1.7976931348623157e308"),
            (5e-324, "5e-324"),
            (f64::NAN, "NaN"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(Number(value).to_string(), text);
        }
        for value in [1.0 / 3.0, 2e-5 / 3.0, 2e20 / 3.0, 123_456_789.123_456_79] {
            assert_eq!(Number(value).to_string().parse(), Ok(value));
        }
    }
}
