//! A system's methods, run over the scalar that records.

use super::{DynSystem, Equations, MessageLog, Offsets, Point};
use crate::recording::{Leaf, Method, Operation, Recorded, Recording, on_tape};

/// A system's values: how many there are, and where sections begin.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Number of real values.
    pub reals: usize,
    /// Number of integers.
    pub integers: usize,
    /// Begin of each section.
    pub offsets: Offsets,
    /// Number of event indicators.
    pub indicators: usize,
}

/// Operations of a recording for each value of its block, about.
const OPERATIONS: usize = 4;

impl Recording {
    /// Records a method.
    pub fn of(system: &dyn DynSystem, method: Method, layout: &Layout) -> Self {
        Recording::with(layout, &|_| None, |t, v| record(system, method, layout, t, v))
    }

    /// Records a method where some values of the block are known: leaves that are constants.
    pub fn of_known(
        system: &dyn DynSystem,
        method: Method,
        layout: &Layout,
        known: &dyn Fn(Leaf) -> Option<f64>,
    ) -> Self {
        Recording::with(layout, known, |t, v| record(system, method, layout, t, v))
    }

    /// Records what a function does with the values of a block, of which some may be known, and its results.
    pub fn with(
        layout: &Layout,
        known: &dyn Fn(Leaf) -> Option<f64>,
        record: impl FnOnce(Recorded, &mut Point<Recorded>) -> Vec<Recorded>,
    ) -> Self {
        let given = |place: Leaf| known(place).map_or_else(|| leaf(place), Recorded::from);
        let ((reals, integers, results), tape) = on_tape(OPERATIONS * (layout.reals + layout.integers), || {
            let mut reals: Vec<_> = (0..layout.reals as u32).map(|place| given(Leaf::Real(place))).collect();
            let mut integers: Vec<_> = (0..layout.integers as u32).map(|place| given(Leaf::Integer(place))).collect();
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
    let equations: &dyn Equations<Recorded> = system;
    let mut results = Vec::new();
    match method {
        Method::Relate => equations.relate(v),
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
