//! One instance of a model in time: its values, its parameters as a transaction, its inputs within a step.

mod derivatives;
mod inputs;
mod model_exchange;
mod settled;
mod step_mode;
mod steps;

use std::sync::Arc;

pub use crate::controls::{InputHandling, OnStepFailure};
use derivatives::Derivation;
pub use model_exchange::Update;
pub use settled::Settled;

use crate::controls::TIGHTEST_TOLERANCE;
use crate::error::{Invalid, StepError};
use crate::integrator::{Chosen, IntegrationMethod, Place, Problem, Ramp, Settings, Workspace, check_values};
use crate::kernel::Kernel;
use crate::model::{Block, Model};
use crate::system::{Handle, Message, MessageLog, Point, Section, Values};

/// An instance of a model.
#[derive(Debug)]
pub struct Execution {
    model: Arc<Model>,
    /// All values.
    block: Block,
    /// True if this integrates: not where a master does, in model exchange.
    integrates: bool,
    /// True if events at the end of a communication step are the master's to handle.
    leaves_events: bool,
    /// True if nothing was changed since everything was computed.
    fresh: bool,
    /// Place of its workspace.
    place: Place,
    derivation: Derivation,
    event_indicators: Vec<f64>,
    kernel: Option<Kernel>,
    /// Messages that wait to be logged.
    pub log: MessageLog,
}

impl Execution {
    /// An instance at its start values. Instances of one model may share it.
    pub fn new(model: impl Into<Arc<Model>>) -> Self {
        let model = model.into();
        let mut execution = Execution {
            fresh: false,
            place: model.workspaces().place(|| model.workspace()),
            integrates: true,
            leaves_events: false,
            derivation: Derivation::new(),
            event_indicators: vec![0.0; model.variables().indicators().len()],
            block: model.start().clone(),
            model,
            kernel: None,
            log: MessageLog::new(),
        };
        execution.mark_stepped();
        execution
    }

    /// Sets the system's flag that shows who integrates.
    fn mark_stepped(&mut self) {
        if let Some(stepped) = self.model.variables().stepped() {
            self.block.integers[stepped] = i32::from(self.integrates);
        }
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Uses compiled equations in place of the generic ones. Returns false if they aren't those of its model, or are for
    /// other parameters. When a parameter changes that they are for, the generic equations are back.
    pub fn take_kernel(&mut self, kernel: Kernel) -> bool {
        let fits = kernel.fits(self.model.variables(), self.model.sparsity().entries())
            && kernel.holds(&self.block.reals, &self.block.integers);
        if fits {
            self.own_workspace().driver.take_kernel(&kernel);
            self.kernel = Some(kernel);
        }
        fits
    }

    /// True if compiled equations are evaluated.
    pub fn has_kernel(&self) -> bool {
        self.kernel.is_some()
    }

    /// Parts with equations that were compiled for other parameters.
    fn check_kernel(&mut self) {
        let Block { reals, integers } = &self.block;
        if self.kernel.is_some_and(|kernel| !kernel.holds(reals, integers)) {
            self.kernel = None;
        }
    }

    /// Returns a workspace of its own, for values that must survive from one call to the next.
    fn own_workspace(&mut self) -> &mut Workspace {
        self.place.own(|| self.model.workspace())
    }

    /// Works with what no other instance uses meanwhile.
    fn working<T>(&mut self, work: impl FnOnce(&mut Self, &mut Workspace) -> T) -> T {
        let mut place = std::mem::take(&mut self.place);
        let done = if let Place::Own(workspace, _) = &mut place {
            work(self, workspace)
        } else {
            let model = Arc::clone(&self.model);
            model.workspaces().work(&mut place, || model.workspace(), |workspace| work(self, workspace))
        };
        self.place = place;
        done
    }

    /// Leaves integration to the master from now on, as in model exchange.
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
        if let Place::Own(workspace, _) = &mut self.place {
            workspace.driver.forget_choices();
        }
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.values()[self.model.controls().time]
    }

