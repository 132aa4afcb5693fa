//! The sampled loop with the nominal plant: its poles, its delay margin and its range of input gains.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{Complex, DMatrix, DVector};

use super::design::hold;
use crate::eigenvalues;

/// Equations of the estimate.
#[derive(Debug)]
pub(super) enum Estimation {
    /// σ̂ = L⁻¹ (x − A_d x − B_d u)
    Exact { L_inverse: DMatrix<f64> },
    /// x̂ = E x̂ + Φ (B (W_0 u + K_m x) + B̄ σ̂), σ̂ = S (x̂ − x)
    Published { E: DMatrix<f64>, of_u: DMatrix<f64>, of_x: DMatrix<f64>, of_sigma: DMatrix<f64>, S: DMatrix<f64> },
}

/// q⁺ = F q + G (−W_0 σ̂_1, σ̂_2), ζ = C q − D_2 σ̂_2.
#[derive(Debug)]
pub(super) struct HeldFilter {
    pub F: DMatrix<f64>,
    pub G: DMatrix<f64>,
    pub C: DMatrix<f64>,
    pub direct: DMatrix<f64>,
}

impl HeldFilter {
    /// D(s) = 1/s, with e^(−k T) of each channel.
    pub fn integrator(left: &[f64]) -> Self {
        let m = left.len();
        HeldFilter {
            F: DMatrix::from_diagonal(&DVector::from_column_slice(left)),
            G: DMatrix::from_diagonal(&DVector::from_fn(m, |i, _| 1.0 - left[i])),
            C: DMatrix::identity(m, m),
            direct: DMatrix::zeros(m, 0),
        }
    }

    /// q⁺ and ζ.
    fn step(&self, q: &DVector<f64>, W_0: &DMatrix<f64>, sigma: &DVector<f64>) -> [DVector<f64>; 2] {
        let (m, k) = self.direct.shape();
        let uncertain = W_0 * sigma.rows(0, m);
        let mut driving = DVector::zeros(m + k);
        driving.rows_mut(0, m).copy_from(&(-uncertain));
        driving.rows_mut(m, k).copy_from(&sigma.rows(m, k));
        let q = &self.F * q + &self.G * driving;
        let zeta = &self.C * &q;
        // A matrix without columns makes no vector of zeros.
        let zeta = if k > 0 { zeta - &self.direct * sigma.rows(m, k) } else { zeta };
        [q, zeta]
    }
}

/// A controller and its plant.
#[derive(Debug)]
pub(super) struct Nominal {
    pub T: f64,
    /// The plant, x' = A x + B W_0 u.
    pub A: DMatrix<f64>,
    pub BW_0: DMatrix<f64>,
    pub A_d: DMatrix<f64>,
    pub B_d: DMatrix<f64>,
    pub L_d: DMatrix<f64>,
    pub estimation: Estimation,
    pub filter: HeldFilter,
    pub W_0: DMatrix<f64>,
    pub W_0_inverse: DMatrix<f64>,
    pub K_d: DMatrix<f64>,
    /// The dead time that it is designed for, in samples.
    pub delay: usize,
}

/// State after a sample.
struct Left {
    x: DVector<f64>,
    x_before: DVector<f64>,
    x_hat: DVector<f64>,
    sigma: DVector<f64>,
    q: DVector<f64>,
    /// Controls that acted, the latest first, and those that will.
    acted: Vec<DVector<f64>>,
    queue: Vec<DVector<f64>>,
}

impl Nominal {
    /// Matrix of the loop over a sample, with so many times the nominal input gain, and so much more dead time than it
    /// is designed for, s.
    pub fn matrix(&self, gain: f64, late: f64) -> DMatrix<f64> {
        let samples = (late / self.T).floor();
        let part = late - samples * self.T;
        let more = samples as usize;
        // What of a control gets to the plant in the rest of an interval, and what of the one before in the part that is late.
        let (rest, now) = hold(&self.A, &self.BW_0, self.T - part);
        let before = rest * hold(&self.A, &self.BW_0, part).1;
        let size = self.size(more);
        let mut matrix = DMatrix::zeros(size, size);
        for k in 0..size {
            let mut unit = DVector::zeros(size);
            unit[k] = 1.0;
            let next = self.step(self.unpack(&unit, more), [&now, &before], gain, more);
            matrix.set_column(k, &pack(&next));
        }
        matrix
    }

