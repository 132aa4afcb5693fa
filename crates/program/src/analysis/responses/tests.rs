//! Random unstable plants, whose linear systems are known.

use super::*;
use crate::analysis::sampled::{Experiment, Shape};
use crate::eigenvalues::complex;

/// x' = A x + B u + small terms of second and third order.
struct Plant {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    /// Factor of the nonlinear terms, and rows that they act on.
    bent: f64,
    step: f64,
    starts: Vec<usize>,
    /// Rounding of what it shows.
    blur: f64,
    /// True if a load keeps it at its start.
    held: bool,
}

impl Plant {
    fn rates(&self, x: &[f64], u: &[f64]) -> Vec<f64> {
        let n = x.len();
        let bend = |value: f64| value - value.sin() + 0.3 * (1.0 - value.cos());
        let row = |i: usize| {
            let linear = (0..n).map(|j| self.a[(i, j)] * x[j]).sum::<f64>();
            let driven = (0..u.len()).map(|j| self.b[(i, j)] * u[j]).sum::<f64>();
            let load = self.bent * bend(x[(i + 1) % n]) * self.a.row(i).amax();
            linear - load + driven * (1.0 - self.bent * 0.2 * (1.0 - x[(i + 2) % n].cos()))
        };
        (0..n).map(row).collect()
    }

    fn stepped(&self, x: &mut [f64], u: &[f64], load: &[f64]) {
        let parts = 4;
        let h = self.step / f64::from(parts);
        let rates = |x: &[f64]| self.rates(x, u).iter().zip(load).map(|(rate, load)| rate - load).collect::<Vec<_>>();
        let moved = |x: &[f64], k: &[f64], h: f64| x.iter().zip(k).map(|(x, k)| x + h * k).collect::<Vec<_>>();
        for _ in 0..parts {
            let k1 = rates(x);
            let k2 = rates(&moved(x, &k1, h / 2.0));
            let k3 = rates(&moved(x, &k2, h / 2.0));
            let k4 = rates(&moved(x, &k3, h));
            for i in 0..x.len() {
                x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
        }
    }

    fn answer(&self, start: Option<(usize, f64)>, input: Option<(usize, f64)>, steps: usize) -> DMatrix<f64> {
        let mut x = vec![0.0; self.a.nrows()];
        if let Some((state, value)) = start {
            x[state] = value;
        }
        let load = if self.held { self.rates(&x, &vec![0.0; self.b.ncols()]) } else { vec![0.0; x.len()] };
        let mut states = DMatrix::zeros(x.len(), steps + 1);
        let mut noise = fastrand::Rng::with_seed(start.or(input).map_or(0, |(_, value)| value.to_bits()));
        for k in 0..=steps {
            for i in 0..x.len() {
                states[(i, k)] = x[i] + self.blur * (noise.f64() - 0.5);
            }
            let mut u = vec![0.0; self.b.ncols()];
            if let Some((input, value)) = input.filter(|_| k < steps / 2) {
                u[input] = value;
            }
            self.stepped(&mut x, &u, &load);
        }
        states
    }
}

impl Subject for Plant {
    fn shape(&self) -> Shape {
        Shape { states: self.a.nrows(), inputs: self.b.ncols(), outputs: (0..self.a.nrows()).map(Some).collect() }
    }

    fn step(&self) -> f64 {
        self.step
    }

    fn starts(&self) -> Vec<usize> {
        self.starts.clone()
    }

