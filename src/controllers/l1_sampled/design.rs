//! The nominal plant as it is sampled, and the gains for it.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{Complex, DMatrix};

use super::L1Sampled;
use super::filter::SampledFilter;
use crate::controllers::inverse::{inverse, refused};
use crate::controllers::l1::orthogonal_complement;
use crate::mathematics::balanced::{far_from_balanced, least_norm};
use crate::mathematics::{feedforward, pole_placement};
use crate::report::at_most;
use crate::system::{Invalid, Number, Point, Values};

/// Entries of a gain that are smaller, in parts of the largest, are zeros.
const ROUNDING: f64 = 1e-14;
/// Most motion of the nominal plant in a sample time, as the least norm of A T in any units.
const MOST_MOTION: f64 = 50.0;

impl L1Sampled {
    /// All that follows from the parameters.
    ///
    /// # Errors
    /// Why there is no such controller.
    pub(super) fn prepare_design(&self, of_A_m: &str, A_m: &DMatrix<f64>, v: &mut Point) -> Result<(), Invalid> {
        let (n, m) = self.plant.B.shape();
        let T = v[self.sample_time];
        let A = self.nominal(A_m);
        let motion = least_norm(&A).max(least_norm(A_m)) * T;
        if motion.is_nan() || motion > MOST_MOTION {
            let allowed = format!(
                "must be at most {}: the nominal plant moves too far within it",
                at_most(MOST_MOTION / (motion / T))
            );
            return Err(Invalid::new(v.name(self.sample_time), Number(T), allowed));
        }
        let W_0 = v.matrix(self.W_0).into_owned();
        let W_0_inverse = self.inverse(&v.name(self.W_0), &W_0)?;
        let directions = self.directions(&W_0);
        let (A_d, L_d) = hold(&A, &directions, T);
        let L_inverse = self.inverse(&format!("effect of sigma over {} s", Number(T)), &L_d)?;
        let B_d = L_d.columns(0, m).into_owned();
        let B_v = &B_d * &W_0_inverse;
        // As rates, where a short sample time would leave little but the identity.
        let (A_r, B_r) = ((&A_d - DMatrix::identity(n, n)) / T, &B_v / T);
        let K_d = match self.dynamics.poles(&v.values()) {
            Some(poles) => {
                pole_placement::place(&A_r, &B_r, &poles.iter().map(|&pole| rate(pole, T)).collect::<Vec<_>>())?
            }
            // What moves the sampled plant as the desired dynamics do, as nearly as it can.
            None if self.dynamics.gain().is_some() => {
                let wanted = (hold(A_m, &DMatrix::zeros(n, 0), T).0 - DMatrix::identity(n, n)) / T;
                B_r.clone().svd(true, true).solve(&(&A_r - wanted), 0.0).map_err(Invalid::because)?
            }
            None => DMatrix::zeros(m, n),
        };
        // What rounding leaves of zeros.
        let noise = ROUNDING * K_d.amax();
        let K_d = K_d.map(|gain| if gain.abs() < noise { 0.0 } else { gain });
        let K_gd = feedforward::gain(&(&A_r - &B_r * &K_d), &B_r, &self.plant.C, of_A_m)?;
        for (handle, matrix) in [
            (self.W_0_inverse, &W_0_inverse),
            (self.A_d, &A_d),
            (self.B_d, &B_d),
            (self.L_d, &L_d),
            (self.L_inverse, &L_inverse),
            (self.K_d, &K_d),
            (self.K_gd, &K_gd),
        ] {
            v.matrix_mut(handle).copy_from(matrix);
        }
        if let SampledFilter::General(filter) = &self.filter {
            let (name, dynamics) = self.filtered_dynamics(A_m, &v.values());
            filter.prepare(self, (&name, &dynamics), v)?;
        }
        self.prepare_predictor(A_m, &W_0, &directions, v)
    }

    /// The dynamics for which unmatched uncertainty is cancelled, with their name: the desired ones, or A − B K_d with
    /// the sampled control of a baseline, to cancel constant uncertainty at any sample time.
    pub(super) fn filtered_dynamics(&self, A_m: &DMatrix<f64>, v: &Values<f64>) -> (String, DMatrix<f64>) {
        let name = match self.dynamics.gain() {
            Some(_) => format!("A - B {}", v.name(self.K_d)),
            None => self.dynamics.name_of_A_m(v),
        };
        (name, self.nominal(A_m) - &self.plant.B * v.matrix(self.K_d))
    }

