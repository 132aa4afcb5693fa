//! A loop of an L1 controller with limits, written out and integrated by the classical Runge–Kutta method in short
//! steps. Plant: x1' = x2, x2' = −3 x1 − 0.5 x2 + 0.7 u. Model: a double integrator, with the poles −8 ± 3 j.

use std::fmt::Write as _;

/// The coefficients of s² + 16 s + 73.
const STIFFNESS: f64 = 73.0;
const DAMPING: f64 = 16.0;
const ADAPTATION_GAIN: f64 = 1e4;
/// Length of its steps, s.
const STEP: f64 = 1e-5;

/// Varied parameters.
#[derive(Debug, Clone, Copy)]
pub struct Law {
    pub gain: f64,
    /// True if the baseline stands inside of what the estimates see.
    pub inside: bool,
    /// D(s) = g (z s + 1)/(s (τ s + 1)) with g, z and τ, or 1/s.
    pub filter: Option<[f64; 3]>,
    pub limits: [f64; 2],
    pub tracking_time: f64,
    /// It commands accelerations, which this converts to forces.
    pub inertia: f64,
}

impl Law {
    pub fn description(&self) -> String {
        let Law { gain, inside, filter, limits: [min, max], tracking_time, inertia } = self;
        let baseline = if *inside { "inside" } else { "outside" };
        let mut text = format!(
            "model = 'l1'\n[structure]\nA = [[0.0, 1.0], [0.0, 0.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\n\
             regressor = 'infinity_norm'\ninput_gain = 'diagonal'\ncommands = 'acceleration'\nbaseline = '{baseline}'\n"
        );
        if let Some([g, z, tau]) = filter {
            let denominator = format!("[[1.0, 0.0], [{tau:?}, 1.0]]");
            writeln!(text, "filter = {{ gain = {g:?}, numerator = [[{z:?}, 1.0]], denominator = {denominator} }}")
                .unwrap();
        }
        writeln!(
            text,
            "[start]\npole_real = [-8.0, -8.0]\npole_imag = [3.0, -3.0]\nadaptation_gain = {ADAPTATION_GAIN:?}\n\
             feedback_gain = [[{gain:?}]]\nnominal_inertia = [{inertia:?}]\nomega_min = [-1e6]\nomega_max = [1e6]\n\
             theta_bound = [1e6]\nsigma_bound = [1e6]\nu_min = [{min:?}]\nu_max = [{max:?}]\n\
             tracking_time = [{tracking_time:?}]"
        )
        .unwrap();
        text
    }
}

/// (x1, x2, x̂1, x̂2, ω̂, θ̂, σ̂, i, p): i is the integral in D(s), p what follows it behind the lag.
pub struct Solution {
    law: Law,
    time: f64,
    state: [f64; 9],
}

impl Solution {
    pub fn at_rest(law: Law) -> Self {
        Solution { law, time: 0.0, state: [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0] }
    }

    pub fn x(&self) -> [f64; 2] {
        [self.state[0], self.state[1]]
    }

    pub fn u_ad(&self) -> f64 {
        self.control(&self.state)[0]
    }

    pub fn u(&self) -> f64 {
        self.control(&self.state)[1]
    }

    /// u_ad, u and the acceleration that is wanted.
    fn control(&self, z: &[f64; 9]) -> [f64; 3] {
        let u_ad = match self.law.filter {
            Some([g, zero, tau]) => g * (z[8] + zero * (z[7] - z[8]) / tau),
            None => z[7],
        };
        let wanted = u_ad - STIFFNESS * z[0] - DAMPING * z[1];
        [u_ad, (wanted * self.law.inertia).clamp(self.law.limits[0], self.law.limits[1]), wanted]
    }

    fn rates(&self, t: f64, z: &[f64; 9]) -> [f64; 9] {
        let Law { gain, inside, filter, tracking_time, inertia, .. } = self.law;
        let [x1, x2, x_hat1, x_hat2, omega, theta, sigma, i, p] = *z;
        let r = 0.6 + 0.4 * (3.0 * t).sin();
        let [u_ad, u, wanted] = self.control(z);
        let cut = u / inertia - wanted;
        let baseline = STIFFNESS * x1 + DAMPING * x2;
        let (v, known) = if inside { (u / inertia, baseline) } else { (u_ad + cut, 0.0) };
        let phi = x1.abs().max(x2.abs());
        let eta = omega * v + theta * phi + sigma + known;
        // P of A_mᵀP + P A_m = −I: its second column is what Bᵀ P takes.
        let p12 = 0.5 / STIFFNESS;
        let p22 = (1.0 + 2.0 * p12) / (2.0 * DAMPING);
        let s = -(p12 * (x_hat1 - x1) + p22 * (x_hat2 - x2));
        let g = filter.map_or(1.0, |[g, ..]| g);
        let rate = match tracking_time {
            0.0 => 0.0,
            time if time > 0.0 => 1.0 / time,
            _ => gain * g,
        };
        let driven = -gain * (eta - STIFFNESS * r);
        // At rest with an output of 1 both states of the filter are 1/g.
        let followed = cut * rate / g;
        let lagged = filter.map_or(0.0, |[_, _, tau]| (i - p) / tau + followed);
        [
            x2,
            -3.0 * x1 - 0.5 * x2 + 0.7 * u,
            x_hat2,
            -STIFFNESS * x_hat1 - DAMPING * x_hat2 + eta,
            ADAPTATION_GAIN * s * v,
            ADAPTATION_GAIN * s * phi,
            ADAPTATION_GAIN * s,
            driven + followed,
            lagged,
        ]
    }

    pub fn advance(&mut self, duration: f64) {
        for _ in 0..(duration / STEP).round() as usize {
            let (t, z, h) = (self.time, self.state, STEP);
            let moved = |k: &[f64; 9], h: f64| std::array::from_fn(|j| z[j] + h * k[j]);
            let k1 = self.rates(t, &z);
            let k2 = self.rates(t + 0.5 * h, &moved(&k1, 0.5 * h));
            let k3 = self.rates(t + 0.5 * h, &moved(&k2, 0.5 * h));
            let k4 = self.rates(t + h, &moved(&k3, h));
            self.state = std::array::from_fn(|j| z[j] + h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
            self.time += h;
        }
    }
}
