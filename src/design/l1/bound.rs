//! The largest gain of the filter with which the adaptation of an L1 law decays.
//!
//! With w = L x̃ the adaptation at rest is w″ − (L ΔB K + L A_m B) w′ + Γ 𝒩 Bᵀ P B w = 0: where the input gain is larger than
//! assumed, it grows whatever Γ is, unless rᵀ Bᵀ P ΔB K r ≤ ½ rᵀ Bᵀ Q B r for each eigenvector r of 𝒩 Bᵀ P B.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use crate::design::robustness::uncertain::Uncertain;

/// Weights of the channels that motion may have, where the input gain is estimated by its diagonal.
const WEIGHTS: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];
/// Combinations of weights at most.
const MOST_WEIGHTS: u32 = 256;

/// The largest k of K = k I, in W; infinite where the input gain is certain.
pub fn largest_gain(plant: &Uncertain, P: &DMatrix<f64>, Q: &DMatrix<f64>, is_full: bool) -> f64 {
    let B = &plant.B;
    let m = B.ncols();
    let (PB, BQB) = (P * B, B.transpose() * Q * B);
    let BPB = B.transpose() * &PB;
    let weights = if is_full { 1 } else { (WEIGHTS.len() as u32).pow(m as u32 - 1).min(MOST_WEIGHTS) };
    // The first channel has weight 1 in turn with the others: only ratios count.
    let of = |number: u32| {
        let digit =
            |i: usize| if i == 0 { 0 } else { number as usize / WEIGHTS.len().pow(i as u32 - 1) % WEIGHTS.len() };
        DVector::from_fn(m, |i, _| WEIGHTS[digit(i)])
    };
    let all = (0..weights).map(of).flat_map(|weights| {
        let against = weights.map(|weight| WEIGHTS[WEIGHTS.len() - 1] / weight);
        [weights, against]
    });
    all.flat_map(|weights| directions(&BPB, &weights))
        .map(|r| {
            // The corner of ΔB that is worst for this direction.
            let along = (&PB * &r).abs();
            let grows = (along.transpose() * &plant.dB * r.abs())[0];
            let decays = (r.transpose() * &BQB * &r)[0];
            if grows > 0.0 { decays / (2.0 * grows) } else { f64::INFINITY }
        })
        .fold(f64::INFINITY, f64::min)
}

/// Eigenvectors of D S for a positive diagonal D and a symmetric positive S: D^½ times those of D^½ S D^½.
fn directions(S: &DMatrix<f64>, weights: &DVector<f64>) -> Vec<DVector<f64>> {
    let root = DMatrix::from_diagonal(&weights.map(f64::sqrt));
    let eigen = (&root * S * &root).symmetric_eigen();
    eigen.eigenvectors.column_iter().map(|vector| &root * vector).collect()
}
