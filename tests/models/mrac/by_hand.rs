//! The controller written out plainly, with arbitrary numbers, against the FMU: its rates, and its samples.

use common::random::Random;
use common::{OK, Unit};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

const N: usize = 3;
const M: usize = 2;
/// x_m, κ̂ and θ̂ by columns, σ̂.
const STATES: usize = N + M * M + M * N + M;

#[derive(Debug)]
struct Case {
    A_m: SMatrix<f64, N, N>,
    B: SMatrix<f64, N, M>,
    C: SMatrix<f64, M, N>,
    Q: SMatrix<f64, N, N>,
    scale: [f64; N],
    gain: f64,
    omega: [[f64; M]; 2],
    coupling: f64,
    theta_bound: [[f64; N]; M],
    sigma_bound: [f64; M],
    leakage: f64,
    tolerance: f64,
    limit: f64,
    x: SVector<f64, N>,
    r: SVector<f64, M>,
}

impl Case {
    fn random(random: &mut Random) -> Self {
        let mut any = |middle: f64, size: f64| middle + size * random.next();
        let A_m = SMatrix::from_fn(|i, j| if i == j { any(-2.0, 0.5) } else { any(0.0, 0.4) });
        let B = SMatrix::from_fn(|i, j| any(if i == j { 1.5 } else { 0.0 }, 0.4));
        let C = SMatrix::from_fn(|i, j| any(if i == j { 1.0 } else { 0.0 }, 0.2));
        let root = SMatrix::<f64, N, N>::from_fn(|i, j| any(if i == j { 1.0 } else { 0.0 }, 0.3));
        Case {
            A_m,
            B,
            C,
            Q: root * root.transpose(),
            scale: [0; N].map(|_| any(1.0, 0.5)),
            gain: any(60.0, 40.0),
            omega: [[0; M].map(|_| any(0.7, 0.2)), [0; M].map(|_| any(1.6, 0.5))],
            coupling: any(0.3, 0.2),
            theta_bound: [0; M].map(|_| [0; N].map(|_| any(1.0, 0.8))),
            sigma_bound: [0; M].map(|_| any(1.0, 0.8)),
            leakage: any(0.5, 0.5),
            tolerance: any(0.3, 0.25),
            limit: any(0.8, 0.6),
            x: SVector::from_fn(|_, _| any(0.0, 0.8)),
            r: SVector::from_fn(|_, _| any(0.0, 0.8)),
        }
    }

    fn text(&self, further: &str) -> String {
        let rows = |matrix: DMatrix<f64>| {
            format!("{:?}", matrix.row_iter().map(|row| row.iter().copied().collect()).collect::<Vec<Vec<f64>>>())
        };
        let square = |A: &SMatrix<f64, N, N>| rows(DMatrix::from_fn(N, N, |i, j| A[(i, j)]));
        format!(
            "name = 'Test'\nmodel = 'mrac'\ndescription = ''\n[structure]\nB = {}\nC = {}\nstate_scale = {:?}\ninput_gain = \
             'full'\n[start]\nA_m = {}\nQ = {}\nadaptation_gain = {:?}\nomega_min = {:?}\nomega_max = {:?}\nkappa_coupling = \
             {:?}\ntheta_bound = {:?}\nsigma_bound = {:?}\nleakage = {:?}\nprojection_tolerance = {:?}\nu_min = [-{limit:?}, \
             -{limit:?}]\nu_max = [{limit:?}, {limit:?}]\n{further}",
            rows(DMatrix::from_fn(N, M, |i, j| self.B[(i, j)])),
            rows(DMatrix::from_fn(M, N, |i, j| self.C[(i, j)])),
            self.scale,
            square(&self.A_m),
            square(&self.Q),
            self.gain,
            self.omega[0],
            self.omega[1],
            self.coupling,
            self.theta_bound,
            self.sigma_bound,
            self.leakage,
            self.tolerance,
            limit = self.limit,
        )
    }

