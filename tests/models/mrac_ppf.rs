//! Robust MRAC with prescribed performance: its law against a plain formula, its funnel, and its sampled form.

use common::described::refused;
use common::{ERROR, OK, Unit, description};

const NAME: &str = "MracPpfCoupledMimo";
const A: [[f64; 3]; 3] = [[-36.0, 36.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, -3.0]];
const A_M: [[f64; 3]; 3] = [[-70.0, 0.0, 0.0], [0.0, -60.0, 1.0], [0.0, -1.0, -60.0]];
const R: [f64; 3] = [1.0, 1.0, 1.0];
const X: [f64; 3] = [0.6, -0.8, 0.4];

fn text(start: &str) -> String {
    format!("{}\n{start}", description(NAME))
}

fn put(unit: &Unit, name: &str, values: [f64; 3]) {
    (0..3).for_each(|i| unit.put(&format!("{name}[{}]", i + 1), values[i]));
}

fn get(unit: &Unit, name: &str) -> [f64; 3] {
    [1, 2, 3].map(|i| unit.get(&format!("{name}[{i}]")))
}

/// The FMU for model exchange, at the start of example 6.5.1.
fn exchange(start: &str) -> Unit {
    let unit = Unit::exchange_from_text(&text(start));
    unit.enter(0.0);
    put(&unit, "r", R);
    put(&unit, "x", X);
    assert_eq!(unit.exit(), OK, "{:?}", unit.messages());
    unit.settle();
    unit
}

/// Stepped, with inputs set before the start.
fn stepped(start: &str, x: [f64; 3]) -> Unit {
    let unit = Unit::from_text(&text(start));
    unit.enter(0.0);
    put(&unit, "r", R);
    put(&unit, "x", x);
    assert_eq!(unit.exit(), OK, "{:?}", unit.messages());
    unit
}

fn near(found: &[f64], expected: &[f64]) {
    let all = found.len() == expected.len()
        && found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-9 * e.abs().max(1.0));
    assert!(all, "{found:?}, not {expected:?}");
}

/// Asserts that a step fails with a message that names these things, and that the values are as before.
fn fails(unit: &Unit, named: &[&str], time: f64) {
    let before = unit.values();
    assert_eq!(unit.step(time, 1e-3), ERROR);
    let message = unit.last_message();
    named.iter().for_each(|name| assert!(message.contains(name), "`{message}` names {name}"));
    assert_eq!(unit.values(), before);
}

