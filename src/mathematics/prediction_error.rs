//! The bound on the prediction error of an L1 adaptive law.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

/// Bounds on what an L1 law estimates, entry by entry, and on how fast it changes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Uncertainty {
    /// Bounds on |θ|, one for each entry.
    pub theta_bound: Vec<f64>,
    /// Bounds on |σ|.
    pub sigma_bound: Vec<f64>,
    /// omega_max − omega_min of each estimated entry of ω.
    pub omega_range: Vec<f64>,
    /// Bounds on |θ'|, 1/s, one for each entry; none when θ is constant.
    pub theta_rate: Vec<f64>,
    /// Bounds on |σ'|, 1/s; none when σ is constant.
    pub sigma_rate: Vec<f64>,
}

impl Uncertainty {
    /// θ_m = 4 Σθ_b² + 4 Σσ_b² + Σ(ω_max − ω_min)² + 4 λ_max(P)/λ_min(Q) (Σθ_b d_θ + Σσ_b d_σ).
    ///
    /// Γ V ≤ θ_m for V = x̃ᵀ P x̃ + (‖θ̃‖² + ‖σ̃‖² + ‖ω̃‖²)/Γ, as an estimate between its bounds is wrong by at most twice
    /// the bound, and V' < 0 beyond. ω is taken as constant.
    pub fn theta_m(&self, P: &DMatrix<f64>, Q: &DMatrix<f64>) -> f64 {
        let squares = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
        let products = |bounds: &[f64], rates: &[f64]| bounds.iter().zip(rates).map(|(b, d)| b * d).sum::<f64>();
        let drift = products(&self.theta_bound, &self.theta_rate) + products(&self.sigma_bound, &self.sigma_rate);
        let slowness = P.symmetric_eigenvalues().max() / Q.symmetric_eigenvalues().min();
        4.0 * squares(&self.theta_bound)
            + 4.0 * squares(&self.sigma_bound)
            + squares(&self.omega_range)
            + 4.0 * slowness * drift
    }

    /// ‖x̃‖ ≤ √(θ_m / (λ_min(P) Γ)) at all times, for a predictor that starts at the measured state.
    pub fn prediction_error(&self, P: &DMatrix<f64>, Q: &DMatrix<f64>, adaptation_gain: f64) -> f64 {
        (self.theta_m(P, Q) / (P.symmetric_eigenvalues().min() * adaptation_gain)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mathematics::lyapunov;

    /// |x̃| of x' = −2x + u + θ x + σ under the adaptive law without projection, started at its worst estimates.
    fn largest_error(gamma: f64, theta: f64, sigma: &dyn Fn(f64) -> f64, start: [f64; 2], until: f64) -> f64 {
        let rates = |t: f64, [x, error, theta_hat, sigma_hat]: [f64; 4]| {
            let uncertainty = theta * x + sigma(t);
            let s = -0.25 * error;
            let estimate = theta_hat * x + sigma_hat;
            [-2.0 * x + uncertainty, -2.0 * error + estimate - uncertainty, gamma * s * x, gamma * s]
        };
        let ahead = |s: [f64; 4], k: [f64; 4], h: f64| std::array::from_fn(|i| s[i] + h * k[i]);
        let h = 2e-4;
        let (mut state, mut largest) = ([1.0, 0.0, start[0], start[1]], 0.0_f64);
        for step in 0..(until / h) as usize {
            let t = step as f64 * h;
            let k1 = rates(t, state);
            let k2 = rates(t + h / 2.0, ahead(state, k1, h / 2.0));
            let k3 = rates(t + h / 2.0, ahead(state, k2, h / 2.0));
            let k4 = rates(t + h, ahead(state, k3, h));
            state = std::array::from_fn(|i| state[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
            largest = largest.max(state[1].abs());
        }
        largest
    }

    fn one(x: f64) -> DMatrix<f64> {
        DMatrix::from_element(1, 1, x)
    }

    #[test]
    fn a_constant_uncertainty_keeps_the_prediction_within_the_bound() {
        // A_m = −2, Q = 1: P = 1/4. |θ| ≤ 1, |σ| ≤ 3, both estimates at the wrong end.
        let P = lyapunov::solve(&one(-2.0), &one(1.0)).unwrap();
        let bounds = Uncertainty { theta_bound: vec![1.0], sigma_bound: vec![3.0], ..Uncertainty::default() };
        assert_eq!(bounds.theta_m(&P, &one(1.0)), 40.0);
        for gamma in [1e2, 1e4] {
            let bound = bounds.prediction_error(&P, &one(1.0), gamma);
            let reached = largest_error(gamma, 1.0, &|_| 3.0, [-1.0, -3.0], 3.0);
            assert!(reached <= bound && reached > 0.5 * bound, "reached {reached}, bound {bound}");
        }
    }

    #[test]
    fn a_changing_uncertainty_widens_the_bound() {
        let P = one(0.25);
        let mut bounds = Uncertainty { theta_bound: vec![0.0], sigma_bound: vec![2.0], ..Uncertainty::default() };
        let constant = bounds.theta_m(&P, &one(1.0));
        bounds.sigma_rate = vec![10.0];
        // 4 · (1/4)/1 · 2 · 10 more.
        assert_eq!(bounds.theta_m(&P, &one(1.0)) - constant, 20.0);
        let reached = largest_error(1e3, 0.0, &|t| 2.0 * (5.0 * t).sin(), [0.0, 0.0], 5.0);
        assert!(reached <= bounds.prediction_error(&P, &one(1.0), 1e3), "{reached}");
    }

    #[test]
    fn the_range_of_the_input_gain_counts() {
        let bounds = Uncertainty { omega_range: vec![9.5, 4.0], ..Uncertainty::default() };
        let P = DMatrix::from_row_slice(2, 2, &[2.0, 1.0, 1.0, 2.0]);
        assert_eq!(bounds.theta_m(&P, &DMatrix::identity(2, 2)), 9.5 * 9.5 + 16.0);
        // Eigenvalues of P are 1 and 3.
        let expected = ((9.5_f64 * 9.5 + 16.0) / 1e4).sqrt();
        assert!((bounds.prediction_error(&P, &DMatrix::identity(2, 2), 1e4) - expected).abs() < 1e-14);
    }
}
