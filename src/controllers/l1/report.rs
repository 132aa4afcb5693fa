//! Report of an L1 controller: its desired dynamics, its filter's loop, the L1-norm condition, the time-delay margin,
//! the limits of the control, the bound on the prediction error and the communication step.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;

use super::Baseline;
use super::law::Law;
use crate::mathematics::delay_margin::{Crossing, NominalLoop};
use crate::mathematics::l1_advice::{Advice, Stabilising};
use crate::mathematics::l1_design::{L1Design, Lipschitz, UnmatchedWay, Worst};
use crate::mathematics::l1_norm::Bounds;
use crate::mathematics::prediction_error::Uncertainty;
use crate::mathematics::{lyapunov, pole_placement};
use crate::report::{DIGITS, at_most, no_more, number};
use crate::system::{DesignReport, Parameter, Values, VectorOf, Verdict};

/// Relative residual up to which a Lyapunov equation counts as solved.
const RESIDUAL: f64 = 1e-9;

/// Factor by which an advised gain should lessen the prediction error.
const FINER: f64 = 10.0;

impl Law {
    /// Reports the controller with each of these K, of which the first is the parameter.
    pub fn report(&self, gains: &[(&str, DMatrix<f64>)], v: &Values<f64>, report: &mut DesignReport) {
        let is_decided = self.report_plants(gains, v, report);
        self.report_dynamics(v, report);
        self.report_lyapunov(v, report);
        for (name, K) in gains {
            let section = |title: &str| if name.is_empty() { title.to_owned() } else { format!("{title}, {name}") };
            let design = self.l1_design(K, v);
            report.section(&section("Filter loop"));
            if !name.is_empty() {
                report.add("K", K, "1/s", "treated as constant; its changes are not taken into account");
            }
            if design.is_large() {
                too_large(&design, report);
                continue;
            }
            report_loop(&design, &v.name(self.design.feedback_gain), report);
            report.section(&section("L1-norm condition"));
            // The parameter itself, or what inference gives in its place.
            let gain = if *name == gains[0].0 { v.name(self.design.feedback_gain) } else { "K".to_owned() };
            self.report_condition(&design, &gain, is_decided, v, report);
            report.section(&section("Adaptation"));
            self.report_adaptation(&design, &gain, v, report);
            report.section(&section("Time delay"));
            self.report_delay(&design, v, report);
        }
        self.report_limits(&gains[0].1, v, report);
        self.report_prediction(v, report);
        self.report_step(v, report);
    }

    fn report_dynamics(&self, v: &Values<f64>, report: &mut DesignReport) {
        let (A_m, of_A_m) = (self.design.A_m(v).into_owned(), self.design.name_of_A_m(v));
        report.section("Desired dynamics");
        report.eigenvalues(&format!("eigenvalues of {of_A_m}"), &A_m, true);
        let baseline = self.design.K_m(v).zip(self.design.name_of_K_m(v));
        if let (Some(A), Some((K_m, of_K_m))) = (&self.plant.A, baseline) {
            let K_m = K_m.into_owned();
            report.eigenvalues("eigenvalues of A", A, false);
            report.eigenvalues(&format!("eigenvalues of A - B {of_K_m}"), &(A - &self.plant.B * &K_m), true);
            controllability(["controllability", "A", "B"], [A, &self.plant.B], report);
            report.add(&of_K_m, &K_m, "", "gain of the baseline");
        } else {
            controllability(["controllability", &of_A_m, "B"], [&A_m, &self.plant.B], report);
        }
        weakest_direction(&A_m, &self.plant.B, report);
        report.add(&v.name(self.design.K_g), &v.matrix(self.design.K_g).into_owned(), "", "gain of the reference");
    }