    fn prepare_predictor(
        &self,
        A_m: &DMatrix<f64>,
        W_0: &DMatrix<f64>,
        directions: &DMatrix<f64>,
        v: &mut Point,
    ) -> Result<(), Invalid> {
        let Some(predictor) = &self.predictor else { return Ok(()) };
        let (n, m) = self.plant.B.shape();
        let T = v[self.sample_time];
        let (E, Phi) = hold(A_m, &DMatrix::identity(n, n), T);
        let K_m = self.dynamics.gain().map_or_else(|| DMatrix::zeros(m, n), |K_m| v.matrix(K_m).into_owned());
        let of_sigma = &Phi * directions;
        let S = -self.inverse(&format!("effect of sigma over {} s", Number(T)), &of_sigma)? * &E;
        let of_v = &Phi * &self.plant.B;
        for (handle, matrix) in [
            (predictor.of_u, &of_v * W_0),
            (predictor.of_x, &of_v * K_m),
            (predictor.of_sigma, of_sigma),
            (predictor.S, S),
            (predictor.E, E),
        ] {
            v.matrix_mut(handle).copy_from(&matrix);
        }
        Ok(())
    }

    /// A; without a baseline the desired dynamics.
    pub(super) fn nominal(&self, A_m: &DMatrix<f64>) -> DMatrix<f64> {
        let given = self.plant.A.as_ref().filter(|_| self.dynamics.gain().is_some());
        given.unwrap_or(A_m).clone()
    }

    /// B̄ = (B W_0, B_um), with all that these don't reach.
    fn directions(&self, W_0: &DMatrix<f64>) -> DMatrix<f64> {
        let ((n, m), k) = (self.plant.B.shape(), self.plant.B_um.ncols());
        let mut all = (&self.plant.B * W_0).resize_horizontally(n, 0.0);
        all.columns_mut(m, k).copy_from(&self.plant.B_um);
        if n > m + k {
            all.columns_mut(m + k, n - m - k).copy_from(&orthogonal_complement(&self.plant.all_directions()));
        }
        all
    }

    /// The inverse of a matrix, whose columns may be of any sizes.
    fn inverse(&self, name: &str, matrix: &DMatrix<f64>) -> Result<DMatrix<f64>, Invalid> {
        let sizes: Vec<_> =
            matrix.column_iter().map(|column| if column.amax() > 0.0 { column.norm() } else { 1.0 }).collect();
        let scaled = DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / sizes[j]);
        if !scaled.norm_squared().is_finite() {
            return Err(refused(name, 0.0));
        }
        let inverse = inverse(&scaled).map_err(|least| refused(name, least))?;
        Ok(DMatrix::from_fn(inverse.nrows(), inverse.ncols(), |i, j| inverse[(i, j)] / sizes[i]))
    }
}

/// e^(A t), and ∫ e^(A s) ds B from 0 to t: the effect of an interval with a constant input.
pub(super) fn hold(A: &DMatrix<f64>, B: &DMatrix<f64>, t: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let Some((balanced, scales)) = far_from_balanced(A) else { return hold_as_given(A, B, t) };
    let (rows, n) = (B.nrows(), A.nrows());
    let scaled = DMatrix::from_fn(rows, B.ncols(), |i, j| B[(i, j)] / scales[i]);
    let (over_A, over_B) = hold_as_given(&balanced, &scaled, t);
    (
        DMatrix::from_fn(n, n, |i, j| over_A[(i, j)] * scales[i] / scales[j]),
        DMatrix::from_fn(rows, B.ncols(), |i, j| over_B[(i, j)] * scales[i]),
    )
}

fn hold_as_given(A: &DMatrix<f64>, B: &DMatrix<f64>, t: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let (n, m) = B.shape();
    let mut whole = DMatrix::zeros(n + m, n + m);
    whole.view_mut((0, 0), (n, n)).copy_from(&(A * t));
    // The input scaled to the size of the rest: the exponential would be halved for it otherwise.
    let size = if B.amax() > 0.0 { B.amax() } else { 1.0 };
    whole.view_mut((0, n), (n, m)).copy_from(&(B / size));
    let over = whole.exp();
    (over.view((0, 0), (n, n)).into_owned(), over.view((0, n), (n, m)) * (size * t))
}

/// (e^(p T) − 1)/T: a pole of the sampled loop, as a rate.
fn rate(pole: Complex<f64>, T: f64) -> Complex<f64> {
    ((pole * T).exp() - 1.0) / T
}
