//! `new loop`: the structure of a loop for given units, wired by names, with comments where a person must decide.

#![cfg(unix)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

use crate::foreign;

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/own/dc_motor");
const DEPENDENCIES: &str = "<ModelStructure><Outputs><Unknown index='2' dependencies='1' dependenciesKind='dependent'/></Outputs></ModelStructure>";

/// Runs the program in a folder.
fn program(folder: &Path, words: &[&str]) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
    program.current_dir(folder).args(words).output().unwrap()
}

/// Output of a command that succeeds.
fn done(folder: &Path, words: &[&str]) -> (String, String) {
    let output = program(folder, words);
    let [out, err] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    assert_eq!(output.status.code(), Some(0), "{words:?}: {err}");
    (out, err)
}

/// The error of a command that is refused.
fn refused(folder: &Path, words: &[&str]) -> String {
    let output = program(folder, words);
    assert_eq!(output.status.code(), Some(1), "{words:?}");
    String::from_utf8(output.stderr).unwrap()
}

/// JSON of a loop that ran.
fn ran(folder: &Path, words: &[&str]) -> Value {
    serde_json::from_str(&done(folder, &[&["run"], words, &["--json"]].concat()).0).unwrap()
}

fn structure(folder: &Path) -> String {
    fs::read_to_string(folder.join("SystemStructure.ssd")).unwrap()
}

/// The connections of a structure: `unit.output unit.input`, sorted; what is in comments doesn't count.
fn connections(text: &str) -> Vec<String> {
    let document = roxmltree::Document::parse(text).unwrap();
    let connections = document.descendants().filter(|node| node.tag_name().name() == "Connection");
    let ends = |node: roxmltree::Node| {
        let of = |name| node.attribute(name).unwrap();
        let [a, b, c, d] = ["startElement", "startConnector", "endElement", "endConnector"].map(of);
        format!("{a}.{b} {c}.{d}")
    };
    let mut found: Vec<_> = connections.map(ends).collect();
    found.sort();
    found
}

/// The units in the order in which they are stepped.
fn order(text: &str) -> Vec<String> {
    let document = roxmltree::Document::parse(text).unwrap();
    let components = document.descendants().filter(|node| node.tag_name().name() == "Component");
    components.map(|node| node.attribute("name").unwrap().to_owned()).collect()
}

/// A folder with the descriptions of the DC motor's loop.
fn motor() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in ["DcMotor.toml", "DcMotorController.toml", "DcMotorReference.toml", "model.json"] {
        fs::copy(Path::new(EXAMPLE).join(file), folder.path().join(file)).unwrap();
    }
    folder
}

#[test]
fn the_motors_loop_gives_what_the_shipped_structure_gives() {
    let folder = motor();
    let units = ["motor=DcMotor.toml", "DcMotorController.toml", "DcMotorReference.toml"];
    let words = [&["new", "loop", "--units"], &units[..], &["--name", "dc_motor"]].concat();
    let (output, left) = done(folder.path(), &words);
    assert!(output.contains("connected inputs: 4; open inputs, each with a comment in the file: 0"), "{output}");
    assert!(output.contains("controller.enabled, controller.u_manual[1]") && left.is_empty(), "{output} {left}");
    let text = structure(folder.path());
    assert_eq!(order(&text), ["reference", "motor", "controller"]);
    assert!(text.contains("<Master step=\"0.001\"") && text.contains("stopTime=\"10.0\""), "{text}");
    assert!(text.contains(
        "<Plot title=\"speed and its reference, rad/s\" signals=\"reference.speed_reference motor.speed\"/>"
    ));
    let table =
        |output: &Value| fs::read(folder.path().join(output["results"].as_str().unwrap()).join("result.csv")).unwrap();
    let ours = ran(folder.path(), &[".", "--until", "1.1", "--out", "ours"]);
    let shipped = ran(folder.path(), &[EXAMPLE, "--until", "1.1", "--out", "shipped"]);
    assert!(table(&ours) == table(&shipped), "the same bits");
    let error = |output: &Value, start: &str| {
        let metrics = output["metrics"].as_array().unwrap();
        let metric = metrics.iter().find(|metric| metric["label"].as_str().unwrap().starts_with(start));
        metric.unwrap_or_else(|| panic!("{start} in {output}"))["value"].as_f64().unwrap()
    };
    // The reference steps by 100 at 1 s; the motor takes some ms.
    let [rms, overshoot] = ["rms (speed - speed_reference), rad/s", "overshoot of "].map(|start| error(&ours, start));
    assert!(rms > 1.0 && rms < 100.0 && overshoot < 10.0, "{rms} {overshoot}");
    assert!(!ours.to_string().contains("max |speed"), "the largest error is the step");
    assert!(error(&ours, "max |voltage|, V") <= 12.0);
}

