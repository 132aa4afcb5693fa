//! The closed-form step of an L1 controller.
//!
//! The estimates may oscillate so fast that a general integrator needs many steps in a communication step. But with
//! the regressor φ, the control v_0 and the gain ω̂ of the stride's beginning, what couples them is linear: x̃ = x̂ − x,
//! a = ω̂ v_0 + θ̂ φ + σ̂ (one number a channel, in which the estimates act together), the filter's state f, time and a
//! constant. One matrix exponential solves it, and the increment of a is shared out to the estimates in proportion
//! to what each of them multiplies. Projection isn't linear: where it may act, a general method takes the step.

use super::estimates::Estimate;
use super::{Baseline, L1, Regressor, largest};
use crate::control::{exponential, projection};
use crate::system::{Handle, Point, Stride, Values};

/// Where the parts of the linear system's state (x̃, a, f, t, 1) begin.
#[derive(Debug, Clone, Copy)]
struct Places {
    a: usize,
    f: usize,
    time: usize,
    one: usize,
    order: usize,
}

/// The linear system, and what is needed to fill it.
struct Linear<'a> {
    l1: &'a L1,
    v: Values<'a, f64>,
    slopes: &'a [f64],
    at: Places,
    /// By columns.
    matrix: &'a mut [f64],
    /// η̂ as rows over the state, one a channel.
    eta: &'a mut [f64],
}

/// The workspace, divided.
struct Space<'a> {
    matrix: &'a mut [f64],
    eta: &'a mut [f64],
    exponential: &'a mut [f64],
    /// The linear system's state at the stride's beginning, its end, and after twice its length.
    solution: [&'a mut [f64]; 3],
    states: &'a mut [f64],
}

impl L1 {
    fn places(&self) -> Places {
        let (n, m) = self.plant.B.shape();
        let time = n + m + self.f.len();
        Places { a: n, f: n + m, time, one: time + 1, order: time + 2 }
    }

    /// Number of continuous states.
    fn states(&self) -> usize {
        let (n, m) = self.plant.B.shape();
        n + self.estimates() + m * self.filter.order()
    }

    fn space_sizes(&self) -> [usize; 7] {
        let (order, m) = (self.places().order, self.u.len());
        [order * order, m * order, exponential::workspace(order), order, order, order, self.states()]
    }

    /// Size of the workspace.
    pub(super) fn closed_form_workspace(&self) -> usize {
        self.space_sizes().iter().sum()
    }

