//! Steps that can't be finished: an error (or, if asked for, fmi2Discard) with variable and time, never a wrong number.

use adaptive_fmu::fmi2::types::MODEL_EXCHANGE;
use adaptive_fmu::system::{
    Declaration, Input, Invalid, Kind, NoStructure, Parameter, Point, Rates, Registry, Scalar, ScalarOf, Signal,
    Signals, State, System, Values, scalar,
};
use common::{DISCARD, ERROR, OK, Unit};

/// population' = population², which is infinite at t = 1/x0.
struct Blowup {
    x0: ScalarOf<Parameter>,
    population: ScalarOf<State>,
}

impl System for Blowup {
    type Structure = NoStructure;
    const NAME: &'static str = "blowup";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Blowup {
            x0: d.parameter(scalar("x0", "start").start(2.0).fixed()),
            population: d.state(scalar("population", "state").output()),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.population] = v[self.x0];
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.population] = v[self.population] * v[self.population];
    }
}

/// A gap with gap' = −1/(2 gap): gap = √(1 − t), which must be wider than an input.
struct Closing {
    needed: ScalarOf<Input>,
    gap: ScalarOf<State>,
}

impl System for Closing {
    type Structure = NoStructure;
    const NAME: &'static str = "closing";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Closing {
            needed: d.input(scalar("needed", "what the gap has to be wider than").start(2.0)),
            gap: d.state(scalar("gap", "state").output()),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.gap] = S::from(1.0);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        // No number beyond zero.
        dx[self.gap] = v[self.gap].sqrt().powi(-2) * -0.5;
    }
    fn check<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        let (gap, needed) = (v[self.gap], v[self.needed]);
        v.refuse(!gap.above(needed), |v| {
            Invalid::new(v.name(self.gap), gap.to_text(), format!("must be above {}", needed.to_text()))
        });
    }
}

/// level' = −1/(2 level): level = √(1 − t), and no number after t = 1.
struct Draining {
    level: ScalarOf<State>,
}

impl System for Draining {
    type Structure = NoStructure;
    const NAME: &'static str = "draining";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Draining { level: d.state(scalar("level", "state").output()) })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.level] = S::from(1.0);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, t: S, _v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.level] = -(-t + 1.0).sqrt().recip() * 0.5;
    }
}

/// y = gain ln(1 − t/2): minus infinity at t = 2, no number after it.
struct Logarithm {
    gain: ScalarOf<Parameter>,
    y: ScalarOf<Signal>,
}

impl System for Logarithm {
    type Structure = NoStructure;
    const NAME: &'static str = "logarithm";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Logarithm { gain: d.parameter(scalar("gain", "factor").start(1.0)), y: d.output(scalar("y", "output")) })
    }
    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.y] = (t * -0.5 + 1.0).ln() * v[self.gain];
    }
}

static REGISTRY: Registry =
    &[Kind::of::<Blowup>(), Kind::of::<Draining>(), Kind::of::<Logarithm>(), Kind::of::<Closing>()];

fn unit(model: &str) -> Unit {
    Unit::of(REGISTRY, &text(model))
}

fn text(model: &str) -> String {
    format!("name = \"Test\"\nmodel = \"{model}\"\ndescription = \"\"\n")
}

/// The time that a message names last.
fn time_in(message: &str) -> f64 {
    let (_, rest) = message.rsplit_once("t = ").unwrap_or_else(|| panic!("`{message}` names a time"));
    rest.split_whitespace().next().unwrap().trim_end_matches([':', ',']).parse().unwrap()
}

/// Steps until one fails; the number of those that didn't.
fn steps_until(failure: adaptive_fmu::fmi2::types::Status, unit: &Unit, step: f64) -> usize {
    for k in 0..1000 {
        let before = unit.values();
        let status = unit.step(k as f64 * step, step);
        if status != OK {
            assert_eq!(status, failure);
            assert_eq!(unit.values(), before, "values are as before the failed step");
            return k;
        }
    }
    panic!("no step failed");
}

#[test]
fn divergence_ends_in_an_error_that_names_the_variable_and_the_time() {
    for (step, good) in [(0.2, 2), (0.07, 7), (1.0, 0), (100.0, 0)] {
        let unit = unit("blowup");
        unit.start(0.0);
        assert_eq!(steps_until(ERROR, &unit, step), good, "step {step}");
        let message = unit.last_message();
        assert!(message.contains("fmi2DoStep") && message.contains("population"), "{message}");
        let time = time_in(&message);
        assert!(time > 0.5 - 1e-4 && time < 0.5 + 1e-4, "infinite at 1/2 s: {message}");
        let t = good as f64 * step;
        // Near the pole the solution magnifies its error by (x/x0)².
        let exact = 2.0 / (1.0 - 2.0 * t);
        assert!((unit.get("population") / exact - 1.0).abs() < 1e-3, "the last good value, at t = {t}");
        assert_eq!(unit.last_successful_time(), t);
        unit.refuses(&["fmi2DoStep", "error"], |unit| unit.step(t, 1e-6));
        unit.refuses(&["fmi2SetInteger"], |unit| unit.set_integer("on_step_failure", 2));
    }
}

#[test]
fn what_is_no_number_ends_in_an_error_that_names_the_variable_and_the_time() {
    let draining = unit("draining");
    draining.start(0.0);
    assert_eq!(steps_until(ERROR, &draining, 0.3), 3);
    let message = draining.last_message();
    assert!(message.contains("level") && (time_in(&message) - 1.0).abs() < 1e-3, "{message}");
    assert!((draining.get("level") - 0.1_f64.sqrt()).abs() < 1e-5);

    let logarithm = unit("logarithm");
    logarithm.start(0.0);
    assert_eq!(steps_until(ERROR, &logarithm, 0.75), 2);
    let message = logarithm.last_message();
    assert!(message.contains('y') && message.contains("NaN"), "{message}");
    assert_eq!(logarithm.get("y"), 0.25_f64.ln());
}

