//! One instance of a model in time: its values, its parameters as a transaction, its inputs within a step.

mod derivatives;
mod model_exchange;

use std::sync::Arc;

pub use crate::controls::{InputHandling, OnStepFailure};
pub use model_exchange::Update;

use crate::controls::TIGHTEST_TOLERANCE;
use crate::error::{Invalid, StepError};
use crate::integrator::{Chosen, Driver, IntegrationMethod, Problem, Ramp, Settings};
use crate::kernel::Kernel;
use crate::model::{Block, Model};
use crate::system::{Causality, Dual, Handle, Message, MessageLog, Point, Section, Values};

/// An instance of a model.
#[derive(Debug)]
pub struct Execution {
    model: Arc<Model>,
    /// All values.
    block: Block,
    /// Whether this integrates: not where a master does, in model exchange.
    integrates: bool,
    /// As before the step that is being tried.
    saved: Block,
    /// Whether nothing was changed since everything was computed.
    fresh: bool,
    driver: Driver,
    ramp_values: Vec<f64>,
    ramp_slopes: Vec<f64>,
    dual: Vec<Dual>,
    dual_integers: Vec<i32>,
    event_indicators: Vec<f64>,
    kernel: Option<Kernel>,
    /// Messages that wait to be logged.
    pub log: MessageLog,
}

impl Execution {
    /// An instance at its start values. Instances of one model may share it.
    pub fn new(model: impl Into<Arc<Model>>) -> Self {
        let model = model.into();
        let block = model.start().clone();
        let inputs = model.variables().reals(Section::Input).len();
        let mut execution = Execution {
            fresh: false,
            driver: Driver::new(model.system(), model.variables(), model.sparsity()),
            integrates: true,
            saved: block.clone(),
            dual: vec![Dual::from(0.0); block.reals.len()],
            dual_integers: block.integers.clone(),
            event_indicators: vec![0.0; model.variables().indicators().len()],
            ramp_values: vec![0.0; inputs],
            ramp_slopes: vec![0.0; inputs],
            block,
            model,
            kernel: None,
            log: MessageLog::new(),
        };
        execution.mark_stepped();
        execution
    }

    /// Tells the system who integrates.
    fn mark_stepped(&mut self) {
        if let Some(stepped) = self.model.variables().stepped() {
            self.block.integers[stepped] = i32::from(self.integrates);
        }
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Takes compiled equations in place of the generic ones, from now on; whether they are those of its model.
    pub fn take_kernel(&mut self, kernel: Kernel) -> bool {
        let fits = kernel.fits(self.model.variables(), self.model.sparsity().entries());
        if fits {
            self.driver.take_kernel(&kernel);
            self.kernel = Some(kernel);
        }
        fits
    }

    /// From now on the master integrates, in model exchange.
    pub fn hand_over_integration(&mut self) {
        self.integrates = false;
        self.mark_stepped();
        self.changed();
    }

    /// Back to the start values.
    pub fn reset(&mut self) {
        self.block.copy_from(self.model.start());
        self.mark_stepped();
        self.changed();
        self.log.clear();
        self.driver.forget_choices();
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.values()[self.model.controls().time]
    }

    /// Puts the instance at a time: the start, or a communication point as the master counts it.
    pub fn set_time(&mut self, t: f64) {
        let handle = self.model.controls().time;
        self.point()[handle] = t;
        self.changed();
    }

    /// The master's tolerance: it may tighten the model's own, never loosen it.
    pub fn set_tolerance(&mut self, tolerance: f64) {
        let handle = self.model.controls().tolerance;
        self.point()[handle] = tolerance;
    }

    /// What a step that can't be finished is answered with.
    pub fn on_step_failure(&self) -> OnStepFailure {
        self.values().get(self.model.controls().on_step_failure).item()
    }

    /// All values.
    pub fn block(&self) -> &Block {
        &self.block
    }

    /// All values, to write as they are: a saved state, say. What follows from them is computed anew when it is asked for.
    /// Single values are set by [`Execution::set_real`] and [`Execution::set_integer`].
    pub fn block_mut(&mut self) -> &mut Block {
        self.changed();
        &mut self.block
    }

    /// Sets a real value by its place in the block. Parameters that are set in a running simulation are prepared together
    /// before the next step.
    pub fn set_real(&mut self, place: usize, value: f64) {
        self.block_mut().reals[place] = value;
        if self.model.variables().reals(Section::Parameter).contains(&place) {
            self.parameters_set();
        }
    }

    /// Sets an integer by its place in the block; see [`Execution::set_real`].
    pub fn set_integer(&mut self, place: usize, value: i32) {
        self.block_mut().integers[place] = value;
        if self.model.variables().integers(Section::Parameter).contains(&place) {
            self.parameters_set();
        }
    }

    /// What follows from values is computed anew when it is asked for.
    fn changed(&mut self) {
        self.fresh = false;
    }

    fn parameters_set(&mut self) {
        let handle = self.model.controls().parameters_set;
        self.point().put(handle, true);
    }

    /// Gives the rate of one input for the next step.
    pub fn set_input_slope(&mut self, input: usize, slope: f64) {
        let (slopes, given) = (self.model.controls().given_slopes, self.model.controls().slopes_given);
        let Some(slopes) = slopes else { return };
        if !self.values().get(given) {
            self.point()[slopes].fill(0.0);
            self.point().put(given, true);
        }
        self.point()[slopes][input] = slope;
    }

    fn values(&self) -> Values<'_, f64> {
        Values::new(&self.block.reals, &self.block.integers, self.model.variables().offsets())
    }

