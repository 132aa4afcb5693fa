//! Error-controlled integration of a system over one communication step.
//!
//! Inputs jump between communication steps, so what is needed is a one-step method that restarts at each of
//! them at no cost, keeps no history, allocates nothing, has a number of states that is known at run time only, and
//! keeps all its memory ([`Pace`]: the substep that it would take next, and by which method) in the instance's block,
//! so that a restored instance continues bit for bit.
//!
//! The published crates were measured in that use (`benches/integrators`; Van der Pol's oscillator with an input,
//! relative and absolute tolerance 1e-6, 20 s in steps of 10 ms; medians on a shared machine, so read ratios):
//!
//! | explicit method | ns a step | allocations a step | largest error |
//! | --- | --- | --- | --- |
//! | this module, everything around it included | 170 | 0 | 3.2e-11 |
//! | differential-equations 0.7 dopri5, size fixed when compiling | 140 | 0 | 3.2e-11 |
//! | differential-equations 0.7 dopri5, size at run time | 830 | 38 | 3.2e-11 |
//! | ode_solvers 0.6 dopri5, size fixed when compiling | 190 | 3 | 3.2e-11 |
//! | ode_solvers 0.6 dopri5, size at run time | 1000 | 56 | 3.2e-11 |
//! | diffsol 0.18 tsit45 | 280 | 0 | 3.1e-11 |
//!
//! With sizes at run time, only diffsol doesn't allocate. But its solver borrows the problem permanently and isn't
//! `Send`, so an instance couldn't own it; it never resets its count of failures, and it brings 87 packages into every
//! FMU. Its implicit methods lose accuracy when restarted often (bdf: 4e-3 at 1 ms; esdirk34: more error at 1 ms than
//! at 10 ms), and saving their state through the public interface changes the run that is saved.
//!
//! A Rosenbrock method has none of that: it is a one-step method as well, solves linear equations only, so that nothing
//! can fail to converge, and its exact Jacobian comes from the recorded equations. The same oscillator, stiff
//! (mu jumps between 5000 and 4000), in steps of 10 ms:
//!
//! | method | ns a step | allocations a step | largest error |
//! | --- | --- | --- | --- |
//! | this module, stiff | 1400 | 0 | 8.3e-13 |
//! | this module, automatic | 1800 | 0 | 1.5e-11 |
//! | this module, explicit | 9600 | 0 | 1.0e-6 |
//! | diffsol 0.18 tr_bdf2 | 2500 | 0.1 | 8.0e-8 |
//! | diffsol 0.18 bdf | 2800 | 2.2 | 2.6e-9 |
//! | diffsol 0.18 esdirk34 | 3200 | 0.1 | 1.3e-7 |
//!
//! So the methods are our own; each is one file behind [`OneStepMethod`], and `methods` chooses between them. Another
//! method has no error control, for targets (`fixed`).
//!
//! The choice between both looks at the eigenvalues of that Jacobian (`stability`): what grows is followed at its rate,
//! by either method, and what is damped decides whether the explicit one pays.
//!
//! A system's own step is worth what it saves. That of L1 controllers, the closed form, meets the tolerance in force.
//! In FMPy (generic FMUs, 4 s of each loop at its default step, the best of five runs) the steps of all FMUs take 1.7
//! times as long without it (`closed_form_phase` = 1e14) in 3.3.2-case1 and 1.6 times in 7.5.3-case1, the quadrotor's,
//! 1.2 times in 3.2.1-cosine, and at most 1.08 times in ten other loops of L1 controllers. At ten times the step it
//! saves at most 6 %. Errors are alike. While estimates stay at a bound, the linear closed form is not the adaptive
//! law, and the general methods integrate. `benches/adaptation` measures single steps.

mod chosen;
mod dense;
mod dop853;
mod dormand_prince;
mod driver;
mod elimination;
mod events;
mod fixed;
mod indicators;
mod jacobian;
mod lu;
mod methods;
mod outputs;
mod own_step;
mod rosenbrock;
mod sparsity;
mod spectrum;
mod stability;
pub mod tableau;
mod watch;
mod work;
mod workspace;

pub use chosen::{Chosen, Integrates};
pub use dense::{AtPoint, Coefficients};
pub use driver::{Driver, SPELL};
pub(crate) use driver::{check_divergence, check_values};
pub(crate) use elimination::{LOST, Pattern};
pub use methods::{IntegrationMethod, MOST_EVIDENCE, Pace};
pub use sparsity::Sparsity;
pub use stability::{ExplicitLimits, Limits, Mode};
pub use work::Work;
pub use workspace::{Place, Workspace, Workspaces};

