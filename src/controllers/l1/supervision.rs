//! What an L1 law does at events and between steps: taking over from manual control, and warnings.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::law::Law;
use super::unmatched::Unmatched;
use super::{dot, infinity_norm};
use crate::control::limits::within;
use crate::system::{Point, Values};

impl Law {
    /// Negative when `enabled` has changed.
    pub fn event_indicators(&self, v: &Values<f64>, z: &mut [f64]) {
        z[0] = if v.get(self.ports.enabled) == v.get(self.active) { 1.0 } else { -1.0 };
    }

    /// Takes over, or hands over, where `enabled` has changed.
    pub fn event(&self, v: &mut Point) {
        let enabled = v.get(self.ports.enabled);
        if enabled && !v.get(self.active) {
            v.copy(self.ports.x, self.x_hat);
            self.take_over(v);
        }
        v.put(self.active, enabled);
    }

    /// Puts the adaptive control where the control is the manual one.
    pub(super) fn take_over(&self, v: &mut Point) {
        for i in 0..self.u_ad.len() {
            let values = v.values();
            let feedback = self.design.K_m(&values).map_or(0.0, |K_m| dot(K_m.row(i).iter(), &v[self.ports.x]));
            let u = within(v[self.ports.u_manual][i], v[self.ports.u_min][i], v[self.ports.u_max][i]);
            let u_ad = u / self.design.inertia(i, &values) + feedback;
            // From the estimates: at the start no signals stand yet.
            let norm = infinity_norm(&v[self.ports.x]);
            let eta_hat = |unmatched: &Unmatched, k: usize| unmatched.estimate(k, norm, &values);
            let filtered = u_ad - self.at_once(i, &values, eta_hat);
            for (k, rest) in self.filter_at_rest.iter().enumerate() {
                v[self.f][i * self.filter.order() + k] = filtered * rest;
            }
        }
    }

    /// The longest communication step for an adaptation that turns at this frequency, s.
    pub(super) fn longest_step(&self, frequency: f64, v: &Values<f64>) -> f64 {
        v[self.design.step_phase_limit] / frequency
    }

    /// Counts estimates at their bounds and the time of a control at its limit; warns of them and of a step that is too
    /// long.
    pub fn step_completed(&self, t: f64, step: f64, v: &mut Point) {
        // Where a person controls, a limit says nothing of the design: no warning.
        let settling_time = if v.get(self.active) { v[self.design.settling_time] } else { f64::INFINITY };
        self.at_limit.look(t, settling_time, v);
        let count = self.projections(&v.values());
        v.put(self.projection_active, count as i32);
        if count > 0 {
            v.warn(self.at_bounds, || {
                format!(
                    "{count} of the estimates at a bound: where that lasts, the plant is beyond it. Widen omega_min … \
                     omega_max, theta_bound or sigma_bound if tracking suffers"
                )
            });
        }
        if !v.get(self.active) {
            self.moves.begin(v);
            v.put(self.step_too_long, false);
            return;
        }
        let frequency = v[self.adaptation_frequency];
        let longest = self.longest_step(frequency, &v.values());
        let (turns, moved) = (step > longest, self.moves.look(self.ports.u, step, v));
        v.put(self.step_too_long, turns || moved.is_some());
        if turns {
            v.warn(self.long_step, || {
                format!(
                    "the communication step {step:.3e} s is too long for the adaptation, which turns at {frequency:.3e} \
                     rad/s now: while that lasts, peaks of the control grow. Use {longest:.1e} s or less"
                )
            });
        } else if let Some(moved) = moved {
            v.warn(self.long_step, || moved.told(step, ""));
        }
    }
}