    /// All values as the system's own methods see them.
    pub fn point(&mut self) -> Point<'_> {
        self.block.point(&self.model, &mut self.log)
    }

    /// Computes everything at the start time from the present parameters and inputs, where any was changed.
    ///
    /// # Errors
    /// What in them is refused.
    pub fn initialise(&mut self) -> Result<(), StepError> {
        if self.fresh {
            return Ok(());
        }
        self.model.prepare(&mut self.block, &mut self.log)?;
        let waiting = self.model.controls().parameters_set;
        self.point().put(waiting, false);
        self.keep_valid_parameters();
        if let Some(last_inputs) = self.model.controls().last_inputs {
            let inputs = self.block.reals[self.model.variables().reals(Section::Input)].to_vec();
            self.point().set(last_inputs, inputs);
        }
        self.keep_integer_inputs();
        self.initialise_states()?;
        self.check_values(self.time(), self.settings().divergence_limit)?;
        self.fresh = true;
        Ok(())
    }

    /// Puts states and discrete variables at their start, and nothing else.
    fn initialise_states(&mut self) -> Result<(), StepError> {
        let t = self.time();
        for section in [Section::State, Section::Discrete] {
            let (reals, integers) = (self.model.variables().reals(section), self.model.variables().integers(section));
            self.block.reals[reals.clone()].copy_from_slice(&self.model.start().reals[reals]);
            self.block.integers[integers.clone()].copy_from_slice(&self.model.start().integers[integers]);
        }
        self.model.equations().initialise(t, &mut self.block.point(&self.model, &mut self.log));
        self.accepted()?;
        let settings = self.settings();
        let (driver, mut problem) = self.problem(false);
        driver.settle(&mut problem, t, &settings)?;
        self.keep_indicators();
        Ok(())
    }

    /// Takes over the parameters that were set since the last step, all or none; whether there were any.
    ///
    /// # Errors
    /// Every reason for which they are refused; the last valid set is in force again.
    fn commit_parameters(&mut self) -> Result<bool, Invalid> {
        if !self.values().get(self.model.controls().parameters_set) {
            return Ok(false);
        }
        let handle = self.model.controls().parameters_set;
        self.point().put(handle, false);
        if let Err(invalid) = self.model.prepare(&mut self.block, &mut self.log) {
            self.restore_valid_parameters();
            // These were prepared before, so they are accepted again.
            return self.model.prepare(&mut self.block, &mut self.log).and(Err(invalid));
        }
        if self.differs_from_valid() {
            let pace = self.model.controls().pace;
            pace.look_again(&mut self.point());
        }
        self.keep_valid_parameters();
        let t = self.time();
        self.model.equations().parameters_changed(t, &mut self.block.point(&self.model, &mut self.log));
        Ok(true)
    }

    /// Puts the driver's event indicators into the block, where they are saved and restored with it.
    fn keep_indicators(&mut self) {
        if let Some(handle) = self.model.controls().indicators {
            self.block.point(&self.model, &mut self.log).set(handle, self.driver.indicators());
        }
    }

    /// Gives the driver the event indicators that lie in the block.
    fn recall_indicators(&mut self) {
        if let Some(handle) = self.model.controls().indicators {
            let values = Values::new(&self.block.reals, &self.block.integers, self.model.variables().offsets());
            self.driver.set_indicators(&values[handle]);
        }
    }

    /// Where in the memory the integers of a section are kept.
    fn kept(&self, first: usize, section: Section) -> std::ops::Range<usize> {
        let start = self.model.variables().integers(Section::Memory).start + first;
        start..start + self.model.variables().integers(section).len()
    }

    fn valid_integers(&self) -> std::ops::Range<usize> {
        self.kept(self.model.controls().valid_integers, Section::Parameter)
    }

    /// Where in the block the real parameters of the last valid set are kept.
    fn valid_reals(&self) -> Option<std::ops::Range<usize>> {
        let memory = self.model.variables().reals(Section::Memory).start;
        let kept = self.model.controls().valid_reals?.span().range();
        Some(memory + kept.start..memory + kept.end)
    }

    /// Whether any parameter is another than in the last valid set.
    fn differs_from_valid(&self) -> bool {
        let Block { reals, integers } = &self.block;
        let set = self.model.variables().integers(Section::Parameter);
        self.valid_reals().is_some_and(|valid| reals[valid] != reals[self.model.variables().reals(Section::Parameter)])
            || integers[self.valid_integers()] != integers[set]
    }

    fn keep_valid_parameters(&mut self) {
        if let Some(valid) = self.valid_reals() {
            self.block.reals.copy_within(self.model.variables().reals(Section::Parameter), valid.start);
        }
        let (from, to) = (self.model.variables().integers(Section::Parameter), self.valid_integers());
        self.block.integers.copy_within(from, to.start);
    }

    fn restore_valid_parameters(&mut self) {
        if let Some(valid) = self.valid_reals() {
            self.block.reals.copy_within(valid, self.model.variables().reals(Section::Parameter).start);
        }
        let (from, to) = (self.valid_integers(), self.model.variables().integers(Section::Parameter));
        self.block.integers.copy_within(from, to.start);
    }

    fn settings(&self) -> Settings {
        let controls = self.model.controls();
        let own = controls.relative_tolerance.map_or(1e-6, |handle| self.values()[handle]);
        let asked = self.values()[controls.tolerance];
        let relative_tolerance = if asked > 0.0 { own.min(asked.max(TIGHTEST_TOLERANCE)) } else { own };
        let method =
            controls.integration_method.map_or(IntegrationMethod::Automatic, |handle| self.values().get(handle).item());
        let fixed_steps = controls.fixed_steps.map_or(1, |handle| self.values().get(handle));
        let most_work = self.values()[controls.work_limit];
        Settings { method, fixed_steps, relative_tolerance, most_work, ..Settings::default() }
    }

    /// Takes over the parameters that were set since the last step, then advances from t by one communication step;
    /// whether parameters were taken over.
    ///
    /// # Errors
    /// [`StepError::Parameters`] when they are refused: the last valid ones are in force again. Else why the step
    /// can't be finished: everything is as before, parameters that wait to be taken over included.
    pub fn step(&mut self, t: f64, step: f64) -> Result<bool, StepError> {
        self.saved.copy_from(&self.block);
        let waiting = self.log.len();
        let taken_over = self.commit_parameters().map_err(StepError::Parameters)?;
        self.set_time(t);
        if let Err(error) = self.try_step(step) {
            self.block.copy_from(&self.saved);
            self.log.truncate(waiting);
            return Err(error);
        }
        Ok(taken_over)
    }

    fn try_step(&mut self, step: f64) -> Result<(), StepError> {
        let controls = self.model.controls();
        let (started, pace, last) = (controls.started, controls.pace, controls.last_step);
        let first = !self.values().get(started);
        if first {
            // Not every master sets inputs in Initialization Mode: what is taken from them is taken here.
            self.initialise_states()?;
            self.check()?;
            self.point().put(started, true);
        }
        let (t0, settings) = (self.time(), self.settings());
        let t1 = t0 + step;
        let ramped = self.prepare_inputs(step, first);
        let mut next = pace.read(&self.values());
        self.recall_indicators();
        let (driver, mut problem) = self.problem(ramped);
        driver.advance(&mut problem, t0, t1, &settings, &mut next)?;
        self.keep_indicators();
        self.keep_integer_inputs();
        self.set_time(t1);
        self.check().map_err(StepError::Unsound)?;
        self.check_values(t1, settings.divergence_limit)?;
        if ramped {
            // Inputs read back what was set.
            let inputs = self.model.variables().reals(Section::Input);
            let set = self.saved.reals[inputs.clone()].iter();
            self.block.reals[inputs].iter_mut().zip(set).for_each(|(input, set)| *input = *set);
        }
        let mut point = self.block.point(&self.model, &mut self.log);
        pace.write(next, &mut point);
        point[last] = step;
        self.model.equations().step_completed(t1, step, &mut point);
        Ok(())
    }

    /// Which method integrates now, where that has changed since it was asked last.
    pub fn method_news(&mut self) -> Option<Chosen> {
        self.driver.news()
    }

    fn keep_integer_inputs(&mut self) {
        let inputs = self.model.variables().integers(Section::Input);
        let kept = self.kept(self.model.controls().last_integer_inputs, Section::Input);
        self.block.integers.copy_within(inputs, kept.start);
    }

    /// Decides how inputs go during this step; whether they change at all.
    fn prepare_inputs(&mut self, step: f64, first: bool) -> bool {
        let controls = self.model.controls();
        let (Some(handling), Some(given_slopes), Some(slopes), Some(previous), Some(last_inputs)) = (
            controls.input_handling,
            controls.given_slopes,
            controls.slopes,
            controls.previous_inputs,
            controls.last_inputs,
        ) else {
            return false;
        };
        let (given, last) = (controls.slopes_given, controls.last_step);
        let inputs = self.model.variables().reals(Section::Input);
        let v = Values::new(&self.saved.reals, &self.saved.integers, self.model.variables().offsets());
        let present = &self.saved.reals[inputs];
        self.ramp_values.copy_from_slice(present);
        let handling = if first { InputHandling::Hold } else { v.get(handling).item() };
        if v.get(given) {
            self.ramp_slopes.copy_from_slice(&v[given_slopes]);
        } else if handling == InputHandling::Hold {
            self.ramp_slopes.fill(0.0);
        } else {
            let duration = if handling == InputHandling::Extrapolate { v[last] } else { step };
            let pairs = present.iter().zip(&v[previous]);
            self.ramp_slopes
                .iter_mut()
                .zip(pairs)
                .for_each(|(slope, (now, before))| *slope = (now - before) / duration);
            if handling == InputHandling::Interpolate {
                self.ramp_values.copy_from_slice(&v[previous]);
            }
        }
        let mut point = self.block.point(&self.model, &mut self.log);
        point.put(given, false);
        point.set(slopes, &self.ramp_slopes);
        point.set(previous, present);
        for (i, (value, slope)) in self.ramp_values.iter().zip(&self.ramp_slopes).enumerate() {
            point[last_inputs][i] = value + slope * step;
        }
        self.ramp_slopes.iter().any(|&slope| slope != 0.0)
    }

    fn problem(&mut self, ramped: bool) -> (&mut Driver, Problem<'_>) {
        let t0 = self.time();
        let ramp = Ramp { values: &self.ramp_values, slopes: &self.ramp_slopes, time: t0 };
        let problem = Problem {
            system: self.model.system(),
            variables: self.model.variables(),
            reals: &mut self.block.reals,
            integers: &mut self.block.integers,
            ramp,
            held: !ramped,
            log: &mut self.log,
            kernel: self.kernel.as_ref(),
        };
        (&mut self.driver, problem)
    }

    /// Whether the equations hold where the instance stands evaluated, with what is wrong and the time.
    fn check(&mut self) -> Result<(), Invalid> {
        let t = self.time();
        self.model.equations().check(t, &mut self.block.point(&self.model, &mut self.log));
        self.accepted().map_err(|invalid| invalid.at(t))
    }

    /// What the system has refused since it was last asked, with the names of variables that are in force.
    fn accepted(&mut self) -> Result<(), Invalid> {
        self.log.accepted().map_err(|invalid| self.model.variables().told_of(invalid))
    }

    /// Takes the messages that wait to be logged, as they are told to users.
    pub fn take_messages(&mut self) -> impl Iterator<Item = Message> {
        let variables = self.model.variables();
        self.log.drain(..).map(|message| Message { text: variables.told(&message.text), ..message })
    }

    /// Every state and signal must be a number, and so the time of the next event; every output within the limit.
    fn check_values(&self, time: f64, limit: f64) -> Result<(), StepError> {
        let variables = self.model.variables();
        let next = self.model.equations().next_time_event(&self.values());
        if next.is_nan() {
            return Err(StepError::Diverged { variable: "the time of the next event".to_owned(), value: next, time });
        }
        for section in [Section::State, Section::Signal] {
            let values = self.block.reals[variables.reals(section)].iter().enumerate();
            for (place, &value) in values.filter(|(_, value)| !value.is_finite() || value.abs() > limit) {
                let Some(element) = variables.real_at(section, place) else { continue };
                if !value.is_finite() || element.variable.causality == Causality::Output {
                    return Err(StepError::Diverged { variable: element.name(), value, time });
                }
            }
        }
        Ok(())
    }
}
