//! Loops with FMUs of other tools, which declare less than the standard allows.

use std::fs;
use std::process::{Command, Output};

use adaptive_fmu::fmu::Hosting;
use adaptive_fmu::simulation::{LoadedLoop, Recording};
use adaptive_fmu::structure::{LoopFiles, Order, Settings};
use tempfile::TempDir;

use crate::foreign;

/// Name, causality and attributes of each variable.
type Variables = &'static [(&'static str, &'static str, &'static str)];

const LAG: Variables = &[("y", "output", ""), ("u", "input", ""), ("x", "parameter", "")];
const GAIN: Variables =
    &[("y", "output", ""), ("u", "input", ""), ("r", "parameter", "start='1'"), ("gain", "parameter", "start='2'")];
const UNTOLD: &str = "<ModelStructure><Outputs><Unknown index='1'/></Outputs></ModelStructure>";
const DEPENDENCIES: &str = "<ModelStructure><Outputs><Unknown index='1' dependencies='2'/></Outputs></ModelStructure>";

/// A folder with a loop of two units, `one` and `two`, each handed the other's `y` as `u`.
struct Pair(TempDir);

impl Pair {
    /// Units by their source, variables and structure.
    fn new(units: [(&str, Variables, &str); 2], values: &str, order: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let resources = folder.path().join("resources");
        fs::create_dir(&resources).unwrap();
        for (name, (source, variables, structure)) in ["One", "Two"].into_iter().zip(units) {
            let inner = foreign::variables(variables) + structure;
            foreign::fmu(&resources, name, source, &foreign::description(name, &inner));
        }
        let text = foreign::structure(
            &[("one", "resources/One.fmu"), ("two", "resources/Two.fmu")],
            &[("one.y", "two.u"), ("two.y", "one.u")],
            &foreign::experiment(0.5, 0.1, order),
        );
        let values = format!(
            "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet xmlns:ssv='v' name='p' \
             version='1.0'><ssv:Parameters>{values}</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>\
             </ssd:ParameterBinding></ssd:ParameterBindings>"
        );
        let text = text.replacen("<ssd:Elements>", &format!("{values}<ssd:Elements>"), 1);
        fs::write(folder.path().join("SystemStructure.ssd"), text).unwrap();
        Pair(folder)
    }

    fn recording(&self) -> Recording {
        let structure = LoopFiles::find(self.0.path().to_str().unwrap()).unwrap().structure().unwrap();
        let loaded = LoadedLoop::new(&structure, &self.0.path().join("resources"), &Hosting::InProcess).unwrap();
        let settings = Settings { start_time: 0.0, stop_time: 0.5, step: 0.1 };
        loaded.instantiate(&[]).unwrap().run(settings, |_| true).unwrap()
    }

    /// Runs the program.
    fn run(&self, options: &[&str]) -> Output {
        let mut program = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
        program.arg("run").arg(self.0.path()).args(options).arg("--out").arg(self.0.path().join("results"));
        program.output().unwrap()
    }
}

fn gain(unit: &str, gain: f64) -> String {
    format!("<ssv:Parameter name='{unit}.gain'><ssv:Real value='{gain}'/></ssv:Parameter>")
}

fn loop_warnings(recording: &Recording) -> Vec<&String> {
    recording.warnings.iter().filter(|text| text.contains("algebraic loop") || text.contains("converge")).collect()
}

#[test]
fn a_plant_that_declares_no_dependencies_runs_in_a_loop_in_both_orders() {
    for structure in [UNTOLD, "<ModelStructure><Outputs/></ModelStructure>", "<ModelStructure/>", ""] {
        for order in [Order::Jacobi, Order::GaussSeidel] {
            let units = [("lag.c", LAG, structure), ("gain.c", GAIN, DEPENDENCIES)];
            let recording = Pair::new(units, "", &order.to_string()).recording();
            let warnings = loop_warnings(&recording);
            assert_eq!(warnings.len(), 1, "{warnings:?}");
            assert!(
                warnings[0].starts_with("`one` does not declare") && warnings[0].contains("previous exchange"),
                "{warnings:?}"
            );
            // x' = u - x by steps of 0.1, u = 2 (1 - x) of the exchange before.
            let (mut x, mut u) = (0.0, 2.0);
            for k in 0..=5 {
                let found = [recording.column("one.y").unwrap()[k], recording.column("two.y").unwrap()[k]];
                assert!((found[0] - x).abs() < 1e-12 && (found[1] - u).abs() < 1e-12, "{order} {k}: {found:?} {x} {u}");
                let before = x;
                x += 0.1 * (u - x);
                u = 2.0 * (1.0 - if order == Order::Jacobi { before } else { x });
            }
        }
    }
}

