//! What a model declares its outputs and derivatives to depend on: nothing else ever changes them. Tools order their
//! calls and build Jacobians by it.

mod common;

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Block, Description, Model};
use adaptive_fmu::system::Section;
use common::random::Random;
use common::{description, description_names};

fn model(name: &str) -> Model {
    Model::from_description(Description::read(&description(name)).unwrap(), REGISTRY).unwrap()
}

/// Signals and derivatives at a point.
fn evaluate(model: &Model, t: f64, point: &Block) -> Block {
    let mut block = point.clone();
    let offsets = model.variables().offsets();
    model.system().outputs(t, &mut block.reals, &block.integers, offsets);
    model.system().derivatives(t, &mut block.reals, &block.integers, offsets);
    block
}

/// Something undeclared that a change of one input or state has changed, in words.
fn undeclared(model: &Model, changed: (Section, usize), before: &Block, after: &Block) -> Option<String> {
    let variables = model.variables();
    let name = |section, place| variables.real_at(section, place).map_or("?".to_owned(), |element| element.name());
    let mut found = None;
    for section in [Section::Signal, Section::Derivative] {
        for (place, index) in variables.reals(section).enumerate() {
            let declared = variables.dependence(section, place);
            let moved = before.reals[index].to_bits() != after.reals[index].to_bits();
            if moved && declared.is_some_and(|on| !on.contains(&changed)) {
                found = Some(format!("{} depends on {}", name(section, place), name(changed.0, changed.1)));
            }
        }
    }
    found
}

fn check(model: &Model, random: &mut Random) {
    let variables = model.variables();
    let mut execution = Execution::new(Model::from_description(model.description().clone(), REGISTRY).unwrap());
    execution.initialise().unwrap();
    let mut point = execution.block.clone();
    let sources = [Section::Input, Section::State];
    for index in sources.into_iter().flat_map(|section| variables.reals(section)) {
        point.reals[index] = 2.0 * random.next();
    }
    let t = 10.0 + 10.0 * random.next();
    let before = evaluate(model, t, &point);
    for section in sources {
        for (place, index) in variables.reals(section).enumerate() {
            for change in [1e-3, 2.0 * random.next(), 200.0 * random.next()] {
                let mut moved = point.clone();
                moved.reals[index] += change;
                let problem = undeclared(model, (section, place), &before, &evaluate(model, t, &moved));
                assert_eq!(problem, None, "in {}", model.description().name);
            }
        }
    }
}

#[test]
fn nothing_undeclared_ever_changes_an_output_or_a_derivative() {
    let mut random = Random::new(1);
    for name in description_names() {
        let model = model(&name);
        (0..20).for_each(|_| check(&model, &mut random));
    }
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
    let mut random = Random::new(2);
    for regressor in ["state", "infinity_norm"] {
        for gain in ["full", "diagonal"] {
            let description = Description::read(&two_inputs(regressor, gain)).unwrap();
            let model = Model::from_description(description, REGISTRY).unwrap();
            (0..20).for_each(|_| check(&model, &mut random));
        }
    }
}
