//! The search for the numbers of an L1 controller.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use super::adaptation::near_limit;
use super::assess::{Found, assess, steps};
use super::closed::Law;
use super::desired::{Desired, desired};
use super::lambda::{MOST_LAMBDA, excess, lambda};
use crate::design::nominal::{Nominal, poles_of};
use crate::design::robustness::assumed::Assumed;
use crate::design::robustness::bounds::deviations;
use crate::design::robustness::region::Region;
use crate::design::robustness::respond::{SETTLED, step};
use crate::design::robustness::uncertain::Uncertain;
use crate::design::step::Step;
use crate::design::{digits, four_digits};
use crate::error::Invalid;
use crate::mathematics::l1_adaptation::L1Adaptation;
use crate::mathematics::lyapunov;
use crate::nominal::{USUAL, Uncertainty};
use crate::template::{Plant, Records, round_down, round_up, three_digits};

/// Gains of the filter that are tried, in W.
const GAINS: [f64; 5] = [2.0, 5.0, 10.0, 20.0, 40.0];
/// λ* of a design that is taken where none is small, in parts of the least.
const NEAR_LEAST: f64 = 1.1;
/// The least gain of the filter of a law that adapts, in W.
const LEAST_GAIN: f64 = 0.5;
/// Communication steps of the fastest pole that is moved, or of 5 W.
const STEPS: f64 = 0.1;
const OWN_SPEED: f64 = 5.0;

/// Requirements of a design.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    /// W, rad/s.
    pub bandwidth: f64,
    /// Size of each reference.
    pub references: &'a [f64],
    /// Uncertainty of the plant.
    pub uncertainty: &'a Uncertainty,
    /// True for a law that adapts.
    pub adapts: bool,
    /// Factors of K between which it varies.
    pub varies: [f64; 2],
}

/// A design, in the units of the file.
#[derive(Debug)]
pub struct Design {
    /// Desired dynamics.
    pub desired: Desired,
    /// A − B K_m.
    pub A_m: DMatrix<f64>,
    /// k of K = k I, 1/s.
    pub feedback_gain: f64,
    /// Peaks of the states in a step of the reference.
    pub peaks: Vec<f64>,
    /// Diagonal of Q, 1/peak².
    pub Q: Vec<f64>,
    /// Γ.
    pub adaptation_gain: f64,
    /// Bounds of ω, m × m.
    pub omega: [DMatrix<f64>; 2],
    /// Bounds of θ, m × n, as a factor of x/peak.
    pub theta_bound: DMatrix<f64>,
    /// One an input.
    pub sigma_bound: Vec<f64>,
    /// Communication step, s.
    pub step: f64,
    /// Assessment for uncertain plants.
    pub found: Found,
    /// Steps of the references by 1.
    pub steps: Vec<Step>,
    /// Sizes of the references that it is for.
    pub references: Vec<f64>,
}

