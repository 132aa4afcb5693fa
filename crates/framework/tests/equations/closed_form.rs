//! The closed-form step of L1 controllers, against error-controlled integration of their equations.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::description;
use common::models::Run;

const CONTROLLERS: [&str; 4] = ["L1NonlinearSiso", "L1ActuatedSiso", "L1TwoLinkRobot", "FuzzyL1ActuatedSiso"];

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

/// The controller in a loop, as [`run_on`]; what the error of a step is judged by, at the end of so many steps.
fn judged(run: &mut Run, steps: usize, step: f64) -> Vec<f64> {
    run_on(run, 0..steps, step);
    outcome(run)
}

/// Runs the controller in a loop with a chain of two integrators a channel, which is disturbed and of another input gain
/// than nominal.
fn run_on(run: &mut Run, steps: std::ops::Range<usize>, step: f64) {
    let (n, m) = (count(run, "x"), count(run, "r"));
    for k in steps {
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
}

/// Values that determine the error of a step.
fn outcome(run: &Run) -> Vec<f64> {
    let (n, m) = (count(run, "x"), count(run, "r"));
    let indices = |name: &'static str, count: usize| (1..=count).map(move |i| format!("{name}[{i}]"));
    indices("x_hat", n).chain(indices("eta_hat", m)).chain(indices("u_ad", m)).map(|name| run.get(&name)).collect()
}

/// The largest difference, relative to each value or 1.
fn difference(found: &[f64], expected: &[f64]) -> f64 {
    let relative = |(found, expected): (&f64, &f64)| (found - expected).abs() / expected.abs().max(1.0);
    found.iter().zip(expected).map(relative).fold(0.0, f64::max)
}

/// The errors of what a run does by the closed form, as its tolerance is tightened.
fn errors(run: impl Fn(&mut Run) -> Vec<f64>, name: &str, structure: &str, start: &str) -> [f64; 3] {
    let general = format!("{start}\nintegration_method = 'explicit'\nrelative_tolerance = 1e-10");
    let expected = run(&mut controller(name, structure, &general));
    let errors = [1e-4, 1e-6, 1e-8].map(|tolerance| {
        // Wherever it is possible, also where it takes more work than a general method.
        let start = format!("{start}\nclosed_form_phase = 0.0\nrelative_tolerance = {tolerance:e}");
        difference(&run(&mut controller(name, structure, &start)), &expected)
    });
    println!("{name} {}: {errors:?}", start.replace("\n", "; "));
    errors
}

/// Asserts that the closed form converges to the equations as its tolerance decreases.
fn assert_converges(name: &str, structure: &str, start: &str, step: f64) {
    let errors = errors(|run| judged(run, (0.2 / step) as usize, step), name, structure, start);
    let [coarse, medium, fine] = errors;
    assert!(coarse < 1e-2 && medium < 1e-4 && fine < 1e-5, "{name}, {start}, H = {step}: {errors:?}");
}

/// The same with repeated transients that carry the errors of many steps along. The error decreases at least with the
/// root of the tolerance, within the accuracy of the comparison.
fn assert_shrinks(run: impl Fn(&mut Run) -> Vec<f64>, name: &str, structure: &str, start: &str) {
    let errors = errors(run, name, structure, start);
    let [coarse, medium, fine] = errors;
    assert!(medium < 0.2 * coarse || medium < 1e-3, "{name}, {start}: {errors:?}");
    assert!(fine < 0.2 * medium || fine < 1e-4, "{name}, {start}: {errors:?}");
    assert!(coarse < 5e-2 && fine < 1e-3, "{name}, {start}: {errors:?}");
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
        ("L1ActuatedSiso", "[-1.0]", "[3.0]"),
        ("L1ActuatedSiso", "[-4.0]", "[10.0]"),
        ("L1TwoLinkRobot", "[-100.0, -20.0]", "[50.0, 300.0]"),
    ] {
        for handling in ["hold", "extrapolate"] {
            let handling = format!("input_handling = '{handling}'");
            let start = format!("u_min = {lo}\nu_max = {hi}\n{handling}");
            assert_converges(name, "", &start, 1e-3);
            let [limited, free] = [&start, &handling].map(|start| judged(&mut controller(name, "", start), 200, 1e-3));
            assert!(difference(&limited, &free) > 1e-2, "{name}: the limits matter");
        }
    }
}