/// The rows of a matrix times a vector.
fn times(matrix: [[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row.iter().zip(vector).map(|(a, x)| a * x).sum())
}

#[test]
fn the_control_at_the_start_is_the_laws() {
    // From the example's numbers by hand.
    let u = get(&exchange(""), "u");
    assert_eq!(u.map(|u| (10.0 * u).round() / 10.0), [-130.4, 326.1, -188.2]);
}

#[test]
fn the_law_and_the_adaptation_are_those_of_the_formulas_anywhere() {
    let unit = exchange("");
    // In the order x_m, theta_hat, sigma_integral, the matrices by columns.
    let x_m = [0.5, -0.9, 0.45];
    let theta: [f64; 9] = std::array::from_fn(|k| 0.1 * k as f64 - 0.3);
    let integral: [f64; 9] = std::array::from_fn(|k| 0.4 - 0.15 * k as f64);
    assert_eq!(unit.set_states(&[&x_m[..], &theta, &integral].concat()), OK);
    assert_eq!(unit.set_time(0.4), OK);
    let rho = 1.95 * (-0.6_f64).exp() + 0.05;
    let drho = -1.5 * 1.95 * (-0.6_f64).exp();
    let model = times(A_M, [0, 1, 2].map(|i| x_m[i] - R[i]));
    let nominal = times(A, X);
    let (mut u, mut dtheta, mut dintegral) = ([0.0; 3], [0.0; 9], [0.0; 9]);
    for i in 0..3 {
        let e = X[i] - x_m[i];
        let (z, epsilon) = (e / rho, (e / rho).atanh());
        let r = 1.0 / (rho * (1.0 - z * z));
        let column = 3 * i..3 * i + 3;
        let sigma = integral[column.clone()]
            .iter()
            .map(|integral| (integral + 1e5 * epsilon * 2.0) / (1.0 + 1e5 * 0.05 * epsilon.abs()))
            .collect::<Vec<_>>();
        let estimated: f64 = theta[column].iter().zip(X).map(|(theta, x)| theta * x).sum();
        u[i] = -nominal[i] + model[i] + z * drho
            - estimated
            - 2.0 * sigma.iter().sum::<f64>()
            - 10.0 * (epsilon / 0.01).tanh()
            - 0.1 * epsilon;
        for j in 0..3 {
            dtheta[3 * i + j] = 5e4 * epsilon * r * X[j];
            dintegral[3 * i + j] = r * 5e4 * (epsilon * 2.0 - epsilon.abs() * 0.05 * sigma[j]);
        }
    }
    near(&unit.derivatives(), &[&model[..], &dtheta, &dintegral].concat());
    near(&get(&unit, "u"), &u);
}

#[test]
fn an_error_outside_at_the_start_is_refused_with_the_bound_that_would_do() {
    for (start, x, named) in [
        (
            "",
            [0.6, -2.5, 0.4],
            ["e[2] = -2.5", "must lie between -2 and 2", "beyond by 0.5", "rho_0[2] above 2.5 would do"],
        ),
        (
            "funnel = 'no_overshoot'\novershoot = [0.1, 0.1, 0.0]",
            [0.1, 0.1, 0.0],
            ["e[3] = 0: ", "must lie between 0 and 2", "is at a bound", "overshoot[3] above 0 would do"],
        ),
    ] {
        let unit = stepped(start, x);
        fails(&unit, &named, 0.0);
        // In model exchange nothing can be set after the start.
        let unit = Unit::exchange_from_text(&text(start));
        unit.enter(0.0);
        put(&unit, "x", x);
        assert_eq!(unit.exit(), ERROR);
        let message = unit.last_message();
        assert!(named.iter().all(|name| message.contains(name)), "{message}");
    }
}

#[test]
fn inputs_that_are_set_after_initialization_are_those_that_count_at_the_start() {
    // At zero, where the inputs are before they are set, this funnel is empty.
    let unit = Unit::from_text(&text("funnel = 'no_overshoot'"));
    unit.start(0.0);
    put(&unit, "r", R);
    put(&unit, "x", X);
    assert_eq!(unit.step(0.0, 1e-3), OK, "{:?}", unit.messages());
    near(&[unit.get("funnel_lower[2]") / unit.get("rho[2]"), unit.get("funnel_upper[2]")], &[-1.0, 0.0]);
    near(&[unit.get("funnel_lower[1]"), unit.get("funnel_upper[1]") / unit.get("rho[1]")], &[0.0, 1.0]);
}

#[test]
fn leaving_the_funnel_is_an_error_that_leaves_the_state_as_before() {
    let unit = stepped("", X);
    assert_eq!(unit.step(0.0, 1e-3), OK);
    unit.put("x[3]", 3.0);
    let named =
        ["e[3] = ", "has left its funnel", "rho[3] = 1.99", "at t = 0.00", "smaller communication step", "rho_0[3]"];
    fails(&unit, &named, 1e-3);
}

#[test]
fn a_funnel_that_re_opens_is_counted_and_closes_again() {
    let unit = stepped("on_funnel_exit = 'reopen'", X);
    unit.run(0.0, 10, 1e-3);
    assert_eq!(unit.get_integer("funnel_reopened"), 0);
    unit.put("x[3]", 3.0);
    assert_eq!(unit.step(0.01, 1e-3), OK, "{:?}", unit.messages());
    assert_eq!(unit.get_integer("funnel_reopened"), 1);
    let e = unit.get("e[3]");
    // 1.25 times the error where the step began, then 1 ms of decay.
    assert!((unit.get("rho[3]") / e - 1.25).abs() < 0.05 && unit.get("rho[1]") < 2.0);
    let messages = unit.messages();
    let count = messages.iter().filter(|(_, category, text)| category == "logFunnel" && text.contains("e[3]")).count();
    assert_eq!(count, 1, "{messages:?}");
    put(&unit, "x", R);
    unit.run(0.011, 1000, 1e-3);
    assert!(unit.get("rho[3]") < 1.2 && unit.get_integer("funnel_reopened") == 1);
}

#[test]
fn the_sampled_control_is_constant_until_the_next_step() {
    let unit = stepped("", X);
    let first = get(&unit, "u");
    assert_eq!(unit.step(0.0, 1e-3), OK);
    let second = get(&unit, "u");
    assert!(first != second);
    // The controller works at steps at which the continuous one, whose error decays at 2.4e7 1/s, is unstable.
    assert!(second.iter().all(|u| u.abs() < 400.0), "{second:?}");
    let continuous = stepped("law = 'continuous'", X);
    assert_eq!(continuous.step(0.0, 1e-6), OK, "{:?}", continuous.messages());
    assert!(continuous.get_boolean("step_too_long"));
    let warned = continuous.messages().into_iter().any(|(_, category, text)| {
        category == "logStepTooLong" && text.contains("law = sampled") && text.contains("4.")
    });
    assert!(warned, "it warns of a step of 1/s");
}

#[test]
fn the_control_keeps_to_its_limits() {
    let limits = "u_min = [-50.0, -50.0, -50.0]\nu_max = [60.0, 60.0, 60.0]";
    near(&get(&exchange(limits), "u"), &[-50.0, 60.0, -50.0]);
    let unit = stepped(limits, X);
    unit.run(0.0, 5, 1e-3);
    assert!(get(&unit, "u").iter().all(|u| (-50.0..=60.0).contains(u)));
}

#[test]
fn parameters_and_structures_that_contradict_themselves_are_refused_with_the_numbers() {
    let wide = description(NAME).replace("rho_inf = [0.05, 0.05, 0.05]", "rho_inf = [0.05, 2.5, 0.05]");
    refused(&wide, &["rho_inf[2] = 2.5", "below rho_0[2] = 2"]);
    refused(&text("K_epsilon = [0.1, 0.0, 0.1]"), &["K_epsilon[2]"]);
    let hurwitz = description(NAME).replace("[-70.0, 0.0, 0.0]", "[70.0, 0.0, 0.0]");
    refused(&hurwitz, &["A_m", "70"]);
    let row = "B = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]";
    refused(&description(NAME).replace(row, "B = [[1.0], [0.0], [0.0]]"), &["rank of B = 1", "must be 3"]);
    refused(&description(NAME).replace(row, "B = [[1.0], [0.0]]"), &["size of A = 3 × 3", "must be 2 × 2"]);
    // Where the master integrates, nothing is sampled.
    let unit = Unit::exchange_from_text(&text("law = 'sampled'"));
    unit.enter(0.0);
    assert_eq!(unit.exit(), ERROR);
    assert!(unit.last_message().contains("law = sampled"));
}
