//! Neuro-adaptive control with prescribed performance: formulas in another form, and behaviour at the bounds of the
//! funnel.

#![allow(non_snake_case)] // matrices have the names of the thesis

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::described::refused;
use common::models::Run;
use common::{ERROR, OK, Unit, description};
use nalgebra::DMatrix;
use num_dual::{Dual2_64, DualNum, second_derivative};

const ROBOT: &str = "NeuroPpfTwoLinkRobot";
const COUPLED: &str = "NeuroPpfCoupledMimo";

/// A controller of two neurons with given weights.
fn small(degree: usize, m: usize, input_gain_network: bool) -> String {
    let row = |j: usize| (0..degree * m).map(|k| weight(j, k)).collect::<Vec<_>>();
    format!(
        "name = \"Small\"\nmodel = \"neuro-ppf\"\ndescription = \"\"\n[structure]\nrelative_degree = {degree}\n\
         channels = {m}\ninput_gain_network = {input_gain_network}\n\
         network = {{ rule = \"given\", weights = [{:?}, {:?}], biases = [0.3, -0.2] }}\n\
         [start]\nrho_inf = {:?}\nfunnel = \"no_overshoot\"\novershoot = {:?}\n",
        row(0),
        row(1),
        vec![0.4; m],
        vec![0.5; m],
    )
}

fn weight(j: usize, k: usize) -> f64 {
    0.7 - 0.4 * j as f64 - 0.15 * k as f64
}

/// A number within ±0.5.
fn pseudo(seed: usize) -> f64 {
    (seed as f64 * 0.618_033_988_7 + 0.21).fract() - 0.5
}

struct Expected {
    nu_b: Vec<f64>,
    nu_a: Vec<f64>,
    u: Vec<f64>,
    /// R_i E_i
    RE: Vec<f64>,
    Z: [f64; 2],
}

const TIME: f64 = 0.3;

/// The control at a point: E and V as derivatives of ε by time without the plant's own part, and the inverse of F_G.
fn by_hand(degree: usize, m: usize, network: bool, run: &Run) -> Expected {
    let all = |name: &str, len: usize| (1..=len).map(|i| run.get(&format!("{name}[{i}]"))).collect::<Vec<_>>();
    let (x, r) = (all("x", degree * m), all("r", m));
    let Z = [0, 1].map(|j| {
        let sum: f64 = x.iter().enumerate().map(|(k, x)| weight(j, k) * x).sum();
        1.0 / (1.0 + (-sum - [0.3, -0.2][j]).exp())
    });
    let estimate =
        |name: &str, column: usize| (0..2).map(|j| Z[j] * run.get(&format!("{name}[{},{column}]", j + 1))).sum::<f64>();
    let (mut nu_b, mut RE) = (vec![], vec![]);
    for i in 0..m {
        // e and its derivatives, the last one without the plant's.
        let [e, rate, second] = if degree == 2 {
            let [dr, ddr] = ["dr", "ddr"].map(|name| all(name, m)[i]);
            [x[i] - r[i], x[m + i] - dr, -ddr]
        } else {
            let x_m = all("x_m", m);
            let model: f64 = (0..m).map(|l| run.get(&format!("A_m[{},{}]", i + 1, l + 1)) * (x_m[l] - r[l])).sum();
            [x[i] - x_m[i], -model, 0.0]
        };
        let rho = |t: Dual2_64| (t * -2.0).exp() * (1.1 - 0.4) + 0.4;
        let epsilon = |t: Dual2_64| {
            let since = t - TIME;
            let z = (since * since * (0.5 * second) + since * rate + e) / rho(t);
            ((z + 0.5) / (-z + 1.0)).ln() * 0.5
        };
        let (eps, d, dd) = second_derivative(epsilon, TIME);
        let z = e / rho(TIME.into()).re;
        let R = 0.5 * (1.0 / (0.5 + z) + 1.0 / (1.0 - z)) / rho(TIME.into()).re;
        let [E, V] = if degree == 2 { [d + 0.75 * eps, dd + 0.75 * d] } else { [eps, d] };
        nu_b.push(estimate("theta_f", i + 1) + V / R + 0.5 * E / R + 0.2 * R * E);
        RE.push(R * E);
    }
    let nu_a = if network {
        let F = DMatrix::from_fn(m, m, |i, l| estimate("theta_G", i * m + l + 1));
        let squared = F.determinant().powi(2);
        let solved = F.lu().solve(&nalgebra::DVector::from_column_slice(&nu_b)).unwrap();
        solved.iter().map(|solved| -squared / (squared + 0.1) * solved).collect()
    } else {
        vec![0.0; m]
    };
    let robust = 0.2 * nu_a.iter().chain(&nu_b).map(|nu: &f64| nu * nu).sum::<f64>();
    let u = nu_a.iter().zip(&RE).map(|(nu_a, RE)| nu_a - robust * RE).collect();
    Expected { nu_b, nu_a, u, RE, Z }
}

