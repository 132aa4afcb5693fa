//! Particle swarm optimisation.
//!
//! J. Kennedy and R. Eberhart, Particle swarm optimization, Proc. IEEE Int. Conf. Neural Networks 4 (1995) 1942–1948;
//! with an inertia that decreases and a limit of the velocity, as in chapter 4 of the thesis:
//!
//! v ← α v + c₁ r₁ (x* − x) + c₂ r₂ (x** − x), x ← x + v,
//!
//! where x* is the best position of a particle, x** the best of all, and r are random numbers in [0, 1). The crate
//! argmin has a swarm, but its inertia is constant and its velocity unlimited. It can't hand out positions and take
//! their values later, which an interrupted search needs.

use fastrand::Rng;
use serde::{Deserialize, Serialize};

/// Motion of a swarm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// c₁, the pull of a particle's own best position.
    pub cognitive: f64,
    /// c₂, the pull of the best position of all.
    pub social: f64,
    /// α of the first generation.
    pub inertia: f64,
    /// Factor of α from generation to generation.
    pub decay: f64,
    /// Largest velocity, in parts of the distance of the bounds.
    pub velocity_limit: f64,
}

impl Default for Motion {
    fn default() -> Self {
        Motion { cognitive: 2.0, social: 2.0, inertia: 1.0, decay: 0.99, velocity_limit: 0.1 }
    }
}

/// A position with its value, the smaller the better.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// The position.
    pub position: Vec<f64>,
    /// Its value.
    pub value: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Particle {
    position: Vec<f64>,
    velocity: Vec<f64>,
    best: Option<Best>,
}

/// Result of a generation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Generation {
    /// The best value of all generations so far, if any.
    pub best: Option<f64>,
    /// The median of the particles' best values so far; those without one count as worst.
    pub median: Option<f64>,
    /// Number of positions without a value.
    pub failed: usize,
}

/// A swarm, whose [positions](Swarm::positions) are evaluated elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Swarm {
    motion: Motion,
    bounds: Vec<(f64, f64)>,
    /// State of the random numbers.
    random: u64,
    particles: Vec<Particle>,
    best: Option<Best>,
    history: Vec<Generation>,
}

impl Swarm {
    /// A swarm of particles anywhere within the bounds; the first one at `start`, if there is one.
    ///
    /// # Panics
    /// Without particles or bounds, or with a start of a different size.
    pub fn new(particles: usize, bounds: Vec<(f64, f64)>, start: Option<Vec<f64>>, motion: Motion, seed: u64) -> Self {
        assert!(particles > 0 && !bounds.is_empty(), "a swarm needs particles and parameters");
        let mut random = Rng::with_seed(seed);
        let mut particle = || {
            let position = bounds.iter().map(|(low, high)| low + random.f64() * (high - low)).collect();
            let speed = |(low, high): &(f64, f64)| motion.velocity_limit * (high - low);
            let velocity = bounds.iter().map(|bounds| (2.0 * random.f64() - 1.0) * speed(bounds)).collect();
            Particle { position, velocity, best: None }
        };
        let mut particles: Vec<_> = (0..particles).map(|_| particle()).collect();
        if let Some(start) = start {
            assert_eq!(start.len(), bounds.len());
            particles[0].position = start;
        }
        Swarm { motion, bounds, random: random.get_seed(), particles, best: None, history: Vec::new() }
    }

    /// The positions whose values are wanted.
    pub fn positions(&self) -> Vec<&[f64]> {
        self.particles.iter().map(|particle| particle.position.as_slice()).collect()
    }

    /// Bound below which each position's value must be to count: the best of its particle so far.
    pub fn bounds_of_values(&self) -> Vec<f64> {
        let best = |particle: &Particle| particle.best.as_ref().map_or(f64::INFINITY, |best| best.value);
        self.particles.iter().map(best).collect()
    }

    /// The best position so far.
    pub fn best(&self) -> Option<&Best> {
        self.best.as_ref()
    }

    /// Results of the generations whose values are known.
    pub fn history(&self) -> &[Generation] {
        &self.history
    }

    /// Notes the values of all positions, with none for a failed one, and moves on. All values that aren't below their
    /// position's [bound](Self::bounds_of_values) have the same effect.
    ///
    /// # Panics
    /// When there are not as many values as positions.
    pub fn tell(&mut self, values: &[Option<f64>]) {
        assert_eq!(values.len(), self.particles.len());
        for (particle, value) in self.particles.iter_mut().zip(values) {
            let Some(value) = value.filter(|value| value.is_finite()) else { continue };
            let here = || Best { position: particle.position.clone(), value };
            if is_better(value, self.best.as_ref()) {
                self.best = Some(here());
            }
            if is_better(value, particle.best.as_ref()) {
                particle.best = Some(here());
            }
        }
        let mut known: Vec<f64> = self.particles.iter().filter_map(|it| Some(it.best.as_ref()?.value)).collect();
        known.sort_by(f64::total_cmp);
        let (best, median) = (self.best.as_ref().map(|best| best.value), known.get((values.len() - 1) / 2).copied());
        self.fly();
        let failed = values.iter().filter(|value| value.is_none_or(|value| !value.is_finite())).count();
        self.history.push(Generation { best, median, failed });
    }

