//! The loop that an L1 adaptive law closes through its filter, and the norm that its stability rests on.
//!
//! C. Cao and N. Hovakimyan, Design and analysis of a novel L1 adaptive control architecture with guaranteed transient
//! performance, IEEE Trans. Automatic Control 53 (2008) 586–591.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use crate::eigenvalues::complex as eigenvalues;
use crate::error::Invalid;
use crate::mathematics::filter::Filter;
use crate::mathematics::l1_norm::{Bounds, L1Norms};
use crate::mathematics::lyapunov::require_hurwitz;

/// Points at most of a grid over the bounds of the input gain.
const GRID: usize = 128;

/// Entries of the input gain at most whose every corner is tried.
const ENTRIES: usize = 7;

/// Work of all norms over ω at most, in multiplications of an impulse response's step: beyond, fewer input gains are tried,
/// but never fewer than these.
const BUDGET: usize = 30_000_000;
const FEWEST: usize = 4;

/// Work of one norm at most: beyond, it takes minutes.
const MOST_WORK: usize = 3_000_000;

/// Relative distance of the bounds of a norm, and of one that is only compared with others.
const TOLERANCE: f64 = 1e-7;
const ROUGH: f64 = 1e-2;

/// Name of A_m in messages.
const DYNAMICS: &str = "the desired dynamics";

/// Points of the grid of frequencies in a decade.
const PER_DECADE: f64 = 40.0;

/// The L1 law u_ad = −K D(s)(η̂ + H_m⁻¹ H_um η̂_2 − K_g r) for x' = A_m x + B (ω u_ad + w) + B_um w_2, with ω between
/// bounds, entry by entry, and an uncertainty w, w_2.
///
/// As the adaptation gets fast, η̂ is ω u_ad + w and η̂_2 is w_2: what is left is a linear system from (w, w_2) to x.
#[derive(Debug, Clone)]
pub struct L1Design {
    /// n × n, Hurwitz.
    pub A_m: DMatrix<f64>,
    /// n × m.
    pub B: DMatrix<f64>,
    /// m × m.
    pub K: DMatrix<f64>,
    /// D(s), the same on every channel.
    pub filter: Filter,
    /// m × m.
    pub omega_min: DMatrix<f64>,
    /// m × m.
    pub omega_max: DMatrix<f64>,
    /// m × n. K_m of a baseline, which acts through ω like all control: what is left of it is (I − ω) K_m x.
    pub known: Option<DMatrix<f64>>,
    /// The way of the unmatched uncertainty, where it is estimated.
    pub unmatched: Option<UnmatchedWay>,
}

/// K D(s) H_m⁻¹(s) H_um(s), which shares the states f of K D(s): f' = … − input w_2 − (I ⊗ B_f) KC_z z, u_ad = … −
/// direct w_2, z' = A_z z + B_z w_2.
#[derive(Debug, Clone)]
pub struct UnmatchedWay {
    /// n × k.
    pub B_um: DMatrix<f64>,
    /// m n_f × k.
    pub input: DMatrix<f64>,
    /// m × k.
    pub direct: DMatrix<f64>,
    /// n_z × n_z.
    pub A_z: DMatrix<f64>,
    /// n_z × k.
    pub B_z: DMatrix<f64>,
    /// m × n_z.
    pub KC_z: DMatrix<f64>,
}

/// Lipschitz constants of the uncertainty in the state, by the largest element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lipschitz {
    /// Constant of the matched part.
    pub matched: f64,
    /// Constant of the unmatched part.
    pub unmatched: f64,
}

/// The norms from the uncertainty to the state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Norms {
    /// From what enters with the control.
    pub matched: Bounds,
    /// From what doesn't; zero where there is none.
    pub unmatched: Bounds,
}

impl Norms {
    const INFINITE: Norms = Norms { matched: Bounds::INFINITE, unmatched: Bounds::INFINITE };

    /// λ = ‖G‖ L + ‖G_um‖ L_2, below 1 where the L1-norm condition holds.
    pub fn lambda(&self, lipschitz: Lipschitz) -> Bounds {
        if !self.matched.upper.is_finite() {
            return Bounds::INFINITE;
        }
        self.matched.times(lipschitz.matched).plus(self.unmatched.times(lipschitz.unmatched))
    }
}

/// The input gain with the largest λ among those tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Worst {
    /// The norms there, infinite where the loop isn't stable.
    pub norms: Norms,
    /// The input gain.
    pub omega: DMatrix<f64>,
    /// Number of input gains that there were to try.
    pub points: usize,
    /// True if every corner of the bounds was among them. If not, only some were, and a larger norm is more likely to
    /// have been missed.
    pub every_corner: bool,
}

