//! The controller written out plainly, with arbitrary numbers, against the FMU.

use common::models::Run;
use common::random::Random;
use nalgebra::{DMatrix, DVector};

use super::run_of;

fn rows(matrix: &DMatrix<f64>) -> String {
    let row = |i: usize| format!("{:?}", matrix.row(i).iter().collect::<Vec<_>>());
    format!("[{}]", (0..matrix.nrows()).map(row).collect::<Vec<_>>().join(", "))
}

/// A law of two channels, whose numbers are anything.
struct Hand {
    is_second: bool,
    inside: bool,
    by_state: bool,
    A: DMatrix<f64>,
    B: DMatrix<f64>,
    A_m: DMatrix<f64>,
    K: DMatrix<f64>,
    gamma: f64,
    bounds: [f64; 3],
    funnel: [[f64; 3]; 2],
    K_epsilon: [f64; 2],
    lambda: [f64; 2],
    limit: f64,
    r: [[f64; 2]; 3],
    x: DVector<f64>,
    x_m0: DVector<f64>,
}

/// The states of the controller by hand: x_m, x̂, ω̂, θ̂, σ̂, u_ad.
#[derive(Clone)]
struct State([DMatrix<f64>; 6]);

impl State {
    fn moved(&self, rate: &State, h: f64) -> State {
        State(std::array::from_fn(|k| &self.0[k] + &rate.0[k] * h))
    }
}

impl Hand {
    fn random(random: &mut Random, k: usize) -> Self {
        let (is_second, inside, by_state) = (k % 2 == 1, k % 4 > 1, k % 8 > 3);
        let mut any = |middle: f64, size: f64| middle + size * random.next();
        let mut matrix = |diagonal: f64, size: f64| {
            let own = |i: usize, j: usize| if i == j { diagonal } else { 0.0 };
            DMatrix::from_fn(2, 2, |i, j| any(own(i, j), size))
        };
        let gain = matrix(1.0, 0.3);
        let (first, second, stiff, damped, K) =
            (matrix(0.0, 2.0), matrix(0.0, 1.0), matrix(-30.0, 3.0), matrix(-12.0, 1.0), matrix(8.0, 1.0));
        let stacked = |low: [&DMatrix<f64>; 2]| {
            let mut all = DMatrix::zeros(4, 4);
            all.view_mut((0, 2), (2, 2)).fill_with_identity();
            all.view_mut((2, 0), (2, 2)).copy_from(low[0]);
            all.view_mut((2, 2), (2, 2)).copy_from(low[1]);
            all
        };
        let below = |gain: &DMatrix<f64>| {
            let mut all = DMatrix::zeros(4, 2);
            all.view_mut((2, 0), (2, 2)).copy_from(gain);
            all
        };
        let n = if is_second { 4 } else { 2 };
        Hand {
            A: if is_second { stacked([&first, &second]) } else { first },
            B: if is_second { below(&gain) } else { gain },
            A_m: if is_second { stacked([&stiff, &damped]) } else { damped },
            K,
            gamma: any(600.0, 300.0),
            bounds: [any(3.0, 0.5), any(0.6, 0.2), any(0.9, 0.3)],
            funnel: [(); 2].map(|()| [any(1.5, 0.3), any(0.9, 0.2), any(1.5, 0.5)]),
            K_epsilon: [any(0.5, 0.3), any(0.5, 0.3)],
            lambda: [any(4.0, 2.0), any(4.0, 2.0)],
            limit: any(9.0, 6.0),
            r: [[any(0.0, 0.4), any(0.0, 0.4)], [any(0.0, 1.0), any(0.0, 1.0)], [any(0.0, 2.0), any(0.0, 2.0)]],
            x: DVector::from_fn(n, |_, _| any(0.0, 0.5)),
            x_m0: DVector::from_fn(2, |_, _| any(0.0, 0.2)),
            is_second,
            inside,
            by_state,
        }
    }

