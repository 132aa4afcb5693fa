//! One communication step: which a master may ask for, and how it is answered.

use crate::error::{Number, StepError};
use crate::execution::OnStepFailure;
use crate::system::Section;

use super::calls::{Answer, Function, Phase, Refused, Standard};
use super::instance::{Instance, hand_out};
use super::logger::{EVENTS, WARNING};
use super::types::Status;

/// Largest distance, in parts of the step, of a master's communication point from the instance's time: a clock of
/// single precision, or of whole microseconds, is no closer.
pub(super) const COMMUNICATION_POINT_SLACK: f64 = 1e-3;
/// Distance up to which, in parts of the step, it is the rounding of a master that adds up its steps, which needs no
/// message.
const COMMUNICATION_POINT_ROUNDING: f64 = 1e-6;

impl Instance {
    /// fmi2DoStep
    ///
    /// # Errors
    /// When the step is refused (nothing changed), or can't be finished (values as before, and the instance in error).
    pub fn do_step(&mut self, point: f64, step: f64) -> Answer<Status> {
        self.check_step(point, step)?;
        self.take_step(point, step)
    }

    /// Takes steps to these times, the first of which is the present one, and writes the values of references behind each, one
    /// row a step. Returns the number of steps that were taken: all, or those before what [`Instance::do_step`] refuses, or can't
    /// finish.
    pub fn do_steps(&mut self, times: &[f64], references: &[u32], rows: &mut [f64]) -> usize {
        let [first, second, ..] = *times else { return 0 };
        let rises = times.windows(2).all(|two| two[1] > two[0]) && times[times.len() - 1].is_finite();
        let slack = point_slack(COMMUNICATION_POINT_SLACK, second - first, first);
        let stops = self.stop_time.is_some_and(|stop| times[times.len() - 1] > stop + slack);
        if !rises || stops || self.check_step(first, second - first).is_err() {
            return 0;
        }
        let rates = self.execution.model().variables().reals(Section::Derivative);
        let with_rates = references.iter().any(|&reference| rates.contains(&(reference as usize)));
        let taken = self.execution.steps(times, with_rates, &mut |k, reals, integers| {
            let row = &mut rows[(k - 1) * references.len()..][..references.len()];
            for (value, &reference) in row.iter_mut().zip(references) {
                let place = reference as usize;
                // Integers have references behind the reals; what has none is no number, and noticed as such.
                let integer = || integers.get(place - reals.len()).map_or(f64::NAN, |&integer| f64::from(integer));
                *value = reals.get(place).copied().unwrap_or_else(integer);
            }
        });
        if taken > 0 {
            self.log_method();
        }
        taken
    }

    /// A step that was checked, or a part of one.
    pub(super) fn take_step(&mut self, point: f64, step: f64) -> Answer<Status> {
        self.log_adopted(point, step);
        match self.execution.step(point, step) {
            Ok(taken_over) => {
                self.log_taken_over(taken_over, point);
                self.log_method();
                Ok(Status::Ok)
            }
            Err(error) => self.failed_step(error, point, step),
        }
    }

    pub(super) fn log_taken_over(&mut self, taken_over: bool, time: f64) {
        if taken_over && self.logger.is_enabled(EVENTS) {
            self.logger.log(Status::Ok, EVENTS, &format!("tunable parameters taken over at t = {} s", Number(time)));
        }
    }

    /// Logs the integration method, if it has changed and the host wants to know.
    fn log_method(&mut self) {
        if let Some(chosen) = self.execution.method_news().filter(|_| self.logger.is_enabled(EVENTS)) {
            self.logger.log(Status::Ok, EVENTS, &chosen.to_string());
        }
    }

    fn failed_step(&mut self, error: StepError, point: f64, step: f64) -> Answer<Status> {
        let name = self.called(Function::DoStep);
        let reason = format!("{name} from t = {} s by {} s: {error}", Number(point), Number(step));
        match error {
            // As with any refused argument, the instance can go on.
            StepError::Parameters(_) => Err(Refused(reason)),
            // A smaller step would not start either, so this is never discarded.
            StepError::Invalid(_) => {
                self.phase = Phase::Error;
                Err(Refused(reason))
            }
            _ if self.execution.on_step_failure() == OnStepFailure::Discard => {
                // In FMI 3.0 it can go on as if the step had not been asked for.
                self.phase = if self.of.0 == Standard::Fmi3 { Phase::StepComplete } else { Phase::StepFailed };
                Ok(self.discard(&reason))
            }
            _ => {
                self.phase = Phase::Error;
                Err(Refused(reason))
            }
        }
    }

    /// Logs, once, that a communication point is adopted which isn't where the last step ended.
    fn log_adopted(&mut self, point: f64, step: f64) {
        let time = self.execution.time();
        if self.points_differ || (point - time).abs() <= point_slack(COMMUNICATION_POINT_ROUNDING, step, time) {
            return;
        }
        self.points_differ = true;
        let (name, point, time) = (self.called(Function::DoStep), Number(point), Number(time));
        let text = format!(
            "{name}: currentCommunicationPoint = {point} s, but the instance is at t = {time} s. A given point \
             that differs by at most 0.001 of the step is used, here and in later steps"
        );
        self.logger.log(Status::Warning, WARNING, &text);
    }

    pub(super) fn check_step(&self, point: f64, step: f64) -> Answer {
        let name = self.called(Function::DoStep);
        if !(step.is_finite() && step > 0.0) {
            return Err(Refused(format!(
                "{name}: communicationStepSize = {} must be finite and above 0",
                Number(step)
            )));
        }
        let time = self.execution.time();
        let slack = point_slack(COMMUNICATION_POINT_SLACK, step, time);
        if !(point.is_finite() && (point - time).abs() <= slack) {
            return Err(Refused(format!(
                "{name}: currentCommunicationPoint = {} s, but the instance is at t = {} s: give that point, to \
                 within 0.001 of communicationStepSize = {} s",
                Number(point),
                Number(time),
                Number(step)
            )));
        }
        let last = time - self.execution.last_step();
        if last < time && point < last - point_slack(0.0, step, time) {
            return Err(Refused(format!(
                "{name}: currentCommunicationPoint = {} s is before that of the last step, {} s; the instance is at \
                 t = {} s: give that point",
                Number(point),
                Number(last),
                Number(time)
            )));
        }
        if point + step <= point {
            return Err(Refused(format!(
                "{name}: communicationStepSize = {} is too small to change t = {} s",
                Number(step),
                Number(point)
            )));
        }
        match self.stop_time {
            Some(stop) if point + step > stop + slack => Err(Refused(format!(
                "{name}: {} s + {} s goes beyond stopTime = {} s, which {} was given",
                Number(point),
                Number(step),
                Number(stop),
                self.called(Function::SetupExperiment)
            ))),
            _ => Ok(()),
        }
    }

    /// Time up to which values are valid, s; fmi2Discard where it is no number.
    pub fn last_successful_time(&mut self, time: &mut f64) -> Status {
        let broken = hand_out(std::iter::once(self.execution.time()), std::slice::from_mut(time));
        broken.map_or(Status::Ok, |(_, value)| {
            self.not_finite(Function::GetRealStatus, "the last successful time", value)
        })
    }
}

/// Largest distance of a communication point from a time: a part of the step, plus the rounding of the time.
fn point_slack(part: f64, step: f64, time: f64) -> f64 {
    part * step + 4.0 * f64::EPSILON * time.abs()
}