#[test]
fn a_sensor_and_an_actuator_are_put_between_by_their_names() {
    let folder = motor();
    for (kind, name) in [("sensor", "Tachometer"), ("actuator", "Drive")] {
        done(folder.path(), &["new", kind, "--name", name, "--plant", "model.json", "--no-schema"]);
    }
    let units = ["Drive.toml", "DcMotorController.toml", "Tachometer.toml", "DcMotor.toml", "DcMotorReference.toml"];
    let (output, _) = done(folder.path(), &[&["new", "loop", "--out", "a/new one", "--units"], &units[..]].concat());
    assert!(output.contains("connected inputs: 7;") && output.contains("in the file: 0"), "{output}");
    let text = structure(&folder.path().join("a/new one"));
    assert_eq!(
        connections(&text),
        [
            "actuator.voltage plant.voltage",
            "controller.voltage actuator.voltage_command",
            "plant.current sensor.current",
            "plant.speed sensor.speed",
            "reference.speed_reference controller.speed_reference",
            "sensor.current_measured controller.current",
            "sensor.speed_measured controller.speed",
        ]
    );
    assert_eq!(order(&text), ["reference", "plant", "sensor", "controller", "actuator"]);
    let output = ran(folder.path(), &["a/new one", "--until", "0.01"]);
    assert_eq!((output["loop"].as_str(), output["ended"].as_str()), (Some("new one"), Some("complete")));
    assert_eq!(output["warnings"].as_array().map(Vec::len), Some(0), "{output}");
}

#[test]
fn where_several_outputs_have_a_name_the_candidates_are_there_to_be_uncommented() {
    let folder = motor();
    let units = ["one=DcMotor.toml", "two=DcMotor.toml", "DcMotorController.toml", "DcMotorReference.toml"];
    let (output, left) = done(folder.path(), &[&["new", "loop", "--units"], &units[..]].concat());
    assert!(output.contains("connected inputs: 3; open inputs, each with a comment in the file: 2"), "{output}");
    assert!(left.contains("to decide: `controller.speed`: several outputs have this name"), "{left}");
    let text = structure(folder.path());
    assert!(text.contains("TO DECIDE: controller.speed: several outputs have this name."), "{text}");
    assert!(text.contains("it keeps its start value, 0.0 rad/s."), "{text}");
    let output = ran(folder.path(), &[".", "--until", "0.001"]);
    let warnings = output["warnings"].to_string();
    assert!(warnings.contains("`controller.speed` is not connected and stays at its start value"), "{warnings}");
    // As a person does who decides.
    let candidate = |signal: &str| {
        let start = format!("<ssd:Connection startElement=\"two\" startConnector=\"{signal}\" ");
        format!("{start}endElement=\"controller\" endConnector=\"{signal}\"/>")
    };
    let mut decided = text.clone();
    for signal in ["speed", "current"] {
        let candidate = candidate(signal);
        assert_eq!(decided.matches(&format!("<!-- {candidate} -->")).count(), 1, "{text}");
        decided = decided.replace(&format!("<!-- {candidate} -->"), &candidate);
    }
    fs::write(folder.path().join("SystemStructure.ssd"), decided).unwrap();
    let output = ran(folder.path(), &[".", "--until", "0.001"]);
    assert_eq!(output["warnings"].as_array().map(Vec::len), Some(0), "{output}");
}

