//! Desired dynamics of an L1 controller: poles that keep what the plant does well.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use crate::design::channels::high_frequency;
use crate::design::criteria::damping;
use crate::design::four_digits;
use crate::design::nominal::{Nominal, poles_of};
use crate::design::robustness::uncertain::Uncertain;
use crate::error::Invalid;
use crate::mathematics::pole_placement::{self, times_polynomial};

/// A stable zero up to this frequency, in W, gets a pole: it doesn't show in the output then.
const SLOW: f64 = 1.5;
/// Zeros with less damping get no pole.
const DAMPED: f64 = 0.4;
/// Poles of the plant that stay get at least this damping.
const LEAST_DAMPING: f64 = 0.7;
/// A zero below this, in W, lets no constant control hold an output.
const AT_REST: f64 = 1e-6;
/// The fastest pole, in W, with which several channels are decoupled.
const FASTEST: f64 = 10.0;
/// The largest condition of the input gain for that.
const MOST_CONDITION: f64 = 1e3;
/// A pole that is within this part of one of the plant isn't moved.
const MOVED: f64 = 0.02;

/// Desired dynamics.
#[derive(Debug)]
pub enum Desired {
    /// As the plant does.
    Own,
    /// With these poles, rad/s.
    Poles(Vec<Complex<f64>>),
    /// With channels that don't act on each other, and these poles in W.
    Decoupled(Vec<Complex<f64>>),
}

/// Desired dynamics, and the gain K_m of the baseline that brings them about, in the coordinates of the plant.
///
/// # Errors
/// Why there are none.
pub fn desired(plant: &Uncertain, nominal: &Nominal) -> Result<(Desired, DMatrix<f64>), Invalid> {
    let (n, m) = plant.size();
    let W = plant.bandwidth;
    if nominal.zeros.iter().any(|zero| zero.norm() < AT_REST) {
        return Err(Invalid::because(
            "the plant has a zero at 0: no constant control holds the outputs at a reference. Control other outputs",
        ));
    }
    if m == 1 {
        let round = |pole: Complex<f64>| Complex::new(four_digits(pole.re * W), four_digits(pole.im * W));
        let poles: Vec<_> = of_one_input(&nominal.poles, &nominal.zeros).into_iter().map(round).collect();
        let wanted: Vec<_> = poles.iter().map(|pole| pole / W).collect();
        let gain = pole_placement::place(&plant.A, &plant.B, &wanted)?;
        return Ok((Desired::Poles(poles), gain));
    }
    let is_good = |pole: &Complex<f64>| pole.re < 0.0 && pole.norm() >= 1.0 - 1e-9 && damping(pole) >= LEAST_DAMPING;
    if nominal.poles.iter().all(is_good) {
        return Ok((Desired::Own, DMatrix::zeros(m, n)));
    }
    decoupled(plant, nominal).ok_or_else(|| {
        Invalid::because(
            "the channels can't be decoupled by state feedback: that takes zeros that are stable and damped, no pole faster \
             than 10 times --bandwidth, and inputs that move the outputs independently. Give other inputs or outputs, or \
             another --bandwidth; `new pid` or `new ladrc` may find a controller",
        )
    })
}

/// Poles in W for a plant with one input.
fn of_one_input(own: &[Complex<f64>], zeros: &[Complex<f64>]) -> Vec<Complex<f64>> {
    let mut left = own.to_vec();
    let mut poles = Vec::new();
    let is_hidden = |zero: &&Complex<f64>| zero.re < 0.0 && zero.norm() <= SLOW && damping(zero) >= DAMPED;
    for &zero in zeros.iter().filter(is_hidden) {
        let Some(nearest) =
            (0..left.len()).min_by(|&i, &j| (left[i] - zero).norm().total_cmp(&(left[j] - zero).norm()))
        else {
            break;
        };
        left.swap_remove(nearest);
        poles.push(zero);
    }
    let has_conjugate =
        |pole: &Complex<f64>| left.iter().any(|other| (other - pole.conj()).norm() <= 1e-9 * pole.norm());
    let alone = |pole: &Complex<f64>| if has_conjugate(pole) { *pole } else { Complex::from(-pole.norm()) };
    let left: Vec<_> = left.iter().map(alone).collect();
    let (fast, slow): (Vec<_>, Vec<_>) = left.into_iter().partition(|pole| pole.norm() >= 1.0 - 1e-9);
    poles.extend(fast.iter().map(damped));
    poles.extend(bessel(slow.len()));
    // Conjugates side by side.
    poles.sort_by(|a, b| a.norm().total_cmp(&b.norm()).then(a.im.abs().total_cmp(&b.im.abs())));
    let upper: Vec<_> = poles.into_iter().filter(|pole| pole.im >= 0.0).collect();
    upper.into_iter().flat_map(|pole| if pole.im > 0.0 { vec![pole, pole.conj()] } else { vec![pole] }).collect()
}