    fn experiment(&self, moved: Moved, part: f64, steps: usize) -> Result<Experiment, Error> {
        let change = CHANGE * part;
        let answer = |change: f64| match moved {
            Moved::Start(state) => self.answer(Some((state, change)), None, steps),
            Moved::Input(input) => self.answer(None, Some((input, change)), steps),
        };
        let states = (answer(change) - answer(-change)) * 0.5;
        Ok(Experiment { moved, change, outputs: states.clone(), states })
    }
}

/// A random plant with an unstable eigenvalue, whose fastest is within 2 … 30 rad/s. Some are mechanical, with
/// positions and velocities, some dense.
/// velocities, some dense.
fn random(seed: u64) -> Plant {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut normal = || (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
    let half = 1 + (normal().abs() * 1.2) as usize % 3;
    let mechanical = normal() > 0.0;
    let n = if mechanical { 2 * half } else { 2 + (normal().abs() * 2.0) as usize % 4 };
    let mut a = DMatrix::from_fn(n, n, |_, _| normal());
    if mechanical {
        for i in 0..half {
            a.row_mut(i).fill(0.0);
            a[(i, half + i)] = 1.0;
        }
        for i in half..n {
            for j in 0..half {
                a[(i, j)] *= 5.0;
            }
        }
    }
    let largest = |a: &DMatrix<f64>| complex(a).unwrap().iter().map(|value| value.norm()).fold(0.0, f64::max);
    let most = |a: &DMatrix<f64>| complex(a).unwrap().iter().map(|value| value.re).fold(f64::MIN, f64::max);
    let wanted = 2.0 * 15.0_f64.powf(normal().abs().min(2.0) / 2.0);
    // Only time is scaled, so that a plant with positions stays one.
    if mechanical {
        let faster = wanted / largest(&a);
        for i in half..n {
            for j in 0..n {
                a[(i, j)] *= if j < half { faster * faster } else { faster };
            }
        }
    } else {
        a *= wanted / largest(&a);
    }
    if most(&a) <= 0.0 {
        if mechanical { a[(half, 0)] += wanted * wanted } else { a[(0, 0)] += wanted }
    }
    let m = 1 + usize::from(normal() > 0.5);
    let b = DMatrix::from_fn(n, m, |i, _| if mechanical && i < half { 0.0 } else { normal() });
    Plant { a, b, bent: normal().abs(), step: 1e-3, starts: Vec::new(), blur: 0.0, held: false }
}

/// The largest distance of eigenvalues, relative to the largest.
fn error(plant: &Plant, found: &DMatrix<f64>) -> f64 {
    let (wanted, found) = (complex(&plant.a).unwrap(), complex(found).unwrap());
    let largest = wanted.iter().map(|value| value.norm()).fold(0.0, f64::max);
    let near = |value: nalgebra::Complex<f64>, others: &[nalgebra::Complex<f64>]| {
        others.iter().map(|other| (other - value).norm()).fold(f64::INFINITY, f64::min)
    };
    let all = wanted.iter().map(|value| near(*value, &found)).chain(found.iter().map(|value| near(*value, &wanted)));
    all.fold(0.0, f64::max) / largest
}

/// Numbers of plants that are right, refused and wrong; with steps of 1 and 5 ms, and inputs of three magnitudes.
fn judged(seeds: std::ops::Range<u64>, change: impl Fn(&mut Plant)) -> [usize; 3] {
    let mut counts = [0; 3];
    for (seed, step, gain) in seeds
        .flat_map(|seed| [1e-3, 5e-3].into_iter().flat_map(move |step| [1e-3, 1.0, 1e3].map(|gain| (seed, step, gain))))
    {
        let mut plant = random(seed);
        plant.step = step;
        plant.b *= gain;
        change(&mut plant);
        let error = found(&plant).map(|(tried, _)| error(&plant, &tried.fit.matrices()[0]));
        counts[error.map_or(1, |error| if error <= 1e-3 { 0 } else { 2 })] += 1;
    }
    counts
}

#[test]
fn unstable_plants_are_linearised_by_their_inputs_or_refused() {
    let [right, refused, wrong] = judged(0..6, |_| ());
    assert!(wrong == 0 && right >= 9 * refused, "{right} right, {refused} refused, {wrong} wrong");
}

#[test]
fn start_values_show_the_same_also_of_what_shows_rounded_values() {
    let all = |plant: &mut Plant| plant.starts = (0..plant.a.nrows()).collect();
    assert_eq!(judged(0..6, all), [36, 0, 0]);
    let rounded = |plant: &mut Plant| (plant.starts, plant.blur) = ((0..plant.a.nrows()).collect(), 1e-12);
    assert_eq!(judged(6..8, rounded), [12, 0, 0]);
    let some = |plant: &mut Plant| plant.starts = (0..plant.a.nrows() / 2).collect();
    let [right, refused, wrong] = judged(0..3, some);
    assert!(wrong == 0 && right >= 9 * refused, "{right} right, {refused} refused, {wrong} wrong");
}

#[test]
fn a_start_value_that_a_load_follows_shows_nothing_of_the_plant() {
    let held = |plant: &mut Plant| (plant.starts, plant.held) = ((0..plant.a.nrows()).collect(), true);
    let [right, refused, wrong] = judged(0..4, held);
    assert!(wrong == 0 && right >= 9 * refused, "{right} right, {refused} refused, {wrong} wrong");
}
