//! Design report of an L1 law with the plant that it was designed for, and with uncertain ones about it.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;

use super::Baseline;
use super::law::Law;
use super::ports::Ports;
use super::structure::PlantMatrices;
use crate::controllers::at_limit::unit;
use crate::design::l1::assess::assess;
use crate::design::l1::closed;
use crate::design::l1::lambda::excess;
use crate::design::robustness::region::Region;
use crate::design::robustness::report::{Described, Unit};
use crate::nominal::NominalPlant;
use crate::report::Value;
use crate::system::{DesignReport, Values, Verdict};

/// Numbers of a law, as its unit has them.
#[derive(Debug)]
pub(in crate::controllers) struct Numbers {
    /// Desired dynamics.
    pub A_m: DMatrix<f64>,
    /// Gain of the baseline, where there is one.
    pub K_m: Option<DMatrix<f64>>,
    /// Gains of the filter, the parameter first.
    pub K: Vec<DMatrix<f64>>,
    /// P of the Lyapunov equation, of a law that adapts.
    pub P: Option<DMatrix<f64>>,
    /// True if the estimates see the baseline.
    pub is_inside: bool,
}

/// Warns where the plant of the structure isn't that of `[nominal]`, which the figures are for.
fn compare(own: &PlantMatrices, report: &mut DesignReport) {
    let Some(NominalPlant { A, B, C, .. }) = report.nominal() else { return };
    let differs = own.A.as_ref().is_some_and(|own| own != A) || own.B != *B || own.C != *C;
    if differs {
        report.section("Nominal loop");
        let note = "A, B, C of [structure] are others than those of [nominal], which all figures here are for. Change both, or begin \
                    with `new --plant` again";
        report.judge("plant", "differs", "", Verdict::Warning, note);
    }
}

/// Reports steps of the reference, and if uncertain plants are stable: true where their uncertainty decides about the design.
pub(in crate::controllers) fn report_robustness(
    own: &PlantMatrices,
    numbers: &Numbers,
    unit: &Unit,
    report: &mut DesignReport,
) -> bool {
    compare(own, report);
    let channels = numbers.K[0].nrows();
    let Some(described) = report.nominal().and_then(|nominal| Described::new(nominal, channels)) else { return false };
    let plant = &described.plant;
    if plant.A.shape() != numbers.A_m.shape() {
        return false;
    }
    let W = plant.bandwidth;
    let K_m = numbers.K_m.as_ref().map_or_else(|| DMatrix::zeros(channels, plant.A.nrows()), |K_m| plant.feedback(K_m));
    let A_m = plant.dynamics(&numbers.A_m);
    let P = numbers.P.as_ref().map(|P| plant.weight(P));
    let law = |K: &DMatrix<f64>| match &P {
        Some(P) => closed::Law::adaptive(plant, &K_m, &A_m, &(K / W), P),
        None => closed::Law::limit(plant, &K_m, &A_m, &(K / W)),
    };
    let laws: Option<Vec<_>> = numbers.K.iter().map(law).collect();
    let Some(laws) = laws else { return false };
    let H = unit.step * W;
    let region = Region::new(plant, &laws[0], described.drawn);
    described.report(&laws[0], &region, unit, report);
    if !described.assumed.is_known() {
        return false;
    }
    let excess = if numbers.is_inside { plant.bounds.A.clone() } else { excess(plant, &K_m) };
    let assumed = &described.assumed;
    let mut found = assess(plant, &laws[0], &region, &excess, H, assumed.most());
    found.is_stable &= laws[1..].iter().all(|law| region.is_stable(plant, law, H));
    let (verdict, text) = found.verdict(assumed);
    let stable = assumed.share(found.stable);
    match (verdict, found.lambda) {
        (Verdict::NotSound, _) => report.judge("stable up to", stable, "", verdict, text),
        (_, lambda) => {
            report.add("stable up to", stable, "", "uncertainty up to which all plants tried are stable");
            report.judge("lambda*", lambda.map_or_else(|| "not computed".into(), Value::from), "", verdict, text);
        }
    }
    if let Some(text) = found.at_rest() {
        report.judge("at rest, 95 % of the plants", 100.0 * found.off_at_rest, "%", Verdict::Warning, text);
    }
    true
}

impl Law {
    /// The same with these gains of the filter; nothing where it is more than its filter 1/s and matched estimates.
    pub(super) fn report_plants(
        &self,
        gains: &[(&str, DMatrix<f64>)],
        v: &Values<f64>,
        report: &mut DesignReport,
    ) -> bool {
        if !self.filter.is_integrator() || self.unmatched.is_some() || self.added.is_some() {
            return false;
        }
        let numbers = Numbers {
            A_m: self.design.A_m(v).into_owned(),
            K_m: self.design.K_m(v).filter(|_| self.baseline != Baseline::None).map(|K_m| K_m.into_owned()),
            K: gains.iter().map(|(_, K)| K.clone()).collect(),
            P: Some(v.matrix(self.design.P).into_owned()),
            is_inside: self.baseline == Baseline::Inside,
        };
        let Ports { u, u_min, u_max, .. } = self.ports;
        report_robustness(&self.plant, &numbers, &unit(u, [u_min, u_max], v, report.step), report)
    }
}
