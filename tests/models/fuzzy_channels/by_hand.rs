//! The controller for several channels written out, with arbitrary numbers, in a loop with a linear plant: by the
//! classical Runge–Kutta method, with switches of the gains by bisection, and the inference by integrals over its sets.
#![allow(non_snake_case)] // matrices have the names of the thesis

use common::closed::Closed;
use common::random::Random;
use nalgebra::{DMatrix, DVector};

/// Output for each pair of input sets: a row for each set of |e'|, a column for each of |e|, from very large down to
/// zero, as in the thesis.
const RULES: [[&str; 5]; 5] = [
    ["VL", "VL", "VL", "VL", "L"],
    ["VL", "VL", "VL", "L", "S"],
    ["VL", "VL", "L", "S", "VS"],
    ["VL", "L", "S", "VS", "VS"],
    ["L", "S", "VS", "VS", "Z"],
];
const NAMES: [&str; 5] = ["VL", "L", "S", "VS", "Z"];
const CENTRES: [f64; 5] = [1.0, 0.77, 0.54, 0.31, 0.08];
/// The corners VL_c, VL_l, L_l, L_c, L_h, S_l, S_c, VS_l, VS_c with their bounds.
const CORNERS: [(&str, f64, f64); 9] = [
    ("VL_c", 8.0, 12.0),
    ("VL_l", 4.0, 8.0),
    ("L_l", 1.5, 3.0),
    ("L_c", 3.0, 6.0),
    ("L_h", 6.0, 10.0),
    ("S_l", 0.3, 1.5),
    ("S_c", 1.5, 4.0),
    ("VS_l", 0.0, 0.5),
    ("VS_c", 0.5, 1.5),
];

/// Membership of a value in a set of an input, from very large down.
fn member(value: f64, set: usize) -> f64 {
    let c = CENTRES;
    let above = if set == 0 { 1.0 } else { (c[set - 1] - value) / (c[set - 1] - c[set]) };
    let below = if set == 4 { 1.0 } else { (value - c[set + 1]) / (c[set] - c[set + 1]) };
    above.min(below).clamp(0.0, 1.0)
}

/// k_f: the moment of all cut sets over their area, each by integrals between the corners of its outline.
fn inferred(a: f64, b: f64, corners: &[f64; 9]) -> f64 {
    let [VL_c, VL_l, L_l, L_c, L_h, S_l, S_c, VS_l, VS_c] = *corners;
    let triangle = |set: &str| match set {
        "Z" => (VS_l, VS_l, S_l),
        "VS" => (VS_l, VS_c, L_l),
        "S" => (S_l, S_c, VL_l),
        "L" => (L_l, L_c, L_h),
        _ => (VL_l, VL_c, VL_c),
    };
    let (mut area, mut moment) = (0.0, 0.0);
    for set in NAMES {
        let pairs = (0..25).filter(|p| RULES[p / 5][p % 5] == set);
        let height = pairs.map(|p| member(a, p % 5).min(member(b, p / 5))).fold(0.0, f64::max);
        let (low, centre, high) = triangle(set);
        let outline = [low, low + height * (centre - low), high - height * (high - centre), high];
        for (from, (to, [h0, h1])) in
            outline.iter().zip(outline[1..].iter().zip([[0.0, height], [height; 2], [height, 0.0]]))
        {
            let (width, middle) = (to - from, (from + to) / 2.0);
            area += width * (h0 + h1) / 2.0;
            // Simpson's rule is exact for a parabola.
            moment += width / 6.0 * (from * h0 + 4.0 * middle * (h0 + h1) / 2.0 + to * h1);
        }
    }
    moment / area
}

/// Outputs whose rates are known.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Degree {
    Second,
    First,
    Mixed,
}

