//! The one abstraction: a dynamic system x' = f(t, x, u; p), y = h(t, x, u; p).
//!
//! # How to write a model of your own
//!
//! A model is a struct of *handles*. It holds no values: these live outside, in one flat block, so that
//! a simulation can be saved, restored, differentiated and run many times over without the model's help.
//!
//! ```
//! # use adaptive_fmu_framework as adaptive_fmu;
//! use adaptive_fmu::{model::Model, system::*};
//!
//! /// Van der Pol oscillator x1' = x2, x2' = mu (1 - x1^2) x2 - x1.
//! struct VanDerPol {
//!     mu: ScalarOf<Parameter>,
//!     x0: VectorOf<Parameter>,
//!     x: VectorOf<State>,
//! }
//!
//! impl System for VanDerPol {
//!     type Structure = NoStructure;
//!     const NAME: &'static str = "van-der-pol";
//!     const DOCUMENTATION: &'static str = "Van der Pol oscillator.";
//!
//!     fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
//!         Ok(VanDerPol {
//!             mu: d.parameter(scalar("mu", "damping").start(1.0)),
//!             x0: d.parameter(vector("x0", 2, "initial state").starts(&[2.0, 0.0]).fixed()),
//!             x: d.state(vector("x", 2, "state").output()),
//!         })
//!     }
//!     fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
//!         v.copy(self.x0, self.x);
//!     }
//!     fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
//!     fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
//!         let [x1, x2] = v.array(self.x);
//!         dx.set(self.x, [x2, v[self.mu] * (-x1 * x1 + 1.0) * x2 - x1]);
//!     }
//! }
//! # let model = Model::new::<VanDerPol>("VanDerPol", &Default::default()).unwrap();
//! # assert_eq!(model.variables().find("x[2]").unwrap().name(), "x[2]");
//! ```
//!
//! `examples/my_controller` is the smallest crate with a controller. `examples/my_plant` is a whole crate with this
//! model, a larger one, which has a structure, units, an input, events and a counter, and a ball that bounces until it
//! rests.
//!
//! ## Which method is called when
//!
//! | method | when | may |
//! | --- | --- | --- |
//! | [`System::declare`] | once an instance | allocate, refuse the structure |
//! | [`System::sizes`], [`System::resize`] | before it, where FMI 3.0 may change sizes of arrays | allocate |
//! | [`System::prepare`] | before the start, and before the first step after a tunable was set | allocate, refuse the parameters |
//! | [`System::relate`] | right after `prepare`, whether that refused or not | refuse the parameters |
//! | [`System::initialise`] | after these, from parameters and present inputs; again at the first step, when every master has set its inputs | refuse the inputs |
//! | [`System::outputs`] | many times a step | not allocate |
//! | [`System::derivatives`] | right after `outputs` at the same point, so it may read signals | not allocate |
//! | [`System::next_time_event`], [`System::event_indicators`], [`System::event`] | several times a step | not allocate |
//! | [`System::check`] | at the start, at the end of each communication step, and where a step can't be finished | not allocate, but for a reason |
//! | [`System::own_step`] | in place of a general integrator, where there is one | not allocate |
//! | [`System::step_completed`] | once a communication step | not allocate, but for a message |
//! | [`System::report`] | before a unit is used at all, after `prepare` | allocate; take up to some 0.1 s |
//!
//! All methods but `declare`, `prepare`, `report` and `own_step` are generic over the [`Scalar`]: with `f64` they are
//! simulated, and over nodes of a [recording](crate::recording) the same text gives exact derivatives, for masters and
//! for the integration of stiff equations, and all dependences: nobody has to declare those. So use `S`'s own functions
//! (`x.sin()`), and write `x * 2.0` rather than `2.0 * x`. A scalar can't be looked at: where something depends on a
//! condition, it is selected ([`Scalar::select`], [`Scalar::branch`]) or carried out on a condition ([`Point::when`]).
//! And keep whatever jumps out of the equations: a jump is an *event*, its value a *discrete* variable that only
//! [`System::event`] changes.
//!
//! ## Events of a contact
//!
//! An event indicator is a function whose change of sign is an event. Behind an event the motion may go on through (a
//! level that is noted, a switch), or be turned back: by a discrete variable that the equations read (a relay), or by a
//! jump of states (a bounce). After a bounce the indicator counts as on the side from which it came, so the way back over
//! its zero is no second event. Such an event reverses the speed, and is best to put the state onto the boundary:
//!
//! ```ignore
//! fn event<S: Scalar>(&self, _t: S, crossed: &[S::Flag], v: &mut Point<S>) {
//!     v.when(crossed[0] & !v.get(self.rests), |v| {
//!         let speed = -v[self.restitution] * v[self.speed];
//!         let rests = speed.at_most(v[self.rest_speed]);
//!         v[self.height] = S::from(0.0);
//!         v[self.speed] = S::select(rests, S::from(0.0), speed);
//!         v.put(self.rests, rests);
//!     });
//! }
//! ```
//!
//! The last lines make it a model: bounces that take a part of the speed follow each other ever faster, and infinitely
//! many of them end at one time. So a contact needs a *mode*, a discrete variable (here `rests`) that an event sets
//! when the speed is small, and that the equations read: while it rests, its rates are zero. Whatever may lift it again
//! is an event too, which takes the mode back: e.g. a force that changes its sign, as one more indicator.
//! `examples/my_plant/src/ball.rs` has it all. Without a mode a step ends in an error that names the indicator (as
//! declared) if its events accumulate, or if an event sets the speed to zero and a force goes on through. An event that
//! lets the motion through with speed left is no error: it may be intended.
//!
//! Equations are pure functions of their arguments. Don't store anything in `self`: an instance is saved by copying its
//! block, and many instances share a thread.

