//! Costs counted in elementary operations: the same on every machine. So a step that is refused for its work is refused
//! everywhere, and a restored instance behaves as the one that was saved.

use super::WORK_LIMIT;
use crate::system::{Section, Variables};

/// Operations of an evaluation, in addition to those for each number that it may read.
const CALL: f64 = 30.0;
/// Operations for a number that an evaluation may read.
const NUMBER: f64 = 1.0;
/// The same for a state, where only states are known.
const STATE: f64 = 20.0;
/// A column of the Jacobian in evaluations.
const COLUMN: f64 = 2.5;

/// Operations of the parts of an integration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Work {
    /// The equations once.
    pub evaluation: f64,
    /// A substep of the explicit method that is tried.
    pub explicit: f64,
    /// The same of the one of order 8.
    pub order_8: f64,
    /// A substep of the stiff method that is tried, its Jacobian apart.
    pub stiff: f64,
    /// The exact Jacobian.
    pub jacobian: f64,
    /// The eigenvalues of a Jacobian.
    pub eigenvalues: f64,
}

impl Work {
    /// Work for a system with these variables.
    pub fn of(variables: &Variables) -> Self {
        let numbers = variables.reals(Section::Derivative).end as f64;
        Work::with(variables.states() as f64, CALL + NUMBER * numbers)
    }

    /// Work for any system with this number of states: choices based on it depend on nothing else.
    pub fn of_states(states: usize) -> Self {
        let n = states as f64;
        Work::with(n, CALL + STATE * n)
    }

    fn with(n: f64, evaluation: f64) -> Self {
        Work {
            evaluation,
            explicit: 7.0 * evaluation + 50.0 * n,
            order_8: 12.0 * evaluation + 90.0 * n,
            stiff: 9.0 * evaluation + 2.0 / 3.0 * n.powi(3) + 16.0 * n.powi(2) + 80.0 * n,
            jacobian: (n + 1.0) * COLUMN * evaluation,
            eigenvalues: 20.0 * n.powi(3) + 100.0 * n,
        }
    }

    /// User documentation of a step's work, in Markdown.
    pub fn documentation(&self) -> String {
        let most = |work: f64| {
            let digits = format!("{:.1e}", WORK_LIMIT / work).parse::<f64>().unwrap_or(0.0);
            format!("{digits}")
        };
        format!(
            "## Work of a communication step\n\nA communication step of co-simulation takes as many integration steps as \
             accuracy needs, but no more than `work_limit` allows: at its start value of {WORK_LIMIT:e}, {} of the \
             explicit method or {} of the stiff one, with a Jacobian each. A step that would take more ends with an \
             error, and leaves the FMU unchanged.\n",
            most(self.explicit),
            most(self.stiff + self.jacobian)
        )
    }
}