    fn text(&self) -> String {
        let n = self.A.nrows();
        let C = DMatrix::<f64>::identity(2, n);
        let [omega, theta, sigma] = self.bounds;
        let each = |k: usize| [self.funnel[0][k], self.funnel[1][k]];
        let own = if self.is_second {
            format!("error_weight = {:?}", self.lambda)
        } else {
            format!("x_m0 = {:?}", self.x_m0.as_slice())
        };
        format!(
            "name = 'Test'\nmodel = 'l1-ppf'\ndescription = ''\n[structure]\nA = {}\nB = {}\nC = {}\nregressor = \
             '{}'\ninput_gain = 'full'\nbaseline = '{}'\ndesired_dynamics = 'matrix'\n[start]\nA_m = {}\nfeedback_gain = \
             {}\nadaptation_gain = {:?}\nomega_min = [[0.2, -{omega:?}], [-{omega:?}, 0.2]]\nomega_max = [[{omega:?}, \
             {omega:?}], [{omega:?}, {omega:?}]]\ntheta_bound = [{theta:?}, {theta:?}]\nsigma_bound = [{sigma:?}, \
             {sigma:?}]\nrho_0 = {:?}\nrho_inf = {:?}\ndecay_rate = {:?}\nbarrier_gain = {:?}\nu_min = [-{:?}, \
             -100.0]\nu_max = [{:?}, 100.0]\nrelative_tolerance = 1e-10\n{own}",
            rows(&self.A),
            rows(&self.B),
            rows(&C),
            if self.by_state { "state" } else { "infinity_norm" },
            if self.inside { "inside" } else { "outside" },
            rows(&self.A_m),
            rows(&self.K),
            self.gamma,
            each(0),
            each(1),
            each(2),
            self.K_epsilon,
            self.limit,
            self.limit,
        )
    }

    /// Initialises a unit with these inputs.
    fn begin(&self, run: &mut Run) {
        for i in 0..2 {
            let of_order = if self.is_second { 3 } else { 1 };
            for (name, values) in ["r", "dr", "ddr"].iter().zip(self.r).take(of_order) {
                run.set(&format!("{name}[{}]", i + 1), values[i]);
            }
        }
        for (i, &x) in self.x.iter().enumerate() {
            run.set(&format!("x[{}]", i + 1), x);
        }
        run.0.initialise().unwrap();
    }

    /// −K_ε R ε, or −K_E R (R w + λ ε), of both channels, and z.
    fn barrier(&self, t: f64, x_m: &DMatrix<f64>) -> (DVector<f64>, f64) {
        let mut furthest = 0.0_f64;
        let asked = DVector::from_fn(2, |i, _| {
            let [start, end, rate] = self.funnel[i];
            let rho = (start - end) * (-rate * t).exp() + end;
            let drho = -rate * (start - end) * (-rate * t).exp();
            let e = self.x[i] - if self.is_second { self.r[0][i] } else { x_m[i] };
            let z = e / rho;
            furthest = furthest.max(z.abs());
            let (epsilon, R) = (((1.0 + z) / (1.0 - z)).ln() / 2.0, 1.0 / (rho * (1.0 - z * z)));
            let E = if self.is_second {
                R * (self.x[2 + i] - self.r[1][i] - z * drho) + self.lambda[i] * epsilon
            } else {
                epsilon
            };
            -self.K_epsilon[i] * R * E
        });
        (asked, furthest)
    }

    /// Output of a sampled barrier from t on: −K_ε R ε where ρ z + h K_ε R ε = e, by bisection.
    fn sampled_barrier(&self, t: f64, x_m: &DMatrix<f64>, h: f64) -> DVector<f64> {
        DVector::from_fn(2, |i, _| {
            let [start, end, rate] = self.funnel[i];
            let rho = (start - end) * (-rate * t).exp() + end;
            let e = self.x[i] - x_m[i];
            assert!(e.abs() < 0.99 * rho, "the error stays inside here");
            let pushes = |z: f64| self.K_epsilon[i] / (rho * (1.0 - z * z)) * ((1.0 + z) / (1.0 - z)).ln() / 2.0;
            let (mut low, mut high) = (-1.0, 1.0);
            for _ in 0..100 {
                let z = (low + high) / 2.0;
                (low, high) = if rho * z + h * pushes(z) > e { (low, z) } else { (z, high) };
            }
            -pushes(low)
        })
    }

