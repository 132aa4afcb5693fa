//! What of a system is recorded, and what a recording holds.

use super::tape::{Node, Tape};

/// What is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// What follows from parameters, and the relations that they keep.
    Relate,
    /// Signals and derivatives.
    Evaluate,
    /// The start: states and discrete values, then signals and derivatives.
    Start,
    /// What happens when tunable parameters have changed.
    ParametersChanged,
    /// True if the equations hold.
    Check,
    /// The time of the next event.
    NextTimeEvent,
    /// The event indicators.
    Indicators,
    /// An event.
    Event,
    /// The end of a communication step.
    StepCompleted,
}

impl Method {
    /// Its name in [`System`](crate::system::System); what evaluates is `outputs` with `derivatives`.
    pub fn name(self) -> &'static str {
        match self {
            Method::Relate => "relate",
            Method::Evaluate => "outputs or derivatives",
            Method::Start => "initialise",
            Method::ParametersChanged => "parameters_changed",
            Method::Check => "check",
            Method::NextTimeEvent => "next_time_event",
            Method::Indicators => "event_indicators",
            Method::Event => "event",
            Method::StepCompleted => "step_completed",
        }
    }

    /// All of them.
    pub const ALL: [Method; 9] = [
        Method::Relate,
        Method::Evaluate,
        Method::Start,
        Method::ParametersChanged,
        Method::Check,
        Method::NextTimeEvent,
        Method::Indicators,
        Method::Event,
        Method::StepCompleted,
    ];
}

/// What a method makes of the values of a block.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// The operations.
    pub tape: Tape,
    /// What becomes of each real value of the block.
    pub reals: Vec<Node>,
    /// What becomes of each integer of the block.
    pub integers: Vec<Node>,
    /// What the method gives beside these: event indicators, the time of the next event.
    pub results: Vec<Node>,
}
