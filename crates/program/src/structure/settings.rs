//! Settings of a run.

use std::fmt;
use std::str::FromStr;

/// Order of stepping: when components see each other's new outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// One component after the other: each takes the latest outputs, then steps.
    GaussSeidel,
    /// All components take the outputs of the last communication point, then all step.
    Jacobi,
    /// One component after the other, as for Gauss-Seidel; then those of FMI 3.0 enter Event Mode, where they sample,
    /// outputs follow inputs immediately, and values are exchanged until they no longer change.
    EventMode,
}

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Order::GaussSeidel => "gauss-seidel",
            Order::Jacobi => "jacobi",
            Order::EventMode => "event-mode",
        })
    }
}

impl FromStr for Order {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "gauss-seidel" => Ok(Order::GaussSeidel),
            "jacobi" => Ok(Order::Jacobi),
            "event-mode" => Ok(Order::EventMode),
            _ => Err(format!("order = {text}: must be gauss-seidel, jacobi or event-mode")),
        }
    }
}

/// Settings of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Start time, s.
    pub start_time: f64,
    /// Stop time, s.
    pub stop_time: f64,
    /// Communication step, s.
    pub step: f64,
}

impl Settings {
    /// Number of communication steps: full ones, and a shorter last one if they don't fill the time.
    pub fn steps(self) -> usize {
        ((self.stop_time - self.start_time) / self.step - 1e-6).ceil().max(0.0) as usize
    }

    /// The communication steps, from one time to the next.
    pub(crate) fn points(self) -> impl Iterator<Item = (f64, f64)> {
        (0..self.steps()).map(move |k| (self.time(k), self.time(k + 1)))
    }

    /// The time of a communication point, by its number from the start.
    pub(crate) fn time(self, k: usize) -> f64 {
        if k == self.steps() { self.stop_time } else { self.start_time + k as f64 * self.step }
    }
}