    fn size(&self, more: usize) -> usize {
        let (n, m) = self.BW_0.shape();
        4 * n + self.filter.F.nrows() + m * (self.delay + more + 2)
    }

    fn unpack(&self, all: &DVector<f64>, more: usize) -> Left {
        let (n, m) = self.BW_0.shape();
        let mut place = 0;
        let mut take = |len: usize| {
            place += len;
            all.rows(place - len, len).into_owned()
        };
        Left {
            x: take(n),
            x_before: take(n),
            x_hat: take(n),
            sigma: take(n),
            q: take(self.filter.F.nrows()),
            acted: (0..more + 2).map(|_| take(m)).collect(),
            queue: (0..self.delay).map(|_| take(m)).collect(),
        }
    }

    fn step(&self, at: Left, [now, before]: [&DMatrix<f64>; 2], gain: f64, more: usize) -> Left {
        let Left { x, x_before, x_hat, sigma, q, mut acted, mut queue } = at;
        let (x_hat, sigma) = match &self.estimation {
            Estimation::Exact { L_inverse } => {
                (x_hat * 0.0, L_inverse * (&x - &self.A_d * &x_before - &self.B_d * &acted[0]))
            }
            Estimation::Published { E, of_u, of_x, of_sigma, S } => {
                let moved = E * x_hat + of_u * &acted[0] + of_x * &x_before + of_sigma * sigma;
                let sigma = S * (&moved - &x);
                (moved, sigma)
            }
        };
        let [q, zeta] = self.filter.step(&q, &self.W_0, &sigma);
        let ahead = queue.iter().fold(x.clone(), |x, u| &self.A_d * x + &self.B_d * u + &self.L_d * &sigma);
        queue.push(&self.W_0_inverse * (&zeta - &self.K_d * ahead));
        acted.insert(0, queue.remove(0));
        acted.pop();
        let driven = now * &acted[more] + before * &acted[more + 1];
        Left { x: &self.A_d * &x + driven * gain, x_before: x, x_hat, sigma, q, acted, queue }
    }

    /// The poles of the loop, the largest first; nothing where they can't be found.
    pub fn poles(&self, gain: f64, late: f64) -> Option<Vec<Complex<f64>>> {
        let mut poles = eigenvalues::complex(&self.matrix(gain, late))?;
        poles.sort_by(|p, q| q.norm().total_cmp(&p.norm()).then(q.im.total_cmp(&p.im)));
        Some(poles)
    }

    /// True if the loop is stable.
    pub fn is_stable(&self, gain: f64, late: f64) -> bool {
        self.poles(gain, late).is_some_and(|poles| poles.first().is_none_or(|pole| pole.norm() < 1.0))
    }

    /// Delay margin in addition to the dead time of the design, s; none if it is at least so many samples.
    pub fn delay_margin(&self, most: usize) -> Option<f64> {
        let is_stable = |late: f64| self.is_stable(1.0, late);
        let tried = (0..).map(|k| 0.125 * 1.15_f64.powi(k)).take_while(|&samples| samples < most as f64);
        edge(0.0, tried.map(|samples| samples * self.T), is_stable)
    }

    /// Between which factors the true input gain may lie, of the nominal one, all channels alike; nothing of those within a
    /// hundredth or a hundred.
    pub fn gain_range(&self) -> [Option<f64>; 2] {
        [-1, 1].map(|way| {
            let tried = (1..).map(|k| 1.1_f64.powi(way * k)).take_while(|factor| (0.01..100.0).contains(factor));
            edge(1.0, tried, |gain| self.is_stable(gain, 0.0))
        })
    }
}

fn pack(left: &Left) -> DVector<f64> {
    let Left { x, x_before, x_hat, sigma, q, acted, queue } = left;
    let parts = [x, x_before, x_hat, sigma, q].into_iter().chain(acted).chain(queue);
    let values: Vec<f64> = parts.flat_map(|part| part.iter().copied()).collect();
    DVector::from_vec(values)
}

/// First value, of those that are tried in turn, at which a loop that is stable at first stops being so.
fn edge(first: f64, tried: impl Iterator<Item = f64>, is_stable: impl Fn(f64) -> bool) -> Option<f64> {
    const HALVINGS: usize = 12;
    let mut good = first;
    for value in tried {
        if is_stable(value) {
            good = value;
            continue;
        }
        let mut bad = value;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (good + bad);
            if is_stable(middle) { good = middle } else { bad = middle }
        }
        return Some(good);
    }
    None
}
