//! Design report of a plain MRAC: its reference model, how fast estimates and plant oscillate, and which dead time and step that
//! tolerates.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use super::Mrac;
use crate::controllers::l1::{Regressor, controllability};
use crate::eigenvalues;
use crate::report::{DIGITS, at_most, no_more, number};
use crate::system::{DesignReport, Values, Verdict};

/// Ratio of the adaptation's frequency to the desired dynamics up to which there is no warning.
const FAST: f64 = 30.0;

impl Mrac {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        let design = &self.design;
        let (A_m, of_A_m) = (design.dynamics.A_m(v).into_owned(), design.dynamics.name_of_A_m(v));
        report.section("Reference model");
        report.eigenvalues(&format!("eigenvalues of {of_A_m}"), &A_m, true);
        if let (Some(A), Some(K_m)) = (&self.plant.A, design.dynamics.gain()) {
            report.eigenvalues("eigenvalues of A", A, false);
            controllability(["controllability", "A", "B"], [A, &self.plant.B], report);
            report.add(&v.name(K_m), &v.matrix(K_m).into_owned(), "", "gain of the baseline");
        } else {
            controllability(["controllability", &of_A_m, "B"], [&A_m, &self.plant.B], report);
        }
        report.add(&v.name(design.K_g), &v.matrix(design.K_g).into_owned(), "", "gain of the reference");
        let R = self.references(report);
        let frequency = self.frequency_for(&R, v);
        self.report_adaptation(&A_m, (frequency, &R), v, report);
        self.report_noise(v, report);
        self.origins.iter().for_each(|origins| origins.report(self.x, v, report));
        if report.step > 0.0 {
            self.report_step(frequency, v, report);
        }
    }

    /// Usual magnitudes of the references: those of the description, else 1.
    fn references(&self, report: &DesignReport) -> DVector<f64> {
        let known = report.nominal().and_then(|nominal| nominal.reference.clone());
        let m = self.u.len();
        known.filter(|known| known.len() == m).map_or_else(|| DVector::from_element(m, 1.0), DVector::from_vec)
    }

    /// ω_a for a step of all references by these: |u_b| at its start or in the end, φ(x) in the end.
    fn frequency_for(&self, R: &DVector<f64>, v: &Values<f64>) -> f64 {
        let command = v.matrix(self.design.K_g) * R;
        let x = v.matrix(self.design.at_rest) * &command;
        let feedback = self.design.dynamics.gain().map(|K_m| v.matrix(K_m) * &x);
        let in_the_end = feedback.map_or(0.0, |feedback| (&command - feedback).norm_squared());
        let phi = match self.regressor {
            Regressor::InfinityNorm => x.amax().powi(2),
            Regressor::State => {
                let scaled = |(j, x): (usize, &f64)| (x * self.regressor_gains.get(j).unwrap_or(&1.0)).powi(2);
                x.iter().enumerate().map(scaled).sum()
            }
        };
        self.design.frequency(command.norm_squared().max(in_the_end) + phi + 1.0, v)
    }

    fn report_adaptation(
        &self,
        A_m: &DMatrix<f64>,
        (frequency, R): (f64, &DVector<f64>),
        v: &Values<f64>,
        report: &mut DesignReport,
    ) {
        let gain = v.name(self.design.adaptation_gain);
        report.section("Adaptation");
        report.add("frequency at rest", self.design.frequency(1.0, v), "rad/s", "with control and state at zero");
        let slowest = || eigenvalues::complex(A_m)?.iter().map(|pole| pole.norm()).reduce(f64::min);
        let bandwidth =
            report.nominal().and_then(|nominal| nominal.bandwidth).or_else(slowest).unwrap_or(f64::INFINITY);
        let references = R.iter().map(|&R| number(R)).collect::<Vec<_>>().join(", ");
        let name = format!("frequency with references of {references}");
        let most = FAST * bandwidth;
        if frequency <= most {
            let note = format!("at most {} times the bandwidth, {} rad/s", number(FAST), number(bandwidth));
            report.add(&name, frequency, "rad/s", &note);
        } else {
            let reason = "no filter is between adaptation and control, and the tolerated dead time falls as 1/";
            let advised = at_most(v[self.design.adaptation_gain] * (most / frequency).powi(2));
            let [times, bandwidth] = [FAST, bandwidth].map(number);
            let note = format!("more than {times} times the bandwidth, {bandwidth} rad/s: {reason}{gain}");
            let note = format!("{note}. Use {gain} = {advised} or less, or an L1 controller");
            report.judge(&name, frequency, "rad/s", Verdict::Warning, note);
        }
        let note =
            "about as long a dead time the oscillation of estimates and plant tolerates; longer ones make it chatter";
        report.add("tolerated dead time", self.design.dead_time(frequency, v), "s", note);
    }

    fn report_noise(&self, v: &Values<f64>, report: &mut DesignReport) {
        let leakage = v.name(self.design.leakage);
        if v[self.design.leakage] == 0.0 {
            let note = "noise of x drives the estimates on and on, until their bounds stop them";
            let note = format!("{note}. Use {leakage} above 0, or narrow bounds, where x is measured with noise");
            report.add("drift of estimates by noise", "bounded", "", &note);
        } else {
            let note = format!("the estimates leak with {leakage} |e|, which noise keeps above 0");
            report.add("drift of estimates by noise", "none", "", &note);
        }
    }

    fn report_step(&self, frequency: f64, v: &Values<f64>, report: &mut DesignReport) {
        let [first, at_once] = self.design.longest_steps(frequency, v);
        report.section("Communication step");
        report.add("longest step, plant stepped first", no_more(first, DIGITS), "s", "0.2 rad of the oscillation");
        let name = "longest step";
        let of = "half of the tolerated dead time: any order of components";
        if report.step <= at_once {
            report.add(name, no_more(at_once, DIGITS), "s", of);
        } else if report.step <= first {
            let note =
                format!("{of}. The default step, {} s, requires that the plant is stepped first", number(report.step));
            report.add(name, no_more(at_once, DIGITS), "s", &note);
        } else {
            let [step, first] = [number(report.step), at_most(first)];
            let gain = v.name(self.design.adaptation_gain);
            let note = format!("shorter than the default step, {step} s: use at most {first} s, a smaller {gain}");
            let note = format!("{note}, or the loop as a single FMU");
            report.judge(name, no_more(at_once, DIGITS), "s", Verdict::Warning, note);
        }
    }
}