    fn report_lyapunov(&self, v: &Values<f64>, report: &mut DesignReport) {
        let (A_m, P) = (self.design.A_m(v).into_owned(), v.matrix(self.design.P).into_owned());
        let [of_A_m, of_P, of_Q] = [self.design.name_of_A_m(v), v.name(self.design.P), v.name(self.design.Q)];
        let eigenvalues = P.symmetric_eigenvalues();
        report.section("Lyapunov equation");
        report.add(&format!("least eigenvalue of {of_P}"), eigenvalues.min(), "", "");
        report.add(&format!("largest eigenvalue of {of_P}"), eigenvalues.max(), "", "");
        let left = (A_m.transpose() * &P + &P * &A_m + v.matrix(self.design.Q)).norm() / (A_m.norm() * P.norm());
        let (verdict, note) = if left <= RESIDUAL {
            (Verdict::Ok, format!("relative residual of {of_A_m}' {of_P} + {of_P} {of_A_m} = -{of_Q}"))
        } else {
            let text = "the estimates may not decrease V: scale states or";
            (Verdict::Warning, format!("{text} {of_A_m} so that their sizes are alike"))
        };
        report.judge("residual", left, "", verdict, note);
    }

    /// The controller as the linear system that fast adaptation makes it.
    fn l1_design(&self, K: &DMatrix<f64>, v: &Values<f64>) -> L1Design {
        let m = K.nrows();
        let bound = |values: &[f64]| {
            let mut matrix = DMatrix::zeros(m, m);
            self.omega_entries.iter().zip(values).for_each(|(&entry, &value)| matrix[entry] = value);
            matrix
        };
        let matrix = |handle: Option<DMatrix<f64>>, rows, columns| handle.unwrap_or(DMatrix::zeros(rows, columns));
        let unmatched = self.unmatched.as_ref().map(|unmatched| {
            let k = self.plant.B_um.ncols();
            let cancellation = &unmatched.cancellation;
            let zeros = cancellation.zeros.as_ref();
            UnmatchedWay {
                B_um: self.plant.B_um.clone(),
                input: v.matrix(cancellation.input).into_owned(),
                direct: matrix(cancellation.direct.map(|direct| v.matrix(direct).into_owned()), m, k),
                A_z: matrix(zeros.map(|zeros| v.matrix(zeros.A_z).into_owned()), 0, 0),
                B_z: matrix(zeros.map(|zeros| v.matrix(zeros.B_z).into_owned()), 0, k),
                KC_z: matrix(zeros.map(|zeros| v.matrix(zeros.KC_z).into_owned()), m, 0),
            }
        });
        L1Design {
            A_m: self.design.A_m(v).into_owned(),
            B: self.plant.B.clone(),
            K: K.clone(),
            filter: self.filter.clone(),
            omega_min: bound(&v[self.design.omega_min]),
            omega_max: bound(&v[self.design.omega_max]),
            known: self.design.K_m(v).filter(|_| self.baseline != Baseline::None).map(|K_m| K_m.into_owned()),
            unmatched,
        }
    }

    /// The bounds on the elements of θ.
    pub(super) fn theta_bounds(&self, v: &Values<f64>) -> DMatrix<f64> {
        let (m, columns) = self.theta_hat.shape();
        DMatrix::from_fn(m, columns, |i, j| self.design.theta_bounds(j, v)[i])
    }

    /// The same of θ as a factor of the state itself.
    pub(super) fn bounds_of_state(&self, v: &Values<f64>) -> DMatrix<f64> {
        let mut bounds = self.theta_bounds(v);
        bounds
            .column_iter_mut()
            .enumerate()
            .for_each(|(j, mut column)| column *= self.regressor_gain(j).unwrap_or(1.0));
        bounds
    }

    /// L of what the bounds on θ allow, by the largest element of the state.
    fn lipschitz(&self, v: &Values<f64>) -> Lipschitz {
        let largest = |bounds: &[f64]| bounds.iter().copied().fold(0.0, f64::max);
        let rows: Vec<_> = self.bounds_of_state(v).row_iter().map(|row| row.sum()).collect();
        Lipschitz {
            matched: largest(&rows),
            unmatched: self.unmatched.as_ref().map_or(0.0, |unmatched| largest(&v[unmatched.theta_bound])),
        }
    }

