//! Declared dependencies of outputs and derivatives: nothing else ever changes them. Tools order their calls and build
//! Jacobians from them.

use std::collections::BTreeSet;

use adaptive_fmu::execution::Execution;
use adaptive_fmu::framework::structure::Place;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Block, Description, Model};
use adaptive_fmu::system::{Causality, Element, Section};
use common::described::open_description;
use common::random::Random;
use common::{description_names, pages};

fn model(description: &str) -> Model {
    Model::from_description(Description::read(description).unwrap(), REGISTRY).unwrap()
}

/// Signals and derivatives at a point.
fn evaluate(model: &Model, t: f64, point: &Block) -> Block {
    let mut block = point.clone();
    model.equations().evaluate(t, &mut block.reals, &block.integers, model.variables().offsets());
    block
}

/// Declared dependencies of outputs and derivatives, and those that were seen to matter.
#[derive(Default)]
struct Tally {
    declared: BTreeSet<(usize, usize)>,
    seen: BTreeSet<(usize, usize)>,
}

/// Outputs that equations write, and derivatives, with their declared dependencies.
fn unknowns(model: &Model) -> Vec<(String, usize, Vec<Place>)> {
    let variables = model.variables();
    let wanted = |element: &Element<'_>| {
        let is_output = element.variable.causality == Causality::Output && element.variable.section == Section::Signal;
        is_output || element.variable.section == Section::Derivative
    };
    let of = |element: Element<'_>| {
        let index = variables.index(element);
        (element.name(), index, model.structure().running(Place::Real(index)).to_vec())
    };
    variables.visible().filter(wanted).map(of).collect()
}

fn check(model: &Model, random: &mut Random, tally: &mut Tally) {
    let variables = model.variables();
    let unknowns = unknowns(model);
    let mut execution = Execution::new(Model::from_description(model.description().clone(), REGISTRY).unwrap());
    execution.initialise().unwrap();
    let mut point = execution.block().clone();
    let sources = [Section::Input, Section::State].into_iter().flat_map(|section| variables.reals(section));
    let sources: Vec<usize> = sources.collect();
    for &index in &sources {
        point.reals[index] = 2.0 * random.next();
    }
    let t = 10.0 + 10.0 * random.next();
    let before = evaluate(model, t, &point);
    for source in sources {
        for change in [1e-3, 2.0 * random.next(), 200.0 * random.next()] {
            let mut moved = point.clone();
            moved.reals[source] += change;
            let after = evaluate(model, t, &moved);
            for (name, index, on) in &unknowns {
                let is_declared = on.contains(&Place::Real(source));
                tally.declared.extend(is_declared.then_some((*index, source)));
                if before.reals[*index].to_bits() != after.reals[*index].to_bits() {
                    assert!(is_declared, "in {}, {name} depends on real {source}", model.description().name);
                    tally.seen.insert((*index, source));
                }
            }
        }
    }
}

#[test]
fn nothing_undeclared_ever_changes_an_output_or_a_derivative() {
    let mut random = Random::new(1);
    let mut table = "| FMU | listed | observed |\n| --- | --- | --- |\n".to_owned();
    for name in description_names() {
        // With funnels that are wide: where a law has lost its funnel, nothing of it moves.
        let (model, mut tally) = (model(&open_description(&name)), Tally::default());
        (0..20).for_each(|_| check(&model, &mut random, &mut tally));
        table.push_str(&format!("| `{name}` | {} | {} |\n", tally.declared.len(), tally.seen.len()));
    }
    pages::assert_generated("docs/internals.md", "dependence", &table);
}

/// The same with other structures than those of the thesis.
#[test]
fn nothing_undeclared_matters_in_controllers_of_other_structures_either() {
    let two_inputs = |regressor: &str, gain: &str| {
        format!(
            "name = \"Two\"\nmodel = \"l1\"\ndescription = \"\"\n[structure]\n\
             B = [[1.0, 0.2], [0.0, 2.0], [0.5, 0.0]]\nC = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]\n\
             regressor = \"{regressor}\"\ninput_gain = \"{gain}\"\n[start]\n\
             A_m = [[-2.0, 1.0, 0.0], [0.0, -3.0, 1.0], [0.0, 0.0, -4.0]]\n{}",
            if gain == "full" {
                "omega_min = [[0.5, -1.0], [-1.0, 0.5]]\nomega_max = [[2.0, 1.0], [1.0, 2.0]]\n"
            } else {
                "omega_min = [0.5, 0.5]\nomega_max = [2.0, 2.0]\n"
            }
        ) + "theta_bound = [5.0, 6.0]\nsigma_bound = [7.0, 8.0]\n"
    };
    let by_element = |text: &str| text.replace("[5.0, 6.0]", "[[5.0, 0.5, 1.0], [6.0, 0.6, 0.0]]");
    let mut random = Random::new(2);
    for regressor in ["state", "infinity_norm"] {
        for gain in ["full", "diagonal"] {
            let text = two_inputs(regressor, gain);
            for text in [by_element(&text), text].into_iter().skip(usize::from(regressor != "state")) {
                let model = Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap();
                (0..20).for_each(|_| check(&model, &mut random, &mut Tally::default()));
            }
        }
    }
}