/// A run with pseudo-random inputs and weights, with the error inside the funnel.
fn at_a_point(degree: usize, m: usize, network: bool) -> Run {
    let description = Description::read(&small(degree, m, network)).unwrap();
    let mut run = Run(Execution::new(Model::from_description(description, REGISTRY).unwrap()));
    run.0.initialise().unwrap();
    run.0.set_time(TIME);
    let mut seed = 0;
    let mut fill = |run: &mut Run, name: &str, scale: f64| {
        seed += 1;
        run.set(name, scale * pseudo(seed));
    };
    let names: &[&str] = if degree == 2 { &["r", "dr", "ddr"] } else { &["r", "x_m"] };
    names
        .iter()
        .flat_map(|name| (1..=m).map(move |i| format!("{name}[{i}]")))
        .for_each(|name| fill(&mut run, &name, 0.3));
    (1..=degree * m).for_each(|i| fill(&mut run, &format!("x[{i}]"), 0.2));
    for j in 1..=2 {
        (1..=m).for_each(|i| fill(&mut run, &format!("theta_f[{j},{i}]"), 3.0));
        let columns = if network { m * m } else { 0 };
        (1..=columns).for_each(|c| fill(&mut run, &format!("theta_G[{j},{c}]"), 4.0));
    }
    let block = &mut run.0.block().clone();
    let model = run.0.model();
    let offsets = model.variables().offsets();
    model.equations().outputs(TIME, &mut block.reals, &block.integers, offsets);
    model.equations().derivatives(TIME, &mut block.reals, &block.integers, offsets);
    *run.0.block_mut() = block.clone();
    run
}

fn near(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= 1e-11 * expected.abs().max(1.0), "{what}: {found}, not {expected}");
}

#[test]
fn the_law_is_that_of_the_thesis() {
    for (degree, m, network) in [(1, 1, true), (1, 2, true), (1, 3, true), (1, 3, false), (2, 1, true), (2, 2, true)] {
        let run = at_a_point(degree, m, network);
        let expected = by_hand(degree, m, network, &run);
        for i in 0..m {
            let what = format!("degree {degree}, channel {} of {m}", i + 1);
            near(run.get(&format!("nu_b[{}]", i + 1)), expected.nu_b[i], &what);
            near(run.get(&format!("u[{}]", i + 1)), expected.u[i], &what);
            for j in 0..2 {
                let theta = run.get(&format!("theta_f[{},{}]", j + 1, i + 1));
                let rate = 0.1 * (expected.Z[j] * expected.RE[i] - 7.5 * theta);
                near(run.get(&format!("der(theta_f[{},{}])", j + 1, i + 1)), rate, &what);
            }
        }
        for (i, l, j) in (0..m).flat_map(|i| (0..m).flat_map(move |l| [(i, l, 0), (i, l, 1)])).filter(|_| network) {
            let name = format!("theta_G[{},{}]", j + 1, i * m + l + 1);
            let excited = expected.Z[j] * expected.nu_a[l] * expected.RE[i];
            near(run.get(&format!("der({name})")), 0.1 * (excited - 7.5 * run.get(&name)), &name);
        }
    }
}

