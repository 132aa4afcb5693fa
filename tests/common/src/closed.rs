//! Loops of this package's descriptions as a single FMU, with any controller.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use toml::{Table, Value};

use crate::description;
use crate::models::Run;

/// Parts of a loop.
#[derive(Debug, Clone, Default)]
pub struct Closed {
    parts: Vec<Value>,
    connections: Vec<Value>,
}

impl Closed {
    /// Nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a part with a description of this package, and further lines of its `[start]`.
    pub fn part(self, name: &str, of: &str, start: &str) -> Self {
        self.described(name, &description(of), start)
    }

    /// Adds a part with the text of a description.
    pub fn described(mut self, name: &str, text: &str, start: &str) -> Self {
        let given: Table = text.parse().unwrap();
        let mut part = Table::new();
        part.insert("name".to_owned(), name.into());
        for key in ["model", "structure"] {
            part.extend(given.get(key).map(|value| (key.to_owned(), value.clone())));
        }
        let mut all = given.get("start").and_then(Value::as_table).cloned().unwrap_or_default();
        all.extend(start.parse::<Table>().unwrap());
        part.insert("start".to_owned(), all.into());
        self.parts.push(part.into());
        self
    }

    /// Adds connections of so many elements.
    pub fn connected(mut self, from: &str, to: &str, count: usize) -> Self {
        for i in 1..=count {
            self.connections.push(vec![format!("{from}[{i}]"), format!("{to}[{i}]")].into());
        }
        self
    }

    /// Adds a connection.
    pub fn joined(mut self, from: &str, to: &str) -> Self {
        self.connections.push(vec![from.to_owned(), to.to_owned()].into());
        self
    }

    /// Initialised, within a tolerance.
    pub fn started(self, tolerance: f64) -> Run {
        let mut run = self.prepared(tolerance);
        run.0.initialise().unwrap();
        run
    }

    /// Before its initialisation.
    pub fn prepared(self, tolerance: f64) -> Run {
        let mut structure = Table::new();
        structure.insert("parts".to_owned(), self.parts.into());
        structure.insert("connections".to_owned(), self.connections.into());
        let mut whole: Table = "name = 'Test'\nmodel = 'composite'\ndescription = ''".parse().unwrap();
        whole.insert("structure".to_owned(), structure.into());
        let start = Table::from_iter([("relative_tolerance".to_owned(), tolerance.into())]);
        whole.insert("start".to_owned(), start.into());
        let description = Description::read(&whole.to_string()).unwrap();
        Run(Execution::new(Model::from_description(description, REGISTRY).unwrap()))
    }
}

/// Metrics of a signal: its rms from a time on, its largest magnitude from then on, and that of the whole run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Metric {
    pub rms: f64,
    pub late: f64,
    pub max: f64,
}

/// Metrics of signals over a run; each signal is the sum of these variables, which a - takes away.
pub fn metrics(run: &mut Run, signals: &[&str], [until, from, step]: [f64; 3]) -> Vec<Metric> {
    let mut metrics = vec![Metric::default(); signals.len()];
    let mut count = 0.0;
    let value = |run: &Run, signal: &str| {
        let parts = signal.split_whitespace();
        parts.map(|part| part.strip_prefix('-').map_or_else(|| run.get(part), |taken| -run.get(taken))).sum::<f64>()
    };
    for k in 0..=(until / step).round() as usize {
        if k > 0 {
            run.step(step);
        }
        let is_late = k as f64 * step >= from - 1e-9;
        count += f64::from(u8::from(is_late));
        for (metric, signal) in metrics.iter_mut().zip(signals) {
            let value = value(run, signal).abs();
            metric.max = metric.max.max(value);
            if is_late {
                metric.late = metric.late.max(value);
                metric.rms += value * value;
            }
        }
    }
    metrics.iter_mut().for_each(|metric| metric.rms = (metric.rms / count).sqrt());
    metrics
}

/// Asserts that a number is known to be another, within a part of that.
#[track_caller]
pub fn near(what: &str, found: f64, known: f64, part: f64) {
    assert!((found - known).abs() <= part * known.abs(), "{what}: {found}, not {known}");
}
