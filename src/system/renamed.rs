//! A system whose user has names of their own for its variables: what it says is told with them.

use num_dual::Dual64;

use super::erased::DynSystem;
use super::names::{Translation, translated};
use super::values::{Offsets, Values};
use super::{ErrorEstimate, Point, Stride};
use crate::error::Invalid;
use crate::report::DesignReport;

/// A system, and the names in its messages.
pub(super) struct Renamed {
    pub system: Box<dyn DynSystem>,
    pub translation: Translation,
}

impl Renamed {
    fn told<T>(&self, answer: Result<T, Invalid>) -> Result<T, Invalid> {
        answer.map_err(|invalid| invalid.told(|reason| translated(reason, &self.translation)))
    }

    /// Calls the system; what it logs is told with the user's names.
    fn with<T>(&self, v: &mut Point, call: impl FnOnce(&dyn DynSystem, &mut Point) -> T) -> T {
        let before = v.log.len();
        let answer = call(self.system.as_ref(), v);
        v.log[before..].iter_mut().for_each(|message| message.text = translated(&message.text, &self.translation));
        answer
    }
}

impl DynSystem for Renamed {
    fn indicators(&self) -> usize {
        self.system.indicators()
    }
    fn indicator_name(&self, indicator: usize) -> String {
        translated(&self.system.indicator_name(indicator), &self.translation)
    }
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.told(self.with(v, |system, v| system.prepare(v)))
    }
    fn initialise(&self, t: f64, v: &mut Point) -> Result<(), Invalid> {
        self.told(self.with(v, |system, v| system.initialise(t, v)))
    }
    fn parameters_changed(&self, t: f64, v: &mut Point) {
        self.with(v, |system, v| system.parameters_changed(t, v));
    }
    fn outputs(&self, t: f64, reals: &mut [f64], integers: &[i32], offsets: &Offsets) {
        self.system.outputs(t, reals, integers, offsets);
    }
    fn derivatives(&self, t: f64, reals: &mut [f64], integers: &[i32], offsets: &Offsets) {
        self.system.derivatives(t, reals, integers, offsets);
    }
    fn outputs_dual(&self, t: Dual64, reals: &mut [Dual64], integers: &[i32], offsets: &Offsets) {
        self.system.outputs_dual(t, reals, integers, offsets);
    }
    fn derivatives_dual(&self, t: Dual64, reals: &mut [Dual64], integers: &[i32], offsets: &Offsets) {
        self.system.derivatives_dual(t, reals, integers, offsets);
    }
    fn check(&self, t: f64, v: &Values<f64>) -> Result<(), Invalid> {
        self.told(self.system.check(t, v))
    }
    fn next_time_event(&self, v: &Values<f64>) -> Option<f64> {
        self.system.next_time_event(v)
    }
    fn event_indicators(&self, t: f64, v: &Values<f64>, z: &mut [f64]) {
        self.system.event_indicators(t, v, z);
    }
    fn event(&self, t: f64, crossed: &[bool], v: &mut Point) {
        self.with(v, |system, v| system.event(t, crossed, v));
    }
    fn step_completed(&self, t: f64, step: f64, v: &mut Point) {
        self.with(v, |system, v| system.step_completed(t, step, v));
    }
    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        let before = report.findings.len();
        self.system.report(v, report);
        for finding in &mut report.findings[before..] {
            finding.name = translated(&finding.name, &self.translation);
            finding.note = translated(&finding.note, &self.translation);
        }
    }
    fn steps_itself(&self) -> bool {
        self.system.steps_itself()
    }
    fn workspace(&self) -> usize {
        self.system.workspace()
    }
    fn advance(&self, stride: Stride, v: &mut Point) -> bool {
        self.system.advance(stride, v)
    }
    fn own_step_pays(&self, h: f64, relative_tolerance: f64, v: &Values<f64>) -> bool {
        self.system.own_step_pays(h, relative_tolerance, v)
    }
    fn conclude(&self, whole: &Values<f64>, tolerance: (&[f64], f64), v: &mut Point) -> ErrorEstimate {
        self.system.conclude(whole, tolerance, v)
    }
}