/// A running controller of the robot, which is to begin its trajectory from rest.
fn robot(parameters: &[(&str, f64)]) -> Unit {
    let unit = Unit::new(ROBOT);
    parameters.iter().for_each(|&(name, value)| unit.put(name, value));
    unit.start(0.0);
    unit.put("r[1]", 0.5);
    unit.put("r[2]", -0.6);
    unit
}

#[test]
fn the_network_of_the_input_gain_never_acts_unless_it_is_given_a_start() {
    let unit = robot(&[]);
    unit.run(0.0, 50, 1e-3);
    let all = |name: &str| [1, 2].map(|i| unit.get(&format!("{name}[{i}]")));
    assert_eq!((all("nu_a"), unit.get("theta_G[7,1]"), unit.get("F_G[2,1]")), ([0.0; 2], 0.0, 0.0));
    assert!(all("u").iter().all(|u| u.abs() > 1.0) && unit.get("theta_f[7,1]") != 0.0);
    let unit = Unit::new(ROBOT);
    unit.put("g_network_initial", 0.7);
    unit.start(0.0);
    [("r[1]", 0.5), ("r[2]", -0.6), ("x[1]", 0.1), ("x[4]", -2.0)]
        .iter()
        .for_each(|&(name, value)| unit.put(name, value));
    assert_eq!(unit.step(0.0, 1e-9), OK, "{:?}", unit.messages());
    let gain = ["F_G[1,1]", "F_G[1,2]", "F_G[2,1]", "F_G[2,2]"].map(|name| unit.get(name));
    assert!(gain.iter().zip([0.7, 0.0, 0.0, 0.7]).all(|(found, g)| (found - g).abs() < 1e-6), "{gain:?}");
    assert!(unit.get("nu_a[1]").abs() > 0.01);
}

#[test]
fn the_control_keeps_its_limits() {
    let unit = robot(&[("u_max[1]", 3.0), ("u_min[2]", -4.0)]);
    assert_eq!(unit.step(0.0, 1e-6), OK);
    let free = robot(&[]);
    assert_eq!(free.step(0.0, 1e-6), OK);
    assert!(free.get("u[1]") > 3.0 && free.get("u[2]") < -4.0);
    assert_eq!([unit.get("u[1]"), unit.get("u[2]")], [3.0, -4.0]);
}

#[test]
fn an_error_outside_at_the_start_is_refused_with_what_would_do() {
    let unit = robot(&[]);
    unit.put("x[1]", 0.0);
    unit.put("r[1]", 1.5);
    assert_eq!(unit.step(0.0, 1e-3), ERROR);
    let message = unit.last_message();
    let named = ["e[1] = -1.5", "0.4", "rho_0[1] above 1.5", "t = 0 s"];
    assert!(named.iter().all(|name| message.contains(name)), "{message}");
    // With a wider one it starts.
    let unit = robot(&[("rho_0[1]", 1.51)]);
    unit.put("x[1]", 0.0);
    unit.put("r[1]", 1.5);
    assert_eq!(unit.step(0.0, 1e-3), OK, "{:?}", unit.messages());
}

#[test]
fn an_error_that_leaves_its_funnel_ends_the_step_and_changes_nothing() {
    let [unit, twin] = [robot(&[]), robot(&[])];
    [&unit, &twin].iter().for_each(|unit| unit.run(0.0, 10, 1e-3));
    let saved = unit.save();
    unit.put("x[2]", 0.7);
    assert_eq!(unit.step(0.01, 1e-3), ERROR);
    let message = unit.last_message();
    let named = ["e[2] = 1.29999", "rho[2] = 1.0783", "at t = 0.01 s"];
    assert!(named.iter().all(|name| message.contains(name)), "{message}");
    assert_eq!(unit.last_successful_time(), twin.last_successful_time());
    let shown = |unit: &Unit| ["theta_f[7,2]", "rho[2]", "e[1]"].map(|name| unit.get(name));
    assert_eq!(shown(&unit), shown(&twin));
    assert_eq!(unit.restore(saved), OK);
    [&unit, &twin].iter().for_each(|unit| unit.run(0.01, 10, 1e-3));
    assert_eq!(unit.values(), twin.values(), "it goes on as if nothing had been tried");
}