#[test]
fn it_follows_what_the_limits_leave_at_the_given_speed() {
    let filter = "filter = { denominator = [[1.0, 0.0], [0.01, 1.0]], numerator = [[0.005, 1.0]], gain = 1.5 }";
    for (name, lo, hi) in
        [("L1ActuatedSiso", -1.0, 3.0), ("FuzzyL1ActuatedSiso", -2.0, 3.0), ("L1TwoLinkRobot", -20.0, 10.0)]
    {
        let m = if name == "L1TwoLinkRobot" { 2 } else { 1 };
        let all = |value: f64| format!("{:?}", vec![value; m]);
        for (structure, time) in [("", 0.0), ("", 0.02), (filter, -1.0), (filter, 0.02), (filter, 1e-4)] {
            let limits = format!("u_min = {}\nu_max = {}\ninput_handling = 'extrapolate'", all(lo), all(hi));
            let start = format!("{limits}\ntracking_time = {}", all(time));
            assert_converges(name, structure, &start, 1e-3);
            let [on, off] =
                [&start, &format!("{limits}\ntracking_time = {}", all(if time == 0.0 { 0.02 } else { 0.0 }))]
                    .map(|start| judged(&mut controller(name, structure, start), 200, 1e-3));
            assert!(difference(&on, &off) > 1e-2, "{name}, {time}: it matters");
        }
    }
}

