//! Functions of FMI 3.0 that FMI 2.0 doesn't have: Event Mode and Step Mode of co-simulation, arrays, adjoint derivatives, dependences.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::arrays::{Entry, entries, time};
use crate::fmi2::access::{References, Type, element};
use crate::fmi2::calls::{Answer, Function, Interface, Phase, Refused};
use crate::fmi2::instance::Instance;
use crate::fmi2::types::Status;
use crate::model::Block;
use crate::structure::Place;
use crate::system::{Causality, Section, Variable};

/// Outcome of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stepped {
    /// True if an event is due.
    pub event_needed: bool,
    /// True if the step ended before it was done.
    pub early_return: bool,
    /// Time of the instance, s.
    pub last_time: f64,
}

/// A value that another one depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dependence {
    /// Element of the dependent variable, from 1; 0 of a scalar.
    pub dependent_element: usize,
    /// Value reference of the variable that it depends on.
    pub independent: u32,
    /// Element of that, from 1; 0 of a scalar.
    pub independent_element: usize,
    /// `fmi3DependencyKind`
    pub kind: i32,
}

/// `fmi3Dependent` of `fmi3DependencyKind`
const DEPENDENT: i32 = 5;

impl Instance {
    /// The master of a co-simulation handles events in Event Mode; a step may end early at one.
    pub fn use_event_mode(&mut self, early_return: bool) {
        (self.event_mode, self.early_return) = (true, early_return);
        self.discrete = vec![0; self.unit.references.discrete().len()];
        self.execution.leave_events();
    }

    /// Number of event indicators.
    pub fn event_indicators(&self) -> usize {
        self.execution.model().variables().indicators().len()
    }

    /// Number of continuous states.
    pub fn continuous_states(&self) -> usize {
        self.execution.states().len()
    }

    /// Refuses value references that are none, or name another number of values than are given.
    ///
    /// # Errors
    /// With both numbers.
    pub fn check_values(&self, function: Function, references: &[u32], values: usize) -> Answer {
        let mut expected = 0;
        for &reference in references {
            expected += self.unit.references.length(reference).map_err(|_| self.no_value(function, reference))?;
        }
        if expected == values {
            return Ok(());
        }
        let name = self.called(function);
        Err(Refused(format!("{name}: nValues = {values}, but these variables have {expected} values")))
    }

    /// Refuses a value reference that no variable has whose values can be read and set.
    fn no_value(&self, function: Function, reference: u32) -> Refused {
        let name = self.called(function);
        if let Some(size) = self.execution.model().sizes().list().get(reference as usize) {
            return Refused(format!("{name}: `{}` (value reference {reference}) is of type UInt64", size.name));
        }
        let place = self.unit.references.inner(reference);
        let known = place.filter(|&place| element(self.execution.model().variables(), place).is_some());
        let of = known.map_or(String::new(), |place| format!(": `{}` is an element of an array", self.name(place)));
        Refused(format!("{name}: there is no variable with value reference {reference}{of}"))
    }

    /// fmi3GetFloat64
    ///
    /// # Errors
    /// For value references that aren't those of Float64 variables, or another number of values.
    pub fn get_float64(&mut self, references: &[u32], values: &mut [f64]) -> Answer<Status> {
        self.check_values(Function::GetReal, references, values.len())?;
        let unit = Arc::clone(&self.unit);
        self.get_real(unit.references.values_of(references), values)
    }

    /// fmi3SetFloat64
    ///
    /// # Errors
    /// For value references or values that can't be set, or another number of values; nothing is changed.
    pub fn set_float64(&mut self, references: &[u32], values: &[f64]) -> Answer {
        self.check_values(Function::SetReal, references, values.len())?;
        let unit = Arc::clone(&self.unit);
        self.set_real(unit.references.values_of(references), values)
    }

    /// fmi3GetInt32, fmi3GetInt64 and fmi3GetBoolean: gives each value with its number.
    ///
    /// # Errors
    /// For value references of another type, or another number of values.
    pub fn get_whole(
        &mut self,
        function: Function,
        references: &[u32],
        values: usize,
        give: impl FnMut(usize, i32),
    ) -> Answer {
        self.check_whole(function, references, values)?;
        let unit = Arc::clone(&self.unit);
        self.get_integer(function, type_of(function), unit.references.values_of(references), give)
    }

    /// fmi3SetInt32, fmi3SetInt64 and fmi3SetBoolean
    ///
    /// # Errors
    /// For value references or values that can't be set, or another number of values; nothing is changed.
    pub fn set_whole(
        &mut self,
        function: Function,
        references: &[u32],
        values: impl ExactSizeIterator<Item = i64> + Clone,
    ) -> Answer {
        self.check_whole(function, references, values.len())?;
        let unit = Arc::clone(&self.unit);
        self.set_integer(function, type_of(function), unit.references.values_of(references), values)
    }

