//! Unknowns and equations of an operating point, by the names of an FMU's variables.

use super::operating_point::OperatingPoint;
use super::plan::{Derivatives, Plan, references};
use crate::error::{Error, Invalid};
use crate::fmu::{Instance, SHOWS_VARIABLES};
use crate::model_description::Variable;

/// Factors of a state's magnitude for other values of it, at which an output must equal it too.
const OTHER: [f64; 2] = [0.37, -0.61];

/// The unknowns are the states that may move and the free inputs; the equations are those of the derivatives, then
/// those of wanted variables.
#[derive(Debug)]
pub(super) struct Aim<'a> {
    /// All states and their derivatives; as inputs and outputs, the free inputs and wanted variables.
    pub plan: Plan<'a>,
    /// Further wanted variables, for which the FMU lists no derivatives.
    pub others: Plan<'a>,
    /// True for each state that keeps its value.
    pub is_fixed: Vec<bool>,
    /// Wanted values, an equation each.
    pub targets: Vec<f64>,
    /// Variables and values that were asked for.
    pub wanted: Vec<(&'a Variable, f64)>,
}

impl<'a> Aim<'a> {
    /// Finds the variables of an initialised instance.
    ///
    /// # Errors
    /// For a name that doesn't exist, or is given twice.
    pub fn new(
        instance: &Instance,
        plan: &Plan<'a>,
        point: &OperatingPoint,
        all: &'a [Variable],
    ) -> Result<Self, Error> {
        let free = inputs(plan, &point.free)?;
        let is_fixed = fixed_states(plan, &point.hold)?;
        let wanted = wanted(instance, plan, point, all)?;
        let mut targets = vec![0.0; plan.states.len()];
        let (mut outputs, mut others) = (Vec::new(), Vec::new());
        for &(variable, value) in &wanted {
            if let Some(place) = place(&plan.derivatives, variable) {
                targets[place] = value;
            } else if let Some(state) = place(&plan.states, variable).filter(|&state| is_fixed[state]) {
                let reason = format!(
                    "--hold {0} is not allowed with --want {0}: the state can't keep its start value",
                    plan.states[state].name
                );
                return Err(Error::Argument(Invalid::because(reason)));
            } else if plan.by == Derivatives::Differences || place(&plan.outputs, variable).is_some() {
                outputs.push((variable, value));
            } else {
                others.push((variable, value));
            }
        }
        targets.extend(outputs.iter().chain(&others).map(|(_, value)| value));
        let of = |wanted: &[(&'a Variable, f64)], by| Plan {
            states: plan.states.clone(),
            derivatives: plan.derivatives.clone(),
            inputs: free.clone(),
            outputs: wanted.iter().map(|(variable, _)| *variable).collect(),
            by,
        };
        let (plan, others) = (of(&outputs, plan.by), of(&others, Derivatives::Differences));
        Ok(Aim { plan, others, is_fixed, targets, wanted })
    }

    /// The wanted variables, apart from derivatives.
    pub fn shown(&self) -> impl Iterator<Item = &'a Variable> {
        self.plan.outputs.iter().chain(&self.others.outputs).copied()
    }

    /// The variable of each equation.
    pub fn equations(&self) -> Vec<&'a Variable> {
        self.plan.derivatives.iter().copied().chain(self.shown()).collect()
    }

    /// The places of the states that may move.
    pub fn moving(&self) -> Vec<usize> {
        (0..self.is_fixed.len()).filter(|&state| !self.is_fixed[state]).collect()
    }

    /// The variable of each unknown.
    pub fn unknowns(&self) -> Vec<&'a Variable> {
        let states = self.moving().into_iter().map(|state| self.plan.states[state]);
        states.chain(self.plan.inputs.iter().copied()).collect()
    }
}

fn place(variables: &[&Variable], variable: &Variable) -> Option<usize> {
    variables.iter().position(|other| other.name == variable.name)
}

