//! First designs of funnel control with filtered errors: the gain for which the errors stay well inside their funnel while the
//! nominal plant follows a reference that starts smoothly.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use super::channels::high_frequency;
use super::funnel_loop::{Channel, Loop};
use super::nominal::Nominal;
use super::{complex, four_digits};
use crate::error::Invalid;

/// Largest relative degree.
const MOST_DEGREE: usize = 3;
/// The largest condition of the input gain with scaled rows and columns.
const MOST_CONDITION: f64 = 1e6;
/// The error may take up so much of each funnel.
const MOST_PART: f64 = 0.7;
/// And in the end the error itself takes up so much of its own, by the relative degree: the rest is for noise, which each level
/// hands on to the next larger than it is.
const MOST_LEFT: [f64; MOST_DEGREE] = [0.45, 0.25, 0.2];
/// Gains in parts of R Wʳ that are tried: 10^(k/2).
const GAINS: i32 = 12;
/// Time constants of the error's filter, in 1/W.
const FILTERS: [f64; 2] = [0.5, 0.25];
/// ψ_0 and ψ_∞ in parts of the reference, and the rate at which the bound narrows, in W.
pub const WIDE: f64 = 2.0;
/// See [`WIDE`].
pub const NARROW: f64 = 0.1;
/// See [`WIDE`].
pub const DECAY: f64 = 0.5;
/// H at most in parts of the time in which an error moves through its funnel.
const STEP: f64 = 0.2;

/// A design.
#[derive(Debug)]
pub struct Design {
    /// Relative degree r.
    pub degree: usize,
    /// Direction: from the outputs of the channels to the controls.
    pub G: DMatrix<f64>,
    /// Gain of each channel.
    pub g: Vec<f64>,
    /// Time constant of the error's filter, s.
    pub tau: f64,
    /// The largest error in parts of its bound.
    pub largest_part: f64,
    /// The lowest and the highest value of each control.
    pub control: Vec<[f64; 2]>,
    /// Communication step at most, s.
    pub step: f64,
    /// True if the errors stay inside with a control that is constant within such steps.
    pub is_sampled: bool,
    /// Final deviation of the output from the reference, in parts of it.
    pub left: f64,
}

/// A funnel for references of these sizes.
///
/// # Errors
/// Why there is none.
pub fn design(plant: &Nominal, references: &[f64]) -> Result<Design, Invalid> {
    design_within(plant, references, &MOST_LEFT)
}

/// The same where the error takes up so much of its own funnel in the end at most, by the relative degree.
///
/// # Errors
/// Why there is none.
pub fn design_within(plant: &Nominal, references: &[f64], most_left: &[f64; MOST_DEGREE]) -> Result<Design, Invalid> {
    if plant.delay.iter().any(|&delay| delay > 0.0) {
        return Err(Invalid::because(
            "delay: a funnel controller takes no dead time. `new pid` or `new ladrc` may find a controller",
        ));
    }
    let (degree, G) = direction(plant)?;
    if let Some(zero) = plant.zeros.iter().find(|zero| zero.re > -1e-6 * zero.norm().max(1.0)) {
        return Err(Invalid::because(format!(
            "the plant has a zero at {} rad/s, not in the left half plane: what the outputs don't show would grow. `new pid` or \
             `new ladrc` may find a controller",
            complex(zero * plant.bandwidth)
        )));
    }
    let W = plant.bandwidth;
    for k in 0..=GAINS {
        for tau in FILTERS {
            let g = 10_f64.powf(f64::from(k) / 2.0);
            let of = |&reference: &f64| Channel {
                reference,
                psi_0: WIDE * reference,
                psi_inf: NARROW * reference,
                decay_rate: DECAY,
                tau,
                g: g * reference,
            };
            let channels: Vec<_> = references.iter().map(of).collect();
            let loop_ = Loop::new([&plant.A, &plant.B, &plant.C], degree, &G, &channels);
            let followed = loop_.follow();
            if followed.largest_part <= MOST_PART && followed.left <= most_left[degree - 1] && followed.stayed() {
                let longest = STEP * NARROW / (g * tau.powi(degree as i32 - 1));
                let sampled = loop_.sampled(longest);
                return Ok(Design {
                    degree,
                    G: (&G / W.powi(degree as i32)).map(four_digits),
                    g: references.iter().map(|size| four_digits(size * g * W.powi(degree as i32))).collect(),
                    tau: four_digits(tau / W),
                    largest_part: followed.largest_part,
                    control: followed.control,
                    step: sampled.unwrap_or(longest) / W,
                    is_sampled: sampled.is_some(),
                    left: followed.left * NARROW,
                });
            }
            if degree == 1 {
                break;
            }
        }
    }
    let sizes = references.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    Err(Invalid::because(format!(
        "no gain keeps the error of the nominal plant within {MOST_PART} of its funnel while it follows a reference of {sizes} \
         at {W} rad/s. Give a lower --bandwidth, or try `new pid` or `new ladrc`"
    )))
}

/// The relative degree of all outputs, and the inverse of the input gain, with time in 1/W.
fn direction(plant: &Nominal) -> Result<(usize, DMatrix<f64>), Invalid> {
    let dependent = || {
        Invalid::because(
            "A, B, C: the controls must move the outputs, or their derivatives, independently of each other. `new pid` or `new ladrc` may find a controller",
        )
    };
    let (degrees, gain) = high_frequency(plant).ok_or_else(dependent)?;
    let degree = degrees[0];
    if let Some(i) = degrees.iter().position(|&other| other != degree) {
        return Err(Invalid::because(format!(
            "the control shows in derivative {degree} of output 1 and in derivative {} of output {}. A funnel controller needs the \
             same for all. `new pid` or `new ladrc` may find a controller",
            degrees[i],
            i + 1
        )));
    }
    if degree > MOST_DEGREE {
        return Err(Invalid::because(format!(
            "the control shows in derivative {degree} of the outputs (relative degree {degree}). A funnel controller takes up to \
             {MOST_DEGREE}. `new pid` or `new ladrc` may find a controller"
        )));
    }
    // An input that acts on no output, and numbers beyond what a float holds.
    if gain.row_iter().any(|row| row.amax() == 0.0) || gain.column_iter().any(|column| column.amax() == 0.0) {
        return Err(dependent());
    }
    let mut scaled = gain.clone();
    scaled.row_iter_mut().for_each(|mut row| row.scale_mut(row.amax().recip()));
    scaled.column_iter_mut().for_each(|mut column| column.scale_mut(column.amax().recip()));
    if scaled.iter().any(|entry| !entry.is_finite()) {
        return Err(dependent());
    }
    let sizes = scaled.singular_values();
    let condition = sizes.max() / sizes.min();
    if condition.is_nan() || condition > MOST_CONDITION {
        return Err(dependent());
    }
    Ok((degree, gain.try_inverse().ok_or_else(dependent)?))
}
