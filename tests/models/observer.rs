//! Observers: their equations with numbers worked out by hand, their gains, and what is refused.

use adaptive_fmu_library::fmi2_functions::fmi2GetDirectionalDerivative;
use common::described::refused;
use common::{ERROR, OK, Unit, description};

/// x_obs = (0.5, −0.25), beta = 2, delta = 0.5 and y = 0.75, so that ỹ = −0.5, ‖y‖⁴ = 81/256 and ‖x_obs‖² = 5/16.
const STATES: [f64; 4] = [0.5, -0.25, 2.0, 0.5];
/// 1 + 81/256 + 5/16 · 81/256 + 2 · 0.5
const BETA_L: f64 = 2.415283203125;

/// The observer of example 7.5.1, in its state.
fn siso(parameters: &[(&str, f64)]) -> Unit {
    let unit = Unit::exchange("ObserverActuatedSiso");
    parameters.iter().for_each(|&(name, value)| unit.put(name, value));
    unit.begin();
    unit.put("y[1]", 0.75);
    assert_eq!(unit.set_states(&STATES), OK);
    unit
}

fn close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    let near = found.iter().zip(expected).all(|(f, e)| (f - e).abs() <= 1e-13 * e.abs().max(1.0));
    assert!(near, "{found:?}, not {expected:?}");
}

fn derivative(unit: &Unit, unknown: &str, known: &str) -> f64 {
    let (unknown, known, mut change) = (unit.reference(unknown), unit.reference(known), f64::NAN);
    let status = unsafe { fmi2GetDirectionalDerivative(unit.component, &unknown, 1, &known, 1, &1.0, &mut change) };
    assert_eq!(status, OK, "{:?}", unit.messages());
    change
}

#[test]
fn the_observer_moves_by_its_equations() {
    let unit = siso(&[]);
    close(&[unit.get("y_tilde[1]"), unit.get("beta_l")], &[-0.5, BETA_L]);
    let beta = 10.0 * 0.5 * BETA_L - 10.0 * 1e-4 * 2.0;
    let delta = -2.5 * 0.5 + 2.5 * 81.0 / 256.0 + 0.625;
    close(&unit.derivatives(), &[-0.25 + 8.0 * 0.5, 64.0 * 0.5 + 2.0 * BETA_L * 0.5, beta, delta]);
}

#[test]
fn the_power_of_the_error_counts_in_the_adaptation_alone() {
    let [printed, proof] = [1.0, 2.0].map(|power| siso(&[("beta_error_power", power)]).derivatives());
    close(&proof[..2], &printed[..2]);
    close(&proof[2..], &[10.0 * 0.25 * BETA_L - 10.0 * 1e-4 * 2.0, printed[3]]);
}

#[test]
fn without_an_output_error_all_derivatives_are_numbers() {
    // The norm of the error has a kink there.
    for power in [0.5, 1.0, 2.0] {
        let unit = siso(&[("beta_error_power", power)]);
        unit.put("y[1]", 0.25);
        close(&[unit.derivatives()[2]], &[-10.0 * 1e-4 * 2.0]);
        for known in ["x_obs[1]", "x_obs[2]", "beta", "delta", "y[1]"] {
            for unknown in ["der(x_obs[1])", "der(x_obs[2])", "der(beta)", "der(delta)"] {
                let change = derivative(&unit, unknown, known);
                assert!(change.is_finite(), "{unknown} by {known}: {change}");
            }
        }
    }
}

#[test]
fn the_states_start_at_their_parameters() {
    let starts = [("x_obs0[1]", 0.3), ("x_obs0[2]", -1.5), ("beta0", 0.0), ("delta0", 4.0)];
    let unit = Unit::exchange("ObserverActuatedSiso");
    starts.iter().for_each(|&(name, value)| unit.put(name, value));
    unit.begin();
    assert_eq!(unit.states(), starts.map(|(_, value)| value));
    let unit = Unit::started("ObserverActuatedSiso");
    assert_eq!(["x_obs[1]", "x_obs[2]", "beta", "delta"].map(|name| unit.get(name)), [0.0, 0.0, 1.0, 1.0]);
}

#[test]
fn a_plant_at_rest_is_found_from_its_output() {
    // For the double integrator at (1, 0), y = x1 + x2 is 1.
    let unit = Unit::started("ObserverActuatedSiso");
    unit.put("y[1]", 1.0);
    unit.run(0.0, 3000, 0.01);
    let found = [unit.get("x_obs[1]"), unit.get("x_obs[2]")];
    assert!((found[0] - 1.0).abs() < 1e-6 && found[1].abs() < 1e-6, "{found:?}");
}

