//! Report of the adaptation: its speed compared with the filter, the deviation of the output that follows, the K that
//! it tolerates, and the effect of a wrong input gain on the baseline.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;

use super::law::Law;
use super::{Baseline, Regressor};
use crate::mathematics::l1_adaptation::L1Adaptation;
use crate::mathematics::l1_advice::{rounded_down, rounded_up};
use crate::mathematics::l1_design::L1Design;
use crate::report::number;
use crate::system::{DesignReport, Values, Verdict};
use crate::template::three_digits;

/// Deviation of the output, in parts of the reference, up to which the adaptation is accepted, and beyond which it
/// isn't sound unless it is much faster than the filter.
const NEAR: f64 = 0.3;
const FAR: f64 = 5.0;

/// Bound on the prediction error of an output, and a reference of it.
struct Off {
    output: usize,
    bound: f64,
    /// Twice what the description has; else the smaller and the larger of 1, in the unit of y, and what half of `sigma_bound`
    /// holds the output at.
    reference: [f64; 2],
}

impl Off {
    fn verdict(&self) -> Verdict {
        let [small, large] = self.reference;
        if self.bound <= NEAR * small {
            Verdict::Ok
        } else if self.bound <= FAR * large {
            Verdict::Warning
        } else {
            Verdict::NotSound
        }
    }
}

impl Law {
    /// Reports the adaptation compared with the filter of a design, whose K has this name.
    pub(super) fn report_adaptation(&self, design: &L1Design, gain: &str, v: &Values<f64>, report: &mut DesignReport) {
        let (P, Q) = (v.matrix(self.design.P).into_owned(), v.matrix(self.design.Q).into_owned());
        let B = &self.plant.B;
        let adaptation = L1Adaptation {
            BPB: B.transpose() * &P * B,
            BQB: B.transpose() * Q * B,
            gain: v[self.design.adaptation_gain],
        };
        self.report_speed(design, &adaptation, v, report);
        self.report_tolerance(design, &adaptation, gain, v, report);
        self.report_baseline(design, v, report);
    }

    /// The adaptation's frequency and the filter's bandwidth; the bound of the prediction and the reference.
    fn report_speed(&self, design: &L1Design, adaptation: &L1Adaptation, v: &Values<f64>, report: &mut DesignReport) {
        let turns = adaptation.slowest();
        let rest = "of the slowest direction of the adaptation, with control and state at zero";
        report.add("frequency at rest", turns, "rad/s", rest);
        let widest = widest(design);
        if let Some(band) = widest {
            report.add("largest bandwidth", band, "rad/s", "of C(s), over omega within its bounds");
        }
        let known = report.nominal().and_then(|nominal| nominal.reference.clone());
        let Some(off) = self.worst_prediction(known.as_deref(), v) else {
            let note = "P and K_g are too badly scaled for a bound on the outputs";
            return report.judge("bound on the prediction", "not found", "", Verdict::Warning, note);
        };
        let needed = widest.and_then(|band| adaptation.needed(band));
        let is_fast = needed.is_some_and(|needed| adaptation.gain >= needed);
        // What is fast leaves its transient before the filter passes it on: such a bound proves nothing against it.
        let verdict = match off.verdict() {
            Verdict::NotSound if is_fast => Verdict::Warning,
            _ if is_fast => Verdict::Ok,
            verdict => verdict,
        };
        let name = format!("bound on the prediction of output {}", off.output + 1);
        let [small, large] = off.reference.map(three_digits);
        let references = if small == large { number(small) } else { format!("{} to {}", number(small), number(large)) };
        if verdict == Verdict::Ok {
            let note = format!("of C (x_hat - x), compared with references of about {references}");
            return report.add(&name, off.bound, "", &note);
        }
        let enough = adaptation.gain * (off.bound / (NEAR * off.reference[0])).powi(2);
        // One that is fast already lacks no speed.
        let advised = needed.filter(|_| !is_fast).map_or(enough, |needed| needed.min(enough));
        let filter = widest
            .map_or(String::new(), |band| format!(", compared with a filter of {} rad/s", number(three_digits(band))));
        let note = format!(
            "the adaptation turns at {} rad/s{filter}: the output error may reach this bound, with references of \
             about {references}. Use {} = {} with steps {} times shorter, or a smaller {} or {}",
            number(three_digits(turns)),
            v.name(self.design.adaptation_gain),
            number(rounded_up(advised)),
            number(rounded_up((advised / adaptation.gain).sqrt())),
            v.name(self.design.feedback_gain),
            v.name(self.design.sigma_bound),
        );
        report.judge(&name, off.bound, "", verdict, note);
    }

