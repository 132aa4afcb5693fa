//! L1 control with unmatched uncertainty, and of plants in the units of their commands: what it cancels, and its closed
//! form against error-controlled integration of the same equations.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::description;
use common::models::Run;

/// Each controller with its plant. `zeros`: outputs for which H_m has a transmission zero.
const LOOPS: [(&str, &str); 6] = [
    ("L1UnmatchedMimo", "UnmatchedMimo"),
    ("L1UnmatchedMimo, zeros", "UnmatchedMimo"),
    ("L1TwinRotor", "TwinRotor"),
    ("L1MaresAuv", "MaresAuv"),
    ("L1CoupledMimo", "CoupledMimo"),
    ("L1Quadrotor", "Quadrotor"),
];

/// A unit with further start values.
fn unit(name: &str, start: &str) -> Run {
    let (name, zeros) = name.split_once(',').map_or((name, false), |(name, _)| (name, true));
    let mut text = description(name);
    if zeros {
        // y_2 = x_2 + x_3 / 2 is zero while x_2 decays with −2.
        text = text.replace("[0.0, 1.0, 0.0]]\nunmatched", "[0.0, 1.0, 0.5]]\nunmatched");
        assert!(text.contains("0.5]]"));
    }
    // Its own bounds leave the start of omega_hat hardly any room outside the layer in which projection acts.
    text =
        text.replace("omega_max = [20.0, 20.0, 20.0, 20.0, 20.0, 20.0]", "omega_max = [3.0, 3.0, 3.0, 3.0, 3.0, 3.0]");
    let model = Model::from_description(Description::read(&format!("{text}\n{start}")).unwrap(), REGISTRY).unwrap();
    let mut run = Run(Execution::new(model));
    run.0.initialise().unwrap();
    run
}

fn count(run: &Run, name: &str) -> usize {
    (1..).take_while(|i| run.0.model().variables().find(&format!("{name}[{i}]")).is_some()).count()
}

/// Hands values of one unit on to another.
fn hand_on(from: &Run, output: &str, to: &mut Run, input: &str) {
    for i in 1..=count(to, input) {
        to.set(&format!("{input}[{i}]"), from.get(&format!("{output}[{i}]")));
    }
}

/// Final states, control and estimates of the loop.
fn outcome((controller, plant): (&str, &str), start: &str, steps: usize, step: f64) -> Vec<f64> {
    let (mut controller, mut plant) = (unit(controller, start), unit(plant, ""));
    for k in 0..steps {
        hand_on(&plant, "x", &mut controller, "x");
        for i in 1..=count(&controller, "r") {
            controller.set(&format!("r[{i}]"), 0.2 * (1.5 * k as f64 * step + i as f64).sin());
        }
        controller.step(step);
        hand_on(&controller, "u", &mut plant, "u");
        plant.step(step);
    }
    let of =
        |run: &Run, name: &str| (1..=count(run, name)).map(|i| run.get(&format!("{name}[{i}]"))).collect::<Vec<_>>();
    let mut found = of(&plant, "x");
    ["x_hat", "u_ad", "eta_hat", "eta_hat_unmatched", "u"].iter().for_each(|name| found.extend(of(&controller, name)));
    found
}

/// The largest difference, relative to each value or 1.
fn difference(found: &[f64], expected: &[f64]) -> f64 {
    let relative = |(found, expected): (&f64, &f64)| (found - expected).abs() / expected.abs().max(1.0);
    found.iter().zip(expected).map(relative).fold(0.0, f64::max)
}

fn assert_converges(units: (&str, &str), start: &str, step: f64) {
    let of = |settings: &str| outcome(units, &format!("{start}\n{settings}"), (0.2 / step) as usize, step);
    let expected = of("integration_method = 'explicit'\nrelative_tolerance = 1e-10");
    let errors = [1e-4, 1e-6, 1e-8].map(|tolerance| {
        // A general method goes on where an estimate may be projected.
        difference(&of(&format!("closed_form_phase = 0.0\nrelative_tolerance = {tolerance:e}")), &expected)
    });
    println!("{units:?} {start}: {errors:?}");
    let [coarse, medium, fine] = errors;
    assert!(coarse < 1e-2 && medium < 1e-4 && fine < 1e-5, "{units:?}, {start}, H = {step}: {errors:?}");
}

#[test]
fn the_closed_form_is_the_solution_of_the_equations() {
    for units in LOOPS {
        assert_converges(units, "", 1e-3);
    }
}

#[test]
fn the_closed_form_follows_inputs_that_change_within_a_step() {
    for units in LOOPS {
        assert_converges(units, "input_handling = 'extrapolate'", 1e-3);
    }
}

#[test]
fn the_closed_form_is_taken() {
    for units in LOOPS {
        let [closed, general] = ["automatic", "explicit"].map(|method| {
            let settings = format!("input_handling = 'extrapolate'\nintegration_method = '{method}'");
            outcome(units, &format!("{settings}\nclosed_form_phase = 0.0"), 200, 1e-3)
        });
        assert_ne!(closed, general, "{units:?}");
    }
}

/// A linear plant x' = A x + B u + B_um d(t), in so small steps of Euler's method that their error doesn't show: the
/// largest magnitude of its outputs in the second half of the time, with references of zero.
fn largest_output(controller: &mut Run, zeros: bool, end: f64) -> f64 {
    let dynamics = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.8]];
    let (mut x, step, substeps) = ([0.0_f64; 3], 1e-3, 20);
    let mut worst = 0.0_f64;
    for k in 0..(end / step) as usize {
        (0..3).for_each(|i| controller.set(&format!("x[{}]", i + 1), x[i]));
        controller.step(step);
        let u = [controller.get("u[1]"), controller.get("u[2]")];
        for j in 0..substeps {
            let h = step / f64::from(substeps);
            let d = 0.4 + 0.6 * (0.3 * (k as f64 * step + f64::from(j) * h)).sin();
            let input = [u[0], d, u[0] + u[1]];
            let rate: [f64; 3] =
                std::array::from_fn(|i| dynamics[i].iter().zip(&x).map(|(a, x)| a * x).sum::<f64>() + input[i]);
            (0..3).for_each(|i| x[i] += h * rate[i]);
        }
        if k as f64 * step > 0.5 * end {
            worst = worst.max(x[0].abs()).max((x[1] + if zeros { 0.5 * x[2] } else { 0.0 }).abs());
        }
    }
    worst
}

#[test]
fn a_slow_unmatched_disturbance_is_cancelled_in_the_outputs() {
    for name in ["L1UnmatchedMimo", "L1UnmatchedMimo, zeros"] {
        let zeros = name.contains("zeros");
        let cancelled = largest_output(&mut unit(name, ""), zeros, 60.0);
        let mut blind = unit(name, "");
        ["theta_bound_unmatched[1]", "sigma_bound_unmatched[1]"].iter().for_each(|bound| blind.set(bound, 0.0));
        let left = largest_output(&mut blind, zeros, 60.0);
        println!("{name}: {cancelled}, {left} without");
        assert!(cancelled < 0.1 * left && left > 0.5, "{name}: {cancelled}, {left} without");
    }
}