    /// λ, which is sufficient, not necessary: where plants within the description's own uncertainty were tried, they decide.
    fn report_condition(
        &self,
        design: &L1Design,
        gain: &str,
        is_decided: bool,
        v: &Values<f64>,
        report: &mut DesignReport,
    ) {
        let lipschitz = self.lipschitz(v);
        // Where nothing is uncertain, the largest norm.
        let free = Lipschitz { matched: 1.0, unmatched: 1.0 };
        let weights = if lipschitz.matched + lipschitz.unmatched > 0.0 { lipschitz } else { free };
        let found = design.worst(weights).and_then(|worst| {
            let lambda = worst.norms.lambda(lipschitz);
            let advice = (!condition_holds(lambda)).then(|| Advice::of(design, lipschitz, lambda, &worst.omega));
            Ok((worst, lambda, advice.transpose()?))
        });
        let (worst, lambda, advice) = match found {
            Ok(found) => found,
            Err(reasons) => return report.judge("‖G‖", "not found", "", Verdict::NotSound, reasons.to_string()),
        };
        self.report_norms(&worst, lipschitz, v, report);
        if let Some(advice) = advice {
            let advised = self.advised(&advice, design, gain, v);
            let bound = v.name(self.design.theta_bound);
            let known = self.without_baseline(design, lipschitz).filter(|_| lambda.upper.is_finite());
            let included = known.map_or(String::new(), |alone| {
                format!(", which is {} where {bound} includes (omega - I) K_m", number(alone))
            });
            let note = format!(
                "not proved for all of {bound}: the L1-norm condition, which is sufficient, asks for less than 1{included}. {advised}"
            );
            let verdict = if is_decided && lambda.upper.is_finite() { Verdict::Ok } else { Verdict::Warning };
            report.judge("lambda", lambda, "", verdict, note);
        } else {
            report.add("lambda", lambda, "", "‖G‖ L < 1: bounded for every uncertainty within the bounds");
        }
    }

    /// λ where the bounds on θ are taken to include what ω leaves of a baseline outside, if it is below 1 then.
    fn without_baseline(&self, design: &L1Design, lipschitz: Lipschitz) -> Option<f64> {
        if self.baseline != Baseline::Outside {
            return None;
        }
        let alone = L1Design { known: None, ..design.clone() }.worst(lipschitz).ok()?.norms.lambda(lipschitz);
        condition_holds(alone).then_some(alone.upper)
    }

    fn report_norms(&self, worst: &Worst, lipschitz: Lipschitz, v: &Values<f64>, report: &mut DesignReport) {
        let allows = |bound: VectorOf<Parameter>| format!("Lipschitz constant that {} allows", v.name(bound));
        let text = "L1 norm from matched uncertainty to the state, at the worst omega";
        report_norm("‖G‖", worst.norms.matched, text, report);
        report.add("L", lipschitz.matched, "", &allows(self.design.theta_bound));
        if let Some(unmatched) = &self.unmatched {
            report_norm("‖G_um‖", worst.norms.unmatched, "the same from unmatched uncertainty", report);
            report.add("L_2", lipschitz.unmatched, "", &allows(unmatched.theta_bound));
        }
        let among = if worst.every_corner { "every corner" } else { "not every corner" };
        let tried = format!("of {} tried ({among} of the bounds included)", worst.points);
        report.add("worst omega", &worst.omega, "", &tried);
    }

