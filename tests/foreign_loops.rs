//! Loops with units of other tools, which tell less of themselves than the standard lets them.

mod foreign;

use std::fs;
use std::process::{Command, Output};

use adaptive_fmu::simulation::{LoadedLoop, LoopFiles, Order, Recording, Settings};
use tempfile::TempDir;

const LAG: &[(&str, &str, &str)] = &[("y", "output", ""), ("u", "input", ""), ("x", "parameter", "")];
const GAIN: &[(&str, &str, &str)] =
    &[("y", "output", ""), ("u", "input", ""), ("r", "parameter", "start='1'"), ("gain", "parameter", "start='2'")];
const UNTOLD: &str = "<ModelStructure><Outputs><Unknown index='1'/></Outputs></ModelStructure>";
const TOLD: &str = "<ModelStructure><Outputs><Unknown index='1' dependencies='2'/></Outputs></ModelStructure>";

/// A folder with a loop of two units, `one` and `two`, each handed the other's `y` as `u`.
struct Pair(TempDir);

impl Pair {
    /// Units by their source, variables and structure.
    fn new(units: [(&str, &[(&str, &str, &str)], &str); 2], values: &str, order: &str) -> Self {
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
        let loaded = LoadedLoop::new(&structure, &self.0.path().join("resources")).unwrap();
        let settings = Settings { start_time: 0.0, stop_time: 0.5, step: 0.1, order: structure.order };
        loaded.instantiate(&[]).unwrap().run(settings, |_| true).unwrap()
    }

    /// By the program.
    fn run(&self, options: &[&str]) -> Output {
        let mut program = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
        program.arg("run").arg(self.0.path()).args(options).arg("--out").arg(self.0.path().join("results"));
        program.output().unwrap()
    }
}

fn gain(unit: &str, gain: f64) -> String {
    format!("<ssv:Parameter name='{unit}.gain'><ssv:Real value='{gain}'/></ssv:Parameter>")
}

fn about_circles(recording: &Recording) -> Vec<&String> {
    recording.warnings.iter().filter(|text| text.contains("algebraic loop") || text.contains("settle")).collect()
}

#[test]
fn a_plant_that_tells_no_dependencies_runs_in_a_loop_in_both_orders() {
    for structure in [UNTOLD, "<ModelStructure><Outputs/></ModelStructure>", "<ModelStructure/>", ""] {
        for order in [Order::Jacobi, Order::GaussSeidel] {
            let units = [("lag.c", LAG, structure), ("gain.c", GAIN, TOLD)];
            let recording = Pair::new(units, "", &order.to_string()).recording();
            let told = about_circles(&recording);
            assert_eq!(told.len(), 1, "{told:?}");
            assert!(told[0].starts_with("`one` does not tell") && told[0].contains("last exchange"), "{told:?}");
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
    let told = about_circles(&recording);
    assert!(told.len() == 1 && told[0].starts_with("`one`, `two` do not tell"), "{told:?}");
    // a = .5 (1 - b), b = .8 (1 - a)
    let (a, b) = (0.1 / 0.6, 0.4 / 0.6);
    for k in 0..=5 {
        assert!((recording.column("one.y").unwrap()[k] - a).abs() < 1e-8);
        assert!((recording.column("two.y").unwrap()[k] - b).abs() < 1e-8);
    }
}

#[test]
fn values_that_never_settle_are_told_by_the_signal_and_its_change() {
    let units = [("gain.c", GAIN, UNTOLD), ("gain.c", GAIN, UNTOLD)];
    let recording = Pair::new(units, &(gain("one", 2.0) + &gain("two", 3.0)), "gauss-seidel").recording();
    let told = about_circles(&recording);
    assert!(told.len() == 2 && told[1].contains("don't settle, `") && told[1].contains("changed by"), "{told:?}");
    // Two rounds of a = 2 (1 - b), b = 3 (1 - a), from b = 0.
    let found = [recording.column("one.y").unwrap()[0], recording.column("two.y").unwrap()[0]];
    assert_eq!(found, [8.0, -21.0]);
}

#[test]
fn a_declared_algebraic_loop_runs_only_where_the_user_accepts_it() {
    let units = [("gain.c", GAIN, TOLD), ("gain.c", GAIN, TOLD)];
    let pair = Pair::new(units, &(gain("one", 0.5) + &gain("two", 0.8)), "jacobi");
    let refused = pair.run(&[]);
    let told = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(1), "{told}");
    assert!(
        told.contains("one.y → two.u → two.y → one.u → one.y") && told.contains("--accept-algebraic-loops"),
        "{told}"
    );
    let accepted = pair.run(&["--accept-algebraic-loops", "--json"]);
    assert_eq!(accepted.status.code(), Some(0), "{}", String::from_utf8_lossy(&accepted.stderr));
    let told: serde_json::Value = serde_json::from_slice(&accepted.stdout).unwrap();
    let warnings = told["warnings"].as_array().unwrap();
    assert!(warnings.iter().any(|text| text.as_str().unwrap().contains("algebraic loop, accepted")), "{told}");
    assert_eq!(pair.run(&["--accept-algebraic-loops", "--composite"]).status.code(), Some(2));
}