#[test]
fn values_that_go_round_at_once_settle_before_the_first_step() {
    let units = [("gain.c", GAIN, UNTOLD), ("gain.c", GAIN, UNTOLD)];
    let recording = Pair::new(units, &(gain("one", 0.5) + &gain("two", 0.8)), "jacobi").recording();
    let warnings = loop_warnings(&recording);
    assert!(warnings.len() == 1 && warnings[0].starts_with("`one`, `two` do not declare"), "{warnings:?}");
    // a = 0.5 (1 - b), b = 0.8 (1 - a)
    let (a, b) = (0.1 / 0.6, 0.4 / 0.6);
    for k in 0..=5 {
        assert!((recording.column("one.y").unwrap()[k] - a).abs() < 1e-8);
        assert!((recording.column("two.y").unwrap()[k] - b).abs() < 1e-8);
    }
}

#[test]
fn values_that_never_settle_are_reported_by_the_signal_and_its_change() {
    let units = [("gain.c", GAIN, UNTOLD), ("gain.c", GAIN, UNTOLD)];
    let recording = Pair::new(units, &(gain("one", 2.0) + &gain("two", 3.0)), "gauss-seidel").recording();
    let warnings = loop_warnings(&recording);
    assert!(
        warnings.len() == 2 && warnings[1].contains("don't converge. `") && warnings[1].contains("changed by"),
        "{warnings:?}"
    );
    // Two rounds of a = 2 (1 - b), b = 3 (1 - a), from b = 0.
    let found = [recording.column("one.y").unwrap()[0], recording.column("two.y").unwrap()[0]];
    assert_eq!(found, [8.0, -21.0]);
}

#[test]
fn a_declared_algebraic_loop_runs_only_where_the_user_accepts_it() {
    let units = [("gain.c", GAIN, DEPENDENCIES), ("gain.c", GAIN, DEPENDENCIES)];
    let pair = Pair::new(units, &(gain("one", 0.5) + &gain("two", 0.8)), "jacobi");
    let refused = pair.run(&[]);
    let error = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(1), "{error}");
    assert!(
        error.contains("one.y → two.u → two.y → one.u → one.y") && error.contains("--accept-algebraic-loops"),
        "{error}"
    );
    let accepted = pair.run(&["--accept-algebraic-loops", "--json"]);
    assert_eq!(accepted.status.code(), Some(0), "{}", String::from_utf8_lossy(&accepted.stderr));
    let error: serde_json::Value = serde_json::from_slice(&accepted.stdout).unwrap();
    let warnings = error["warnings"].as_array().unwrap();
    assert!(warnings.iter().any(|text| text.as_str().unwrap().contains("algebraic loop, accepted")), "{error}");
    assert_eq!(pair.run(&["--accept-algebraic-loops", "--composite"]).status.code(), Some(2));
}

/// A reference of this package's kinds, as a description.
const REFERENCE: &str = "name = \"Wanted\"\nmodel = \"reference\"\ndescription = \"\"\n[structure]\nchannels = 1\n\
    [start]\noffset = [1.0]\n[experiment]\nstop_time = 2.0\nstep = 0.05\n";

/// A folder with FMUs in several places: `resources/Lag.fmu`, `resources/Wanted.toml`, and `other units/Gain.fmu` next
/// to it.
fn places() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let (resources, other) = (folder.path().join("loop/resources"), folder.path().join("other units"));
    fs::create_dir_all(&resources).unwrap();
    fs::create_dir(&other).unwrap();
    foreign::fmu(&resources, "Lag", "lag.c", &foreign::description("Lag", &(foreign::variables(LAG) + UNTOLD)));
    foreign::fmu(&other, "Gain", "gain.c", &foreign::description("Gain", &(foreign::variables(GAIN) + DEPENDENCIES)));
    fs::write(resources.join("Wanted.toml"), REFERENCE).unwrap();
    folder
}