#[test]
fn it_follows_what_the_limits_leave_where_the_control_shows_unmatched_uncertainty_at_once() {
    // The twin rotor's D(s) H_m⁻¹ H_um isn't strictly proper; at a constant state, its control goes to its limits.
    let at_limit = |run: &mut Run| {
        for k in 0..100 {
            let t = 1e-3 * f64::from(k);
            (1..=6).for_each(|i| run.set(&format!("x[{i}]"), 0.05 * (3.0 * t + f64::from(i)).sin()));
            (1..=2).for_each(|i| run.set(&format!("r[{i}]"), 0.3 * (9.0 * t + f64::from(i)).cos()));
            run.step(1e-3);
        }
        outcome(run)
    };
    let at_once = controller("L1TwinRotor", "", "").0.model().variables().find("u_ad[1]").unwrap().variable.section;
    assert_eq!(at_once, adaptive_fmu::system::Section::Signal, "u_ad is more than the filter's state");
    for time in ["[-1.0, -1.0]", "[0.01, 0.02]"] {
        let limits = "u_min = [-0.2, -0.1]\nu_max = [0.3, 0.1]\ninput_handling = 'extrapolate'";
        assert_shrinks(at_limit, "L1TwinRotor", "", &format!("{limits}\ntracking_time = {time}"));
        let [on, off] = [time, "[0.0, 0.0]"]
            .map(|time| at_limit(&mut controller("L1TwinRotor", "", &format!("{limits}\ntracking_time = {time}"))));
        assert!(difference(&on, &off) > 1e-2, "{time}: it matters");
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
    let mut run = controller("L1ActuatedSiso", "", "closed_form_phase = 0.0\nrelative_tolerance = 1e-3");
    judged(&mut run, 500, 1e-3);
    assert!(run.get("adaptation_frequency") * 1e-3 > 3.0);
    assert!(run.get("#own substep") >= 1e-3, "a communication step is one step: {}", run.get("#own substep"));
}

/// Reference and manual control that change while the controller is not in command; then it takes over.
fn taking_over(run: &mut Run) -> Vec<f64> {
    run.set_boolean("enabled", false);
    let m = count(run, "r");
    for k in 0..100 {
        (1..=m).for_each(|i| run.set(&format!("u_manual[{i}]"), (0.05 * (k + i) as f64).sin()));
        run_on(run, k..k + 1, 1e-3);
    }
    let mut found = outcome(run);
    run.set_boolean("enabled", true);
    run_on(run, 100..200, 1e-3);
    found.extend(outcome(run));
    found
}

#[test]
fn it_follows_the_manual_control_and_takes_over() {
    for name in CONTROLLERS {
        for handling in ["hold", "extrapolate", "interpolate"] {
            assert_shrinks(taking_over, name, "", &format!("input_handling = '{handling}'"));
        }
    }
}

#[test]
fn it_takes_over_with_limits_and_a_filter() {
    let filter = "filter = { denominator = [[1.0, 0.0], [0.01, 1.0]] }";
    for (name, limit) in [("L1NonlinearSiso", "[0.4]"), ("L1ActuatedSiso", "[0.4]"), ("L1TwoLinkRobot", "[0.4, 0.4]")] {
        let start = format!("u_max = {limit}\ninput_handling = 'extrapolate'");
        assert_shrinks(taking_over, name, filter, &start);
    }
}

#[test]
fn gains_may_be_tuned_between_steps() {
    for name in CONTROLLERS {
        let tuned = |run: &mut Run| {
            for k in 0..200 {
                run.set("feedback_gain[1,1]", if k % 20 < 10 { 15.0 } else { 25.0 });
                run.set("adaptation_gain", if k % 14 < 7 { 4e4 } else { 2e5 });
                run_on(run, k..k + 1, 1e-3);
            }
            outcome(run)
        };
        assert_shrinks(tuned, name, "", "");
    }
}

#[test]
fn a_restored_state_continues_bit_for_bit() {
    for name in CONTROLLERS {
        for handling in ["hold", "extrapolate"] {
            let made = || controller(name, "", &format!("input_handling = '{handling}'"));
            let mut run = made();
            run_on(&mut run, 0..77, 1e-3);
            let saved = run.0.block().clone();
            run_on(&mut run, 77..150, 1e-3);
            let end = run.0.block().clone();
            // In the same instance, and in one that never ran.
            for mut other in [run, made()] {
                other.0.block_mut().copy_from(&saved);
                run_on(&mut other, 77..150, 1e-3);
                assert!(other.0.block() == &end, "{name}, {handling}");
            }
        }
    }
}

#[test]
fn a_step_may_be_as_short_as_a_nanosecond() {
    let step = 1e-9;
    for name in CONTROLLERS {
        for enabled in [true, false] {
            let mut run = controller(name, "", "");
            run_on(&mut run, 0..100, 1e-3);
            run.set_boolean("enabled", enabled);
            run.step(step);
            let states: Vec<_> = run.0.model().variables().visible().map(|e| e.name()).collect();
            let states: Vec<_> =
                states.iter().filter_map(|name| name.strip_prefix("der(")?.strip_suffix(')')).collect();
            let before: Vec<_> = states.iter().map(|x| (run.get(x), run.get(&format!("der({x})")))).collect();
            run.step(step);
            for (x, (value, rate)) in states.iter().zip(before) {
                let error = run.get(x) - value - rate * step;
                let rounding = 4.0 * f64::EPSILON * value.abs();
                assert!(
                    error.abs() < 1e-3 * rate.abs() * step + rounding,
                    "{name}: {x} = {value} by {rate}: {error:e}"
                );
            }
        }
    }
}

#[test]
fn a_step_may_be_as_long_as_a_second() {
    for name in CONTROLLERS {
        let long = |start: &str| {
            let mut run = controller(name, "", start);
            (1..=count(&run, "x")).for_each(|i| run.set(&format!("x[{i}]"), 0.01 * i as f64));
            run.set("r[1]", 0.1);
            run.step(1.0);
            outcome(&run)
        };
        let expected = long("integration_method = 'explicit'\nrelative_tolerance = 1e-10");
        let error = difference(&long("relative_tolerance = 1e-9"), &expected);
        println!("{name}: {error:.1e}");
        assert!(error < 1e-3, "{name}: {error:e}");
    }
}

#[test]
fn the_tightest_of_all_tolerances_rules() {
    // By the length of its steps: a communication step is one step, within 1e-3.
    let substep = |relative: f64, own: f64, by_master: Option<f64>| {
        let start =
            format!("closed_form_phase = 0.0\nrelative_tolerance = {relative:e}\nadaptation_tolerance = {own:e}");
        let mut run = controller("L1ActuatedSiso", "", &start);
        by_master.into_iter().for_each(|tolerance| run.0.set_tolerance(tolerance));
        judged(&mut run, 500, 1e-3);
        run.get("#own substep")
    };
    let loose = substep(1e-3, 1e-3, None);
    let tight = [substep(1e-6, 1e-3, None), substep(1e-3, 1e-6, None), substep(1e-3, 1e-3, Some(1e-6))];
    assert!(tight.iter().all(|&tight| tight < 0.2 * loose), "{tight:?}, {loose}");
    // None loosens another.
    assert_eq!(substep(1e-3, 1.0, Some(1e-2)), loose);
}
