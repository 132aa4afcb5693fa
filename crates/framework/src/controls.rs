//! Variables that every model has in addition to its own, and the memory of its simulation.

use crate::integrator::{Driver, ExplicitLimits, IntegrationMethod, Limits, MOST_EVIDENCE, Mode, Pace, WORK_LIMIT};
use crate::system::{
    BooleanOf, Choice, ChoiceOf, Declaration, DiscreteHandle, Handle, IntegerOf, Memory, Parameter, Point, ScalarOf,
    Section, Span, Values, Variables, VectorOf, boolean, choice, integer, scalar, vector,
};

/// Tolerances below this only add up rounding errors.
pub(crate) const TIGHTEST_TOLERANCE: f64 = 1e-12;

/// The most steps of fixed length in a communication step.
const MOST_FIXED_STEPS: i32 = 10_000;

/// Input signals within a communication step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputHandling {
    /// Inputs are constant (zero-order hold).
    Hold,
    /// They go on as between the last two communication points.
    Extrapolate,
    /// They ramp from the previous value to the present one.
    Interpolate,
}

impl Choice for InputHandling {
    const TYPE: &'static str = "InputHandling";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Hold, "hold", "constant during a communication step (zero-order hold)"),
        (Self::Extrapolate, "extrapolate", "continued along the line through the last two values"),
        (
            Self::Interpolate,
            "interpolate",
            "ramp from the previous to the present value: for masters that step the plant first",
        ),
    ];
}

/// Answer to a step that can't be finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnStepFailure {
    /// An error: many masters take a discarded step for success.
    Error,
    /// The standard's own way.
    Discard,
}

impl Choice for OnStepFailure {
    const TYPE: &'static str = "OnStepFailure";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Error, "error", "fmi2Error: no master overlooks it"),
        (
            Self::Discard,
            "discard",
            "fmi2Discard with the last successful time, for masters that then take a smaller step",
        ),
    ];
}

/// Variables that every model has in addition to its own, and the memory of its simulation.
#[derive(Debug)]
pub struct Controls {
    pub(crate) relative_tolerance: Option<ScalarOf<Parameter>>,
    pub(crate) integration_method: Option<ChoiceOf<Parameter, IntegrationMethod>>,
    pub(crate) fixed_steps: Option<IntegerOf<Parameter>>,
    pub(crate) work_limit: ScalarOf<Parameter>,
    pub(crate) input_handling: Option<ChoiceOf<Parameter, InputHandling>>,
    pub(crate) on_step_failure: ChoiceOf<Parameter, OnStepFailure>,
    pub(crate) time: ScalarOf<Memory>,
    /// The master's tolerance; 0 where it gave none.
    pub(crate) tolerance: ScalarOf<Memory>,
    pub(crate) pace: PaceMemory,
    pub(crate) last_step: ScalarOf<Memory>,
    /// Rates of the inputs that the master gave for the next step.
    pub(crate) given_slopes: Option<VectorOf<Memory>>,
    /// Rates of the inputs in the last step.
    pub(crate) slopes: Option<VectorOf<Memory>>,
    /// Inputs as set for the last step, and as they were at its end.
    pub(crate) previous_inputs: Option<VectorOf<Memory>>,
    pub(crate) last_inputs: Option<VectorOf<Memory>>,
    /// The parameters of the last valid set.
    pub(crate) valid_reals: Option<VectorOf<Memory>>,
    pub(crate) valid_integers: usize,
    /// State of the event indicators at the end of the last step.
    pub(crate) indicators: Option<VectorOf<Memory>>,
    /// Integer and Boolean inputs in the last step; in model exchange those in force while others wait.
    pub(crate) last_integer_inputs: usize,
    pub(crate) integer_inputs_wait: BooleanOf<Memory>,
    pub(crate) started: BooleanOf<Memory>,
    /// Time at which the master's integrator completed its last step (model exchange), and whether states have jumped
    /// at the present event.
    pub(crate) completed: ScalarOf<Memory>,
    pub(crate) states_jumped: BooleanOf<Memory>,
    pub(crate) parameters_set: BooleanOf<Memory>,
    pub(crate) slopes_given: BooleanOf<Memory>,
}