/// A loop whose numbers are anything.
struct Hand {
    degree: Degree,
    is_inverse: bool,
    own_sets: bool,
    lag: Option<f64>,
    limit: f64,
    A: DMatrix<f64>,
    A_m: DMatrix<f64>,
    B: DMatrix<f64>,
    C: DMatrix<f64>,
    P: DMatrix<f64>,
    K_g: DMatrix<f64>,
    K: DMatrix<f64>,
    gamma: f64,
    bounds: [f64; 3],
    k_p: [f64; 2],
    k_d: [f64; 2],
    k_e: [f64; 2],
    scale: [f64; 2],
    corners: [[f64; 9]; 2],
    amplitude: [f64; 2],
    frequency: [f64; 2],
    x0: DVector<f64>,
}

/// The loop's states: x, x̂, ω̂, θ̂, σ̂, and the filter's, an integral and what lags behind it.
#[derive(Clone)]
struct State([DMatrix<f64>; 7]);

impl State {
    fn moved(&self, rate: &State, h: f64) -> State {
        State(std::array::from_fn(|k| &self.0[k] + &rate.0[k] * h))
    }
}

impl Hand {
    fn random(random: &mut Random, k: usize) -> Self {
        let mut any = |middle: f64, size: f64| middle + size * random.next();
        let degree = [Degree::Second, Degree::First, Degree::Mixed][k % 3];
        let mut matrix = |rows: usize, columns: usize, diagonal: f64, size: f64| {
            DMatrix::from_fn(rows, columns, |i, j| any(if i == j { diagonal } else { 0.0 }, size))
        };
        let (gain, stiff, damped) = (matrix(2, 2, 1.0, 0.3), matrix(2, 2, -25.0, 3.0), matrix(2, 2, -9.0, 1.0));
        let (first, K) = (matrix(2, 2, -6.0, 1.0), matrix(2, 2, 12.0, 4.0));
        // Rows of the state that the control reaches; the others are of chains.
        let (n, reached) = match degree {
            Degree::Second => (4, [2, 3]),
            Degree::First => (2, [0, 1]),
            Degree::Mixed => (3, [1, 2]),
        };
        let mut A_m = DMatrix::zeros(n, n);
        match degree {
            Degree::Second => {
                A_m.view_mut((0, 2), (2, 2)).fill_with_identity();
                A_m.view_mut((2, 0), (2, 2)).copy_from(&stiff);
                A_m.view_mut((2, 2), (2, 2)).copy_from(&damped);
            }
            Degree::First => A_m.copy_from(&first),
            Degree::Mixed => {
                A_m[(0, 1)] = 1.0;
                (A_m[(1, 0)], A_m[(1, 1)], A_m[(1, 2)]) = (stiff[(0, 0)], damped[(0, 0)], damped[(0, 1)]);
                (A_m[(2, 0)], A_m[(2, 1)], A_m[(2, 2)]) = (first[(1, 0)], damped[(1, 0)], first[(1, 1)]);
            }
        }
        let (mut A, mut B, mut C) = (A_m.clone(), DMatrix::zeros(n, 2), DMatrix::zeros(2, n));
        for (i, &row) in reached.iter().enumerate() {
            B.row_mut(row).copy_from(&gain.row(i));
            A.row_mut(row).iter_mut().for_each(|entry| *entry += any(0.0, 1.5));
        }
        C[(0, 0)] = 1.0;
        C[(1, if degree == Degree::Mixed { 2 } else { 1 })] = 1.0;
        let K_g = -(&C * A_m.clone().try_inverse().unwrap() * &B).try_inverse().unwrap();
        let corner = |any: &mut dyn FnMut(f64, f64) -> f64| {
            let mut corners = CORNERS.map(|(_, low, high)| any((low + high) / 2.0, (high - low) / 2.0));
            corners[7] = corners[7].min(corners[5] - 0.01);
            corners
        };
        let sets = [corner(&mut any), corner(&mut any)];
        let (own_sets, known) =
            (k.is_multiple_of(2), |i: usize| degree == Degree::Second || (degree == Degree::Mixed && i == 0));
        Hand {
            degree,
            own_sets,
            is_inverse: k % 4 > 1,
            lag: (k % 5 > 2).then(|| any(0.05, 0.02)),
            limit: if k % 5 == 1 { any(4.0, 1.0) } else { 1000.0 },
            P: lyapunov(&A_m),
            gamma: any(600.0, 300.0),
            bounds: [any(3.0, 0.5), any(1.5, 0.5), any(3.0, 1.0)],
            k_p: [any(0.9, 0.5), any(0.9, 0.5)],
            k_d: [0, 1].map(|i| if known(i) { any(0.3, 0.2) } else { 0.0 }),
            k_e: [any(0.2, 0.1), any(0.2, 0.1)],
            scale: [any(1.2, 0.7), any(1.2, 0.7)],
            corners: if own_sets { sets } else { [sets[0]; 2] },
            amplitude: [any(0.0, 1.0), any(0.0, 1.0)],
            frequency: [any(5.0, 2.0), any(5.0, 2.0)],
            x0: DVector::from_fn(n, |_, _| any(0.0, 0.4)),
            A,
            A_m,
            B,
            C,
            K_g,
            K,
        }
    }