/// A pole as it is, made stable, and damped.
fn damped(pole: &Complex<f64>) -> Complex<f64> {
    if pole.im == 0.0 {
        return Complex::from(-pole.norm());
    }
    let wanted = (pole.re.abs() / pole.norm()).max(LEAST_DAMPING);
    let imaginary = (1.0 - wanted * wanted).max(0.0).sqrt() * pole.im.signum();
    Complex::new(-wanted, imaginary) * pole.norm()
}

/// The roots of Bessel's polynomial of an order, with product 1: a step that overshoots by less than 1 %.
pub fn bessel(order: usize) -> Vec<Complex<f64>> {
    // (2k − j)!/(2^(k−j) j! (k−j)!) of s^j, each from the one above; scaled so that the last one is 1.
    let mut coefficients = vec![1.0; order + 1];
    for j in (0..order).rev() {
        let (k, j) = (order as f64, j as f64);
        coefficients[j as usize] = coefficients[j as usize + 1] * (2.0 * k - j) * (j + 1.0) / (2.0 * (k - j));
    }
    let scale = if order == 0 { 1.0 } else { coefficients[0].powf(1.0 / order as f64) };
    let companion = DMatrix::from_fn(order, order, |i, j| match (i, j) {
        (i, j) if i + 1 == order => -coefficients[j] / scale.powi((order - j) as i32),
        (i, j) if j == i + 1 => 1.0,
        _ => 0.0,
    });
    let mut roots = poles_of(&companion).unwrap_or_default();
    // Conjugates to the last digit.
    roots.retain(|root| root.im >= 0.0);
    roots.iter().flat_map(|root| if root.im > 0.0 { vec![*root, root.conj()] } else { vec![*root] }).collect()
}

/// Channels with Bessel's poles at W that don't act on each other.
fn decoupled(plant: &Uncertain, nominal: &Nominal) -> Option<(Desired, DMatrix<f64>)> {
    let is_hidden = |zero: &Complex<f64>| zero.re < 0.0 && damping(zero) >= DAMPED;
    let is_slow = |pole: &Complex<f64>| pole.norm() <= FASTEST;
    if !(nominal.zeros.iter().all(is_hidden) && nominal.poles.iter().all(is_slow)) {
        return None;
    }
    let (degrees, gain) = high_frequency(nominal)?;
    let mut scaled = gain.clone();
    scaled.row_iter_mut().for_each(|mut row| row /= row.amax());
    let sizes = scaled.singular_values();
    if sizes.max() > MOST_CONDITION * sizes.min() {
        return None;
    }
    let mut closed = DMatrix::zeros(plant.C.nrows(), plant.A.nrows());
    let mut all = nominal.zeros.clone();
    for (i, &degree) in degrees.iter().enumerate() {
        let poles = bessel(degree);
        closed.set_row(i, &times_polynomial(plant.C.row(i).into_owned(), &plant.A, &poles));
        all.extend(poles);
    }
    Some((Desired::Decoupled(all), gain.lu().solve(&closed)?))
}

impl Desired {
    /// The fastest pole that isn't one of the plant's own, in W; 0 where there is none.
    pub fn fastest_moved(&self, own: &[Complex<f64>], bandwidth: f64) -> f64 {
        let poles: Vec<_> = match self {
            Desired::Own => return 0.0,
            Desired::Poles(poles) => poles.iter().map(|pole| pole / bandwidth).collect(),
            Desired::Decoupled(poles) => poles.clone(),
        };
        // Each pole of the plant accounts for one.
        let mut left = own.to_vec();
        let mut is_moved = |pole: &&Complex<f64>| {
            let near = left.iter().position(|other| (*pole - other).norm() <= MOVED * other.norm());
            near.map(|place| left.swap_remove(place)).is_none()
        };
        poles.iter().filter(|pole| is_moved(pole)).map(|pole| pole.norm()).fold(0.0, f64::max)
    }
}
