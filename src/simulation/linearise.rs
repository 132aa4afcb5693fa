//! The linear system x' = A x + B u, y = C x + D u that an FMU is like about an operating point, from the exact
//! derivatives that it gives.

use std::sync::Arc;

use nalgebra::DMatrix;
use serde::Serialize;

use super::check::typed;
use super::description::Variable;
use super::fmu::{Fmu, Instance};
use super::model_structure::ModelStructure;
use super::steady_state;
use crate::control::eigenvalues::{Eigenvalue, eigenvalues};
use crate::error::Error;
use crate::exporter::read_entry;

const DIRECTIONAL: &str = "providesDirectionalDerivative";
/// Communication step of an FMU that proposes none, s.
const STEP: f64 = 1e-3;

/// Where an FMU is linearised.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct OperatingPoint {
    /// Time, s; the start time where none is given.
    pub time: Option<f64>,
    /// Whether states are sought whose derivatives are zero then. Else they are those of a simulation until then.
    pub steady_state: bool,
    /// Start values of parameters and inputs; inputs keep them.
    pub start: Vec<(String, String)>,
}

/// A variable at the operating point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Quantity {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: Option<String>,
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
    /// Whether the steady state is the only one near; none where none was asked for.
    pub unique: Option<bool>,
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

/// The variables of the matrices.
#[derive(Debug)]
pub(super) struct Plan<'a> {
    pub states: Vec<&'a Variable>,
    pub derivatives: Vec<&'a Variable>,
    pub inputs: Vec<&'a Variable>,
    pub outputs: Vec<&'a Variable>,
}

/// Linearises an FMU.
///
/// # Errors
/// When it gives no directional derivatives, a start value is refused, or there is no steady state.
pub fn linearise(fmu: &Arc<Fmu>, point: &OperatingPoint) -> Result<Linearisation, Error> {
    let refuse = |reason: String| Error::Archive { file: fmu.file().to_owned(), reason };
    let structure = ModelStructure::read(&read_entry(fmu.file(), "modelDescription.xml")?).map_err(refuse)?;
    let time = point.time.unwrap_or(structure.start_time);
    if !time.is_finite() || time < structure.start_time {
        return Err(refuse(format!("time {time}: must be from the start time, {} s, on", structure.start_time)));
    }
    let plan = Plan::new(fmu, &structure);
    let (instance, unique) = if point.steady_state {
        check_exchange(fmu, &structure).map_err(refuse)?;
        let instance = prepared(fmu.instantiate_for_exchange(&fmu.description.name)?, point, time, time)?;
        let unique = steady_state::find(&instance, &plan, time)?;
        (instance, Some(unique))
    } else {
        if !fmu.description.capabilities.iter().any(|(name, value)| name == DIRECTIONAL && value != "0") {
            return Err(refuse(lacks_derivatives("co-simulation")));
        }
        let instance = fmu.instantiate(&fmu.description.name)?;
        (simulated(prepared(instance, point, structure.start_time, time)?, structure.start_time, time)?, None)
    };
    let [a, b, c, d] = plan.matrices(&instance)?;
    let eigenvalues = eigenvalues(&a).map_err(|message| refuse(format!("t = {time} s: A {message}")))?;
    let values = |variables: &[&Variable]| quantities(&instance, variables);
    let (states, inputs, outputs) = (values(&plan.states)?, values(&plan.inputs)?, values(&plan.outputs)?);
    let name = fmu.description.name.clone();
    Ok(Linearisation { name, time, unique, states, inputs, outputs, a, b, c, d, eigenvalues })
}

fn lacks_derivatives(interface: &str) -> String {
    format!(
        "gives no directional derivatives in {interface} ({DIRECTIONAL} isn't true): it can't be linearised exactly"
    )
}

/// Whether an instance for model exchange can be had from the loaded library.
fn check_exchange(fmu: &Fmu, structure: &ModelStructure) -> Result<(), String> {
    match &structure.exchange {
        None => Err("is not for model exchange, which the search for a steady state needs".to_owned()),
        Some(exchange) if !exchange.directional => Err(lacks_derivatives("model exchange")),
        Some(exchange) if exchange.model_identifier != fmu.description.model_identifier => {
            let identifier = &exchange.model_identifier;
            Err(format!("has its model exchange in a library of its own, {identifier}, which can't be loaded yet"))
        }
        Some(_) => Ok(()),
    }
}

