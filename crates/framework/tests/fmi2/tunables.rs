//! Tunable parameters are one transaction: masters set them one by one, through combinations that are invalid. What
//! counts is the set that stands when the next step begins.

use common::loops::{Loop, STEP};
use common::*;

/// Two loops that ran alike up to step 500.
fn twins() -> [Loop; 2] {
    let twins = [Loop::started(), Loop::started()];
    twins.iter().for_each(|units| units.run(0..500));
    twins
}

const NOW: f64 = 500.0 * STEP;

fn warnings(unit: &Unit) -> Vec<String> {
    let projection = unit.messages().into_iter().filter(|(_, category, _)| category == "logProjection");
    projection.map(|(_, _, text)| text).collect()
}

#[test]
fn bounds_may_cross_while_they_are_being_set() {
    let [tuned, twin] = twins();
    for units in [&tuned, &twin] {
        units.controller.put("omega_max[1,1]", 6.0);
    }
    // Through an invalid combination: the lower bound is above the upper one for a while.
    tuned.controller.put("omega_min[1,1]", 8.0);
    tuned.controller.put("omega_min[1,1]", 0.25);
    twin.controller.put("omega_min[1,1]", 0.25);
    for units in [&tuned, &twin] {
        units.run(500..600);
    }
    assert_eq!(tuned.fingerprint(), twin.fingerprint());
    assert_eq!(tuned.controller.get("omega_min[1,1]"), 0.25);
}

#[test]
fn an_invalid_set_is_refused_at_the_step_and_leaves_no_trace() {
    let [attempting, twin] = twins();
    let unit = &attempting.controller;
    let old = unit.get("omega_min[1,1]");
    unit.put("omega_min[1,1]", 8.0);
    unit.put("adaptation_gain", 2e5);
    assert_eq!(unit.get("omega_min[1,1]"), 8.0, "until the step, what was set reads back");
    assert_eq!(unit.step(NOW, STEP), ERROR);
    let message = unit.last_message();
    ["fmi2DoStep", "omega_min[1,1]", "omega_max[1,1]", "8"]
        .iter()
        .for_each(|name| assert!(message.contains(name), "`{message}` names {name}"));
    assert_eq!(unit.last_successful_time(), twin.controller.last_successful_time(), "time did not advance");
    assert_eq!(unit.get("omega_min[1,1]"), old, "the last valid set is in force");
    assert_eq!(unit.get("adaptation_gain"), 1e5, "as a whole");
    assert_eq!(attempting.fingerprint(), twin.fingerprint());
    for units in [&attempting, &twin] {
        units.run(500..700);
    }
    assert_eq!(attempting.fingerprint(), twin.fingerprint(), "and it goes on as if nothing had been tried");
}

#[test]
fn every_reason_of_a_refused_set_is_named_at_once() {
    let [units, _] = twins();
    let unit = &units.controller;
    unit.put("theta_bound[1]", -1.0);
    unit.put("adaptation_gain", 0.0);
    assert_eq!(unit.step(NOW, STEP), ERROR);
    let message = unit.last_message();
    assert!(message.contains("theta_bound[1] = -1") && message.contains("adaptation_gain = 0"), "{message}");
    unit.put("omega_min[1,1]", 8.0);
    unit.put("A_m[2,1]", 1.0);
    assert_eq!(unit.step(NOW, STEP), ERROR);
    let message = unit.last_message();
    assert!(message.contains("omega_min[1,1]") && message.contains("Hurwitz"), "{message}");
}

#[test]
fn a_matrix_that_is_not_hurwitz_is_refused_with_its_eigenvalues() {
    let [units, twin] = twins();
    let unit = &units.controller;
    unit.put("A_m[2,1]", 1.0);
    assert_eq!(unit.step(NOW, STEP), ERROR);
    // s² + 1.4 s − 1 = 0 has the roots −0.7 ± √1.49 = 0.5206555…, −1.9206555….
    let message = unit.last_message();
    for part in ["A_m", "Hurwitz", "0.5206", "-1.9206"] {
        assert!(message.contains(part), "`{message}` names {part}");
    }
    assert_eq!(unit.fingerprint(), twin.controller.fingerprint());
}

#[test]
fn estimates_outside_tightened_bounds_are_brought_to_them_and_logged() {
    let [units, _] = twins();
    let unit = &units.controller;
    let (theta, sigma) = (unit.get("theta_hat[1,1]"), unit.get("sigma_hat[1]"));
    assert!(theta != 0.0 && sigma.abs() > 1e-3, "the loop has adapted: {theta} {sigma}");
    let bound = sigma.abs() / 2.0;
    unit.put("theta_bound[1]", 0.0);
    unit.put("sigma_bound[1]", bound);
    unit.messages();
    assert_eq!(unit.get("theta_hat[1,1]"), theta, "not before the step");
    assert_eq!(unit.step(NOW, STEP), OK);
    assert_eq!(unit.get("theta_hat[1,1]"), 0.0, "bounds that coincide freeze the estimate between them");
    assert!(unit.get("sigma_hat[1]").abs() <= bound * (1.0 + 1e-9));
    let logged = warnings(unit);
    assert!(logged.len() == 2 && logged[0].contains("moved to them") && logged[1].contains("at a bound"), "{logged:?}");
    assert_eq!(unit.step(NOW + STEP, STEP), OK);
    assert!(warnings(unit).is_empty(), "once");
}

