//! Refusals, the report, and descriptions by `new`.

use super::*;
use adaptive_fmu::library::begin;
use adaptive_fmu::report::{Finding, Value, Verdict};
use adaptive_fmu::template::{Plant, Request, Sizes};

/// Reason why this description is not valid or can't start.
fn refused(text: &str) -> String {
    match made(text) {
        Err(reason) => reason,
        Ok(mut unit) => unit.initialise().unwrap_err().to_string(),
    }
}

#[test]
fn what_is_no_controller_is_refused_by_name_and_value() {
    for (start, named) in [
        ("u_min = [1.0, 0.0]\nu_max = [0.5, 1.0]", &["u_min[1] = 1", "below u_max[1] = 0.5"][..]),
        ("tracking_time = [1.0, -0.5]", &["tracking_time[2] = -0.5", "-1 (by the gains), 0 (off)", "1e-9 s"]),
        ("S = [[1.0, 2.0], [2.0, 4.0]]", &["S: least singular value", "must be above 1e-12"]),
        ("S = [[0.0, 0.0], [0.0, 0.0]]", &["S: least singular value", "= 0"]),
        ("K_p = [1.0, -2.0]", &["K_p[2]", "-2"]),
        ("N = [100.0, 0.0]", &["N[2]", "0"]),
    ] {
        let error = refused(&alone(2, start));
        assert!(named.iter().all(|part| error.contains(part)), "{error} names {named:?}");
    }
    for channels in [0, 201] {
        let error = refused(&alone(channels, ""));
        assert!(error.contains(&format!("channels = {channels}")) && error.contains("1 … 200"), "{error}");
    }
}

fn findings(start: &str, step: f64) -> Vec<Finding> {
    let text = alone(1, start).replace("[structure]", &format!("[experiment]\nstep = {step:?}\n[structure]"));
    made(&text).unwrap().model().report().findings
}

fn finding<'a>(findings: &'a [Finding], name: &str) -> Option<&'a Finding> {
    findings.iter().find(|finding| finding.name == name)
}

#[test]
fn the_report_shows_what_a_sampled_output_leaves_of_the_derivative() {
    for (N, H, verdict) in [(100.0, 1e-3, Verdict::Ok), (100.0, 0.01, Verdict::Warning), (20.0, 0.02, Verdict::Ok)] {
        let start = format!("K_p = [1.0]\nK_d = [1.0]\nN = [{N:?}]");
        let found = findings(&start, H);
        let found = finding(&found, "sampled derivative").unwrap();
        let Value::Number(part) = found.value else { panic!("{found:?}") };
        // A ramp of slope −1 that comes in steps, until all that happens repeats itself.
        for (handling, part) in [("hold", part), ("interpolate", 1.0)] {
            let mut run = Run::of(&alone(1, &format!("{start}\ninput_handling = '{handling}'")));
            run.start();
            for k in 1..=200 {
                run.set("y[1]", -f64::from(k) * H).step(H);
            }
            assert!((run.get("D[1]") - part).abs() < 1e-6, "{handling} {found:?}: {}", run.get("D[1]"));
        }
        assert_eq!(found.verdict, verdict);
        assert_eq!(verdict == Verdict::Warning, found.note.contains("A step of 0.0043 s or less"), "{found:?}");
    }
    assert!(finding(&findings("K_p = [1.0]", 0.01), "sampled derivative").is_none());
}

#[test]
fn the_report_warns_of_a_filter_that_ends_the_derivative_and_of_an_integral_that_winds_up() {
    let narrow = findings("K_p = [4.0]\nK_d = [1.0]\nN = [5.0]", 1e-3);
    let corner = finding(&narrow, "corner frequency").unwrap();
    assert!(corner.verdict == Verdict::Warning && corner.note.contains("8 rad/s"), "{corner:?}");
    assert_eq!(finding(&narrow, "gain at high frequencies").unwrap().value, Value::Number(9.0));
    let limited = "K_p = [4.0]\nK_i = [2.0]\nu_max = [1.0]";
    let on = findings(limited, 1e-3);
    let time = finding(&on, "T_t[1]").unwrap();
    assert!(time.value == Value::Number(2.0) && time.verdict == Verdict::Ok, "{time:?}");
    let off = findings(&format!("{limited}\ntracking_time = [0.0]"), 1e-3);
    assert_eq!(finding(&off, "T_t[1]").unwrap().verdict, Verdict::Warning);
    assert!(finding(&findings("K_i = [2.0]", 1e-3), "T_t[1]").is_none(), "no limits");
}

fn request(json: &str) -> Request<'static> {
    let plant = Some(Plant::parse(json).unwrap());
    Request {
        kind: Pid::NAME,
        name: "Mine",
        sizes: Sizes::NONE,
        plant,
        bandwidth: None,
        reference: &[1.0],
        uncertainty: None,
        experiment: None,
    }
}

#[test]
fn a_controller_begun_for_a_plant_brings_its_outputs_to_their_references() {
    for json in [
        r#"{"A": -2, "B": 3, "C": 1}"#,
        r#"{"A": [[-0.5, 250.0], [-25.0, -500.0]], "B": [[0.0], [500.0]], "C": [[1.0, 0.0]]}"#,
        r#"{"A": [[0, 1, 0], [0, 0, 0], [0.3, 0, -1]], "B": [[0, 0], [1, 0.5], [-0.2, 2]], "C": [[1, 0, 0], [0, 0, 1]]}"#,
        r#"{"A": [[0, 1], [9, 0]], "B": [0, -4], "C": [1, 0]}"#,
        // 1 − s over (s + 1)²: a zero at 1.
        r#"{"A": [[0, 1], [-1, -2]], "B": [0, 1], "C": [1, -1]}"#,
    ] {
        let text = begin(&request(json)).unwrap_or_else(|reason| panic!("{json}: {reason}")).text;
        let Plant { A, B, C, .. } = Plant::parse(json).unwrap();
        let table: toml::Table = text.parse().unwrap();
        let mut run = closed(&A, &B, &C, &start_of(&table));
        for i in 1..=B.ncols() {
            run.set(&format!("pid.r[{i}]"), i as f64);
        }
        run.start().step(table["experiment"]["stop_time"].as_float().unwrap());
        for i in 1..=B.ncols() {
            let y = run.get(&format!("plant.y[{i}]"));
            assert!((y / i as f64 - 1.0).abs() < 1e-3, "{json}: y[{i}] = {y}");
        }
    }
}

#[test]
fn for_a_plant_that_no_pid_reaches_none_is_begun() {
    for (json, named) in [
        (r#"{"A": [[0,1,0],[0,0,1],[0,0,0]], "B": [0,0,1], "C": [1,0,0]}"#, "give --bandwidth"),
        (r#"{"A": [[0,1,0,0],[0,0,1,0],[0,0,0,1],[0,0,0,-2]], "B": [0,0,0,1], "C": [1,0,0,0]}"#, "3 poles at 0"),
        (r#"{"A": [[0, 0], [0, -1]], "B": [[1, 1], [1, 1]], "C": [[1, 0], [1, 0]]}"#, "independently of each other"),
        (r#"{"A": [[0, 1], [-1, -2]], "B": [0, 1], "C": [0, 1]}"#, "a zero at 0"),
        (r#"{"A": [[0, 1], [5, 4]], "B": [0, 1], "C": [-6, 1]}"#, "M_s of at least 11"),
    ] {
        let error = begin(&request(json)).unwrap_err().to_string();
        assert!(error.contains(named), "{json}: {error}");
    }
}
