//! The control of an L1 law within its limits, and what the estimates see of it.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::law::Law;
use super::structure::Baseline;
use super::unmatched::Unmatched;
use super::{add_product, commanded};
use crate::mathematics::limits::within;
use crate::system::{Scalar, Signals, Values};

impl Law {
    /// The control, and what the estimates see of it.
    pub(super) fn control<S: Scalar>(&self, v: &Values<S>, y: &mut Signals<S>) {
        let active = self.in_command.is_active(v);
        y[self.feedback].fill(S::from(0.0));
        if let Some(K_m) = self.design.K_m(v) {
            add_product(&mut y[self.feedback], K_m, self.state(v));
        }
        self.filtered(v, y);
        for i in 0..self.u_ad.len() {
            let (u_ad, feedback) = (y[self.u_ad][i], y[self.feedback][i]);
            let added = self.added.map(|added| y[added.now][i]);
            let law = || commanded(u_ad, feedback, added) * self.design.inertia(i, v);
            let wanted = S::branch(active, law, || v[self.in_command.u_manual][i]);
            let u = within(wanted, v[self.ports.u_min][i], v[self.ports.u_max][i]);
            (y[self.ports.unlimited][i], y[self.ports.u][i]) = (wanted, u);
        }
        if let Some(rotors) = &self.ports.rotors {
            rotors.limit(v, y);
        }
        for i in 0..self.u_ad.len() {
            let (u_ad, feedback, inertia) = (y[self.u_ad][i], y[self.feedback][i], self.design.inertia(i, v));
            let (wanted, u) = (y[self.ports.unlimited][i], y[self.ports.u][i]);
            let added = self.added.map(|added| y[added.now][i]);
            y[self.v][i] = match self.baseline {
                Baseline::None | Baseline::Inside => added.map_or(u / inertia, |added| u / inertia - added),
                Baseline::Outside => S::branch(active, || u_ad + (u - wanted) / inertia, || u / inertia + feedback),
            };
        }
    }

    /// u_ad: the output of the filter, including the feedthrough of η̂_2.
    fn filtered<S: Scalar>(&self, v: &Values<S>, y: &mut Signals<S>) {
        for (i, states) in v[self.f].chunks_exact(self.filter.order()).enumerate() {
            y[self.u_ad][i] = states.iter().zip(self.filter.C_f.iter()).fold(S::from(0.0), |sum, (&f, &c)| sum + f * c);
        }
        if let Some(unmatched) = &self.unmatched {
            unmatched.add_at_once(self.u_ad, v, y);
        }
    }

    /// Feedthrough of η̂_2 to u_ad of a channel.
    pub(super) fn at_once<S: Scalar>(&self, i: usize, v: &Values<S>, eta_hat: impl Fn(&Unmatched, usize) -> S) -> S {
        self.unmatched.as_ref().map_or(S::from(0.0), |unmatched| unmatched.at_once(i, v, |k| eta_hat(unmatched, k)))
    }
}