impl Controls {
    /// Declares them; a system without states has no tolerance and no method to choose, one without inputs no handling
    /// of them.
    pub(crate) fn declare(d: &mut Declaration) -> Self {
        d.begin_controls();
        let inputs = d.size(Section::Input);
        let integer_inputs = d.integer_size(Section::Input);
        let relative_tolerance = (d.size(Section::State) > 0).then(|| {
            let text = "error tolerated in each integration step of co-simulation, relative to a state's magnitude or nominal value";
            d.parameter(
                scalar("relative_tolerance", text).start(1e-6).min(TIGHTEST_TOLERANCE).max(1e-2).nominal(1e-6).fixed(),
            )
        });
        let integration_method = IntegrationMethod::offered(d.size(Section::State)).then(|| {
            let text = "method that integrates the equations within a communication step of co-simulation";
            d.parameter(choice::<IntegrationMethod>("integration_method", text).fixed())
        });
        let fixed_steps = integration_method.map(|_| {
            let text = "integration steps of a communication step of co-simulation, with integration_method = fixed";
            d.parameter(integer("fixed_steps", text).start(1).within(1, MOST_FIXED_STEPS).fixed())
        });
        let work_limit = {
            let text = "work that a communication step of co-simulation may take before it ends with an error, in elementary \
                        operations (about 1 ns each)";
            d.parameter(scalar("work_limit", text).start(WORK_LIMIT).min(1e3).max(1e15).nominal(WORK_LIMIT).fixed())
        };
        let input_handling = (inputs > 0).then(|| {
            d.parameter(
                choice::<InputHandling>(
                    "input_handling",
                    "course of inputs within a communication step of co-simulation, from the second one on",
                )
                .fixed(),
            )
        });
        let on_step_failure = d.parameter(
            choice::<OnStepFailure>("on_step_failure", "answer to a communication step that cannot be finished")
                .fixed(),
        );
        let (reals, integers) = (d.size(Section::Parameter), d.integer_size(Section::Parameter));
        let indicators = Driver::stored_of(d.indicator_count());
        let mut memory = |name: &str, len: usize| (len > 0).then(|| d.memory(vector(name, len, "")));
        Controls {
            relative_tolerance,
            integration_method,
            fixed_steps,
            work_limit,
            input_handling,
            on_step_failure,
            given_slopes: memory("#given slopes", inputs),
            slopes: memory("#slopes", inputs),
            previous_inputs: memory("#previous inputs", inputs),
            last_inputs: memory("#last inputs", inputs),
            valid_reals: memory("#valid parameters", reals),
            indicators: memory("#indicators", indicators),
            last_integer_inputs: d.integer_memory(integer_inputs),
            valid_integers: d.integer_memory(integers),
            time: d.memory(scalar("#time", "")),
            tolerance: d.memory(scalar("#tolerance", "")),
            pace: PaceMemory::declare(d),
            last_step: d.memory(scalar("#last step", "")),
            started: d.memory(boolean("#started", "")),
            completed: d.memory(scalar("#completed", "")),
            states_jumped: d.memory(boolean("#states jumped", "")),
            parameters_set: d.memory(boolean("#parameters set", "")),
            slopes_given: d.memory(boolean("#slopes given", "")),
            integer_inputs_wait: d.memory(boolean("#integer inputs wait", "")),
        }
    }

    /// Places of the reals, by names in capitals; none for a real that the model lacks.
    pub(crate) fn reals(&self) -> Vec<(&'static str, Option<Span>)> {
        let of = |scalar: ScalarOf<Memory>| Some(scalar.span());
        let each = |vector: Option<VectorOf<Memory>>| vector.map(|vector| vector.span());
        let pace = &self.pace;
        vec![
            ("RELATIVE_TOLERANCE", self.relative_tolerance.map(|scalar| scalar.span())),
            ("WORK_LIMIT", Some(self.work_limit.span())),
            ("TIME", of(self.time)),
            ("TOLERANCE", of(self.tolerance)),
            ("LAST_STEP", of(self.last_step)),
            ("COMPLETED", of(self.completed)),
            ("SUBSTEP", of(pace.substep)),
            ("SUBSTEP_8", of(pace.substep_8)),
            ("OWN_SUBSTEP", of(pace.own_substep)),
            // Eight in a row.
            ("LIMITS", of(pace.limits[0])),
            ("JACOBIAN_SIZE", of(pace.jacobian_size)),
            ("UNTIL_LOOK", of(pace.until_look)),
            ("INTERVAL", of(pace.interval)),
            ("GIVEN_SLOPES", each(self.given_slopes)),
            ("SLOPES", each(self.slopes)),
            ("PREVIOUS_INPUTS", each(self.previous_inputs)),
            ("LAST_INPUTS", each(self.last_inputs)),
            ("VALID_PARAMETERS", each(self.valid_reals)),
            ("INDICATORS", each(self.indicators)),
        ]
    }

    /// Sections of integers that are copied to the memory, each with the begin of its copy in the block.
    pub(crate) fn copied_integers(&self, variables: &Variables) -> [(Section, usize); 2] {
        let memory = variables.integers(Section::Memory).start;
        [(Section::Parameter, memory + self.valid_integers), (Section::Input, memory + self.last_integer_inputs)]
    }