    /// Refuses what [`Instance::check_values`] does, and enumerations as Int32 and integers as Int64.
    fn check_whole(&self, function: Function, references: &[u32], values: usize) -> Answer {
        self.check_values(function, references, values)?;
        let wants_items = match function {
            Function::GetEnumeration | Function::SetEnumeration => true,
            Function::GetInteger | Function::SetInteger => false,
            _ => return Ok(()),
        };
        for one in self.unit.references.values_of(references) {
            let (place, _) = self.place(function, one, Type::Integer)?;
            if self.unit.references.is_choice(place) != wants_items {
                let (name, variable) = (self.called(function), self.name(one));
                let is = if wants_items { "Int32" } else { "Enumeration, which Int64 is for" };
                let reference = self.unit.references.outer(one);
                return Err(Refused(format!("{name}: `{variable}` (value reference {reference}) is of type {is}")));
            }
        }
        Ok(())
    }

    /// fmi3EnterEventMode in co-simulation.
    ///
    /// # Errors
    /// For an instance that was made without Event Mode.
    pub fn enter_event_mode_of_step(&mut self) -> Answer {
        if self.of.1 == Interface::CoSimulation && !self.event_mode {
            let name = self.called(Function::EnterEventMode);
            return Err(Refused(format!("{name}: the instance was made with eventModeUsed = false")));
        }
        self.enter_event_mode();
        Ok(())
    }

    /// fmi3EnterStepMode
    ///
    /// # Errors
    /// While parameters wait to be taken over.
    pub fn enter_step_mode(&mut self) -> Answer {
        self.end_event(Function::EnterStepMode, Phase::StepComplete)
    }

    /// fmi3DoStep. A step without Event Mode, or whose master takes no early return, handles events within it.
    ///
    /// # Errors
    /// When the step is refused (nothing changed), or can't be finished (values as before, and the instance in error).
    pub fn do_step_with_events(&mut self, point: f64, step: f64, stepped: &mut Stepped) -> Answer<Status> {
        stepped.last_time = self.execution.time();
        self.check_step(point, step)?;
        let early = if self.event_mode && self.early_return { self.execution.event_within(point, step) } else { None };
        let length = early.map_or(step, |event| event - point);
        self.note_discrete();
        let answer = self.take_step(point, length);
        let is_done = answer == Ok(Status::Ok);
        if is_done {
            self.execution.find_indicators();
        }
        *stepped = Stepped {
            // A master reads discrete variables at events: flags, for example, which equations set at the end of a step.
            event_needed: is_done && self.event_mode && (self.execution.event_due() || self.discrete_differ()),
            early_return: is_done && early.is_some(),
            last_time: self.execution.time(),
        };
        answer
    }

    fn note_discrete(&mut self) {
        let (block, places) = (self.execution.block(), self.unit.references.discrete());
        self.discrete.iter_mut().zip(places).for_each(|(before, place)| *before = bits(block, *place));
    }

    fn discrete_differ(&self) -> bool {
        let (block, places) = (self.execution.block(), self.unit.references.discrete());
        self.discrete.iter().zip(places).any(|(before, place)| *before != bits(block, *place))
    }

    /// fmi3EvaluateDiscreteStates: outputs with the present inputs, discrete states as they were.
    pub fn evaluate_discrete_states(&mut self) {
        self.execution.evaluate();
    }

    /// fmi3GetDirectionalDerivative
    ///
    /// # Errors
    /// As in FMI 2.0, and for another number of values.
    pub fn get_directional(
        &mut self,
        (unknowns, result): (&[u32], &mut [f64]),
        (knowns, seed): (&[u32], &[f64]),
    ) -> Answer<Status> {
        let [unknowns, knowns] =
            self.elements(Function::GetDirectionalDerivative, [(unknowns, result.len()), (knowns, seed.len())])?;
        self.get_directional_derivative(&unknowns, &knowns, seed, result)
    }

    /// fmi3GetAdjointDerivative: the seed times the derivatives of unknowns by knowns, a number for each known.
    ///
    /// # Errors
    /// As for fmi3GetDirectionalDerivative.
    pub fn get_adjoint(
        &mut self,
        (unknowns, seed): (&[u32], &[f64]),
        (knowns, result): (&[u32], &mut [f64]),
    ) -> Answer<Status> {
        let function = Function::GetAdjointDerivative;
        let [unknowns, knowns] = self.elements(function, [(unknowns, seed.len()), (knowns, result.len())])?;
        self.get_adjoint_derivative(&unknowns, &knowns, seed, result)
    }

    /// The value references of single values.
    fn elements(&self, function: Function, of: [(&[u32], usize); 2]) -> Answer<[Vec<u32>; 2]> {
        for (references, values) in of {
            self.check_values(function, references, values)?;
        }
        Ok(of.map(|(references, _)| self.unit.references.values_of(references).collect()))
    }

