//! Units of other tools in model exchange: `simulate` finds their events, and ends where they fail.

#![cfg(unix)]

use std::fs;
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

use crate::foreign;

const DESCRIPTION: &str = "<?xml version='1.0'?>
<fmiModelDescription fmiVersion='2.0' modelName='Other' guid='other' numberOfEventIndicators='1'>
<ModelExchange modelIdentifier='Other'/>
<TypeDefinitions><SimpleType name='Behaviour'><Enumeration>
<Item name='samples' value='0'/><Item name='now' value='1'/><Item name='chatters' value='2'/>
<Item name='fails' value='3'/><Item name='ball' value='4'/><Item name='integrates' value='5'/>
<Item name='spring' value='6'/>
</Enumeration></SimpleType></TypeDefinitions>
<ModelVariables>
<ScalarVariable name='x' valueReference='0' causality='output'><Real/></ScalarVariable>
<ScalarVariable name='v' valueReference='1' causality='output'><Real/></ScalarVariable>
<ScalarVariable name='count' valueReference='2' causality='output' variability='discrete'><Real/></ScalarVariable>
<ScalarVariable name='u' valueReference='3' causality='input'><Real start='0'/></ScalarVariable>
<ScalarVariable name='behaviour' valueReference='0' causality='parameter' variability='fixed'>
<Enumeration declaredType='Behaviour' start='0'/></ScalarVariable>
<ScalarVariable name='der(x)' valueReference='4'><Real derivative='1'/></ScalarVariable>
<ScalarVariable name='der(v)' valueReference='5'><Real derivative='2'/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index='1'/><Unknown index='2'/><Unknown index='3'/></Outputs>
<Derivatives><Unknown index='6'/><Unknown index='7'/></Derivatives></ModelStructure></fmiModelDescription>";

struct Other(TempDir);

impl Other {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        foreign::fmu(folder.path(), "Other", "exchange.c", DESCRIPTION);
        Other(folder)
    }

    fn simulate(&self, behaviour: &str, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
        command.args(["simulate", "Other.fmu", "--json", "--set", &format!("behaviour={behaviour}")]);
        command.args(arguments).current_dir(self.0.path()).output().unwrap()
    }

    /// The last values of the outputs.
    fn last(&self, behaviour: &str, arguments: &[&str]) -> Value {
        let output = self.simulate(behaviour, arguments);
        assert!(output.status.success(), "{output:?}");
        let result: Value = serde_json::from_slice(&output.stdout).unwrap();
        result["last"].clone()
    }

    fn error(&self, behaviour: &str, arguments: &[&str]) -> String {
        let output = self.simulate(behaviour, arguments);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    }
}

#[test]
fn sampled_units_meet_all_of_their_times() {
    let other = Other::new();
    for step in ["0.01", "0.1", "0.37", "1"] {
        let last = other.last("samples", &["--step", step, "--until", "2.05"]);
        assert_eq!(last["count"], 20.0, "step {step}");
        assert!((last["x"].as_f64().unwrap() - 2.05).abs() < 1e-12);
    }
}

/// Bounces from height 1 with half the speed after each: t₀ = √(2/g), then flights of 2 t₀, t₀, t₀/2 …
#[test]
fn a_ball_bounces_where_it_meets_the_ground() {
    let t0 = (2.0_f64 / 9.81).sqrt();
    let speed = 9.81 * t0;
    // In the third flight, between the bounces at 2 t0 and 2.5 t0.
    let time = 2.2 * t0;
    let into = time - 2.0 * t0;
    let height = 0.25 * speed * into - 0.5 * 9.81 * into * into;
    for step in ["0.01", "0.3"] {
        let last = Other::new().last("ball", &["--step", step, "--until", &time.to_string(), "--tolerance", "1e-9"]);
        assert!((last["x"].as_f64().unwrap() - height).abs() < 1e-7, "step {step}: {last}, not {height}");
    }
}

#[test]
fn an_input_that_jumps_counts_up_to_its_jump() {
    let other = Other::new();
    fs::write(other.0.path().join("input.csv"), "\u{feff}time,u\n0,1\n0.5,1\n0.5,-3\n1,-3\n").unwrap();
    for (step, tolerance) in [("1", "1e-3"), ("0.1", "1e-6")] {
        let last = other.last("integrates", &["--input", "input.csv", "--step", step, "--tolerance", tolerance]);
        assert!((last["x"].as_f64().unwrap() + 1.0).abs() < 1e-9, "step {step}: {last}");
    }
    fs::write(other.0.path().join("input.csv"), "time,u,u\n0,1,2\n").unwrap();
    assert!(other.error("integrates", &["--input", "input.csv"]).contains("`u` is the name of two columns"));
}

#[test]
fn events_without_end_are_reported() {
    for behaviour in ["now", "chatters"] {
        let error = Other::new().error(behaviour, &["--until", "1", "--step", "0.01"]);
        assert!(error.contains("too many events, "), "{behaviour}: {error}");
    }
}

#[test]
fn an_error_is_no_matter_of_the_step() {
    let error = Other::new().error("fails", &["--until", "1", "--step", "0.01"]);
    assert!(error.contains("fmi2GetDerivatives failed at t = 0.3") && error.contains("fmi2Error"), "{error}");
}

#[test]
fn items_have_the_numbers_that_the_description_gives_them() {
    let other = Other::new();
    assert_eq!(other.last("ball", &["--until", "0.1"]), other.last("4", &["--until", "0.1"]));
    let error = other.error("7", &[]);
    assert!(error.contains("samples (0)") && error.contains("integrates (5)"), "{error}");
}

#[test]
fn an_operating_point_holds_with_the_events_on_the_way_to_it() {
    let other = Other::new();
    for (wanted, stiffness) in [(0.5, 1.0), (2.0, 3.0), (-4.0, 1.0)] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
        command.args(["linearise", "Other.fmu", "--json", "--set", "behaviour=spring", "--free", "u", "--want"]);
        let output = command.arg(format!("x={wanted}")).current_dir(other.0.path()).output().unwrap();
        let linear: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{output:?}"));
        assert_eq!(linear["method"]["by"], "differences");
        let force = linear["inputs"][0]["value"].as_f64().unwrap();
        assert!((force - stiffness * (wanted - 1.0) - 1.0).abs() < 1e-8, "{linear}");
        assert!((linear["A"][1][0].as_f64().unwrap() + stiffness).abs() < 1e-6, "{linear}");
    }
}

#[test]
fn a_run_without_a_step_is_refused() {
    for arguments in [&["--until", "1e-9"][..], &["--until", "1", "--step", "1e7"]] {
        assert!(Other::new().error("samples", arguments).contains("is shorter than one communication step"));
    }
}
