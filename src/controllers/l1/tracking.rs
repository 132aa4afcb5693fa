//! Back-calculation: where the control is at its limit, u_ad follows what the limit leaves, so that it doesn't wind up.
//!
//! The predictor sees the limited control, which keeps the estimates from winding up; the integrator in D(s) would go on
//! all the same. u_ad' = … + (u − u_wanted)/T_t in units of u_ad, u_wanted being the control without limits. For any D(s)
//! it drives the filter along the state f_0 in which it rests, A_f f_0 = 0, C_f f_0 = 1: at the limit the filter's own poles
//! stay where they are, and −1/T_t takes the place of the integrator's, whatever T_t is.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{DMatrix, DMatrixView};

use super::law::Law;
use crate::mathematics::limits::UNLIMITED;
use crate::system::{DesignReport, Invalid, Number, Parameter, Point, Rates, Scalar, Values, VectorOf, Verdict};

/// Value of `tracking_time` if it follows from K.
pub(in crate::controllers) const BY_GAIN: f64 = -1.0;
/// The least time that is given, s.
const LEAST: f64 = 1e-9;

/// Refuses given times that are none.
pub(in crate::controllers) fn check<S: Scalar>(times: VectorOf<Parameter>, v: &mut Point<S>) {
    for i in 0..times.len() {
        let time = v[times][i];
        let is_known = time.equals(S::from(BY_GAIN)) | time.equals(S::from(0.0));
        v.refuse(!is_known & time.below(S::from(LEAST)), |v| {
            let allowed = format!("must be {BY_GAIN} (1/K), 0 (off), or at least {} s", Number(LEAST));
            Invalid::new(v.name(times.at(i)), time.to_text(), allowed)
        });
    }
}

/// 1/T_t of a channel whose K has this row, behind a filter whose integral rests at this for an output of 1.
pub(in crate::controllers) fn rate<'a, S: Scalar>(time: S, row: impl Iterator<Item = &'a S>, rest: f64) -> S {
    let none = S::from(0.0);
    let by_gain = || row.fold(none, |sum, k| sum + k.abs()) / rest.abs();
    let in_force = || S::branch(time.above(none), || time.recip(), by_gain);
    S::branch(time.equals(none), || none, in_force)
}

impl Law {
    /// Difference that the limits make to the control wanted by a channel, in the units of u_ad: exactly 0 within them.
    fn added_by_limits<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let inertia = self.design.inertia(channel, v);
        // As the control is computed, so that rounding leaves nothing.
        let of_law = v[self.u_ad][channel] - v[self.feedback][channel];
        let wanted = self.added.map_or(of_law, |added| of_law + v[added.now][channel]) * inertia;
        (v[self.ports.u][channel] - wanted) / inertia
    }

    /// True if the control of a channel is not what it wants.
    pub(super) fn is_limited(&self, channel: usize, v: &Values<f64>) -> bool {
        self.added_by_limits(channel, v) != 0.0
    }

    /// 1/T_t of a channel. Unless given, T_t is 1/K, K being the sum of the magnitudes of its row, times the gain of
    /// the integrator in D(s): the response time of the controller to the limit. Other gains in force give other times.
    pub(super) fn tracking_rate<S: Scalar>(&self, channel: usize, K: DMatrixView<S>, v: &Values<S>) -> S {
        // The first state is the integral, and its rest that of an output of 1.
        rate(v[self.design.tracking_time][channel], K.row(channel).iter(), self.filter_at_rest[0])
    }

    /// f' = … + f_0 (u − u_wanted)/T_t in each channel.
    pub(super) fn track_limits<S: Scalar>(&self, K: DMatrixView<S>, v: &Values<S>, dx: &mut Rates<S>) {
        for i in 0..self.u_ad.len() {
            let added = self.added_by_limits(i, v);
            dx.when(!added.equals(S::from(0.0)), |dx| {
                let rate = added * self.tracking_rate(i, K, v);
                let states = dx[self.f].chunks_exact_mut(self.filter.order()).nth(i).into_iter().flatten();
                states.zip(self.filter_at_rest.iter()).for_each(|(f, &rest)| *f += rate * rest);
            });
        }
    }

    /// Reports the channels that have limits.
    pub(super) fn report_limits(&self, K: &DMatrix<f64>, v: &Values<f64>, report: &mut DesignReport) {
        let (u_min, u_max) = (&v[self.ports.u_min], &v[self.ports.u_max]);
        let together = self.ports.rotors.is_some_and(|rotors| rotors.is_on(v));
        let is_limited = |i: &usize| together || u_min[*i] > -UNLIMITED || u_max[*i] < UNLIMITED;
        let limited: Vec<_> = (0..u_min.len()).filter(is_limited).collect();
        if limited.is_empty() {
            return;
        }
        report.section("Limits of the control");
        for i in limited {
            let (name, rate) = (format!("T_t[{}]", i + 1), self.tracking_rate(i, K.as_view(), v));
            if rate > 0.0 {
                let note = format!("time constant with which {} tracks the limited control", self.name_of_u_ad(i, v));
                report.add(&name, 1.0 / rate, "s", &note);
            } else {
                let [u_ad, time] = [self.name_of_u_ad(i, v), v.name(self.design.tracking_time.at(i))];
                let note =
                    format!("{u_ad} winds up while the control is at its limit; {time} = {BY_GAIN} prevents this");
                report.judge(&name, "off", "s", Verdict::Warning, note);
            }
        }
    }
}