#[test]
fn each_axis_gets_the_gain_of_its_poles() {
    // With y = q + q'/60 the characteristic polynomial of an axis is s² + (k1 + k2/60) s + k2.
    let unit = Unit::started("ObserverTwoLinkRobot");
    let gain = |i: usize, j: usize| unit.get(&format!("observer_gain[{i},{j}]"));
    let [stiff, soft] = [60.0_f64, 50.0].map(|re| (2.0 * re, re * re + 0.25));
    let axis = |(sum, product): (f64, f64)| [sum - product / 60.0, product];
    let near = |found: [f64; 2], expected: [f64; 2]| {
        assert!((0..2).all(|k| (found[k] / expected[k] - 1.0).abs() < 1e-11), "{found:?}, not {expected:?}");
    };
    near([gain(1, 1), gain(3, 1)], axis(stiff));
    near([gain(2, 2), gain(4, 2)], axis(soft));
    let crossed = [gain(2, 1), gain(4, 1), gain(1, 2), gain(3, 2)];
    assert!(crossed.iter().all(|gain| gain.abs() < 1e-9), "{crossed:?}");
}

#[test]
fn a_known_torque_turns_the_estimated_attitude() {
    let torques = [4.85e-3, -9.7e-3, 4.405e-3];
    let rates = |known: bool| {
        let unit = Unit::exchange("ObserverQuadrotor");
        assert_eq!(unit.set_boolean("known_input", known), OK);
        unit.begin();
        (1..=3).for_each(|i| unit.put(&format!("u[{i}]"), torques[i - 1]));
        unit.derivatives()
    };
    let change: Vec<f64> = rates(true).iter().zip(rates(false)).map(|(with, without)| with - without).collect();
    let expected = [0.0, 0.0, 0.0, 1.0, -2.0, 0.5, 0.0, 0.0];
    assert!(change.iter().zip(expected).all(|(found, e)| (found - e).abs() < 1e-9), "{change:?}, not {expected:?}");
}

#[test]
fn a_gain_that_lets_the_error_grow_is_refused_with_the_eigenvalues() {
    let given = "observer_gain = [[8.0], [64.0]]";
    let text = description("ObserverActuatedSiso");
    assert!(text.contains(given));
    // s² - 56 s - 64
    let named = ["A - observer_gain C", "57.12", "-1.12"];
    refused(&text.replace(given, "observer_gain = [[8.0], [-64.0]]"), &named);
    // While it runs, the gains in force stay so.
    let unit = Unit::started("ObserverActuatedSiso");
    unit.put("observer_gain[2,1]", -64.0);
    assert_eq!(unit.step(0.0, 0.01), ERROR);
    let message = unit.last_message();
    assert!(named.iter().all(|name| message.contains(name)), "{message}");
}

#[test]
fn what_is_no_observer_is_refused_when_its_description_is_read() {
    let (gain, poles) = (description("ObserverActuatedSiso"), description("ObserverTwoLinkRobot"));
    let changed = |text: &str, old: &str, new: &str| {
        assert!(text.contains(old), "`{old}` is in the description");
        text.replace(old, new)
    };
    refused(&(gain.clone() + "observer_pole_real = [-1.0, -1.0]"), &["observer_pole_real", "no such parameter"]);
    refused(&changed(&poles, "-50.0, -50.0]", "5.0, 5.0]"), &["pole 3 = 5 + 0.5j", "negative real part"]);
    // The rates by themselves don't determine the joint angles.
    let rates = "C = [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]";
    let measured = poles.lines().find(|line| line.starts_with("C = ")).unwrap();
    refused(&changed(&poles, measured, rates), &["A, C", "observable"]);
    refused(&changed(&gain, "C = [[1.0, 1.0]]", "C = [[1.0]]"), &["C = 1 x 1", "1 x 2"]);
    refused(&changed(&gain, "A = [[0.0, 1.0], [0.0, 0.0]]", "A = [[0.0]]"), &["A = 1 x 1", "2 x 2"]);
    refused(&changed(&gain, "\"gain\"", "\"matrix\""), &["observer_dynamics", "matrix", "gain"]);
    refused(&changed(&gain, "lambda_0 = 2.5", "lambda_0 = 0.0"), &["lambda_0"]);
}
