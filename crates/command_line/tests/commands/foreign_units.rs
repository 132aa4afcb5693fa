//! FMUs of other tools in `run`. For any error of theirs, the message names FMU, function and time, and the results
//! until then are saved.

#![cfg(unix)]

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};
use std::sync::OnceLock;

use adaptive_fmu::exporter::{Platform, write_entries};
use common::at_top;
use serde_json::Value;

/// Two motors in a row, `first` and `second`, and their constant input.
const LOOP: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="motors" version="1.0">
  <ssd:System name="loop" description="two motors">
    <ssd:Elements>
      <ssd:Component name="first" type="application/x-fmu-sharedlibrary" source="resources/Motor.fmu">
        <ssd:Connectors><ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector><ssd:Connector name="y" kind="output"><ssc:Real/></ssd:Connector></ssd:Connectors>
      </ssd:Component>
      <ssd:Component name="second" type="application/x-fmu-sharedlibrary" source="resources/Motor.fmu">
        <ssd:Connectors><ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector><ssd:Connector name="y" kind="output"><ssc:Real/></ssd:Connector></ssd:Connectors>
      </ssd:Component>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="first" startConnector="y" endElement="second" endConnector="u"/>
    </ssd:Connections>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0.0" stopTime="1.0">
    <ssd:Annotations>
      <ssc:Annotation type="adaptive-fmu.closed-loop">
        <ClosedLoop name="motors"><Master step="0.01" order="gauss-seidel"/><Plot title="speeds" signals="first.y second.y"/></ClosedLoop>
      </ssc:Annotation>
    </ssd:Annotations>
  </ssd:DefaultExperiment>
</ssd:SystemStructureDescription>
"#;

/// The archive of the motor, made once.
fn motor() -> &'static [u8] {
    static MOTOR: OnceLock<Vec<u8>> = OnceLock::new();
    MOTOR.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let (library, archive) = (folder.path().join("Motor.so"), folder.path().join("Motor.fmu"));
        let compiled = Command::new("cc")
            .args(["-O1", "-fPIC", "-shared", "-pthread", "-o"])
            .arg(&library)
            .arg(at_top("tests/foreign/motor.c"))
            .arg("-lm")
            .status()
            .expect("a C compiler");
        assert!(compiled.success());
        let (xml, bytes) = (fs::read(at_top("tests/foreign/motor.xml")).unwrap(), fs::read(library).unwrap());
        write_entries(&archive, &[("modelDescription.xml", &xml), (&Platform::own().binary("Motor"), &bytes)]).unwrap();
        fs::read(archive).unwrap()
    })
}

/// The loop in a folder of its own, where results go too.
struct Motors(tempfile::TempDir);

impl Motors {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("resources")).unwrap();
        fs::write(folder.path().join("resources/Motor.fmu"), motor()).unwrap();
        fs::write(folder.path().join("SystemStructure.ssd"), LOOP).unwrap();
        Motors(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
        command.args(["run", ".", "--json", "--set", "first.u=1"]).args(arguments).current_dir(self.0.path());
        command
    }

    /// Runs the loop, the second motor with a fault.
    fn run(&self, fault: u32, arguments: &[&str]) -> Output {
        self.command(&["--set", &format!("second.fault={fault}")]).args(arguments).output().unwrap()
    }

    /// The last time in the result, and the last speed of the second motor.
    fn last(&self) -> (f64, f64) {
        let csv = fs::read_to_string(self.path("results/motors/result.csv")).unwrap();
        assert!(csv.starts_with("time,first.y,second.y\n"), "{csv}");
        let row: Vec<f64> = csv.lines().last().unwrap().split(',').map(|value| value.parse().unwrap()).collect();
        (row[0], row[2])
    }
}

/// The one error of a run that failed with results, and its last time.
fn failure(fault: u32, arguments: &[&str]) -> (String, f64) {
    let motors = Motors::new();
    let output = motors.run(fault, arguments);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let errors: Vec<_> = stderr.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{stderr}");
    assert!(motors.path("results/motors/index.html").is_file());
    (errors[0].to_owned(), motors.last().0)
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&output.stdout).expect("nothing but JSON on stdout")
}

fn warnings(output: &Output) -> Vec<String> {
    json(output)["warnings"].as_array().unwrap().iter().map(|text| text.as_str().unwrap().to_owned()).collect()
}

/// Both motors answer a step as their equations do, each delayed by nothing but the exchange.
#[test]
fn a_sound_unit_gives_the_same_in_both_places() {
    let motors = Motors::new();
    let mut ends = Vec::new();
    for arguments in [&[][..], &["--in-process"]] {
        assert_eq!(warnings(&motors.run(0, arguments)), Vec::<String>::new());
        ends.push(motors.last());
    }
    assert_eq!(ends[0], ends[1]);
    let decay = (-0.1_f64).exp();
    let (mut first, mut second) = (0.0, 0.0);
    for _ in 0..100 {
        first = 1.0 + (first - 1.0) * decay;
        second = first + (second - first) * decay;
    }
    assert!((ends[0].0 - 1.0).abs() < 1e-12 && (ends[0].1 - second).abs() < 1e-12, "{ends:?}, {second}");
}

