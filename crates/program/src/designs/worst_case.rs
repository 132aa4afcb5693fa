//! The worst plant within the uncertainty of a description, from a search with runs of its loop as FMUs.
#![allow(non_snake_case)] // matrices have the names of the field

use std::time::Duration;

use super::design_loop::{DesignLoop, nominal_of};
use super::series::{Course, Followed};
use super::trial::{NotRun, Trial};
use crate::clock::Instant;
use crate::design::robustness::assumed::Assumed;
use crate::design::robustness::bounds::Bounds;
use crate::error::Error;
use crate::exporter::Source;
use crate::fmu::Ready;
use crate::nominal::{NominalPlant, WorstPlant};
use crate::parallel;
use crate::tuning::{Motion, Swarm};
use crate::workers::{employed, results};

/// Particles of the swarm.
const PARTICLES: usize = 24;
/// Duration of a run, in 1/W.
const DURATION: f64 = 20.0;

/// The result of a search.
#[derive(Debug)]
pub struct WorstCase {
    /// The plant.
    pub plant: WorstPlant,
    /// Steps of its loop, or the reason why it fails.
    pub followed: Result<Followed, String>,
    /// Number of plants that were tried.
    pub tried: usize,
}

/// Figures of the loop of a description.
#[derive(Debug)]
pub(super) struct Steps {
    /// Steps of the references.
    pub followed: Followed,
    /// Name of each control, and the larger of its limits.
    pub controls: Vec<(String, f64)>,
    /// Duration of the run, s.
    pub duration: f64,
    /// True if the description has bounds of its plant's entries.
    pub has_others: bool,
}

/// The loop of a description, for runs with plants within the bounds of `[nominal]`.
#[derive(Debug)]
pub struct Cases {
    nominal: NominalPlant,
    bounds: Bounds,
    trial: Trial,
    duration: f64,
}

impl Cases {
    /// The loop of a description.
    ///
    /// # Errors
    /// When the description has no uncertain plant, or its loop can't be closed by the names of its signals.
    pub fn new(source: &Source, units: &Ready) -> Result<Self, Error> {
        let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
        let (_, nominal) = nominal_of(source)?;
        let bounds = bounds(&nominal).ok_or_else(|| refuse("[nominal] has no uncertainty".to_owned()))?;
        let trial = DesignLoop::new(source, units.library())?.trial(units)?;
        let duration = DURATION / nominal.bandwidth.unwrap_or(1.0);
        Ok(Cases { nominal, bounds, trial, duration })
    }

    /// The integral of the squared error of steps of the references with a plant; 0 is the nominal one, −1 and 1 are
    /// bounds.
    ///
    /// # Errors
    /// Why its loop fails.
    pub fn squared_error(&self, place: &[f64]) -> Result<f64, String> {
        let found = self.trial.squared_error(&plant_at(&self.nominal, &self.bounds, place), self.duration);
        found.map_err(|error| error.to_string())
    }

    /// The same for many plants, on all threads or by the workers of the command; fewer if the command should stop.
    fn squared_errors(&self, places: &[&[f64]]) -> Vec<Result<f64, String>> {
        if let Some(workers) = employed() {
            return results(&*workers, places, |_| ()).into_iter().map_while(|value| value).collect();
        }
        parallel::each(&vec![(); parallel::cores()], places.len(), |(), k| self.squared_error(places[k]))
    }

    fn found(&self, place: &[f64], tried: usize) -> WorstCase {
        let plant = plant_at(&self.nominal, &self.bounds, place);
        let followed = self.trial.steps(Some(&plant), self.duration).map(|(followed, _)| followed);
        WorstCase { plant, followed: followed.map_err(|error| error.to_string()), tried }
    }

    /// Searches for some time, by a particle swarm, for the plant with the largest integral of the squared error of
    /// steps of the references. A plant whose loop fails ends the search.
    ///
    /// # Errors
    /// When the loop fails with the nominal plant.
    pub fn worst(&self, seconds: f64, seed: u64) -> Result<WorstCase, Error> {
        let count = self.bounds.dimensions();
        let mut swarm =
            Swarm::new(PARTICLES, vec![(-1.0, 1.0); count], Some(vec![0.0; count]), Motion::default(), seed);
        // A loop that fails with the nominal plant doesn't fail because of the plant.
        self.trial.course(0, None, self.duration).map_err(|reason| reason.error())?;
        let (begun, mut tried) = (Instant::now(), 0);
        loop {
            let positions = swarm.positions();
            let values = self.squared_errors(&positions);
            tried += values.len();
            if let Some(k) = values.iter().position(Result::is_err) {
                return Ok(self.found(positions[k], tried));
            }
            if values.len() < positions.len() {
                break;
            }
            let values: Vec<_> = values.into_iter().map(|value| value.ok().map(|error| -error)).collect();
            swarm.tell(&values);
            if begun.elapsed() >= Duration::from_secs_f64(seconds) {
                break;
            }
        }
        let best = swarm.best().map_or_else(|| vec![0.0; count], |best| best.position.clone());
        Ok(self.found(&best, tried))
    }
}

/// Steps of the references in the loop of a description and its nominal plant, from runs of the FMUs with the limits of
/// the control and its communication step. `None` if they take too long.
///
/// # Errors
/// When the description has no nominal plant, its loop can't be closed by the names of its signals, or a run fails.
pub(super) fn steps(source: &Source, units: &Ready) -> Result<Option<Steps>, Error> {
    let (_, nominal) = nominal_of(source)?;
    let design = DesignLoop::new(source, units.library())?;
    let DesignLoop { controls, .. } = &design;
    let (trial, controls) = (design.trial(units)?, controls.clone());
    let duration = DURATION / nominal.bandwidth.unwrap_or(1.0);
    let seconds = duration * trial.references() as f64;
    let trial = trial.within(seconds);
    let has_others = bounds(&nominal).is_some();
    match trial.steps(None, duration) {
        Err(NotRun::TooLong(_)) => Ok(None),
        Ok((followed, _)) => Ok(Some(Steps { followed, controls, duration, has_others })),
        Err(reason) => Err(reason.error()),
    }
}

/// The bounds of the uncertain entries; `None` if nothing is uncertain.
fn bounds(NominalPlant { A, B, uncertainty, .. }: &NominalPlant) -> Option<Bounds> {
    let bounds = Assumed::new(A, B, uncertainty).bounds;
    (bounds.dimensions() > 0).then_some(bounds)
}

fn plant_at(nominal: &NominalPlant, bounds: &Bounds, position: &[f64]) -> WorstPlant {
    let place = bounds.place(position);
    let (A, B) = (&nominal.A + bounds.A.component_mul(&place.A), &nominal.B + bounds.B.component_mul(&place.B));
    let [A, B] = [A, B].map(|matrix| matrix.row_iter().map(|row| row.iter().copied().collect()).collect());
    WorstPlant { respects: vec!["squared error".to_owned()], A, B }
}

impl Trial {
    /// The integral of the squared error of steps of all references, in parts of the steps.
    fn squared_error(&self, plant: &WorstPlant, duration: f64) -> Result<f64, NotRun> {
        let of = |i: usize| Ok(self.error_of(i, &self.course(i, Some(plant), duration)?));
        (0..self.references()).map(of).sum()
    }

    fn error_of(&self, i: usize, course: &Course) -> f64 {
        let size = self.size(i);
        let errors = course.outputs[i].iter().map(|y| (y / size - 1.0).powi(2));
        errors.sum::<f64>() * self.step
    }
}
