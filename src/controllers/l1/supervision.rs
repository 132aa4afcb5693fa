//! Actions of an L1 controller at events and between steps: taking over from manual control, and warnings.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrixView;

use super::law::Law;
use super::unmatched::Unmatched;
use super::{commanded, infinity_norm};
use crate::controllers::origins::Angle;
use crate::mathematics::limits::within;
use crate::system::{Point, Scalar, Values};

impl Law {
    /// Negative when `enabled` has changed.
    pub fn event_indicators<S: Scalar>(&self, v: &Values<S>, z: &mut [S]) {
        self.in_command.event_indicators(v, z);
        self.origin_indicators(v, z);
    }

    /// Takes over, or hands over, where `enabled` has changed.
    pub fn event<S: Scalar>(&self, v: &mut Point<S>) {
        self.event_with(|_| {}, |_, _, _| {}, v);
    }

    /// The same, with what a unit does before it takes over, and where the origin of an angle has moved.
    pub fn event_with<S: Scalar>(
        &self,
        before: impl FnOnce(&mut Point<S>),
        moved: impl Fn(Angle, S, &mut Point<S>),
        v: &mut Point<S>,
    ) {
        self.in_command.event(v, |v| {
            before(v);
            self.put_predictor(v);
            self.take_over(v);
        });
        self.move_origins(moved, v);
    }

    /// Puts the adaptive control where the control is the manual one.
    pub fn take_over<S: Scalar>(&self, v: &mut Point<S>) {
        let by_hand = self.ports.rotors.map(|rotors| rotors.torques_by_hand(&v.values()));
        for i in 0..self.u_ad.len() {
            let values = v.values();
            let of_state = |K_m: DMatrixView<S>| {
                K_m.row(i).iter().zip(self.state(&values)).fold(S::from(0.0), |sum, (&k, x)| sum + k * x)
            };
            let feedback = self.design.K_m(&values).map_or(S::from(0.0), of_state);
            let manual = || within(v[self.in_command.u_manual][i], v[self.ports.u_min][i], v[self.ports.u_max][i]);
            let u = by_hand.map_or_else(manual, |torques| torques[i]);
            let u_ad = u / self.design.inertia(i, &values) + feedback;
            let u_ad = self.added.map_or(u_ad, |added| u_ad - v[added.at_takeover][i]);
            // Computed from the estimates: at the start there are no signals yet.
            let norm = infinity_norm(self.state(&values));
            let eta_hat = |unmatched: &Unmatched, k: usize| unmatched.estimate(k, norm, &values);
            let filtered = u_ad - self.at_once(i, &values, eta_hat);
            for (k, &rest) in self.filter_at_rest.iter().enumerate() {
                v[self.f][i * self.filter.order() + k] = filtered * rest;
            }
        }
    }

    /// The longest communication step for an adaptation that turns at this frequency, s.
    pub(super) fn longest_step<S: Scalar>(&self, frequency: S, v: &Values<S>) -> S {
        v[self.design.step_phase_limit] / frequency
    }

    /// Counts estimates at their bounds and the time of a control at its limit; warns of them and of a step that is too
    /// long.
    pub fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        let (active, settling_time) = (self.in_command.is_active(&v.values()), v[self.design.settling_time]);
        self.at_limit.look(t, settling_time, active, v);
        self.count_projections(v);
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
        v.when(active, |v| self.judge_step(step, v));
        v.when(!active, |v| {
            self.moves.begin(v);
            v.put(self.step_too_long, false.into());
        });
    }

    /// Counts estimates at their bounds, and warns of them.
    fn count_projections<S: Scalar>(&self, v: &mut Point<S>) {
        let count = self.projections(&v.values());
        v.put(self.projection_active, count.to_integer());
        v.when(count.above(S::from(0.0)), |v| {
            v.warn(self.at_bounds, |v| {
                let design = &self.design;
                let [omega_min, omega_max, theta_bound, sigma_bound] =
                    [design.omega_min, design.omega_max, design.theta_bound, design.sigma_bound].map(|it| v.name(it));
                format!(
                    "parameter estimates at a bound: {}. If they stay there, the plant is outside the assumed \
                     uncertainty. Widen {omega_min} … {omega_max}, {theta_bound} or {sigma_bound} if tracking suffers",
                    count.to_text()
                )
            });
        });
    }

    /// Shows the control with the addition of an FMU, if that has changed after a step.
    pub fn show_with_added<S: Scalar>(&self, v: &mut Point<S>) {
        let active = self.in_command.is_active(&v.values());
        for i in 0..self.u_ad.len() {
            let added = self.added.map(|added| v[added.now][i]);
            let wanted = commanded(v[self.u_ad][i], v[self.feedback][i], added) * self.design.inertia(i, &v.values());
            let u = within(wanted, v[self.ports.u_min][i], v[self.ports.u_max][i]);
            v[self.ports.u][i] = S::select(active, u, v[self.ports.u][i]);
        }
    }

    /// Reports that a communication step was too long for the addition of an FMU to the control, if so.
    pub fn judge_step_of_added<S: Scalar>(
        &self,
        is_too_long: S::Flag,
        text: impl FnOnce(&Values<S>) -> String,
        v: &mut Point<S>,
    ) {
        v.when(is_too_long, |v| {
            v.put(self.step_too_long, true.into());
            v.warn(self.long_step, text);
        });
    }

    /// Warns if a communication step was too long for the control.
    fn judge_step<S: Scalar>(&self, step: S, v: &mut Point<S>) {
        let moved = self.moves.look(self.ports.u, step, v);
        v.put(self.step_too_long, moved.flag);
        v.when(moved.flag, |v| v.warn(self.long_step, |_| moved.warning(step, "")));
    }
}
