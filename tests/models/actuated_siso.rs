//! The actuated system: its parts do what they are, whatever the uncertainty.

use common::{ERROR, OK, Unit};

/// Reads `der(name)` at a point.
fn at(unit: &Unit, t: f64, states: [f64; 5], names: &[&str]) -> Vec<f64> {
    assert_eq!((unit.set_time(t), unit.set_states(&states)), (OK, OK));
    names.iter().map(|name| unit.get(name)).collect()
}

#[test]
fn the_actuator_is_a_first_order_lag_at_its_rate() {
    for (rate, uncertainty) in [(75.0, 1), (75.0, 2), (12.5, 3)] {
        let unit = Unit::new("ActuatedSiso");
        unit.put("actuator_rate", rate);
        unit.put("relative_tolerance", 1e-9);
        assert_eq!(unit.set_integer("uncertainty", uncertainty), OK);
        unit.start(0.0);
        unit.put("u[1]", 1.0);
        for k in 0..100 {
            unit.run(f64::from(k) * 2e-3, 1, 2e-3);
            let t = f64::from(k + 1) * 2e-3;
            let expected = 1.0 - (-rate * t).exp();
            assert!((unit.get("mu") - expected).abs() < 1e-7, "{} at t = {t}, not {expected}", unit.get("mu"));
        }
    }
}

#[test]
fn at_rest_without_disturbance_it_stays_at_rest() {
    for uncertainty in [1, 3] {
        let unit = Unit::new("ActuatedSiso");
        assert_eq!(unit.set_integer("uncertainty", uncertainty), OK);
        unit.start(0.0);
        unit.run(0.0, 1000, 0.01);
        let names = ["x[1]", "x[2]", "mu", "z[1]", "z[2]", "y[1]"];
        assert_eq!(names.map(|name| unit.get(name)), [0.0; 6]);
    }
}

#[test]
fn all_initial_values_can_be_chosen() {
    let unit = Unit::new("ActuatedSiso");
    let values = [("x[1]", "x0[1]", 0.4), ("x[2]", "x0[2]", -0.3), ("mu", "mu0", 2.0), ("z[1]", "z0[1]", 0.1)];
    values.iter().for_each(|(_, initial, value)| unit.put(initial, *value));
    unit.put("z0[2]", -0.7);
    unit.start(0.0);
    values.iter().for_each(|(state, _, value)| assert_eq!(unit.get(state), *value));
    assert_eq!(unit.get("z[2]"), -0.7);
}

#[test]
fn the_output_is_what_the_output_matrix_makes_of_the_state() {
    let unit = Unit::new("ActuatedSiso");
    [("x0[1]", 0.4), ("x0[2]", -0.3)].iter().for_each(|(name, value)| unit.put(name, *value));
    unit.start(0.0);
    assert_eq!(unit.get("y[1]"), 0.4, "chapter 4");
    unit.put("C[1,2]", 1.0);
    unit.run(0.0, 1, 1e-3);
    assert_eq!(unit.get("y[1]"), unit.get("x[1]") + unit.get("x[2]"), "example 7.5.1");
}

#[test]
fn only_the_unmodeled_dynamics_distinguish_the_third_uncertainty_from_the_first() {
    let states = [0.4, -0.3, 0.2, 1.7, 0.6];
    let [first, third] = [1, 3].map(|uncertainty| {
        let unit = Unit::exchange("ActuatedSiso");
        assert_eq!(unit.set_integer("uncertainty", uncertainty), OK);
        unit.begin();
        at(&unit, 2.0, states, &["der(x[1])", "der(x[2])", "der(mu)", "der(z[1])", "der(z[2])"])
    });
    assert!((third[1] - first[1] - 1.7 * 1.7).abs() < 1e-14);
    assert_eq!((first[0], &first[2..]), (third[0], &third[2..]));
}

#[test]
fn an_uncertainty_that_there_is_not_is_refused() {
    let unit = Unit::new("ActuatedSiso");
    for number in [0, 4, -1] {
        assert_eq!(unit.set_integer("uncertainty", number), ERROR);
        let message = unit.last_message();
        assert!(message.contains("uncertainty") && message.contains(&number.to_string()), "{message}");
    }
}

#[test]
fn a_state_that_escapes_is_an_error_and_no_number() {
    let unit = Unit::new("ActuatedSiso");
    unit.put("x0[1]", 1.0);
    unit.start(0.0);
    let failed = (0..100).find(|k| unit.step(f64::from(*k) * 0.1, 0.1) == ERROR);
    assert!(failed.is_some(), "the quadratic terms have it diverge");
    assert!(unit.get("x[1]").is_finite() && unit.get("x[2]").is_finite());
}
