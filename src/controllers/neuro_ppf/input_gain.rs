//! The network that estimates the plant's input gain G.

use super::network::{Network, sum};
use crate::system::{
    Declaration, DesignReport, Discrete, Input, MatrixOf, Parameter, Point, Rates, Scalar, ScalarOf, Signal, Signals,
    State, Values, VectorOf, Verdict, matrix, scalar, vector,
};

/// The most channels, for which adjugates are written out.
pub(super) const MOST_CHANNELS: usize = 3;
/// A value each channel; those that a law lacks are zero.
pub(super) type Channels<S> = [S; MOST_CHANNELS];

/// (F_G)_ij = Zᵀ θ_G,ij, and the part ν_a of the control that inverts it.
#[derive(Debug)]
pub(super) struct InputGainNetwork {
    eta_Ga: ScalarOf<Parameter>,
    delta_d: ScalarOf<Parameter>,
    g_network_initial: ScalarOf<Parameter>,
    theta_G: MatrixOf<State>,
    /// θ_G0 of the diagonal of G, which has the same for each.
    theta_G0: VectorOf<Discrete>,
    F_G: MatrixOf<Signal>,
    nu_a: VectorOf<Signal>,
}

impl InputGainNetwork {
    pub fn declare(d: &mut Declaration, neurons: usize, units: &[&'static str]) -> Self {
        let m = units.len();
        let number = |name: &str, text: &str, start: f64| scalar(name, text).start(start).min(0.0);
        let initial = "estimate of the input gain at the start, times the identity matrix; where it is 0, as in the thesis, \
                       it stays 0 and the network of the input gain never acts";
        let weights = "weight of a neuron in the estimate of the input gain's element (i,l): column (i - 1) m + l";
        InputGainNetwork {
            eta_Ga: d.parameter(number("eta_Ga", "gain of the robust term for nu_a", 0.2)),
            delta_d: d.parameter(
                scalar("delta_d", "what keeps the inverse of the estimated input gain finite").start(0.1).positive(),
            ),
            g_network_initial: d.parameter(scalar("g_network_initial", initial).fixed()),
            theta_G: d.state(matrix("theta_G", neurons, m * m, weights).source("Hashim (5.26)")),
            theta_G0: d.discrete(vector("#theta_G0", neurons, "").hidden()),
            F_G: d.local(matrix("F_G", m, m, "estimate of the input gain").source("Hashim (5.19)")),
            nu_a: d.local(
                vector("nu_a", m, "control that inverts the estimated input gain").units(units).source("Hashim (5.23)"),
            ),
        }
    }

    /// Reports if the network can act.
    pub fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        let g = v[self.g_network_initial];
        if g != 0.0 {
            report.add("input gain at the start", g, "", &v.name(self.g_network_initial));
            return;
        }
        let note = format!(
            "{} is 0: the estimate of the input gain stays 0, and only the robust term of nu_b controls. Use the \
             plant's nominal input gain so that the network acts, or input_gain_network = false for the same result \
             with fewer states",
            v.name(self.g_network_initial)
        );
        report.judge("input gain at the start", g, "", Verdict::Warning, note);
    }

    /// θ_G0 = Z g/(ZᵀZ) on the diagonal, the least weights with which F_G is g I at the start; θ_G starts there.
    pub fn initialise<S: Scalar>(&self, network: &Network, x: VectorOf<Input>, v: &mut Point<S>) {
        let (m, g, zero) = (self.nu_a.len(), v[self.g_network_initial], S::from(0.0));
        let (mut inputs, len) = ([zero; 2 * MOST_CHANNELS], x.len());
        inputs[..len].copy_from_slice(&v[x]);
        network.outputs(&inputs[..len], &mut v[self.theta_G0]);
        let squared = sum(&v[self.theta_G0], &v[self.theta_G0]);
        // If every neuron is 0, the network can't estimate.
        let factor = S::branch(squared.above(zero), || g / squared, || zero);
        v[self.theta_G0].iter_mut().for_each(|Z| *Z *= factor);
        let neurons = network.neurons();
        v[self.theta_G.elements()].fill(zero);
        for i in 0..m {
            v.copy(self.theta_G0, self.theta_G.elements().part(i * (m + 1) * neurons..(i * (m + 1) + 1) * neurons));
        }
    }

