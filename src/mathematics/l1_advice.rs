//! Changes with which an L1 design satisfies its L1-norm condition: found by search, with the norm itself.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use crate::error::Invalid;
use crate::mathematics::l1_design::{L1Design, Lipschitz};
use crate::mathematics::l1_norm::Bounds;

/// Largest λ of the search, for a little room to rounding.
const AIM: f64 = 0.99;

/// Doublings of K that are tried, in two steps each.
const DOUBLINGS: i32 = 16;

/// Halvings of the last step.
const HALVINGS: usize = 7;

/// Most changes of the worst input gain.
const ROUNDS: usize = 4;

/// Place of narrower bounds of the input gain, between the identity and those that keep the loop stable.
const NARROWED: f64 = 0.9;

/// Changes that would make λ less than 1.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Advice {
    /// Change that stabilises the loop, if it isn't stable for each input gain. The rest of the advice builds on it.
    pub stabilising: Option<Stabilising>,
    /// Factor by which K has to grow, and λ then.
    pub gain_factor: Option<(f64, f64)>,
    /// If no factor of K suffices: the one of those tried with the least λ, and that.
    pub best_factor: Option<(f64, f64)>,
    /// Factor by which the bounds on θ have to shrink.
    pub bound_factor: Option<f64>,
}

/// Change that stabilises the loop for each input gain within its bounds.
#[derive(Debug, Clone, PartialEq)]
pub enum Stabilising {
    /// A smaller K, by this factor.
    Gain(f64),
    /// Narrower bounds of the input gain: the lower and the upper ones.
    Bounds(DMatrix<f64>, DMatrix<f64>),
}

impl Advice {
    /// For a design with λ, at least 1, at its worst input gain.
    ///
    /// # Errors
    /// [`Invalid`] as of [`L1Design::norms`].
    pub fn of(design: &L1Design, lipschitz: Lipschitz, lambda: Bounds, omega: &DMatrix<f64>) -> Result<Self, Invalid> {
        if lambda.upper.is_finite() {
            let mut advice = gain_search(design, lipschitz, omega.clone())?;
            advice.bound_factor = Some(rounded_down(AIM / lambda.upper));
            return Ok(advice);
        }
        let (stable, stabilising) = if let Some(factor) = calmer(design) {
            (design.with_gain_times(factor), Stabilising::Gain(factor))
        } else if let Some(narrower) = narrowed(design) {
            let stabilising = Stabilising::Bounds(narrower.omega_min.clone(), narrower.omega_max.clone());
            (narrower, stabilising)
        } else {
            return Ok(Advice::default());
        };
        let worst = stable.worst(lipschitz)?;
        let lambda = worst.norms.lambda(lipschitz);
        let further = if lambda.upper >= 1.0 && lambda.upper.is_finite() {
            Advice::of(&stable, lipschitz, lambda, &worst.omega)?
        } else {
            Advice::default()
        };
        Ok(Advice { stabilising: Some(stabilising), ..further })
    }
}

/// A factor of K that leaves it stable for each input gain, with as much to spare: half of what is found to.
fn calmer(design: &L1Design) -> Option<f64> {
    let stable = |factor: f64| is_stable(&design.with_gain_times(factor));
    let mut low = (1..=DOUBLINGS / 2).map(|k| 0.5_f64.powi(k)).find(|&factor| stable(factor))?;
    let mut high = 2.0 * low;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if stable(middle) { low = middle } else { high = middle }
    }
    Some(rounded_down(0.5 * low))
}

fn is_stable(design: &L1Design) -> bool {
    design.gains().iter().all(|omega| design.is_stable(omega))
}

/// Searches the factor of K at the worst input gain, then tries it at all.
fn gain_search(design: &L1Design, lipschitz: Lipschitz, mut omega: DMatrix<f64>) -> Result<Advice, Invalid> {
    let mut best = (1.0, f64::INFINITY);
    for _ in 0..ROUNDS {
        let mut lambda = |factor: f64| {
            let lambda = design.with_gain_times(factor).rough_norms(&omega)?.lambda(lipschitz).upper;
            if lambda < best.1 {
                best = (factor, lambda);
            }
            Ok::<_, Invalid>(lambda)
        };
        let (mut low, mut high) = (1.0, None);
        for factor in (0..=2 * DOUBLINGS).map(|k| 2_f64.powf(0.5 * f64::from(k))) {
            let found = lambda(factor)?;
            if found <= AIM {
                high = Some(factor);
                break;
            }
            if found.is_infinite() {
                break;
            }
            low = factor;
        }
        let Some(mut high) = high else { return Ok(Advice { best_factor: Some(best), ..Advice::default() }) };
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if lambda(middle)? <= AIM { high = middle } else { low = middle }
        }
        let factor = rounded_up(high);
        let scaled = design.with_gain_times(factor);
        let worst = scaled.worst(lipschitz)?;
        let everywhere = worst.norms.lambda(lipschitz).upper;
        if everywhere < 1.0 {
            return Ok(Advice { gain_factor: Some((factor, everywhere)), ..Advice::default() });
        }
        (omega, best) = (worst.omega, (factor, everywhere));
    }
    Ok(Advice { best_factor: Some(best), ..Advice::default() })
}

/// The design with bounds of ω nearer to the identity, between which the loop is stable: first with other lower ones
/// only. `None` when it isn't even for ω = I.
fn narrowed(design: &L1Design) -> Option<L1Design> {
    let identity = DMatrix::identity(design.K.nrows(), design.K.nrows());
    // No more digits than a person would write.
    let short = |value: f64| (value * 1e9).round() / 1e9;
    let towards = |bound: &DMatrix<f64>, part: f64| (&identity + (bound - &identity) * part).map(short);
    let search = |with: &dyn Fn(f64) -> L1Design| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if is_stable(&with(middle)) { low = middle } else { high = middle }
        }
        let found = with((NARROWED * low * 100.0).floor() / 100.0);
        is_stable(&found).then_some(found)
    };
    let lower = |part: f64| L1Design { omega_min: towards(&design.omega_min, part), ..design.clone() };
    let both = |part: f64| L1Design { omega_max: towards(&design.omega_max, part), ..lower(part) };
    search(&lower).or_else(|| search(&both))
}

/// To three digits.
pub fn rounded_up(value: f64) -> f64 {
    let unit = digit(value);
    (value / unit).ceil() * unit
}

/// To three digits.
pub fn rounded_down(value: f64) -> f64 {
    let unit = digit(value);
    (value / unit).floor() * unit
}

/// Value of the third digit of a number.
fn digit(value: f64) -> f64 {
    10_f64.powi(value.log10().floor() as i32 - 2)
}
