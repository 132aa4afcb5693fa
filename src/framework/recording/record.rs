//! A system's methods, run over the scalar that records.

use super::node::{Recorded, on_tape};
use super::tape::{Leaf, Node, Operation, Tape};
use crate::system::{DynSystem, Happens, MessageLog, Offsets, Point};

/// What is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Signals and derivatives.
    Evaluate,
    /// The start: states and discrete values, then signals and derivatives.
    Start,
    /// What happens when tunable parameters have changed.
    ParametersChanged,
    /// Whether the equations hold.
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
    pub const ALL: [Method; 8] = [
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

/// A system's values: how many there are, and where sections begin.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Number of real values.
    pub reals: usize,
    /// Number of integers.
    pub integers: usize,
    /// Where sections begin.
    pub offsets: Offsets,
    /// Number of event indicators.
    pub indicators: usize,
}

/// What a method makes of the values of a block.
#[derive(Debug, Clone)]
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

impl Recording {
    /// Records a method.
    pub fn of(system: &dyn DynSystem, method: Method, layout: &Layout) -> Self {
        Recording::with(layout, |t, v| record(system, method, layout, t, v))
    }

    /// Records what a function does with the values of a block, and its results.
    pub fn with(layout: &Layout, record: impl FnOnce(Recorded, &mut Point<Recorded>) -> Vec<Recorded>) -> Self {
        let ((reals, integers, results), tape) = on_tape(|| {
            let mut reals: Vec<_> = (0..layout.reals as u32).map(|place| leaf(Leaf::Real(place))).collect();
            let mut integers: Vec<_> = (0..layout.integers as u32).map(|place| leaf(Leaf::Integer(place))).collect();
            let mut log = MessageLog::new();
            let t = leaf(Leaf::Time);
            let results = record(t, &mut Point::new(&mut reals, &mut integers, &layout.offsets, &mut log));
            (reals, integers, results)
        });
        let nodes = |values: Vec<Recorded>| values.into_iter().map(Recorded::node).collect();
        Recording { tape, reals: nodes(reals), integers: nodes(integers), results: nodes(results) }
    }
}

fn leaf(leaf: Leaf) -> Recorded {
    Recorded::of(Operation::Leaf(leaf))
}

fn record(
    system: &dyn DynSystem,
    method: Method,
    layout: &Layout,
    t: Recorded,
    v: &mut Point<Recorded>,
) -> Vec<Recorded> {
    let equations: &dyn Happens<Recorded> = system;
    let mut results = Vec::new();
    match method {
        Method::Evaluate => v.evaluate(equations, t),
        Method::Start => {
            equations.initialise(t, v);
            v.evaluate(equations, t);
        }
        Method::ParametersChanged => equations.parameters_changed(t, v),
        Method::Check => equations.check(t, v),
        Method::NextTimeEvent => results.push(equations.next_time_event(&v.values())),
        Method::Indicators => {
            results.resize(layout.indicators, Recorded::from(1.0));
            equations.event_indicators(t, &v.values(), &mut results);
        }
        Method::Event => {
            let crossed: Vec<_> = (0..layout.indicators as u32).map(|k| leaf(Leaf::Crossed(k)).holds()).collect();
            equations.event(t, &crossed, v);
        }
        Method::StepCompleted => equations.step_completed(t, leaf(Leaf::Step), v),
    }
    results
}
