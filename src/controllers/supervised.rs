//! What is looked at after each communication step of a control that is held for it and limited: how far it moves in a step,
//! and for how long it has stood at its limit.

use super::at_limit::{AtLimit, Limited};
use super::moves::Moves;
use crate::system::{
    BooleanOf, Declaration, Discrete, Memory, Point, Scalar, Signal, Values, VectorOf, Warning, boolean,
};

/// Of one control.
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
    /// Of a control.
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

    /// Looks at the control at t after a step. A control that has stood at its limit as long as the loop takes to settle is
    /// warned of; infinity where no desired dynamics say how long that is. Under manual control nothing is judged.
    pub fn look<S: Scalar>(&self, (t, step): (S, S), settling_time: S, active: S::Flag, v: &mut Point<S>) {
        self.at_limit.look(t, settling_time, active, v);
        v.when(active, |v| {
            let moved = self.moves.look(self.u, step, v);
            v.put(self.step_too_long, moved.flag);
            v.when(moved.flag, |v| v.warn(self.long_step, |_| moved.told(step, ", or the loop as one unit")));
        });
        v.when(!active, |v| {
            self.moves.begin(v);
            v.put(self.step_too_long, false.into());
        });
    }

    /// Tells too, after [`Supervised::look`], of a communication step that is too long for the law itself: where there are such
    /// steps, in co-simulation.
    pub fn judge<S: Scalar>(&self, too_long: S::Flag, v: &mut Point<S>, text: impl FnOnce(&Values<S>) -> String) {
        let too_long = too_long & v.get(self.is_stepped);
        let told = v.get(self.step_too_long);
        v.put(self.step_too_long, told | too_long);
        v.when(too_long, |v| v.warn(self.long_step, text));
    }
}