    fn divide<'a>(&self, workspace: &'a mut [f64]) -> Space<'a> {
        let mut rest = workspace;
        let [matrix, eta, exponential, start, end, whole, states] = self.space_sizes().map(|size| {
            let (part, others) = std::mem::take(&mut rest).split_at_mut(size);
            rest = others;
            part
        });
        Space { matrix, eta, exponential, solution: [start, end, whole], states }
    }

    /// Advances the states by one stride, and tells where one of twice its length leads. Whether it could: not where an
    /// estimate may come to the layer at its bounds on the way, for what is linear here knows no projection.
    pub(super) fn closed_form(&self, stride: Stride, v: &mut Point) -> bool {
        let Space { matrix, eta, exponential, solution: [start, end, whole], states } = self.divide(stride.workspace);
        let at = self.places();
        let values = v.values();
        Linear { l1: self, v: values, slopes: stride.slopes, at, matrix, eta: &mut *eta }.fill();
        self.linear_state(&values, at, start);
        apply(matrix, start, end);
        apply(matrix, end, whole);
        let (rates, second_rates) = (&end[at.a..at.f], &whole[at.a..at.f]);
        let amplitudes = &mut eta[..rates.len()];
        self.amplitudes(&values, rates, second_rates, amplitudes);
        matrix.iter_mut().for_each(|entry| *entry *= stride.length);
        exponential::exponential(at.order, matrix, exponential);
        apply(matrix, start, end);
        apply(matrix, end, whole);
        let of_a = at.a..at.f;
        if self.may_be_projected(&values, amplitudes, [&start[of_a.clone()], &end[of_a.clone()], &whole[of_a]]) {
            return false;
        }
        self.arrive(&values, at, [start, whole], stride.slopes, 2.0 * stride.length, stride.whole);
        self.arrive(&values, at, [start, end], stride.slopes, stride.length, states);
        for handle in [self.x_hat, self.omega_hat, self.theta_hat.elements(), self.sigma_hat, self.f] {
            v.set(handle, &states[handle.span().range()]);
        }
        true
    }

    /// How far a may swing about where it stands, with its rates of first and second order.
    fn amplitudes(&self, v: &Values<f64>, rates: &[f64], second_rates: &[f64], amplitudes: &mut [f64]) {
        let PB = v.matrix(self.design.PB);
        for (i, amplitude) in amplitudes.iter_mut().enumerate() {
            let stiffness: f64 = PB.column(i).iter().zip(self.plant.B.column(i).iter()).map(|(p, b)| p * b).sum();
            let square = v[self.design.adaptation_gain] * self.excitation(v, i) * stiffness;
            *amplitude = 2.0 * (rates[i] / square.sqrt()).hypot(second_rates[i] / square);
        }
    }

    /// Whether an estimate may come to the layer in which projection acts, where a goes through these values.
    fn may_be_projected(&self, v: &Values<f64>, amplitudes: &[f64], [start, end, whole]: [&[f64]; 3]) -> bool {
        let epsilon = v[self.design.projection_tolerance];
        (0..self.estimates()).any(|k| {
            let Estimate { place, bounds: (lo, hi), channel: i, factor } = self.estimate(k, v);
            let (gone, further) = (end[i] - start[i], whole[i] - start[i]);
            let [down, up] = [gone.min(further).min(0.0) - amplitudes[i], gone.max(further).max(0.0) + amplitudes[i]];
            let share = factor / self.excitation(v, i);
            let in_layer = |increment: f64| projection::is_in_layer(v[place] + share * increment, lo, hi, epsilon);
            // An estimate whose bounds coincide is in no layer, but doesn't move.
            lo == hi || in_layer(down) || in_layer(up)
        })
    }

    /// (x̃, a, f, t, 1) at the stride's beginning.
    fn linear_state(&self, v: &Values<f64>, at: Places, state: &mut [f64]) {
        for (x_tilde, (x_hat, x)) in state.iter_mut().zip(v[self.x_hat].iter().zip(&v[self.x])) {
            *x_tilde = x_hat - x;
        }
        for (i, a) in state[at.a..at.f].iter_mut().enumerate() {
            *a = v[self.eta_hat][i] - if self.baseline == Baseline::Inside { v[self.feedback][i] } else { 0.0 };
        }
        state[at.f..at.time].copy_from_slice(&v[self.f]);
        (state[at.time], state[at.one]) = (0.0, 1.0);
    }

    /// The controller's states where the linear system has gone from one state to another in time h.
    fn arrive(
        &self,
        v: &Values<f64>,
        at: Places,
        [start, end]: [&[f64]; 2],
        slopes: &[f64],
        h: f64,
        states: &mut [f64],
    ) {
        let slope = &slopes[self.x.span().range()];
        for (k, x_hat) in states[self.x_hat.span().range()].iter_mut().enumerate() {
            *x_hat = v[self.x][k] + slope[k] * h + end[k];
        }
        states[self.f.span().range()].copy_from_slice(&end[at.f..at.time]);
        for k in 0..self.estimates() {
            let Estimate { place, channel, factor, .. } = self.estimate(k, v);
            let increment = factor * (end[at.a + channel] - start[at.a + channel]) / self.excitation(v, channel);
            states[place.span().start] = v[place] + increment;
        }
    }

    /// N: the sum of squares of what the estimates of a channel are multiplied by.
    fn excitation(&self, v: &Values<f64>, channel: usize) -> f64 {
        let entries = self.omega_entries.iter().filter(|entry| entry.0 == channel);
        let of_control: f64 = entries.map(|&(_, j)| v[self.v][j] * v[self.v][j]).sum();
        of_control + v[self.phi].iter().map(|phi| phi * phi).sum::<f64>() + 1.0
    }
}

/// y = M x
fn apply(matrix: &[f64], x: &[f64], y: &mut [f64]) {
    y.fill(0.0);
    for (column, &x) in matrix.chunks_exact(y.len()).zip(x) {
        y.iter_mut().zip(column).for_each(|(y, entry)| *y += entry * x);
    }
}

