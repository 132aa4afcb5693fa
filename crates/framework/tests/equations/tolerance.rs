//! The tolerance in force rules every unit, whatever integrates it: the errors of states and outputs fall with it.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::system::{Causality, Section, Variability};
use common::described::{model, open_description};
use common::models::Run;
use common::sample::sampled_names;

const EXPLICIT: i32 = 2;
const STEPS: usize = 40;
const LONGER: f64 = 20.0;
/// Tolerances that are asked for.
const TOLERANCES: [f64; 3] = [1e-3, 1e-6, 1e-9];

/// Who asks for the tolerance.
#[derive(Debug, Clone, Copy)]
enum Asked {
    /// The user, by `relative_tolerance`.
    ByUser,
    /// The master, in fmi2SetupExperiment, where the user's is looser.
    ByMaster,
}

/// A unit whose funnels are wide, at this tolerance. `None` where it has none.
fn unit(name: &str, tolerance: f64, asked: Asked, handling: i32, method: Option<i32>) -> Option<Run> {
    let mut run = Run(Execution::new(model(&open_description(name)).unwrap()));
    let own = run.0.model().variables().find("relative_tolerance").is_some();
    if !own {
        return None;
    }
    match asked {
        Asked::ByUser => run.set("relative_tolerance", tolerance),
        Asked::ByMaster => {
            run.set("relative_tolerance", 1e-2);
            run.0.set_tolerance(tolerance);
        }
    }
    put(&mut run, "input_handling", handling);
    method.into_iter().for_each(|method| put(&mut run, "integration_method", method));
    run.0.initialise().unwrap();
    Some(run)
}

fn put(run: &mut Run, name: &str, value: i32) {
    let variables = run.0.model().variables();
    if let Some(element) = variables.find(name) {
        let place = variables.index(element);
        run.0.block_mut().integers[place] = value;
    }
}

/// Names of the states and real outputs that change continuously.
fn shown(run: &Run) -> Vec<usize> {
    let variables = run.0.model().variables();
    let continuous = variables.visible().filter(|e| e.variable.variability == Variability::Continuous);
    let wanted = continuous.filter(|e| {
        e.variable.is_real() && (e.variable.section == Section::State || e.variable.causality == Causality::Output)
    });
    wanted.map(|element| variables.index(element)).collect()
}

/// Visible signals of an FMU at the end of each step, with inputs that move a little.
fn motion(run: &mut Run) -> Vec<Vec<f64>> {
    let places = shown(run);
    // Without fast adaptation, its own step is one substep at any tolerance.
    let adapts = run.0.model().variables().find("adaptation_frequency").is_some();
    let step = run.0.model().description().experiment.step * if adapts { 1.0 } else { LONGER };
    let inputs: Vec<_> = run.0.model().variables().reals(Section::Input).collect();
    let row = |k: usize| {
        for (i, &input) in inputs.iter().enumerate() {
            run.0.block_mut().reals[input] = 0.05 * (0.1 * (k + 10 * i) as f64).sin();
        }
        run.step(step);
        places.iter().map(|&place| run.0.block().reals[place]).collect()
    };
    (0..STEPS).map(row).collect()
}

/// The largest difference of two motions, relative to the largest magnitude or nominal value of each variable.
fn difference(run: &Run, found: &[Vec<f64>], expected: &[Vec<f64>]) -> f64 {
    let variables = run.0.model().variables();
    let nominals: Vec<f64> = shown(run)
        .into_iter()
        .map(|place| {
            variables.visible().find(|e| e.variable.is_real() && variables.index(*e) == place).unwrap().nominal()
        })
        .collect();
    let column = |i: usize| {
        let magnitude = expected.iter().map(|row| row[i].abs()).fold(nominals[i], f64::max);
        found.iter().zip(expected).map(|(found, expected)| (found[i] - expected[i]).abs()).fold(0.0, f64::max)
            / magnitude
    };
    (0..nominals.len()).map(column).fold(0.0, f64::max)
}

#[test]
fn errors_fall_with_the_tolerance_in_force_in_every_unit() {
    let mut failed = Vec::new();
    for name in sampled_names() {
        for (handling, asked) in [(1, Asked::ByUser), (1, Asked::ByMaster), (2, Asked::ByUser)] {
            let Some(mut exact) = unit(&name, 1e-11, Asked::ByUser, handling, Some(EXPLICIT)) else { continue };
            let expected = motion(&mut exact);
            // What rounding does, which the unit may amplify.
            let other = motion(&mut unit(&name, 1e-12, Asked::ByUser, handling, Some(EXPLICIT)).unwrap());
            let rounding = difference(&exact, &other, &expected);
            let errors = TOLERANCES.map(|tolerance| {
                difference(&exact, &motion(&mut unit(&name, tolerance, asked, handling, None).unwrap()), &expected)
            });
            let shown = errors.map(|error| format!("{error:.1e}")).join(", ");
            println!("{name:24} {handling} {asked:?}: {shown}; rounding {rounding:.1e}");
            let [loose, usual, tight] = errors;
            let floor = 1e-9 + 10.0 * rounding;
            // Where one step is far better than asked there is nothing to fall.
            let falls = usual <= (0.1 * loose).max(TOLERANCES[1]) && tight <= (0.1 * usual).max(floor);
            if !falls || usual > 1e-4 || tight > 1e-7 + floor {
                failed.push(format!("{name}, input_handling {handling}, {asked:?}: {shown}, rounding {rounding:e}"));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}
