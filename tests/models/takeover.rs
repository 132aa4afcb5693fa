//! Taking over from manual control: no jump, whichever way the controller comes into command.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu_library::fmi2_functions::fmi2GetDirectionalDerivative;
use common::models::Run;
use common::{OK, Unit, description};

fn robot(start: &str) -> Run {
    let text = format!("{}\n{start}", description("L1TwoLinkRobot"));
    let run = Run(Execution::new(Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap()));
    started(run)
}

/// Starts on its trajectory, in manual mode.
fn started(mut run: Run) -> Run {
    for (name, value) in [("x[1]", 0.5), ("x[4]", -0.39), ("r[1]", 0.5), ("u_manual[1]", 15.0), ("u_manual[2]", -3.0)] {
        run.set(name, value);
    }
    run.0.initialise().unwrap();
    run
}

#[test]
fn a_bumpless_start_begins_at_the_manual_control() {
    let zero = robot("");
    // Only −K_m x: (300² + 5²) · 0.5
    assert!((zero.get("u[1]") + 45012.5).abs() < 1e-6, "{}", zero.get("u[1]"));
    let bumpless = robot("u_ad_start = 'bumpless'");
    assert!((bumpless.get("u[1]") - 15.0).abs() < 1e-9 && (bumpless.get("u[2]") + 3.0).abs() < 1e-9);
}

#[test]
fn while_not_enabled_the_control_is_the_manual_one_and_estimates_are_frozen() {
    let unit = Unit::new("L1TwoLinkRobot");
    unit.enter(0.0);
    assert_eq!(unit.set_boolean("enabled", false), OK);
    unit.put("u_manual[1]", 4.0);
    assert_eq!(unit.exit(), OK);
    assert_eq!(unit.get("u[1]"), 4.0);
    for k in 0..200 {
        let t = f64::from(k) * 1e-3;
        unit.put("x[1]", 0.3 * t);
        unit.put("u_manual[1]", 4.0 + t);
        assert_eq!(unit.step(t, 1e-3), OK);
        assert!((unit.get("u[1]") - (4.0 + t)).abs() < 1e-12);
    }
    assert_eq!([unit.get("theta_hat[1,1]"), unit.get("omega_hat[1,1]"), unit.get("sigma_hat[2]")], [0.0, 1.0, 0.0]);
    assert!((unit.get("x_hat[1]") - unit.get("x[1]")).abs() < 1e-2, "the predictor follows");
}

#[test]
fn enabling_makes_no_jump() {
    for interface in ["co-simulation", "by a general method"] {
        let start = if interface == "co-simulation" { "" } else { "integration_method = 'explicit'" };
        let text = format!("{}\n{start}", description("L1TwoLinkRobot"));
        let unit = Unit::from_text(&text);
        unit.enter(0.0);
        assert_eq!(unit.set_boolean("enabled", false), OK);
        for (name, value) in [("x[1]", 0.5), ("r[1]", 0.5), ("u_manual[1]", 15.0), ("u_manual[2]", -3.0)] {
            unit.put(name, value);
        }
        assert_eq!(unit.exit(), OK);
        assert_eq!(unit.step(0.0, 1e-4), OK);
        unit.put("x[1]", 0.6);
        unit.put("u_manual[1]", 18.0);
        assert_eq!(unit.set_boolean("enabled", true), OK);
        // Short enough for the control not to have moved far on its own.
        assert_eq!(unit.step(1e-4, 1e-7), OK);
        assert!((unit.get("u[1]") - 18.0).abs() < 0.2 && (unit.get("u[2]") + 3.0).abs() < 0.2, "{interface}");
        assert!((unit.get("x_hat[1]") - 0.6).abs() < 1e-6, "the predictor is at the state: {interface}");
    }
}

#[test]
fn a_controller_that_is_switched_off_hands_over_to_the_manual_control() {
    let unit = Unit::started("L1TwoLinkRobot");
    unit.put("u_manual[2]", 7.0);
    assert_eq!(unit.step(0.0, 1e-4), OK);
    assert!(unit.get("u[2]") != 7.0);
    assert_eq!(unit.set_boolean("enabled", false), OK);
    assert!(unit.get("u[2]") != 7.0, "outputs change in a step only");
    assert_eq!(unit.step(1e-4, 1e-4), OK);
    assert_eq!(unit.get("u[2]"), 7.0);
}

/// A run in Continuous-Time Mode, a step of the master's integrator after the start.
fn exchanged() -> Unit {
    let unit = Unit::exchange("L1TwoLinkRobot");
    unit.begin();
    [("x[1]", 0.3), ("u_manual[1]", 4.0), ("u_manual[2]", 7.0)].into_iter().for_each(|(name, u)| unit.put(name, u));
    assert_eq!(unit.set_time(1e-3), OK);
    assert!(!unit.completed_step());
    unit
}

#[test]
fn in_model_exchange_a_switch_between_events_waits_for_the_next_one_and_asks_for_it() {
    let unit = exchanged();
    let seed = |unit: &Unit| {
        let (u, x, mut du) = (unit.reference("u[1]"), unit.reference("x[1]"), f64::NAN);
        assert_eq!(unsafe { fmi2GetDirectionalDerivative(unit.component, &u, 1, &x, 1, &1.0, &mut du) }, OK);
        du
    };
    let in_force = |unit: &Unit| (unit.get("u[1]"), unit.get("u[2]"), unit.derivatives(), seed(unit));
    let before = in_force(&unit);
    assert!(before.0 != 4.0 && before.1 != 7.0);
    assert_eq!(unit.set_boolean("enabled", true), OK);
    assert!(!unit.completed_step(), "what stands already asks for nothing");
    assert_eq!(unit.set_boolean("enabled", false), OK);
    assert!(!unit.get_boolean("enabled"), "what was set reads back");
    assert_eq!(in_force(&unit), before);
    let waiting = unit.fingerprint();
    assert_eq!(unit.set_boolean("enabled", true), OK);
    assert!(!unit.completed_step(), "it was taken back");
    for unit in [unit, exchanged()] {
        let (status, state) = unit.deserialise(&waiting);
        assert_eq!((status, unit.restore(state)), (OK, OK));
        assert!(!unit.get_boolean("enabled"));
        assert_eq!(in_force(&unit), before, "saved with everything else");
        assert!(unit.completed_step(), "it waits for an event");
        assert!(unit.completed_step(), "however often the master goes on");
        assert_eq!(in_force(&unit), before);
        assert_eq!(unit.enter_event_mode(), OK);
        unit.settle();
        assert_eq!((unit.get("u[1]"), unit.get("u[2]")), (4.0, 7.0));
        assert!(!unit.get_boolean("enabled") && !unit.completed_step());
    }
}

#[test]
fn the_manual_control_keeps_to_the_limits_too() {
    let limited = robot("u_ad_start = 'bumpless'\nu_max = [10.0, 10.0]");
    assert!(limited.get("u[1]") == 10.0 && (limited.get("u[2]") + 3.0).abs() < 1e-9);
}

#[test]
fn limits_that_are_upside_down_are_refused() {
    let text = format!("{}\nu_min = [1.0, 1.0]\nu_max = [2.0, -2.0]", description("L1TwoLinkRobot"));
    let error = Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap_err().to_string();
    assert!(error.contains("u_min[2] = 1") && error.contains("must be below u_max[2] = -2"), "{error}");
}
