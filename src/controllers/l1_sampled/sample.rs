//! Computations of a sample: the estimate of the last interval, the predicted state, the filter, the control.

use super::filter::SampledFilter;
use super::{L1Sampled, MOST_DELAY};
use crate::mathematics::limits::within;
use crate::system::{Class, MatrixOf, Point, Scalar, Values};

impl L1Sampled {
    /// Starts with the computed control, or with the manual one if it is in force or the start is bumpless.
    pub(super) fn begin<S: Scalar>(&self, by_hand: S::Flag, v: &mut Point<S>) {
        let none = S::from(0.0);
        v[self.zeta].fill(none);
        if let SampledFilter::General(filter) = &self.filter {
            filter.begin(v);
        }
        v[self.sigma_hat].fill(none);
        if let Some(other) = self.sigma_other {
            v[other].fill(none);
        }
        self.start_state(v);
        v.copy(self.x_before, self.x_ahead);
        if let Some(predictor) = &self.predictor {
            v.copy(self.x_before, predictor.x_hat);
        }
        // Where nothing is late, the start is a sample.
        let is_sample = self.delay(&v.values()).equals(none);
        v.when(is_sample, |v| self.filter(v));
        self.control(v);
        v.when(by_hand, |v| {
            for i in 0..self.u.len() {
                v[self.sampled_control][i] = within(v[self.in_command.u_manual][i], v[self.u_min][i], v[self.u_max][i]);
            }
        });
        for i in 0..self.past.len() {
            v[self.past][i] = v[self.sampled_control][i % self.u.len()];
        }
        v.when(by_hand, |v| self.follow(v));
    }

    /// Takes a sample. What is measured then is of so many samples before as the dead time has.
    pub(super) fn sample<S: Scalar>(&self, v: &mut Point<S>) {
        let measured = v[self.clock.count] + 1.0 - self.delay(&v.values());
        self.remember_control(v);
        self.move_origins(v);
        v.when(measured.at_least(S::from(1.0)), |v| self.estimate(v));
        self.keep_state(v);
        self.look_ahead(v);
        let follows = !self.in_command.is_active(&v.values()) | v.get(self.takes_over);
        v.when(follows, |v| {
            for i in 0..self.u.len() {
                v[self.sampled_control][i] = within(v[self.past][i], v[self.u_min][i], v[self.u_max][i]);
            }
            self.follow(v);
        });
        v.when(!follows & measured.at_least(S::from(0.0)), |v| {
            self.filter(v);
            self.control(v);
        });
        v.put(self.takes_over, false.into());
        self.clock.tick(v);
    }

    /// The dead time, in samples.
    fn delay<S: Scalar>(&self, v: &Values<S>) -> S {
        S::from_integer(v.get(self.delay_steps))
    }

    /// The control of the interval that ended, before those of earlier ones.
    fn remember_control<S: Scalar>(&self, v: &mut Point<S>) {
        let m = self.u.len();
        for k in (m..self.past.len()).rev() {
            v[self.past][k] = v[self.past][k - m];
        }
        for i in 0..m {
            v[self.past][i] = self.in_force(i, &v.values());
        }
    }

