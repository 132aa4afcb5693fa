//! L1 with prescribed performance: against its equations written out, on the loops of the thesis, and what becomes of an error
//! that leaves its funnel.
#![allow(non_snake_case)] // matrices have the names of the field

use adaptive_fmu::error::Invalid;
use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::closed::{Closed, near};
use common::description;
use common::models::Run;
use common::random::Random;
use nalgebra::{DMatrix, DVector};
use toml::Table;

fn run_of(text: &str) -> Result<Run, Invalid> {
    Ok(Run(Execution::new(Model::from_description(Description::read(text)?, REGISTRY)?)))
}

/// A unit of this package with further start values, before its initialisation.
fn unit(name: &str, start: &str) -> Run {
    let mut table: Table = description(name).parse().unwrap();
    let all = table.entry("start").or_insert_with(|| Table::new().into()).as_table_mut().unwrap();
    all.extend(start.parse::<Table>().unwrap());
    run_of(&table.to_string()).unwrap()
}

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

/// The states of the law by hand: x_m, x̂, ω̂, θ̂, σ̂, u_ad.
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
            format!("lambda = {:?}", self.lambda)
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

    /// The rates of the law, and its control.
    fn rates(&self, t: f64, state: &State) -> (State, DVector<f64>) {
        let [x_m, x_hat, omega, theta, sigma, u_ad] = &state.0;
        let n = self.A.nrows();
        let low = |matrix: &DMatrix<f64>| matrix.rows(n - 2, 2).into_owned();
        let gain = low(&self.B).try_inverse().unwrap();
        let K_m = &gain * low(&(&self.A - &self.A_m));
        let x = DMatrix::from_column_slice(n, 1, self.x.as_slice());
        let feedback = &K_m * &x;
        let (asked, furthest) = self.barrier(t, x_m);
        assert!(furthest < 0.99, "the error stays inside here");
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

    /// The control after a time, by the classical Runge–Kutta method.
    fn control_after(&self, until: f64) -> DVector<f64> {
        let n = self.A.nrows();
        let columns = if self.by_state { n } else { 1 };
        let mut state = State([
            DMatrix::from_column_slice(2, 1, self.x_m0.as_slice()),
            DMatrix::from_column_slice(n, 1, self.x.as_slice()),
            DMatrix::identity(2, 2),
            DMatrix::zeros(2, columns),
            DMatrix::zeros(2, 1),
            DMatrix::zeros(2, 1),
        ]);
        let steps = 4000;
        let h = until / f64::from(steps);
        for k in 0..steps {
            let t = f64::from(k) * h;
            let one = self.rates(t, &state).0;
            let two = self.rates(t + h / 2.0, &state.moved(&one, h / 2.0)).0;
            let three = self.rates(t + h / 2.0, &state.moved(&two, h / 2.0)).0;
            let four = self.rates(t + h, &state.moved(&three, h)).0;
            for (rate, part) in [(one, 6.0), (two, 3.0), (three, 3.0), (four, 6.0)] {
                state = state.moved(&rate, h / part);
            }
        }
        self.rates(until, &state).1
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
        for i in 0..2 {
            let of_order = if hand.is_second { 3 } else { 1 };
            for (name, values) in ["r", "dr", "ddr"].iter().zip(hand.r).take(of_order) {
                run.set(&format!("{name}[{}]", i + 1), values[i]);
            }
        }
        for (i, &x) in hand.x.iter().enumerate() {
            run.set(&format!("x[{}]", i + 1), x);
        }
        run.0.initialise().unwrap();
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

/// What a loop of separate or joint units comes to: largest |e|/ρ, rms of e from 5 s on, largest |u|, channel by channel.
#[derive(Default)]
struct Found {
    part: Vec<f64>,
    late_part: Vec<f64>,
    rms: Vec<f64>,
    max: Vec<f64>,
    count: f64,
}

impl Found {
    fn new(m: usize) -> Self {
        let none = vec![0.0; m];
        Found { part: none.clone(), late_part: none.clone(), rms: none.clone(), max: none, count: 0.0 }
    }

    fn note(&mut self, t: f64, get: impl Fn(String) -> f64) {
        let is_late = t >= 5.0 - 1e-9;
        self.count += f64::from(u8::from(is_late));
        for i in 0..self.part.len() {
            let [e, rho, u] = ["e", "rho", "u"].map(|name| get(format!("{name}[{}]", i + 1)));
            self.part[i] = self.part[i].max((e / rho).abs());
            self.max[i] = self.max[i].max(u.abs());
            if is_late {
                self.rms[i] += e * e;
                self.late_part[i] = self.late_part[i].max((e / rho).abs());
            }
        }
    }

    fn done(mut self) -> Self {
        self.rms.iter_mut().for_each(|rms| *rms = (*rms / self.count).sqrt());
        println!("part {:?} late {:?} rms {:?} max {:?}", self.part, self.late_part, self.rms, self.max);
        self
    }
}

/// A loop as one unit, for 10 s.
fn whole([reference, plant, controller]: [&str; 3], [of_plant, of_controller]: [&str; 2], [m, n]: [usize; 2]) -> Found {
    let closed = Closed::new().part("reference", reference, "").part("plant", plant, of_plant);
    let mut closed = closed.part("controller", controller, of_controller).connected("reference.r", "controller.r", m);
    if n > m {
        closed = closed.connected("reference.dr", "controller.dr", m).connected("reference.ddr", "controller.ddr", m);
    }
    let closed = closed.connected("plant.x", "controller.x", n).connected("controller.u", "plant.u", m);
    let mut run = closed.started(1e-8);
    let mut found = Found::new(m);
    for k in 0..=10_000 {
        if k > 0 {
            run.step(1e-3);
        }
        found.note(f64::from(k) * 1e-3, |name| run.get(&format!("controller.{name}")));
    }
    found.done()
}

/// Asserts that numbers are those known, each within a part of itself.
#[track_caller]
fn all_near(what: &str, found: &[f64], known: &[f64], part: f64) {
    assert_eq!(found.len(), known.len());
    found.iter().zip(known).for_each(|(&found, &known)| near(what, found, known, part));
}

const COUPLED: [&str; 3] = ["ReferenceCoupledMimo", "CoupledMimo", "L1PpfCoupledMimo"];
const FIRST: &str = "x0 = [0.6, -0.8, 0.4]";
const SECOND: &str = "x0 = [0.6, -0.8, 0.4]\nnonaffine = true";
const BUMPLESS: &str = "u_ad_start = 'bumpless'";
/// How far the figures may be from those of the reference simulation, whose digits are four.
const DIGITS: f64 = 1e-3;

#[test]
fn the_system_of_example_6_5_1_stays_in_its_funnel() {
    for (start, part, max) in [
        ("", [0.3171, 0.4127, 0.2509], [19.06, 64.43, 22.01]),
        (BUMPLESS, [0.3178, 0.6451, 0.2509], [35.61, 34.98, 10.36]),
    ] {
        let found = whole(COUPLED, [FIRST, start], [3, 3]);
        all_near("e/rho", &found.part, &part, DIGITS);
        all_near("rms e", &found.rms, &[0.01080, 0.01103, 0.008724], DIGITS);
        all_near("max u", &found.max, &max, DIGITS);
    }
}

#[test]
fn the_system_that_the_control_enters_nonlinearly_stays_in_its_funnel() {
    for (start, part, rms_2, max) in [
        ("", [0.5667, 0.5644, 0.2600], 0.01206, [13.16, 92.25, 22.00]),
        (BUMPLESS, [0.5667, 0.5719, 0.2512], 0.01208, [21.84, 58.08, 9.967]),
    ] {
        let found = whole(COUPLED, [SECOND, start], [3, 3]);
        all_near("e/rho", &found.part, &part, DIGITS);
        all_near("rms e", &found.rms, &[0.01130, rms_2, 0.008727], DIGITS);
        all_near("max u", &found.max, &max, DIGITS);
    }
}

#[test]
fn without_the_barrier_the_error_leaves() {
    let closed = Closed::new().part("reference", COUPLED[0], "").part("plant", COUPLED[1], SECOND);
    let closed = closed.part("controller", COUPLED[2], "barrier_gain = [0.0, 0.0, 0.0]");
    let closed = closed.connected("reference.r", "controller.r", 3).connected("plant.x", "controller.x", 3);
    let mut run = closed.connected("controller.u", "plant.u", 3).started(1e-8);
    let failure = (0..10_000).find_map(|_| run.0.step(run.0.time(), 1e-3).err()).expect("the plain law leaves");
    assert!(failure.to_string().contains("has left its funnel"), "{failure}");
}

#[test]
fn the_robot_stays_in_its_funnel() {
    let found = whole(["ReferenceTwoLinkRobot", "TwoLinkRobot", "L1PpfTwoLinkRobot"], ["", ""], [2, 4]);
    all_near("e/rho", &found.part, &[0.4618, 0.5509], DIGITS);
    all_near("e/rho from 5 s on", &found.late_part, &[0.3573, 0.4399], DIGITS);
    all_near("rms e", &found.rms, &[0.001329, 0.001624], DIGITS);
    all_near("max u", &found.max, &[113.2, 89.51], DIGITS);
}

/// A loop of separate units, for 10 s; nothing where it leaves its funnel.
fn split(of_plant: &str, is_jacobi: bool, step: f64) -> Option<Found> {
    let [mut reference, mut plant, mut controller] =
        [unit(COUPLED[0], ""), unit(COUPLED[1], of_plant), unit(COUPLED[2], "")];
    let hand_on = |from: &Run, [of, to]: [&str; 2], unit: &mut Run| {
        (1..=3).for_each(|i| unit.set(&format!("{to}[{i}]"), from.get(&format!("{of}[{i}]"))));
    };
    reference.0.initialise().unwrap();
    plant.0.initialise().unwrap();
    hand_on(&reference, ["r", "r"], &mut controller);
    hand_on(&plant, ["x", "x"], &mut controller);
    controller.0.initialise().unwrap();
    let mut found = Found::new(3);
    for k in 1..=(10.0 / step).round() as usize {
        hand_on(&controller, ["u", "u"], &mut plant);
        if is_jacobi {
            hand_on(&reference, ["r", "r"], &mut controller);
            hand_on(&plant, ["x", "x"], &mut controller);
        }
        reference.step(step);
        plant.step(step);
        if !is_jacobi {
            hand_on(&reference, ["r", "r"], &mut controller);
            hand_on(&plant, ["x", "x"], &mut controller);
        }
        controller.0.step(controller.0.time(), step).ok()?;
        // The error as it is, not as it was handed on.
        found.note(k as f64 * step, |name| match name.strip_prefix('e') {
            Some(i) => plant.get(&format!("x{i}")) - controller.get(&format!("x_m{i}")),
            None => controller.get(&name),
        });
    }
    Some(found.done())
}

#[test]
fn units_of_their_own_stay_in_their_funnels() {
    for (plant, is_jacobi, step) in [
        (FIRST, false, 1e-3),
        (FIRST, true, 1e-3),
        (SECOND, false, 1e-3),
        (SECOND, true, 1e-3),
        (FIRST, false, 5e-3),
        (FIRST, true, 5e-3),
        (SECOND, false, 5e-3),
        (SECOND, true, 5e-3),
    ] {
        println!("{plant} jacobi {is_jacobi} {step}: {}", split(plant, is_jacobi, step).is_some());
    }
}

#[test]
fn an_error_that_leaves_its_funnel_is_told_with_its_channel_and_the_time() {
    let mut run = unit(COUPLED[2], "");
    run.0.initialise().unwrap();
    run.step(0.5);
    let before = run.get("u[2]");
    run.set("x[2]", 1.5);
    let reason = run.failure(0.5).to_string();
    for told in ["e[2] = 1.5", "has left its funnel", "rho[2]", "on_funnel_exit"] {
        assert!(reason.contains(told), "{told}: {reason}");
    }
    assert_eq!((run.0.time(), run.get("u[2]")), (0.5, before), "as before the step");
    let mut run = unit(COUPLED[2], "on_funnel_exit = 'reopen'");
    run.0.initialise().unwrap();
    run.step(0.5);
    run.set("x[2]", 1.5);
    run.step(1e-3);
    assert_eq!(run.integer("funnel_reopened"), 1);
    assert!((run.get("rho[2]") - 1.25 * 1.5).abs() < 0.01, "{}", run.get("rho[2]"));
}

#[test]
fn a_start_outside_is_refused_and_says_which_bound_would_do() {
    let mut run = unit("L1PpfTwoLinkRobot", "");
    run.set("r[1]", 3.5);
    run.0.initialise().unwrap();
    let reason = run.failure(0.001).to_string();
    assert!(reason.contains("e[1] = -3.5") && reason.contains("rho_0[1] above 3.5 would do"), "{reason}");
}

#[test]
fn taking_over_makes_no_jump_and_opens_the_funnel_anew() {
    for (name, n) in [("L1PpfCoupledMimo", 3), ("L1PpfTwoLinkRobot", 4)] {
        let mut run = unit(name, "");
        run.set_boolean("enabled", false);
        run.set("u_manual[1]", 4.0);
        run.set("x[1]", 9.0);
        run.0.initialise().unwrap();
        run.run(50, 0.1);
        assert_eq!(run.get("u[1]"), 4.0, "{name}: by hand an error may be anywhere");
        (1..=n).for_each(|i| run.set(&format!("x[{i}]"), 0.3));
        run.set_boolean("enabled", true);
        run.step(1e-9);
        assert!((run.get("u[1]") - 4.0).abs() < 1e-4, "{name}: {}", run.get("u[1]"));
        let rho_0 = run.get("rho_0[1]");
        assert!((run.get("rho[1]") - rho_0).abs() < 1e-6, "{name}");
    }
}

#[test]
fn a_bumpless_start_is_at_the_manual_control_whatever_the_barrier_adds() {
    let mut run = unit("L1PpfCoupledMimo", &format!("{BUMPLESS}\nx_m0 = [-0.5, 0.5, 0.5]"));
    for i in 1..=3 {
        run.set(&format!("x[{i}]"), 0.4 * f64::from(i));
        run.set(&format!("u_manual[{i}]"), f64::from(i));
    }
    run.0.initialise().unwrap();
    for i in 1..=3 {
        assert!((run.get(&format!("u[{i}]")) - f64::from(i)).abs() < 1e-12);
        assert!(run.get(&format!("u_barrier[{i}]")).abs() > 1e-3, "the barrier acts");
    }
}

#[test]
fn a_control_at_its_limit_ends_the_guarantee_and_is_told() {
    let mut run = unit("L1PpfCoupledMimo", "u_max = [0.5, 0.5, 0.5]");
    run.0.initialise().unwrap();
    run.step(0.001);
    assert_eq!(run.0.take_messages().count(), 0);
    run.set("x[1]", -0.5);
    run.step(0.001);
    assert_eq!(run.get("u[1]"), 0.5);
    assert!(run.0.take_messages().any(|message| message.text.contains("isn't guaranteed")));
}

#[test]
fn a_step_that_is_too_long_for_the_barrier_is_told() {
    let mut run = unit("L1PpfCoupledMimo", "rho_inf = [0.001, 0.05, 0.05]\ndecay_rate = [1e3, 1.5, 1.5]");
    run.0.initialise().unwrap();
    run.run(20, 0.001);
    assert!(run.get("barrier_stiffness") > 9e4, "K/rho²: {}", run.get("barrier_stiffness"));
    assert_eq!(run.integer("step_too_long"), 1);
    assert!(run.0.take_messages().any(|message| message.text.contains("too long for the barrier")));
}

#[test]
fn structures_that_are_none_are_refused() {
    let text = description("L1PpfTwoLinkRobot");
    for (from, to, named) in [
        ("baseline = \"inside\"\n", "", "where a control shows after two derivatives"),
        ("baseline = \"inside\"\n", "baseline = \"inside\"\nunmatched = true\n", "unmatched: this law cancels matched"),
        ("[1.0, 0.0], [0.0, 1.0]]", "[1.0, 0.0], [1.0, 0.0]]", "C A B: least singular value"),
        ("B = [[0.0, 0.0]", "B = [[1.0, 0.0]", "C B: largest entry"),
    ] {
        assert!(text.contains(from), "{from}");
        let reason = run_of(&text.replacen(from, to, 1)).map(drop).unwrap_err().to_string();
        assert!(reason.contains(named), "{reason}");
    }
}