    fn controller(&self) -> String {
        let [omega, theta, sigma] = self.bounds;
        let with_rates = if self.degree == Degree::First { String::new() } else { format!("k_d = {:?}\n", self.k_d) };
        let corners: String = CORNERS
            .iter()
            .enumerate()
            .map(|(k, (name, ..))| {
                let [first, second] = [self.corners[0][k], self.corners[1][k]];
                if self.own_sets {
                    format!("{name} = {:?}\n", [first, second])
                } else {
                    format!("{name} = {first:?}\n")
                }
            })
            .collect();
        format!(
            "model = 'fuzzy-l1'\n[structure]\nA = {}\nB = {}\nC = {}\nregressor = 'infinity_norm'\ninput_gain = \
             'full'\nfuzzy_weights = 'own'\nfuzzy_sets = '{}'\n{}[start]\nfeedback_gain = {}\nadaptation_gain = \
             {:?}\nomega_min = [[0.2, -{omega:?}], [-{omega:?}, 0.2]]\nomega_max = [[{omega:?}, {omega:?}], [{omega:?}, \
             {omega:?}]]\ntheta_bound = [{theta:?}, {theta:?}]\nsigma_bound = [{sigma:?}, {sigma:?}]\nu_min = [-{:?}, \
             -1000.0]\nu_max = [{:?}, 1000.0]\nfuzzy_output = '{}'\nk_p = {:?}\n{with_rates}k_e = {:?}\nfuzzy_scale = \
             {:?}\n{corners}",
            rows(&self.A_m),
            rows(&self.B),
            rows(&self.C),
            if self.own_sets { "own" } else { "shared" },
            self.lag
                .map_or(String::new(), |lag| format!("filter = {{ denominator = [[1.0, 0.0], [{lag:?}, 1.0]] }}\n")),
            rows(&self.K),
            self.gamma,
            self.limit,
            self.limit,
            if self.is_inverse { "inverse_gain" } else { "gain" },
            self.k_p,
            self.k_e,
            self.scale,
        )
    }

    fn unit(&self) -> common::models::Run {
        let structure =
            |C: &DMatrix<f64>| format!("[structure]\nA = {}\nB = {}\nC = {}\n", rows(&self.A), rows(&self.B), rows(C));
        let (n, all) = (self.A.nrows(), DMatrix::identity(self.A.nrows(), self.A.nrows()));
        let plant = format!("model = 'state-space'\n{}[start]\nx0 = {:?}", structure(&all), self.x0.as_slice());
        let reference = format!(
            "model = 'reference'\n[structure]\nchannels = 2\n[start]\ncosine_amplitude = {:?}\ncosine_frequency = {:?}",
            self.amplitude, self.frequency
        );
        let mut closed = Closed::new().described("reference", &reference, "").described("plant", &plant, "");
        closed = closed.described("controller", &self.controller(), "").connected("reference.r", "controller.r", 2);
        if self.degree != Degree::First {
            closed = closed.connected("reference.dr", "controller.dr", 2);
        }
        closed.connected("plant.y", "controller.x", n).connected("controller.u", "plant.u", 2).started(1e-10)
    }