#[test]
fn what_has_no_name_of_another_or_does_not_fit_is_left_to_a_person() {
    let folder = motor();
    let path = folder.path();
    // A motor in C whose current is called otherwise, and whose speed is in metres.
    let variables = [("voltage", "input", "unit='V'"), ("speed", "output", "unit='m'"), ("i_a", "output", "unit='A'")];
    let inner = foreign::variables(&variables);
    foreign::fmu(path, "Other", "lag.c", &foreign::description("Other", &inner));
    let units = ["Other.fmu", "DcMotorController.toml", "DcMotorReference.toml"];
    let (output, left) = done(path, &[&["new", "loop", "--units"], &units[..]].concat());
    assert!(output.contains("connected inputs: 2;") && output.contains("in the file: 2"), "{output}");
    assert!(
        left.contains("`controller.speed`: the output with this name has unit m, but the input has unit rad/s"),
        "{left}"
    );
    assert!(left.contains("`controller.current`: no output has this name"), "{left}");
    let text = structure(path);
    let candidate = "<!-- <ssd:Connection startElement=\"plant\" startConnector=\"i_a\" endElement=\"controller\" endConnector=\"current\"/> -->";
    assert!(text.contains(candidate), "{text}");
    // What is to be measured of it can't be known: speeds in other units are not subtracted.
    assert!(
        text.contains("TO DECIDE: which signal follows which reference?") && !text.contains("minus=\"reference.speed")
    );
    // What doesn't fit is refused once it is uncommented, and not before.
    assert_eq!(ran(path, &[".", "--until", "0.001"])["ended"], "complete");
    let speed = "<ssd:Connection startElement=\"plant\" startConnector=\"speed\" endElement=\"controller\" endConnector=\"speed\"/>";
    fs::write(path.join("SystemStructure.ssd"), text.replace(&format!("<!-- {speed} -->"), speed)).unwrap();
    assert!(refused(path, &["run", "."]).contains("of another dimension"));
}

#[test]
fn fmus_in_an_algebraic_loop_are_written_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    for (name, input, output) in [("One", "a", "b"), ("Two", "b", "a")] {
        let variables = foreign::variables(&[(input, "input", ""), (output, "output", "")]);
        foreign::fmu(folder.path(), name, "gain.c", &foreign::description(name, &(variables + DEPENDENCIES)));
    }
    let (output, left) = done(folder.path(), &["new", "loop", "--units", "One.fmu", "Two.fmu", "--name", "round"]);
    assert!(
        output.contains("connected inputs: 2;")
            && left.contains("`run` will refuse this structure")
            && left.contains("algebraic"),
        "{left}"
    );
    assert!(refused(folder.path(), &["run", "."]).contains("--accept-algebraic-loops"));
}

#[test]
fn names_may_hold_anything_that_xml_can() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let hostile = "a\"<&'>ö--b- ]]> -->";
    let escaped = "a&quot;&lt;&amp;&apos;&gt;ö--b- ]]&gt; --&gt;";
    let file = "we\"ird & <ö>'--%41 .fmu";
    let variables = [("u", "input", ""), (escaped, "output", "")];
    let made = foreign::fmu(path, "Source", "lag.c", &foreign::description("Source", &foreign::variables(&variables)));
    fs::rename(made, path.join(file)).unwrap();
    let variables = [(escaped, "input", "unit='--'"), ("other", "input", "unit='&lt;--&gt;'"), ("y", "output", "")];
    foreign::fmu(path, "Sink", "lag.c", &foreign::description("Sink", &foreign::variables(&variables)));
    let far = tempfile::tempdir().unwrap();
    fs::rename(path.join("Sink.fmu"), far.path().join("Si:nk#?.fmu")).unwrap();
    let sink = far.path().join("Si:nk#?.fmu");
    let words = ["new", "loop", "--out", "<l--p>", "--units", file, sink.to_str().unwrap()];
    let (output, left) = done(path, &words);
    assert!(output.contains("connected inputs: 1;") && left.contains("to decide: "), "{output} {left}");
    let text = structure(&path.join("<l--p>"));
    let found = connections(&text);
    assert!(found.len() == 1 && found[0].ends_with(&format!(".{hostile}")), "{found:?}");
    for comment in text.split("<!--").skip(1) {
        let inner = comment.split("-->").next().unwrap();
        assert!(!inner.contains("--") && !inner.ends_with('-'), "{inner}");
    }
    let output = ran(path, &["<l--p>", "--until", "0.01"]);
    assert_eq!((output["ended"].as_str(), output["loop"].as_str()), (Some("complete"), Some("_l--p_")), "{output}");
}

