//! The fuzzy feedback gain of an L1 controller, as its user sees it.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::described::refused;
use common::models::Run;
use common::{OK, Unit, description};

const NAME: &str = "FuzzyL1ActuatedSiso";

/// A controller with further lines in its `[start]`, started at this reference, rate of it, and measured state.
fn at(start: &str, values: [f64; 4]) -> Run {
    let inputs: Vec<_> = ["r[1]", "dr[1]", "x[1]", "x[2]"].into_iter().zip(values).collect();
    started(&format!("{}\n{start}", description(NAME)), &inputs)
}

fn started(text: &str, inputs: &[(&str, f64)]) -> Run {
    let mut run = Run(Execution::new(Model::from_description(Description::read(text).unwrap(), REGISTRY).unwrap()));
    inputs.iter().for_each(|(name, value)| run.set(name, *value));
    run.0.initialise().unwrap();
    run
}

/// The description with one text in it replaced.
fn with(old: &str, new: &str) -> String {
    let text = description(NAME);
    assert!(text.contains(old), "`{old}` is in the description");
    text.replace(old, new)
}

#[test]
fn where_the_error_is_small_the_gain_is_the_constant_one_and_else_the_fuzzy_one() {
    for (e, is_fuzzy) in [(0.0, false), (0.099, false), (-0.1, false), (0.101, true), (-3.0, true)] {
        let run = at("", [0.2 + e, 0.0, 0.2, 0.0]);
        let expected = if is_fuzzy { run.get("k_f") } else { 20.0 };
        assert_eq!(run.get("gain_in_force[1,1]"), expected, "e = {e}");
        assert!(run.get("k_f") < 20.0);
    }
    let inverse = at("fuzzy_output = 'inverse_gain'", [1.0, 0.0, 0.0, 0.0]);
    assert_eq!(inverse.get("gain_in_force[1,1]"), 1.0 / inverse.get("k_f"));
}

#[test]
fn without_inference_the_gain_has_two_levels() {
    for (e, gain) in [(0.09, 20.0), (0.11, 0.7), (3.0, 0.7)] {
        let run = at("fuzzy_output = 'constant'\nconstant_gain = 0.7", [e, 4.0, 0.0, 0.0]);
        assert_eq!((run.get("k_f"), run.get("gain_in_force[1,1]")), (0.7, gain), "e = {e}");
    }
}

#[test]
fn the_gain_grows_with_the_error_and_with_its_rate() {
    let k_f = |values| at("", values).get("k_f");
    // (low + centre + high) / 3 of the sets zero and very large.
    let [zero, very_large] = [(0.25 + 0.25 + 0.9) / 3.0, (6.0 + 10.0 + 10.0) / 3.0];
    assert!((k_f([0.0, 0.0, 0.0, 0.0]) - zero).abs() < 1e-14);
    assert!((k_f([30.0, 50.0, 0.0, 0.0]) - very_large).abs() < 1e-14);
    // k_p |e| and k_d |e'| are 0.31, the centre of very small, and 1.
    let [by_error, by_rate] = [k_f([3.1, 20.0, 0.0, 0.0]), k_f([10.0, 6.2, 0.0, 0.0])];
    assert!((by_error - by_rate).abs() < 1e-12 && zero < by_error && by_error <= very_large);
    // What counts is e' = dr - x2.
    assert_eq!(k_f([1.0, 8.0, 0.0, 3.0]), k_f([1.0, 0.0, 0.0, -5.0]));
    assert_eq!(k_f([1.0, 8.0, 0.0, 3.0]), k_f([-1.0, -5.0, 0.0, 0.0]));
}

#[test]
fn with_a_threshold_out_of_reach_it_is_the_plain_controller_bit_for_bit() {
    let [mut plain, mut fuzzy] = [started(&description("L1ActuatedSiso"), &[]), at("k_e = 1e6", [0.0; 4])];
    for k in 0..300 {
        let t = 1e-3 * f64::from(k);
        for run in [&mut plain, &mut fuzzy] {
            run.set("r[1]", (5.0 * t).cos());
            run.set("x[1]", 0.3 * (4.0 * t).sin());
            run.set("x[2]", 1.2 * (4.0 * t).cos());
            run.step(1e-3);
        }
        assert_eq!(plain.get("u[1]").to_bits(), fuzzy.get("u[1]").to_bits(), "step {k}");
    }
}

