//! Motion of a control from one communication point to the next: the cause of differences between a loop of separate
//! FMUs and the loop as a single FMU, whatever the controller.
//!
//! A plant gets a control with a zero-order hold, which lags by half a step: the acting control is wrong by half of its
//! motion in the step. If that is a noticeable part of the control, so is the error of its peaks or of its rms
//! (`docs/step_size.md` has the measurements behind the numbers here).

use crate::system::{
    BooleanOf, Declaration, Discrete, Memory, Parameter, Point, Scalar, ScalarOf, Signal, VectorOf, larger, scalar,
    smaller, vector,
};

/// A control has its size once it has grown by no more than this factor for as long as it took to get there,
const GROWTH: f64 = 1.1;
/// at least for so many steps,
const SHORTEST_WAIT: f64 = 20.0;
/// and not for more than so many.
const LONGEST_WAIT: f64 = 1000.0;
/// The part of the limit that a warning's step leads to.
const NAMED: f64 = 0.65;

/// The moves of a control, channel by channel.
#[derive(Debug)]
pub(super) struct Moves {
    limit: ScalarOf<Parameter>,
    /// True if signals are sampled at communication points.
    pub is_stepped: BooleanOf<Memory>,
    /// The steps since the control isn't 0 any more.
    count: ScalarOf<Discrete>,
    /// The control where the last step ended, its largest magnitude, its farthest move.
    last: VectorOf<Discrete>,
    largest: VectorOf<Discrete>,
    farthest: VectorOf<Discrete>,
    /// The magnitude from which growth counts, and the steps since it was reached.
    size: VectorOf<Discrete>,
    since: VectorOf<Discrete>,
}

/// Largest motion of a control in a step, over all channels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Move<S: Scalar> {
    /// True if that is too far.
    pub flag: S::Flag,
    /// Motion, in parts of the control's largest magnitude; 0 if no channel is to be judged.
    pub part: S,
    /// Allowed motion.
    pub limit: S,
}

impl Moves {
    /// Declares the watch on m controls.
    pub fn declare(d: &mut Declaration, m: usize, is_stepped: BooleanOf<Memory>) -> Self {
        let limit = "motion of a control within a communication step, in parts of its largest magnitude, above which \
                     step_too_long is true";
        let mut hidden = |name: &str| d.discrete(vector(name, m, "").hidden());
        Moves {
            last: hidden("#last u"),
            largest: hidden("#largest u"),
            farthest: hidden("#farthest move"),
            size: hidden("#size of u"),
            since: hidden("#steps at this size"),
            count: d.discrete(scalar("#moves", "").hidden()),
            limit: d.parameter(scalar("step_move_limit", limit).start(0.13).positive()),
            is_stepped,
        }
    }

    /// Restarts the watch when the control jumps for another reason than its control law.
    pub fn begin<S: Scalar>(&self, v: &mut Point<S>) {
        let none = S::from(0.0);
        v[self.count] = none;
        for handle in [self.last, self.largest, self.farthest, self.size, self.since] {
            v[handle].fill(none);
        }
    }

    /// Looks at the control after a communication step; the farthest of the moves that any channel has made in one so far.
    pub fn look<S: Scalar>(&self, u: VectorOf<Signal>, step: S, v: &mut Point<S>) -> Move<S> {
        let none = S::from(0.0);
        let has_stepped = !step.at_most(none) & v.get(self.is_stepped);
        v.when(has_stepped, |v| self.note(u, v));
        let part = S::branch(has_stepped, || self.worst(v), || none);
        let limit = v[self.limit];
        Move { flag: part.above(limit), part, limit }
    }

    /// Notes the present control, and its motion so far.
    fn note<S: Scalar>(&self, u: VectorOf<Signal>, v: &mut Point<S>) {
        let none = S::from(0.0);
        // The first move leads from an arbitrary start.
        let has_left = v[self.count].above(none);
        let mut counts = has_left;
        for i in 0..u.len() {
            let (now, moved) = (v[u][i].abs(), (v[u][i] - v[self.last][i]).abs());
            counts = counts | moved.above(none);
            v[self.last][i] = v[u][i];
            v[self.farthest][i] = S::branch(has_left, || larger(v[self.farthest][i], moved), || v[self.farthest][i]);
            v[self.largest][i] = larger(v[self.largest][i], now);
            let grows = now.above(v[self.size][i] * GROWTH);
            v[self.size][i] = S::select(grows, now, v[self.size][i]);
            v[self.since][i] = S::select(grows, none, v[self.since][i] + 1.0);
        }
        v[self.count] += S::from_flag(counts);
    }

    /// The farthest move in parts of its channel's largest magnitude, of those that have their size; 0 where none has.
    fn worst<S: Scalar>(&self, v: &Point<S>) -> S {
        let none = S::from(0.0);
        (0..self.last.len()).fold(none, |worst, i| {
            let (largest, since) = (v[self.largest][i], v[self.since][i]);
            let wait = smaller(larger(v[self.count] - since, S::from(SHORTEST_WAIT)), S::from(LONGEST_WAIT));
            let is_judged = since.at_least(wait) & largest.above(none);
            S::branch(is_judged, || larger(worst, v[self.farthest][i] / largest), || worst)
        })
    }
}

impl<S: Scalar> Move<S> {
    /// Warning text, with advice.
    pub fn warning(self, step: S, helps: &str) -> String {
        let Move { part, limit, .. } = self;
        // The move goes with the step.
        let shorter = step * limit * NAMED / part;
        format!(
            "the control has moved by {} of its largest magnitude within a communication step of {} s (limit {}): its peaks and \
             rms may differ by several per cent from those of the loop as a single FMU. Try {} s or less{helps}",
            part.fixed(2),
            step.scientific(3),
            limit.rounded(),
            shorter.scientific_at_most(1)
        )
    }
}
