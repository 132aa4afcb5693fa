//! What a designer should know of a robust MRAC law.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::MracPpf;
use crate::controllers::sampling::Evaluation;
use crate::report::{DIGITS, no_more, number};
use crate::system::{DesignReport, Values, Verdict};

impl MracPpf {
    pub(super) fn tell_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        let A_m = v.matrix(self.A_m).into_owned();
        report.section("Reference model");
        report.eigenvalues(&format!("eigenvalues of {}", v.name(self.A_m)), &A_m, true);
        report.eigenvalues("eigenvalues of A", &self.A, false);
        // B⁺ has the rank of B, which the description is refused without.
        let rank = self.B_inverse.rank(1e-9 * self.B_inverse.amax());
        report.tell("rank of B", rank as f64, "", "each state has its own control");
        report.tell("k_g", &(-&self.B_inverse * &A_m), "", "gain of the reference, B k_g = -A_m");
        report.section("Funnel");
        self.funnel.report(v, report);
        if report.step > 0.0 {
            self.tell_step(v, report);
        }
    }

    fn tell_step(&self, v: &Values<f64>, report: &mut DesignReport) {
        let (longest, is_sampled) = (self.longest_step(v), !v.get(self.law).is(Evaluation::Continuous));
        report.section("Communication step");
        let note = "decay rate of the error under the continuous control law, with a plant input gain of 1";
        report.tell("s", self.decay(v), "1/s", note);
        let name = "longest step of the continuous law";
        if longest == f64::INFINITY {
            report.tell_unlimited(name, "s", "the control law does not act on the error");
        } else if is_sampled {
            report.tell(
                name,
                no_more(longest, DIGITS),
                "s",
                "1/s; in co-simulation the control law is sampled, which allows longer steps",
            );
        } else if report.step <= longest {
            report.tell(name, no_more(longest, DIGITS), "s", "1/s; 2/s if the plant is stepped first");
        } else {
            let note = format!(
                "shorter than the default step, {} s: use at most this step, {} = sampled, or the loop as a single FMU",
                number(report.step),
                v.name(self.law)
            );
            report.judge(name, no_more(longest, DIGITS), "s", Verdict::Warning, note);
        }
    }
}
