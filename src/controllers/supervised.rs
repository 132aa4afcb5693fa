//! Checks of a limited control after each communication step: its motion in a step, and the time that it has been at
//! its limit.

use super::at_limit::{AtLimit, Limited};
use super::moves::Moves;
use crate::system::{
    BooleanOf, Declaration, Discrete, Memory, Point, Scalar, Signal, Values, VectorOf, Warning, boolean,
};

/// Supervision of one control.
#[derive(Debug)]
pub(super) struct Supervised {
    u: VectorOf<Signal>,
    moves: Moves,
    /// True if a master of co-simulation steps the unit.
    is_stepped: BooleanOf<Memory>,
    at_limit: AtLimit,
    step_too_long: BooleanOf<Discrete>,
    long_step: Warning,
}

impl Supervised {
    /// Declares the supervision of a control.
    pub fn declare(d: &mut Declaration, limited: Limited) -> Self {
        let is_stepped = d.is_stepped();
        let flag = boolean("step_too_long", "whether the communication step is too long for the control").output();
        Supervised {
            u: limited.u,
            moves: Moves::declare(d, limited.u.len(), is_stepped),
            is_stepped,
            at_limit: AtLimit::declare(d, limited),
            step_too_long: d.discrete(flag),
            long_step: d.warning("logStepTooLong", "communication step too long for the control"),
        }
    }

    /// True if a master of co-simulation steps the unit: one flag of a unit is set so, this one.
    pub fn is_stepped(&self) -> BooleanOf<Memory> {
        self.is_stepped
    }

    /// Checks the control at t after a step. Warns of a control that has been at its limit for a settling time, which
    /// is infinite without desired dynamics. Under manual control nothing is judged.
    pub fn look<S: Scalar>(&self, (t, step): (S, S), settling_time: S, active: S::Flag, v: &mut Point<S>) {
        self.at_limit.look(t, settling_time, active, v);
        v.when(active, |v| {
            let moved = self.moves.look(self.u, step, v);
            v.put(self.step_too_long, moved.flag);
            v.when(moved.flag, |v| v.warn(self.long_step, |_| moved.warning(step, ", or a single FMU")));
        });
        v.when(!active, |v| {
            self.moves.begin(v);
            v.put(self.step_too_long, false.into());
        });
    }

    /// Warns, after [`Supervised::look`], of a communication step in co-simulation that is too long for the controller
    /// itself.
    pub fn judge<S: Scalar>(&self, too_long: S::Flag, v: &mut Point<S>, text: impl FnOnce(&Values<S>) -> String) {
        let too_long = too_long & v.get(self.is_stepped);
        let earlier = v.get(self.step_too_long);
        v.put(self.step_too_long, earlier | too_long);
        v.when(too_long, |v| v.warn(self.long_step, text));
    }
}
