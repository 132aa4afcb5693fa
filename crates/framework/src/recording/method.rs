//! Methods of a system that are recorded, and the content of a recording.

use super::tape::{Node, Tape};

/// Recorded methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Values that follow from parameters, and the relations between parameters.
    Relate,
    /// Signals and derivatives.
    Evaluate,
    /// The start: states and discrete values, then signals and derivatives.
    Start,
    /// The reaction to a change of tunable parameters.
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

/// A method's effect on the values of a block.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// The operations.
    pub tape: Tape,
    /// New real values of the block.
    pub reals: Vec<Node>,
    /// New integers of the block.
    pub integers: Vec<Node>,
    /// Further results: event indicators, the time of the next event.
    pub results: Vec<Node>,
}