use crate::error::{Invalid, StepError};
use crate::kernel::Kernel;
use crate::system::{DynSystem, Equations, ErrorEstimate, MessageLog, Offsets, Point, Section, Values, Variables};

/// Work that one communication step may take by default, in elementary operations of about 1 ns.
pub const WORK_LIMIT: f64 = 1e9;

/// Settings of the integration of a communication step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Integration method.
    pub method: IntegrationMethod,
    /// Number of substeps in a communication step with [`IntegrationMethod::Fixed`].
    pub fixed_steps: i32,
    /// Error tolerated in each substep, relative to the larger of a state's magnitude and its nominal value.
    pub relative_tolerance: f64,
    /// Work that one communication step may take, in elementary operations.
    pub most_work: f64,
    /// Largest number of events in a row whose times can't be distinguished.
    pub max_events: usize,
    /// A value beyond this, in magnitude, is divergence.
    pub divergence_limit: f64,
    /// True if events at the end of a communication step are left to the master.
    pub leaves_end: bool,
    /// A time event is taken at the end of a communication step if it lies at most this much of the step behind
    /// it: masters add up their communication points, and rounding must not move an event by a whole step.
    pub event_slack: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            method: IntegrationMethod::Automatic,
            fixed_steps: 1,
            relative_tolerance: 1e-6,
            most_work: WORK_LIMIT,
            max_events: 10_000,
            divergence_limit: 1e12,
            leaves_end: false,
            event_slack: 1e-6,
        }
    }
}

/// Inputs that change linearly within a communication step.
#[derive(Debug, Clone, Copy)]
pub struct Ramp<'a> {
    /// Values at `time`.
    pub values: &'a [f64],
    /// Their rates.
    pub slopes: &'a [f64],
    /// Time at which the inputs have these values, s.
    pub time: f64,
}

/// The system that is integrated, with its values.
pub struct Problem<'a> {
    /// The system.
    pub system: &'a dyn DynSystem,
    /// Its variables.
    pub variables: &'a Variables,
    /// Its real values.
    pub reals: &'a mut [f64],
    /// Its integers.
    pub integers: &'a mut [i32],
    /// Change of the inputs.
    pub ramp: Ramp<'a>,
    /// True if inputs are constant (zero-order hold).
    pub constant_inputs: bool,
    /// True if inputs change within the communication step, or since the one before.
    pub moved: bool,
    /// Destination of messages.
    pub log: &'a mut MessageLog,
    /// Its compiled equations, if there are any.
    pub kernel: Option<&'a Kernel>,
}

impl std::fmt::Debug for Problem<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Problem").field("reals", &self.reals).finish_non_exhaustive()
    }
}

