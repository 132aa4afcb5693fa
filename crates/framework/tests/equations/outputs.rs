//! The tolerance is valid for outputs of loops, not for states only.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::system::{Causality, Section, Variability};
use common::described::model;
use common::loops::whole;
use common::models::rows;

const STEP: f64 = 0.01;
const POINTS: usize = 100;

/// The continuous outputs of a loop as a single FMU that aren't states, at each point of a second.
fn outputs(name: &str, method: &str, tolerance: f64, in_one_go: bool) -> Vec<Vec<f64>> {
    let start = format!("\n[start]\nintegration_method = '{method}'\nrelative_tolerance = {tolerance:e}\n");
    let mut execution = Execution::new(model(&whole(name).replace("\n[start]\n", &start)).unwrap());
    execution.initialise().unwrap();
    let variables = execution.model().variables();
    let shown = variables.visible().filter(|e| {
        let (v, continuous) = (e.variable, Variability::Continuous);
        v.section == Section::Signal && v.is_real() && v.causality == Causality::Output && v.variability == continuous
    });
    let places: Vec<_> = shown.map(|element| variables.index(element)).collect();
    let times: Vec<_> = (0..=POINTS).map(|k| k as f64 * STEP).collect();
    rows(&mut execution, &times, &places, in_one_go)
}

/// The largest error of an output, relative to its largest magnitude.
fn error(found: &[Vec<f64>], exact: &[Vec<f64>]) -> f64 {
    let of = |k: usize| {
        let size = exact.iter().map(|point| point[k].abs()).fold(0.0, f64::max);
        let apart = found.iter().zip(exact).map(|(found, exact)| (found[k] - exact[k]).abs()).fold(0.0, f64::max);
        if size > 0.0 { apart / size } else { apart }
    };
    (0..exact[0].len()).map(of).fold(0.0, f64::max)
}

#[test]
fn outputs_of_composites_are_within_ten_times_the_tolerance() {
    for name in ["3.3.1-case2", "3.3.2-case1", "3.3.3", "3.4.2", "4-case1"] {
        let exact = outputs(name, "stiff", 1e-11, false);
        for tolerance in [1e-4, 1e-6, 1e-8] {
            for in_one_go in [false, true] {
                let error = error(&outputs(name, "automatic", tolerance, in_one_go), &exact);
                println!("{name}, {tolerance:e}, in one go: {in_one_go}: {:.2} tolerances", error / tolerance);
                assert!(error < 10.0 * tolerance, "{name}, {tolerance:e}: {error:e}");
            }
        }
    }
}