    /// P of A_m' P + P A_m = −Q, by its equations element by element.
    fn P(&self) -> SMatrix<f64, N, N> {
        let (identity, A) = (DMatrix::<f64>::identity(N, N), DMatrix::from_fn(N, N, |i, j| self.A_m[(j, i)]));
        let system = identity.kronecker(&A) + A.kronecker(&identity);
        let Q = DVector::from_fn(N * N, |k, _| -self.Q[(k % N, k / N)]);
        let P = system.lu().solve(&Q).unwrap();
        SMatrix::from_fn(|i, j| P[i + j * N])
    }

    fn command(&self) -> SVector<f64, M> {
        -(self.C * self.A_m.try_inverse().unwrap() * self.B).try_inverse().unwrap() * self.r
    }

    fn phi(&self) -> [f64; N] {
        std::array::from_fn(|j| self.x[j] / self.scale[j])
    }

    /// κ̂, θ̂ and σ̂ one by one: bounds, channel, what it is multiplied by.
    fn estimates(&self) -> Vec<([f64; 2], usize, f64)> {
        let (u_b, phi) = (self.command(), self.phi());
        let about = |bound: f64| [-bound, bound];
        let mut all = Vec::new();
        for (j, i) in (0..M).flat_map(|j| (0..M).map(move |i| (j, i))) {
            let own = [1.0 - 1.0 / self.omega[0][i], 1.0 - 1.0 / self.omega[1][i]];
            all.push((if i == j { own } else { about(self.coupling) }, i, u_b[j]));
        }
        for (j, i) in (0..N).flat_map(|j| (0..M).map(move |i| (j, i))) {
            all.push((about(self.theta_bound[i][j]), i, phi[j]));
        }
        all.extend((0..M).map(|i| (about(self.sigma_bound[i]), i, 1.0)));
        all
    }

    /// The control without limits.
    fn wanted(&self, state: &[f64]) -> SVector<f64, M> {
        let mut u = self.command();
        for ((_, channel, factor), estimate) in self.estimates().into_iter().zip(&state[N..]) {
            u[channel] -= estimate * factor;
        }
        u
    }

    /// The rates of all states, with what the limits take from this control.
    fn rates(&self, state: &[f64], wanted: SVector<f64, M>) -> Vec<f64> {
        let x_m = SVector::<f64, N>::from_column_slice(&state[..N]);
        let e = self.x - x_m;
        let s = self.B.transpose() * self.P() * e;
        let u = wanted.map(|u| u.clamp(-self.limit, self.limit));
        let model = self.A_m * x_m + self.B * (self.command() + u - wanted);
        let of_estimates = self.estimates().into_iter().zip(&state[N..]).map(|(([lo, hi], channel, factor), &v)| {
            let (d, h) = (v - 0.5 * (lo + hi), 0.5 * (hi - lo));
            let y = s[channel] * factor - self.leakage * e.norm() * v;
            let f = ((1.0 + self.tolerance) * d * d - h * h) / (self.tolerance * h * h);
            self.gain * if f > 0.0 && d * y > 0.0 { y * (1.0 - f) } else { y }
        });
        model.iter().copied().chain(of_estimates).collect()
    }

    fn put(&self, unit: &Unit) {
        (0..N).for_each(|i| unit.put(&format!("x[{}]", i + 1), self.x[i]));
        (0..M).for_each(|i| unit.put(&format!("r[{}]", i + 1), self.r[i]));
    }

    fn states(unit: &Unit) -> Vec<f64> {
        let mut names: Vec<_> = (1..=N).map(|i| format!("x_m[{i}]")).collect();
        for (name, columns) in [("kappa_hat", M), ("theta_hat", N)] {
            names.extend((1..=columns).flat_map(|j| (1..=M).map(move |i| format!("{name}[{i},{j}]"))));
        }
        names.extend((1..=M).map(|i| format!("sigma_hat[{i}]")));
        names.iter().map(|name| unit.get(name)).collect()
    }
}

fn same(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    let all = found.iter().zip(expected).all(|(f, e)| (f - e).abs() < tolerance * (1.0 + e.abs()));
    assert!(found.len() == expected.len() && all, "{what}: {found:?}, not {expected:?}");
}