    /// The control that acted in the interval between the last two measurements.
    fn acted<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let (m, delay) = (self.u.len(), self.delay(v));
        (0..=MOST_DELAY)
            .fold(S::from(0.0), |u, late| S::select(delay.equals(S::from(late as f64)), v[self.past][late * m + i], u))
    }

    /// σ̂ of the interval between the last two measurements.
    fn estimate<S: Scalar>(&self, v: &mut Point<S>) {
        let (n, m) = self.plant.B.shape();
        if let Some(predictor) = &self.predictor {
            // x̂ = E x̂ + Φ (B (W_0 u + K_m x) + B̄ σ̂)
            for i in 0..n {
                let values = &v.values();
                let moved = product(predictor.E, i, |j| values[predictor.x_hat][j], values)
                    + product(predictor.of_u, i, |j| self.acted(j, values), values)
                    + product(predictor.of_x, i, |j| values[self.x_before][j], values)
                    + product(predictor.of_sigma, i, |j| self.sigma(j, values), values);
                v[self.between][i] = moved;
            }
            for i in 0..n {
                v[predictor.x_hat][i] = v[self.between][i];
                let error = v[self.between][i] - self.state(i, &v.values());
                v[self.between][i] = error;
            }
        } else {
            // x − A_d x − B_d u, what is left.
            for i in 0..n {
                let values = &v.values();
                let nominal = product(self.A_d, i, |j| values[self.x_before][j], values)
                    + product(self.B_d, i, |j| self.acted(j, values), values);
                v[self.between][i] = self.state(i, values) - nominal;
            }
        }
        let by = self.predictor.as_ref().map_or(self.L_inverse, |predictor| predictor.S);
        for j in 0..n {
            let values = &v.values();
            let sigma = product(by, j, |i| values[self.between][i], values);
            match self.sigma_other {
                Some(other) if j >= m => v[other][j - m] = sigma,
                _ => v[self.sigma_hat][j] = sigma,
            }
        }
    }

    /// σ̂, of the controls and then of what no control reaches.
    pub(super) fn sigma<S: Scalar>(&self, j: usize, v: &Values<S>) -> S {
        let m = self.u.len();
        match self.sigma_other {
            Some(other) if j >= m => v[other][j - m],
            _ => v[self.sigma_hat][j],
        }
    }

    /// The measured state, advanced over the controls that are under way, with σ̂.
    fn look_ahead<S: Scalar>(&self, v: &mut Point<S>) {
        let (n, m) = self.plant.B.shape();
        v.copy(self.x_before, self.x_ahead);
        for late in (0..MOST_DELAY).rev() {
            let is_under_way = self.delay(&v.values()).above(S::from(late as f64));
            v.when(is_under_way, |v| {
                for i in 0..n {
                    let values = &v.values();
                    let moved = product(self.A_d, i, |j| values[self.x_ahead][j], values)
                        + product(self.B_d, i, |j| values[self.past][late * m + j], values)
                        + product(self.L_d, i, |j| self.sigma(j, values), values);
                    v[self.between][i] = moved;
                }
                v.copy(self.between, self.x_ahead);
            });
        }
    }

    /// The filter over a sample, driven by K_gd r − W_0 σ̂_1, r as it is where the control acts; for D(s) = 1/s
    /// ζ⁺ = e^(−k T) ζ + (1 − e^(−k T)) (K_gd r − W_0 σ̂_1).
    fn filter<S: Scalar>(&self, v: &mut Point<S>) {
        let ahead = self.delay(&v.values()) * v[self.sample_time];
        let wanted = |i: usize, values: &Values<S>| {
            product(self.K_gd, i, |j| self.reference(j, values) + ahead * values[self.dr][j], values)
                - product(self.W_0, i, |j| values[self.sigma_hat][j], values)
        };
        match &self.filter {
            SampledFilter::Integrator { left, .. } => {
                for i in 0..self.u.len() {
                    let left = v[*left][i];
                    v[self.zeta][i] = left * v[self.zeta][i] + (-left + 1.0) * wanted(i, &v.values());
                }
            }
            SampledFilter::General(filter) => {
                for i in 0..self.u.len() {
                    v[self.zeta][i] = wanted(i, &v.values());
                }
                filter.advance(self, self.zeta, v);
                for i in 0..self.u.len() {
                    v[self.zeta][i] = filter.output(self, i, &v.values());
                }
            }
        }
    }

    /// u = W_0⁻¹ (ζ − K_d x_p), within the limits.
    fn control<S: Scalar>(&self, v: &mut Point<S>) {
        let m = self.u.len();
        for i in 0..m {
            let values = &v.values();
            let wanted = v[self.zeta][i] - product(self.K_d, i, |j| values[self.x_ahead][j], values);
            v[self.between][i] = wanted;
        }
        for i in 0..m {
            let values = &v.values();
            let u = product(self.W_0_inverse, i, |j| values[self.between][j], values);
            v[self.sampled_control][i] = within(u, v[self.u_min][i], v[self.u_max][i]);
        }
    }

    /// ζ := W_0 u + K_d x_p: the computed control is the present one.
    fn follow<S: Scalar>(&self, v: &mut Point<S>) {
        for i in 0..self.u.len() {
            let values = &v.values();
            let zeta = product(self.W_0, i, |j| values[self.sampled_control][j], values)
                + product(self.K_d, i, |j| values[self.x_ahead][j], values);
            v[self.zeta][i] = zeta;
        }
        if let SampledFilter::General(filter) = &self.filter {
            filter.follow(self, self.zeta, v);
        }
    }
}

/// A row of a matrix times a vector.
pub(super) fn product<S: Scalar, C: Class>(
    matrix: MatrixOf<C>,
    row: usize,
    vector: impl Fn(usize) -> S,
    v: &Values<S>,
) -> S {
    (0..matrix.shape().1).fold(S::from(0.0), |sum, j| sum + v[matrix.at(row, j)] * vector(j))
}