    /// Length of the last communication step, s; 0 before the first.
    pub fn last_step(&self) -> f64 {
        self.values()[self.model.controls().last_step]
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

    /// Answer to a step that can't be finished.
    pub fn on_step_failure(&self) -> OnStepFailure {
        self.values().get(self.model.controls().on_step_failure).item()
    }

    /// All values.
    pub fn block(&self) -> &Block {
        &self.block
    }

    /// All values, for direct writing, e.g. of a saved state. Dependent values are computed again when they are next
    /// asked for. [`Execution::set_real`] and [`Execution::set_integer`] set single values.
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

    /// Marks dependent values as out of date.
    fn changed(&mut self) {
        self.fresh = false;
    }

    fn parameters_set(&mut self) {
        let handle = self.model.controls().parameters_set;
        self.point().put(handle, true);
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
        self.model.workspaces().initialised(&mut self.place, || self.model.workspace());
        if !self.model.prepare_as_at_start(&mut self.block) {
            self.model.prepare(&mut self.block, &mut self.log)?;
        }
        let waiting = self.model.controls().parameters_set;
        self.point().put(waiting, false);
        self.keep_valid_parameters();
        if let Some(last_inputs) = self.model.controls().last_inputs {
            let inputs = self.block.reals[self.model.variables().reals(Section::Input)].to_vec();
            self.point().set(last_inputs, inputs);
        }
        self.keep_integer_inputs();
        self.working(Execution::initialise_states)?;
        self.check_values(self.time(), self.settings().divergence_limit)?;
        self.fresh = true;
        Ok(())
    }

    /// Puts states and discrete variables at their start, and nothing else.
    fn initialise_states(&mut self, workspace: &mut Workspace) -> Result<(), StepError> {
        let t = self.time();
        for section in [Section::State, Section::Discrete] {
            let (reals, integers) = (self.model.variables().reals(section), self.model.variables().integers(section));
            self.block.reals[reals.clone()].copy_from_slice(&self.model.start().reals[reals]);
            self.block.integers[integers.clone()].copy_from_slice(&self.model.start().integers[integers]);
        }
        self.model.equations().initialise(t, &mut self.block.point(&self.model, &mut self.log));
        self.accepted()?;
        let settings = self.settings();
        workspace.driver.settle(&mut self.problem(), t, &settings)?;
        self.keep_indicators(workspace);
        if self.integrates {
            workspace.driver.prepare(&self.problem(), &settings);
        }
        Ok(())
    }

    /// Takes over the parameters that were set since the last step, all or none. Returns true if there were any.
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
    fn keep_indicators(&mut self, workspace: &Workspace) {
        if let Some(handle) = self.model.controls().indicators {
            self.block.point(&self.model, &mut self.log).set(handle, workspace.driver.indicators());
        }
    }

    /// Gives the driver the event indicators that lie in the block.
    fn recall_indicators(&self, workspace: &mut Workspace) {
        if let Some(handle) = self.model.controls().indicators {
            workspace.driver.set_indicators(&self.values()[handle]);
        }
    }

    /// Place of a section's copied integers in the memory.
    fn copied_integers(&self, first: usize, section: Section) -> std::ops::Range<usize> {
        let start = self.model.variables().integers(Section::Memory).start + first;
        start..start + self.model.variables().integers(section).len()
    }

    fn valid_integers(&self) -> std::ops::Range<usize> {
        self.copied_integers(self.model.controls().valid_integers, Section::Parameter)
    }

    /// Place in the block of the real parameters of the last valid set.
    fn valid_reals(&self) -> Option<std::ops::Range<usize>> {
        let memory = self.model.variables().reals(Section::Memory).start;
        let span = self.model.controls().valid_reals?.span().range();
        Some(memory + span.start..memory + span.end)
    }

    /// True if any parameter is another than in the last valid set.
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
        let (most_work, leaves_end) = (self.values()[controls.work_limit], self.leaves_events);
        Settings { method, fixed_steps, relative_tolerance, most_work, leaves_end, ..Settings::default() }
    }

    /// Takes over the parameters that were set since the last step, then advances from t by one communication step.
    /// Returns true if parameters were taken over.
    ///
    /// # Errors
    /// [`StepError::Parameters`] when they are refused: the last valid ones are in force again. Else why the step
    /// can't be finished: everything is as before, parameters that wait to be taken over included.
    pub fn step(&mut self, t: f64, step: f64) -> Result<bool, StepError> {
        self.working(|execution, workspace| execution.step_with(workspace, t, step))
    }

    fn step_with(&mut self, workspace: &mut Workspace, t: f64, step: f64) -> Result<bool, StepError> {
        workspace.keep(&self.block.reals, &self.block.integers);
        let waiting = self.log.len();
        let taken_over = self.commit_parameters().map_err(StepError::Parameters)?;
        self.set_time(t);
        if let Err(error) = self.try_step(workspace, step) {
            workspace.bring_back(&mut self.block.reals, &mut self.block.integers);
            self.log.truncate(waiting);
            return Err(error);
        }
        Ok(taken_over)
    }

