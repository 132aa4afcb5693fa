//! Behaviour of PID controllers.
#![allow(non_snake_case)] // gains have the names of the field

mod design;

use nalgebra::{DMatrix, DVector};

use adaptive_fmu::controllers::pid::Pid;
use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::System;
use adaptive_fmu::template::{list, rows};

/// A generator of numbers in [−1, 1], the same in each run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// A unit, or a loop as one.
struct Run(Execution);

fn made(text: &str) -> Result<Execution, String> {
    let model = Model::from_description(Description::read(text).unwrap(), REGISTRY);
    model.map(Execution::new).map_err(|invalid| invalid.to_string())
}

fn head(model: &str) -> String {
    format!("name = 'Test'\nmodel = '{model}'\ndescription = ''\n")
}

fn alone(channels: usize, start: &str) -> String {
    format!("{}[structure]\nchannels = {channels}\n[start]\nrelative_tolerance = 1e-10\n{start}\n", head(Pid::NAME))
}

/// A linear plant with the controller, the reference free.
fn closed(A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>, start: &str) -> Run {
    let m = B.ncols();
    let connections =
        (1..=m).map(|i| format!("['plant.y[{i}]', 'pid.y[{i}]'], ['pid.u[{i}]', 'plant.u[{i}]']")).collect::<Vec<_>>();
    let [A, B, C] = [A, B, C].map(|matrix| rows(matrix).replace(['\n', ' '], ""));
    Run::of(&format!(
        "{}[structure]\nconnections = [{}]\n[[structure.parts]]\nname = 'plant'\nmodel = 'state-space'\nstructure = {{ A = \
         {A}, B = {B}, C = {C} }}\n[[structure.parts]]\nname = 'pid'\nmodel = 'pid'\nstructure = {{ channels = {m} }}\n\
         [structure.parts.start]\n{start}\n[start]\nrelative_tolerance = 1e-10\n",
        head("composite"),
        connections.join(", ")
    ))
}

impl Run {
    fn of(text: &str) -> Self {
        Run(made(text).unwrap_or_else(|reason| panic!("{reason}: {text}")))
    }

    fn place(&self, name: &str) -> usize {
        let variables = self.0.model().variables();
        variables.index(variables.find(name).unwrap_or_else(|| panic!("there is no {name}")))
    }

    fn get(&self, name: &str) -> f64 {
        self.0.block().reals[self.place(name)]
    }

    fn set(&mut self, name: &str, value: f64) -> &mut Self {
        let place = self.place(name);
        self.0.set_real(place, value);
        self
    }

    fn enable(&mut self, enabled: bool) -> &mut Self {
        let place = self.place("enabled");
        self.0.set_integer(place, i32::from(enabled));
        self
    }

    fn start(&mut self) -> &mut Self {
        self.0.initialise().unwrap();
        self
    }

    fn step(&mut self, step: f64) -> &mut Self {
        self.0.step(self.0.time(), step).unwrap();
        self
    }
}

/// The lines of `[start]`.
fn start_of(description: &toml::Table) -> String {
    description["start"].as_table().unwrap().to_string()
}

fn matrix(random: &mut Random, n: usize, m: usize) -> DMatrix<f64> {
    DMatrix::from_fn(n, m, |_, _| random.next())
}

/// Far from singular.
fn regular(random: &mut Random, m: usize) -> DMatrix<f64> {
    DMatrix::identity(m, m) * 2.0 + matrix(random, m, m)
}

