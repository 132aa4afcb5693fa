//! Effect of the limits on the linear system of a stride: a control that is at its limit at the beginning stays there,
//! and u_ad follows what the limit leaves.

use super::{Baseline, Linear};

impl Linear<'_> {
    /// Adds the change of v_j, times ω̂: that of the filter's output, or none while the control is at its limit.
    pub(super) fn add_control_change(&mut self, omega: f64, i: usize, j: usize) {
        let (l1, at, v) = (self.l1, self.at, self.v);
        let limited = l1.is_limited(j, &v);
        let feedback_rate = self.feedback_rate(j);
        if !limited {
            let u_ad = v[l1.u_ad][j];
            let eta = self.row(i);
            for (f, c) in eta[at.f + j * l1.filter.order()..].iter_mut().zip(l1.filter.C_f.iter()) {
                *f += omega * c;
            }
            eta[at.one] -= omega * u_ad;
            self.add_at_once(omega, i, j);
        }
        self.row(i)[at.time] += omega
            * match (l1.baseline, limited) {
                (Baseline::Inside, false) => -feedback_rate,
                (Baseline::Outside, true) => feedback_rate,
                _ => 0.0,
            };
    }

    /// f' = … + f_0 (u/inertia + K_m x − u_ad)/T_t where the control u is at its limit.
    pub(super) fn tracking(&mut self) {
        let (l1, at, v) = (self.l1, self.at, self.v);
        let order = l1.filter.order();
        for i in (0..l1.u_ad.len()).filter(|&i| l1.is_limited(i, &v)) {
            let tracking_rate = l1.tracking_rate(i, self.K, &v);
            let (left, left_rate) = (v[l1.ports.u][i] / l1.design.inertia(i, &v), self.feedback_rate(i));
            for k in 0..order {
                let (row, gain) = (at.f + i * order + k, tracking_rate * l1.filter_at_rest[k]);
                *self.entry(row, at.one) += gain * (left + v[l1.feedback][i]);
                *self.entry(row, at.time) += gain * left_rate;
                for (l, c) in l1.filter.C_f.iter().enumerate() {
                    *self.entry(row, at.f + i * order + l) -= gain * c;
                }
                self.track_at_once(row, gain, i);
            }
        }
    }

    /// Feedthrough of η̂_2 to u_ad, in what is followed.
    fn track_at_once(&mut self, row: usize, gain: f64, channel: usize) {
        let Some(direct) = self.l1.unmatched.as_ref().and_then(|unmatched| unmatched.cancellation.direct) else {
            return;
        };
        let (gains, m, order) = (self.v.matrix(direct), self.l1.eta_hat.len(), self.at.order);
        for (k, at_once) in gains.row(channel).iter().enumerate() {
            for column in 0..order {
                let eta = self.eta[(m + k) * order + column];
                *self.entry(row, column) += gain * at_once * eta;
            }
        }
    }
}
