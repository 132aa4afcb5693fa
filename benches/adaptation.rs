//! Cost of a communication step of L1 controllers at equal accuracy: with their closed form where it holds and pays
//! (`automatic`), against the general integrator alone.
//!
//! Each loop is simulated at its communication step of 1 ms, its controller integrated tightly. Both methods then take a
//! step of each length from the recorded states, with the recorded inputs: once as the loop starts, when estimates run
//! into their bounds, once when it tracks. Each method is timed at the loosest tolerance with which it is as accurate as
//! asked in every one of these steps: x̂, η̂ and u_ad at the step's end, against a reference and relative to the largest
//! magnitude that each has among all ends.

use std::hint::black_box;
use std::time::Duration;

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::Section;
use common::models::Run;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

/// A loop: its name, its units (the plant, what gives the reference, the controller), lines of the controller's start.
struct Loop {
    name: &'static str,
    units: [&'static str; 3],
    start: &'static str,
}

const LOOPS: [Loop; 3] = [
    Loop { name: "chapter 4, case 1", units: ["ReferenceActuatedSiso", "ActuatedSiso", "L1ActuatedSiso"], start: "" },
    Loop {
        name: "example 3.3.1, case 2",
        units: ["ReferenceTwoLinkRobot", "TwoLinkRobot", "L1TwoLinkRobot"],
        start: "pole_real = [-30.0, -30.0, -40.0, -40.0]\npole_imag = [0.5, -0.5, 0.5, -0.5]",
    },
    Loop { name: "example 3.2.1", units: ["ReferenceNonlinearSiso", "NonlinearSiso", "L1NonlinearSiso"], start: "" },
];

/// Communication step of the loops, s, and how many steps are taken from a record.
const STEP: f64 = 1e-3;
const COUNT: usize = 100;
/// The first of these steps.
const PHASES: [(&str, usize); 2] = [("start", 1), ("tracking", 2000)];
/// The steps that are timed, s.
const TIMED: [f64; 3] = [1e-2, 1e-3, 1e-4];
const ACCURACIES: [f64; 2] = [1e-3, 1e-4];

/// A method, and what stands before its tolerance among the start values.
type Method = (&'static str, &'static str);
const CLOSED_FORM: Method = ("automatic", "relative_tolerance");
const GENERAL: Method = ("general", "integration_method = 'explicit'\nrelative_tolerance");

/// A unit with further lines in its `[start]`, in place of those of the same names.
fn unit(name: &str, start: &str) -> Run {
    let folder = common::description_folder();
    let text = std::fs::read_to_string(folder.join(format!("{name}.toml"))).unwrap();
    let mut description = Description::read(&text).unwrap();
    description.start.extend(start.parse::<toml::Table>().unwrap());
    let mut run = Run(Execution::new(Model::from_description(description, REGISTRY).unwrap()));
    run.0.initialise().unwrap();
    run
}

/// The elements of a vector, by name.
fn elements(run: &Run, vector: &str) -> Vec<String> {
    let names = (1..).map(|i| format!("{vector}[{i}]"));
    names.take_while(|name| run.0.model().variables().find(name).is_some()).collect()
}

fn controller(of: &Loop, (_, option): Method, tolerance: f64) -> Run {
    unit(of.units[2], &format!("{}\n{option} = {tolerance:e}", of.start))
}

/// Where a step begins.
struct Begin {
    inputs: Vec<f64>,
    states: Vec<f64>,
}

/// Simulates a loop to the end of its last phase; where each of the controller's steps begins.
fn record(of: &Loop) -> Vec<Begin> {
    let [mut reference, mut plant] = [of.units[0], of.units[1]].map(|name| unit(name, ""));
    let mut controller = controller(of, GENERAL, 1e-8);
    let hand_over = |from: &Run, to: &mut Run, vector: &str| {
        elements(to, vector).iter().for_each(|name| to.set(name, from.get(name)));
    };
    let variables = controller.0.model().variables();
    let [inputs, states] = [Section::Input, Section::State].map(|section| variables.reals(section));
    let step = |_| {
        reference.step(STEP);
        hand_over(&controller, &mut plant, "u");
        plant.step(STEP);
        hand_over(&reference, &mut controller, "r");
        hand_over(&plant, &mut controller, "x");
        let reals = &controller.0.block().reals;
        let begin = Begin { inputs: reals[inputs.clone()].to_vec(), states: reals[states.clone()].to_vec() };
        controller.step(STEP);
        begin
    };
    (0..PHASES[1].1 + COUNT).map(step).collect()
}

/// A controller that goes on from whatever states it is given: its very first step takes them from the inputs.
fn replaying(of: &Loop, method: Method, tolerance: f64) -> Run {
    let mut controller = controller(of, method, tolerance);
    controller.step(STEP);
    controller
}

/// Takes a step of length h from each of these; `after` sees where it ends.
fn replay(controller: &mut Run, begins: &[Begin], h: f64, mut after: impl FnMut(&Run)) {
    let variables = controller.0.model().variables();
    let [inputs, states] = [Section::Input, Section::State].map(|section| variables.reals(section));
    for begin in begins {
        let reals = &mut controller.0.block_mut().reals;
        reals[inputs.clone()].copy_from_slice(&begin.inputs);
        reals[states.clone()].copy_from_slice(&begin.states);
        controller.step(h);
        after(controller);
    }
}

/// x̂, η̂ and u_ad where the steps end.
fn ends(of: &Loop, method: Method, tolerance: f64, begins: &[Begin], h: f64) -> Vec<Vec<f64>> {
    let mut controller = replaying(of, method, tolerance);
    let names = ["x_hat", "eta_hat", "u_ad"].map(|vector| elements(&controller, vector)).concat();
    let mut rows = Vec::new();
    replay(&mut controller, begins, h, |controller| rows.push(names.iter().map(|name| controller.get(name)).collect()));
    rows
}

/// The largest difference, relative to the largest magnitude of each column.
fn difference(found: &[Vec<f64>], expected: &[Vec<f64>]) -> f64 {
    let column = |i: usize| {
        let magnitude = expected.iter().map(|row| row[i].abs()).fold(0.0, f64::max);
        let differences = found.iter().zip(expected).map(|(found, expected)| (found[i] - expected[i]).abs());
        differences.fold(0.0, f64::max) / magnitude
    };
    (0..expected[0].len()).map(column).fold(0.0, f64::max)
}

/// The loosest tolerances, of two a decade, with which a method is as accurate as asked.
fn tolerances(of: &Loop, method: Method, begins: &[Begin], h: f64, expected: &[Vec<f64>]) -> [Option<f64>; 2] {
    let grid = (4..=16).map(|k| 10_f64.powf(-f64::from(k) / 2.0));
    let mut found = [None; 2];
    for tolerance in grid {
        let error = difference(&ends(of, method, tolerance, begins, h), expected);
        for (found, asked) in found.iter_mut().zip(ACCURACIES) {
            *found = found.or((error <= asked).then_some(tolerance));
        }
        if found[1].is_some() {
            break;
        }
    }
    found
}

fn compare(criterion: &mut Criterion, name: &str, of: &Loop, begins: &[Begin], h: f64) {
    let expected = ends(of, GENERAL, 1e-11, begins, h);
    let finest = difference(&ends(of, CLOSED_FORM, 1e-9, begins, h), &expected);
    println!("{name}: at its tightest tolerance the closed form differs from the general integrator's by {finest:.1e}");
    for method in [CLOSED_FORM, GENERAL] {
        let mut group = criterion.benchmark_group(name);
        group.throughput(Throughput::Elements(begins.len() as u64)).sample_size(10);
        group.warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_secs(1));
        for (asked, tolerance) in ACCURACIES.into_iter().zip(tolerances(of, method, begins, h, &expected)) {
            let Some(tolerance) = tolerance else {
                println!("{name}: the {} isn't as accurate as {asked:e} in every step", method.0);
                continue;
            };
            let mut controller = replaying(of, method, tolerance);
            group.bench_function(format!("{} to {asked:e}, tolerance {tolerance:.1e}", method.0), |bencher| {
                bencher.iter(|| replay(&mut controller, begins, h, |controller| _ = black_box(controller)));
            });
        }
        group.finish();
    }
}

fn adaptation(criterion: &mut Criterion) {
    for of in &LOOPS {
        let recorded = record(of);
        for (phase, first) in PHASES {
            for h in TIMED {
                let name = format!("{}, {phase}, step {} ms", of.name, h * 1e3);
                compare(criterion, &name, of, &recorded[first..first + COUNT], h);
            }
        }
    }
}

criterion_group!(benches, adaptation);
criterion_main!(benches);
