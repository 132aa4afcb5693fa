//! Several communication steps in one go, for a master that asks for values at many times and sets none.

use super::Execution;
use crate::error::StepError;
use crate::integrator::{IntegrationMethod, Problem, SPELL, Workspace};

/// Part of a step by which another in the same go may differ.
const SAME_LENGTH: f64 = 1e-6;

/// Receives the values at a communication point: its number, reals, integers.
type Give<'a> = dyn FnMut(usize, &[f64], &[i32]) + 'a;

impl Execution {
    /// Takes the communication steps from the first of these times to the last, as [`Execution::step`] does one by one, but
    /// substeps don't end at each of them: values there are the integration method's interpolation, as accurate as its
    /// substeps. Events of time are handled at the same communication points.
    ///
    /// `give` gets the values at each of the times but the first, rates only if they are asked for. Returns the number of
    /// steps that were taken; what isn't taken is left to [`Execution::step`]: what it refuses or can't finish, and a first
    /// step after parameters or inputs were set. A go ends after some 30 ms of work, and where a step has another length.
    pub fn steps(&mut self, times: &[f64], with_rates: bool, give: &mut Give) -> usize {
        let [first, second, ..] = *times else { return 0 };
        let step = second - first;
        let is_other =
            |two: &[f64]| (two[1] - two[0] - step).abs() > SAME_LENGTH * step + 4.0 * f64::EPSILON * two[1].abs();
        let times = &times[..=times.windows(2).position(is_other).unwrap_or(times.len() - 1)];
        let (mut taken, mut work) = (0, 0.0);
        while taken + 1 < times.len() && work < SPELL && self.goes_on_by_itself() {
            let further = self.working(|execution, workspace| {
                let give = &mut |k, reals: &[f64], integers: &[i32]| give(taken + k, reals, integers);
                execution.steps_with(workspace, &times[taken..], with_rates, give)
            });
            let Some((further, its_work)) = further else { break };
            (taken, work) = (taken + further, work + its_work);
        }
        taken
    }

    /// True if the next step depends on nothing but the values at the end of the last.
    fn goes_on_by_itself(&self) -> bool {
        let controls = self.model.controls();
        self.inputs_rest()
            && self.integrates
            && !self.leaves_events
            && self.values().get(controls.started)
            && !self.values().get(controls.parameters_set)
            && self.model.ends_aside()
            && self.model.system().own_step().is_none()
            && self.settings().method != IntegrationMethod::Fixed
    }

    fn steps_with(
        &mut self,
        workspace: &mut Workspace,
        times: &[f64],
        with_rates: bool,
        give: &mut Give,
    ) -> Option<(usize, f64)> {
        workspace.keep(&self.block.reals, &self.block.integers);
        let waiting = self.log.len();
        self.set_time(times[0]);
        let taken = self.try_steps(workspace, times, with_rates, give).ok().filter(|&taken| taken > 0);
        if taken.is_none() {
            workspace.bring_back(&mut self.block.reals, &mut self.block.integers);
            self.log.truncate(waiting);
        }
        taken.map(|taken| (taken, workspace.driver.work()))
    }

    fn try_steps(
        &mut self,
        workspace: &mut Workspace,
        times: &[f64],
        with_rates: bool,
        give: &mut Give,
    ) -> Result<usize, StepError> {
        let (settings, pace) = (self.settings(), self.model.controls().pace);
        let (time, last_step) = (self.model.controls().time, self.model.controls().last_step);
        let mut next = pace.read(&self.values());
        self.recall_indicators(workspace);
        let mut at_point = |problem: &mut Problem, k: usize| {
            let (t, step) = (times[k], times[k] - times[k - 1]);
            if with_rates {
                problem.evaluate(t);
            }
            problem.point()[time] = t;
            problem.check(t).map_err(StepError::Unsound)?;
            problem.check_values(t, settings.divergence_limit)?;
            problem.point()[last_step] = step;
            problem.step_completed(t, step);
            give(k, problem.reals, problem.integers);
            Ok(())
        };
        let driver = &mut workspace.driver;
        let reached = driver.advance_through(&mut self.problem(), times, &settings, &mut next, &mut at_point)?;
        if reached == 0 {
            return Ok(0);
        }
        self.keep_indicators(workspace);
        at_point(&mut self.problem(), reached)?;
        self.check_next_event(times[reached])?;
        pace.write(next, &mut self.point());
        Ok(reached)
    }
}
