//! Report of an active disturbance rejection controller: its bandwidths, the delay margin of its nominal loop, and the
//! communication step.
#![allow(non_snake_case)] // matrices have the names of the field

use std::f64::consts::PI;

use nalgebra::{Complex, DMatrix, DVector};

use super::{BY_CONTROLLER, Ladrc, binomial};
use crate::controllers::at_limit::unit;
use crate::design;
use crate::design::controller::Controller;
use crate::design::ladrc::Gains;
use crate::design::robustness::feedback;
use crate::design::robustness::linear::OutputFeedback;
use crate::design::robustness::report::Described;
use crate::design::search::Law as _;
use crate::report::{DIGITS, no_more, number};
use crate::system::{DesignReport, Values, Verdict};

/// Ratio of the observer's bandwidth to the loop's that should be reached.
const APART: f64 = 3.0;
/// ω_o H up to which a step is short for an observer.
const SHORT: f64 = 0.5;
/// Points of the grid of frequencies in a decade, and the decades about the bandwidths.
const PER_DECADE: f64 = 200.0;
const DECADES: f64 = 2.0;

impl Ladrc {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_loop(v, report);
        for i in 0..self.u.len() {
            report.section(&format!("Channel {}", i + 1));
            let (omega_c, omega_o) = (v[self.omega_c][i], v[self.omega_o_in_force][i]);
            let [of_c, of_o] = [v.name(self.omega_c.at(i)), v.name(self.omega_o_in_force.at(i))];
            let poles = format!("of the nominal loop, {} poles at -{of_c}", self.order);
            report.add(&of_c, omega_c, "rad/s", &poles);
            let poles = format!("of the observer, {} poles at -{of_o}", self.order + 1);
            if omega_o < APART * omega_c {
                let given = v.name(self.omega_o.at(i));
                let note = format!(
                    "{poles}: hardly faster than the loop, which then moves otherwise; {given} = {BY_CONTROLLER} makes it \
                     ten times as fast"
                );
                report.judge(&of_o, omega_o, "rad/s", Verdict::Warning, note);
            } else {
                report.add(&of_o, omega_o, "rad/s", &poles);
            }
            self.report_delay(i, [omega_c, omega_o], v, report);
            // Within a composite, no signal is sampled.
            if report.step > 0.0 {
                report_step(&of_o, omega_o, report);
            }
        }
        let B_0 = v.matrix(self.B_0).into_owned();
        report.section("Input gain");
        let note = "gain from the control to the last derivatives; its error is rejected like any disturbance";
        report.add(&v.name(self.B_0), &B_0, "", note);
    }

    /// The loop with the plant of the description, whose references' derivatives aren't given.
    fn report_loop(&self, v: &Values<f64>, report: &mut DesignReport) {
        let (m, order) = (self.u.len(), self.order);
        let gains =
            |i: usize| Gains { order, omega_c: v[self.omega_c][i], omega_o: v[self.omega_o_in_force][i], b_0: 1.0 };
        let (gains, S): (Vec<_>, _) = ((0..m).map(gains).collect(), v.matrix(self.B_0_inverse).into_owned());
        let law = |described: &Described| {
            let W = described.plant.bandwidth;
            let channels: Vec<_> = gains.iter().map(|gains| design::ladrc::Ladrc::controller(gains, W)).collect();
            OutputFeedback {
                controller: Controller::of_channels(&channels, &S),
                entry: design::ladrc::entry(&gains, &S, W),
                C: described.plant.C.clone(),
            }
        };
        let unit = unit(self.u, [self.u_min, self.u_max], v, report.step);
        feedback::report_robustness(m, law, &unit, report);
    }

    /// The delay margin of the loop of a nominal chain of integrators at its input.
    fn report_delay(&self, i: usize, bandwidths: [f64; 2], v: &Values<f64>, report: &mut DesignReport) {
        let note = format!("at {}, of a loop with a chain of {} integrators", v.name(self.u.at(i)), self.order);
        match delay_margin(self.order, bandwidths) {
            Some(delay) if delay > 1.5 * report.step => report.add("delay margin", delay, "s", &note),
            Some(delay) => {
                let lag = number(1.5 * report.step);
                let note = format!("{note}. Sampling by itself may delay by {lag} s, 1.5 communication steps");
                report.judge("delay margin", delay, "s", Verdict::Warning, note);
            }
            None => report.add_unlimited("delay margin", "s", "the loop's gain is nowhere 1"),
        }
    }
}

