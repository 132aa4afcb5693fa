//! Report of an MRAC for unmatched uncertainty.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;

use super::MracPpfUnmatched;
use super::structure::Driven;
use crate::report::{DIGITS, at_most, no_more, number};
use crate::system::{DesignReport, Values, Verdict};

/// Least ratio of the speed of a driving state's barrier to the adaptation of its unmatched row.
const FASTER: f64 = 3.0;

impl MracPpfUnmatched {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        let A_m = v.matrix(self.A_m).into_owned();
        report.section("Reference model");
        report.eigenvalues(&format!("eigenvalues of {}", v.name(self.A_m)), &A_m, true);
        report.eigenvalues("eigenvalues of A", &self.plant.A, false);
        report.add(&v.name(self.K_g), &v.matrix(self.K_g).into_owned(), "", "gain of the reference");
        report.section("Funnel");
        self.funnel.report(v, report);
        report.section("Input gain");
        let sizes = self.plant.inverse.singular_values();
        let note = "the proof covers any input gain B (I + D) if the largest singular value of D is below this";
        report.add("error of the input gain", sizes.min() / sizes.max(), "", note);
        self.report_noise(v, report);
        self.origins.iter().for_each(|origins| origins.report(self.x, v, report));
        for &driven in &self.plant.unmatched {
            self.report_unmatched(driven, v, report);
        }
        self.report_limits(v, report);
        if report.step > 0.0 {
            self.report_step(v, report);
        }
    }

    /// Drift of θ̂ due to noise of x.
    fn report_noise(&self, v: &Values<f64>, report: &mut DesignReport) {
        let [bound, leakage] = [self.theta_bound, self.theta_leakage].map(|it| v.name(it));
        let leaks = &v[self.theta_leakage];
        report.section("Estimates");
        if leaks.iter().all(|&leaks| leaks > 0.0) {
            let note = format!("mean of theta_hat with {leakage}, times the standard deviation of the noise of x");
            // s² over s √(2/π), the mean magnitude of what is normally distributed.
            let bias = DMatrix::from_fn(1, leaks.len(), |_, i| (0.5 * std::f64::consts::PI).sqrt() / leaks[i]);
            report.add("bias of theta_hat by noise", &bias, "", &note);
        } else {
            let helps = format!("Use {leakage} above 0, or a small {bound}, where x is measured with noise");
            let note = format!("noise of x drives theta_hat on and on, until {bound} stops it. {helps}");
            report.add("drift of theta_hat by noise", "bounded", "", &note);
        }
    }

    /// The rule for the gains of an unmatched row: √(γ (1 + |x|²))/ρ_∞ below a third of the barrier's rate.
    fn report_unmatched(&self, Driven { row, by }: Driven, v: &Values<f64>, report: &mut DesignReport) {
        let [gamma, K, end] = [v.name(self.gamma.at(row)), v.name(self.K_epsilon.at(by)), self.funnel.name_of_end(v)];
        let (x_row, x_by) = (v.name(self.x.at(row)), v.name(self.x.at(by)));
        report.section(&format!("Unmatched row {}, driven by state {}", row + 1, by + 1));
        let rate = self.barrier_rate(by, v);
        report.add("rate of the barrier", rate, "1/s", &format!("{K} divided by the square of {end} of {x_by}"));
        let adaptation = v[self.gamma][row].sqrt() / self.funnel.narrowest(row, v);
        report.add(
            "rate of the adaptation at x = 0",
            adaptation,
            "1/s",
            &format!("square root of {gamma} divided by {end} of {x_row}"),
        );
        let name = format!("largest |x| for {gamma}");
        let room = (rate / (FASTER * adaptation)).powi(2);
        if adaptation == 0.0 {
            report.add_unlimited(&name, "", "nothing of this row is estimated");
        } else if room > 1.0 {
            let note = "2-norm up to which the adaptation stays below a third of the barrier's rate; above it the \
                loop oscillates";
            report.add(&name, (room - 1.0).sqrt(), "", note);
        } else {
            let note = format!(
                "the adaptation must stay below a third of the barrier's rate, otherwise the loop oscillates or \
                 diverges: use {gamma} below {}, or a larger {K}",
                at_most((rate * self.funnel.narrowest(row, v) / FASTER).powi(2))
            );
            report.judge(&name, 0.0, "", Verdict::Warning, note);
        }
        let (entry, theta) = (self.plant.A[(row, by)], v.name(self.theta_hat.at(by, row)));
        let side = if entry > 0.0 { "above" } else { "below" };
        let note =
            format!("the proof requires {theta} to stay {side} this, otherwise the virtual control reverses {x_by}");
        report.add(&format!("bound of {theta}"), -entry, "", &note);
    }

    fn report_limits(&self, v: &Values<f64>, report: &mut DesignReport) {
        use crate::mathematics::limits::UNLIMITED;
        report.section("Limits");
        let is_limited = |k: &usize| v[self.u_min][*k] > -UNLIMITED || v[self.u_max][*k] < UNLIMITED;
        for k in (0..self.u.len()).filter(is_limited) {
            let note = "the errors are guaranteed to stay in their funnels only while no control is at its limit";
            report.judge(&format!("limits of {}", v.name(self.u.at(k))), "given", "", Verdict::Warning, note);
        }
    }

    fn report_step(&self, v: &Values<f64>, report: &mut DesignReport) {
        let stiffness = self.stiffness(v);
        report.section("Communication step");
        let note = "fastest rate at which a barrier brings an error back, where its funnel is narrowest";
        report.add("s", stiffness, "1/s", note);
        let (name, longest) = ("longest step", 1.0 / stiffness);
        if report.step <= longest {
            report.add(name, no_more(longest, DIGITS), "s", "1/s; 2/s if the plant is stepped first");
        } else {
            let step = number(report.step);
            let note =
                format!("shorter than the default step, {step} s: use at most this step, or the loop as a single FMU");
            report.judge(name, no_more(longest, DIGITS), "s", Verdict::Warning, note);
        }
    }
}