/// Runs the program in a folder, and returns its output.
fn run_json(folder: &TempDir, words: &[&str]) -> serde_json::Value {
    let mut program = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
    let done = program.current_dir(folder.path()).args(words).arg("--json").output().unwrap();
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    serde_json::from_slice(&done.stdout).unwrap()
}

/// The last row of a result, by names.
fn last_row(folder: &TempDir, output: &serde_json::Value) -> Vec<(String, f64)> {
    let text = fs::read_to_string(folder.path().join(output["results"].as_str().unwrap()).join("result.csv")).unwrap();
    let names = text.lines().next().unwrap().split(',').map(|name| name.trim_matches('"').to_owned());
    names.zip(text.lines().last().unwrap().split(',').map(|value| value.parse().unwrap())).collect()
}

fn value(row: &[(String, f64)], name: &str) -> f64 {
    row.iter().find(|(known, _)| known == name).unwrap_or_else(|| panic!("{name} in {row:?}")).1
}

#[test]
fn units_may_lie_in_resources_elsewhere_or_be_descriptions() {
    let folder = places();
    let uri = format!("file://{}", folder.path().join("other%20units/Gain.fmu").display());
    let mut rows = Vec::new();
    for source in ["../other units/Gain.fmu", "../other%20units/Gain.fmu", &uri] {
        let units = [("wanted", "resources/Wanted.toml"), ("lag", "resources/Lag.fmu"), ("gain", source)];
        let connections = [("wanted.r[1]", "gain.u"), ("gain.y", "lag.u")];
        let text = foreign::structure(&units, &connections, &foreign::experiment(1.0, 0.1, "jacobi"));
        fs::write(folder.path().join("loop/SystemStructure.ssd"), text).unwrap();
        let output = run_json(&folder, &["run", "loop", "--out", "results"]);
        assert_eq!(output["ended"], "complete");
        rows.push(last_row(&folder, &output));
    }
    // 2 (1 - 1) all the time.
    assert_eq!((value(&rows[0], "wanted.r[1]"), value(&rows[0], "gain.y"), value(&rows[0], "time")), (1.0, 0.0, 1.0));
    assert!(rows.iter().all(|row| *row == rows[0]));
    // Packed, all are in the archive, which runs as it is.
    let packed = run_json(&folder, &["export", "--ssp", "loop", "--out", "packed"]);
    let archive = packed["ssps"][0].as_str().unwrap();
    let again = run_json(&folder, &["run", archive, "--out", "again"]);
    assert_eq!(last_row(&folder, &again), rows[0]);
    let mut program = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
    let refused = program.current_dir(folder.path()).args(["run", "loop", "--composite"]).output().unwrap();
    let refused = String::from_utf8(refused.stderr).unwrap();
    assert!(refused.contains("`gain` is an FMU archive"), "{refused}");
}

