//! An instance in co-simulation whose master handles events at communication points: Event Mode and Step Mode of FMI 3.0.

use super::Execution;
use crate::error::StepError;
use crate::system::{Handle, Section};

impl Execution {
    /// Leaves events at the end of a communication step to the master from now on.
    pub fn leave_events(&mut self) {
        self.leaves_events = true;
    }

    /// Goes on in co-simulation with events from the values that were just initialised: the first one is the start, which inputs that are
    /// set in it begin anew.
    ///
    /// # Errors
    /// When the equations don't hold there; nothing is changed.
    pub fn begin_event_mode(&mut self) -> Result<(), StepError> {
        self.check()?;
        self.begin_event();
        Ok(())
    }

    /// Goes on with a step behind an event: the inputs in force are those that were set.
    pub fn begin_step_mode(&mut self) {
        let (variables, controls) = (self.model.variables(), self.model.controls());
        let (inputs, memory) = (variables.reals(Section::Input), variables.reals(Section::Memory).start);
        // Those before the start are none that inputs could come from.
        let previous = controls.previous_inputs.filter(|_| !self.values().get(controls.started));
        for copy in [previous, controls.last_inputs].into_iter().flatten() {
            self.block.reals.copy_within(inputs.clone(), memory + copy.span().range().start);
        }
        let (started, slopes) = (controls.started, controls.slopes);
        let mut point = self.block.point(&self.model, &mut self.log);
        point.put(started, true);
        if let Some(slopes) = slopes {
            point[slopes].fill(0.0);
        }
        self.keep_integer_inputs();
        self.find_indicators();
    }

    /// True if a time event is due at the communication point where the instance is.
    pub fn event_due(&self) -> bool {
        self.next_time_event().is_some_and(|event| event <= self.time() + self.event_slack())
    }

    /// The next event that is known in advance, s.
    pub fn next_time_event(&self) -> Option<f64> {
        Some(self.model.equations().next_time_event(&self.values())).filter(|time| time.is_finite())
    }

    /// The time event that ends a step from a point early, s: one that lies within it.
    pub fn event_within(&self, point: f64, step: f64) -> Option<f64> {
        let slack = self.settings().event_slack * step;
        self.next_time_event().filter(|&event| event > point + slack && event < point + step - slack)
    }

    /// A time event belongs to the present point if it lies at most this far behind it, s: masters add up their steps.
    pub(super) fn event_slack(&self) -> f64 {
        if self.integrates { self.settings().event_slack * self.last_step() } else { 0.0 }
    }
}