/// The design for a plant, in units of the file.
///
/// # Errors
/// Why there is none.
pub fn design(plant: &Plant, asked: &Asked) -> Result<Design, Invalid> {
    let W = asked.bandwidth;
    let nominal = Nominal::new(&Plant { delay: Vec::new(), ..plant.clone() }, W)?;
    let assumed = Assumed::new(&plant.A, &plant.B, asked.uncertainty);
    let uncertain = Uncertain::new([&plant.A, &plant.B, &plant.C], &assumed.bounds, &plant.delays(), W);
    let uncertain = uncertain.ok_or_else(extreme)?;
    let (desired, K_m) = desired(&uncertain, &nominal)?;
    let A_m = &uncertain.A - &uncertain.B * &K_m;
    let weights = Weights::new(&uncertain, &A_m, asked.references).ok_or_else(extreme)?;
    let laws = Laws {
        plant: &uncertain,
        asked,
        assumed: &assumed,
        longest: plant.sample_time(),
        K_m: &K_m,
        A_m: &A_m,
        weights: &weights,
    };
    let chosen = laws.choose(&desired, &nominal)?;
    let law = &chosen.law;
    let steps = steps(&uncertain, law).ok_or_else(extreme)?;
    let found = assess(&uncertain, law, &chosen.region, &excess(&uncertain, &K_m), chosen.step * W, assumed.most());
    let gain_of = uncertain.in_units(&K_m);
    let matched = plant.B.clone().pseudo_inverse(0.0).map_err(Invalid::because)?;
    let m = plant.B.ncols();
    let spread = assumed.bounds.of_inputs(&matched);
    let of_records = |records: &Records| records.disturbances(&matched, deviations(records.level(), plant.B.shape()));
    let recorded = plant.records.as_ref().map_or_else(|| vec![0.0; m], of_records);
    let identity = DMatrix::identity(m, m);
    let peak = |j: usize| {
        let of_step = |(step, size): (&Step, &f64)| size * step.control[j][1].max(-step.control[j][0]);
        steps.iter().zip(asked.references).map(of_step).fold(0.0, f64::max)
    };
    let limit = |j: usize| plant.limits.as_ref().map(|[min, max]| min[j].abs().max(max[j].abs()));
    let sigma = |j: usize| round_up(limit(j).unwrap_or(2.0 * peak(j)).max(peak(j)).max(recorded[j]));
    let sigma_bound: Vec<_> = (0..m).map(sigma).collect();
    let mut theta_bound = assumed.bounds.of_feedback(&matched, &gain_of);
    theta_bound.column_iter_mut().zip(&weights.peaks).for_each(|(mut column, peak)| column *= *peak);
    let adaptation_gain = laws.adaptation_gain(law, chosen.gain / W, spread.amax(), &sigma_bound)?;
    Ok(Design {
        A_m: &plant.A - &plant.B * &gain_of,
        feedback_gain: chosen.gain,
        peaks: weights.peaks,
        Q: weights.of_file,
        adaptation_gain,
        omega: [(&identity - &spread).map(short), (&identity + &spread).map(short)],
        theta_bound: theta_bound.map(up_to_three_digits),
        sigma_bound,
        step: chosen.step,
        desired,
        found,
        steps,
        references: asked.references.to_vec(),
    })
}

fn extreme() -> Invalid {
    Invalid::because(
        "the plant, the bandwidth and the reference differ by too many powers of ten for a design in double precision: choose \
         other units, or more inputs (a control that acts through more than about 14 integrators has none)",
    )
}

/// Q of the peaks of the nominal loop, and P.
struct Weights {
    Q: DMatrix<f64>,
    P: DMatrix<f64>,
    /// In the units of the file: peaks, and the diagonal of Q.
    peaks: Vec<f64>,
    of_file: Vec<f64>,
}

impl Weights {
    /// 1/X² for the peak X of each state in the steps of all references.
    fn new(plant: &Uncertain, A_m: &DMatrix<f64>, references: &[f64]) -> Option<Self> {
        let (n, _) = plant.size();
        let at_rest = A_m.clone().lu().solve(&plant.B)?;
        let entry = &plant.B * -(&plant.C * at_rest).try_inverse()?;
        let states = DMatrix::identity(n, n);
        let mut peaks = DVector::zeros(n);
        for (column, size) in entry.column_iter().zip(references) {
            let courses = step(A_m, &(column * *size), &states, &DVector::zeros(n), SETTLED)?;
            peaks.iter_mut().zip(&courses).for_each(|(peak, course)| {
                *peak = course.range[1].max(-course.range[0]).max(*peak);
            });
        }
        // What no reference moves counts as the largest of those that are moved.
        let largest = peaks.max();
        let scaled = peaks.map(|peak| if peak > 1e-9 * largest { peak } else { largest });
        let peaks: Vec<_> = (0..n).map(|i| three_digits(scaled[i] * plant.scales[i])).collect();
        let of_file: Vec<_> = peaks.iter().map(|peak| three_digits(peak.powi(-2))).collect();
        let Q = plant.weight(&DMatrix::from_diagonal(&DVector::from_vec(of_file.clone()))) / plant.bandwidth;
        let P = lyapunov::solve(A_m, &Q).ok()?;
        of_file.iter().all(|entry| entry.is_normal()).then_some(Weights { Q, P, peaks, of_file })
    }
}

/// Laws of all gains of the filter.
struct Laws<'a> {
    plant: &'a Uncertain,
    asked: &'a Asked<'a>,
    assumed: &'a Assumed,
    /// Step of the records, s: what is faster isn't known.
    longest: Option<f64>,
    K_m: &'a DMatrix<f64>,
    A_m: &'a DMatrix<f64>,
    weights: &'a Weights,
}

