//! fmi2GetRealOutputDerivatives: exact, at the last communication point, of what is in force there.

use adaptive_fmu::system::{
    Declaration, Input, Invalid, Kind, NoStructure, Registry, Scalar, ScalarOf, Signal, Signals, System, Values, scalar,
};
use adaptive_fmu_library::fmi2_functions::fmi2GetRealOutputDerivatives;
use common::loops::{Loop, STEP};
use common::{DISCARD, OK, Unit};

fn assert_near(value: f64, expected: f64, what: &str) {
    assert!((value - expected).abs() <= 1e-9 * expected.abs().max(1.0), "{what}: {value} is not {expected}");
}

#[test]
fn the_plants_output_derivatives_are_its_equations() {
    let plant = Unit::started("NonlinearSiso");
    plant.put("u[1]", -0.4);
    plant.run(0.0, 30, 0.01);
    let (t, u) = (0.3_f64, -0.4_f64);
    let [x1, x2] = ["x[1]", "x[2]"].map(|name| plant.get(name));
    assert_near(plant.output_derivative("y[1]"), x2, "y'");
    assert_near(plant.output_derivative("x[1]"), x2, "x1'");
    // The plant's equation, in which A_m x and its opposite in f cancel.
    let expected = (2.0 + 0.2 * t.sin()) * u + u.sin() * x1.sin() + x1 * x1 + x2 * x2 + (0.5 * t).sin();
    assert_near(plant.output_derivative("x[2]"), expected, "x2'");
}

#[test]
fn the_controllers_output_derivative_is_its_control_law() {
    let units = Loop::started();
    units.run(0..400);
    let unit = &units.controller;
    // u' = −K (η̂ − K_g r) with K = 20 and K_g = −1/(C A_m⁻¹ B) = 1.
    let expected = -20.0 * (unit.get("eta_hat[1]") - unit.get("r[1]"));
    assert!(expected.abs() > 1e-3, "something to see: {expected}");
    assert_near(unit.output_derivative("u[1]"), expected, "u'");
}

#[test]
fn the_references_output_derivatives_are_its_derivatives() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    unit.run(0.0, 7, 0.5);
    assert_near(unit.output_derivative("r[1]"), unit.get("dr[1]"), "r'");
    assert_near(unit.output_derivative("dr[1]"), unit.get("ddr[1]"), "r''");
    // r = 2 cos 0.2 t.
    assert_near(unit.output_derivative("ddr[1]"), 2.0 * 0.2_f64.powi(3) * (0.2_f64 * 3.5).sin(), "r'''");
}

#[test]
fn output_derivatives_are_known_before_the_first_step() {
    let unit = Unit::new("NonlinearSiso");
    unit.put("x0[2]", 0.7);
    unit.start(0.0);
    assert_near(unit.output_derivative("y[1]"), 0.7, "y'");
}

#[test]
fn output_derivatives_agree_with_differences_of_the_outputs() {
    let plant = Unit::new("NonlinearSiso");
    assert_eq!(plant.set("relative_tolerance", 1e-12), OK);
    plant.put("u[1]", -0.3);
    plant.start(0.0);
    let h = 1e-3;
    let mut seen = Vec::new();
    for k in 0..400 {
        plant.run(f64::from(k) * h, 1, h);
        seen.push((plant.get("x[2]"), plant.output_derivative("x[2]")));
    }
    for window in seen.windows(5) {
        let x: Vec<f64> = window.iter().map(|(x, _)| *x).collect();
        // Central, of order 4: its own error is h⁴ x⁽⁵⁾/30.
        let difference = (x[0] - 8.0 * x[1] + 8.0 * x[3] - x[4]) / (12.0 * h);
        assert!((difference - window[2].1).abs() < 1e-8, "{difference} {}", window[2].1);
    }
}

/// y = u², and its root.
struct Square {
    u: ScalarOf<Input>,
    y: ScalarOf<Signal>,
    root: ScalarOf<Signal>,
}

impl System for Square {
    type Structure = NoStructure;
    const NAME: &'static str = "square";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Square {
            u: d.input(scalar("u", "input")),
            y: d.output(scalar("y", "its square")),
            root: d.output(scalar("root", "the square's root")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.y] = v[self.u] * v[self.u];
        y[self.root] = y[self.y].sqrt();
    }
}

static REGISTRY: Registry = &[Kind::of::<Square>()];

#[test]
fn a_feedthrough_output_changes_with_the_inputs_slope_in_the_last_step() {
    let unit = Unit::of(REGISTRY, "name = \"Square\"\nmodel = \"square\"\ndescription = \"\"\n");
    unit.start(0.0);
    unit.put("u", 3.0);
    assert_eq!(unit.set_slope("u", 0.5), OK);
    unit.run(0.0, 1, 2.0);
    // At the end of the step u = 4 and u' = 0.5.
    assert_near(unit.get("y"), 16.0, "y");
    assert_near(unit.output_derivative("y"), 4.0, "y' = 2 u u'");
    unit.run(2.0, 1, 2.0);
    assert_near(unit.output_derivative("y"), 0.0, "held again");
}

#[test]
fn a_derivative_that_is_no_number_is_not_given_as_one() {
    let unit = Unit::of(REGISTRY, "name = \"Square\"\nmodel = \"square\"\ndescription = \"\"\n");
    unit.start(0.0);
    unit.run(0.0, 1, 1.0);
    // |u| has no derivative at 0.
    let mut given = 7.5;
    let root = unit.reference("root");
    let status = unsafe { fmi2GetRealOutputDerivatives(unit.component, &root, 1, &1, &mut given) };
    assert_eq!((status, given), (DISCARD, 7.5), "nothing is given");
    let message = unit.last_message();
    assert!(message.contains("the derivative of `root`") && message.contains("no finite number"), "{message}");
    assert_near(unit.output_derivative("y"), 0.0, "the other output's");
}

#[test]
fn what_was_set_since_the_last_step_is_not_in_the_derivatives_yet() {
    let units = Loop::started();
    units.run(0..100);
    let unit = &units.controller;
    let before = unit.output_derivative("u[1]");
    unit.put("r[1]", 50.0);
    unit.put("x[1]", 3.0);
    unit.put("feedback_gain[1,1]", 1.0);
    assert_eq!(unit.set_slope("r[1]", 9.0), OK);
    assert_eq!(unit.output_derivative("u[1]").to_bits(), before.to_bits());
    assert_eq!(unit.step(100.0 * STEP, STEP), OK);
    assert_ne!(unit.output_derivative("u[1]").to_bits(), before.to_bits());
}

#[test]
fn a_choice_that_was_set_since_the_last_step_is_not_in_the_derivatives_yet() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    unit.run(0.0, 3, 1.0);
    let before = unit.output_derivative("r[1]");
    assert_near(before, -0.4 * 0.6_f64.sin(), "the cosine's");
    assert_eq!(unit.set_integer("signal", 2), OK);
    assert_eq!(unit.output_derivative("r[1]"), before);
    unit.run(3.0, 1, 1.0);
    assert_eq!(unit.output_derivative("r[1]"), 0.0, "the square wave's");
}

#[test]
fn reading_output_derivatives_changes_nothing() {
    let units = Loop::started();
    units.run(0..50);
    let before = units.fingerprint();
    units.units().iter().zip(["r[1]", "y[1]", "u[1]"]).for_each(|(unit, name)| {
        unit.output_derivative(name);
    });
    assert_eq!(units.fingerprint(), before);
}
