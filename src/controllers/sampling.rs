//! A controller that is evaluated at all times, or sampled if a master steps the FMU.

use super::clock::{Clock, SHORTEST};
use crate::system::{
    BooleanOf, Choice, ChoiceOf, Declaration, DiscreteSpec, Invalid, Memory, Parameter, Point, Scalar, ScalarOf,
    choice, integer, scalar,
};

/// Evaluation of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Evaluation {
    Automatic,
    Continuous,
    Sampled,
}

impl Choice for Evaluation {
    const TYPE: &'static str = "Law";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Automatic, "automatic", "sampled in co-simulation; continuous in model exchange and in a composite"),
        (Self::Continuous, "continuous", "at all times; in co-simulation only where the step is short against 1/s"),
        (Self::Sampled, "sampled", "once a sample time, over which the control law's dynamics are solved"),
    ];
}

impl Evaluation {
    /// The parameter `law` that chooses, with its description.
    pub fn parameter(description: &str) -> DiscreteSpec<Self> {
        choice("law", description).fixed()
    }

    /// Refuses to sample where no master steps the unit.
    pub fn require_steps<S: Scalar>(
        law: ChoiceOf<Parameter, Evaluation>,
        is_stepped: BooleanOf<Memory>,
        v: &mut Point<S>,
    ) {
        v.refuse(v.get(law).is(Evaluation::Sampled) & !v.get(is_stepped), |v| {
            let allowed = "must be continuous or automatic: only an FMU that is stepped in co-simulation is sampled";
            Invalid::new(v.name(law), "sampled", allowed)
        });
    }
}

/// The parameter for the number of samples that a sampled controller looks ahead.
pub(super) fn prediction_steps() -> DiscreteSpec<i32> {
    let text = "samples over which the sampled law looks ahead: 1 is sharper, where the plant is stepped before the \
                controller; 2 serves any master";
    integer("prediction_steps", text).start(2).within(1, 100)
}

/// The samples of a law: a sample time apart, or as far as the first communication step is long.
#[derive(Debug)]
pub(super) struct Sampling {
    pub sample_time: ScalarOf<Parameter>,
    /// The clock. Its sample time is 0 without sampling, and until the first step's length is known.
    pub clock: Clock,
}

impl Sampling {
    pub fn declare(d: &mut Declaration) -> Self {
        let asked = "time from sample to sample of the sampled law; 0: the length of the first communication step";
        let used = "time from sample to sample; 0 until it is known, and for continuous evaluation";
        Sampling {
            sample_time: d.parameter(scalar("sample_time", asked).unit("s").min(0.0).fixed()),
            clock: {
                let period = d.discrete(scalar("sample_period", used).unit("s"));
                Clock::declare(d, period)
            },
        }
    }

    /// Refuses a sample time that is next to nothing.
    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        let asked = v[self.sample_time];
        let is_known = asked.equals(S::from(0.0)) | asked.at_least(S::from(SHORTEST));
        v.refuse(!is_known, |v| {
            let allowed = format!("must be {SHORTEST:e} or more, or 0 for the length of the first communication step");
            Invalid::new(v.name(self.sample_time), asked.to_text(), allowed)
        });
    }

    /// Starts the clock at t; if the controller is sampled, with the sample time that is asked for.
    pub fn begin<S: Scalar>(&self, t: S, is_sampled: S::Flag, v: &mut Point<S>) {
        v[self.clock.start] = t;
        v.when(is_sampled, |v| v[self.clock.period] = v[self.sample_time]);
    }

    /// At a communication point, after a step: takes the first step's length where it is to be the sample time, with what
    /// is to be done then. A step that is too short for that is a remnant: the clock starts behind it, with what is to be
    /// done then.
    pub fn keep_to_communication_points<S: Scalar>(
        &self,
        (t, step): (S, S),
        first: impl FnOnce(&mut Point<S>),
        remnant: impl FnOnce(&mut Point<S>),
        v: &mut Point<S>,
    ) {
        let clock = &self.clock;
        let is_known = clock.is_known(&v.values());
        let is_first = !is_known & step.at_least(S::from(SHORTEST));
        v.when(is_known, |v| clock.follow(t, step, v));
        v.when(is_first, |v| {
            v[clock.period] = step;
            first(v);
        });
        v.when(!is_known & !is_first, |v| {
            v[clock.start] = t;
            remnant(v);
        });
    }
}