#[test]
fn a_step_without_limits_is_answered_as_the_linear_loop_does() {
    let mut random = Random(5);
    for (n, m) in [(2, 1), (3, 1), (3, 2), (5, 3)] {
        let (A, B, C) = (matrix(&mut random, n, n), matrix(&mut random, n, m), matrix(&mut random, m, n));
        let mut positive = |most: f64| DVector::from_fn(m, |_, _| most * random.next().abs());
        let [K_p, K_i, K_d, b, c, r] = [4.0, 6.0, 0.5, 1.0, 1.0, 1.0].map(&mut positive);
        let N = positive(20.0).add_scalar(5.0);
        let S = regular(&mut random, m);
        let parts = [("K_p", &K_p), ("K_i", &K_i), ("K_d", &K_d), ("b", &b), ("c", &c), ("N", &N)];
        let start = parts.map(|(name, values)| format!("{name} = {}\n", list(values.as_slice()))).concat();
        let mut run = closed(&A, &B, &C, &format!("{start}S = {}", rows(&S)));
        for (i, &r) in r.iter().enumerate() {
            run.set(&format!("pid.r[{}]", i + 1), r);
        }
        run.start();
        // (x, I, w, 1)' = M (x, I, w, 1), and v = F (x, I, w, 1).
        let size = n + 2 * m + 1;
        let (mut M, mut F) = (DMatrix::zeros(size, size), DMatrix::zeros(m, size));
        M.view_mut((0, 0), (n, n)).copy_from(&A);
        for i in 0..m {
            F.view_mut((i, 0), (1, n)).copy_from(&(C.row(i) * -(K_p[i] + K_d[i] * N[i])));
            F[(i, n + i)] = 1.0;
            F[(i, n + m + i)] = -K_d[i] * N[i];
            F[(i, size - 1)] = (K_p[i] * b[i] + K_d[i] * N[i] * c[i]) * r[i];
            M.view_mut((n + i, 0), (1, n)).copy_from(&(C.row(i) * -K_i[i]));
            M[(n + i, size - 1)] = K_i[i] * r[i];
            M.view_mut((n + m + i, 0), (1, n)).copy_from(&(C.row(i) * -N[i]));
            M[(n + m + i, n + m + i)] = -N[i];
            M[(n + m + i, size - 1)] = N[i] * c[i] * r[i];
        }
        let of_controls = &B * &S * &F;
        let mut states = M.view_mut((0, 0), (n, size));
        states += of_controls;
        let mut begun = DVector::zeros(size);
        begun.rows_mut(n + m, m).copy_from(&c.component_mul(&r));
        begun[size - 1] = 1.0;
        for k in 1..=10 {
            run.step(0.1);
            let now = (&M * (0.1 * f64::from(k))).exp() * &begun;
            let (y, u) = (&C * now.rows(0, n), &S * &F * &now);
            for (name, exact) in [("plant.y", y), ("pid.u", u)] {
                for (i, exact) in exact.iter().enumerate() {
                    let found = run.get(&format!("{name}[{}]", i + 1));
                    assert!((found - exact).abs() <= 1e-7 * (1.0 + exact.abs()), "{n} {m} {name}: {found}, {exact}");
                }
            }
        }
    }
}

#[test]
fn at_a_limit_the_integral_goes_to_where_back_calculation_has_it() {
    // K_p e is beyond the limit by 3, and K_i e T_t = 2 · 5 · 0.5 is added at rest.
    let mut run = Run::of(&alone(1, "K_p = [1.0]\nK_i = [2.0]\ntracking_time = [0.5]\nu_max = [2.0]"));
    run.set("r[1]", 5.0).start();
    for k in 1..=20 {
        run.step(0.1);
        let gone = -(-0.1 * f64::from(k) / 0.5_f64).exp_m1();
        assert!((run.get("I[1]") - 2.0 * gone).abs() < 1e-8 && run.get("u[1]") == 2.0, "{}", run.get("I[1]"));
    }
    let mut off = Run::of(&alone(1, "K_p = [1.0]\nK_i = [2.0]\ntracking_time = [0.0]\nu_max = [2.0]"));
    off.set("r[1]", 5.0).start().step(2.0);
    assert!((off.get("I[1]") - 20.0).abs() < 1e-8);
}

/// With all controls at a limit, S⁻¹ (u − S v) = −K_i e T_t in each channel at rest.
#[test]
fn at_the_limits_of_coupled_controls_each_channel_rests_where_its_own_share_has_it() {
    let start = "K_p = [3.0, 5.0]\nK_i = [2.0, 1.0]\ntracking_time = [0.2, 0.1]\nS = [[2.0, 0.5], [-0.3, 1.0]]\n\
                 u_min = [-1.0, -1.0]\nu_max = [1.0, 1.0]";
    let mut run = Run::of(&alone(2, start));
    run.set("r[1]", 4.0).set("r[2]", 8.0).start().step(5.0);
    assert_eq!([run.get("u[1]"), run.get("u[2]")], [1.0, 1.0]);
    // S⁻¹ (1, 1) = (0.5, 2.3)/2.15, as the determinant is 2.15.
    for (name, share, asked) in [("v[1]", 0.5, 2.0 * 4.0 * 0.2), ("v[2]", 2.3, 8.0 * 0.1)] {
        assert!((run.get(name) - share / 2.15 - asked).abs() < 1e-8, "{name}: {}", run.get(name));
    }
}