#[test]
fn neither_the_switch_nor_tuning_makes_the_control_jump() {
    // The control moves by its rate, which the gain scales: over a nanosecond next to nothing.
    let mut run = at("", [0.5, 0.0, 0.0, 0.0]);
    run.run(50, 1e-3);
    for (name, value, gain) in [("k_e", 2.0, 20.0), ("k_e", 0.1, f64::NAN), ("VL_c", 12.0, f64::NAN)] {
        run.set(name, value);
        let before = run.get("u[1]");
        run.step(1e-9);
        assert!((run.get("u[1]") - before).abs() < 1e-5, "{name}: {} after {before}", run.get("u[1]"));
        let expected = if gain.is_nan() { run.get("k_f") } else { gain };
        assert_eq!(run.get("gain_in_force[1,1]"), expected, "{name} = {value}");
    }
    // The error falls below the threshold.
    let before = run.get("u_ad[1]");
    run.set("r[1]", 0.05);
    run.step(1e-9);
    assert_eq!(run.get("gain_in_force[1,1]"), 20.0);
    assert!((run.get("u_ad[1]") - before).abs() < 1e-5, "{} after {before}", run.get("u_ad[1]"));
}

#[test]
fn the_switch_is_met_inside_a_step_when_inputs_move() {
    // The reference falls through the threshold in the middle of a long step.
    let ends = |step: f64, method: &str| {
        let start = format!("input_handling = 'extrapolate'\nadaptation_tolerance = 1e-8\n{method}");
        let mut run = at(&start, [0.11, -1.0, 0.0, 0.0]);
        let steps = (0.02 / step).round() as u32;
        for k in 0..steps {
            run.set("r[1]", 0.11 - step * f64::from(k));
            run.step(step);
        }
        assert_eq!(run.get("gain_in_force[1,1]"), 20.0, "{step}");
        run.get("u_ad[1]")
    };
    // One step of each is needed before its rate is known.
    let exact = ends(1e-4, "integration_method = 'explicit'\nrelative_tolerance = 1e-10");
    for method in ["", "integration_method = 'explicit'\nrelative_tolerance = 1e-10"] {
        let errors = [4e-3, 1e-3, 1e-4].map(|step| (ends(step, method) - exact).abs());
        assert!(errors[2] <= 1e-6 * exact.abs() && errors[1] <= 0.5 * errors[0], "{method}: {errors:?} of {exact}");
    }
}

#[test]
fn an_error_that_sweeps_over_both_thresholds_within_a_step_switches_twice() {
    // e goes from -0.25 to 0.72 within 10 µs. Between the thresholds -0.1 and 0.1 the gain is 20, and moves the
    // control.
    let swept = |parts: u32, method: i32| {
        let unit = Unit::new(NAME);
        assert_eq!(unit.set_integer("integration_method", method), OK);
        unit.start(0.0);
        unit.put("x[1]", 0.5);
        let step = 1e-5 / f64::from(parts);
        for k in 0..parts {
            unit.put("r[1]", 0.25 + 0.97e5 * f64::from(k) * step);
            assert_eq!(unit.set_slope("r[1]", 0.97e5), OK);
            assert_eq!(unit.step(f64::from(k) * step, step), OK);
        }
        unit.get("u_ad[1]")
    };
    let fine = swept(100, 2);
    for method in [1, 2, 3] {
        let whole = swept(1, method);
        assert!((whole - fine).abs() <= 1e-5 * fine.abs(), "method {method}: {whole}, in fine steps {fine}");
    }
}

#[test]
fn each_channel_has_a_gain_of_its_own() {
    let robot = description("L1TwoLinkRobot").replace("\"l1\"", "\"fuzzy-l1\"");
    let run = started(&robot, &[("r[1]", 0.05), ("r[2]", 2.5)]);
    let gain = |i: usize, j: usize| run.get(&format!("gain_in_force[{i},{j}]"));
    assert_eq!([gain(1, 1), gain(1, 2), gain(2, 1), gain(2, 2)], [30.0, 0.0, 0.0, run.get("k_f[2]")]);
    assert_ne!(run.get("k_f[1]"), run.get("k_f[2]"));
}

#[test]
fn sets_without_a_width_or_out_of_order_are_refused_with_their_numbers() {
    let fuzzy = |start: &str| format!("{}\n{start}", description(NAME));
    refused(&fuzzy("VS_l = 0.4\nS_l = 0.3"), &["VS_l = 0.4", "must be below S_l = 0.3"]);
    refused(&fuzzy("VL_l = 8.0\nVL_c = 8.0"), &["VL_l = 8", "must be below VL_c = 8"]);
    refused(&fuzzy("L_c = 2.9"), &["L_c = 2.9", "must be within 3 … 6"]);
    refused(
        &fuzzy("input_centre = [0.1, 0.5, 0.4, 0.8, 1.0]"),
        &["input_centre[2] = 0.5", "must be below input_centre[3] = 0.4"],
    );
}

#[test]
fn where_a_gain_that_changes_would_do_harm_the_description_is_refused() {
    let filter = "unmatched = true\nfilter = { denominator = [[1.0, 0.0], [0.01, 1.0]] }";
    refused(&with("input_gain", &format!("{filter}\ninput_gain")), &["unmatched = true", "jump"]);
    refused(&with("C = [[1.0, 0.0]]", "C = [[1.0, 1.0]]"), &["C B: largest entry = 1.000e0", "must be 0"]);
}
