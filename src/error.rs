//! Everything that can go wrong, each with what a user needs to mend it. All texts stand here.

use std::fmt;
use std::path::PathBuf;

use crate::integrator::Mode;

/// A text of a file or another tool as one line that can be shown: control characters escaped.
pub fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() { line.extend(c.escape_debug()) } else { line.push(c) }
    }
    line
}

/// A number with all its digits, and with an exponent where it would hold a row of zeros: a limit of 1e-300 reads as such.
pub fn exact(value: f64) -> String {
    let plain = value == 0.0 || !value.is_finite() || (1e-4..1e16).contains(&value.abs());
    // No sign at zero.
    if plain { format!("{}", value + 0.0) } else { format!("{value:e}") }
}

/// Why a set of parameters, a structure or a start is refused: one line a reason.
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

    /// As reasons of a part of something larger.
    pub(crate) fn within(self, part: &str) -> Self {
        Invalid { reasons: self.reasons.into_iter().map(|reason| format!("{part}: {reason}")).collect() }
    }

    /// In other words.
    pub(crate) fn told(self, tell: impl Fn(&str) -> String) -> Self {
        Invalid { reasons: self.reasons.iter().map(|reason| tell(reason)).collect() }
    }

    /// With the time at which they were found, s.
    pub(crate) fn at(self, time: f64) -> Self {
        Invalid { reasons: self.reasons.into_iter().map(|reason| format!("{reason} (at t = {time} s)")).collect() }
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

/// Why a communication step could not be finished. Time and state are as before the step.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StepError {
    /// A value grew beyond any use: the loop is unstable.
    #[error(
        "{variable} = {value:e} at t = {time} s: the simulation diverges. \
         Check the gains and the loop, or take a smaller communication step"
    )]
    Diverged {
        /// The variable.
        variable: String,
        /// Its value.
        value: f64,
        /// When, s.
        time: f64,
    },
    /// No step size meets the tolerance: the equations jump without an event, or have a pole.
    #[error(
        "no step size reaches the relative tolerance {tolerance:e} at t = {time} s (last tried {step:e} s; {variable} \
         has the largest error). The equations may be singular there"
    )]
    StepTooSmall {
        /// When, s.
        time: f64,
        /// The step that was tried last, s.
        step: f64,
        /// The tolerance asked for.
        tolerance: f64,
        /// The state with the largest error.
        variable: String,
    },
    /// The stiff method was asked for where it can't go.
    #[error(
        "a derivative of der({variable}) by states or time is no number at t = {time} s, and the stiff method needs \
         it: set integration_method to automatic or explicit"
    )]
    NoJacobian {
        /// The state whose rate it is.
        variable: String,
        /// When, s.
        time: f64,
    },
    /// The step needs more work than allowed.
    #[error(
        "{substeps} substeps reached only t = {time} s of a communication step of {step} s, with all the work that \
         work_limit allows. The system changes too fast for so long a step: take a smaller one, or a larger \
         work_limit, or, if it is stiff and integration_method is explicit, another method{}",
        followed.map_or(String::new(), |mode| mode.followed())
    )]
    TooMuchWork {
        /// How many were made.
        substeps: usize,
        /// How far they came, s.
        time: f64,
        /// The communication step, s.
        step: f64,
        /// What had to be followed, where that limited the substeps.
        followed: Option<Mode>,
    },
    /// Events follow each other without time going on.
    #[error("more than {events} events at t = {time} s: the system switches without end (Zeno behaviour)")]
    TooManyEvents {
        /// How many.
        events: usize,
        /// When, s.
        time: f64,
    },
    /// The equations don't hold where the step leads, as the system itself says.
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
        /// What the system says.
        source: std::io::Error,
    },
    /// An archive that isn't an FMU of version 2.0, or not a sound one.
    #[error("{}: {reason}", file.display())]
    Archive {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A loop that can't be closed.
    #[error("{}: {reason}", file.display())]
    Loop {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A unit that answered with an error while a loop ran.
    #[error("{unit}: {function} failed at t = {time} s: {message}")]
    Unit {
        /// The unit in the loop.
        unit: String,
        /// The function that failed.
        function: &'static str,
        /// When, s.
        time: f64,
        /// What it logged.
        message: String,
    },
    /// A name that isn't there.
    #[error("there is no {what} named `{name}`; there are: {known}")]
    Unknown {
        /// What was looked for.
        what: &'static str,
        /// The name asked for.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// The source folder, where something is to be taken from it.
    #[error("{}: {reason}", file.display())]
    Source {
        /// The file in it.
        file: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The shared library that goes into the FMUs is missing or doesn't answer.
    #[error("{0}")]
    Library(String),
}

impl Error {
    /// Names the file in an error of the file system.
    pub fn file(file: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Error {
        let file = file.into();
        move |source| Error::File { file, source }
    }
}