    /// Advice that makes λ less than 1, in terms of the parameters.
    fn advised(&self, advice: &Advice, design: &L1Design, gain: &str, v: &Values<f64>) -> String {
        let is_full = self.omega_entries.len() == design.K.len();
        let (first, then) = match &advice.stabilising {
            None => (String::new(), design.clone()),
            Some(Stabilising::Gain(factor)) => {
                let text =
                    format!("The loop is not stable for each omega; {gain} times {} makes it stable", number(*factor));
                (text, design.with_gain_times(*factor))
            }
            Some(Stabilising::Bounds(min, max)) => {
                let [of_min, of_max] = [self.design.omega_min, self.design.omega_max].map(|bound| v.name(bound));
                let text = format!(
                    "No {gain} makes the loop stable for each omega; {of_min} = {}, {of_max} = {} do",
                    rows(min, is_full),
                    rows(max, is_full)
                );
                (text, design.clone())
            }
        };
        let Some(bound) = advice.bound_factor else {
            let hopeless = format!("The loop is not stable even with omega = I: check the sign and size of {gain}");
            return if first.is_empty() { hopeless } else { format!("{first}. That is enough") };
        };
        let start = if first.is_empty() { String::new() } else { format!("{first}. Then ") };
        let of_unmatched = self.unmatched.as_ref().map(|unmatched| format!(" and {}", v.name(unmatched.theta_bound)));
        let of_matched = v.name(self.design.theta_bound);
        let smaller = format!("{of_matched}{} times {}", of_unmatched.unwrap_or_default(), number(bound));
        let Some((factor, lambda)) = advice.gain_factor else {
            let (best, lambda) = advice.best_factor.unwrap_or((1.0, f64::INFINITY));
            return format!(
                "{start}{smaller} is enough. No larger {gain} is: of its multiples tried, {} times gives the smallest \
                 lambda, {}",
                number(best),
                number(lambda)
            );
        };
        let crossings = self.nominal_loop(&then.with_gain_times(factor), v).crossings();
        let margin =
            crossings.as_ref().and_then(|crossings| crossings.first()).map_or(f64::INFINITY, |first| first.delay);
        format!(
            "{start}{gain} times {} is enough (lambda = {}, delay margin {} s), or a smaller uncertainty: {smaller}",
            number(factor),
            number(lambda),
            number(margin)
        )
    }

    fn report_delay(&self, design: &L1Design, v: &Values<f64>, report: &mut DesignReport) {
        report_delay_margin(design, &self.nominal_loop(design, v), &v.name(self.design.feedback_gain), report);
    }

    fn nominal_loop(&self, design: &L1Design, v: &Values<f64>) -> NominalLoop {
        let K_m = self.design.K_m(v).map(|K_m| K_m.into_owned());
        let A = if K_m.is_some() { self.plant.A.clone() } else { None };
        let (n, m) = design.B.shape();
        NominalLoop {
            A: A.unwrap_or_else(|| design.A_m.clone()),
            B: design.B.clone(),
            K_m: K_m.unwrap_or_else(|| DMatrix::zeros(m, n)),
            K: design.K.clone(),
            filter: design.filter.clone(),
        }
    }

    fn report_prediction(&self, v: &Values<f64>, report: &mut DesignReport) {
        let uncertainty = self.uncertain(v);
        let (P, Q) = (v.matrix(self.design.P).into_owned(), v.matrix(self.design.Q).into_owned());
        let gain = v[self.design.adaptation_gain];
        report.section("Prediction error");
        let constant = "for constant omega, theta and sigma; larger if they change";
        report.add("theta_m", uncertainty.theta_m(&P, &Q), "", constant);
        let bound = uncertainty.prediction_error(&P, &Q, gain);
        let [of_gain, x_hat, x] = [v.name(self.design.adaptation_gain), v.name(self.x_hat), v.name(self.ports.x)];
        let finer = format!(
            "at all times. {of_gain} = {} makes it {FINER} times smaller and the adaptation {FINER} times faster",
            number(gain * FINER * FINER)
        );
        report.add(&format!("bound on |{x_hat} - {x}|"), bound, "", &finer);
    }

    pub(super) fn uncertain(&self, v: &Values<f64>) -> Uncertainty {
        let design = &self.design;
        let theta_bound = self.theta_bounds(v).transpose();
        let (mut theta_bound, mut sigma_bound) = (theta_bound.as_slice().to_vec(), v[design.sigma_bound].to_vec());
        if let Some(unmatched) = &self.unmatched {
            theta_bound.extend(&v[unmatched.theta_bound]);
            sigma_bound.extend(&v[unmatched.sigma_bound]);
        }
        let ranges = v[design.omega_max].iter().zip(&v[design.omega_min]).map(|(max, min)| max - min);
        Uncertainty { theta_bound, sigma_bound, omega_range: ranges.collect(), ..Uncertainty::default() }
    }

