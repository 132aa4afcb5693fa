//! Report of an observer.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{DMatrix, DVector};

use super::Observer;
use crate::controllers::l1::controllability;
use crate::design::digits;
use crate::design::robustness::place::Place;
use crate::design::robustness::report::{Described, report_number};
use crate::design::robustness::uncertain::Uncertain;
use crate::eigenvalues;
use crate::system::{DesignReport, Values};
use crate::template::three_digits;

/// An error has decayed to 2 % after so many time constants.
const TO_2_PERCENT: f64 = 3.912;

impl Observer {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        let k_l = self.k_l.matrix(v).into_owned();
        report.section("Observer");
        report.eigenvalues("eigenvalues of A", &self.A, false);
        report.eigenvalues("eigenvalues of A - k_l C", &(&self.A - &k_l * &self.C), true);
        controllability(["observability", "A", "C"], [&self.A.transpose(), &self.C.transpose()], report);
        report.add("k_l", &k_l, "", "gain of the output error");
        self.report_estimate(v, report);
        report.section("Adaptation");
        let leak = v[self.Gamma_l] * v[self.sigma_l];
        let (beta, delta) = (v.name(self.beta), v.name(self.delta));
        let (gain, leakage, error) = (v.name(self.Gamma_l), v.name(self.sigma_l), v.name(self.y_tilde));
        let note = format!("{gain} {leakage}: rate at which {beta} falls where {error} is 0");
        report.add(&format!("leakage of {beta}"), leak, "1/s", &note);
        let rest = v[self.d_0] / v[self.lambda_0];
        let note = format!("{}/{}, where {} is 0", v.name(self.d_0), v.name(self.lambda_0), v.name(self.y));
        report.add(&format!("{delta} at rest"), rest, "", &note);
        report.add(&format!("decay of {delta}"), v[self.lambda_0], "1/s", "");
    }

    /// Reports the decay of the estimation error with the plant of the description, and its rest in steady state.
    fn report_estimate(&self, v: &Values<f64>, report: &mut DesignReport) {
        let m = self.C.nrows();
        let Some(described) = report.nominal().and_then(|nominal| Described::new(nominal, m)) else { return };
        let plant = &described.plant;
        let k_l = self.k_l.matrix(v).into_owned();
        let closed = &self.A - &k_l * &self.C;
        let Some(poles) = eigenvalues::complex(&closed) else { return };
        let slowest = poles.iter().map(|pole| -pole.re).fold(f64::INFINITY, f64::min);
        report.section("Nominal plant");
        let time = three_digits(TO_2_PERCENT / slowest);
        report.add(
            "decay of the estimate's error",
            time,
            "s",
            "to 2 %, with the slowest pole, where the plant is the nominal one",
        );
        let settles = format!("an error of the estimate decays to 2 % in {} s", digits(time));
        if !described.assumed.is_known() {
            return report.summarise(settles);
        }
        let (drawn, seed) = described.drawn;
        let mut places = vec![Place::nominal(plant.size())];
        places.extend(plant.bounds.drawn(drawn, seed));
        report_number(&places, report);
        // The gain in the coordinates of the uncertain plant, with time in 1/W.
        let gain = DMatrix::from_fn(k_l.nrows(), m, |i, j| k_l[(i, j)] / plant.scales[i] / plant.bandwidth);
        let known = v.get(self.known_input);
        let errors = places.iter().filter_map(|place| error_at_rest(plant, place, &gain, known, &described.reference));
        let Some(worst) = errors.reduce(|one, other| one.sup(&other)) else { return report.summarise(settles) };
        let worst = worst.component_mul(&plant.scales).map(three_digits);
        let note =
            "of each state at most, in its unit, while outputs are at their references: what the plant differs by";
        let row = DMatrix::from_row_slice(1, worst.len(), worst.as_slice());
        report.add("error of the estimate at rest", &row, "", note);
        let off = worst.iter().copied().map(digits).collect::<Vec<_>>().join(", ");
        report.summarise(format!("{settles}; worst of {} plants: off by {off} at rest", places.len()));
    }
}

/// The largest error of the estimate of each state while outputs stay at their references; `None` for a plant that has no such
/// rest.
fn error_at_rest(
    plant: &Uncertain,
    place: &Place,
    k_l: &DMatrix<f64>,
    knows_input: bool,
    references: &[f64],
) -> Option<DVector<f64>> {
    let (n, m) = plant.size();
    let [A, B] = plant.at(place);
    let mut whole = DMatrix::zeros(n + m, n + m);
    whole.view_mut((0, 0), (n, n)).copy_from(&A);
    whole.view_mut((0, n), (n, m)).copy_from(&B);
    whole.view_mut((n, 0), (m, n)).copy_from(&plant.C);
    let (rest, observer) = (whole.lu(), (&plant.A - k_l * &plant.C).lu());
    let mut errors = DVector::zeros(n);
    for (i, reference) in references.iter().enumerate() {
        let mut ends = DVector::zeros(n + m);
        ends[n + i] = *reference;
        let at_rest = rest.solve(&ends)?;
        let (x, u) = (at_rest.rows(0, n), at_rest.rows(n, m));
        let known = if knows_input { &plant.B * u } else { DVector::zeros(n) };
        // 0 = A x̆ − k_l (C x̆ − y) + B u
        let estimate = observer.solve(&-(k_l * (&plant.C * x) + known))?;
        errors = errors.sup(&(estimate - x).abs());
    }
    errors.iter().all(|error| error.is_finite()).then_some(errors)
}