    fn reference(&self, t: f64) -> [DMatrix<f64>; 2] {
        let of = |f: &dyn Fn(f64, f64) -> f64| DMatrix::from_fn(2, 1, |i, _| f(self.amplitude[i], self.frequency[i]));
        [of(&|a, w| a * (w * t).cos()), of(&|a, w| -a * w * (w * t).sin())]
    }

    fn errors(&self, t: f64, state: &State) -> [f64; 2] {
        let e = &self.reference(t)[0] - &self.C * &state.0[0];
        [e[0], e[1]]
    }

    /// K with the gains of the channels that are fuzzy.
    fn gain(&self, t: f64, state: &State, fuzzy: [bool; 2]) -> DMatrix<f64> {
        let (e, dr) = (self.errors(t, state), &self.reference(t)[1]);
        let mut K = self.K.clone();
        for i in (0..2).filter(|&i| fuzzy[i]) {
            // y' is a state where it is known.
            let rate = match (self.degree, i) {
                (Degree::Second, i) => dr[i] - state.0[0][2 + i],
                (Degree::Mixed, 0) => dr[0] - state.0[0][1],
                _ => 0.0,
            };
            let k_f = inferred(self.k_p[i] * e[i].abs(), self.k_d[i] * rate.abs(), &self.corners[i]).max(1e-3);
            let k = if self.is_inverse { self.scale[i] / k_f } else { self.scale[i] * k_f };
            let ratio = k / self.K[(i, i)];
            K.row_mut(i).iter_mut().for_each(|entry| *entry *= ratio);
        }
        K
    }

    /// The rates of the loop, and its control.
    fn rates(&self, t: f64, state: &State, fuzzy: [bool; 2]) -> (State, DMatrix<f64>) {
        let [x, x_hat, omega, theta, sigma, integral, lagged] = &state.0;
        let u_ad = if self.lag.is_some() { lagged } else { integral };
        let u = DMatrix::from_fn(2, 1, |i, _| if i == 0 { u_ad[0].clamp(-self.limit, self.limit) } else { u_ad[1] });
        let eta = omega * &u + theta * x.amax() + sigma;
        let s = -(self.B.transpose() * &self.P * (x_hat - x));
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
        let K = self.gain(t, state, fuzzy);
        let excess = &eta - &self.K_g * &self.reference(t)[0];
        // What the limit leaves, followed with the time 1/K of the row in force.
        let followed = DMatrix::from_fn(2, 1, |i, _| (u[i] - u_ad[i]) * K.row(i).iter().map(|k| k.abs()).sum::<f64>());
        let lag = self.lag.map_or(DMatrix::zeros(2, 1), |lag| (integral - lagged) / lag + &followed);
        let rates = [
            &self.A * x + &self.B * &u,
            &self.A_m * x_hat + &self.B * &eta,
            project(omega, &s * u.transpose(), &|i, j| [if i == j { 0.2 } else { -bound }, bound]),
            project(theta, &s * x.amax(), &|_, _| [-of_theta, of_theta]),
            project(sigma, s.clone(), &|_, _| [-of_sigma, of_sigma]),
            -(K * excess) + &followed,
            lag,
        ];
        (State(rates), u)
    }