    /// The rates of the controller, and its control; `held` is the output of a sampled barrier.
    fn rates(&self, t: f64, state: &State, sampled: Option<&DVector<f64>>) -> (State, DVector<f64>) {
        let [x_m, x_hat, omega, theta, sigma, u_ad] = &state.0;
        let n = self.A.nrows();
        let low = |matrix: &DMatrix<f64>| matrix.rows(n - 2, 2).into_owned();
        let gain = low(&self.B).try_inverse().unwrap();
        let K_m = &gain * low(&(&self.A - &self.A_m));
        let x = DMatrix::from_column_slice(n, 1, self.x.as_slice());
        let feedback = &K_m * &x;
        let asked = sampled.cloned().unwrap_or_else(|| {
            let (asked, furthest) = self.barrier(t, x_m);
            assert!(furthest < 0.99, "the error stays inside here");
            asked
        });
        let u_barrier = &gain * DMatrix::from_column_slice(2, 1, asked.as_slice());
        let wanted = u_ad - &feedback + &u_barrier;
        let u = DMatrix::from_fn(2, 1, |i, _| {
            let limit = if i == 0 { self.limit } else { 100.0 };
            wanted[i].clamp(-limit, limit)
        });
        // What the limits take is in what the estimates see, the barrier isn't.
        let v = if self.inside { &u - &u_barrier } else { u_ad + (&u - &wanted) };
        let phi = if self.by_state { x.clone() } else { DMatrix::from_element(1, 1, x.amax()) };
        let mut eta = omega * &v + theta * &phi + sigma;
        if self.inside {
            eta += &feedback;
        }
        let P = lyapunov(&self.A_m);
        let s = -(self.B.transpose() * P * (x_hat - &x));
        let project = |v: &DMatrix<f64>, y: DMatrix<f64>, bounds: &dyn Fn(usize, usize) -> [f64; 2]| {
            DMatrix::from_fn(v.nrows(), v.ncols(), |i, j| {
                let [low, high] = bounds(i, j);
                let (centre, half) = ((low + high) / 2.0, (high - low) / 2.0);
                let d = v[(i, j)] - centre;
                let f = (1.1 * d * d - half * half) / (0.1 * half * half);
                let y = y[(i, j)];
                self.gamma * if f > 0.0 && d * y > 0.0 { y * (1.0 - f) } else { y }
            })
        };
        let [bound, of_theta, of_sigma] = self.bounds;
        let r = |k: usize| DMatrix::from_column_slice(2, 1, &self.r[k]);
        let command = if self.is_second {
            // y'' = r'' where the state is on the reference.
            let desired = low(&self.A_m);
            &gain * (r(2) - desired.columns(0, 2) * r(0) - desired.columns(2, 2) * r(1))
        } else {
            let K_g = -(self.A_m.clone().try_inverse().unwrap() * &self.B).try_inverse().unwrap();
            K_g * r(0)
        };
        // What the limit leaves, followed with 1/K.
        let followed =
            DMatrix::from_fn(2, 1, |i, _| (u[i] - wanted[i]) * self.K.row(i).iter().map(|k| k.abs()).sum::<f64>());
        let dx_m = if self.is_second { DMatrix::zeros(2, 1) } else { &self.A_m * x_m + &self.B * &command };
        let rates = [
            dx_m,
            &self.A_m * x_hat + &self.B * (&eta + &u_barrier),
            project(omega, &s * v.transpose(), &|i, j| [if i == j { 0.2 } else { -bound }, bound]),
            project(theta, &s * phi.transpose(), &|_, _| [-of_theta, of_theta]),
            project(sigma, s.clone(), &|_, _| [-of_sigma, of_sigma]),
            -(&self.K * (&eta - &command)) + followed,
        ];
        (State(rates), DVector::from_column_slice(u.as_slice()))
    }

    /// The initial states of the controller.
    fn start(&self) -> State {
        let n = self.A.nrows();
        State([
            DMatrix::from_column_slice(2, 1, self.x_m0.as_slice()),
            DMatrix::from_column_slice(n, 1, self.x.as_slice()),
            DMatrix::identity(2, 2),
            DMatrix::zeros(2, if self.by_state { n } else { 1 }),
            DMatrix::zeros(2, 1),
            DMatrix::zeros(2, 1),
        ])
    }

