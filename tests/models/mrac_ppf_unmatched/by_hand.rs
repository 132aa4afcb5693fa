//! The controller written out plainly, with arbitrary numbers, against the FMU.
#![allow(non_snake_case)] // matrices have the names of the thesis

use common::random::Random;
use nalgebra::{DMatrix, SMatrix, SVector};

use super::read;

const N: usize = 4;
const M: usize = 2;
/// Rows that the controls reach, and unmatched ones with what drives them: one state drives a row before it, one a row behind.
const REACHED: [usize; M] = [0, 2];
const UNMATCHED: [(usize, usize); 2] = [(1, 2), (3, 0)];

/// A plant, a controller and constant inputs.
#[derive(Debug)]
struct Case {
    A: SMatrix<f64, N, N>,
    A_m: SMatrix<f64, N, N>,
    B: SMatrix<f64, N, M>,
    C: SMatrix<f64, M, N>,
    rho: [[f64; N]; 3],
    K_epsilon: [f64; N],
    gamma: [f64; N],
    upsilon: [f64; N],
    theta_leakage: [f64; N],
    bounds: [[f64; N]; 2],
    tolerance: f64,
    limit: [f64; M],
    x_m0: [f64; N],
    x: [f64; N],
    r: [f64; M],
}

/// x_m, θ̂ row by row, σ̂.
type State = SVector<f64, { N + N * N + N }>;

impl Case {
    fn random(random: &mut Random) -> Self {
        let mut any = |middle: f64, size: f64| middle + size * random.next();
        let mut A_m = SMatrix::from_fn(|row, column| if row == column { any(-2.5, 0.3) } else { any(0.0, 0.2) });
        for (row, by) in UNMATCHED {
            let sign = any(0.0, 1.0).signum();
            A_m[(row, by)] = sign * any(1.2, 0.3);
        }
        let mut A = A_m;
        let mut B = SMatrix::zeros();
        for (place, row) in REACHED.into_iter().enumerate() {
            (0..N).for_each(|column| A[(row, column)] += any(0.0, 1.0));
            (0..M).for_each(|column| B[(row, column)] = any(if place == column { 2.0 } else { 0.0 }, 0.5));
        }
        let C = SMatrix::from_fn(|i, j| f64::from(u8::from(j == UNMATCHED[i].0)) + any(0.0, 0.1));
        let mut row = |middle: f64, size: f64| std::array::from_fn(|_| any(middle, size));
        Case {
            A,
            A_m,
            B,
            C,
            rho: [row(4.0, 0.5), row(2.5, 0.5), row(1.0, 0.5)],
            K_epsilon: row(1.0, 0.5),
            gamma: row(3.0, 1.0),
            upsilon: row(0.3, 0.2),
            theta_leakage: row(1.5, 1.5),
            bounds: [row(0.12, 0.1), row(0.2, 0.15)],
            tolerance: any(0.2, 0.1),
            limit: [any(0.8, 0.3), any(0.8, 0.3)],
            x_m0: std::array::from_fn(|_| any(0.0, 0.4)),
            x: std::array::from_fn(|_| any(0.0, 0.6)),
            r: std::array::from_fn(|_| any(0.0, 1.0)),
        }
    }

    fn text(&self) -> String {
        let rows = |matrix: &DMatrix<f64>| {
            let rows: Vec<Vec<f64>> = matrix.row_iter().map(|row| row.iter().copied().collect()).collect();
            format!("{rows:?}")
        };
        let dynamic = |A: &SMatrix<f64, N, N>| rows(&DMatrix::from_fn(N, N, |i, j| A[(i, j)]));
        let unmatched =
            UNMATCHED.map(|(row, by)| format!("{{ row = {}, driven_by = {} }}", row + 1, by + 1)).join(", ");
        let [rho_0, rho_inf, decay_rate] = self.rho;
        format!(
            "name = 'Test'\nmodel = 'mrac-ppf-unmatched'\ndescription = ''\n[structure]\nA = {}\nB = {}\nC = {}\nunmatched = \
             [{unmatched}]\n[start]\nA_m = {}\nrho_0 = {rho_0:?}\nrho_inf = {rho_inf:?}\ndecay_rate = {decay_rate:?}\nK_epsilon \
             = {:?}\ngamma = {:?}\nupsilon = {:?}\ntheta_bound = {:?}\nsigma_bound = {:?}\nprojection_tolerance = {:?}\ntheta_leakage = \
             {:?}\nx_m_start = 'given'\nx_m0 = {:?}\nu_min = {:?}\nu_max = {:?}\nrelative_tolerance = 1e-10",
            dynamic(&self.A),
            rows(&DMatrix::from_fn(N, M, |i, j| self.B[(i, j)])),
            rows(&DMatrix::from_fn(M, N, |i, j| self.C[(i, j)])),
            dynamic(&self.A_m),
            self.K_epsilon,
            self.gamma,
            self.upsilon,
            self.bounds[0],
            self.bounds[1],
            self.tolerance,
            self.theta_leakage,
            self.x_m0,
            self.limit.map(|limit| -limit),
            self.limit
        )
    }

