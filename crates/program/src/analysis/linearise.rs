//! The linear system x' = A x + B u, y = C x + D u of an FMU about an operating point: from its exact derivatives, else
//! from differences of its equations, else from its responses.

use std::sync::Arc;

use nalgebra::DMatrix;
use serde::Serialize;

use super::operating_point::{Method, OperatingPoint, prepared, simulated};
use super::plan::{DIFFERENCE, Derivatives, Plan, references};
use super::responses;
use super::trim::{self, Trim};
use crate::eigenvalues::{Eigenvalue, eigenvalues};
use crate::error::{Error, Invalid};
use crate::fmu::{Fmu, Instance, SHOWS_VARIABLES};
use crate::model_description::ModelStructure;
use crate::model_description::Variable;

const DIRECTIONAL: &str = "providesDirectionalDerivative";

/// A variable at the operating point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Quantity {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: Option<String>,
    /// The FMU's description of it.
    pub description: String,
    /// Value.
    pub value: f64,
}

/// A linearised FMU.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearisation {
    /// Name of the FMU.
    pub name: String,
    /// Time, s.
    pub time: f64,
    /// Method that found it.
    pub method: Method,
    /// The search for the operating point, if there was one.
    pub trim: Option<Trim>,
    /// States.
    pub states: Vec<Quantity>,
    /// Inputs.
    pub inputs: Vec<Quantity>,
    /// Outputs.
    pub outputs: Vec<Quantity>,
    /// Derivatives of states by states.
    pub a: DMatrix<f64>,
    /// Derivatives of states by inputs.
    pub b: DMatrix<f64>,
    /// Outputs by states.
    pub c: DMatrix<f64>,
    /// Outputs by inputs.
    pub d: DMatrix<f64>,
    /// Eigenvalues of A, the slowest first.
    pub eigenvalues: Vec<Eigenvalue>,
}

/// Linearises an FMU.
///
/// # Errors
/// When a start value is refused, there is no steady state, or the responses are those of no linear system.
pub fn linearise(fmu: &Arc<Fmu>, point: &OperatingPoint) -> Result<Linearisation, Error> {
    let refuse = |reason: String| Error::Archive { file: fmu.file().to_owned(), reason };
    let structure = ModelStructure::read(fmu.text()).map_err(refuse)?;
    let time = point.time.unwrap_or(structure.start_time);
    if !time.is_finite() || time < structure.start_time {
        let allowed = format!("must be at or after the start time, {} s", structure.start_time);
        return Err(Error::Argument(Invalid::new("--at", time, allowed)));
    }
    let Found { instance, plan, method, trim, matrices } = found(fmu, &structure, point, time)?;
    let [a, b, c, d] = matrices;
    let eigenvalues = eigenvalues(&a).map_err(|message| refuse(format!("t = {time} s: A {message}")))?;
    let values = |variables: &[&Variable]| quantities(&instance, variables);
    let (states, inputs, outputs) = (values(&plan.states)?, values(&plan.inputs)?, values(&plan.outputs)?);
    let name = fmu.description.name.clone();
    Ok(Linearisation { name, time, method, trim, states, inputs, outputs, a, b, c, d, eigenvalues })
}

/// The matrices, and an instance at the operating point.
struct Found<'a> {
    instance: Instance,
    plan: Plan<'a>,
    method: Method,
    trim: Option<Trim>,
    matrices: [DMatrix<f64>; 4],
}