/// Frequencies, rad/s, up to which the filtered control follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bandwidth {
    /// Frequency at which the slowest direction has fallen to 1/√2.
    pub slowest: f64,
    /// Frequency at which the fastest one has.
    pub fastest: f64,
}

impl L1Design {
    /// Number of states of the linear system.
    pub fn order(&self) -> usize {
        let zeros = self.unmatched.as_ref().map_or(0, |way| way.A_z.nrows());
        self.A_m.nrows() + self.K.nrows() * self.filter.order() + zeros
    }

    /// Work of a norm: a step of each impulse response.
    fn work(&self) -> usize {
        let inputs = self.B.ncols() + self.unmatched.as_ref().map_or(0, |way| way.B_um.ncols());
        self.A_m.nrows() * inputs * self.order().pow(3)
    }

    /// True if its norms and frequency responses would take minutes.
    pub fn is_large(&self) -> bool {
        self.work() > MOST_WORK
    }

    /// Most input gains that may be tried.
    fn most_points(&self) -> usize {
        (BUDGET / self.work().max(1)).clamp(FEWEST, 1 << ENTRIES)
    }

    /// Entries of the input gain at most whose every corner is tried.
    fn most_entries(&self) -> usize {
        self.most_points().ilog2() as usize
    }

    /// With another K, so many times as large.
    pub fn with_gain_times(&self, factor: f64) -> Self {
        let mut design = self.clone();
        design.K *= factor;
        if let Some(way) = &mut design.unmatched {
            way.input *= factor;
            way.direct *= factor;
            way.KC_z *= factor;
        }
        design
    }

    /// Matrix of the loop ωK D(s), whose eigenvalues are the poles of C(s).
    pub fn loop_matrix(&self, omega: &DMatrix<f64>) -> DMatrix<f64> {
        let Filter { A_f, B_f, C_f } = &self.filter;
        DMatrix::identity(self.K.nrows(), self.K.nrows()).kronecker(A_f) - (omega * &self.K).kronecker(&(B_f * C_f))
    }

    /// Poles of C(s). `None` when they can't be found.
    pub fn loop_poles(&self, omega: &DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
        eigenvalues(&self.loop_matrix(omega))
    }

    /// True if the loop ωK D(s) is stable, and with it what ω leaves of a baseline.
    pub fn is_stable(&self, omega: &DMatrix<f64>) -> bool {
        let decays =
            |matrix: &DMatrix<f64>| eigenvalues(matrix).is_some_and(|poles| poles.iter().all(|lambda| lambda.re < 0.0));
        decays(&self.loop_matrix(omega)) && (self.known.is_none() || decays(&self.system(omega).0))
    }

    /// A and B of the linear system from (w, w_2) to (x, f, z).
    fn system(&self, omega: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
        let (n, m) = self.B.shape();
        let (states, order) = (m * self.filter.order(), self.order());
        let channels = |block: &DMatrix<f64>| DMatrix::identity(m, m).kronecker(block);
        let (C_F, B_F) = (channels(&dynamic(&self.filter.C_f)), channels(&dynamic(&self.filter.B_f)));
        let driven = &B_F * &self.K;
        let mut A = DMatrix::zeros(order, order);
        A.view_mut((0, 0), (n, n)).copy_from(&self.A_m);
        A.view_mut((0, n), (n, states)).copy_from(&(&self.B * omega * &C_F));
        A.view_mut((n, n), (states, states)).copy_from(&(channels(&self.filter.A_f) - &driven * omega * &C_F));
        if let Some(K_m) = &self.known {
            let left = (DMatrix::identity(m, m) - omega) * K_m;
            let mut of_x = A.columns_mut(0, n);
            of_x.rows_mut(0, n).gemm(1.0, &self.B, &left, 1.0);
            of_x.rows_mut(n, states).gemm(-1.0, &driven, &left, 1.0);
        }
        let k = self.unmatched.as_ref().map_or(0, |way| way.B_um.ncols());
        let mut B = DMatrix::zeros(order, m + k);
        B.view_mut((0, 0), (n, m)).copy_from(&self.B);
        B.view_mut((n, 0), (states, m)).copy_from(&-&driven);
        if let Some(UnmatchedWay { B_um, input, direct, A_z, B_z, KC_z }) = &self.unmatched {
            let z = n + states;
            A.view_mut((n, z), (states, order - z)).copy_from(&-(&B_F * KC_z));
            A.view_mut((z, z), A_z.shape()).copy_from(A_z);
            let at_once = omega * direct;
            B.view_mut((0, m), (n, k)).copy_from(&(B_um - &self.B * &at_once));
            B.view_mut((n, m), (states, k)).copy_from(&(&driven * &at_once - input));
            B.view_mut((z, m), B_z.shape()).copy_from(B_z);
        }
        (A, B)
    }