    /// The derivatives of the state, the control without limits, and e, at a time.
    fn at(&self, t: f64, state: &State) -> (State, SVector<f64, M>, [f64; N]) {
        let x = SVector::from(self.x);
        let x_m: SVector<f64, N> = state.fixed_rows::<N>(0).into_owned();
        let theta = |i: usize, j: usize| state[N + i * N + j];
        let sigma = |i: usize| state[N + N * N + i];
        let K_g = -(self.C * self.A_m.try_inverse().unwrap() * self.B).try_inverse().unwrap();
        let x_m_rate = self.A_m * x_m + self.B * K_g * SVector::from(self.r);
        let estimate = |i: usize| (0..N).map(|j| theta(i, j) * x[j]).sum::<f64>() + sigma(i);
        // ε, R, b of a row with this error.
        let of_error = |i: usize, e: f64| {
            let above = (self.rho[0][i] - self.rho[1][i]) * (-self.rho[2][i] * t).exp();
            let (rho, rate) = (above + self.rho[1][i], -self.rho[2][i] * above);
            let z = e / rho;
            assert!(z.abs() < 1.0, "row {i} leaves its funnel: no case for a comparison");
            let (epsilon, R) = (z.atanh(), 1.0 / (rho * (1.0 - z * z)));
            (epsilon, R, z * rate - self.K_epsilon[i] * R * epsilon)
        };
        let mut e: [f64; N] = std::array::from_fn(|i| x[i] - x_m[i]);
        for (row, by) in UNMATCHED {
            let others: f64 = (0..N).filter(|j| *j != by).map(|j| self.A[(row, j)] * x[j]).sum();
            let alpha = (x_m_rate[row] - others - estimate(row) + of_error(row, e[row]).2) / self.A[(row, by)];
            e[by] = x[by] - alpha;
        }
        let mut rate = State::zeros();
        rate.fixed_rows_mut::<N>(0).copy_from(&x_m_rate);
        let mut w = SVector::<f64, M>::zeros();
        for i in 0..N {
            let (epsilon, R, b) = of_error(i, e[i]);
            for j in 0..N {
                let of_theta =
                    self.gamma[i] * R * (epsilon * x[j] - self.theta_leakage[i] * epsilon.abs() * theta(i, j));
                rate[N + i * N + j] = self.projected(theta(i, j), of_theta, self.bounds[0][i]);
            }
            let of_sigma = self.gamma[i] * R * (epsilon - self.upsilon[i] * epsilon.abs() * sigma(i));
            rate[N + N * N + i] = self.projected(sigma(i), of_sigma, self.bounds[1][i]);
            if let Some(place) = REACHED.iter().position(|reached| *reached == i) {
                w[place] = x_m_rate[i] - (self.A.row(i) * x)[0] - estimate(i) + b;
            }
        }
        let B_a = SMatrix::<f64, M, M>::from_fn(|i, j| self.B[(REACHED[i], j)]);
        (rate, B_a.try_inverse().unwrap() * w, e)
    }

    /// Proj(v, y) about 0.
    fn projected(&self, v: f64, y: f64, bound: f64) -> f64 {
        let f = ((1.0 + self.tolerance) * v * v - bound * bound) / (self.tolerance * bound * bound);
        if f > 0.0 && v * y > 0.0 { y * (1.0 - f) } else { y }
    }

    /// The state after a time, by the method of Runge and Kutta.
    fn after(&self, until: f64) -> State {
        let (mut state, steps) = (State::zeros(), 4000);
        state.fixed_rows_mut::<N>(0).copy_from(&SVector::from(self.x_m0));
        let h = until / f64::from(steps);
        for k in 0..steps {
            let t = f64::from(k) * h;
            let k1 = self.at(t, &state).0;
            let k2 = self.at(t + h / 2.0, &(state + k1 * (h / 2.0))).0;
            let k3 = self.at(t + h / 2.0, &(state + k2 * (h / 2.0))).0;
            let k4 = self.at(t + h, &(state + k3 * h)).0;
            state += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
        }
        state
    }
}

#[test]
fn it_is_the_law_that_is_written() {
    let mut random = Random::new(5);
    let (mut limited, mut at_bound) = (0, 0);
    for _ in 0..12 {
        let case = Case::random(&mut random);
        let until = 0.8;
        let mut run = read(&case.text()).unwrap();
        (0..N).for_each(|i| run.set(&format!("x[{}]", i + 1), case.x[i]));
        (0..M).for_each(|i| run.set(&format!("r[{}]", i + 1), case.r[i]));
        run.0.initialise().unwrap();
        run.run(8, until / 8.0);
        let state = case.after(until);
        let (_, u, e) = case.at(until, &state);
        let same = |name: String, exact: f64| {
            let found = run.get(&name);
            assert!((found - exact).abs() < 1e-7 * (1.0 + exact.abs()), "{name}: {found}, {exact}\n{case:?}");
        };
        for i in 0..N {
            same(format!("x_m[{}]", i + 1), state[i]);
            same(format!("e[{}]", i + 1), e[i]);
            same(format!("sigma_hat[{}]", i + 1), state[N + N * N + i]);
            (0..N).for_each(|j| same(format!("theta_hat[{},{}]", j + 1, i + 1), state[N + i * N + j]));
        }
        for k in 0..M {
            let exact = u[k].clamp(-case.limit[k], case.limit[k]);
            limited += usize::from(exact != u[k]);
            same(format!("u[{}]", k + 1), exact);
        }
        at_bound += run.integer("projection_active");
    }
    println!("{limited} of 24 at a limit, {at_bound} estimates at a bound");
    assert!((1..24).contains(&limited) && (1..240).contains(&at_bound), "{limited}, {at_bound}");
}