mod clock;
mod composite;
mod declaration;
mod erased;
mod names;
mod point;
mod quantity;
mod record;
mod size;
mod spec;
mod start;
mod unit;
mod values;
mod variable;

pub use clock::SamplingClock;
pub use composite::Structure as CompositeStructure;
pub use declaration::{Declarable, Declaration, DiscreteValue, Warning};
pub use erased::{Compiled, DynSystem, Equations, Kind, Registry};
pub use names::{Described, Named, Names, TAKEN, Word, Words};
pub use point::Point;
pub use quantity::{of_outputs, quantities};
pub use record::Layout;
pub use size::Size;
pub use spec::{
    DiscreteSpec, Grid, Many, Shape, Spec, boolean, choice, diagonal, integer, matrix, scalar, selection, vector,
};
pub use unit::{BASE_UNITS, Base, DisplayUnit, Unit};
pub use values::{
    BooleanOf, Choice, ChoiceOf, Chosen, Class, DifferenceOf, DiscreteHandle, Handle, IntegerOf, MatrixOf, Offsets,
    Rates, ScalarOf, Signals, Span, Values, VectorOf,
};
pub use variable::{
    Causality, Data, Element, NO_LIMIT, Naming, Section, Shown, TELLS_NO_LIMIT, Variability, Variable, Variables,
};

pub use values::class::{Derivative, Discrete, Input, Memory, Parameter, Prepared, Signal, State};

use serde::Deserialize;
use serde::de::DeserializeOwned;

pub use crate::error::{Invalid, Number};
pub use crate::report::{DesignReport, Verdict};
pub use crate::scalar::{Changed, Flag, Merge, Message, MessageLog, Scalar, any, larger, smaller};

/// The structure of a system that has none to choose: its description's `[structure]` is empty.
#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct NoStructure {}

/// A stride of a system's own [`OwnStep::advance`].
#[derive(Debug)]
pub struct Stride<'a> {
    /// Begin, s. Inputs and signals have their values at this time.
    pub time: f64,
    /// Its length, s.
    pub length: f64,
    /// Rates of the inputs meanwhile, in the order of their declaration.
    pub slopes: &'a [f64],
    /// Output: the states at `time` + 2 `length`, one number a state in the order of their declaration, as a stride of
    /// twice the length finds them. It is compared with two strides: whatever a stride freezes at its beginning must
    /// stay frozen over both halves of this one.
    pub whole: &'a mut [f64],
    /// Workspace of [`OwnStep::workspace`] numbers; what it holds means nothing.
    pub workspace: &'a mut [f64],
}

/// An estimate of the error of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorEstimate {
    /// Largest error of the step in units of what is tolerated: a step with `scaled <= 1` is accepted.
    pub scaled: f64,
    /// The error of a step h shrinks as h to this power.
    pub order: i32,
}