/// An instance with its start values, initialised.
fn prepared(mut instance: Instance, point: &OperatingPoint, start: f64, time: f64) -> Result<Instance, Error> {
    for (name, value) in &point.start {
        let variables = &instance.description().variables;
        let settable: Vec<_> =
            variables.iter().filter(|v| v.causality == "parameter" || v.causality == "input").collect();
        let variable = settable.iter().find(|variable| variable.name == *name).ok_or_else(|| {
            let known: Vec<_> = settable.iter().map(|variable| variable.name.as_str()).collect();
            Error::Unknown { what: "parameter or input", name: name.clone(), known: known.join(", ") }
        })?;
        let typed = typed(value, variable).map_err(|reason| {
            let (file, reason) = (instance.fmu().file().to_owned(), format!("`{name}` = {value}: {reason}"));
            Error::Archive { file, reason }
        })?;
        instance.set_start(variable.reference, &typed)?;
    }
    // A stop time must be after the start.
    instance.enter_initialization(start, time.max(start + 1.0))?;
    instance.exit_initialization()?;
    Ok(instance)
}

/// The instance, stepped to a time.
fn simulated(mut instance: Instance, start: f64, time: f64) -> Result<Instance, Error> {
    let step = instance.description().step.filter(|step| *step > 0.0).unwrap_or(STEP);
    let steps = ((time - start) / step - 1e-6).ceil().max(0.0) as usize;
    let time_of = |k: usize| if k == steps { time } else { start + k as f64 * step };
    for k in 0..steps {
        instance.do_step(time_of(k), time_of(k + 1) - time_of(k))?;
    }
    Ok(instance)
}

fn quantities(instance: &Instance, variables: &[&Variable]) -> Result<Vec<Quantity>, Error> {
    let mut values = vec![0.0; variables.len()];
    instance.get_real(&references(variables), &mut values)?;
    let quantity = |(variable, value): (&&Variable, f64)| {
        let (name, unit) = (variable.name.clone(), variable.unit.clone());
        Quantity { name, unit, value }
    };
    Ok(variables.iter().zip(values).map(quantity).collect())
}

fn references(variables: &[&Variable]) -> Vec<u32> {
    variables.iter().map(|variable| variable.reference).collect()
}

impl<'a> Plan<'a> {
    fn new(fmu: &'a Fmu, structure: &ModelStructure) -> Self {
        let variables = &fmu.description.variables;
        let is_input = |v: &&Variable| v.causality == "input" && v.kind == "Real" && v.variability == "continuous";
        Plan {
            states: structure.states.iter().map(|(state, _)| &variables[*state]).collect(),
            derivatives: structure.states.iter().map(|(_, derivative)| &variables[*derivative]).collect(),
            inputs: variables.iter().filter(is_input).collect(),
            outputs: structure.outputs.iter().map(|&k| &variables[k]).filter(|v| v.kind == "Real").collect(),
        }
    }

    /// How unknowns change with knowns, a column a known.
    pub fn jacobian(instance: &Instance, unknowns: &[&Variable], knowns: &[&Variable]) -> Result<DMatrix<f64>, Error> {
        let unknowns = references(unknowns);
        let mut jacobian = DMatrix::zeros(unknowns.len(), knowns.len());
        for (mut column, known) in jacobian.column_iter_mut().zip(knowns) {
            column.copy_from_slice(&instance.directional_derivative(&unknowns, &[known.reference], &[1.0])?);
        }
        Ok(jacobian)
    }

    fn matrices(&self, instance: &Instance) -> Result<[DMatrix<f64>; 4], Error> {
        let Plan { states, derivatives, inputs, outputs } = self;
        Ok([
            Self::jacobian(instance, derivatives, states)?,
            Self::jacobian(instance, derivatives, inputs)?,
            Self::jacobian(instance, outputs, states)?,
            Self::jacobian(instance, outputs, inputs)?,
        ])
    }
}
