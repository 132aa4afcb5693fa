//! Functions that lead from one phase to another, and on in time.

use std::ptr::{null, null_mut};

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::system::Causality;
use adaptive_fmu_library::fmi2_functions::*;

use super::dice::Dice;
use super::{Arguments, DISCARD, ERROR, OK, Sequence};

impl Sequence<'_> {
    pub(super) fn progress(&mut self, name: &'static str, dice: &mut Dice) {
        match name {
            "fmi2SetDebugLogging" => self.set_debug_logging(dice),
            "fmi2SetupExperiment" => self.setup_experiment(dice),
            "fmi2DoStep" => self.do_step(dice),
            "fmi2SetTime" => self.set_time(dice),
            "fmi2NewDiscreteStates" => self.new_discrete_states(dice),
            "fmi2CompletedIntegratorStep" => self.completed_integrator_step(dice),
            _ => self.change_of_phase(name),
        }
    }

    fn change_of_phase(&mut self, name: &'static str) {
        let status = self.call(name, Arguments::Right, String::new(), |c| unsafe {
            match name {
                "fmi2EnterInitializationMode" => fmi2EnterInitializationMode(c),
                "fmi2ExitInitializationMode" => fmi2ExitInitializationMode(c),
                "fmi2Terminate" => fmi2Terminate(c),
                "fmi2Reset" => fmi2Reset(c),
                "fmi2EnterEventMode" => fmi2EnterEventMode(c),
                "fmi2EnterContinuousTimeMode" => fmi2EnterContinuousTimeMode(c),
                _ => fmi2CancelStep(c),
            }
        });
        if let (Some(status), "fmi2EnterContinuousTimeMode") = (status, name) {
            self.expect((status == ERROR) == self.now.waiting, "time goes on only with parameters that are in force");
        }
        if status != Some(OK) {
            return;
        }
        match name {
            "fmi2EnterInitializationMode" => self.now.phase = 'M',
            "fmi2ExitInitializationMode" => self.now.phase = if self.subject.kind == CO_SIMULATION { 'S' } else { 'V' },
            "fmi2Terminate" => self.now.phase = 'T',
            "fmi2EnterEventMode" => self.now.phase = 'V',
            "fmi2EnterContinuousTimeMode" => self.now.phase = 'C',
            _ => {
                self.expect(self.now.fingerprint == self.start.fingerprint, "an instance that was reset is a new one");
                self.now = self.start.clone();
            }
        }
    }

    fn set_debug_logging(&mut self, dice: &mut Dice) {
        let known = [c"logStatusError", c"logAll", c"logEvents", c"logStatusDiscard", c"logStatusWarning"];
        let mut names: Vec<StringPointer> = (0..dice.below(3)).map(|_| dice.pick(&known).as_ptr()).collect();
        let mut right = true;
        if dice.one_in(3) {
            names.push(dice.pick(&[c"".as_ptr(), c"log 100%\n".as_ptr(), c"\xff".as_ptr(), null()]));
            right = false;
        }
        let on = dice.pick(&[TRUE, FALSE, 2]);
        let list = if dice.one_in(10) { null() } else { names.as_ptr() };
        right &= names.is_empty() || !list.is_null();
        self.call("fmi2SetDebugLogging", Arguments::of(right), format!("{} categories", names.len()), |c| unsafe {
            fmi2SetDebugLogging(c, on, names.len(), list)
        });
    }

    fn setup_experiment(&mut self, dice: &mut Dice) {
        let mut odd = |usual: f64| if dice.one_in(16) { dice.not_finite() } else { usual };
        let (mut start, mut length, mut tolerance) = (odd(0.0), odd(10.0), odd(1e-5));
        if dice.one_in(6) {
            start += dice.pick(&[1.5, -3.0, 1e9, 1e300]);
        }
        length *= dice.pick(&[1.0, 1e-4, 0.0, -1.0]);
        tolerance *= dice.pick(&[1.0, 1e-320, 1e10, 0.0, -1.0]);
        let [stops, tolerates] = [dice.one_in(3), dice.one_in(3)].map(Boolean::from);
        let stop = start + length;
        let right_stop = stops == FALSE || stop.is_finite() && stop >= start;
        let right_tolerance = tolerates == FALSE || tolerance.is_finite() && tolerance > 0.0;
        let right = Arguments::of(start.is_finite() && right_stop && right_tolerance);
        let text = format!("{tolerates}, {tolerance}, {start}, {stops}, {stop}");
        let status = self.call("fmi2SetupExperiment", right, text, |c| unsafe {
            fmi2SetupExperiment(c, tolerates, tolerance, start, stops, stop)
        });
        if status.is_some() {
            (self.now.time, self.now.stop) = (start, (stops == TRUE).then_some(stop));
        }
    }

    fn do_step(&mut self, dice: &mut Dice) {
        let t = self.now.time;
        let mut step = dice.step();
        if dice.one_in(16) {
            step = dice.pick(&[0.0, -0.0, -step, f64::NAN, f64::INFINITY, f64::NEG_INFINITY]);
        }
        let mut point = t;
        if dice.one_in(12) {
            point = dice.pick(&[
                t + step,
                t - step,
                t + 9e-4 * step,
                t - 9e-4 * step,
                t + 1.0,
                -1e300,
                f64::NAN,
                f64::INFINITY,
            ]);
        }
        let (end, rounding) = (point + step, 1e-3 * step + 1e-9 * t.abs());
        let late = self.now.stop.is_some_and(|stop| end > stop + rounding);
        let near = self.now.stop.is_some_and(|stop| end > stop) || point != t;
        let arguments = match () {
            () if !(step.is_finite() && step > 0.0 && point.is_finite() && end > point) || late => Arguments::Wrong,
            () if (point - t).abs() > rounding => Arguments::Wrong,
            () if near => Arguments::Unclear,
            () => Arguments::Right,
        };
        let before = self.now.fingerprint.clone();
        let status = self.call("fmi2DoStep", arguments, format!("{point}, {step}"), |c| unsafe {
            fmi2DoStep(c, point, step, FALSE)
        });
        match status {
            Some(OK) => (self.now.time, self.now.waiting) = (end, false),
            Some(DISCARD) => {
                self.now.phase = 'F';
                self.expect(self.unit.get_integer("on_step_failure") == 2, "a step is discarded where that was chosen");
                self.expect_as_before(&before, |_| true);
            }
            Some(_) => {
                self.note_whether_it_failed_for_good();
                // Parameters that were refused are the last valid ones again.
                let refused = self.now.phase == 'S';
                self.expect_as_before(&before, |entry| !refused || entry.causality != Causality::Parameter);
            }
            None => {}
        }
    }

    fn set_time(&mut self, dice: &mut Dice) {
        let time = match dice.below(16) {
            0 => dice.not_finite(),
            1 => dice.pick(&[self.now.time, 0.0, -1.0, 1e9, f64::MAX, 5e-324]),
            2 => self.now.time - dice.step(),
            _ => self.now.time + dice.step(),
        };
        let arguments = Arguments::of(time.is_finite());
        let status = self.call("fmi2SetTime", arguments, format!("{time}"), |c| unsafe { fmi2SetTime(c, time) });
        if status.is_some() {
            self.now.time = time;
        }
    }

    fn new_discrete_states(&mut self, dice: &mut Dice) {
        let mut info = EventInfo {
            new_discrete_states_needed: 77,
            terminate_simulation: 77,
            nominals_changed: 77,
            values_changed: 77,
            next_event_time_defined: 77,
            next_event_time: 0.0,
        };
        let nowhere = dice.one_in(20);
        let text = format!("NULL: {nowhere}");
        let status = self.call("fmi2NewDiscreteStates", Arguments::of(!nowhere), text, |c| unsafe {
            fmi2NewDiscreteStates(c, if nowhere { null_mut() } else { &mut info })
        });
        if status.is_some() {
            // Either they are in force now, or those that were are again.
            self.now.waiting = false;
            self.note_whether_it_failed_for_good();
        }
        if status == Some(OK) {
            let flags = [info.new_discrete_states_needed, info.values_changed, info.next_event_time_defined];
            self.expect(flags.iter().all(|flag| [TRUE, FALSE].contains(flag)), "what an event changed is told");
            self.expect(info.next_event_time.is_finite(), "the next event's time is a number");
        }
    }

    fn completed_integrator_step(&mut self, dice: &mut Dice) {
        let (mut event, mut end) = (77, 77);
        let nowhere = dice.below(40);
        let text = format!("NULL: {}", nowhere > 37);
        let status = self.call("fmi2CompletedIntegratorStep", Arguments::of(nowhere < 38), text, |c| unsafe {
            let [event, end] =
                [(38, &raw mut event), (39, &raw mut end)].map(|(k, p)| if k == nowhere { null_mut() } else { p });
            fmi2CompletedIntegratorStep(c, TRUE, event, end)
        });
        match status {
            Some(OK) => {
                self.expect((event == TRUE || event == FALSE) && end == FALSE, "whether there is an event is told")
            }
            Some(_) => self.note_whether_it_failed_for_good(),
            None => {}
        }
    }
}