#[test]
fn a_structure_without_our_annotation_runs_as_its_units_propose() {
    let folder = places();
    let experiment = "<DefaultExperiment stopTime='1.5' stepSize='0.02'/>";
    let inner = experiment.to_owned() + &foreign::variables(LAG) + UNTOLD;
    foreign::fmu(&folder.path().join("loop/resources"), "Lag", "lag.c", &foreign::description("Lag", &inner));
    let units =
        [("lag", "resources/Lag.fmu"), ("gain", "../other%20units/Gain.fmu"), ("wanted", "resources/Wanted.toml")];
    let connections = [("gain.y", "lag.u"), ("wanted.r[1]", "gain.u")];
    let run = |connections: &[(&str, &str)], rest: &str| {
        let text = foreign::structure(&units, connections, rest);
        fs::write(folder.path().join("loop/SystemStructure.ssd"), text).unwrap();
        let output = run_json(&folder, &["run", "loop", "--out", "results"]);
        let warnings = output["warnings"].as_array().unwrap().clone();
        let about: Vec<_> =
            warnings.iter().filter_map(|text| text.as_str()).filter(|text| text.contains("annotation")).collect();
        assert_eq!(about.len(), 1, "{warnings:?}");
        (about[0].to_owned(), last_row(&folder, &output))
    };
    let (output, row) = run(&connections, "");
    assert!(output.contains("communication step 0.02 s") && output.contains("stop time 2 s"), "{output}");
    assert!(output.contains("gauss-seidel in the order wanted, gain, lag"), "{output}");
    assert_eq!(value(&row, "time"), 2.0);
    let (output, row) = run(&connections, "<ssd:DefaultExperiment startTime='0.5' stopTime='0.8'/>");
    assert!(output.contains("stop time 0.8 s") && value(&row, "time") == 0.8, "{output}");
    // OMSimulator stores its step in an annotation of its own.
    let theirs = "<ssd:DefaultExperiment stopTime='1'><ssd:Annotations><ssc:Annotation type='org.openmodelica'>\
        <oms:Annotations xmlns:oms='o'><oms:SimulationInformation><oms:FixedStepMaster description='oms-ma' stepSize='0.25'/>\
        </oms:SimulationInformation></oms:Annotations></ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment>";
    assert!(run(&connections, theirs).0.contains("communication step 0.25 s (from another tool's annotation)"));
}

/// Static units, each driven by the one before, in an order that passes a value on by one unit a round.
#[test]
fn a_value_has_gone_through_all_units_when_a_run_begins_and_many_are_reported_by_their_number() {
    const COUNT: usize = 40;
    let folder = places();
    let passes = "name = \"Passes\"\nmodel = \"state-space\"\ndescription = \"\"\n[structure]\nA = [[-1.0]]\n\
        B = [[0.0]]\nC = [[0.0]]\nD = [[1.0]]\n";
    fs::write(folder.path().join("loop/resources/Passes.toml"), passes).unwrap();
    let names: Vec<String> = (0..COUNT).map(|k| format!("unit{k}")).collect();
    let mut units: Vec<_> = names.iter().rev().map(|name| (name.as_str(), "resources/Passes.toml")).collect();
    units.push(("wanted", "resources/Wanted.toml"));
    let wires: Vec<_> = (1..COUNT).map(|k| (format!("unit{}.y[1]", k - 1), format!("unit{k}.u[1]"))).collect();
    let mut connections: Vec<_> = wires.iter().map(|(from, to)| (from.as_str(), to.as_str())).collect();
    connections.push(("wanted.r[1]", "unit0.u[1]"));
    let run = |rest: &str| {
        let text = foreign::structure(&units, &connections, rest);
        fs::write(folder.path().join("loop/SystemStructure.ssd"), text).unwrap();
        run_json(&folder, &["run", "loop", "--until", "0.1", "--out", "results"])
    };
    let ran = run(&foreign::experiment(0.2, 0.1, "gauss-seidel"));
    let table = folder.path().join(ran["results"].as_str().unwrap()).join("result.csv");
    let text = fs::read_to_string(table).unwrap();
    let names = text.lines().next().unwrap().split(',');
    let first = names.zip(text.lines().nth(1).unwrap().split(',')).filter(|(name, _)| name.ends_with(".y[1]"));
    let first: Vec<&str> = first.map(|(_, value)| value).collect();
    assert_eq!(first, ["1"; COUNT], "{text}");
    let ran = run("");
    let warnings = ran["warnings"].as_array().unwrap().iter().filter_map(|text| text.as_str());
    let order = warnings.filter(|text| text.contains("in the order")).collect::<String>();
    assert!(
        order.contains("order wanted, unit0, unit1,") && order.ends_with("unit18, …, unit39 (41 components)"),
        "{order}"
    );
}