#[test]
fn fmus_of_this_package_are_named_and_names_alike_are_taken_where_one_fits() {
    let folder = tempfile::tempdir().unwrap();
    let units = ["L1NonlinearSiso", "NonlinearSiso", "ReferenceNonlinearSiso"];
    let (output, _) = done(folder.path(), &[&["new", "loop", "--until", "2", "--units"], &units[..]].concat());
    assert!(output.contains("connected inputs: 4;") && output.contains("in the file: 0"), "{output}");
    let text = structure(folder.path());
    assert_eq!(order(&text), ["reference", "plant", "controller"]);
    assert!(text.contains("of=\"plant.y[1]\" minus=\"reference.r[1]\"") && text.contains("stopTime=\"2.0\""), "{text}");
    assert_eq!(ran(folder.path(), &[".", "--until", "0.01"])["ended"], "complete");
    let x = [("Motor.X1", "output", ""), ("x_2", "output", ""), ("u", "input", "")];
    let plant = foreign::description("Plant", &foreign::variables(&x));
    foreign::fmu(folder.path(), "Plant", "lag.c", &plant);
    let units = ["L1NonlinearSiso", "Plant.fmu", "ReferenceNonlinearSiso"];
    let (output, left) = done(folder.path(), &[&["new", "loop", "--force", "--units"], &units[..]].concat());
    assert!(
        output.contains("connected inputs: 3;") && left.contains("`plant.u`: no output has this name"),
        "{output} {left}"
    );
    let text = structure(folder.path());
    assert!(text.contains("plant.Motor.X1 goes to controller.x[1]: the names differ only in their form"), "{text}");
}

#[test]
fn what_cannot_be_done_is_refused_and_nothing_written() {
    let folder = motor();
    let path = folder.path();
    let exchange = "<?xml version='1.0'?><fmiModelDescription fmiVersion='2.0' modelName='M' guid='M'>\
        <ModelExchange modelIdentifier='M'/><ModelVariables/></fmiModelDescription>";
    foreign::fmu(path, "Exchange", "lag.c", exchange);
    let loop_of = |units: &[&str]| refused(path, &[&["new", "loop", "--out", "made", "--units"], units].concat());
    assert!(loop_of(&["Gone.fmu"]).contains("Gone.fmu"));
    assert!(loop_of(&["Gone"]).contains("there is no FMU named `Gone`"));
    assert!(loop_of(&["Exchange.fmu"]).contains("does not support co-simulation"));
    assert!(loop_of(&["model.json"]).contains("model.json"));
    assert!(loop_of(&["a=DcMotor.toml", "a=DcMotorReference.toml"]).contains("--units = a"));
    assert!(loop_of(&["a b=DcMotor.toml"]).contains("spaces"));
    let name = |name: &str| refused(path, &["new", "loop", "--out", "made", "--name", name, "--units", "DcMotor.toml"]);
    assert!(name("../up").contains("../up"));
    assert!(!path.join("made").exists());
    done(path, &["new", "loop", "--units", "DcMotor.toml"]);
    let before = structure(path);
    let again = refused(path, &["new", "loop", "--units", "DcMotor.toml", "DcMotorReference.toml"]);
    assert!(again.contains("Use --force to overwrite it") && structure(path) == before, "{again}");
    done(path, &["new", "loop", "--force", "--units", "DcMotor.toml", "DcMotorReference.toml"]);
    assert!(structure(path) != before);
    for words in [&["new", "loop"][..], &["new", "loop", "--units"], &["new"], &["new", "--units", "DcMotor.toml"]] {
        assert_eq!(program(path, words).status.code(), Some(2), "{words:?}");
    }
}

#[test]
fn a_description_may_lie_in_a_file_of_another_name() {
    let folder = motor();
    let path = folder.path();
    for (old, new) in [("DcMotor", "plant"), ("DcMotorController", "controller"), ("DcMotorReference", "reference")] {
        fs::rename(path.join(format!("{old}.toml")), path.join(format!("{new}.toml"))).unwrap();
    }
    done(path, &["new", "loop", "--units", "plant.toml", "controller.toml", "reference.toml"]);
    assert_eq!(ran(path, &[".", "--until", "0.001"])["ended"], "complete");
    done(path, &["export", "controller.toml"]);
    let fmu: PathBuf = path.join("fmus/DcMotorController.fmu");
    assert!(fmu.is_file(), "it has the name of its description");
}

#[test]
fn the_help_names_both_forms_of_new() {
    let folder = tempfile::tempdir().unwrap();
    let (output, _) = done(folder.path(), &["new", "--help"]);
    assert!(output.contains("loop") && output.contains("state-space") && output.contains("--name <NAME>"), "{output}");
    assert!(done(folder.path(), &["new", "loop", "--help"]).0.contains("--units"));
}