    /// ‖G‖ in the L1 sense, G(s) = (sI − A_m)⁻¹ B (I − C(s)), C(s) = ωK D(s) (I + ωK D(s))⁻¹, and what it is from unmatched
    /// uncertainty; infinite when the loop isn't stable.
    ///
    /// # Errors
    /// [`Invalid`] when A_m isn't Hurwitz, or the system too badly scaled.
    pub fn norms(&self, omega: &DMatrix<f64>) -> Result<Norms, Invalid> {
        require_hurwitz(DYNAMICS, &self.A_m)?;
        self.norms_by(&mut L1Norms::within(TOLERANCE), omega)
    }

    /// The same within a percent, for less work.
    ///
    /// # Errors
    /// As there.
    pub fn rough_norms(&self, omega: &DMatrix<f64>) -> Result<Norms, Invalid> {
        require_hurwitz(DYNAMICS, &self.A_m)?;
        self.norms_by(&mut L1Norms::within(ROUGH), omega)
    }

    fn norms_by(&self, norms: &mut L1Norms, omega: &DMatrix<f64>) -> Result<Norms, Invalid> {
        if !self.is_stable(omega) {
            return Ok(Norms::INFINITE);
        }
        let ((A, B), (n, m)) = (self.system(omega), self.B.shape());
        let to_x = DMatrix::identity(n, A.nrows());
        let mut norm = |first: usize, count: usize| norms.of(&A, &B.columns(first, count).into_owned(), &to_x);
        Ok(Norms { matched: norm(0, m)?, unmatched: norm(m, B.ncols() - m)? })
    }

    /// The largest λ over ω: on a grid of its bounds for up to three entries with distinct bounds, at the corners and
    /// the centre for up to seven, at 128 corners spread over all and the centre for more; at fewer in large systems.
    ///
    /// Between the points it may be larger; corners and centre are where it is usually largest.
    ///
    /// # Errors
    /// [`Invalid`] as of [`L1Design::norms`].
    pub fn worst(&self, lipschitz: Lipschitz) -> Result<Worst, Invalid> {
        require_hurwitz(DYNAMICS, &self.A_m)?;
        let gains = self.gains();
        let found = |norms: Norms, omega: &DMatrix<f64>| {
            let every_corner = self.free().len() <= self.most_entries();
            Ok(Worst { norms, omega: omega.clone(), points: gains.len(), every_corner })
        };
        let (mut rough, mut exact) = (L1Norms::within(ROUGH), L1Norms::within(TOLERANCE));
        let mut candidates = Vec::with_capacity(gains.len());
        for omega in &gains {
            let norms = self.norms_by(&mut rough, omega)?;
            if norms.matched == Bounds::INFINITE {
                return found(norms, omega);
            }
            candidates.push((norms.lambda(lipschitz), omega));
        }
        let least = candidates.iter().map(|(lambda, _)| lambda.lower).fold(0.0, f64::max);
        let mut worst: Option<(f64, Norms, &DMatrix<f64>)> = None;
        for (_, omega) in candidates.iter().filter(|(lambda, _)| lambda.upper >= least) {
            let norms = self.norms_by(&mut exact, omega)?;
            let lambda = norms.lambda(lipschitz).upper;
            if worst.is_none_or(|(largest, ..)| lambda > largest) {
                worst = Some((lambda, norms, omega));
            }
        }
        let (_, norms, omega) = worst.ok_or_else(|| Invalid::because("bounds of omega: no input gain to try"))?;
        found(norms, omega)
    }

    /// Entries of ω whose bounds differ.
    fn free(&self) -> Vec<usize> {
        (0..self.omega_min.len()).filter(|&k| self.omega_min[k] < self.omega_max[k]).collect()
    }

