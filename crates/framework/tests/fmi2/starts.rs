//! The start: what its values depend on, and their derivatives by the inputs, in Initialization Mode.

use std::collections::{BTreeMap, BTreeSet};

use adaptive_fmu::execution::Execution;
use adaptive_fmu::framework::structure::Place;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::structure::LoopFiles;
use adaptive_fmu::system::{Causality, Section, Variable};
use adaptive_fmu_library::fmi2_functions::*;
use common::described::open_description;
use common::random::Random;
use common::{ERROR, OK, Unit, at_top, description, description_names};

fn model(text: &str) -> Model {
    Model::from_description(Description::read(text).unwrap(), REGISTRY).unwrap()
}

/// All values after the start with these inputs; nothing where it is refused.
fn start(execution: &mut Execution, inputs: &[(usize, f64)]) -> Option<Vec<f64>> {
    execution.reset();
    // Quantised values move in steps.
    let variables = execution.model().variables();
    let steps: Vec<usize> =
        variables.visible().filter(|e| e.variable.name == "resolution").map(|e| variables.index(e)).collect();
    steps.into_iter().for_each(|place| execution.set_real(place, 0.0));
    inputs.iter().for_each(|&(place, value)| execution.set_real(place, value));
    execution.initialise().ok()?;
    Some(execution.block().reals.clone())
}

#[test]
fn derivatives_of_the_start_are_those_of_its_values() {
    let mut random = Random::new(7);
    let mut all = 0;
    for name in description_names() {
        let mut execution = Execution::new(model(&open_description(&name)));
        let variables = execution.model().variables();
        let inputs: Vec<usize> = variables.reals(Section::Input).collect();
        let sections = [Section::State, Section::Signal, Section::Derivative];
        let unknowns: Vec<usize> = sections.into_iter().flat_map(|section| variables.reals(section)).collect();
        let (mut compared, mut kinks) = (0, 0);
        for _ in 0..10 {
            let at: Vec<(usize, f64)> = inputs.iter().map(|&place| (place, 0.4 * random.next())).collect();
            let seed: Vec<f64> = inputs.iter().map(|_| random.next()).collect();
            let moved = |by: f64| -> Vec<(usize, f64)> {
                at.iter().zip(&seed).map(|(&(place, value), seed)| (place, value + by * seed)).collect()
            };
            let (h, mut points) = (1e-4, Vec::new());
            for by in [h, -h, 2.0 * h, -2.0 * h] {
                points.extend(start(&mut execution, &moved(by)));
            }
            let middle = start(&mut execution, &moved(0.0));
            let (Some(_), [right, left, far_right, far_left]) = (middle, &points[..]) else { continue };
            let knowns: Vec<u32> = inputs.iter().map(|&place| place as u32).collect();
            let found = execution.start_derivative(&knowns, &seed);
            for &unknown in &unknowns {
                let near = (right[unknown] - left[unknown]) / (2.0 * h);
                let far = (far_right[unknown] - far_left[unknown]) / (4.0 * h);
                let (expected, exact) = (near + (near - far) / 3.0, found[unknown]);
                if (near - far).abs() > 1e-4 * exact.abs().max(1.0) {
                    kinks += 1;
                    continue;
                }
                compared += 1;
                let error = (exact - expected).abs() / exact.abs().max(1.0);
                assert!(error < 1e-6, "{name}, {unknown}: {exact}, not {expected}");
            }
        }
        assert!(compared >= 19 * kinks, "{name}: {kinks} kinks in {compared} comparisons");
        all += compared;
    }
    assert!(all > 10_000, "{all}");
}