    /// The states so much later, by steps of the classical Runge–Kutta method.
    fn later(&self, from: f64, time: f64, mut state: State, sampled: Option<&DVector<f64>>) -> State {
        let steps = (time * 13_333.0).ceil() as u32;
        let h = time / f64::from(steps);
        for k in 0..steps {
            let t = from + f64::from(k) * h;
            let one = self.rates(t, &state, sampled).0;
            let two = self.rates(t + h / 2.0, &state.moved(&one, h / 2.0), sampled).0;
            let three = self.rates(t + h / 2.0, &state.moved(&two, h / 2.0), sampled).0;
            let four = self.rates(t + h, &state.moved(&three, h), sampled).0;
            for (rate, part) in [(one, 6.0), (two, 3.0), (three, 3.0), (four, 6.0)] {
                state = state.moved(&rate, h / part);
            }
        }
        state
    }

    /// The control after a time.
    fn control_after(&self, until: f64) -> DVector<f64> {
        let state = self.later(0.0, until, self.start(), None);
        self.rates(until, &state, None).1
    }

    /// The control of the sampled law after each of so many samples, looking ahead over a number of them.
    fn controls_at_samples(&self, count: u32, period: f64, ahead: u32) -> Vec<DVector<f64>> {
        let (mut state, mut sampled) = (self.start(), DVector::zeros(2));
        let at_sample = |k: u32| {
            let t = f64::from(k) * period;
            state = self.later(t - period, period, state.clone(), Some(&sampled));
            sampled = self.sampled_barrier(t, &state.0[0], f64::from(ahead) * period);
            self.rates(t, &state, Some(&sampled)).1
        };
        (1..=count).map(at_sample).collect()
    }
}

/// P with A_mᵀ P + P A_m = −I.
fn lyapunov(A_m: &DMatrix<f64>) -> DMatrix<f64> {
    let n = A_m.nrows();
    let one = DMatrix::<f64>::identity(n, n);
    let all = one.kronecker(&A_m.transpose()) + A_m.transpose().kronecker(&one);
    let P = all.lu().solve(&DVector::from_column_slice((-one).as_slice())).unwrap();
    DMatrix::from_column_slice(n, n, P.as_slice())
}

#[test]
fn it_is_the_law_that_is_written() {
    let mut random = Random::new(41);
    let mut at_limit = 0;
    for k in 0..24 {
        let hand = Hand::random(&mut random, k);
        let mut run = run_of(&hand.text()).unwrap();
        hand.begin(&mut run);
        run.run(5, 0.06);
        let exact = hand.control_after(0.3);
        at_limit += usize::from(exact[0].abs() >= hand.limit);
        for i in 0..2 {
            let found = run.get(&format!("u[{}]", i + 1));
            assert!(
                (found - exact[i]).abs() < 1e-6 * (1.0 + exact[i].abs()),
                "{k}: u[{}] = {found}, {}",
                i + 1,
                exact[i]
            );
        }
    }
    assert!((1..24).contains(&at_limit), "limits act in some: {at_limit}");
}

/// With the sample time as the first step, and with one that a master's steps divide.
#[test]
fn sampled_it_is_the_law_that_is_written() {
    let mut random = Random::new(43);
    let (count, period) = (8, 0.03);
    for k in 0..16 {
        let (hand, ahead) = (Hand::random(&mut random, 2 * k), 1 + k as u32 % 3);
        let exact = hand.controls_at_samples(count, period, ahead);
        for (given, steps) in [("", 1), ("\nsample_time = 0.03", 3)] {
            let text = format!("{}\nlaw = 'sampled'\nprediction_steps = {ahead}{given}", hand.text());
            let mut run = run_of(&text).unwrap();
            hand.begin(&mut run);
            for (at, exact) in exact.iter().enumerate() {
                run.run(steps, period / steps as f64);
                for i in 0..2 {
                    let found = run.get(&format!("u[{}]", i + 1));
                    let is_near = (found - exact[i]).abs() < 1e-6 * (1.0 + exact[i].abs());
                    assert!(is_near, "{k}, sample {at}{given}: u[{}] = {found}, {}", i + 1, exact[i]);
                }
            }
            assert_eq!(run.get("sample_period"), period);
        }
    }
}
