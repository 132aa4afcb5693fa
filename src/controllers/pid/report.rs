//! Report of a PID controller: the effect of its filter on noise and on the derivative, and the time in which it leaves
//! a limit.
#![allow(non_snake_case)] // gains have the names of the field

use super::{BY_GAINS, Pid};
use crate::controllers::at_limit::unit;
use crate::design;
use crate::design::controller::Controller;
use crate::design::pid::Gains;
use crate::design::robustness::feedback;
use crate::design::robustness::linear::OutputFeedback;
use crate::design::robustness::report::Described;
use crate::design::search::Law as _;
use crate::mathematics::limits::UNLIMITED;
use crate::report::{at_least, at_most, number};
use crate::system::{DesignReport, Values, Verdict};

/// Least part of the derivative that should remain at the end of a step.
const LEAST_REMAINING: f64 = 0.8;
/// N H at which so much is left.
const LONGEST: f64 = 0.43;
/// Least ratio of the filter's rate to K_p/K_d, from which on the derivative acts.
const APART: f64 = 2.0;

impl Pid {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_loop(v, report);
        for i in 0..self.I.len() {
            report.section(&format!("Channel {}", i + 1));
            self.report_derivative(i, v, report);
            self.report_limits(i, v, report);
        }
    }

    /// The loop with the plant of the description.
    fn report_loop(&self, v: &Values<f64>, report: &mut DesignReport) {
        let m = self.I.len();
        let gains = |i: usize| Gains { K_p: v[self.K_p][i], K_i: v[self.K_i][i], K_d: v[self.K_d][i], N: v[self.N][i] };
        let (gains, S): (Vec<_>, _) = ((0..m).map(gains).collect(), v.matrix(self.S).into_owned());
        let weights: Vec<_> = (0..m).map(|i| [v[self.b][i], v[self.c][i]]).collect();
        let law = |described: &Described| {
            let W = described.plant.bandwidth;
            let channels: Vec<_> = gains.iter().map(|gains| design::pid::Pid::controller(gains, W)).collect();
            OutputFeedback {
                controller: Controller::of_channels(&channels, &S),
                entry: design::pid::entry(&gains, &weights, &S, W),
                C: described.plant.C.clone(),
            }
        };
        let unit = unit(self.u, [self.u_min, self.u_max], v, report.step);
        feedback::report_robustness(m, law, &unit, report);
    }

    fn report_derivative(&self, i: usize, v: &Values<f64>, report: &mut DesignReport) {
        let [K_p, K_d, N] = [self.K_p, self.K_d, self.N].map(|parameter| v[parameter][i]);
        let [of_K_p, of_K_d, of_N] = [self.K_p, self.K_d, self.N].map(|parameter| v.name(parameter.at(i)));
        let note = format!("{of_K_p} + {of_K_d} {of_N}, from measurement noise in {}", v.name(self.y.at(i)));
        report.add("gain at high frequencies", K_p + K_d * N, "", &note);
        if K_d == 0.0 {
            return;
        }
        let note = format!("of {of_K_p} and {of_K_d}: the derivative acts from there up to {of_N}");
        if N < APART * K_p / K_d {
            let least = at_least(APART * K_p / K_d);
            let note = format!("{note}, which leaves it hardly any effect. Choose {of_N} of {least} rad/s or more");
            report.judge("corner frequency", K_p / K_d, "rad/s", Verdict::Warning, note);
        } else {
            report.add("corner frequency", K_p / K_d, "rad/s", &note);
        }
        // Within a composite, no signal is sampled.
        if report.step > 0.0 {
            self.report_sampled_derivative(i, v, report);
        }
    }

    fn report_sampled_derivative(&self, i: usize, v: &Values<f64>, report: &mut DesignReport) {
        let (N, H, remaining) = (v[self.N][i], report.step, remaining_part(v[self.N][i] * report.step));
        let (of_D, of_N) = (v.name(self.D.at(i)), v.name(self.N.at(i)));
        let note = format!("part of {of_D} that is left at the end of a communication step of {} s", number(H));
        if remaining >= LEAST_REMAINING {
            report.add("sampled derivative", remaining, "", &note);
            return;
        }
        let (step, rate) = (at_most(LONGEST / N), at_most(LONGEST / H));
        let note = format!(
            "{note} with a constant output. A step of {step} s or less, or {of_N} of {rate} rad/s or less, \
             leaves {LEAST_REMAINING}; input_handling = interpolate leaves all of it"
        );
        report.judge("sampled derivative", remaining, "", Verdict::Warning, note);
    }

    /// Reports the limits of a controller that has some.
    fn report_limits(&self, i: usize, v: &Values<f64>, report: &mut DesignReport) {
        let limited = v[self.u_min].iter().any(|&min| min > -UNLIMITED)
            || v[self.u_max].iter().any(|&max| max < UNLIMITED)
            || self.u_achieved.is_some();
        if !limited || v[self.K_i][i] == 0.0 {
            return;
        }
        let (time, name, of_I) = (v[self.T_t][i], v.name(self.T_t.at(i)), v.name(self.I.at(i)));
        if time > 0.0 {
            report.add(&name, time, "s", &format!("time constant with which {of_I} tracks the limited control"));
        } else {
            let given = v.name(self.tracking_time.at(i));
            let note = format!("{of_I} winds up while a control is at its limit. Set {given} = {BY_GAINS}");
            report.judge(&name, "off", "s", Verdict::Warning, note);
        }
    }
}

/// Part of the derivative that remains at the end of each step for a sampled ramp: x/(eˣ − 1) with x = N H.
fn remaining_part(x: f64) -> f64 {
    x / x.exp_m1()
}