/// Continuous Real inputs by their names.
fn inputs<'a>(plan: &Plan<'a>, names: &[String]) -> Result<Vec<&'a Variable>, Error> {
    let mut found: Vec<&Variable> = Vec::new();
    for name in names {
        let known = || plan.inputs.iter().map(|input| input.name.as_str());
        let input = plan.inputs.iter().find(|input| input.name == *name);
        let input = input.ok_or_else(|| Error::unknown("continuous Real input", name, known(), SHOWS_VARIABLES))?;
        if place(&found, input).is_none() {
            found.push(input);
        }
    }
    Ok(found)
}

/// True for each state of these names.
fn fixed_states(plan: &Plan, names: &[String]) -> Result<Vec<bool>, Error> {
    let known = || plan.states.iter().map(|state| state.name.as_str());
    let is_state = |name: &&String| known().any(|state| state == **name);
    if let Some(name) = names.iter().find(|name| !is_state(name)) {
        return Err(Error::unknown("continuous state", name, known(), SHOWS_VARIABLES));
    }
    Ok(known().map(|state| names.iter().any(|name| name == state)).collect())
}

/// Wanted variables with their values.
fn wanted<'a>(
    instance: &Instance,
    plan: &Plan<'a>,
    point: &OperatingPoint,
    all: &'a [Variable],
) -> Result<Vec<(&'a Variable, f64)>, Error> {
    let mut found: Vec<(&Variable, f64)> = Vec::new();
    for (name, value) in &point.want {
        let shown = |v: &&Variable| v.kind == "Real" && matches!(v.causality.as_str(), "output" | "local");
        let plain = all.iter().filter(shown).find(|variable| variable.name == *name);
        let variable = match plain {
            Some(variable) => variable,
            None => derivative(instance, plan, name)?.ok_or_else(|| {
                let mut known: Vec<_> = all.iter().filter(shown).map(|variable| variable.name.clone()).collect();
                let derivatives = plan.states.iter().map(|state| format!("der({})", state.name));
                let others: Vec<_> = derivatives.filter(|name| !known.contains(name)).collect();
                known.extend(others);
                Error::unknown("Real output, local variable or derivative of a state", name, known, SHOWS_VARIABLES)
            })?,
        };
        if found.iter().any(|(other, _)| other.name == variable.name) {
            let reason = format!("--want {name}={value}: {} already has a wanted value", variable.name);
            return Err(Error::Argument(Invalid::because(reason)));
        }
        found.push((variable, *value));
    }
    Ok(found)
}

/// The derivative that `der(NAME)` means: that of the state NAME, or of the state that the output NAME equals.
fn derivative<'a>(instance: &Instance, plan: &Plan<'a>, name: &str) -> Result<Option<&'a Variable>, Error> {
    let Some(name) = name.strip_prefix("der(").and_then(|name| name.strip_suffix(')')) else { return Ok(None) };
    if let Some(state) = plan.states.iter().position(|state| state.name == name) {
        return Ok(Some(plan.derivatives[state]));
    }
    let Some(output) = plan.outputs.iter().find(|output| output.name == name) else { return Ok(None) };
    let states = instance.states(plan.states.len())?;
    let same = equal(instance, output, &states)?;
    instance.set_states(&states)?;
    Ok(same.map(|state| plan.derivatives[state]))
}

/// The state that an output equals, at the present states and at others.
fn equal(instance: &Instance, output: &Variable, states: &[f64]) -> Result<Option<usize>, Error> {
    let mut same: Vec<usize> = (0..states.len()).collect();
    for part in [0.0, OTHER[0], OTHER[1]] {
        // Each state gets a different step, or two states of one value would be confused.
        let step = |k: usize| part * states[k].abs().max(1.0) / (1.0 + 0.1 * k as f64);
        let moved: Vec<_> = states.iter().enumerate().map(|(k, state)| state + step(k)).collect();
        instance.set_states(&moved)?;
        let mut value = [0.0];
        instance.get_real(&references(&[output]), &mut value)?;
        same.retain(|&k| moved[k] == value[0]);
    }
    Ok(same.first().copied())
}
