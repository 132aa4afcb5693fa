//! Gains: the same search for every controller.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::bench::CONTROLLER;
use super::condition::Deviation;
use super::pair::{Form, Pair};
use crate::parallel;
use crate::tuning::{Motion, Swarm};

/// What a search of gains came to.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Gains {
    /// The gains, by their names in the loop; none where the controller stays as it is.
    pub values: BTreeMap<String, f64>,
    /// By how much those that the search scales together were scaled.
    pub factors: Vec<(String, f64)>,
    /// The cost with the gains before the search.
    pub before: f64,
    /// The cost with the gains that were found.
    pub after: f64,
    /// Runs of the search.
    pub runs: usize,
}

impl Pair<'_> {
    /// Searches gains for the nominal plant behind sensors and actuators; none where the user interrupts.
    ///
    /// # Errors
    /// When the bench doesn't fit the loop.
    pub fn search(&self, is_interrupted: &(dyn Fn() -> bool + Sync)) -> Result<Option<Gains>, String> {
        let groups = self.tuned();
        let as_it_is = vec![0.0; groups.len()];
        let before = self.costs(&[&as_it_is], is_interrupted)?;
        if groups.is_empty() {
            let gains = Gains { before: before[0], after: before[0], runs: 1, ..Gains::default() };
            return Ok((!is_interrupted()).then_some(gains));
        }
        // Factors are searched by their logarithms.
        let [low, high] = self.budget.gain_range.map(f64::ln);
        let bounds = vec![(low, high); groups.len()];
        let mut swarm = Swarm::new(self.budget.particles, bounds, Some(as_it_is), Motion::default(), self.budget.seed);
        for _ in 0..self.budget.generations {
            let costs = self.costs(&swarm.positions(), is_interrupted)?;
            if is_interrupted() {
                return Ok(None);
            }
            swarm.tell(&costs.into_iter().map(Some).collect::<Vec<_>>());
        }
        let Some(best) = swarm.best() else { return Ok(None) };
        Ok(Some(Gains {
            values: self.scaled(&best.position),
            factors: self.entry.tune.iter().cloned().zip(best.position.iter().map(|factor| factor.exp())).collect(),
            before: before[0],
            after: best.value,
            runs: (1 + self.budget.particles * self.budget.generations) * self.budget.noises as usize,
        }))
    }

    /// The gains at a position, by their names in the loop.
    fn scaled(&self, position: &[f64]) -> BTreeMap<String, f64> {
        let groups = self.tuned().into_iter().zip(position);
        let scale = |(group, factor): (Vec<(String, f64)>, &f64)| {
            let factor = factor.exp();
            group.into_iter().map(move |(name, value)| (name, factor * value))
        };
        groups.flat_map(scale).collect()
    }

    /// The mean cost of each position over noises.
    fn costs(&self, positions: &[&[f64]], is_interrupted: &(dyn Fn() -> bool + Sync)) -> Result<Vec<f64>, String> {
        let noises = self.budget.noises as usize;
        let mut deviations = Vec::new();
        for position in positions {
            for noise in 1..=self.budget.noises {
                let mut deviation = Deviation::default();
                for (name, value) in self.scaled(position) {
                    deviation.set(self.place(&name)?, value);
                }
                self.put_on_bench(&mut deviation, noise.cast_signed())?;
                deviations.push(deviation);
            }
        }
        let duration = self.budget.tuning_time.min(self.plant.duration);
        let workers = vec![(); parallel::cores()];
        let costs = parallel::each(&workers, deviations.len(), |(), k| {
            self.run(&deviations[k], (Form::Whole, duration, self.plant.step), 1.0, is_interrupted).cost
        });
        Ok(costs.chunks(noises).map(|costs| costs.iter().sum::<f64>() / noises as f64).collect())
    }
}

impl Gains {
    /// The gains without the name of the controller, in words.
    pub fn told(&self) -> String {
        let plain = |name: &String| name.strip_prefix(CONTROLLER).unwrap_or(name).trim_start_matches('.').to_owned();
        let told = self.values.iter().map(|(name, value)| format!("{} = {value:.4}", plain(name)));
        told.collect::<Vec<_>>().join(", ")
    }
}