    /// The output whose prediction is worst, in parts of its reference: √(C_i P⁻¹ C_iᵀ θ_m/Γ). `None` where it can't be
    /// found.
    fn worst_prediction(&self, known: Option<&[f64]>, v: &Values<f64>) -> Option<Off> {
        let (P, Q) = (v.matrix(self.design.P).into_owned(), v.matrix(self.design.Q).into_owned());
        let size = (self.uncertain(v).theta_m(&P, &Q) / v[self.design.adaptation_gain]).sqrt();
        let (C, inverse) = (&self.plant.C, P.try_inverse()?);
        let at_rest = v.matrix(self.design.K_g).into_owned().try_inverse()?;
        let all = (0..C.nrows()).map(|i| {
            let row = C.row(i);
            let moved: f64 =
                at_rest.row(i).iter().zip(&v[self.design.sigma_bound]).map(|(y, sigma)| (y * sigma).abs()).sum();
            let half = if moved > 0.0 { 0.5 * moved } else { 1.0 };
            let known = known.and_then(|known| known.get(i)).map(|&known| [known, known]);
            let reference = known.unwrap_or([half.min(1.0), half.max(1.0)]);
            Off { output: i, bound: size * (row * &inverse * row.transpose())[0].max(0.0).sqrt(), reference }
        });
        let rank = |off: &Off| (off.verdict(), off.bound / off.reference[1]);
        let worst = all.max_by(|a, b| rank(a).0.cmp(&rank(b).0).then(rank(a).1.total_cmp(&rank(b).1)))?;
        worst.bound.is_finite().then_some(worst)
    }

    /// The largest K with which the adaptation at rest decays at each input gain within the bounds.
    fn report_tolerance(
        &self,
        design: &L1Design,
        adaptation: &L1Adaptation,
        gain: &str,
        v: &Values<f64>,
        report: &mut DesignReport,
    ) {
        // Direct feedthrough of the filter: if D(s) falls off faster than 1/s, fast motions don't pass.
        let at_once = (&self.filter.C_f * &self.filter.B_f)[0];
        let is_full = self.omega_entries.len() == design.K.len();
        let factor = adaptation.tolerated(&(&design.K * at_once), &design.gains(), is_full);
        let name = format!("{gain} that the adaptation tolerates");
        if factor == f64::INFINITY {
            return report.add_unlimited(
                &name,
                "",
                "the adaptation at rest does not grow for any omega within its bounds",
            );
        }
        let value = &design.K * factor;
        if factor >= 1.0 {
            return report.add(
                &name,
                &value,
                "1/s",
                "up to this value the adaptation at rest decays for each omega within its bounds",
            );
        }
        let note = format!(
            "if the input gain is larger than assumed, the control oscillates at rest; the amplitude decreases with \
             the square root of {}. Use {gain} times {}, or a smaller {}",
            v.name(self.design.adaptation_gain),
            number(rounded_down(factor)),
            v.name(self.design.omega_max)
        );
        report.judge(&name, &value, "1/s", Verdict::Warning, note);
    }

    /// Effect of a wrong input gain on an outside baseline: (ω − I) K_m x counts as part of θ.
    fn report_baseline(&self, design: &L1Design, v: &Values<f64>, report: &mut DesignReport) {
        let Some(K_m) = design.known.as_ref().filter(|_| self.baseline == Baseline::Outside) else { return };
        let m = design.K.nrows();
        let added = |omega: &DMatrix<f64>| {
            let left = ((omega - DMatrix::identity(m, m)) * K_m).abs();
            if self.regressor == Regressor::State { left } else { DMatrix::from_fn(m, 1, |i, _| left.row(i).sum()) }
        };
        let bounds = self.bounds_of_state(v);
        let most =
            design.gains().iter().map(added).fold(bounds.map(|_| 0.0), |most, added| most.zip_map(&added, f64::max));
        let by_element = self.design.theta_bound.len() > m;
        let value = if by_element { most.clone() } else { DMatrix::from_fn(1, m, |_, i| most.row(i).max()) };
        let of_K_m = self.design.name_of_K_m(v).unwrap_or_default();
        let name = format!("(omega - I) {of_K_m}");
        let each = if by_element { "of theta" } else { "for each input" };
        let counts = format!("(omega - I) {of_K_m} x is also uncertain: one element {each}, at the bounds of omega");
        // Bounds that were scaled have rounding in their last digit.
        if most.iter().zip(&bounds).all(|(added, bound)| *added <= bound * (1.0 + 1e-9)) {
            return report.add(&name, &value, "", &counts);
        }
        let note = format!(
            "{counts}. It exceeds {}: for such an omega, theta_hat stays at its bounds and sigma_hat must represent \
             the rest",
            v.name(self.design.theta_bound)
        );
        report.judge(&name, &value, "", Verdict::Warning, note);
    }
}

/// The largest bandwidth of C(s) over the input gains with which it is stable, rad/s.
fn widest(design: &L1Design) -> Option<f64> {
    let fastest = |omega: &DMatrix<f64>| {
        let poles = design.loop_poles(omega)?;
        poles.iter().all(|pole| pole.re < 0.0).then(|| poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max))
    };
    let gains = design.gains();
    let stable = gains.iter().filter_map(|omega| fastest(omega).map(|speed| (speed, omega)));
    let (_, omega) = stable.max_by(|a, b| a.0.total_cmp(&b.0))?;
    design.low_pass_band(omega)
}