impl Linear<'_> {
    fn entry(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.matrix[row + column * self.at.order]
    }

    /// Rate of K_m x in a channel.
    fn feedback_rate(&self, channel: usize) -> f64 {
        let rates = &self.slopes[self.l1.x.span().range()];
        let K_m = self.l1.design.K_m(&self.v);
        K_m.map_or(0.0, |K_m| K_m.row(channel).iter().zip(rates).map(|(k, rate)| k * rate).sum())
    }

    fn fill(mut self) {
        self.matrix.fill(0.0);
        self.eta.fill(0.0);
        *self.entry(self.at.time, self.at.one) = 1.0;
        self.prediction_error();
        self.uncertainty();
        self.predictor();
        self.adaptation();
        self.control_law();
    }

    /// x̃' = A_m x̃ + (A_m x − x') …
    fn prediction_error(&mut self) {
        let (l1, v) = (self.l1, self.v);
        let (A_m, x) = (l1.design.A_m(&v), &v[l1.x]);
        let rates = &self.slopes[l1.x.span().range()];
        for i in 0..x.len() {
            for j in 0..x.len() {
                *self.entry(i, j) = A_m[(i, j)];
            }
            let along = |values: &[f64]| A_m.row(i).iter().zip(values).map(|(a, x)| a * x).sum::<f64>();
            *self.entry(i, self.at.one) = along(x) - rates[i];
            *self.entry(i, self.at.time) = along(rates);
        }
    }

    /// η̂ = a + ω̂ (v − v_0) + θ̂ (φ − φ_0) + K_m x, the last for a baseline inside.
    fn uncertainty(&mut self) {
        let l1 = self.l1;
        let m = l1.u.len();
        for i in 0..m {
            let feedback_rate = self.feedback_rate(i);
            let eta = &mut self.eta[i * self.at.order..(i + 1) * self.at.order];
            eta[self.at.a + i] = 1.0;
            eta[self.at.time] = regressor_rate(l1, &self.v, self.slopes, i);
            if l1.baseline == Baseline::Inside {
                eta[self.at.one] = self.v[l1.feedback][i];
                eta[self.at.time] += feedback_rate;
            }
        }
        for (k, &(i, j)) in l1.omega_entries.iter().enumerate() {
            let omega = self.v[l1.omega_hat][k];
            let (u_ad, feedback) = (self.v[l1.u_ad][j], self.v[l1.feedback][j]);
            let limited = self.v[l1.u][j] != u_ad - feedback;
            let feedback_rate = self.feedback_rate(j);
            let eta = &mut self.eta[i * self.at.order..(i + 1) * self.at.order];
            // How v leaves v_0: with the filter's output, or not at all while the control is at its limit.
            if !limited {
                for (f, c) in eta[self.at.f + j * l1.filter.order()..].iter_mut().zip(l1.filter.C_f.iter()) {
                    *f += omega * c;
                }
                eta[self.at.one] -= omega * u_ad;
            }
            eta[self.at.time] += omega
                * match (l1.baseline, limited) {
                    (Baseline::Inside, false) => -feedback_rate,
                    (Baseline::Outside, true) => feedback_rate,
                    _ => 0.0,
                };
        }
    }

    /// x̃' = … + B η̂
    fn predictor(&mut self) {
        let B = &self.l1.plant.B;
        for column in 0..self.at.order {
            for j in 0..B.ncols() {
                let eta = self.eta[j * self.at.order + column];
                if eta != 0.0 {
                    (0..B.nrows()).for_each(|i| *self.entry(i, column) += B[(i, j)] * eta);
                }
            }
        }
    }

    /// a' = −Γ N Bᵀ P x̃
    fn adaptation(&mut self) {
        let l1 = self.l1;
        let (PB, gamma) = (self.v.matrix(l1.design.PB), self.v[l1.design.adaptation_gain]);
        for i in 0..l1.u.len() {
            let gain = gamma * l1.excitation(&self.v, i);
            for k in 0..l1.x.len() {
                *self.entry(self.at.a + i, k) = -gain * PB[(k, i)];
            }
        }
    }

    /// f' = A_f f − B_f K (η̂ − K_g r)
    fn control_law(&mut self) {
        let (l1, v) = (self.l1, self.v);
        let (K, K_g, r) = (v.matrix(l1.design.feedback_gain), v.matrix(l1.design.K_g), &v[l1.r]);
        let (rates, order) = (&self.slopes[l1.r.span().range()], l1.filter.order());
        for i in 0..l1.u.len() {
            for k in 0..order {
                let row = self.at.f + i * order + k;
                let input = l1.filter.B_f[k];
                for l in 0..order {
                    *self.entry(row, self.at.f + i * order + l) += l1.filter.A_f[(k, l)];
                }
                for j in (0..l1.u.len()).filter(|_| input != 0.0) {
                    let gain = input * K[(i, j)];
                    for column in 0..self.at.order {
                        let eta = self.eta[j * self.at.order + column];
                        *self.entry(row, column) -= gain * eta;
                    }
                    let along = |values: &[f64]| K_g.row(j).iter().zip(values).map(|(k, r)| k * r).sum::<f64>();
                    *self.entry(row, self.at.one) += gain * along(r);
                    *self.entry(row, self.at.time) += gain * along(rates);
                }
            }
        }
    }
}

/// Rate of θ̂ φ(x) in a channel, as x moves.
fn regressor_rate(l1: &L1, v: &Values<f64>, slopes: &[f64], channel: usize) -> f64 {
    let (theta_hat, rates) = (v.matrix(l1.theta_hat), &slopes[l1.x.span().range()]);
    match l1.regressor {
        Regressor::State => theta_hat.row(channel).iter().zip(rates).map(|(theta, rate)| theta * rate).sum(),
        Regressor::InfinityNorm => {
            let k = largest(&v[l1.x]);
            theta_hat[(channel, 0)] * rates[k] * v[l1.x][k].signum()
        }
    }
}
