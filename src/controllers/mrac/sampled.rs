//! The sampled form: over a sample time, state and reference are what they were measured as at its end. The reference model then
//! moves exactly, the estimates by the integral of its error, and the control follows from them and from the same state.
#![allow(non_snake_case)] // matrices have the names of the field

use super::Mrac;
use super::estimates::Factor;
use super::magnitude;
use crate::controllers::origins::Turning as _;
use crate::controllers::sampling::Sampling;
use crate::mathematics::exponential::{exponential, workspace};
use crate::mathematics::limits::within;
use crate::system::{Declaration, Discrete, Point, Scalar, Values, VectorOf, vector};

/// The clock of the samples, and values that last from sample to sample.
#[derive(Debug)]
pub(super) struct Samples {
    pub sampling: Sampling,
    /// The control until the next sample, before its limits.
    pub control: VectorOf<Discrete>,
    /// x_m at the latest sample.
    pub x_m_before: VectorOf<Discrete>,
    /// u_b and φ(x) as they were last looked at.
    u_b: VectorOf<Discrete>,
    phi: VectorOf<Discrete>,
    /// State at which the model rests, its distance from there, and the integral of e.
    rest: VectorOf<Discrete>,
    away: VectorOf<Discrete>,
    integral: VectorOf<Discrete>,
    /// e^(M T) of M = (A_m I; 0 0) by columns, with the integral of e^(A_m t) to the right of e^(A_m T); then the workspace for it.
    transition: VectorOf<Discrete>,
}

impl Samples {
    /// Values for n states and m controls, and a regressor of so many elements.
    pub fn declare(d: &mut Declaration, (n, m): (usize, usize), columns: usize) -> Self {
        let sampling = Sampling::declare(d);
        let mut hidden = |name: &str, size: usize| d.discrete(vector(name, size, "").hidden());
        Samples {
            control: hidden("#sampled u", m),
            x_m_before: hidden("#x_m_before", n),
            u_b: hidden("#sampled u_b", m),
            phi: hidden("#sampled phi", columns),
            rest: hidden("#rest of x_m", n),
            away: hidden("#x_m - rest", n),
            integral: hidden("#integral of e", n),
            transition: hidden("#transition", 4 * n * n + workspace(2 * n)),
            sampling,
        }
    }
}

