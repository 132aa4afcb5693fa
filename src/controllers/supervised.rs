//! What is looked at after each communication step of a control that is held for it and limited: how far it moves in a step,
//! and for how long it has stood at its limit.

use super::at_limit::{AtLimit, Limited};
use super::moves::Moves;
use crate::system::{BooleanOf, Declaration, Discrete, Point, Scalar, Signal, VectorOf, Warning, boolean};

/// Of one control.
#[derive(Debug)]
pub(super) struct Supervised {
    u: VectorOf<Signal>,
    moves: Moves,
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
            at_limit: AtLimit::declare(d, limited),
            step_too_long: d.discrete(flag),
            long_step: d.warning("logStepTooLong", "communication step too long for the control"),
        }
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
}
