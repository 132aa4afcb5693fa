//! Report of a neuro-adaptive controller.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;

use super::NeuroPpf;
use super::order::Order;
use crate::report::at_most;
use crate::system::{DesignReport, Values, Verdict};

impl NeuroPpf {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        report.section("Error dynamics");
        match self.order {
            Order::First { A_m, .. } => {
                report.eigenvalues(&format!("eigenvalues of {}", v.name(A_m)), &v.matrix(A_m).into_owned(), true);
            }
            Order::Second { lambda, .. } => {
                let note = format!("where E = epsilon' + {} epsilon is zero", v.name(lambda));
                let lambda = DMatrix::from_row_slice(1, v[lambda].len(), &v[lambda]);
                report.add("decay of epsilon", &lambda, "1/s", &note);
            }
        }
        self.report_rates(v, report);
        report.section("Networks");
        let (neurons, channels) = (self.network.neurons() as f64, self.r.len() as f64);
        report.add("neurons", neurons, "", "sigmoids in the common layer, with fixed weights");
        report.add("inputs", self.network.width() as f64, "", "of each neuron");
        let gains = if self.input_gain.is_some() { channels * channels } else { 0.0 };
        report.add("adapted weights", neurons * (channels + gains), "", "each of them a state");
        let leak = v[self.network_gain] * v[self.sigma];
        let (gain, sigma) = (v.name(self.network_gain), v.name(self.sigma));
        let note = format!("rate at which unexcited weights decay, {gain} {sigma}");
        report.add("leakage", leak, "1/s", &note);
        self.report_bound(v, report);
        if let Some(input_gain) = &self.input_gain {
            input_gain.report(v, report);
        }
        report.section("Funnel");
        self.funnel.report(v, report);
    }

    /// Reports the bound of the weights: 0 < Z < 1, and the leakage is constant.
    fn report_bound(&self, v: &Values<f64>, report: &mut DesignReport) {
        let (sigma, name) = (v[self.sigma], "largest weight for |R E| = 1");
        if sigma > 0.0 {
            let note = format!(
                "1/{}: noise biases the weights, at most by this times the mean of |R E|, and they do not drift",
                v.name(self.sigma)
            );
            return report.add(name, 1.0 / sigma, "", &note);
        }
        let sigma = v.name(self.sigma);
        let note = format!(
            "{sigma} is 0: nothing bounds the weights, and noise may drive them on and on. Use {sigma} above 0"
        );
        report.judge(name, "infinite", "", Verdict::Warning, note);
    }

    /// E' = −(k + n_f R²) E where the networks are right, with R = 1/ρ in the middle of a symmetric funnel.
    fn report_rates(&self, v: &Values<f64>, report: &mut DesignReport) {
        let (k, n_f) = (v[self.k], v[self.n_f]);
        let [name_of_k, name_of_n_f] = [self.k, self.n_f].map(|gain| v.name(gain));
        let narrowest = (0..self.r.len()).map(|i| self.funnel.narrowest(i, v)).fold(f64::INFINITY, f64::min);
        if k > 0.0 {
            let note = format!("{name_of_k}, if the networks are exact");
            report.add("least decay of E", k, "1/s", &note);
        } else {
            let note =
                format!("{name_of_k} is 0: the rest of E decays only through {name_of_n_f}. Use {name_of_k} above 0");
            report.judge("least decay of E", k, "1/s", Verdict::Warning, note);
        }
        let end = k + n_f / (narrowest * narrowest);
        let note = format!(
            "{name_of_k} + {name_of_n_f}/{}²; a sampled controller needs steps well below its inverse, {} s, or the \
             loop as a single FMU",
            self.funnel.name_of_end(v),
            at_most(1.0 / end)
        );
        if report.step * end < 1.0 {
            report.add("decay of E in the narrow funnel", end, "1/s", &note);
        } else {
            report.judge("decay of E in the narrow funnel", end, "1/s", Verdict::Warning, note);
        }
    }
}