    fn try_step(&mut self, workspace: &mut Workspace, step: f64) -> Result<(), StepError> {
        let controls = self.model.controls();
        let (started, pace, last) = (controls.started, controls.pace, controls.last_step);
        let first = !self.values().get(started);
        if first {
            // Not every master sets inputs in Initialization Mode: what is taken from them is taken here.
            self.initialise_states(workspace)?;
            self.check()?;
            self.point().put(started, true);
        }
        let (t0, settings) = (self.time(), self.settings());
        let t1 = t0 + step;
        let moved = !first && self.inputs_moved();
        let ramped = self.prepare_inputs(workspace, step, first);
        let mut next = pace.read(&self.values());
        self.recall_indicators(workspace);
        let Workspace { driver, ramp_values, ramp_slopes, .. } = workspace;
        let ramp = Ramp { values: ramp_values, slopes: ramp_slopes, time: t0 };
        let mut problem = Problem { ramp, constant_inputs: !ramped, moved: ramped || moved, ..self.problem() };
        driver.advance(&mut problem, t0, t1, &settings, &mut next)?;
        self.keep_indicators(workspace);
        self.keep_integer_inputs();
        self.set_time(t1);
        self.check().map_err(StepError::Unsound)?;
        self.check_values(t1, settings.divergence_limit)?;
        if ramped {
            // Inputs read back what was set.
            let inputs = self.model.variables().reals(Section::Input);
            let set = workspace.reals[inputs.clone()].iter();
            self.block.reals[inputs].iter_mut().zip(set).for_each(|(input, set)| *input = *set);
        }
        let mut point = self.block.point(&self.model, &mut self.log);
        pace.write(next, &mut point);
        point[last] = step;
        self.model.equations().step_completed(t1, step, &mut point);
        Ok(())
    }

    /// Starts reporting the integration method.
    pub fn log_methods(&mut self) {
        self.own_workspace();
    }

    /// The present integration method, if it has changed since the last call; none before [`Execution::log_methods`]
    /// was called.
    pub fn method_news(&mut self) -> Option<Chosen> {
        match &mut self.place {
            Place::Own(workspace, _) => workspace.driver.news(),
            _ => None,
        }
    }

    fn keep_integer_inputs(&mut self) {
        let inputs = self.model.variables().integers(Section::Input);
        let in_force = self.copied_integers(self.model.controls().last_integer_inputs, Section::Input);
        self.block.integers.copy_within(inputs, in_force.start);
    }

    /// The system at the present point, with constant inputs.
    fn problem(&mut self) -> Problem<'_> {
        self.check_kernel();
        Problem {
            system: self.model.system(),
            variables: self.model.variables(),
            reals: &mut self.block.reals,
            integers: &mut self.block.integers,
            ramp: Ramp { values: &[], slopes: &[], time: 0.0 },
            constant_inputs: true,
            moved: false,
            log: &mut self.log,
            kernel: self.kernel.as_ref(),
        }
    }

    /// Checks whether the equations hold at the evaluated point; an error has the reasons and the time.
    fn check(&mut self) -> Result<(), Invalid> {
        let t = self.time();
        self.model.equations().check(t, &mut self.block.point(&self.model, &mut self.log));
        self.accepted().map_err(|invalid| invalid.at(t))
    }

    /// Returns the system's refusals since the last call, with the names of variables that are in force.
    fn accepted(&mut self) -> Result<(), Invalid> {
        self.log.accepted().map_err(|invalid| self.model.variables().named_refusal(invalid))
    }

    fn check_values(&self, time: f64, limit: f64) -> Result<(), StepError> {
        self.check_next_event(time)?;
        check_values(self.model.variables(), &self.block.reals, time, limit)
    }

    /// The time of the next event must be a number.
    fn check_next_event(&self, time: f64) -> Result<(), StepError> {
        let value = self.model.equations().next_time_event(&self.values());
        if value.is_nan() {
            return Err(StepError::Diverged { variable: "the time of the next event".to_owned(), value, time });
        }
        Ok(())
    }

    /// Takes the messages that wait to be logged, in users' words.
    pub fn take_messages(&mut self) -> impl Iterator<Item = Message> {
        let variables = self.model.variables();
        self.log.drain(..).map(|message| Message { text: variables.named(&message.text), ..message })
    }
}