/// Files of OMSimulator have a system within the model's, connectors of systems, values in files of resources, its own
/// annotations, geometry, and start values of connected inputs.
#[test]
fn a_package_as_omsimulator_writes_it_runs() {
    let folder = places();
    let loop_folder = folder.path().join("loop");
    let geometry = "<ssd:ConnectorGeometry x='0.0' y='0.5'/>";
    let connector = |name: &str, kind: &str| {
        format!("<ssd:Connector name='{name}' kind='{kind}'><ssc:Real/>{geometry}</ssd:Connector>")
    };
    let unit = |name: &str, source: &str, connectors: &str| {
        format!(
            "<ssd:Component name='{name}' type='application/x-fmu-sharedlibrary' source='{source}'><ssd:Connectors>{connectors}</ssd:Connectors><ssd:ElementGeometry x1='0' y1='0' x2='1' y2='1'/></ssd:Component>"
        )
    };
    fs::copy(folder.path().join("other units/Gain.fmu"), loop_folder.join("resources/0001_gain.fmu")).unwrap();
    let lag = unit("lag", "resources/Lag.fmu", &(connector("y", "output") + &connector("u", "input")));
    let gain = unit(
        "gain",
        "resources/0001_gain.fmu",
        &(connector("y", "output")
            + &connector("u", "input")
            + &connector("gain", "parameter")
            + &connector("r", "parameter")),
    );
    let connection = |from: [&str; 2], to: [&str; 2]| {
        format!(
            "<ssd:Connection startElement='{}' startConnector='{}' endElement='{}' endConnector='{}'/>",
            from[0], from[1], to[0], to[1]
        )
    };
    let annotation = "<ssd:Annotations><ssc:Annotation type='org.openmodelica'><oms:Annotations><oms:SimulationInformation>\
        <oms:FixedStepMaster description='oms-ma' stepSize='0.100000' absoluteTolerance='0.000100' relativeTolerance='0.000100'/>\
        </oms:SimulationInformation></oms:Annotations></ssc:Annotation></ssd:Annotations>";
    let text = format!(
        "<?xml version='1.0'?><ssd:SystemStructureDescription xmlns:ssc='c' xmlns:ssd='d' xmlns:ssv='v' xmlns:ssm='m' xmlns:ssb='b' \
         xmlns:oms='o' name='model:1' version='1.0'><ssd:System name='root'><ssd:Connectors>{}</ssd:Connectors>\
         <ssd:ParameterBindings><ssd:ParameterBinding source='resources/root.ssv'/></ssd:ParameterBindings>\
         <ssd:Elements><ssd:System name='plant'><ssd:Connectors>{}{}</ssd:Connectors><ssd:Elements>{lag}</ssd:Elements>\
         <ssd:Connections>{}{}</ssd:Connections></ssd:System>{gain}</ssd:Elements><ssd:Connections>{}{}{}</ssd:Connections>\
         {annotation}</ssd:System><ssd:DefaultExperiment startTime='0.000000' stopTime='1.000000'/></ssd:SystemStructureDescription>",
        connector("measured", "output"),
        connector("drive", "input"),
        connector("speed", "output"),
        connection(["", "drive"], ["lag", "u"]),
        connection(["lag", "y"], ["", "speed"]),
        connection(["gain", "y"], ["plant", "drive"]),
        connection(["plant", "speed"], ["gain", "u"]),
        connection(["plant", "speed"], ["", "measured"]),
    );
    fs::write(loop_folder.join("SystemStructure.ssd"), text).unwrap();
    let real =
        |name: &str, value: f64| format!("<ssv:Parameter name='{name}'><ssv:Real value='{value}'/></ssv:Parameter>");
    let values = real("gain.gain", 3.0) + &real("gain.u", 0.5) + &real("plant.drive", 7.0) + &real("plant.lag.x", 0.25);
    let set = format!(
        "<ssv:ParameterSet xmlns:ssv='v' version='1.0' name='parameters'><ssv:Parameters>{values}</ssv:Parameters></ssv:ParameterSet>"
    );
    fs::write(loop_folder.join("resources/root.ssv"), set).unwrap();
    let output = run_json(&folder, &["run", "loop", "--out", "results"]);
    assert_eq!(output["loop"], "model_1");
    let row = last_row(&folder, &output);
    // Gauss-Seidel, the system's plant first: x' = 3 (1 - x) - x by steps of 0.1 from x = 1/4.
    let expected = (0..10).fold(0.25, |x, _| x + 0.1 * (3.0 * (1.0 - x) - x));
    assert!((value(&row, "plant.lag.y") - expected).abs() < 1e-12, "{row:?} {expected}");
}
