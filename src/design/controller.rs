//! Linear controllers and the loop that they close.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

/// u = −(C x + D y), x' = A x + B y.
#[derive(Debug, Clone)]
pub struct Controller {
    /// k × k.
    pub A: DMatrix<f64>,
    /// k × m.
    pub B: DMatrix<f64>,
    /// m × k.
    pub C: DMatrix<f64>,
    /// m × m.
    pub D: DMatrix<f64>,
}

impl Controller {
    /// Controllers of single channels, whose controls go through S.
    pub fn of_channels(channels: &[Controller], S: &DMatrix<f64>) -> Self {
        let m = channels.len();
        let states = channels.iter().map(|channel| channel.A.nrows()).sum();
        let (mut A, mut B) = (DMatrix::zeros(states, states), DMatrix::zeros(states, m));
        let (mut C, mut D) = (DMatrix::zeros(m, states), DMatrix::zeros(m, m));
        let mut first = 0;
        for (i, channel) in channels.iter().enumerate() {
            let own = channel.A.nrows();
            D[(i, i)] = channel.D[(0, 0)];
            if own == 0 {
                continue;
            }
            A.view_mut((first, first), (own, own)).copy_from(&channel.A);
            B.view_mut((first, i), (own, 1)).copy_from(&channel.B);
            C.view_mut((i, first), (1, own)).copy_from(&channel.C);
            first += own;
        }
        Controller { A, B, C: S * C, D: S * D }
    }

    /// The state matrix of the loop that it closes about a plant without feedthrough; the plant's states come first.
    pub fn closed(&self, A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>) -> DMatrix<f64> {
        let (n, k) = (A.nrows(), self.A.nrows());
        let mut M = DMatrix::zeros(n + k, n + k);
        M.view_mut((0, 0), (n, n)).copy_from(&(A - B * &self.D * C));
        M.view_mut((0, n), (n, k)).copy_from(&(-(B * &self.C)));
        M.view_mut((n, 0), (k, n)).copy_from(&(&self.B * C));
        M.view_mut((n, n), (k, k)).copy_from(&self.A);
        M
    }
}