    /// Reports the communication step of an FMU that is stepped by itself.
    fn report_step(&self, v: &Values<f64>, report: &mut DesignReport) {
        if report.step == 0.0 {
            return;
        }
        let frequency = self.frequency_for([0.0, 0.0], v);
        let longest = self.longest_step(frequency, v);
        report.section("Communication step");
        let of_frequency = v.name(self.adaptation_frequency);
        let grows = format!("{of_frequency} with control and state at zero; grows as √(1 + |v|² + |phi|²)");
        report.add("omega_a at rest", frequency, "rad/s", &grows);
        if longest == f64::INFINITY {
            report.add_unlimited("longest step at rest", "s", "no estimate changes");
            return;
        }
        if report.step <= longest {
            let note = format!("the estimates turn by {} in one step", v.name(self.design.step_phase_limit));
            report.add("longest step at rest", no_more(longest, DIGITS), "s", &note);
            return;
        }
        let gain = v[self.design.adaptation_gain] * (longest / report.step).powi(2);
        let note = format!(
            "shorter than the default step, {} s: use at most this step, or {} = {}",
            number(report.step),
            v.name(self.design.adaptation_gain),
            at_most(gain)
        );
        report.judge("longest step at rest", no_more(longest, DIGITS), "s", Verdict::Warning, note);
    }
}

/// The delay margin of the loop of the nominal plant, of which K has this name.
pub(in crate::controllers) fn report_delay_margin(
    design: &L1Design,
    broken: &NominalLoop,
    of_gain: &str,
    report: &mut DesignReport,
) {
    let identity = DMatrix::identity(design.K.nrows(), design.K.nrows());
    if !design.is_stable(&identity) {
        let note = "the loop with omega = I is unstable even without delay";
        report.judge("delay margin", 0.0, "s", Verdict::NotSound, note);
        return;
    }
    let Some(crossings) = broken.crossings() else {
        let note = "frequency responses of the loop are too badly scaled";
        report.judge("delay margin", "not found", "s", Verdict::Warning, note);
        return;
    };
    let Some(&Crossing { frequency, phase, delay }) = crossings.first() else {
        report.add_unlimited("delay margin", "s", "the loop gain does not cross 1");
        return;
    };
    let of = "largest delay at the plant's input, in all channels, with which the loop of the nominal plant is stable";
    // Zero-order holds delay by half a step; measuring before the plant's step, by one more.
    let lag = 1.5 * report.step;
    if delay > lag {
        report.add("delay margin", delay, "s", of);
    } else {
        let note = format!(
            "sampling already delays by up to {} s (1.5 communication steps). Use a step below {} s, or a smaller \
             {of_gain}",
            number(lag),
            at_most(delay / 1.5),
        );
        report.judge("delay margin", delay, "s", Verdict::Warning, note);
    }
    report.add("phase there", phase.to_degrees(), "deg", "phase margin at this gain crossover");
    report.add("frequency there", frequency, "rad/s", "");
    if crossings.len() > 1 {
        let all = DMatrix::from_fn(crossings.len(), 2, |i, j| [crossings[i].frequency, crossings[i].delay][j]);
        report.add("all crossings", &all, "rad/s, s", "frequency of each gain crossover, and its delay margin");
    }
}

/// A norm, which is infinite where the loop isn't stable for some input gain.
fn report_norm(name: &str, norm: Bounds, text: &str, report: &mut DesignReport) {
    let verdict = if norm.upper.is_finite() { Verdict::Ok } else { Verdict::Warning };
    report.judge(name, norm, "", verdict, text);
}

/// λ < 1, which no λ shows that isn't a number.
fn condition_holds(lambda: Bounds) -> bool {
    lambda.upper < 1.0
}

/// Reports the missing checks of a design that is too large.
fn too_large(design: &L1Design, report: &mut DesignReport) {
    let note = format!(
        "the norms and margins of a system of {} states (plant and filters) would take minutes: check a part of it",
        design.order()
    );
    report.judge("L1-norm condition", "not checked", "", Verdict::NotSound, note);
}

/// Controllability of a pair, or the observability that is its dual, and the names of the two.
pub(in crate::controllers) fn controllability(
    [property, A, B]: [&str; 3],
    pair: [&DMatrix<f64>; 2],
    report: &mut DesignReport,
) {
    let name = format!("{property} indices of ({A}, {B})");
    match pole_placement::controllability_indices(pair[0], pair[1]) {
        Ok(indices) => {
            let indices = DMatrix::from_fn(1, indices.len(), |_, i| indices[i] as f64);
            report.add(&name, &indices, "", "one for each channel; their sum, the rank, is the number of states");
        }
        Err(reason) => report.judge(&name, "none", "", Verdict::Warning, reason.to_string()),
    }
}