fn report_step(of_o: &str, omega_o: f64, report: &mut DesignReport) {
    let (H, longest) = (report.step, SHORT / omega_o);
    let name = format!("longest step for {of_o}");
    if H <= longest {
        report.add(&name, no_more(longest, DIGITS), "s", "beyond it, the observer gets too few samples");
        return;
    }
    let note = format!("shorter than the default step, {} s: the observer gets too few samples", number(H));
    report.judge(&name, no_more(longest, DIGITS), "s", Verdict::Warning, note);
}

/// The least delay by which the loop of y^(n) = u becomes unstable; nothing where its gain is nowhere 1.
fn delay_margin(n: usize, [omega_c, omega_o]: [f64; 2]) -> Option<f64> {
    let size = n + 1;
    // z' = A z + L y with the control u = −k z in it.
    let mut A = DMatrix::<f64>::zeros(size, size);
    let mut L = DVector::<f64>::zeros(size);
    let k = DVector::from_fn(size, |i, _| if i < n { binomial(n, i) * omega_c.powi((n - i) as i32) } else { 1.0 });
    for i in 0..size {
        L[i] = binomial(size, i + 1) * omega_o.powi(i as i32 + 1);
        A[(i, 0)] -= L[i];
        if i + 1 < size {
            A[(i, i + 1)] += 1.0;
        }
        A[(n - 1, i)] -= k[i];
    }
    let gain = |w: f64| {
        let s = Complex::new(0.0, w);
        let shifted = DMatrix::identity(size, size) * s - A.map(Complex::from);
        let z = shifted.lu().solve(&L.map(Complex::from))?;
        Some(k.map(Complex::from).dot(&z) / s.powi(n as i32))
    };
    let first = omega_c.min(omega_o).log10() - DECADES;
    let points = ((omega_c.max(omega_o).log10() + DECADES - first) * PER_DECADE) as usize;
    let grid = (0..=points).map(|p| 10_f64.powf(first + p as f64 / PER_DECADE));
    let values: Vec<_> = grid.map(|w| Some((w, gain(w)?))).collect::<Option<_>>()?;
    let crossings = values.windows(2).filter(|pair| (pair[0].1.norm() - 1.0) * (pair[1].1.norm() - 1.0) <= 0.0);
    let delays = crossings.map(|pair| {
        let ((w, one), (_, other)) = (pair[0], pair[1]);
        let part = (1.0 - one.norm()) / (other.norm() - one.norm());
        // What lag is left until −1.
        let phase = (one.arg() + PI).rem_euclid(2.0 * PI);
        phase / (w * (1.0 + part * (10_f64.powf(1.0 / PER_DECADE) - 1.0)))
    });
    delays.reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use super::delay_margin;

    /// Only the bandwidths set the time.
    #[test]
    fn a_loop_that_is_twice_as_fast_tolerates_half_the_delay() {
        for (n, bandwidths) in [(1, [4.0, 40.0]), (2, [8.0, 80.0]), (3, [10.0, 100.0]), (2, [8.0, 30.0])] {
            let delay = delay_margin(n, bandwidths).unwrap();
            assert!(delay > 0.0 && delay < 1.0 / bandwidths[0], "{n}: {delay}");
            let faster = delay_margin(n, bandwidths.map(|w| 2.0 * w)).unwrap();
            assert!((faster / delay - 0.5).abs() < 1e-3, "{n}: {delay}, {faster}");
        }
    }
}
