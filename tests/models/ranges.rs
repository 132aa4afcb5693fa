//! Ranges of values in descriptions, which show tools as much as can be known.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::fmi2::model_description;
use adaptive_fmu::model::{Block, Model};
use adaptive_fmu::system::{Causality, Data, Element, NO_LIMIT, Naming, Section, Variability};
use common::described::model;
use common::loops::{loop_names, whole};
use common::{description, description_names};

/// All FMUs, and composites, whose variables are those of their parts.
fn models() -> Vec<Model> {
    let texts = description_names().into_iter().map(|name| description(&name));
    texts.chain(loop_names().iter().take(3).map(|name| whole(name))).map(|text| model(&text).unwrap()).collect()
}

/// Smallest and largest real value that are declared.
fn limits(element: Element<'_>) -> (Option<f64>, Option<f64>) {
    match &element.variable.data {
        Data::Real { min, max, .. } => (*min, *max),
        _ => (None, None),
    }
}

#[test]
fn every_start_lies_in_its_range_and_what_is_no_limit_ends_one() {
    for model in models() {
        let name = &model.description().name;
        for element in model.variables().visible().filter(|element| element.variable.is_real()) {
            let ((min, max), start) = (limits(element), element.start());
            let message = || format!("{name}: {} = {start}, range {min:?} … {max:?}", element.name());
            assert!(min.is_none_or(|min| start >= min) && max.is_none_or(|max| start <= max), "{}", message());
            let is_huge = start.abs() >= NO_LIMIT && element.variable.causality != Causality::Hidden;
            assert!(!is_huge || min.is_some() && max.is_some(), "{}", message());
        }
    }
}

#[test]
fn every_state_has_a_nominal_value() {
    for model in models() {
        let (name, xml) = (&model.description().name, model_description::xml(&model));
        let states = model.variables().visible().filter(|element| element.variable.section == Section::State);
        for state in states.map(|element| element.name()) {
            let variable = xml.split(&format!("name=\"{state}\"")).nth(1).expect("the state is there");
            let real = variable.split("</ScalarVariable>").next().unwrap();
            assert!(real.contains(" nominal=\""), "{name}: {state}: {real}");
        }
    }
}

/// True if a simulation starts where one parameter has another value; also where it contradicts another parameter, which is
/// no range of its own.
fn starts(execution: &mut Execution, start: &Block, place: usize, value: f64) -> bool {
    execution.block_mut().reals.copy_from_slice(&start.reals);
    execution.block_mut().integers.copy_from_slice(&start.integers);
    execution.set_real(place, value);
    let refusal = execution.initialise().err().map(|error| error.to_string());
    execution.take_messages().for_each(drop);
    refusal.is_none_or(|reason| ["must be below ", "must not be above "].iter().any(|order| reason.contains(order)))
}

#[test]
fn parameters_that_are_refused_below_zero_declare_it() {
    let mut silent = Vec::new();
    for model in models() {
        let name = model.description().name.clone();
        let mut execution = Execution::new(model);
        let start = execution.block().clone();
        let settable = |element: &Element<'_>| {
            element.variable.causality == Causality::Parameter
                && element.variable.variability != Variability::Constant
                && element.variable.is_real()
                // A matrix is refused as a whole: where it isn't definite, or not stable.
                && !matches!(element.variable.naming, Naming::Matrix(..))
                && limits(*element).0.is_none()
        };
        let variables = execution.model().variables();
        let free: Vec<_> = variables.visible().filter(settable).collect();
        let free: Vec<_> = free.iter().map(|e| (e.name(), variables.index(*e), e.start().abs())).collect();
        for (parameter, place, size) in free {
            let small = 1e-3 * if size > 0.0 { size } else { 1.0 };
            if starts(&mut execution, &start, place, small) && !starts(&mut execution, &start, place, -small) {
                silent.push(format!("{name}: {parameter}"));
            }
        }
    }
    assert!(silent.is_empty(), "{silent:#?} have no `min`, and are refused below 0");
}
