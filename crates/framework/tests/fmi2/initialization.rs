//! Initialization Mode, and what may change after it. Masters differ: some set inputs there, some don't; some read
//! feedthrough outputs again after setting an input, some only after a step. All must get the same loop.

use adaptive_fmu_library::fmi2_functions::*;
use common::loops::{Loop, STEP};
use common::*;

/// Γ and the smallest eigenvalue that matters, (BᵀPB) = p22 = 1/1.4, of example 3.2.1.
const GAMMA: f64 = 1e5;
const P22: f64 = 1.0 / 1.4;

fn close(value: f64, expected: f64) -> bool {
    (value - expected).abs() <= 1e-12 * expected.abs().max(1.0)
}

#[test]
fn in_initialization_mode_every_get_follows_the_present_inputs() {
    let unit = Unit::new("L1NonlinearSiso");
    unit.enter(0.0);
    for x1 in [0.3, -0.7, 0.0, 0.3] {
        unit.put("x[1]", x1);
        unit.put("x[2]", 2.0 * x1);
        assert_eq!(unit.get("x_hat[1]"), x1, "the predictor starts at the measured state");
        assert_eq!(unit.get("x_hat[2]"), 2.0 * x1);
        let frequency = (GAMMA * P22 * (5.0 * x1 * x1 + 1.0)).sqrt();
        assert!(close(unit.get("adaptation_frequency"), frequency));
        assert_eq!(unit.get("u[1]"), 0.0);
    }
    unit.put("x[1]", 0.9);
    assert_eq!(unit.exit(), OK);
    assert_eq!(unit.get("x_hat[1]"), 0.9, "also what was set last and never read");
}

#[test]
fn in_initialization_mode_every_get_follows_the_present_parameters() {
    let unit = Unit::new("L1NonlinearSiso");
    unit.enter(0.0);
    assert!(close(unit.get("P[2,2]"), P22));
    unit.put("Q[1,1]", 3.0);
    unit.put("Q[2,2]", 3.0);
    assert!(close(unit.get("P[2,2]"), 3.0 * P22), "P is linear in Q");
    unit.put("Q[1,1]", 1.0);
    unit.put("Q[2,2]", 1.0);
    assert!(close(unit.get("P[1,2]"), 0.5));
    let plant = Unit::new("NonlinearSiso");
    plant.enter(0.0);
    for x0 in [1.0, -2.0] {
        plant.put("x0[1]", x0);
        assert_eq!(plant.get("x[1]"), x0);
        assert_eq!(plant.get("y[1]"), x0);
    }
}

#[test]
fn values_set_before_initialization_mode_count_too() {
    let unit = Unit::new("L1NonlinearSiso");
    unit.put("x[1]", 0.25);
    unit.put("Q[1,1]", 2.0);
    unit.start(0.0);
    assert_eq!(unit.get("x_hat[1]"), 0.25);
    // p11 = 1.4 p12 + p22 with p12 = q11/2 and p22 = (1/2 + p12)/1.4.
    assert!(close(unit.get("P[1,1]"), 1.4 + 1.5 / 1.4));
}

#[test]
fn a_start_that_is_refused_can_be_corrected_in_initialization_mode() {
    let unit = Unit::new("L1NonlinearSiso");
    unit.put("adaptation_gain", -1.0);
    unit.enter(0.0);
    assert_eq!(unit.try_get("u[1]", &mut 0.0), ERROR);
    let message = unit.last_message();
    assert!(message.contains("fmi2GetReal") && message.contains("adaptation_gain = -1"), "{message}");
    assert_eq!(unit.exit(), ERROR);
    let message = unit.last_message();
    assert!(message.contains("fmi2ExitInitializationMode") && message.contains("adaptation_gain = -1"), "{message}");
    unit.put("adaptation_gain", 1e5);
    assert_eq!(unit.exit(), OK, "{:?}", unit.messages());
    let never_wrong = Unit::started("L1NonlinearSiso");
    unit.run(0.0, 5, STEP);
    never_wrong.run(0.0, 5, STEP);
    assert_eq!(unit.fingerprint(), never_wrong.fingerprint());
}

/// Trajectory bits of the controller, fed by a plant that starts at (0.4, -0.3).
fn controller_trajectory(feed_in_initialization_mode: bool, feed_before_first_step: bool) -> Vec<Vec<u64>> {
    let units = Loop::new();
    units.plant.put("x0[1]", 0.4);
    units.plant.put("x0[2]", -0.3);
    units.reference.start(0.0);
    units.plant.start(0.0);
    units.controller.enter(0.0);
    if feed_in_initialization_mode {
        units.feed_controller();
        units.controller.get("x_hat[1]");
    }
    assert_eq!(units.controller.exit(), OK);
    if feed_before_first_step {
        units.feed_controller();
    }
    let mut trajectory = Vec::new();
    for k in 0..300 {
        let t = f64::from(k) * STEP;
        assert_eq!(units.controller.step(t, STEP), OK, "{:?}", units.controller.messages());
        trajectory.push(units.controller.values());
        assert_eq!(units.reference.step(t, STEP), OK);
        units.plant.put("u[1]", units.controller.get("u[1]"));
        assert_eq!(units.plant.step(t, STEP), OK);
        units.feed_controller();
    }
    trajectory
}