    fn step(&self, t: f64, state: &State, h: f64, fuzzy: [bool; 2]) -> State {
        let one = self.rates(t, state, fuzzy).0;
        let two = self.rates(t + h / 2.0, &state.moved(&one, h / 2.0), fuzzy).0;
        let three = self.rates(t + h / 2.0, &state.moved(&two, h / 2.0), fuzzy).0;
        let four = self.rates(t + h, &state.moved(&three, h), fuzzy).0;
        let parts = [(one, 6.0), (two, 3.0), (three, 3.0), (four, 6.0)];
        parts.iter().fold(state.clone(), |state, (rate, part)| state.moved(rate, h / part))
    }

    fn is_fuzzy(&self, t: f64, state: &State) -> [bool; 2] {
        let e = self.errors(t, state);
        [0, 1].map(|i| e[i].abs() > self.k_e[i])
    }

    /// Goes on by a time, switch by switch. How many there were.
    fn go_on(&self, t: &mut f64, state: &mut State, duration: f64, fuzzy: &mut [bool; 2]) -> usize {
        const STEPS: u32 = 1600;
        let (mut switches, from) = (0, *t);
        for k in 1..=STEPS {
            let end = from + duration * f64::from(k) / f64::from(STEPS);
            loop {
                let arrived = self.step(*t, state, end - *t, *fuzzy);
                if self.is_fuzzy(end, &arrived) == *fuzzy {
                    (*t, *state) = (end, arrived);
                    break;
                }
                let (mut low, mut high) = (0.0, end - *t);
                for _ in 0..60 {
                    let middle = (low + high) / 2.0;
                    let same = self.is_fuzzy(*t + middle, &self.step(*t, state, middle, *fuzzy)) == *fuzzy;
                    (low, high) = if same { (middle, high) } else { (low, middle) };
                }
                *state = self.step(*t, state, high, *fuzzy);
                *t += high;
                *fuzzy = self.is_fuzzy(*t, state);
                switches += 1;
            }
        }
        switches
    }

    fn start(&self) -> State {
        let x = DMatrix::from_column_slice(self.x0.len(), 1, self.x0.as_slice());
        let zero = DMatrix::zeros(2, 1);
        State([x.clone(), x, DMatrix::identity(2, 2), zero.clone(), zero.clone(), zero.clone(), zero])
    }
}

fn rows(matrix: &DMatrix<f64>) -> String {
    let row = |i: usize| format!("{:?}", matrix.row(i).iter().collect::<Vec<_>>());
    format!("[{}]", (0..matrix.nrows()).map(row).collect::<Vec<_>>().join(", "))
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
    let mut random = Random::new(109);
    let (mut switches, mut at_limit) = (0, 0);
    for k in 0..24 {
        let hand = Hand::random(&mut random, k);
        let mut run = hand.unit();
        let (mut t, mut state) = (0.0, hand.start());
        let mut fuzzy = hand.is_fuzzy(t, &state);
        for point in 1..=6 {
            run.run(2, 0.05);
            switches += hand.go_on(&mut t, &mut state, 0.1, &mut fuzzy);
            let (u, K) = (hand.rates(t, &state, fuzzy).1, hand.gain(t, &state, fuzzy));
            at_limit += usize::from(u[0].abs() == hand.limit);
            // Where the slope of a set changes within a step by hand, that costs up to 4e-6.
            let near = |name: String, exact: f64| {
                let found = run.get(&name);
                let what = format!("{k}, {:?}, point {point}: {name} = {found}, {exact} by hand", hand.degree);
                assert!((found - exact).abs() <= 1e-5 * (1.0 + exact.abs()), "{what}");
            };
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                near(format!("controller.gain_in_force[{},{}]", i + 1, j + 1), K[(i, j)]);
            }
            (0..2).for_each(|i| near(format!("controller.u[{}]", i + 1), u[i]));
            (0..hand.x0.len()).for_each(|i| near(format!("plant.x[{}]", i + 1), state.0[0][i]));
        }
    }
    println!("{switches} switches, {at_limit} at a limit");
    assert!(switches > 60 && at_limit > 2, "gains switch, {switches}, and limits act, {at_limit}");
}
