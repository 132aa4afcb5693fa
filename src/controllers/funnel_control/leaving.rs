//! An error that leaves its funnel: it isn't defined outside, so the step is refused, or the funnel re-opens.

use super::{Errors, FunnelControl, MOST_DEGREE};
use crate::controllers::angles::require_below_half_a_turn;
use crate::controllers::funnel::{EDGE, OnExit, WIDER};
use crate::system::{Invalid, Point, Scalar, Values, larger};

/// A funnel that re-opens is widened so many times at most, each time to [`WIDER`] of what it was: by 1e96 in all.
const MOST_WIDENED: usize = 1000;

impl FunnelControl {
    /// True if a funnel opens to an error that leaves it.
    pub(super) fn reopens<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        v.get(self.on_exit).is(OnExit::Reopen) & v.get(self.began_inside) & self.in_command.is_active(v)
    }

    /// Distance of the errors of a channel from where its funnel re-opens, in parts of their bounds.
    pub(super) fn distance<S: Scalar>(&self, i: usize, t: S, v: &Values<S>) -> S {
        let (mut nearest, mut is_inside) = (S::from(1.0), S::Flag::from(true));
        for part in self.levels(i, t, v).into_iter().take(self.parts.shape().1) {
            let margin = -part.abs() + (1.0 - EDGE);
            // Outside, what follows from an error is no number.
            nearest = S::select(is_inside & margin.below(nearest), margin, nearest);
            is_inside = is_inside & margin.above(S::from(0.0));
        }
        S::select(nearest.equals(S::from(0.0)), S::from(-f64::MIN_POSITIVE), nearest)
    }

    /// Re-opens the funnels of channels that have an error outside.
    pub(super) fn reopen_left<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let reopens = self.reopens(&v.values());
        v.when(reopens, |v| {
            for i in 0..self.u.len() {
                let is_inside = self.distance(i, t, &v.values()).above(S::from(0.0));
                v.when(!is_inside, |v| self.reopen(i, t, v));
            }
        });
    }

    /// Re-opens the funnel of a channel: to 1.25 times the error, and on until the errors of all levels are at most 0.8 of their
    /// bounds.
    fn reopen<S: Scalar>(&self, i: usize, t: S, v: &mut Point<S>) {
        let values = v.values();
        let psi = larger(self.bounds.at(i, t, &values), self.error(0, i, &values).abs() * WIDER);
        let mut opened = [psi];
        if let Errors::Filtered { .. } = self.errors {
            let is_wide = |opened: &[S]| {
                let levels: [S; MOST_DEGREE] = self.levels_within(opened[0], i, t, &values);
                let inside = levels.into_iter().map(|part| part.abs().at_most(S::from(1.0 / WIDER)));
                inside.fold(S::Flag::from(true), |all, inside| all & inside)
            };
            S::iterate(&mut opened, MOST_WIDENED, |opened| !is_wide(opened), |opened| opened[0] *= WIDER);
        }
        let was = self.bounds.at(i, t, &values);
        let second = match &self.errors {
            Errors::Filtered { .. } => None,
            Errors::TwoFunnels { g_0, second } => {
                let e_1 = self.second_error(*g_0, opened[0], i, &values);
                let is_inside = e_1.abs().below(second.at(i, t, &values) * (1.0 - EDGE));
                Some((second, S::select(is_inside, second.at(i, t, &values), e_1.abs() * WIDER)))
            }
        };
        for (bounds, to) in [(&self.bounds, opened[0])].into_iter().chain(second) {
            v[bounds.opened_to][i] = larger(v[bounds.end][i], to);
            v[bounds.opened_at][i] = t;
        }
        let count = (S::from_integer(v.get(self.reopened)) + 1.0).to_integer();
        v.put(self.reopened, count);
        self.warn_reopened((i, t), [was, opened[0]], v);
    }

    fn warn_reopened<S: Scalar>(&self, (i, t): (usize, S), [was, now]: [S; 2], v: &mut Point<S>) {
        let error = self.error(0, i, &v.values());
        v.warn(self.left, |v| {
            format!(
                "{} = {} or an error that follows from it has left its funnel of {} = {} at t = {} s; it was re-opened to {}. {} \
                 counts how often that happens",
                v.name(self.e.at(i)),
                error.rounded(),
                v.name(self.bounds.psi.at(i)),
                was.rounded(),
                t.to_text(),
                now.rounded(),
                v.name(self.reopened)
            )
        });
    }

    /// Refuses an error of a channel that is outside: the first of its levels that is.
    pub(super) fn check_channel<S: Scalar>(&self, i: usize, t: S, v: &mut Point<S>) {
        if self.angles.has(i) {
            let (opened_to, psi) = (v[self.bounds.opened_to][i], self.bounds.psi.at(i));
            require_below_half_a_turn(opened_to, |v| v.name(psi), v);
        }
        let levels = self.levels(i, t, &v.values());
        let is_start = t.equals(v[self.bounds.opened_at][i]);
        let mut others_inside = S::Flag::from(true);
        for (level, part) in levels.into_iter().enumerate().take(self.parts.shape().1) {
            let inside = part.abs().below(S::from(1.0));
            for (when, begins) in [(is_start, true), (!is_start, false)] {
                v.refuse(others_inside & !inside & when, |v| self.refusal((i, level), part, begins, v));
            }
            others_inside = others_inside & inside;
        }
    }

    /// Message about an error of a channel and level that is outside, with advice.
    fn refusal<S: Scalar>(&self, (i, level): (usize, usize), part: S, begins: bool, v: &Values<S>) -> Invalid {
        let [psi_0, psi_inf, psi] =
            [v.name(self.bounds.start.at(i)), v.name(self.bounds.end.at(i)), v.name(self.bounds.psi.at(i))];
        let bound = v[self.bounds.psi][i];
        let error = v[self.e][i];
        let gain = v.name(self.g.at(i));
        let helps = match (begins, level) {
            (true, 0) => format!("{psi_0} above {} would do", error.abs().rounded_at_least()),
            (true, _) => format!("a larger {psi_0} would do, or a start nearer to the reference and its rate"),
            (false, _) => format!(
                "a smaller communication step helps where it is sampled too rarely, a larger {gain} or {psi_inf} where the \
                 control is too weak, wider limits where it is at one; {} = reopen goes on",
                v.name(self.on_exit)
            ),
        };
        let place = if begins { "starts outside its funnel" } else { "has left its funnel" };
        if level == 0 {
            let allowed = format!("{place}: must lie between -{0} and {0}, {psi}; {helps}", bound.rounded_at_most());
            return Invalid::new(v.name(self.e.at(i)), error.to_text(), allowed);
        }
        let allowed = format!(
            "{place}: must lie between -1 and 1 (with {} = {} and {psi} = {}); {helps}",
            v.name(self.e.at(i)),
            error.to_text(),
            bound.rounded()
        );
        Invalid::new(v.name(self.parts.at(i, level)), part.to_text(), allowed)
    }
}