#[test]
fn a_crash_is_reported_and_what_was_computed_is_saved() {
    let (error, last) = failure(1, &[]);
    assert!(error.contains("second: fmi2DoStep failed at t = 0.5 s: crashed") && error.contains("SIGSEGV"), "{error}");
    assert!((last - 0.5).abs() < 1e-9);
    let (error, _) = failure(11, &[]);
    assert!(error.contains("SIGABRT") && error.contains("assertion failed: the shaft is broken"), "{error}");
}

#[test]
fn a_unit_that_hangs_is_ended_after_the_patience() {
    let (error, last) = failure(2, &["--patience", "0.5"]);
    assert!(error.contains("second: fmi2DoStep failed at t = 0.5 s: did not respond within 0.5 s"), "{error}");
    assert!(error.contains("--patience") && (last - 0.5).abs() < 1e-9, "{error}");
}

#[test]
fn a_unit_that_exits_ends_itself_only() {
    let (error, last) = failure(3, &[]);
    assert!(error.contains("second: fmi2DoStep failed at t = 0.5 s: ended its process with exit code 0"), "{error}");
    assert!((last - 0.5).abs() < 1e-9);
}

#[test]
fn what_a_unit_prints_is_a_warning_and_stays_out_of_the_results() {
    let warnings = warnings(&Motors::new().run(4, &[]));
    assert_eq!(warnings.len(), 50, "{warnings:?}");
    assert!(warnings[0].starts_with("second: wrote: the motor is at 0."), "{warnings:?}");
}

#[test]
fn a_number_that_is_none_ends_the_run_in_both_places() {
    for arguments in [&[][..], &["--in-process"]] {
        let (error, last) = failure(5, arguments);
        assert!(error.contains("second: fmi2GetReal failed at t = 0.5 s: `y` = NaN"), "{error}");
        assert!((last - 0.5).abs() < 1e-9);
    }
}

#[test]
fn a_crash_when_freed_keeps_the_whole_run() {
    let (error, last) = failure(6, &[]);
    assert!(error.contains("second: fmi2FreeInstance failed") && error.contains("SIGABRT"), "{error}");
    assert!((last - 1.0).abs() < 1e-9);
}

#[test]
fn messages_are_expanded_cleaned_and_counted_after_the_hundredth() {
    let messages = warnings(&Motors::new().run(7, &[]));
    let expected = if cfg!(target_arch = "x86_64") {
        "second: second is 100 % warm: \\u{1b}[31m42\\u{1b}[0m degrees, 1.50 A"
    } else {
        "second: %s is 100 % warm: \\u{1b}[31m%d\\u{1b}[0m degrees, %.2f A"
    };
    assert_eq!(messages, vec![expected; 50]);
    let messages = warnings(&Motors::new().run(8, &["--until", "10"]));
    assert_eq!(messages.len(), 102, "{messages:?}");
    assert_eq!(messages[100], "second: 849 more messages");
}

#[test]
fn messages_may_come_from_any_thread() {
    for arguments in [&[][..], &["--in-process"]] {
        let messages = warnings(&Motors::new().run(9, arguments));
        assert_eq!(messages.len(), 102);
        assert_eq!(messages[100], "second: 99899 more messages");
    }
}

#[test]
fn an_answer_that_is_no_status_is_reported() {
    let (error, _) = failure(10, &[]);
    assert!(error.contains("it returned 17, which is not a status of the FMI standard"), "{error}");
}

#[test]
fn a_crash_at_the_beginning_names_the_unit() {
    let output = Motors::new().command(&[]).env("MOTOR_CRASHES", "1").output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr.contains("Motor.fmu") && stderr.contains("fmi2Instantiate") && stderr.contains("SIGABRT"),
        "{stderr}"
    );
}

/// No process of a unit stays behind a run that was killed.
#[test]
#[cfg(target_os = "linux")]
fn the_processes_of_units_end_with_the_run() {
    let motors = Motors::new();
    let mut run = motors.command(&["--set", "second.fault=2"]).spawn().unwrap();
    let children = || fs::read_to_string(format!("/proc/{0}/task/{0}/children", run.id())).unwrap_or_default();
    while children().split_whitespace().count() < 2 {
        std::thread::yield_now();
    }
    let processes: Vec<_> = children().split_whitespace().map(str::to_owned).collect();
    run.kill().unwrap();
    run.wait().unwrap();
    let is_there = |process: &&String| {
        fs::read_to_string(format!("/proc/{process}/stat")).is_ok_and(|stat| !stat.contains(") Z "))
    };
    for _ in 0..100 {
        if processes.iter().filter(is_there).count() == 0 {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    panic!("{processes:?} are still there");
}