#[test]
fn a_funnel_that_may_reopen_does_and_counts() {
    let unit = Unit::new(ROBOT);
    assert_eq!(unit.set_integer("on_funnel_exit", 2), OK);
    unit.start(0.0);
    unit.put("r[1]", 0.5);
    unit.put("r[2]", -0.6);
    unit.run(0.0, 10, 1e-3);
    assert_eq!(unit.get_integer("funnel_reopened"), 0);
    unit.put("x[2]", 0.7);
    assert_eq!(unit.step(0.01, 1e-3), OK, "{:?}", unit.messages());
    assert_eq!(unit.get_integer("funnel_reopened"), 1);
    let expected = (1.25 * 1.3 - 0.005) * f64::exp(-2e-3) + 0.005;
    near(unit.get("rho[2]"), expected, "rho[2]");
    let warnings = unit.messages().into_iter().filter(|(_, category, _)| category == "logFunnel").count();
    assert_eq!(warnings, 1);
}

#[test]
fn weights_of_another_size_are_refused_with_the_sizes() {
    let text = small(2, 2, true);
    let changed = |old: &str, new: &str| {
        assert!(text.contains(old), "`{old}` is in {text}");
        text.replace(old, new)
    };
    refused(&changed("biases = [0.3, -0.2]", "biases = [0.3]"), &["biases = 1 numbers", "must be 2"]);
    refused(&changed("biases =", "neurons = 3, biases ="), &["weights = 2 rows", "must be 3", "biases = 2"]);
    let first = format!("{:?}", (0..4).map(|k| weight(0, k)).collect::<Vec<_>>());
    refused(&changed(&first, "[1.0, 2.0]"), &["weights, row 1 = 2 numbers", "must be 4"]);
    refused(&changed("\"given\"", "\"square_roots\""), &["weights, biases", "given"]);
    let robot = description(ROBOT);
    refused(&robot.replace("neurons = 30", "neurons = 0"), &["neurons = 0", "1 … 1000"]);
    refused(&robot.replace("channels = 2", "channels = 4"), &["channels = 4", "1 … 3"]);
    refused(&robot.replace("relative_degree = 2", "relative_degree = 3"), &["relative_degree = 3", "1 or 2"]);
    refused(&robot.replace("\"square_roots\"", "\"random\""), &["random", "quasi_random"]);
}

#[test]
fn a_funnel_that_widens_is_refused() {
    for name in [ROBOT, COUPLED] {
        let text = description(name);
        let line = text.lines().find(|line| line.starts_with("rho_inf")).unwrap();
        let wide = if name == ROBOT { "rho_inf = [0.005, 1.2]" } else { "rho_inf = [0.05, 2.0, 0.05]" };
        let allowed = if name == ROBOT { "rho_0[2] = 1.1" } else { "rho_0[2] = 2" };
        refused(&text.replace(line, wide), &["rho_inf[2]", "must be below", allowed]);
    }
}

#[test]
fn the_model_that_is_followed_starts_where_given() {
    let unit = Unit::new(COUPLED);
    [("x_m0[1]", 0.6), ("x_m0[2]", -0.8), ("x_m0[3]", 0.4)].iter().for_each(|&(name, value)| unit.put(name, value));
    unit.start(0.0);
    [("x[1]", 0.6), ("x[2]", -0.8), ("x[3]", 0.4)].iter().for_each(|&(name, value)| unit.put(name, value));
    assert_eq!(unit.step(0.0, 1e-9), OK);
    assert!((1..=3).all(|i| unit.get(&format!("e[{i}]")).abs() < 1e-6), "{}", unit.get("e[1]"));
    // x_m' = A_m (x_m − r): the first state decays to the reference at 70 1/s.
    unit.put("r[1]", 1.0);
    unit.run(1e-9, 10, 1e-3);
    let expected = 1.0 - 0.4 * f64::exp(-0.7);
    assert!((unit.get("x_m[1]") - expected).abs() < 1e-5, "{}", unit.get("x_m[1]"));
}