/// Gain of the filter, 1/s, with its law and its region, and communication step, s.
struct Chosen {
    gain: f64,
    law: Law,
    region: Region,
    step: f64,
}

impl Laws<'_> {
    /// A law with K = k I, k in W.
    fn law(&self, k: f64) -> Option<Law> {
        let m = self.plant.B.ncols();
        let K = DMatrix::from_diagonal_element(m, m, k);
        if self.asked.adapts {
            Law::adaptive(self.plant, self.K_m, self.A_m, &K, &self.weights.P)
        } else {
            Law::limit(self.plant, self.K_m, self.A_m, &K)
        }
    }

    /// The smallest gain of the filter with λ* of at most 0.8 and a stable region, at the longest step; else the smallest
    /// one with a stable region whose λ* is near the least; else the smallest one that stabilises the nominal plant.
    fn choose(&self, desired: &Desired, nominal: &Nominal) -> Result<Chosen, Invalid> {
        let W = self.plant.bandwidth;
        let gains = self.gains()?;
        let laws = gains.iter().map(|&gain| self.law(gain / W)).collect::<Option<Vec<_>>>();
        let mut laws = laws.ok_or_else(extreme)?;
        let steps = self.steps(desired, nominal);
        let certain = self.plant.with_bounds_times(0.0);
        let alone =
            |k: usize, step: f64| Region::new(&certain, &laws[k], USUAL).is_stable(&certain, &laws[k], step * W);
        let mut tried = steps.iter().flat_map(|&step| (0..gains.len()).map(move |k| (k, step)));
        let (first, first_step) = tried.find(|&(k, step)| alone(k, step)).ok_or_else(|| self.unstable())?;
        let excess = excess(self.plant, self.K_m);
        let lambdas: Vec<_> = laws.iter().map(|law| lambda(self.plant, law, &excess).unwrap_or(0.0)).collect();
        let mut regions: Vec<_> = laws.iter().map(|law| Region::new(self.plant, law, USUAL)).collect();
        let is_stable =
            |k: usize, H: f64| self.varied(&laws[k]).iter().all(|law| regions[k].is_stable(self.plant, law, H * W));
        let stable = |step: f64| (0..gains.len()).filter(|&k| is_stable(k, step)).collect::<Vec<_>>();
        let (k, step) = proved_or_near(&steps, stable, &lambdas).unwrap_or((first, first_step));
        Ok(Chosen { gain: gains[k], law: laws.swap_remove(k), region: regions.swap_remove(k), step })
    }

    fn unstable(&self) -> Invalid {
        let late = self.plant.delay / self.plant.bandwidth;
        let reason = match late {
            0.0 => "Give another --bandwidth".to_owned(),
            late => format!("Its dead time is {} s: give a lower --bandwidth", digits(late)),
        };
        Invalid::because(format!(
            "no gain of the filter stabilises the nominal plant with one communication step of dead time. {reason}, or try `new \
             pid` or `new ladrc`"
        ))
    }

    /// A law with each gain that it gives to the filter.
    fn varied(&self, law: &Law) -> Vec<Law> {
        let [low, high] = self.asked.varies;
        let factors = if low == high { vec![low] } else { vec![low, high] };
        factors.into_iter().map(|factor| law.with_gain(&law.K * factor)).collect()
    }

    /// Gains of the filter, 1/s, cut to the bound of a law that adapts.
    fn gains(&self) -> Result<Vec<f64>, Invalid> {
        let (W, largest) = (self.plant.bandwidth, self.largest_gain());
        if largest < LEAST_GAIN {
            return Err(Invalid::because(format!(
                "the gain of the filter may be at most {} 1/s, {} of the bandwidth: beyond, the adaptation would oscillate where \
                 the input gain is larger than assumed. Give a smaller {}, or take `new l1-limit` or `new l1-sampled`, which have \
                 no such bound",
                digits(largest * W),
                digits(largest),
                self.assumed.option()
            )));
        }
        // Never rounded up beyond the bound.
        let cut = |gain: f64| if gain <= largest { four_digits(gain * W) } else { rounded_down(largest * W) };
        let mut gains: Vec<_> = GAINS.iter().map(|&gain| cut(gain)).collect();
        gains.dedup();
        Ok(gains)
    }

    fn largest_gain(&self) -> f64 {
        if !self.asked.adapts {
            return f64::INFINITY;
        }
        let PB = &self.weights.P * &self.plant.B;
        self.adaptation().largest_gain(&PB, &self.plant.bounds.B, self.is_full()) / self.asked.varies[1]
    }

    /// The adaptation at rest, with time in 1/W.
    fn adaptation(&self) -> L1Adaptation {
        let (B, Weights { P, Q, .. }) = (&self.plant.B, self.weights);
        L1Adaptation { BPB: B.transpose() * P * B, BQB: B.transpose() * Q * B, gain: 0.0 }
    }

    /// True if the input gain is estimated entry by entry.
    fn is_full(&self) -> bool {
        is_full(&self.plant.bounds.of_inputs(&self.plant.inverse))
    }

    /// Communication steps, s, the longest first.
    fn steps(&self, desired: &Desired, nominal: &Nominal) -> Vec<f64> {
        let W = self.plant.bandwidth;
        let fastest = OWN_SPEED.max(desired.fastest_moved(&nominal.poles, W));
        let first = round_down(STEPS / (fastest * W));
        let first = self.longest.map_or(first, |longest| first.min(round_down(longest)));
        let all = poles_of(self.A_m).unwrap_or_default().iter().map(|pole| pole.norm()).fold(fastest, f64::max);
        let shorter = |step: &f64| Some(round_down(0.99 * step));
        let least = STEPS / (all * W);
        let further = std::iter::successors(Some(first), shorter).skip(1).take_while(|&step| step >= 0.5 * least);
        [first].into_iter().chain(further).collect()
    }

    /// Γ for this filter; `spread` is what the input gain may be off.
    fn adaptation_gain(&self, law: &Law, k: f64, spread: f64, sigma_bound: &[f64]) -> Result<f64, Invalid> {
        let P = &self.weights.P;
        let start = self.adaptation().needed(k * self.asked.varies[1] * (1.0 + spread)).ok_or_else(extreme)?;
        let gain = match sigma_bound {
            [sigma_bound] => {
                let fastest = law.with_gain(&law.K * self.asked.varies[1]);
                near_limit(self.plant, &fastest, P, start, self.asked.references[0], *sigma_bound)
            }
            _ => start,
        };
        Ok(up_to_three_digits(gain))
    }
}