impl Mrac {
    /// Starts the clock at t, where its sample time is known, with the control of the start.
    pub(super) fn begin_sampling<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let is_sampled = self.is_sampled(&v.values());
        self.samples.sampling.begin(t, is_sampled, v);
        v.copy(self.x_m, self.samples.x_m_before);
        v.when(is_sampled, |v| self.discretise(v));
        self.look(v);
        self.hold(v);
    }

    /// e^(A_m T) and its integral, where T is known.
    pub(super) fn discretise<S: Scalar>(&self, v: &mut Point<S>) {
        let (clock, n) = (&self.samples.sampling.clock, self.x.len());
        let (period, order) = (v[clock.period], 2 * n);
        v.when(clock.is_known(&v.values()), |v| {
            v[self.samples.transition].fill(S::from(0.0));
            for i in 0..n {
                for j in 0..n {
                    let entry = self.design.dynamics.A_m(&v.values())[(i, j)];
                    v[self.samples.transition][i + j * order] = entry * period;
                }
                v[self.samples.transition][i + (n + i) * order] = period;
            }
            let (matrix, workspace) = v[self.samples.transition].split_at_mut(order * order);
            exponential(order, matrix, workspace);
        });
    }

    /// Notes u_b and φ of the present inputs.
    pub(super) fn look<S: Scalar>(&self, v: &mut Point<S>) {
        for i in 0..self.u.len() {
            let u_b = self.nominal_control(i, &v.values());
            v[self.samples.u_b][i] = u_b;
        }
        for j in 0..self.phi.len() {
            let phi = self.regressor(j, &v.values());
            v[self.samples.phi][j] = phi;
        }
    }

    fn noted<S: Scalar>(&self, factor: Factor, v: &Values<S>) -> S {
        match factor {
            Factor::Control(j) => v[self.samples.u_b][j],
            Factor::Regressor(j) => v[self.samples.phi][j],
            Factor::One => S::from(1.0),
        }
    }

    /// The adaptive control, before its limits, from what was noted.
    pub(super) fn sampled_law<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        self.adapted(i, v, |factor| self.noted(factor, v))
    }

    /// Holds the control from what was noted, and shows it.
    pub(super) fn hold<S: Scalar>(&self, v: &mut Point<S>) {
        for i in 0..self.u.len() {
            let wanted = self.sampled_law(i, &v.values());
            v[self.samples.control][i] = wanted;
        }
        let is_shown = self.is_sampled(&v.values()) & self.in_command.is_active(&v.values());
        v.when(is_shown, |v| {
            for i in 0..self.u.len() {
                let wanted = v[self.samples.control][i];
                v[self.unlimited][i] = wanted;
                v[self.u][i] = within(wanted, v[self.u_min][i], v[self.u_max][i]);
            }
        });
    }

    /// Takes a sample: advances model and estimates by a sample time, and computes the control until the next one.
    pub(super) fn sample<S: Scalar>(&self, v: &mut Point<S>) {
        let active = self.in_command.is_active(&v.values());
        self.look(v);
        v.when(active, |v| {
            self.advance_model(v);
            self.adapt(v);
        });
        v.when(!active, |v| self.put_model(v));
        v.copy(self.x_m, self.samples.x_m_before);
        self.hold(v);
        self.samples.sampling.clock.tick(v);
    }

    /// x_m a sample time later, rest + e^(A_m T) (x_m − rest), and the integral of e meanwhile. It is driven by K_g r, and by
    /// what the limits have taken from the control.
    fn advance_model<S: Scalar>(&self, v: &mut Point<S>) {
        let (n, order, period) = (self.x.len(), 2 * self.x.len(), v[self.samples.sampling.clock.period]);
        for i in 0..n {
            let values = &v.values();
            let rest = (0..self.u.len()).fold(S::from(0.0), |sum, j| {
                let control = v[self.samples.control][j];
                let driven = self.command(j, values) + within(control, v[self.u_min][j], v[self.u_max][j]) - control;
                sum + v[self.design.at_rest.at(i, j)] * driven
            });
            v[self.samples.rest][i] = rest;
            v[self.samples.away][i] = v[self.samples.x_m_before][i] - rest;
        }
        for i in 0..n {
            let along = |first: usize| {
                let entry = |l: usize| v[self.samples.transition][i + (first + l) * order];
                (0..n).fold(S::from(0.0), |sum, l| sum + entry(l) * v[self.samples.away][l])
            };
            let (moved, integral) = (along(0), along(n));
            let rest = v[self.samples.rest][i];
            v[self.x_m][i] = rest + moved;
            v[self.samples.integral][i] = period * (self.state(i, &v.values()) - rest) - integral;
        }
    }

    /// Each estimate, by Γ times the integral of s over the sample time.
    fn adapt<S: Scalar>(&self, v: &mut Point<S>) {
        let (gain, period, n) = (v[self.design.adaptation_gain], v[self.samples.sampling.clock.period], self.x.len());
        for i in 0..n {
            v[self.samples.away][i] = self.state(i, &v.values()) - v[self.x_m][i];
        }
        let leak = gain * v[self.design.leakage] * period * magnitude(&v[self.samples.away]);
        for k in 0..self.estimates() {
            let (place, channel, factor) = self.estimate(k);
            let values = &v.values();
            let of_s = (0..n)
                .fold(S::from(0.0), |sum, l| sum + v[self.design.PB.at(l, channel)] * v[self.samples.integral][l]);
            let after = self.after(k, gain * of_s * self.noted(factor, values), leak, values);
            v[place] = after;
        }
    }
}
