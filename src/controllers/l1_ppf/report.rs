//! Report of the barrier: its funnel, its stiffness, and its longest stable step.
#![allow(non_snake_case)] // R is the thesis' name

use nalgebra::DMatrix;

use super::L1Ppf;
use super::order::Order;
use crate::controllers::sampling::Evaluation;
use crate::mathematics::limits::UNLIMITED;
use crate::mathematics::performance::{Bounds, Performance};
use crate::report::{DIGITS, at_most, no_more, number};
use crate::system::{DesignReport, Values, Verdict};

/// Errors, in parts of the bound, at which the stiffness is reported.
const PLACES: [f64; 3] = [0.0, 0.57, 0.9];

impl L1Ppf {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        report.section("Funnel");
        self.funnel.report(v, report);
        let guarantee = "the error stays inside";
        let has_limits = v[self.ports.u_min].iter().any(|&limit| limit > -UNLIMITED)
            || v[self.ports.u_max].iter().any(|&limit| limit < UNLIMITED);
        let (what, note) = match self.order {
            _ if v[self.barrier_gain].contains(&0.0) => ("not proven", "without a barrier the error is not confined"),
            Order::Second { .. } => ("not proven", "for relative degree 2 it was only simulated"),
            Order::First { .. } if !self.law.has_baseline_outside() => {
                ("not proven", "the proof applies to the baseline outside only")
            }
            Order::First { .. } if has_limits => {
                ("proven", "while no control is at its limit, and for an input gain that is diagonal and positive")
            }
            Order::First { .. } => ("proven", "for an input gain that is diagonal and positive"),
        };
        report.add(guarantee, what, "", note);
        self.report_barrier(v, report);
    }

    fn report_barrier(&self, v: &Values<f64>, report: &mut DesignReport) {
        report.section("Barrier");
        let row =
            |place: f64| DMatrix::from_fn(1, self.barrier_gain.len(), |_, i| self.stiffness_in_the_end(i, place, v));
        let what = match self.order {
            Order::First { .. } => "rate at which it brings the error back",
            Order::Second { .. } => "rate at which it brings the error's rate back",
        };
        for place in PLACES {
            let note = format!("{what} at {place} of the final bound, with the nominal input gain");
            report.add(&format!("stiffness at {place}"), &row(place), "1/s", &note);
        }
        if report.step > 0.0 {
            self.report_step(row(0.0).max(), v, report);
        }
    }

    /// Reports the step of an FMU that is stepped by itself.
    fn report_step(&self, stiffness: f64, v: &Values<f64>, report: &mut DesignReport) {
        let name = "longest step in the middle";
        if stiffness == 0.0 {
            report.add_unlimited(name, "s", "there is no barrier");
            return;
        }
        let (longest, of_gain) = (1.0 / stiffness, v.name(self.barrier_gain));
        if self.samples.is_some() && !v.get(self.evaluation).is(Evaluation::Continuous) {
            let note = "1/stiffness in the middle; in co-simulation the barrier is sampled, which allows longer steps";
            report.add(name, no_more(longest, DIGITS), "s", note);
            return;
        }
        if report.step <= longest {
            let note =
                "1/stiffness in the middle; 2/stiffness if the plant is stepped first. It is shorter near the bounds";
            report.add(name, no_more(longest, DIGITS), "s", note);
            return;
        }
        let sampled =
            if self.samples.is_some() { format!("{} = sampled, ", v.name(self.evaluation)) } else { String::new() };
        let note = format!(
            "shorter than the default step, {} s: use at most this step, {sampled}{of_gain} times {}, or the loop as \
             a single FMU",
            number(report.step),
            at_most(longest / report.step)
        );
        report.judge(name, no_more(longest, DIGITS), "s", Verdict::Warning, note);
    }

    /// The stiffness of a channel at an error of this part of the bound in the end.
    fn stiffness_in_the_end(&self, i: usize, place: f64, v: &Values<f64>) -> f64 {
        let rho = self.funnel.narrowest(i, v);
        let bounds = Bounds { lower: 1.0, upper: 1.0 };
        let performance = Performance { rho, rate: 0.0, second_rate: 0.0 };
        let (epsilon, R) = (bounds.transformed(place), bounds.slope(place) / rho);
        let inside = super::Inside { e: place * rho, performance, bounds, z: place, epsilon, R };
        self.stiffness_of(i, &inside, v)
    }
}