/// The direction that a bounded control moves least, by the controllability Gramian of the desired dynamics.
fn weakest_direction(A_m: &DMatrix<f64>, B: &DMatrix<f64>, report: &mut DesignReport) {
    let reached = lyapunov::gramian(&A_m.transpose(), &(B * B.transpose()));
    let Some(reached) = reached.filter(|reached| reached.norm_squared().is_finite()) else { return };
    let eigen = reached.symmetric_eigen();
    let (weakest, least) = eigen.eigenvalues.argmin();
    let ratio = (least.max(0.0) / eigen.eigenvalues.max()).sqrt();
    let direction = eigen.eigenvectors.column(weakest).into_owned();
    // Up to rounding, and pointing along its largest element.
    let direction = (&direction * direction[direction.iamax()].signum()).map(|v| if v.abs() < 1e-12 { 0.0 } else { v });
    report.add(
        "weakest direction",
        &direction,
        "",
        "direction of the state that a control of given energy moves least",
    );
    report.add("reach along it", ratio, "", "relative to the strongest one; depends on the states' units");
}

fn report_loop(design: &L1Design, feedback_gain: &str, report: &mut DesignReport) {
    let (gains, identity) = (design.gains(), DMatrix::identity(design.K.nrows(), design.K.nrows()));
    let slowest = |omega: &DMatrix<f64>| {
        let poles = design.loop_poles(omega)?;
        poles.iter().map(|pole| pole.re).reduce(f64::max)
    };
    let found: Option<Vec<_>> = gains.iter().map(|omega| slowest(omega).map(|re| (re, omega))).collect();
    let worst = found.and_then(|found| found.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)));
    let Some((real, omega)) = worst else {
        report.judge("poles of C(s)", "not found", "1/s", Verdict::NotSound, "the filter's loop is too badly scaled");
        return;
    };
    let name = "largest real part of a pole of C(s)";
    if real < 0.0 {
        report.add(name, real, "1/s", &format!("over {} values of omega within its bounds", gains.len()));
    } else {
        let note = "for some omega within its bounds the loop is unstable; see the advice at lambda";
        // The bounds may be wider than a plant's true range: the nominal gain decides.
        let is_nominal = design.is_stable(&identity);
        report.judge(name, real, "1/s", if is_nominal { Verdict::Warning } else { Verdict::NotSound }, note);
        report.add("omega there", omega, "", "");
    }
    match design.dc_gain(&identity) {
        Some(gain) => report.add("C(0)", &gain, "", "constant uncertainty is cancelled completely"),
        None => report.judge("C(0)", "none", "", Verdict::NotSound, format!("{feedback_gain} is singular")),
    }
    if let Some(band) = design.bandwidth(&identity) {
        let note = "of C(s) with omega = I, in its slowest direction (-3 dB)";
        report.add("bandwidth", band.slowest, "rad/s", note);
        if band.fastest > band.slowest * (1.0 + 1e-6) {
            report.add("bandwidth of the fastest direction", band.fastest, "rad/s", "");
        }
    }
    if let Some(band) = design.bandwidth(omega).filter(|_| real < 0.0) {
        report.add("least bandwidth", band.slowest, "rad/s", "with the omega that makes the loop slowest");
    }
}

/// Bounds of ω as a description gives them.
fn rows(matrix: &DMatrix<f64>, is_full: bool) -> String {
    let list = |values: Vec<f64>| values.into_iter().map(number).collect::<Vec<_>>().join(", ");
    if !is_full || matrix.len() == 1 {
        return format!("[{}]", list(matrix.diagonal().iter().copied().collect()));
    }
    let rows: Vec<_> = matrix.row_iter().map(|row| format!("[{}]", list(row.iter().copied().collect()))).collect();
    format!("[{}]", rows.join(", "))
}