#[test]
fn an_output_beyond_any_use_is_divergence_too() {
    let unit = unit("logarithm");
    unit.start(0.0);
    unit.put("gain", -1e13);
    assert_eq!(unit.step(0.0, 1.5), ERROR);
    let message = unit.last_message();
    assert!(message.contains("y = 1.38"), "{message}");
}

#[test]
fn an_output_that_is_no_number_is_never_given_as_good() {
    // At t = 2 the output is minus infinity, at t = 3 not a number: from the start on.
    for start in [2.0, 3.0] {
        let unit = unit("logarithm");
        unit.enter(start);
        let mut value = 0.0;
        let answers = [unit.try_get("y", &mut value), unit.exit()];
        assert!(value.is_finite(), "y(t = {start}) was given as {value} with {:?}", answers[0]);
        assert_eq!(answers, [ERROR; 2], "start at {start}");
    }
}

#[test]
fn a_failed_step_is_discarded_where_that_was_asked_for() {
    let unit = unit("blowup");
    assert_eq!(unit.set_integer("on_step_failure", 2), OK);
    unit.start(0.0);
    let good = steps_until(DISCARD, &unit, 0.2);
    assert_eq!(good, 2);
    let (_, category, message) = unit.messages().pop().unwrap();
    assert_eq!(category, "logStatusDiscard");
    assert!(message.contains("population"), "{message}");
    assert_eq!(unit.last_successful_time(), 0.4);
    unit.refuses(&["fmi2DoStep", "discarded"], |unit| unit.step(0.4, 0.01));
}

#[test]
fn a_discarded_step_is_tried_again_shorter_after_restoring_the_state_before_it() {
    let unit = unit("blowup");
    assert_eq!(unit.set_integer("on_step_failure", 2), OK);
    unit.start(0.0);
    unit.run(0.0, 4, 0.1);
    let before = unit.save();
    assert_eq!(unit.step(0.4, 0.2), DISCARD);
    assert_eq!(unit.restore(before), OK);
    assert_eq!(unit.step(0.4, 0.05), OK);
    assert!((unit.get("population") - 20.0).abs() < 1e-3, "{}", unit.get("population"));
}

#[test]
fn a_refused_argument_is_an_error_even_where_failed_steps_are_discarded() {
    let unit = unit("blowup");
    assert_eq!(unit.set_integer("on_step_failure", 2), OK);
    unit.start(0.0);
    unit.refuses(&["communicationStepSize"], |unit| unit.step(0.0, -1.0));
    assert_eq!(unit.step(0.0, 0.1), OK);
}

#[test]
fn the_plant_of_example_3_2_1_without_control_ends_in_an_error_and_not_with_numbers() {
    // x1'' = x1² + x2² + sin(t/2) grows without bound in finite time.
    let plant = Unit::started("NonlinearSiso");
    let steps = steps_until(ERROR, &plant, 0.01);
    let message = plant.last_message();
    assert!(message.contains("x["), "{message}");
    assert!((time_in(&message) - steps as f64 * 0.01).abs() <= 0.011, "{message}");
    assert!(plant.get("x[1]").abs() < 1e12);
}

#[test]
fn what_a_system_itself_finds_wrong_is_reported_at_the_end_of_a_step() {
    let unit = unit("closing");
    unit.start(0.0);
    unit.put("needed", 0.5);
    // √(1 − t) = 0.5 at t = 0.75.
    assert_eq!(steps_until(ERROR, &unit, 0.1), 7);
    let message = unit.last_message();
    assert!(message.contains("gap = 0.447") && message.contains("above 0.5"), "{message}");
    assert!((time_in(&message) - 0.8).abs() < 1e-12, "{message}");
    assert!((unit.get("gap") - 0.3_f64.sqrt()).abs() < 1e-6, "as before the step");
}

#[test]
fn where_no_step_leads_on_the_system_reports_what_is_wrong_there() {
    for method in [1, 2, 3] {
        let unit = unit("closing");
        assert_eq!(unit.set_integer("integration_method", method), OK);
        unit.start(0.0);
        unit.put("needed", 0.0);
        assert_eq!(steps_until(ERROR, &unit, 0.3), 3);
        let message = unit.last_message();
        assert!(message.contains("gap = -") && message.contains("above 0"), "{message}");
        assert!((time_in(&message) - 1.0).abs() < 1e-4, "{message}");
    }
}

#[test]
fn a_system_checks_the_inputs_that_its_simulation_starts_with() {
    // In co-simulation those of the first step: not every master sets any before.
    let slave = unit("closing");
    slave.start(0.0);
    assert_eq!(slave.step(0.0, 0.1), ERROR, "the gap of 1 is not above 2");
    let message = slave.last_message();
    assert!(message.contains("gap = 1: must be above 2 (at t = 0 s)"), "{message}");
    let solved = Unit::made(REGISTRY, &text("closing"), MODEL_EXCHANGE);
    solved.enter(0.0);
    assert_eq!(solved.exit(), ERROR);
    assert!(solved.last_message().contains("gap = 1: must be above 2 (at t = 0 s)"));
    solved.put("needed", 0.5);
    assert_eq!(solved.exit(), OK, "what was wrong can be set anew: {:?}", solved.messages());
}