    fn fly(&mut self) {
        let Motion { cognitive, social, inertia, decay, velocity_limit } = self.motion;
        let inertia = inertia * decay.powi(i32::try_from(self.history.len()).unwrap_or(i32::MAX));
        let mut random = Rng::with_seed(self.random);
        for Particle { position, velocity, best } in &mut self.particles {
            for (k, &(low, high)) in self.bounds.iter().enumerate() {
                // A particle without a best position is pulled to none.
                let mut pull = |strength: f64, to: Option<&Best>| {
                    strength * random.f64() * to.map_or(0.0, |best| best.position[k] - position[k])
                };
                let pulls = pull(cognitive, best.as_ref()) + pull(social, self.best.as_ref());
                let limit = velocity_limit * (high - low);
                velocity[k] = (inertia * velocity[k] + pulls).clamp(-limit, limit);
                let target = position[k] + velocity[k];
                position[k] = target.clamp(low, high);
                // A particle that hits a bound stays there until it is pulled back.
                if target != position[k] {
                    velocity[k] = 0.0;
                }
            }
        }
        self.random = random.get_seed();
    }
}

/// True if a value is better than the best one, if any.
pub fn is_better(value: f64, best: Option<&Best>) -> bool {
    best.is_none_or(|best| value < best.value)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley, with its minimum 0 at (1, 1).
    fn valley(x: &[f64]) -> f64 {
        (1.0 - x[0]).powi(2) + 100.0 * (x[1] - x[0] * x[0]).powi(2)
    }

    fn swarm(seed: u64) -> Swarm {
        Swarm::new(30, vec![(-2.0, 2.0), (-1.0, 3.0)], None, Motion::default(), seed)
    }

    fn advance(swarm: &mut Swarm, generations: usize, objective: impl Fn(&[f64]) -> Option<f64>) {
        for _ in 0..generations {
            let values: Vec<_> = swarm.positions().into_iter().map(&objective).collect();
            swarm.tell(&values);
        }
    }

    #[test]
    fn the_minimum_of_a_curved_valley_is_found() {
        for seed in 0..5 {
            let mut swarm = swarm(seed);
            advance(&mut swarm, 300, |x| Some(valley(x)));
            let Best { position, value } = swarm.best().unwrap();
            assert!(*value < 1e-3, "seed {seed}: {value} at {position:?}");
        }
    }

    #[test]
    fn positions_stay_within_bounds_and_steps_within_the_limit() {
        let mut swarm = swarm(1);
        for _ in 0..50 {
            let before: Vec<Vec<f64>> = swarm.positions().into_iter().map(<[f64]>::to_vec).collect();
            // The minimum lies in a corner.
            advance(&mut swarm, 1, |x| Some(x[0] - x[1]));
            for (before, after) in before.iter().zip(swarm.positions()) {
                assert!((-2.0..=2.0).contains(&after[0]) && (-1.0..=3.0).contains(&after[1]));
                assert!(before.iter().zip(after).all(|(a, b)| (a - b).abs() <= 0.4 + 1e-12));
            }
        }
        assert_eq!(swarm.best().unwrap().position, [-2.0, 3.0]);
    }

    #[test]
    fn what_has_no_value_is_worst_and_ends_nothing() {
        let mut swarm = swarm(2);
        advance(&mut swarm, 2, |_| None);
        assert_eq!((swarm.best(), swarm.history()[1]), (None, Generation { best: None, median: None, failed: 30 }));
        advance(&mut swarm, 100, |x| (x[0] > 0.5).then(|| valley(x)));
        assert!(swarm.best().unwrap().value < 1e-2 && swarm.history()[2].failed > 0);
    }

    #[test]
    fn a_swarm_that_was_written_down_goes_on_as_if_it_had_not_been() {
        let (mut swarm, mut other) = (swarm(3), swarm(4));
        advance(&mut swarm, 7, |x| (x[1] < 2.5).then(|| valley(x)));
        let mut read: Swarm = serde_json::from_str(&serde_json::to_string(&swarm).unwrap()).unwrap();
        for swarm in [&mut swarm, &mut read, &mut other] {
            advance(swarm, 7, |x| Some(valley(x)));
        }
        assert_eq!(read, swarm);
        assert_ne!(other.positions(), swarm.positions());
    }

    #[test]
    fn the_start_is_among_the_first_positions_so_that_the_best_is_never_worse() {
        let start = vec![0.9, 0.8];
        let mut swarm = Swarm::new(2, vec![(-2.0, 2.0), (-1.0, 3.0)], Some(start.clone()), Motion::default(), 1);
        advance(&mut swarm, 1, |x| Some(valley(x)));
        assert!(swarm.best().unwrap().value <= valley(&start));
    }
}
