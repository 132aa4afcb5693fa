//! Poles of a new controlled plant, which are as fast as its bandwidth.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use crate::eigenvalues;
use crate::error::Invalid;
use crate::mathematics::pole_placement;
use crate::template::three_digits;

/// Damping of poles at least.
const DAMPING: f64 = 0.8;
/// Ratio of each pole to the one before in the same chain.
const SPREAD: f64 = 1.2;

fn eigenvalues(A: &DMatrix<f64>) -> Result<Vec<Complex<f64>>, Invalid> {
    eigenvalues::complex(A).ok_or_else(|| Invalid::because("A is too badly scaled: its eigenvalues can't be found"))
}

/// Poles of a closed loop: the plant's own, none slower than the bandwidth, all of them damped.
///
/// # Errors
/// Why the plant can't be controlled.
pub fn poles(A: &DMatrix<f64>, B: &DMatrix<f64>, bandwidth: f64) -> Result<Vec<Complex<f64>>, Invalid> {
    let chains = pole_placement::controllability_indices(A, B)?;
    let mut own = eigenvalues(A)?;
    own.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    if let [n] = chains[..] {
        return Ok(of_one_chain(&own, bandwidth, n));
    }
    // Conjugates must share a chain; real poles may stand anywhere.
    let mut placed: Vec<Vec<f64>> = chains.iter().map(|_| Vec::new()).collect();
    for speed in own.iter().map(|lambda| three_digits(lambda.norm().max(bandwidth))) {
        let free = (0..chains.len()).filter(|&i| placed[i].len() < chains[i]);
        let share = |i: usize| placed[i].len() as f64 / chains[i] as f64;
        if let Some(chain) = free.min_by(|&i, &j| share(i).total_cmp(&share(j))) {
            let last = placed[chain].last().copied().unwrap_or(0.0);
            placed[chain].push(apart(speed, last));
        }
    }
    Ok(placed.into_iter().flatten().map(|speed| Complex::new(-speed, 0.0)).collect())
}

fn of_one_chain(own: &[Complex<f64>], bandwidth: f64, n: usize) -> Vec<Complex<f64>> {
    let (mut poles, mut last) = (Vec::new(), 0.0);
    // Of conjugates, the one above stands for both.
    for lambda in own.iter().filter(|lambda| lambda.im >= 0.0) {
        let speed = three_digits(lambda.norm().max(bandwidth));
        let damping = if lambda.im > 0.0 { (-lambda.re / lambda.norm()).max(DAMPING) } else { 1.0 };
        if damping < 1.0 {
            let (re, im) = (three_digits(-damping * speed), three_digits((1.0 - damping * damping).sqrt() * speed));
            poles.extend([Complex::new(re, im), Complex::new(re, -im)]);
        } else {
            for _ in 0..if lambda.im > 0.0 { 2 } else { 1 } {
                last = apart(speed, last);
                poles.push(Complex::new(-last, 0.0));
            }
        }
    }
    poles.truncate(n);
    poles
}

/// A speed that isn't that of the pole before.
fn apart(speed: f64, last: f64) -> f64 {
    if speed > 1.05 * last { speed } else { three_digits(SPREAD * last) }
}
