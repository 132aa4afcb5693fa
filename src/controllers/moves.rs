//! How far a control moves from one communication point to the next: what a loop of separate units differs by from the loop
//! as one, whatever the law is.
//!
//! A plant gets a control that is held for a step, and so lags by half of it: what acts is wrong by half of what the control
//! moves by in the step. Where that is a noticeable part of the control, so is the error of its peaks or of its rms
//! (`docs/step_flags.md` has the measurements behind the numbers here).

use crate::system::{
    BooleanOf, Declaration, Discrete, Memory, Parameter, Point, ScalarOf, Signal, VectorOf, scalar, vector,
};

/// A start is arbitrary, and the control leaves it within a few steps: so many moves don't count.
const LEAVING: f64 = 3.0;
/// A control is judged when it has passed a peak: when its magnitude grew no further for so many steps.
const PASSED: f64 = 5.0;

/// The moves of a control, channel by channel.
#[derive(Debug)]
pub(super) struct Moves {
    limit: ScalarOf<Parameter>,
    /// Whether anything is held at all.
    is_stepped: BooleanOf<Memory>,
    /// How many moves there were.
    count: ScalarOf<Discrete>,
    /// The control where the last step ended, its largest magnitude, its farthest move, and the steps since the largest
    /// magnitude.
    last: VectorOf<Discrete>,
    largest: VectorOf<Discrete>,
    farthest: VectorOf<Discrete>,
    since: VectorOf<Discrete>,
}

/// A control that moves too far in a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Move {
    /// How far, in parts of its largest magnitude.
    pub part: f64,
    /// How far it may.
    pub limit: f64,
}

impl Moves {
    /// Of m controls.
    pub fn declare(d: &mut Declaration, m: usize, is_stepped: BooleanOf<Memory>) -> Self {
        let limit = "how far a control may move within a communication step, in parts of its largest magnitude, before \
                     step_too_long tells";
        let mut hidden = |name: &str| d.discrete(vector(name, m, "").hidden());
        Moves {
            last: hidden("#last u"),
            largest: hidden("#largest u"),
            farthest: hidden("#farthest move"),
            since: hidden("#steps since the largest u"),
            count: d.discrete(scalar("#moves", "").hidden()),
            limit: d.parameter(scalar("step_move_limit", limit).start(0.13).positive()),
            is_stepped,
        }
    }

    /// Begins anew where the control jumps for another reason than its law.
    pub fn begin(&self, v: &mut Point) {
        v[self.count] = 0.0;
        for handle in [self.last, self.largest, self.farthest, self.since] {
            v[handle].fill(0.0);
        }
    }

    /// Looks at the control after a communication step; the worst channel that has moved too far in one so far.
    pub fn look(&self, u: VectorOf<Signal>, step: f64, v: &mut Point) -> Option<Move> {
        if step <= 0.0 || !v.get(self.is_stepped) {
            return None;
        }
        let mut any = false;
        for i in 0..u.len() {
            let (now, moved) = (v[u][i].abs(), (v[u][i] - v[self.last][i]).abs());
            any |= moved > 0.0;
            v[self.last][i] = v[u][i];
            if v[self.count] >= LEAVING {
                v[self.farthest][i] = v[self.farthest][i].max(moved);
            }
            if now > v[self.largest][i] {
                (v[self.largest][i], v[self.since][i]) = (now, 0.0);
            } else {
                v[self.since][i] += 1.0;
            }
        }
        // A control that is held over several steps hasn't left its start in them.
        v[self.count] += f64::from(u8::from(any));
        self.worst(v)
    }

    fn worst(&self, v: &Point) -> Option<Move> {
        let limit = v[self.limit];
        let passed = (0..self.last.len()).filter(|&i| v[self.since][i] >= PASSED && v[self.largest][i] > 0.0);
        let moves = passed.map(|i| Move { part: v[self.farthest][i] / v[self.largest][i], limit });
        moves.filter(|one| one.part > limit).max_by(|a, b| a.part.total_cmp(&b.part))
    }
}

impl Move {
    /// What a warning says of it, and what helps against it.
    pub fn told(self, step: f64, helps: &str) -> String {
        let Move { part, limit } = self;
        // The move goes with the step.
        let shorter = step * limit / part;
        format!(
            "the control has moved by {part:.2} of its largest magnitude within a communication step of {step:.3e} s: held so \
             long, it is off that of the loop as one unit by some {:.2} of it. Try {shorter:.1e} s or less{helps}",
            0.5 * part
        )
    }
}