    /// The same of integers: section, and place there.
    pub(crate) fn integers(&self) -> Vec<(&'static str, Option<(Section, usize)>)> {
        let in_memory = |place: usize| Some((Section::Memory, place));
        vec![
            ("INTEGRATION_METHOD", self.integration_method.map(|choice| choice.place())),
            ("FIXED_STEPS", self.fixed_steps.map(|steps| steps.place())),
            ("INPUT_HANDLING", self.input_handling.map(|choice| choice.place())),
            ("ON_STEP_FAILURE", Some(self.on_step_failure.place())),
            ("STIFF", Some(self.pace.stiff.place())),
            ("EVIDENCE", Some(self.pace.evidence.place())),
            ("STARTED", Some(self.started.place())),
            ("STATES_JUMPED", Some(self.states_jumped.place())),
            ("PARAMETERS_SET", Some(self.parameters_set.place())),
            ("SLOPES_GIVEN", Some(self.slopes_given.place())),
            ("INTEGER_INPUTS_WAIT", Some(self.integer_inputs_wait.place())),
            ("VALID_INTEGERS", in_memory(self.valid_integers)),
            ("LAST_INTEGER_INPUTS", in_memory(self.last_integer_inputs)),
        ]
    }
}

/// Memory of the integration's [`Pace`] between steps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PaceMemory {
    substep: ScalarOf<Memory>,
    substep_8: ScalarOf<Memory>,
    own_substep: ScalarOf<Memory>,
    stiff: BooleanOf<Memory>,
    evidence: IntegerOf<Memory>,
    /// Limits of the explicit methods, of order 5 and 8, for stability and growth, of the stiff one; the mode that grows:
    /// rate, frequency; how far errors are carried.
    limits: [ScalarOf<Memory>; 8],
    jacobian_size: ScalarOf<Memory>,
    until_look: ScalarOf<Memory>,
    interval: ScalarOf<Memory>,
}

impl PaceMemory {
    fn declare(d: &mut Declaration) -> Self {
        PaceMemory {
            substep: d.memory(scalar("#substep", "")),
            substep_8: d.memory(scalar("#substep of order 8", "")),
            own_substep: d.memory(scalar("#own substep", "")),
            stiff: d.memory(boolean("#stiff", "")),
            evidence: d.memory(integer("#evidence", "").within(-MOST_EVIDENCE, MOST_EVIDENCE)),
            limits: [
                "#stable",
                "#growing",
                "#stable 8",
                "#growing 8",
                "#stiff limit",
                "#growth",
                "#frequency",
                "#carried",
            ]
            .map(|name| d.memory(scalar(name, ""))),
            jacobian_size: d.memory(scalar("#Jacobian", "")),
            until_look: d.memory(scalar("#until look", "")),
            interval: d.memory(scalar("#interval", "")),
        }
    }

    pub(crate) fn read(self, v: &Values<f64>) -> Pace {
        let [stable, growing, stable_8, growing_8, stiff, growth, frequency, carried] =
            self.limits.map(|limit| v[limit]);
        Pace {
            substep: v[self.substep],
            substep_8: v[self.substep_8],
            own_substep: v[self.own_substep],
            stiff: v.get(self.stiff),
            evidence: v.get(self.evidence),
            limits: Limits {
                order_5: ExplicitLimits { stable, growing },
                order_8: ExplicitLimits { stable: stable_8, growing: growing_8 },
                stiff,
                mode: Mode { growth, frequency },
                carried,
            },
            jacobian_size: v[self.jacobian_size],
            until_look: v[self.until_look],
            interval: v[self.interval],
        }
    }

    /// Has eigenvalues looked at before the next substep: the equations are others.
    pub(crate) fn look_again(self, v: &mut Point) {
        v[self.until_look] = 0.0;
    }

    pub(crate) fn write(self, pace: Pace, v: &mut Point) {
        v[self.substep] = pace.substep;
        v[self.substep_8] = pace.substep_8;
        v[self.own_substep] = pace.own_substep;
        v.put(self.stiff, pace.stiff);
        v.put(self.evidence, pace.evidence);
        let Limits { order_5, order_8, stiff, mode: Mode { growth, frequency }, carried } = pace.limits;
        let explicit = [order_5.stable, order_5.growing, order_8.stable, order_8.growing];
        let limits = explicit.into_iter().chain([stiff, growth, frequency, carried]);
        self.limits.iter().zip(limits).for_each(|(&handle, limit)| v[handle] = limit);
        v[self.jacobian_size] = pace.jacobian_size;
        v[self.until_look] = pace.until_look;
        v[self.interval] = pace.interval;
    }
}
