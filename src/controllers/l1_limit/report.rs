//! Report of a limit controller: desired dynamics, the filter's loop, the effect of noise, the delay margin, and the
//! limits.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;

use super::L1Limit;
use crate::controllers::at_limit::unit;
use crate::controllers::l1::tracking::{self, BY_GAIN};
use crate::controllers::l1::{controllability, plants, report_delay_margin};
use crate::mathematics::delay_margin::NominalLoop;
use crate::mathematics::l1_design::L1Design;
use crate::mathematics::limits::UNLIMITED;
use crate::system::{DesignReport, Values, Verdict};

impl L1Limit {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_plants(v, report);
        self.report_dynamics(v, report);
        let (design, of_K) = (self.nominal_design(v), v.name(self.K));
        report.section("Filter loop");
        if design.is_large() {
            let note = format!("the margins of a system of {} states would take minutes", design.order());
            report.judge("delay margin", "not checked", "", Verdict::NotSound, note);
        } else {
            let identity = DMatrix::identity(design.K.nrows(), design.K.nrows());
            report.eigenvalues("poles of C(s)", &design.loop_matrix(&identity), true);
            if let Some(band) = design.bandwidth(&identity) {
                let note = "of C(s) with the nominal input gain, in its slowest direction (-3 dB)";
                report.add("bandwidth", band.slowest, "rad/s", note);
            }
            report.section("Time delay");
            report_delay_margin(&design, &self.nominal_loop(&design, v), &of_K, report);
        }
        self.report_noise(v, report);
        self.report_limits(v, report);
    }

    /// Plants with a law that is its filter 1/s and matched estimates.
    fn report_plants(&self, v: &Values<f64>, report: &mut DesignReport) {
        if !self.filter.is_integrator() || self.plant.B_um.ncols() > 0 {
            return;
        }
        let numbers = plants::Numbers {
            A_m: self.dynamics.A_m(v).into_owned(),
            K_m: self.dynamics.gain().map(|K_m| v.matrix(K_m).into_owned()),
            K: vec![v.matrix(self.K).into_owned()],
            P: None,
            is_inside: false,
        };
        plants::report_robustness(
            &self.plant,
            &numbers,
            &unit(self.u, [self.u_min, self.u_max], v, report.step),
            report,
        );
    }

    fn report_dynamics(&self, v: &Values<f64>, report: &mut DesignReport) {
        let (A_m, of_A_m) = (self.dynamics.A_m(v).into_owned(), self.dynamics.name_of_A_m(v));
        report.section("Desired dynamics");
        report.eigenvalues(&format!("eigenvalues of {of_A_m}"), &A_m, true);
        controllability(["controllability", &of_A_m, "B"], [&A_m, &self.plant.B], report);
        if let Some(K_m) = self.dynamics.gain() {
            report.add(&v.name(K_m), &v.matrix(K_m).into_owned(), "", "gain of the baseline");
        }
        report.add(&v.name(self.K_g), &v.matrix(self.K_g).into_owned(), "", "gain of the reference");
    }

    /// The controller with the nominal input gain.
    fn nominal_design(&self, v: &Values<f64>) -> L1Design {
        let m = self.u.len();
        let nominal = DMatrix::identity(m, m);
        L1Design {
            A_m: self.dynamics.A_m(v).into_owned(),
            B: self.plant.B.clone(),
            K: v.matrix(self.K).into_owned(),
            filter: self.filter.clone(),
            omega_min: nominal.clone(),
            omega_max: nominal,
            known: None,
            unmatched: None,
        }
    }

    fn nominal_loop(&self, design: &L1Design, v: &Values<f64>) -> NominalLoop {
        let (n, m) = design.B.shape();
        let K_m = self.dynamics.gain().map(|K_m| v.matrix(K_m).into_owned());
        let A = if K_m.is_some() { self.plant.A.clone() } else { None };
        NominalLoop {
            A: A.unwrap_or_else(|| design.A_m.clone()),
            B: design.B.clone(),
            K_m: K_m.unwrap_or_else(|| DMatrix::zeros(m, n)),
            K: design.K.clone(),
            filter: design.filter.clone(),
        }
    }

    /// Feedthrough of the state to the control, which noise takes too.
    fn report_noise(&self, v: &Values<f64>, report: &mut DesignReport) {
        let L = v.matrix(self.L).into_owned();
        let gain = DMatrix::from_fn(self.u.len(), self.x.len(), |i, j| {
            let column: Vec<_> = L.column(j).iter().copied().collect();
            let K_m = self.dynamics.gain().map_or(0.0, |K_m| v[K_m.at(i, j)]);
            self.filtered(i, &column, v) - K_m
        });
        report.section("Noise");
        let note = format!("from measurement noise in {} to {}", v.name(self.x), v.name(self.u));
        report.add("gain at high frequencies", &gain, "", &note);
    }

    /// Reports the channels that have limits.
    fn report_limits(&self, v: &Values<f64>, report: &mut DesignReport) {
        let is_limited = |i: &usize| v[self.u_min][*i] > -UNLIMITED || v[self.u_max][*i] < UNLIMITED;
        for i in (0..self.u.len()).filter(is_limited) {
            report.section("Limits of the control");
            let (u_ad, time) = (v.name(self.u_ad.at(i)), v.name(self.tracking_time.at(i)));
            let row = v.matrix(self.K);
            let rate = tracking::rate(v[self.tracking_time][i], row.row(i).iter(), self.filter_at_rest[0]);
            let name = format!("T_t[{}]", i + 1);
            if rate > 0.0 {
                report.add(
                    &name,
                    1.0 / rate,
                    "s",
                    &format!("time constant with which {u_ad} tracks the limited control"),
                );
            } else {
                let note =
                    format!("{u_ad} winds up while the control is at its limit; {time} = {BY_GAIN} prevents this");
                report.judge(&name, "off", "s", Verdict::Warning, note);
            }
        }
    }
}