impl<'a> Problem<'a> {
    fn equations(&self) -> &'a dyn Equations<f64> {
        self.system
    }

    fn offsets(&self) -> &Offsets {
        self.variables.offsets()
    }

    /// Brings inputs, signals and derivatives to time t.
    pub fn evaluate(&mut self, t: f64) {
        self.follow_ramp(t);
        match self.kernel {
            Some(kernel) => kernel.evaluate(t, self.reals, self.integers),
            None => self.equations().evaluate(t, self.reals, self.integers, self.variables.offsets()),
        }
    }

    /// Brings inputs and signals to time t.
    fn evaluate_signals(&mut self, t: f64) {
        self.follow_ramp(t);
        match self.kernel {
            Some(kernel) => kernel.outputs(t, self.reals, self.integers),
            None => self.equations().outputs(t, self.reals, self.integers, self.variables.offsets()),
        }
    }

    /// Brings inputs to time t.
    #[inline]
    fn follow_ramp(&mut self, t: f64) {
        if !self.constant_inputs {
            let ramp = self.ramp;
            let inputs = &mut self.reals[self.variables.reals(Section::Input)];
            for ((input, value), slope) in inputs.iter_mut().zip(ramp.values).zip(ramp.slopes) {
                *input = value + slope * (t - ramp.time);
            }
        }
    }

    /// The continuous states.
    pub fn states(&mut self) -> &mut [f64] {
        &mut self.reals[self.variables.reals(Section::State)]
    }

    /// Their derivatives.
    pub fn rates(&self) -> &[f64] {
        &self.reals[self.variables.reals(Section::Derivative)]
    }

    fn rates_mut(&mut self) -> &mut [f64] {
        &mut self.reals[self.variables.reals(Section::Derivative)]
    }

    /// The states, to write, and their derivatives.
    fn states_and_rates(&mut self) -> (&mut [f64], &[f64]) {
        let (states, rates) = (self.variables.reals(Section::State), self.variables.reals(Section::Derivative));
        let (before, after) = self.reals.split_at_mut(rates.start);
        (&mut before[states], &after[..rates.len()])
    }

    fn values(&self) -> Values<'_, f64> {
        Values::new(self.reals, self.integers, self.offsets())
    }

    pub(crate) fn point(&mut self) -> Point<'_> {
        Point::new(self.reals, self.integers, self.variables.offsets(), self.log)
    }

    /// Checks whether the equations hold at t, with the problem evaluated there.
    pub(crate) fn check(&mut self, t: f64) -> Result<(), Invalid> {
        self.equations().check(t, &mut self.point());
        self.log.accepted().map_err(|invalid| self.variables.named_refusal(invalid).at(t))
    }

    pub(crate) fn check_values(&self, time: f64, limit: f64) -> Result<(), StepError> {
        check_values(self.variables, self.reals, time, limit)
    }

    fn next_time_event(&self) -> f64 {
        self.equations().next_time_event(&self.values())
    }

    fn event_indicators(&self, t: f64, z: &mut [f64]) {
        self.equations().event_indicators(t, &self.values(), z);
    }

    /// Has the system take note that a communication step of this length ended at t.
    pub(crate) fn step_completed(&mut self, t: f64, step: f64) {
        self.equations().step_completed(t, step, &mut self.point());
    }

    fn event(&mut self, t: f64, crossed: &[bool]) {
        self.equations().event(t, crossed, &mut self.point());
    }
}

/// Start of a substep: time, states and their derivatives.
#[derive(Debug, Clone, Default)]
pub struct Start {
    /// Time, s.
    pub time: f64,
    /// States.
    pub states: Vec<f64>,
    /// Their derivatives.
    pub rates: Vec<f64>,
}

impl Start {
    /// Takes over a problem's states and rates at time t.
    #[inline]
    fn set(&mut self, problem: &mut Problem, t: f64) {
        self.time = t;
        self.states.copy_from_slice(problem.states());
        self.rates.copy_from_slice(problem.rates());
    }
}

/// Unit of scaled errors.
#[derive(Debug, Clone, Copy)]
pub struct Tolerance<'a> {
    /// Relative tolerance.
    pub relative: f64,
    /// Magnitude of each state.
    pub nominals: &'a [f64],
}

impl Tolerance<'_> {
    /// The largest of `errors` (one a state) in units of what is tolerated, and the state that has it. Not a number
    /// where any of them isn't.
    pub fn scaled(&self, errors: impl Iterator<Item = f64>, before: &[f64], after: &[f64]) -> (f64, usize) {
        let mut worst = (0.0, 0);
        for (i, error) in errors.enumerate() {
            let magnitude = self.nominals[i].max(before[i].abs()).max(after[i].abs());
            let scaled = error.abs() / (self.relative * magnitude);
            if scaled > worst.0 || scaled.is_nan() {
                worst = (scaled, i);
            }
            if scaled.is_nan() {
                break;
            }
        }
        worst
    }
}

/// A one-step method: explicit, implicit, or a system's own.
pub trait OneStepMethod: Send {
    /// Prepares attempts from `start`, where the problem is evaluated.
    ///
    /// # Errors
    /// The state whose rate has a derivative that is no number, where the method needs that.
    fn begin(&mut self, problem: &Problem, start: &Start) -> Result<(), usize> {
        let _ = (problem, start);
        Ok(())
    }

    /// Advances the states from `start` by h and evaluates the problem there; returns the size of the error and the
    /// state that has it. The problem may be at any point; its values are overwritten.
    fn attempt(&mut self, problem: &mut Problem, start: &Start, h: f64, tolerance: Tolerance)
    -> (ErrorEstimate, usize);

    /// Right after an attempt: the error of each state, where the method knows them.
    fn errors(&self) -> &[f64] {
        &[]
    }

    /// Right after the substep h, with the problem evaluated at its end: the polynomials between its ends, one row a state. The
    /// problem may be anywhere afterwards.
    fn between(&mut self, problem: &mut Problem, start: &Start, h: f64, rows: &mut [Coefficients]) {
        dense::hermite(problem, start, h, rows);
    }
}