    /// The input gains to try.
    pub fn gains(&self) -> Vec<DMatrix<f64>> {
        let free = self.free();
        let at = |place: &dyn Fn(usize) -> f64| {
            let mut omega = self.omega_min.clone();
            for (k, &entry) in free.iter().enumerate() {
                omega[entry] += place(k) * (self.omega_max[entry] - self.omega_min[entry]);
            }
            omega
        };
        let power = |levels: usize| u32::try_from(free.len()).ok().and_then(|k| levels.checked_pow(k));
        let (most, entries) = (self.most_points().min(GRID), self.most_entries());
        // An odd number of levels has the centre among them.
        if let Some(levels) = [9, 5].into_iter().find(|&levels| power(levels).is_some_and(|count| count <= most)) {
            let count = power(levels).unwrap_or(1);
            let digit = |point: usize, k: usize| point / levels.pow(k as u32) % levels;
            return (0..count).map(|point| at(&|k| digit(point, k) as f64 / (levels - 1) as f64)).collect();
        }
        let corners = 1 << free.len().min(entries);
        let corner = |point: usize, k: usize| {
            if free.len() <= entries {
                return f64::from(u8::from(point >> k & 1 == 1));
            }
            // Beyond: the parity of a few bits of the point, others for each entry, as in an orthogonal array.
            let mask = (k + 1).wrapping_mul(0x9E37_79B9) >> 7 & (corners - 1) | 1;
            f64::from((point & mask).count_ones() & 1)
        };
        let mut gains: Vec<_> = (0..corners).map(|point| at(&|k| corner(point, k))).collect();
        gains.push(at(&|_| 0.5));
        gains
    }

    /// C(s) = ωK D(s) (I + ωK D(s))⁻¹. `None` at a pole, and where its numbers are too large.
    pub fn low_pass(&self, omega: &DMatrix<f64>, s: Complex<f64>) -> Option<DMatrix<Complex<f64>>> {
        let d = self.filter.at(s);
        let gain = (omega * &self.K).map(Complex::from);
        let m = gain.nrows();
        // With D = 1/q: C = ωK (q I + ωK)⁻¹, which holds at the integrator's pole too.
        let q = if d.is_finite() { d.inv() } else { Complex::from(0.0) };
        let low_pass = (DMatrix::identity(m, m) * q + &gain).try_inverse().map(|inverse| gain * inverse);
        low_pass.filter(|low_pass| low_pass.iter().all(|entry| entry.is_finite()))
    }

    /// C(0), the identity as D(s) has an integrator; `None` when ωK is singular and the control can't cancel all
    /// constant uncertainty.
    pub fn dc_gain(&self, omega: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        self.low_pass(omega, Complex::from(0.0)).map(|gain| gain.map(|entry| entry.re))
    }

    /// Frequency at which the largest singular value of C(jω) has fallen to 1/√2, whatever becomes of a baseline.
    /// `None` when C(s) isn't stable.
    pub fn low_pass_band(&self, omega: &DMatrix<f64>) -> Option<f64> {
        L1Design { known: None, ..self.clone() }.bandwidth(omega).map(|band| band.fastest)
    }

    /// Frequencies at which the singular values of C(jω) have first fallen to 1/√2. `None` when the loop isn't stable.
    pub fn bandwidth(&self, omega: &DMatrix<f64>) -> Option<Bandwidth> {
        if !self.is_stable(omega) {
            return None;
        }
        let poles = self.loop_poles(omega)?;
        let [least, most] = [f64::min, f64::max].map(|of| poles.iter().map(|pole| pole.norm()).reduce(of));
        let (lowest, decades) = (1e-4 * least?, (1e8 * most? / least?).log10());
        let extremes = |w: f64| {
            let singular = self.low_pass(omega, Complex::new(0.0, w))?.singular_values();
            Some([singular.min(), singular.max()])
        };
        let mut found = [None; 2];
        let mut below = lowest;
        for w in (0..(decades * PER_DECADE) as usize).map(|k| lowest * 10_f64.powf(k as f64 / PER_DECADE)) {
            let now = extremes(w)?;
            for (k, found) in found.iter_mut().enumerate() {
                if found.is_none() && now[k] < std::f64::consts::FRAC_1_SQRT_2 {
                    *found = Some(bisect(below, w, &|w| extremes(w).map(|values| values[k]))?);
                }
            }
            if let [Some(slowest), Some(fastest)] = found {
                return Some(Bandwidth { slowest, fastest });
            }
            below = w;
        }
        None
    }
}

/// A row or a column as a matrix.
fn dynamic<R: nalgebra::Dim, C: nalgebra::Dim>(
    part: &nalgebra::Matrix<f64, R, C, impl nalgebra::RawStorage<f64, R, C>>,
) -> DMatrix<f64> {
    DMatrix::from_fn(part.nrows(), part.ncols(), |i, j| part[(i, j)])
}

/// Place where a value that is above 1/√2 at `low` and below it at `high` is that.
fn bisect(mut low: f64, mut high: f64, value: &dyn Fn(f64) -> Option<f64>) -> Option<f64> {
    for _ in 0..60 {
        let middle = (low * high).sqrt();
        if value(middle)? < std::f64::consts::FRAC_1_SQRT_2 { high = middle } else { low = middle }
    }
    Some(high)
}

#[cfg(test)]
mod tests;