    /// fmi3GetOutputDerivatives
    ///
    /// # Errors
    /// For what isn't a Float64 output, another order than 1, or another number of values.
    pub fn get_derivatives_of_outputs(
        &mut self,
        references: &[u32],
        orders: &[i32],
        values: &mut [f64],
    ) -> Answer<Status> {
        self.check_values(Function::GetRealOutputDerivatives, references, values.len())?;
        let each = references.iter().zip(orders).flat_map(|(reference, order)| {
            self.unit.references.values_of(std::slice::from_ref(reference)).map(move |one| (one, *order))
        });
        let (references, orders): (Vec<u32>, Vec<i32>) = each.unzip();
        self.get_output_derivatives(&references, &orders, values)
    }

    /// fmi3GetVariableDependencies: of a variable while a simulation runs, or, before its start, of the start.
    ///
    /// # Errors
    /// For what is no output, state or derivative.
    pub fn dependencies(&self, function: Function, dependent: u32) -> Answer<Vec<Dependence>> {
        let (model, variables) = (self.execution.model(), self.execution.model().variables());
        let is_known = |variable: &Variable| {
            variable.causality == Causality::Output || matches!(variable.section, Section::State | Section::Derivative)
        };
        let place = self.unit.references.inner(dependent);
        if place == Some(References::of_indicators(variables)) && self.event_indicators() > 0 {
            return Ok(self.dependencies_of_indicators());
        }
        let known = place.and_then(|place| element(variables, place)).filter(|element| is_known(element.variable));
        if known.is_none() || self.unit.references.length(dependent).is_err() {
            let name = self.called(function);
            return Err(Refused(format!(
                "{name}: value reference {dependent} is no output, state or derivative of a state"
            )));
        }
        let is_start = matches!(self.phase(), Phase::Instantiated | Phase::Initialization);
        let places = self.places();
        let number = |(k, is_array): (usize, bool)| if is_array { k + 1 } else { 0 };
        let mut found = Vec::new();
        for reference in self.unit.references.values_of(&[dependent]) {
            let Some(element) = element(variables, reference) else { continue };
            let own = [Place::of(variables, element)];
            let on = match element.variable.section {
                _ if is_start => model.structure().start(own[0]),
                Section::State => &own[..],
                Section::Discrete => &[],
                _ => model.structure().running(own[0]),
            };
            let Some(&(_, k, is_array)) = places.get(&own[0]) else { continue };
            let of_place = |place: &Place| {
                let &(independent, on, array) = places.get(place)?;
                Some(Dependence {
                    dependent_element: number((k, is_array)),
                    independent,
                    independent_element: number((on, array)),
                    kind: DEPENDENT,
                })
            };
            found.extend(on.iter().filter_map(of_place));
        }
        Ok(found)
    }

    /// Each indicator on everything that it may depend on: more isn't known of it.
    fn dependencies_of_indicators(&self) -> Vec<Dependence> {
        let variables = self.execution.model().variables();
        let is_known = |entry: &Entry| matches!(entry.element.variable.section, Section::Input | Section::State);
        let knowns: Vec<u32> = entries(self.execution.model())
            .filter(is_known)
            .map(|entry| References::of(variables, entry.element))
            .chain([time(self.execution.model())])
            .map(|place| self.unit.references.outer(place))
            .collect();
        let of = |indicator| {
            let on = move |&independent: &u32| Dependence {
                dependent_element: indicator,
                independent,
                independent_element: 0,
                kind: DEPENDENT,
            };
            knowns.iter().map(on)
        };
        (1..=self.event_indicators()).flat_map(of).collect()
    }

    /// The variables of places: value reference, number of the element, and whether it is an array.
    fn places(&self) -> BTreeMap<Place, (u32, usize, bool)> {
        let (model, variables) = (self.execution.model(), self.execution.model().variables());
        let outer = |place| self.unit.references.outer(place);
        let of_entry = |entry: Entry| {
            let (reference, is_array) = (outer(References::of(variables, entry.element)), entry.shape.is_some());
            let elements = entry.elements().into_iter().enumerate();
            let places = elements.map(move |(k, one)| (Place::of(variables, one), (reference, k, is_array)));
            places.collect::<Vec<_>>()
        };
        let of_time = (Place::Real(model.time_place()), (outer(time(model)), 0, false));
        entries(model).flat_map(of_entry).chain([of_time]).collect()
    }
}

/// The bits of a value.
fn bits(block: &Block, place: Place) -> u64 {
    match place {
        Place::Real(place) => block.reals[place].to_bits(),
        Place::Integer(place) => block.integers[place] as u64,
    }
}

fn type_of(function: Function) -> Type {
    if matches!(function, Function::GetBoolean | Function::SetBoolean) { Type::Boolean } else { Type::Integer }
}