#[test]
fn wider_bounds_bring_no_estimate_anywhere_and_log_nothing() {
    let [tuned, twin] = twins();
    tuned.controller.messages();
    tuned.controller.put("theta_bound[1]", 20.0);
    assert_eq!(tuned.controller.step(NOW, 1e-9), OK);
    assert!(warnings(&tuned.controller).is_empty());
    let (a, b) = (tuned.controller.get("sigma_hat[1]"), twin.controller.get("sigma_hat[1]"));
    assert!((a - b).abs() < 1e-3 * b.abs().max(1.0), "{a} {b}");
}

#[test]
fn parameters_set_to_the_values_they_have_change_nothing() {
    let [tuned, twin] = twins();
    for name in ["omega_min[1,1]", "adaptation_gain", "A_m[2,2]", "Q[1,1]"] {
        tuned.controller.put(name, tuned.controller.get(name));
    }
    for units in [&tuned, &twin] {
        units.run(500..600);
    }
    assert_eq!(tuned.fingerprint(), twin.fingerprint());
}

#[test]
fn prepared_quantities_follow_tuned_parameters_at_the_step() {
    let [units, _] = twins();
    let unit = &units.controller;
    let p = unit.get("P[2,2]");
    unit.put("Q[1,1]", 2.0);
    unit.put("Q[2,2]", 2.0);
    assert_eq!(unit.get("P[2,2]"), p, "not before");
    assert_eq!(unit.step(NOW, STEP), OK);
    assert!((unit.get("P[2,2]") - 2.0 * p).abs() < 1e-12);
}

#[test]
fn a_fixed_parameter_is_refused_after_initialisation() {
    let units = Loop::started();
    units.run(0..3);
    units.controller.refuses(&["fmi2SetReal", "`relative_tolerance`", "fixed"], |u| u.set("relative_tolerance", 1e-7));
    units.controller.refuses(&["fmi2SetInteger", "`input_handling`"], |u| u.set_integer("input_handling", 2));
    units.plant.refuses(&["fmi2SetReal", "`x0[1]`", "fixed"], |unit| unit.set("x0[1]", 1.0));
    units
        .plant
        .refuses(&["`x0[1]`"], |unit| unit.set_reals(&[unit.reference("omega"), unit.reference("x0[1]")], &[3.0, 1.0]));
}

#[test]
fn a_set_refused_before_the_first_step_leaves_the_start_as_it_was() {
    let [tried, twin] = [Unit::started("L1NonlinearSiso"), Unit::started("L1NonlinearSiso")];
    tried.put("adaptation_gain", -1.0);
    assert_eq!(tried.step(0.0, STEP), ERROR);
    for unit in [&tried, &twin] {
        unit.put("r[1]", 1.0);
        unit.run(0.0, 50, STEP);
    }
    assert_eq!(tried.fingerprint(), twin.fingerprint());
}

#[test]
fn a_step_refused_for_its_arguments_does_not_take_parameters_over() {
    let [units, _] = twins();
    let unit = &units.controller;
    unit.put("omega_min[1,1]", 8.0);
    unit.refuses(&["communicationStepSize"], |unit| unit.step(NOW, -1.0));
    assert_eq!(unit.get("omega_min[1,1]"), 8.0, "still being set");
    unit.put("omega_min[1,1]", 0.4);
    assert_eq!(unit.step(NOW, STEP), OK);
}

#[test]
fn a_step_that_fails_takes_nothing_over() {
    let [units, _] = twins();
    let unit = &units.controller;
    unit.put("theta_bound[1]", 0.0);
    unit.put("Q[1,1]", 3.0);
    // No number is large enough for the square of this one.
    unit.put("x[1]", 1e200);
    let before = unit.values();
    assert!(unit.get("theta_hat[1,1]") != 0.0);
    assert_eq!(unit.step(NOW, STEP), ERROR);
    assert_eq!(unit.values(), before, "values are as before the failed step, estimates and P included");
}

#[test]
fn bounds_tuned_while_running_need_not_hold_an_estimates_start_value() {
    let [units, _] = twins();
    let unit = &units.controller;
    // The plant's input gain is 2 ± 0.2; the estimate has long left its start value of 1.
    unit.put("omega_min[1,1]", 1.75);
    unit.put("omega_max[1,1]", 2.25);
    assert_eq!(unit.step(NOW, STEP), OK, "{:?}", unit.messages());
    assert!((1.75..=2.25).contains(&unit.get("omega_hat[1,1]")), "{}", unit.get("omega_hat[1,1]"));
}

#[test]
fn parameters_from_which_nothing_finite_follows_are_refused_and_the_last_ones_stay() {
    let unit = Unit::started("L1NonlinearSiso");
    unit.run(0.0, 10, 1e-3);
    for name in ["Q[1,1]", "Q[2,2]"] {
        assert_eq!(unit.set(name, 1e308), OK);
    }
    assert_eq!(unit.step(0.01, 1e-3), ERROR);
    let message = unit.last_message();
    assert!(message.contains("must be finite") || message.contains("too badly scaled"), "{message}");
    assert_eq!(unit.get("Q[1,1]"), 1.0);
    unit.run(0.01, 10, 1e-3);
}
