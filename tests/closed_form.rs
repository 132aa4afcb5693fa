//! The closed-form step of L1 controllers, against error-controlled integration of their equations.

mod common;

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::description;
use common::models::Run;

const CONTROLLERS: [&str; 3] = ["L1NonlinearSiso", "L1ActuatedSiso", "L1TwoLinkRobot"];

/// A controller with further lines in its `[structure]` and its `[start]`. The robot's has the slower poles of its case 2.
fn controller(name: &str, structure: &str, start: &str) -> Run {
    let text = description(name)
        .replace("[structure]", &format!("[structure]\n{structure}"))
        .replace("[-300.0, -300.0, -400.0, -400.0]", "[-30.0, -30.0, -40.0, -40.0]");
    let model = Model::from_description(Description::read(&format!("{text}\n{start}")).unwrap(), REGISTRY).unwrap();
    let mut run = Run(Execution::new(model));
    run.0.initialise().unwrap();
    run
}

fn count(run: &Run, name: &str) -> usize {
    (1..).take_while(|i| run.0.model().variables().find(&format!("{name}[{i}]")).is_some()).count()
}

/// The controller in a loop with a chain of two integrators a channel, which is disturbed and of another input gain than
/// nominal; what the error of a step is judged by, at the end of so many steps.
fn judged(run: &mut Run, steps: usize, step: f64) -> Vec<f64> {
    let (n, m) = (count(run, "x"), count(run, "r"));
    for k in 0..steps {
        let t = k as f64 * step;
        for i in 1..=m {
            let (position, rate) = (format!("x[{i}]"), format!("x[{}]", n - m + i));
            let [x, v, u] = [&position, &rate, &format!("u[{i}]")].map(|name| run.get(name));
            let acceleration = 1.3 * u + 0.5 * (3.0 * t).sin() + 0.2 * x - 0.3 * v * x;
            run.set(&position, x + step * v);
            run.set(&rate, v + step * acceleration);
            run.set(&format!("r[{i}]"), 0.4 * (2.0 * t + i as f64).cos());
        }
        run.step(step);
    }
    let indices = |name: &'static str, count: usize| (1..=count).map(move |i| format!("{name}[{i}]"));
    indices("x_hat", n).chain(indices("eta_hat", m)).chain(indices("u_ad", m)).map(|name| run.get(&name)).collect()
}

/// The largest difference, relative to each value or 1.
fn difference(found: &[f64], expected: &[f64]) -> f64 {
    let relative = |(found, expected): (&f64, &f64)| (found - expected).abs() / expected.abs().max(1.0);
    found.iter().zip(expected).map(relative).fold(0.0, f64::max)
}

/// That the closed form converges to the equations as its tolerance is tightened.
fn assert_converges(name: &str, structure: &str, start: &str, step: f64) {
    let steps = (0.2 / step) as usize;
    let general = format!("{start}\nintegration_method = 'explicit'\nrelative_tolerance = 1e-10");
    let expected = judged(&mut controller(name, structure, &general), steps, step);
    let error = |tolerance: f64| {
        let start = format!("{start}\nadaptation_tolerance = {tolerance:e}");
        difference(&judged(&mut controller(name, structure, &start), steps, step), &expected)
    };
    let [coarse, medium, fine] = [1e-3, 1e-5, 1e-7].map(error);
    println!("{name} {} H = {step}: {coarse:.1e} {medium:.1e} {fine:.1e}", start.replace("\n", "; "));
    assert!(coarse < 1e-2 && medium < 1e-3 && fine < 1e-4, "{name}, {start}: {coarse:e}, {medium:e}, {fine:e}");
}

#[test]
fn it_is_the_solution_of_the_equations() {
    for name in CONTROLLERS {
        assert_converges(name, "", "", 1e-3);
        assert_converges(name, "", "", 1e-4);
    }
}

#[test]
fn it_follows_inputs_that_change_within_a_step() {
    for name in CONTROLLERS {
        assert_converges(name, "", "input_handling = 'extrapolate'", 1e-3);
    }
}

#[test]
fn it_knows_the_limits_of_the_control() {
    for (name, lo, hi) in [
        ("L1NonlinearSiso", "[-0.1]", "[0.1]"),
        ("L1ActuatedSiso", "[-20.0]", "[30.0]"),
        ("L1TwoLinkRobot", "[-100.0, -20.0]", "[50.0, 300.0]"),
    ] {
        for handling in ["hold", "extrapolate"] {
            let start = format!("u_min = {lo}\nu_max = {hi}\ninput_handling = '{handling}'");
            assert_converges(name, "", &start, 1e-3);
        }
    }
}

#[test]
fn it_is_that_of_any_filter_and_regressor() {
    let filter = "filter = { denominator = [[1.0, 0.0], [0.01, 1.0], [1e-4, 0.015, 1.0]], numerator = [[0.005, 1.0]] }";
    for name in CONTROLLERS {
        assert_converges(name, filter, "", 1e-3);
    }
}

#[test]
fn it_needs_few_steps_where_the_equations_need_many() {
    // The adaptation turns through some 20 rad in a communication step.
    let mut run = controller("L1ActuatedSiso", "", "");
    judged(&mut run, 500, 1e-3);
    assert!(run.get("adaptation_frequency") * 1e-3 > 3.0);
    assert!(run.get("#substep") >= 1e-3, "a communication step is one step: {}", run.get("#substep"));
}