/// y of 1/s² under PID control within ±limit after a step of the reference, every 0.1 s for 12 s: equations written
/// out, by the classical Runge–Kutta method.
fn by_hand([K_p, K_i, K_d, N]: [f64; 4], limit: f64, tracking_rate: f64) -> Vec<f64> {
    const STEPS: usize = 2000;
    let rate = |[x1, x2, I, w]: [f64; 4]| {
        let v = K_p * (1.0 - x1) + I + K_d * N * (-x1 - w);
        let u = v.clamp(-limit, limit);
        [x2, u, K_i * (1.0 - x1) + (u - v) * tracking_rate, N * (-x1 - w)]
    };
    let h = 0.1 / STEPS as f64;
    let along = |x: [f64; 4], k: [f64; 4], h: f64| std::array::from_fn(|i| x[i] + h * k[i]);
    let step = |x: [f64; 4]| {
        let k1 = rate(x);
        let k2 = rate(along(x, k1, 0.5 * h));
        let k3 = rate(along(x, k2, 0.5 * h));
        let k4 = rate(along(x, k3, h));
        std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
    };
    let mut x = [0.0; 4];
    let mut outputs = Vec::new();
    for _ in 0..120 {
        (0..STEPS).for_each(|_| x = step(x));
        outputs.push(x[0]);
    }
    outputs
}

#[test]
fn from_a_limit_the_loop_recovers_as_back_calculation_has_it_and_overshoots_less() {
    let (gains, limit) = ([3.0, 1.0, 3.0, 60.0], 0.3);
    let A = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
    let (B, C) = (DMatrix::from_row_slice(2, 1, &[0.0, 1.0]), DMatrix::from_row_slice(1, 2, &[1.0, 0.0]));
    let mut overshoot = Vec::new();
    for (time, rate) in [(-1.0, (1.0_f64 / 3.0).sqrt()), (0.5, 2.0), (0.0, 0.0)] {
        let start = format!(
            "K_p = [3.0]\nK_i = [1.0]\nK_d = [3.0]\nN = [60.0]\nc = [0.0]\nu_min = [-0.3]\nu_max = [0.3]\n\
             tracking_time = [{time:?}]"
        );
        let mut run = closed(&A, &B, &C, &start);
        run.set("pid.r[1]", 1.0).start();
        let exact = by_hand(gains, limit, rate);
        for &exact in &exact {
            let found = run.step(0.1).get("plant.y[1]");
            assert!((found - exact).abs() < 1e-6, "T_t = {time}: {found}, {exact}");
        }
        overshoot.push(exact.into_iter().fold(0.0, f64::max) - 1.0);
    }
    let [by_gains, _, off] = overshoot[..] else { panic!("three") };
    assert!(by_gains < 0.5 * off, "{overshoot:?}");
}

#[test]
fn gains_of_zero_leave_their_parts_out() {
    let mut random = Random(3);
    for (gains, time) in [
        ([2.0, 0.0, 0.0], 0.0),
        ([2.0, 0.0, 0.5], 0.0),
        ([2.0, 4.0, 0.0], 0.5),
        ([0.0, 4.0, 0.0], 0.01),
        ([0.0, 4.0, 1.0], 0.5),
        ([0.0, 0.0, 0.0], 0.0),
    ] {
        let [K_p, K_i, K_d] = gains;
        let start = format!("K_p = [{K_p:?}]\nK_i = [{K_i:?}]\nK_d = [{K_d:?}]\nu_min = [-1.0]\nu_max = [1.0]");
        let mut run = Run::of(&alone(1, &start));
        run.start();
        assert_eq!(run.get("T_t[1]"), time, "{gains:?}");
        for _ in 0..50 {
            run.set("r[1]", 3.0 * random.next()).set("y[1]", random.next()).step(0.01);
            let [P, I, D] = ["P[1]", "I[1]", "D[1]"].map(|name| run.get(name));
            assert!(P + I + D == run.get("v[1]") && run.get("v[1]").clamp(-1.0, 1.0) == run.get("u[1]"), "{gains:?}");
            assert!((K_p != 0.0 || P == 0.0) && (K_i != 0.0 || I == 0.0) && (K_d != 0.0 || D == 0.0), "{gains:?}");
        }
    }
}

