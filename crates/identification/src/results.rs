//! Results of a fit, of measured states and of outputs alike.

use crate::data::Data;
use crate::finding::{Cause, Refusal};
use crate::held_out::{Disturbance, HeldOut, disturbance, held_out};
use crate::layout::Continuous;
use crate::marquardt::Fit;
use crate::poles::{Pole, poles};
use crate::problem::Problem;
use crate::residuals::{Correlations, Residuals};
use crate::uncertainty::Uncertainty;

/// Findings of a fit.
pub(crate) struct Results {
    pub uncertainty: Uncertainty,
    /// The largest of the first autocorrelations of each signal's residual, in units of 1/√N.
    pub whiteness: Vec<f64>,
    pub correlations: Correlations,
    /// Fits of the held-out part.
    pub fits: Option<HeldOut>,
    /// Fits of the part that is estimated from.
    pub own: Option<HeldOut>,
    pub disturbed: Disturbance,
    /// Poles, in 1/s.
    pub poles: Vec<Pole>,
}

impl Results {
    /// Results of a fit of these signals, `states` or `outputs`; its model is for signals as they are, with constants that are fitted
    /// in these rows.
    pub fn of(
        (problem, fit, signals): (&Problem, &Fit, &str),
        model: &Continuous,
        tested: Option<&Data>,
        (offsets, band): (&[usize], f64),
        noise: &[f64],
    ) -> Result<Self, Refusal> {
        let failed =
            || Refusal::new(Cause::NoModel, format!("no model of these {signals} follows the record: it isn't finite"));
        let (data, hold) = (problem.data, problem.hold);
        let uncertainty = Uncertainty::of(problem, fit).ok_or_else(failed)?;
        let residuals = Residuals::of(problem, fit).ok_or_else(failed)?;
        let correlations = Correlations::of(&residuals, data);
        let largest = |each: &Vec<f64>| each.iter().fold(0.0, |most: f64, one| most.max(one.abs()));
        let found = poles(&model.a, problem.layout, &uncertainty.covariance);
        Ok(Results {
            uncertainty,
            whiteness: correlations.own.iter().map(largest).collect(),
            correlations,
            fits: tested.and_then(|tested| held_out(model, tested, hold, (offsets, band), noise)),
            own: held_out(model, data, hold, (offsets, band), noise),
            disturbed: tested.and_then(|tested| disturbance(model, tested, hold, band, noise)).unwrap_or_default(),
            poles: found.into_iter().map(|pole| pole.scaled(1.0 / data.scaling.h)).collect(),
        })
    }
}