/// A start value changes only with its declared dependencies.
#[test]
fn nothing_undeclared_changes_the_start() {
    let mut random = Random::new(8);
    for name in description_names() {
        let mut execution = Execution::new(model(&open_description(&name)));
        let variables = execution.model().variables();
        let shown: Vec<_> = variables.visible().map(|e| (e.name(), variables.index(e), e.variable.clone())).collect();
        let wanted = |causality: Causality, section: Section| {
            causality == Causality::Output || matches!(section, Section::State | Section::Derivative)
        };
        let unknowns: Vec<_> = shown.iter().filter(|(_, _, v)| v.is_real() && wanted(v.causality, v.section)).collect();
        let is_known = |v: &Variable| {
            v.is_real()
                && (v.section == Section::Input || v.causality == Causality::Parameter && !variables.is_control(v))
        };
        let knowns: Vec<_> =
            variables.visible().filter(|e| is_known(e.variable)).map(|e| (e.name(), variables.index(e))).collect();
        let at: Vec<(usize, f64)> = variables.reals(Section::Input).map(|place| (place, 0.3 * random.next())).collect();
        let Some(before) = start(&mut execution, &at) else { continue };
        for (known_name, known) in &knowns {
            let mut with = at.clone();
            with.retain(|(place, _)| place != known);
            let value = at.iter().find(|(place, _)| place == known).map_or(before[*known], |(_, value)| *value);
            with.push((*known, value * 1.01 + 1e-3));
            let Some(after) = start(&mut execution, &with) else { continue };
            for (unknown_name, unknown, _) in &unknowns {
                let moved = before[*unknown].to_bits() != after[*unknown].to_bits();
                let is_declared =
                    execution.model().structure().start(Place::Real(*unknown)).contains(&Place::Real(*known));
                assert!(!moved || is_declared, "{name}: the start of {unknown_name} follows from {known_name}");
            }
        }
    }
}

/// The outputs of a loop's units, each with the outputs that its start follows from through connections.
fn graph(name: &str) -> BTreeMap<(String, String), BTreeSet<(String, String)>> {
    let structure = LoopFiles::find(name).unwrap().structure().unwrap();
    let mut graph = BTreeMap::new();
    for component in &structure.components {
        let model = model(&description(&component.fmu));
        let variables = model.variables();
        for output in variables.visible().filter(|e| e.variable.causality == Causality::Output && e.variable.is_real())
        {
            let on = model.structure().start(Place::of(variables, output));
            let inputs = variables.visible().filter(|e| e.variable.causality == Causality::Input);
            let declared = inputs.filter(|e| on.contains(&Place::of(variables, *e))).map(|e| e.name());
            let from = |input: String| {
                let to = (component.name.clone(), input);
                structure.connections.iter().find(|connection| connection.to == to).map(|found| found.from.clone())
            };
            graph.insert((component.name.clone(), output.name()), declared.filter_map(from).collect());
        }
    }
    graph
}

#[test]
fn no_loop_is_circular_at_its_start() {
    let examples = std::fs::read_dir(at_top("examples")).unwrap();
    let folders = examples.map(|entry| entry.unwrap().path()).filter(|path| path.join("SystemStructure.ssd").is_file());
    let mut count = 0;
    for folder in folders {
        let mut graph = graph(folder.file_name().unwrap().to_str().unwrap());
        count += 1;
        // A value that depends on none of the rest is known; an algebraic loop never is.
        while !graph.is_empty() {
            let known: BTreeSet<_> = graph
                .iter()
                .filter(|(_, on)| on.iter().all(|on| !graph.contains_key(on)))
                .map(|(of, _)| of.clone())
                .collect();
            assert!(!known.is_empty(), "{}: an algebraic loop through {:?}", folder.display(), graph.keys());
            graph.retain(|of, _| !known.contains(of));
        }
    }
    assert_eq!(count, 32);
}

#[test]
fn masters_are_given_derivatives_in_initialization_mode_by_inputs_alone() {
    let unit = Unit::new("L1NonlinearSiso");
    unit.enter(0.0);
    unit.put("x[1]", 0.3);
    let references = |names: &[&str]| names.iter().map(|name| unit.reference(name)).collect::<Vec<_>>();
    let along = |knowns: &[u32], seed: &[f64]| {
        let unknowns = references(&["x_hat[1]", "x_hat[2]"]);
        let (mut result, count) = ([f64::NAN; 2], knowns.len());
        let status = unsafe {
            let (of, by) = (unknowns.as_ptr(), knowns.as_ptr());
            fmi2GetDirectionalDerivative(unit.component, of, 2, by, count, seed.as_ptr(), result.as_mut_ptr())
        };
        (status, result)
    };
    // The predictor starts at the measured state.
    assert_eq!(along(&references(&["x[1]", "x[2]"]), &[2.0, -3.0]), (OK, [2.0, -3.0]));
    assert_eq!(along(&references(&["x_hat[1]"]), &[1.0]).0, ERROR);
    let message = unit.last_message();
    assert!(message.contains("x_hat[1]") && message.contains("Initialization Mode"), "{message}");
    assert_eq!(unit.exit(), OK, "and nothing else has changed");
}