    /// Writes F_G and ν_a = −adj(F_G) det(F_G)/(det(F_G)² + δ_d) ν_b, and gives ν_a and η_Ga |ν_a|².
    pub fn outputs<S: Scalar>(
        &self,
        Z: VectorOf<Signal>,
        nu_b: Channels<S>,
        v: &Values<S>,
        y: &mut Signals<S>,
    ) -> (Channels<S>, S) {
        let (m, theta) = (self.nu_a.len(), v.matrix(self.theta_G));
        // With the identity beyond m, which leaves determinant and adjugate as they are.
        let mut F: [Channels<S>; MOST_CHANNELS] =
            std::array::from_fn(|i| std::array::from_fn(|l| S::from(f64::from(u8::from(i == l)))));
        for (i, row) in F.iter_mut().enumerate().take(m) {
            for (l, F) in row.iter_mut().enumerate().take(m) {
                let column = theta.column(i * m + l);
                *F = sum(&y[Z], column.as_slice());
                y[self.F_G.at(i, l)] = *F;
            }
        }
        let adjugate = adjugate(&F);
        let determinant = F[0][0] * adjugate[0][0] + F[0][1] * adjugate[1][0] + F[0][2] * adjugate[2][0];
        let factor = -determinant / (determinant * determinant + v[self.delta_d]);
        let mut nu_a = [S::from(0.0); MOST_CHANNELS];
        for i in 0..m {
            nu_a[i] = factor * sum(&adjugate[i][..m], &nu_b[..m]);
            y[self.nu_a.at(i)] = nu_a[i];
        }
        (nu_a, v[self.eta_Ga] * sum(&nu_a, &nu_a))
    }

    /// θ_G,il' = Γ (Z ν_a,l R_i E_i − σ (θ_G,il − θ_G0,il))
    pub fn derivatives<S: Scalar>(
        &self,
        [Z, RE]: [VectorOf<Signal>; 2],
        [gain, sigma]: [S; 2],
        v: &Values<S>,
        dx: &mut Rates<S>,
    ) {
        let (m, neurons) = (self.nu_a.len(), Z.len());
        for (i, l) in (0..m).flat_map(|i| (0..m).map(move |l| (i, l))) {
            let excitation = v[RE.at(i)] * v[self.nu_a.at(l)];
            for j in 0..neurons {
                let theta = self.theta_G.at(j, i * m + l);
                let towards = if i == l { v[self.theta_G0.at(j)] } else { S::from(0.0) };
                dx[theta] = gain * (v[Z.at(j)] * excitation - sigma * (v[theta] - towards));
            }
        }
    }
}

/// adj(F): transposed cofactors.
fn adjugate<S: Scalar>(F: &[Channels<S>; MOST_CHANNELS]) -> [Channels<S>; MOST_CHANNELS] {
    std::array::from_fn(|i| {
        std::array::from_fn(|l| {
            let [(r1, c1), (r2, c2)] = [1, 2].map(|step| ((l + step) % 3, (i + step) % 3));
            F[r1][c1] * F[r2][c2] - F[r1][c2] * F[r2][c1]
        })
    })
}

#[cfg(test)]
mod tests {
    use super::adjugate;

    #[test]
    fn an_adjugate_is_the_inverse_times_the_determinant_whatever_the_size() {
        let full: [[f64; 3]; 3] = [[2.0, -1.0, 0.5], [0.3, 1.5, -2.0], [1.0, 0.25, 3.0]];
        let inverse = nalgebra::Matrix3::from_fn(|i, l| full[i][l]).try_inverse().unwrap();
        let determinant = nalgebra::Matrix3::from_fn(|i, l| full[i][l]).determinant();
        let found = adjugate(&full);
        assert!((0..9).all(|k| (found[k / 3][k % 3] - determinant * inverse[(k / 3, k % 3)]).abs() < 1e-14));
        // Of two channels, and of one, singular ones too.
        let two = adjugate(&[[1.0, 2.0, 0.0], [2.0, 4.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!([two[0][..2].to_vec(), two[1][..2].to_vec()], [[4.0, -2.0], [-2.0, 1.0]]);
        assert_eq!(adjugate(&[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])[0][0], 1.0);
    }
}
