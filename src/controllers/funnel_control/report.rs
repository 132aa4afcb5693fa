//! What a designer should know of a funnel controller: its bounds, how steep it is in the middle of them, and its limits.

use nalgebra::DMatrix;

use super::{Bounds, Errors, FunnelControl};
use crate::mathematics::limits::UNLIMITED;
use crate::mathematics::performance;
use crate::system::{DesignReport, Values, Verdict};

impl FunnelControl {
    pub(super) fn tell_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        report.section("Funnel");
        tell_bounds(&self.bounds, v, report);
        match &self.errors {
            Errors::Filtered { tau: Some(tau) } => {
                report.tell(&v.name(*tau), &row(&v[*tau]), "s", "in the middle the error decays with it");
            }
            Errors::Filtered { tau: None } => {}
            Errors::TwoFunnels { g_0, second } => {
                report.section("Funnel of the second error");
                tell_bounds(second, v, report);
                report.tell(&v.name(*g_0), &row(&v[*g_0]), "1/s", "in the middle the error decays at this rate");
            }
        }
        report.section("Gain");
        let note = "how much a channel asks for, over the last error in parts of its bound: in the middle of it, and ever \
                    more towards it";
        report.tell(&v.name(self.g), &row(&v[self.g]), "", note);
        let note =
            "the plant's input gain times it, plus its transpose, must be positive definite; nothing here can tell";
        report.tell(&v.name(self.G), &v.matrix(self.G).into_owned(), "", note);
        let is_limited = |j: &usize| v[self.u_min][*j] > -UNLIMITED || v[self.u_max][*j] < UNLIMITED;
        for j in (0..self.u.len()).filter(is_limited) {
            let note = "without limits the error stays in its funnel, whatever the plant is; with them only where they don't act";
            report.judge(&format!("limits of {}", v.name(self.u.at(j))), "given", "", Verdict::Warning, note);
        }
    }
}

fn tell_bounds(bounds: &Bounds, v: &Values<f64>, report: &mut DesignReport) {
    performance::report([bounds.start, bounds.end, bounds.decay_rate], v, report);
}

fn row(values: &[f64]) -> DMatrix<f64> {
    DMatrix::from_row_slice(1, values.len(), values)
}