#[test]
fn without_an_integral_a_given_tracking_time_is_no_leak() {
    let mut run = Run::of(&alone(1, "K_p = [2.0]\ntracking_time = [0.1]\nu_max = [1.0]"));
    run.set("r[1]", 5.0).start().step(1.0);
    assert_eq!((run.get("T_t[1]"), run.get("I[1]"), run.get("u[1]")), (0.0, 0.0, 1.0));
}

#[test]
fn controls_stay_within_their_limits() {
    let mut random = Random(11);
    for round in 0..20 {
        let S = regular(&mut random, 3);
        let (min, max): (Vec<f64>, Vec<f64>) =
            (0..3).map(|_| (-0.01 - random.next().abs(), 0.01 + random.next().abs())).unzip();
        let start = format!(
            "K_p = [5.0, 1.0, 0.0]\nK_i = [3.0, 0.0, 20.0]\nK_d = [1.0, 0.1, 0.0]\nS = {}\nu_min = {}\nu_max = {}",
            rows(&S),
            list(&min),
            list(&max)
        );
        let mut run = Run::of(&alone(3, &start));
        run.start();
        let (mut reached, mut free) = (0, 0);
        for _ in 0..60 {
            let enabled = random.next() > -0.5;
            for i in 1..=3 {
                let size = 10_f64.powf(2.0 * random.next());
                run.set(&format!("r[{i}]"), size * random.next()).set(&format!("y[{i}]"), size * random.next());
                run.set(&format!("u_manual[{i}]"), size * random.next());
            }
            run.enable(enabled).step(0.01);
            for i in 0..3 {
                let u = run.get(&format!("u[{}]", i + 1));
                assert!((min[i]..=max[i]).contains(&u), "{round}: {} <= {u} <= {}", min[i], max[i]);
                if u == min[i] || u == max[i] { reached += 1 } else { free += 1 }
            }
        }
        assert!(reached > 20 && free > 5, "both occur: {reached}, {free}");
    }
}

/// Two coupled channels in motion, limited to ±4.
fn moving() -> Run {
    let start = "K_p = [3.0, 5.0]\nK_i = [2.0, 1.0]\nK_d = [0.4, 0.0]\nS = [[2.0, 0.5], [-0.3, 1.0]]\n\
                 u_min = [-4.0, -4.0]\nu_max = [4.0, 4.0]";
    let mut run = Run::of(&alone(2, start));
    run.set("r[1]", 0.4).set("r[2]", -0.2).start();
    for k in 0..50 {
        run.set("y[1]", (0.1 * f64::from(k)).sin() * 0.2).set("y[2]", 0.002 * f64::from(k)).step(0.01);
    }
    run
}

#[test]
fn neither_way_of_changing_command_makes_the_control_jump() {
    let mut run = moving();
    let (before, integral) = ([run.get("u[1]"), run.get("u[2]")], run.get("I[1]"));
    // By hand from where the control is.
    run.set("u_manual[1]", before[0]).set("u_manual[2]", before[1]).enable(false).step(1e-9);
    assert_eq!([run.get("u[1]"), run.get("u[2]")], before);
    for k in 0..50 {
        run.set("u_manual[1]", 0.01 * f64::from(k)).set("y[1]", (0.1 * f64::from(k)).cos() * 0.2).step(0.01);
        assert_eq!(run.get("u[1]"), 0.01 * f64::from(k));
    }
    assert!((run.get("I[1]") - integral).abs() < 1e-7, "held, but for the step in which the command changed");
    assert!(run.get("D[1]").abs() < 1.0, "the derivative follows");
    // And back, with everything in motion.
    run.set("u_manual[2]", -1.5).set("y[1]", 0.3).set("r[2]", 0.9).enable(true).step(1e-12);
    assert!(run.get("D[1]").abs() > 1e-3, "the derivative is in force");
    let off = (run.get("u[1]") - 0.49).abs().max((run.get("u[2]") + 1.5).abs());
    assert!(off < 1e-8, "{off}");
}

