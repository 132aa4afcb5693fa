//! Gains: the same search for every controller.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::bench::CONTROLLER;
use super::condition::Deviation;
use super::pair::{Form, Pair};
use crate::parallel;
use crate::tuning::{Motion, Swarm};

/// Result of a search of gains.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Gains {
    /// The gains, by their names in the loop; none if the controller stays as it is.
    pub values: BTreeMap<String, f64>,
    /// Factor of each group of gains that the search scales together.
    pub factors: Vec<(String, f64)>,
    /// The cost with the gains before the search.
    pub before: f64,
    /// The cost with the gains that were found.
    pub after: f64,
    /// Runs of the search.
    pub runs: usize,
}

impl Pair<'_> {
    /// Searches gains for the nominal plant with sensors and actuators; none if the user interrupts.
    ///
    /// # Errors
    /// If the bench doesn't fit the loop.
    pub fn search(&self, is_interrupted: &(dyn Fn() -> bool + Sync)) -> Result<Option<Gains>, String> {
        let groups = self.tuned();
        let as_it_is = vec![0.0; groups.len()];
        if groups.is_empty() {
            let cost = self.costs(&[&as_it_is], &[f64::INFINITY], is_interrupted)?[0];
            let gains = Gains { before: cost, after: cost, runs: self.budget.noises as usize, ..Gains::default() };
            return Ok((!is_interrupted()).then_some(gains));
        }
        self.fold_once();
        // Factors are searched by their logarithms. The first particle starts at the initial gains.
        let [low, high] = self.budget.gain_range.map(f64::ln);
        let bounds = vec![(low, high); groups.len()];
        let mut swarm = Swarm::new(self.budget.particles, bounds, Some(as_it_is), Motion::default(), self.budget.seed);
        let mut before = None;
        for _ in 0..self.budget.generations {
            let costs = self.costs(&swarm.positions(), &swarm.bounds_of_values(), is_interrupted)?;
            if is_interrupted() {
                return Ok(None);
            }
            before = before.or(costs.first().copied());
            swarm.tell(&costs.into_iter().map(Some).collect::<Vec<_>>());
        }
        let (Some(before), Some(best)) = (before, swarm.best()) else { return Ok(None) };
        Ok(Some(Gains {
            values: self.scaled(&best.position),
            factors: self.entry.tune.iter().cloned().zip(best.position.iter().map(|factor| factor.exp())).collect(),
            before,
            after: best.value,
            runs: self.budget.particles * self.budget.generations * self.budget.noises as usize,
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

    /// The mean cost of each position over noises. A run ends once its cost exceeds the position's bound, since the
    /// swarm treats all numbers above it alike.
    fn costs(
        &self,
        positions: &[&[f64]],
        bounds: &[f64],
        is_interrupted: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<f64>, String> {
        let noises = 1..=self.budget.noises.cast_signed();
        let deviations = |position: &&[f64]| {
            let gains = self.scaled(position).into_iter();
            let gains =
                gains.map(|(name, value)| Ok((self.place(&name)?, value))).collect::<Result<Vec<_>, String>>()?;
            let noisy = |seed: i32| {
                let mut deviation = Deviation::default();
                gains.iter().for_each(|&(place, value)| deviation.set(place, value));
                self.put_on_bench(&mut deviation, seed)?;
                Ok(deviation)
            };
            noises.clone().map(noisy).collect::<Result<Vec<_>, String>>()
        };
        let deviations = positions.iter().map(deviations).collect::<Result<Vec<_>, String>>()?;
        let how = (Form::Whole, self.budget.tuning_time.min(self.plant.duration), self.plant.step);
        let workers = vec![(); parallel::cores()];
        Ok(parallel::each(&workers, deviations.len(), |(), k| {
            let (count, mut sum) = (f64::from(self.budget.noises), 0.0);
            for deviation in &deviations[k] {
                let left = count * bounds[k] - sum;
                if left < 0.0 {
                    break;
                }
                sum += self.run_while_cheap(deviation, how, (1.0, left), is_interrupted).cost;
            }
            sum / count
        }))
    }
}

impl Gains {
    /// The gains as text, without the name of the controller.
    pub fn to_text(&self) -> String {
        let plain = |name: &String| name.strip_prefix(CONTROLLER).unwrap_or(name).trim_start_matches('.').to_owned();
        let pairs = self.values.iter().map(|(name, value)| format!("{} = {value:.4}", plain(name)));
        pairs.collect::<Vec<_>>().join(", ")
    }
}