#[test]
fn rates_and_control_are_those_of_the_formulas_anywhere() {
    let mut random = Random::new(3);
    let (mut limited, mut held_back) = (0, 0);
    for _ in 0..40 {
        let case = Case::random(&mut random);
        let unit = Unit::exchange_from_text(&case.text(""));
        unit.enter(0.0);
        case.put(&unit);
        assert_eq!(unit.exit(), OK, "{:?}", unit.messages());
        unit.settle();
        let mut state: Vec<f64> = (0..N).map(|_| 0.8 * random.next()).collect();
        for ([lo, hi], ..) in case.estimates() {
            state.push(0.5 * (lo + hi) + 0.5 * (hi - lo) * random.next());
        }
        assert_eq!(state.len(), STATES);
        assert_eq!(unit.set_states(&state), OK);
        let wanted = case.wanted(&state);
        let rates = case.rates(&state, wanted);
        same("rates", &unit.derivatives(), &rates, 1e-9);
        let free = Case { tolerance: 1e9, ..case };
        held_back += usize::from(free.rates(&state, wanted) != rates);
        let u = [1, 2].map(|i| unit.get(&format!("u[{i}]")));
        same("u", &u, wanted.map(|u| u.clamp(-free.limit, free.limit)).as_slice(), 1e-10);
        limited += usize::from(wanted.iter().any(|u| u.abs() > free.limit));
    }
    assert!(limited > 5 && limited < 40 && held_back > 5, "{limited}, {held_back}");
}

/// Over a sample time with constant x and r, increments have one sign: the sampled controller in closed form does the
/// same as the continuous one.
#[test]
fn a_sample_leads_where_the_continuous_law_does_with_sampled_inputs() {
    let mut random = Random::new(8);
    let T = 0.02;
    for _ in 0..12 {
        let mut case = Case { leakage: 0.0, ..Case::random(&mut random) };
        let unit = Unit::from_text(&case.text(&format!("sample_time = {T:?}\nstep_move_limit = 1e3")));
        unit.enter(0.0);
        case.put(&unit);
        assert_eq!(unit.exit(), OK, "{:?}", unit.messages());
        let mut state = vec![0.0; STATES];
        state[..N].copy_from_slice(case.x.as_slice());
        let mut wanted = case.wanted(&state);
        for k in 0..30 {
            // What the start takes from inputs is what they are before the first step.
            if k > 0 {
                case.x += SVector::from_fn(|_, _| 0.3 * random.next());
                case.r += SVector::from_fn(|_, _| 0.2 * random.next());
            }
            case.put(&unit);
            assert_eq!(unit.step(f64::from(k) * T, T), OK, "{:?}", unit.messages());
            let found = Case::states(&unit);
            let before = state.clone();
            state = integrated(&case, state, wanted, T);
            // Where s changes its sign within the sample, projection isn't the same.
            let s = |state: &[f64]| {
                let e = case.x - SVector::<f64, N>::from_column_slice(&state[..N]);
                case.B.transpose() * case.P() * e
            };
            let turns = (0..M).any(|i| s(&before)[i] * s(&state)[i] <= 0.0);
            if turns {
                same("model", &found[..N], &state[..N], 1e-7);
            } else {
                same(&format!("sample {k}"), &found, &state, 1e-6);
            }
            state = found;
            wanted = case.wanted(&state);
            let u = [1, 2].map(|i| unit.get(&format!("u[{i}]")));
            same("u", &u, wanted.map(|u| u.clamp(-case.limit, case.limit)).as_slice(), 1e-10);
        }
    }
}

/// Integrates by the method of Runge and Kutta, with constant control and inputs.
fn integrated(case: &Case, mut state: Vec<f64>, wanted: SVector<f64, M>, T: f64) -> Vec<f64> {
    let steps = 400;
    let h = T / f64::from(steps);
    let by = |state: &[f64], k: &[f64], h: f64| state.iter().zip(k).map(|(s, k)| s + h * k).collect::<Vec<_>>();
    for _ in 0..steps {
        let k1 = case.rates(&state, wanted);
        let k2 = case.rates(&by(&state, &k1, 0.5 * h), wanted);
        let k3 = case.rates(&by(&state, &k2, 0.5 * h), wanted);
        let k4 = case.rates(&by(&state, &k3, h), wanted);
        for (i, s) in state.iter_mut().enumerate() {
            *s += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
    }
    state
}