#[test]
fn manual_control_beyond_a_limit_is_taken_over_at_the_limit() {
    let mut run = moving();
    run.set("u_manual[1]", 9.0).set("u_manual[2]", -1.0).enable(false).step(0.01);
    assert_eq!(run.get("u[1]"), 4.0);
    run.enable(true).step(1e-9);
    assert!((run.get("u[1]") - 4.0).abs() < 1e-6 && (run.get("u[2]") + 1.0).abs() < 1e-6);
    let wanted = 2.0 * run.get("v[1]") + 0.5 * run.get("v[2]");
    assert!((wanted - 4.0).abs() < 1e-6, "nothing is wound up: {wanted}");
}

#[test]
fn a_start_by_hand_is_left_without_a_jump() {
    let mut run = Run::of(&alone(1, "K_i = [1.0]\nK_d = [1.0]"));
    run.set("r[1]", 3.0).set("y[1]", 1.0).set("u_manual[1]", 0.7).enable(false).start();
    assert_eq!((run.get("u[1]"), run.get("I[1]"), run.get("D[1]")), (0.7, 0.0, 0.0));
    run.step(0.1).enable(true).step(1e-9);
    assert!((run.get("u[1]") - 0.7).abs() < 1e-6);
}

#[test]
fn a_start_has_no_derivative_kick() {
    let mut run = Run::of(&alone(1, "K_p = [2.0]\nK_d = [1.0]"));
    run.set("r[1]", 3.0).set("y[1]", 1.0).start();
    assert_eq!((run.get("u[1]"), run.get("D[1]")), (4.0, 0.0));
}

#[test]
fn the_inverse_of_the_plant_s_gain_decouples() {
    let G = DMatrix::from_row_slice(2, 2, &[2.0, 0.8, 0.5, 1.0]);
    let (A, C) = (DMatrix::zeros(2, 2), DMatrix::identity(2, 2));
    let moved = |S: &DMatrix<f64>| {
        let mut run = closed(&A, &G, &C, &format!("K_p = [2.0, 2.0]\nK_i = [1.0, 1.0]\nS = {}", rows(S)));
        run.set("pid.r[1]", 1.0).start();
        let step = |run: &mut Run| run.step(0.1).get("plant.y[2]").abs();
        let largest = (0..50).map(|_| step(&mut run)).fold(0.0, f64::max);
        assert!((run.get("plant.y[1]") - 1.0).abs() < 0.1);
        largest
    };
    assert!(moved(&G.clone().try_inverse().unwrap()) < 1e-9);
    assert!(moved(&DMatrix::identity(2, 2)) > 0.05);
}

/// Example 3.2.1 by the PID controller of this package, against an independent simulation of it.
#[test]
fn the_plant_of_example_3_2_1_follows_its_reference() {
    let mut pid: toml::Table = common::description("PidNonlinearSiso").parse().unwrap();
    // What is connected has no start value.
    pid["start"].as_table_mut().unwrap().remove("y");
    let mut run = Run::of(&format!(
        "{}[structure]\nconnections = [['reference.r[1]', 'pid.r[1]'], ['plant.y[1]', 'pid.y[1]'], ['pid.u[1]', \
         'plant.u[1]']]\n[[structure.parts]]\nname = 'reference'\nmodel = 'reference'\nstructure = {{ channels = 1, signals \
         = [{{ name = 'cosine', description = '', parts = ['cosine'] }}] }}\nstart = {{ cosine_amplitude = [2.0], \
         cosine_frequency = [0.2] }}\n[[structure.parts]]\nname = 'plant'\nmodel = 'nonlinear-siso'\n[[structure.parts]]\nname = 'pid'\nmodel = 'pid'\n\
         structure = {{ channels = 1 }}\n[structure.parts.start]\n{}\n",
        head("composite"),
        start_of(&pid)
    ));
    run.start();
    assert_eq!(run.get("pid.u[1]"), 64.0);
    let (mut squares, mut count) = (0.0, 0);
    for k in 1..=6000 {
        run.step(0.01);
        assert!(run.get("pid.u[1]").abs() <= 64.0);
        if k >= 500 {
            squares += (run.get("pid.r[1]") - run.get("plant.y[1]")).powi(2);
            count += 1;
        }
    }
    let rms = (squares / f64::from(count)).sqrt();
    assert!((rms - 0.029_251).abs() < 3e-5, "{rms}");
}
