//! Findings about records and models, and refusals.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Judgement of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Something to know; nothing is wrong.
    Note,
    /// The model can be used with a restriction that the text names.
    Warning,
    /// The model should not be used for a design.
    NotSound,
}

/// Kind of a finding, for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)] // their names are what the documentation of findings lists
pub enum Kind {
    StepsDiffer,
    Gap,
    MissingCells,
    ShortWindow,
    LeftOut,
    WrongCells,
    ShortRecord,
    InputAtLimit,
    Quantised,
    WrongRow,
    Delay,
    Unseen,
    Kinematics,
    EntryAtZero,
    ColouredResiduals,
    IllConditioned,
    UnstablePole,
    HeldOutFit,
    HeldOutStill,
    NothingHeldOut,
    FixedInput,
    Order,
}

/// A finding with its text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Finding {
    /// Its subject.
    pub kind: Kind,
    /// Verdict.
    pub verdict: Verdict,
    /// The finding for people.
    pub text: String,
}

impl Finding {
    pub(crate) fn note(kind: Kind, text: impl Into<String>) -> Self {
        Finding { kind, verdict: Verdict::Note, text: text.into() }
    }

    pub(crate) fn warning(kind: Kind, text: impl Into<String>) -> Self {
        Finding { kind, verdict: Verdict::Warning, text: text.into() }
    }

    pub(crate) fn not_sound(kind: Kind, text: impl Into<String>) -> Self {
        Finding { kind, verdict: Verdict::NotSound, text: text.into() }
    }
}

/// Reason for which records give no model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// A signal, a structure or an option that doesn't fit the records.
    Request,
    /// Time doesn't grow.
    Time,
    /// Too few rows for the unknowns.
    TooShort,
    /// An input never moves.
    StillInput,
    /// A measured signal never moves.
    StillState,
    /// Inputs move together.
    DependentInputs,
    /// An input is a fixed combination of the states.
    Feedback,
    /// No model follows the record.
    NoModel,
    /// No order has a continuous model: sampled too slowly.
    SampledTooSlowly,
}

/// A refusal: what is wrong, what is allowed, what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// Its cause, for programs.
    pub cause: Cause,
    /// The reason for people.
    pub text: String,
}

impl Refusal {
    pub(crate) fn new(cause: Cause, text: impl Into<String>) -> Self {
        Refusal { cause, text: text.into() }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::error::Error for Refusal {}
