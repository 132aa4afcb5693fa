//! The parameters that a design reads: those that a unit of C sources fixes.

use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::*;
use common::description;

/// Parameters that the design of an FMU of this package reads.
fn designed_of(name: &str) -> Vec<String> {
    Model::from_description(Description::read(&description(name)).unwrap(), REGISTRY).unwrap().designed_names()
}

#[test]
fn the_design_of_an_l1_law_reads_poles_and_the_lyapunov_equation_and_no_gain() {
    assert_eq!(designed_of("L1TwoLinkRobot"), ["pole_real", "pole_imag", "Q"]);
    assert_eq!(designed_of("L1CoupledMimo"), ["A_m", "Q"]);
}

#[test]
fn a_feedback_gain_acts_on_unmatched_uncertainty_by_arithmetic() {
    assert_eq!(designed_of("L1UnmatchedMimo"), ["A_m", "Q"]);
    assert_eq!(designed_of("L1TwinRotor"), ["pole_real", "pole_imag", "Q"]);
}

#[test]
fn units_whose_parameters_are_only_related_fix_none() {
    for name in ["NeuroPpfTwoLinkRobot", "Sensor", "Actuator", "MaresAuv", "StateSpace"] {
        assert_eq!(designed_of(name), [""; 0], "{name}");
    }
}

/// A design that reads `a` in one mode only, `b` where `a` is large there, `factor` where `weight` isn't 0.
struct Hidden {
    is_fine: BooleanOf<Parameter>,
    steps: IntegerOf<Parameter>,
    a: ScalarOf<Parameter>,
    b: ScalarOf<Parameter>,
    weight: ScalarOf<Parameter>,
    factor: ScalarOf<Parameter>,
    panics: ScalarOf<Parameter>,
    refused: VectorOf<Parameter>,
    related: ScalarOf<Parameter>,
    gain: ScalarOf<Parameter>,
    designed: VectorOf<Prepared>,
}

impl System for Hidden {
    type Structure = NoStructure;
    const NAME: &'static str = "hidden";
    const DOCUMENTATION: &'static str = "A design.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Hidden {
            is_fine: d.parameter(boolean("is_fine", "")),
            steps: d.parameter(integer("steps", "").start(3).within(1, 5)),
            a: d.parameter(scalar("a", "")),
            b: d.parameter(scalar("b", "").start(2.0)),
            weight: d.parameter(scalar("weight", "")),
            factor: d.parameter(scalar("factor", "").start(1.0)),
            panics: d.parameter(scalar("panics", "").start(1.0)),
            refused: d.parameter(vector("refused", 2, "").start(1.0).max(20.0)),
            related: d.parameter(scalar("related", "").start(1.0)),
            gain: d.parameter(scalar("gain", "").start(1.0)),
            designed: d.prepared(vector("designed", 4, "")),
        })
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        assert!(v[self.panics] < 1e6, "too large");
        if v.get(self.is_fine) {
            v[self.designed.at(0)] = v[self.a];
            v[self.designed.at(1)] = if v[self.a] > 100.0 { v[self.b] } else { 0.0 };
        } else {
            v.set(self.designed.part(0..2), [0.0, 0.0]);
        }
        v[self.designed.at(2)] = v[self.weight] * v[self.factor];
        v[self.designed.at(3)] = f64::from(v.get(self.steps) / 5);
        let refused = v[self.refused.at(1)] > 10.0;
        if refused { Err(Invalid::new(v.name(self.refused.at(1)), v[self.gain], "too much")) } else { Ok(()) }
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        v.require_at_most(self.related, self.b);
    }

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
}

#[test]
fn what_a_mode_or_another_parameter_hides_is_found_and_what_equations_read_is_left() {
    let names = Model::new::<Hidden>("Hidden", &toml::Table::new()).unwrap().designed_names();
    let expected = ["is_fine", "steps", "a", "b", "weight", "factor", "panics", "refused", "gain"];
    assert_eq!(names, expected, "gain stands in a reason");
}