#[test]
fn masters_that_set_inputs_in_initialization_mode_and_masters_that_do_not_get_the_same_loop() {
    let both = controller_trajectory(true, true);
    assert_eq!(both, controller_trajectory(false, true), "inputs only before the first step");
    assert_eq!(both, controller_trajectory(true, false), "inputs only in Initialization Mode");
}

#[test]
fn the_first_step_starts_from_the_inputs_set_before_it() {
    let unit = Unit::started("L1NonlinearSiso");
    unit.put("x[1]", 0.5);
    assert_eq!(unit.get("x_hat[1]"), 0.0, "until the step, values are those of Initialization Mode");
    assert_eq!(unit.step(0.0, 1e-6), OK);
    // Within a microsecond x̂ moves by its rate, about 0.5, times that.
    assert!((unit.get("x_hat[1]") - 0.5).abs() < 2e-6, "{}", unit.get("x_hat[1]"));
}

/// Values of everything but inputs and parameters.
fn calculated(unit: &Unit) -> Vec<u64> {
    ["u[1]", "x_hat[1]", "x_hat[2]", "eta_hat[1]", "sigma_hat[1]", "omega_hat[1,1]", "adaptation_frequency", "P[1,1]"]
        .map(|name| unit.get(name).to_bits())
        .to_vec()
}

#[test]
fn after_initialization_mode_outputs_change_only_in_a_step() {
    let unit = Unit::started("L1NonlinearSiso");
    unit.put("r[1]", 1.0);
    unit.run(0.0, 20, STEP);
    let before = calculated(&unit);
    unit.put("x[1]", 0.77);
    unit.put("r[1]", -3.0);
    unit.put("Q[1,1]", 5.0);
    assert_eq!(unit.set_slope("r[1]", 2.0), OK);
    assert_eq!([unit.get("x[1]"), unit.get("r[1]"), unit.get("Q[1,1]")], [0.77, -3.0, 5.0], "what was set reads back");
    assert_eq!(calculated(&unit), before);
    assert_eq!(unit.step(20.0 * STEP, STEP), OK);
    let after = calculated(&unit);
    assert!(after.iter().zip(&before).all(|(a, b)| a != b), "and everything changes in the step");
}

#[test]
fn values_read_before_the_first_step_are_those_of_initialization_mode() {
    let unit = Unit::new("L1NonlinearSiso");
    unit.put("x[1]", 0.2);
    unit.start(0.0);
    let before = calculated(&unit);
    unit.put("x[1]", 0.9);
    assert_eq!(calculated(&unit), before);
}

#[test]
fn a_restored_state_and_a_reset_bring_their_own_outputs() {
    let unit = Unit::started("L1NonlinearSiso");
    unit.put("r[1]", 1.0);
    unit.run(0.0, 10, STEP);
    let (state, at_saving) = (unit.save(), unit.values());
    unit.run(10.0 * STEP, 10, STEP);
    assert_ne!(unit.values(), at_saving);
    assert_eq!(unit.restore(state), OK);
    assert_eq!(unit.values(), at_saving);
    assert_eq!(unit.reset(), OK);
    unit.enter(0.0);
    assert_eq!([unit.get("u[1]"), unit.get("r[1]")], [0.0, 0.0]);
}

#[test]
fn input_derivatives_given_in_initialization_mode_hold_for_the_first_step() {
    let with = |slope_in_initialization_mode: bool| {
        let unit = Unit::new("NonlinearSiso");
        unit.enter(0.0);
        let give = || assert_eq!(unit.set_slope("u[1]", 3.0), OK);
        if slope_in_initialization_mode {
            give();
            assert_eq!(unit.exit(), OK);
        } else {
            assert_eq!(unit.exit(), OK);
            give();
        }
        unit.run(0.0, 2, 0.01);
        unit.values()
    };
    assert_eq!(with(true), with(false));
    let sampled = Unit::started("NonlinearSiso");
    sampled.run(0.0, 2, 0.01);
    assert_ne!(with(true), sampled.values());
}

#[test]
fn a_unit_may_be_initialised_without_an_experiment_set_up() {
    let unit = Unit::new("ReferenceNonlinearSiso");
    assert_eq!(unsafe { fmi2EnterInitializationMode(unit.component) }, OK);
    assert_eq!(unit.exit(), OK);
    assert_eq!(unit.step(0.0, 0.1), OK, "it starts at 0: {:?}", unit.messages());
}

#[test]
fn a_refused_get_in_initialization_mode_changes_nothing() {
    let unit = Unit::new("L1NonlinearSiso");
    unit.enter(0.0);
    unit.put("x[1]", 0.4);
    let references = [unit.reference("x_hat[1]"), u32::MAX];
    unit.refuses(&["fmi2GetReal", &u32::MAX.to_string()], |unit| unit.get_reals(&references, &mut [0.0; 2]));
    assert_eq!(unit.get("x_hat[1]"), 0.4);
}

#[test]
fn bounds_that_do_not_hold_an_estimates_start_value_are_refused_at_the_start() {
    // omega_hat starts at 1.
    for (name, value) in [("omega_max[1,1]", 0.9), ("omega_min[1,1]", 1.1)] {
        let unit = Unit::new("L1NonlinearSiso");
        unit.put(name, value);
        unit.enter(0.0);
        assert_eq!(unit.exit(), ERROR);
        let message = unit.last_message();
        assert!(message.contains(name) && message.contains(&value.to_string()), "{message}");
    }
}
