//! λ*: a small-gain condition by element, which doesn't depend on units. Below 1, the loop is stable while the plant changes
//! within its bounds as it will.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use super::closed::Law;
use crate::design::nominal::poles_of;
use crate::design::robustness::respond::absolute_integral;
use crate::design::robustness::uncertain::Uncertain;

/// λ* at most, for stability that counts as proved.
pub const MOST_LAMBDA: f64 = 0.8;
/// States at most: beyond, the norms take seconds.
const MOST_STATES: usize = 12;
/// Input gains at most that are tried.
const MOST_CORNERS: u32 = 4;

/// The spectral radius of Ē|T| + |M| ΔB |ω⁻¹| |T_f| at the worst corner of ω = I ± |L| ΔB, where T and T_f hold the L1 norms
/// from what enters the states' rates to the states and to the filters; infinite where a loop isn't stable. `excess` is Ē,
/// what of the rates the states are uncertain in: ΔA − ΔB K_m. `None` for a plant of so many states that it isn't computed.
pub fn lambda(plant: &Uncertain, law: &Law, excess: &DMatrix<f64>) -> Option<f64> {
    let corners = input_gains(&plant.bounds.of_inputs(&law.L));
    let all = corners.iter().map(|omega| at(plant, law, excess, omega).unwrap_or(f64::INFINITY));
    (plant.size().0 <= MOST_STATES).then(|| all.fold(0.0, f64::max))
}

/// Ē of a law with a baseline outside of what its estimates see.
pub fn excess(plant: &Uncertain, K_m: &DMatrix<f64>) -> DMatrix<f64> {
    let n = plant.A.nrows();
    plant.bounds.of_feedback(&DMatrix::identity(n, n), K_m)
}

fn at(plant: &Uncertain, law: &Law, excess: &DMatrix<f64>, omega: &DMatrix<f64>) -> Option<f64> {
    let (n, m) = plant.size();
    let gain = omega * &law.K;
    let free = &law.free;
    let k = free.ncols();
    let N = n + k + m;
    let (mut A, mut B) = (DMatrix::zeros(N, N), DMatrix::zeros(N, n));
    A.view_mut((0, 0), (n, n)).copy_from(&law.A_m);
    A.view_mut((0, n + k), (n, m)).copy_from(&-&plant.B);
    A.view_mut((n + k, n + k), (m, m)).copy_from(&-&gain);
    B.view_mut((0, 0), (n, n)).fill_with_identity();
    B.view_mut((n + k, 0), (m, n)).copy_from(&(&gain * &law.L));
    if k > 0 {
        let unmatched = free.transpose() * &law.M;
        A.view_mut((n, n), (k, k)).copy_from(&(&unmatched * &law.A_m * free));
        A.view_mut((n + k, n), (m, k)).copy_from(&-(&gain * &law.L * &law.A_m * free));
        B.view_mut((n, 0), (k, n)).copy_from(&-unmatched);
    }
    let mut out = DMatrix::zeros(n + m, N);
    out.view_mut((0, 0), (n, n)).fill_with_identity();
    out.view_mut((n, n + k), (m, m)).fill_with_identity();
    let norms = absolute_integral(&A, &B, &out)?;
    let (to_x, to_f) = (norms.rows(0, n), norms.rows(n, m));
    let through = plant.bounds.of_inputs(&law.M) * omega.clone().try_inverse()?.abs();
    let whole = excess * to_x + through * to_f;
    poles_of(&whole)?.iter().map(|value| value.norm()).reduce(f64::max)
}

/// I ± spread, entry by entry: all corners of a few entries, else those of the diagonal together, the others with them or
/// against them.
fn input_gains(spread: &DMatrix<f64>) -> Vec<DMatrix<f64>> {
    let m = spread.nrows();
    let identity = DMatrix::identity(m, m);
    let entries: Vec<_> = (0..spread.len()).filter(|&k| spread[k] > 0.0).collect();
    let at = |sign: &dyn Fn(usize) -> f64| {
        let mut omega = identity.clone();
        entries.iter().enumerate().for_each(|(place, &k)| omega[k] += sign(place) * spread[k]);
        omega
    };
    if entries.len() <= MOST_CORNERS as usize {
        return (0..1_usize << entries.len())
            .map(|corner| at(&|k| if corner >> k & 1 == 1 { 1.0 } else { -1.0 }))
            .collect();
    }
    let is_own = |place: usize| entries[place] % m == entries[place] / m;
    let signs = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
    signs.iter().map(|&(own, other)| at(&|place| if is_own(place) { own } else { other })).collect()
}