fn found<'a>(
    fmu: &'a Arc<Fmu>,
    structure: &ModelStructure,
    point: &OperatingPoint,
    time: f64,
) -> Result<Found<'a>, Error> {
    let description = &fmu.description;
    let exact = || description.capabilities.iter().any(|(name, value)| name == DIRECTIONAL && value != "0");
    let exchange = structure.exchange.as_ref();
    let by = match exchange {
        Some(exchange) if !exchange.directional => Derivatives::Differences,
        _ => Derivatives::Exact,
    };
    let mut plan = Plan::new(description, structure, by);
    let method = match by {
        Derivatives::Exact => Method::Derivatives,
        Derivatives::Differences => Method::Differences { part: DIFFERENCE },
    };
    let refuse = |reason: &str| Error::Archive { file: fmu.file().to_owned(), reason: reason.to_owned() };
    if !point.states.is_empty() && !plan.states.is_empty() {
        return Err(refuse("declares its states, so --states can't be used. Remove --states"));
    }
    if point.is_sought() {
        if exchange.is_none() {
            let reason = "does not support model exchange, which --steady-state, --free, --want and --hold need";
            return Err(refuse(reason));
        }
        let instance = prepared(fmu.instantiate_for_exchange(&description.name)?, point, time, time)?;
        let trim = Some(trim::find(&instance, &plan, point, time)?);
        let matrices = matrices(&plan, &instance)?;
        return Ok(Found { instance, plan, method, trim, matrices });
    }
    let start = structure.start_time;
    if description.co_simulation && exact() && point.states.is_empty() {
        plan.by = Derivatives::Exact;
        let instance = prepared(fmu.instantiate(&description.name)?, point, start, time)?;
        let instance = simulated(instance, start, time, point.step_of(fmu))?;
        let matrices = matrices(&plan, &instance)?;
        return Ok(Found { instance, plan, method: Method::Derivatives, trim: None, matrices });
    }
    if exchange.is_some() && !plan.states.is_empty() {
        let instance = exchanged(fmu, &plan, structure, point, time)?;
        let matrices = matrices(&plan, &instance)?;
        return Ok(Found { instance, plan, method, trim: None, matrices });
    }
    if plan.states.is_empty() {
        plan.states = named_states(fmu, &plan, point)?;
    }
    let (method, matrices) = responses::find(fmu, &plan, point, (start, time))?;
    let instance = prepared(fmu.instantiate(&description.name)?, point, start, time)?;
    let instance = simulated(instance, start, time, point.step_of(fmu))?;
    Ok(Found { instance, plan, method, trim: None, matrices })
}

/// An instance for model exchange at the states that a simulation reaches at a time.
fn exchanged(
    fmu: &Arc<Fmu>,
    plan: &Plan,
    structure: &ModelStructure,
    point: &OperatingPoint,
    time: f64,
) -> Result<Instance, Error> {
    let (name, start) = (&fmu.description.name, structure.start_time);
    let mut instance = prepared(fmu.instantiate_for_exchange(name)?, point, time, time)?;
    instance.finish_event()?;
    if time > start {
        if !fmu.description.co_simulation {
            let reason = "supports only model exchange, so it can be linearised only at its start time or with \
                --steady-state"
                .to_owned();
            return Err(Error::Archive { file: fmu.file().to_owned(), reason });
        }
        let begun = prepared(fmu.instantiate(name)?, point, start, time)?;
        let simulated = simulated(begun, start, time, point.step_of(fmu))?;
        let mut states = vec![0.0; plan.states.len()];
        simulated.get_real(&references(&plan.states), &mut states)?;
        instance.set_time(time)?;
        instance.set_states(&states)?;
        instance.begin_event()?;
        instance.finish_event()?;
    }
    Ok(instance)
}

/// The states of an FMU whose description names none: those that the user names, otherwise its outputs.
fn named_states<'a>(fmu: &'a Fmu, plan: &Plan<'a>, point: &OperatingPoint) -> Result<Vec<&'a Variable>, Error> {
    if point.states.is_empty() {
        return Ok(plan.outputs.clone());
    }
    let variables = &fmu.description.variables;
    let is_known = |v: &&Variable| v.kind == "Real" && matches!(v.causality.as_str(), "output" | "local");
    let find = |name: &String| {
        let unknown = || {
            let known = variables.iter().filter(is_known).map(|variable| variable.name.as_str());
            Error::unknown("Real output or local variable", name, known, SHOWS_VARIABLES)
        };
        variables.iter().filter(is_known).find(|variable| variable.name == *name).ok_or_else(unknown)
    };
    point.states.iter().map(find).collect()
}

fn matrices(plan: &Plan, instance: &Instance) -> Result<[DMatrix<f64>; 4], Error> {
    let (by_states, by_inputs) = (plan.by_states(instance)?, plan.by_inputs(instance)?);
    Ok([by_states.derivatives, by_inputs.derivatives, by_states.outputs, by_inputs.outputs])
}

fn quantities(instance: &Instance, variables: &[&Variable]) -> Result<Vec<Quantity>, Error> {
    let mut values = vec![0.0; variables.len()];
    instance.get_real(&references(variables), &mut values)?;
    let quantity = |(variable, value): (&&Variable, f64)| {
        let (name, unit) = (variable.name.clone(), variable.unit.clone());
        let description = variable.description.clone();
        Quantity { name, unit, description, value }
    };
    Ok(variables.iter().zip(values).map(quantity).collect())
}
