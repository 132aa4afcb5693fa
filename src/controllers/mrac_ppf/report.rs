//! Design report of a robust MRAC.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;

use super::MracPpf;
use crate::controllers::sampling::Evaluation;
use crate::report::{DIGITS, no_more, number};
use crate::system::{DesignReport, Values, Verdict};

impl MracPpf {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        let A_m = v.matrix(self.A_m).into_owned();
        report.section("Reference model");
        report.eigenvalues(&format!("eigenvalues of {}", v.name(self.A_m)), &A_m, true);
        report.eigenvalues("eigenvalues of A", &self.A, false);
        // B⁺ has the rank of B, which the description is refused without.
        let rank = self.B_inverse.rank(1e-9 * self.B_inverse.amax());
        report.add("rank of B", rank as f64, "", "each state has its own control");
        report.add("k_g", &(-&self.B_inverse * &A_m), "", "gain of the reference, B k_g = -A_m");
        report.section("Funnel");
        self.funnel.report(v, report);
        self.report_estimates(v, report);
        self.origins.iter().for_each(|origins| origins.report(self.x, v, report));
        if report.step > 0.0 {
            self.report_step(v, report);
        }
    }

    /// The bounds of θ̂, and where noise of x takes it.
    fn report_estimates(&self, v: &Values<f64>, report: &mut DesignReport) {
        let [bound, leakage] = [self.bounded.theta_bound, self.bounded.theta_leakage].map(|it| v.name(it));
        let row = |value: &dyn Fn(usize) -> f64| DMatrix::from_fn(1, self.x.len(), |_, i| value(i));
        report.section("Estimates");
        let tolerance = v.name(self.bounded.projection_tolerance);
        let note =
            format!("bound of theta_hat. The proof needs a theta of at most this divided by sqrt(1 + {tolerance})");
        report.add(&bound, &row(&|i| v[self.bounded.theta_bound][i]), "", &note);
        let leaks = |i: usize| v[self.bounded.theta_leakage][i];
        if (0..self.x.len()).all(|i| leaks(i) > 0.0) {
            let note = format!("mean of theta_hat with {leakage}, times the standard deviation of the noise of x");
            // s² over s √(2/π), the mean magnitude of what is normally distributed.
            let bias = row(&|i| (0.5 * std::f64::consts::PI).sqrt() / leaks(i));
            return report.add("bias of theta_hat by noise", &bias, "", &note);
        }
        let helps = format!(
            "Use {leakage} above 0 (`new` writes 0.05 R/W), or a small {bound}, where x is measured with noise"
        );
        if report.step > 0.0 && !v.get(self.law).is(Evaluation::Continuous) {
            let note = format!("times the variance of the noise of x, about, until {bound} stops it. {helps}");
            report.add("drift of theta_hat by noise", &row(&|i| self.drift(i, report.step, v)), "1/s", &note);
        } else {
            let note = format!("noise of x drives theta_hat on and on, until {bound} stops it. {helps}");
            report.add("drift of theta_hat by noise", "bounded", "", &note);
        }
    }

    /// Rate at which noise of x drives an element of θ̂ of the sampled controller, in parts of its variance: ε and the
    /// regressor have the same noise. Valid for a narrow funnel and a small ε.
    fn drift(&self, i: usize, step: f64, v: &Values<f64>) -> f64 {
        let asked = v[self.samples.sampling.sample_time];
        let period = if asked > 0.0 { asked } else { step };
        let h = period * f64::from(v.get(self.prediction_steps));
        let rho = self.funnel.narrowest(i, v);
        let psi: f64 = v[self.psi].iter().map(|psi| psi * psi).sum();
        let gain = psi * v[self.gamma_2][i] * (v[self.beta][i] + h / rho)
            + v[self.alpha_bar][i] / v[self.switching_width]
            + v[self.K_epsilon][i];
        let rate = if v[self.bounded.theta_leakage][i] > 0.0 { 0.0 } else { v[self.gamma_1][i] };
        rate / (rho * (rho + h * gain))
    }

    fn report_step(&self, v: &Values<f64>, report: &mut DesignReport) {
        let (longest, is_sampled) = (self.longest_step(v), !v.get(self.law).is(Evaluation::Continuous));
        report.section("Communication step");
        let note = "decay rate of the error under the continuous control law, with a plant input gain of 1";
        report.add("s", self.decay(v), "1/s", note);
        let name = "longest step of the continuous law";
        if longest == f64::INFINITY {
            report.add_unlimited(name, "s", "the control law does not act on the error");
        } else if is_sampled {
            report.add(
                name,
                no_more(longest, DIGITS),
                "s",
                "1/s; in co-simulation the control law is sampled, which allows longer steps",
            );
        } else if report.step <= longest {
            report.add(name, no_more(longest, DIGITS), "s", "1/s; 2/s if the plant is stepped first");
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
