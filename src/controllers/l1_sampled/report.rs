//! Report of a sampled L1 controller: desired dynamics, the sampled loop with the nominal plant, and its margins of
//! dead time and input gain.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{Complex, DMatrix, DVector};

use super::filter::SampledFilter;
use super::nominal::{Estimation, HeldFilter, Nominal};
use super::{L1Sampled, MOST_DELAY};
use crate::controllers::at_limit::unit;
use crate::controllers::l1::{controllability, plants};
use crate::report::number;
use crate::system::{DesignReport, Values, Verdict};

/// The most states of a plant whose loop is looked at: beyond, it would take long.
const MOST_STATES: usize = 30;
/// The most states of its filters.
const MOST_FILTER_STATES: usize = 60;
/// Most samples of additional dead time that are tried.
const MOST_LATE: usize = 40;
/// Magnitude below which a pole has settled within a sample: several that are 0 are found only so well.
const SETTLED: f64 = 1e-3;
/// Imaginary part below which a pole is real.
const REAL: f64 = 1e-9;
/// Range of factors of the nominal input gain for which a loop should at least be stable.
const NARROW: [f64; 2] = [0.8, 1.25];

impl L1Sampled {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_plants(v, report);
        let (A_m, of_A_m) = (self.dynamics.A_m(v).into_owned(), self.dynamics.name_of_A_m(v));
        report.section("Desired dynamics");
        report.eigenvalues(&format!("eigenvalues of {of_A_m}"), &A_m, true);
        controllability(["controllability", &of_A_m, "B"], [&A_m, &self.plant.B], report);
        let (of_K_d, of_K_g) = (v.name(self.K_d), v.name(self.K_gd));
        report.add(
            &of_K_d,
            &v.matrix(self.K_d).into_owned(),
            "",
            "state feedback gain, for a control with zero-order hold",
        );
        report.add(&of_K_g, &v.matrix(self.K_gd).into_owned(), "", "gain of the reference");
        self.report_filter(&A_m, v, report);
        report.section("Sampled loop");
        let (T, delay) = (v[self.sample_time], v.get(self.delay_steps) as f64);
        let note = "the communication step may be shorter, but not longer";
        report.add(&v.name(self.sample_time), T, "s", note);
        if report.step > T * (1.0 + 1e-6) {
            let note = format!("longer than {}: several samples use the same inputs", v.name(self.sample_time));
            report.judge("default step", report.step, "s", Verdict::NotSound, note);
        }
        let note =
            format!("assumed by the design: {} samples from a measurement until its control acts", number(delay));
        report.add("dead time", delay * T, "s", &note);
        if self.x.len() > MOST_STATES || self.filter.order() > MOST_FILTER_STATES {
            let note = format!(
                "the check would take too long with more than {MOST_STATES} states of the plant, or more than \
                 {MOST_FILTER_STATES} of the filters"
            );
            report.judge("stability", "not checked", "", Verdict::NotSound, note);
            return;
        }
        self.report_loop(&self.nominal_loop(&A_m, v), v, report);
        self.report_noise(v, report);
    }

    /// Plants with the controller as it is for short samples: one that is its filter 1/s and matched estimates.
    fn report_plants(&self, v: &Values<f64>, report: &mut DesignReport) {
        let is_nominal = v.matrix(self.W_0).is_identity(0.0);
        let SampledFilter::Integrator { K: k, .. } = &self.filter else { return };
        if self.plant.B_um.ncols() > 0 || !is_nominal {
            return;
        }
        let numbers = plants::Numbers {
            A_m: self.dynamics.A_m(v).into_owned(),
            K_m: self.dynamics.gain().map(|K_m| v.matrix(K_m).into_owned()),
            K: vec![DMatrix::from_diagonal(&DVector::from_column_slice(&v[*k]))],
            P: None,
            is_inside: false,
        };
        let unit = unit(self.u, [self.u_min, self.u_max], v, v[self.sample_time]);
        plants::report_robustness(&self.plant, &numbers, &unit, report);
    }

    /// The filter, in a loop with the nominal input gain, where it isn't 1/s.
    fn report_filter(&self, A_m: &DMatrix<f64>, v: &Values<f64>, report: &mut DesignReport) {
        let SampledFilter::General(filter) = &self.filter else { return };
        let (name, dynamics) = self.filtered_dynamics(A_m, v);
        let Ok(continuous) = filter.continuous((&name, &dynamics), &self.plant, v) else { return };
        report.section("Filter loop");
        report.eigenvalues("poles of C(s)", &continuous.of_channels(), true);
        let zeros = continuous.of_zeros();
        if !zeros.is_empty() {
            report.eigenvalues("zeros of H_m(s)", &zeros, true);
        }
    }

    fn report_loop(&self, nominal: &Nominal, v: &Values<f64>, report: &mut DesignReport) {
        let Some(poles) = nominal.poles(1.0, 0.0) else {
            report.judge(
                "poles",
                "not found",
                "",
                Verdict::NotSound,
                "the sampled loop is too badly scaled".to_owned(),
            );
            return;
        };
        let largest = poles.first().map_or(0.0, |pole| pole.norm());
        report.add("poles", texts(&poles), "", "of the loop with the nominal plant, sample by sample");
        if largest >= 1.0 {
            let note = "must be below 1: the loop with the nominal plant is unstable".to_owned();
            report.judge("largest magnitude of the poles", largest, "", Verdict::NotSound, note);
            return;
        }
        report.add("largest magnitude of the poles", largest, "", "below 1: stable");
        let of_delay = v.name(self.delay_steps);
        match nominal.delay_margin(MOST_LATE) {
            Some(late) if late < 0.5 * nominal.T => {
                let note = format!(
                    "in addition to the dead time of {of_delay}. The margin is less than half a sample, so the dead \
                     time must be known that precisely"
                );
                report.judge("delay margin", late, "s", Verdict::Warning, note);
            }
            Some(late) => report.add("delay margin", late, "s", &format!("in addition to the dead time of {of_delay}")),
            None => report.add_unlimited("delay margin", "s", &format!("the loop tolerates {MOST_LATE} samples")),
        }
        self.report_gains(nominal, v, report);
    }

    /// Between which input gains of the true plant the loop is stable.
    fn report_gains(&self, nominal: &Nominal, v: &Values<f64>, report: &mut DesignReport) {
        let note = format!(
            "input gain of the true plant relative to {}, the same in all channels, that the loop tolerates",
            v.name(self.W_0)
        );
        let edges = [("least input gain", -1.0, "below 0.01"), ("largest input gain", 1.0, "above 100")];
        for (((name, way, beyond), narrow), edge) in edges.into_iter().zip(NARROW).zip(nominal.gain_range()) {
            match edge {
                Some(gain) if way * (gain - narrow) < 0.0 => {
                    let note = format!("{note}. A shorter sample time or a smaller feedback_gain widens the range");
                    report.judge(name, gain, "", Verdict::Warning, note);
                }
                Some(gain) => report.add(name, gain, "", &note),
                None => report.add(name, beyond, "", &note),
            }
        }
    }

    /// Gain from noise in the state to the control.
    fn report_noise(&self, v: &Values<f64>, report: &mut DesignReport) {
        report.section("Noise");
        let W_0_inverse = v.matrix(self.W_0_inverse).into_owned();
        let note = format!(
            "from {} to {} within a sample, without the contribution of the estimate",
            v.name(self.x),
            v.name(self.u)
        );
        report.add("gain of the baseline", &(-W_0_inverse * v.matrix(self.K_d)), "", &note);
        let by = self.predictor.as_ref().map_or(self.L_inverse, |predictor| predictor.S);
        let (m, k) = (self.u.len(), self.plant.B_um.ncols());
        let rows = v.matrix(by).rows(0, m).into_owned();
        report.add(
            "gain of the estimate",
            &rows,
            "",
            &format!("from {} to {}", v.name(self.x), v.name(self.sigma_hat)),
        );
        let (Some(other), SampledFilter::General(filter)) = (self.sigma_other, &self.filter) else { return };
        if k == 0 {
            return;
        }
        let unmatched = v.matrix(by).rows(m, k).into_owned();
        let note = format!("from {} to {} along B_um", v.name(self.x), v.name(other));
        report.add("gain of the unmatched estimate", &unmatched, "", &note);
        if let Some(direct) = filter.direct(v) {
            let note = format!("from noise in {} to {} within a sample", v.name(other), v.name(self.u));
            let W_0_inverse = v.matrix(self.W_0_inverse).into_owned();
            report.add("gain of what is unmatched", &(-W_0_inverse * direct), "", &note);
        }
    }

    pub(super) fn nominal_loop(&self, A_m: &DMatrix<f64>, v: &Values<f64>) -> Nominal {
        let T = v[self.sample_time];
        let W_0 = v.matrix(self.W_0).into_owned();
        let estimation = match &self.predictor {
            None => Estimation::Exact { L_inverse: v.matrix(self.L_inverse).into_owned() },
            Some(predictor) => Estimation::Published {
                E: v.matrix(predictor.E).into_owned(),
                of_u: v.matrix(predictor.of_u).into_owned(),
                of_x: v.matrix(predictor.of_x).into_owned(),
                of_sigma: v.matrix(predictor.of_sigma).into_owned(),
                S: v.matrix(predictor.S).into_owned(),
            },
        };
        Nominal {
            T,
            A: self.nominal(A_m),
            BW_0: &self.plant.B * &W_0,
            A_d: v.matrix(self.A_d).into_owned(),
            B_d: v.matrix(self.B_d).into_owned(),
            L_d: v.matrix(self.L_d).into_owned(),
            estimation,
            filter: match &self.filter {
                SampledFilter::Integrator { K, .. } => {
                    HeldFilter::integrator(&v[*K].iter().map(|k| (-k * T).exp()).collect::<Vec<_>>())
                }
                SampledFilter::General(filter) => {
                    let [F, G, C, direct] = filter.matrices(v);
                    HeldFilter { F, G, C, direct }
                }
            },
            W_0,
            W_0_inverse: v.matrix(self.W_0_inverse).into_owned(),
            K_d: v.matrix(self.K_d).into_owned(),
            delay: usize::try_from(v.get(self.delay_steps)).unwrap_or(0).min(MOST_DELAY),
        }
    }
}

/// Poles as text, one for a conjugate pair, without those that settle within a sample.
fn texts(poles: &[Complex<f64>]) -> String {
    let three = |value: f64| number(format!("{value:.3e}").parse().unwrap_or(value));
    let mut texts: Vec<String> = Vec::new();
    for pole in poles.iter().filter(|pole| pole.norm() > SETTLED && pole.im > -REAL) {
        let imaginary = if pole.im > REAL { format!(" ± {}j", three(pole.im)) } else { String::new() };
        texts.push(format!("{}{imaginary}", three(pole.re)));
    }
    texts.dedup();
    if texts.is_empty() { "0".to_owned() } else { texts.join(", ") }
}