/// A dynamic system: variables, and equations over them. See the [module](self) for a guide.
pub trait System: Sized + Send + Sync + 'static {
    /// Structure, on which the number of variables depends: read from `[structure]` of the description.
    type Structure: DeserializeOwned;
    /// The name by which a description asks for this system (`model = "…"`).
    const NAME: &'static str;
    /// Purpose, equations and their source, in Markdown with `$…$` mathematics.
    const DOCUMENTATION: &'static str;

    /// Declares every variable, once, and keeps the handles.
    ///
    /// # Errors
    /// [`Invalid`] when the structure contradicts itself, e.g. by sizes that don't fit.
    fn declare(structure: Self::Structure, d: &mut Declaration) -> Result<Self, Invalid>;

    /// Sizes of a structure that can change before the start, without a new description: none where the structure fixes them.
    /// [`System::declare`] decides which variable has which of them; it must also accept the first k sizes larger by 1.
    fn sizes(structure: &Self::Structure) -> Vec<Size> {
        let _ = structure;
        Vec::new()
    }

    /// Gives a structure these values of [`System::sizes`]. Returns start values that differ from those of the description, by names.
    fn resize(structure: &mut Self::Structure, sizes: &[usize]) -> toml::Table {
        let _ = (structure, sizes);
        toml::Table::new()
    }

    /// Designs values that depend on parameters only, by any means: placed poles, solved matrix equations. Its results
    /// are constants of a recording, so an FMU with C sources can't tune the parameters that it reads: values that
    /// follow by arithmetic only belong into [`System::relate`]. Limits of single values (`min`, `max`) were checked
    /// before.
    ///
    /// # Errors
    /// [`Invalid`] with every reason; the parameters set before stay in force.
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        let _ = v;
        Ok(())
    }

    /// Computes the prepared variables that follow from parameters and from designed values by arithmetic only, and
    /// checks the relations between parameters: [`Point::refuse`] reports a violation.
    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        let _ = v;
    }

    /// Sets states and discrete variables at the start time; others have their declared start values. Every Get in
    /// Initialization Mode comes after a call of it, so it only computes. If there is no valid start from these
    /// parameters and inputs, it reports that by [`Point::refuse`].
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let _ = (t, v);
    }

    /// Called when tunable parameters have changed and were prepared: brings states back into new bounds.
    fn parameters_changed<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let _ = (t, v);
    }

    /// The output equation y = h(t, x, u; p), with every other signal that is worth a look.
    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>);

    /// The state equation x' = f(t, x, u; p).
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let _ = (t, v, dx);
    }

    /// Checks whether the equations hold at this point, with signals evaluated: at the start, when every master has set
    /// its inputs, at the end of each communication step, and where a step can't be finished. If they would give no
    /// number, it refuses by [`Point::refuse`] with a text for users: the variable, its value, what is allowed and what
    /// helps. The time is added to the reasons. It changes nothing.
    fn check<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let _ = (t, v);
    }

    /// The time of the next event that is known in advance, infinity where there is none; read off discrete variables (so
    /// that an event that was handled isn't found again).
    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        let _ = v;
        S::from(f64::INFINITY)
    }

    /// Functions whose change of sign is an event, as many as were declared by [`Declaration::indicators`]. An event that
    /// turns the motion back by a jump of states leaves the function as it is, or puts the state onto the boundary, so that
    /// it is exactly zero: then the side to which it leaves counts as the one where it was. (See the [module](self) for
    /// contacts.)
    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        let _ = (t, v, z);
    }

    /// Handles the event at t: changes discrete variables, and states that jump. `crossed` is true for event indicators
    /// that changed sides (none, at a time event). A time event is handled at t = its own time, even if rounding has a
    /// communication step end a little before it.
    fn event<S: Scalar>(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        let _ = (t, crossed, v);
    }

    /// Called after every communication step, with its length: counts, and warns of what is out of the
    /// system's own assumptions. In a composite, whose parts hold no inputs for each other, the length is 0.
    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        let _ = (t, step, v);
    }

    /// Reports what a designer should know of these parameters before using them, from the parameters only: poles,
    /// margins, whether the assumptions of the design hold, and remedies for those that don't.
    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        let _ = (v, report);
    }

    /// A better way through a step than a general integrator, where the system has one.
    fn own_step(&self) -> Option<&dyn OwnStep> {
        None
    }
}

/// A system's own way through a communication step.
pub trait OwnStep {
    /// Size of the workspace for [`OwnStep::advance`].
    fn workspace(&self) -> usize {
        0
    }

    /// True if it pays over a step h from these values, with this relative tolerance in force. If it doesn't, general
    /// integration goes on.
    fn pays(&self, h: f64, relative_tolerance: f64, v: &Values<f64>) -> bool {
        let _ = (h, relative_tolerance, v);
        true
    }

    /// Advances the states by one stride, and changes nothing else: a stride may be tried again with another length. A
    /// step consists of pairs of strides, and is divided until [`OwnStep::conclude`] finds them accurate. Returns false
    /// if the way doesn't hold for this stride: then general integration goes on.
    fn advance(&self, stride: Stride, v: &mut Point) -> bool;

    /// Concludes a step: returns the distance between the ends of one `whole` stride and of two halves, both with their
    /// signals; the point is at the end of the halves. Its states may be improved from both. `tolerance` is what the
    /// user is promised: the nominal value of each state, and the error that is tolerated relative to that or to the
    /// state's magnitude.
    fn conclude(&self, whole: &Values<f64>, tolerance: (&[f64], f64), v: &mut Point) -> ErrorEstimate;
}