/// At the longest of these steps at which there is one, the first gain that is stable and proved; else, at the longest with a
/// stable gain, the first whose λ* is near the least.
fn proved_or_near(steps: &[f64], stable: impl Fn(f64) -> Vec<usize>, lambdas: &[f64]) -> Option<(usize, f64)> {
    let mut near = None;
    for &step in steps {
        let stable = stable(step);
        if let Some(&k) = stable.iter().find(|&&k| lambdas[k] <= MOST_LAMBDA) {
            return Some((k, step));
        }
        let least = stable.iter().map(|&k| lambdas[k]).fold(f64::INFINITY, f64::min);
        near = near.or(stable.into_iter().find(|&k| lambdas[k] <= NEAR_LEAST * least).map(|k| (k, step)));
    }
    near
}

/// Off-diagonal entries of the input gain beyond this are estimated.
const MOST_COUPLING: f64 = 0.05;

/// True if inputs act on each other's channels.
pub fn is_full(spread: &DMatrix<f64>) -> bool {
    let m = spread.nrows();
    (0..m).any(|i| (0..m).any(|j| i != j && spread[(i, j)] > MOST_COUPLING))
}

/// Without the rounding of a last digit.
fn short(value: f64) -> f64 {
    format!("{value:.9e}").parse().unwrap_or(value)
}

fn up_to_three_digits(value: f64) -> f64 {
    let rounded = three_digits(value);
    if rounded >= value { rounded } else { three_digits(value * 1.005) }
}

fn rounded_down(value: f64) -> f64 {
    let rounded = four_digits(value);
    if rounded <= value { rounded } else { four_digits(value * (1.0 - 5e-4)) }
}
