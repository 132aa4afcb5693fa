//! Smooth start of references in loops with a funnel about y - r, which a step would leave.

use super::{Draft, Signal};
use crate::model_description::Variable;

/// Kinds of the FMUs concerned.
const FUNNEL: &str = "funnel";
/// Parameters of a controller with prescribed performance of the difference itself; one with a reference model has
/// only the first.
const PRESCRIBED: [&str; 2] = ["rho_0[1]", "lambda[1]"];
const REFERENCE: &str = "reference";
/// Rate of the smooth start relative to the rate at which the funnel narrows, as `new funnel` designs for it.
const RATE: f64 = 4.0;

/// Start values that a component has in the loop, and why.
#[derive(Debug)]
pub struct Starts {
    /// Place of the component.
    pub unit: usize,
    /// Names and values.
    pub values: Vec<(String, f64)>,
    /// Reason, for the user.
    pub why: String,
}

/// The start values of references that step and lead to a funnel controller.
pub fn of(draft: &Draft) -> Vec<Starts> {
    let model = |unit: usize| draft.units[unit].model.as_deref();
    let references = (0..draft.units.len()).filter(|&unit| model(unit) == Some(REFERENCE));
    let starts = references.filter_map(|unit| {
        let leads = |(from, to): &(Signal, Signal)| from.0 == unit && has_funnel(draft, to.0);
        let funnel = draft.connections().find(leads)?.1.0;
        smooth(draft, unit, funnel)
    });
    starts.collect()
}

/// True for a component that keeps the difference from the reference itself within a funnel.
fn has_funnel(draft: &Draft, unit: usize) -> bool {
    let unit = &draft.units[unit];
    let is_prescribed = || PRESCRIBED.iter().all(|name| unit.description.variable(name).is_some());
    unit.model.as_ref().is_some_and(|model| model == FUNNEL || is_prescribed())
}

/// True if a reference steps in its loop: then its largest error is the step.
pub fn steps(draft: &Draft, unit: usize) -> bool {
    let heights = |variable: &&Variable| variable.name.starts_with("step_height[");
    draft.units[unit].model.as_deref() == Some(REFERENCE)
        && draft.starts.iter().all(|starts| starts.unit != unit)
        && draft.units[unit].description.variables.iter().filter(heights).filter_map(number).any(|height| height != 0.0)
}

/// Every step as an offset that comes in smoothly.
fn smooth(draft: &Draft, unit: usize, funnel: usize) -> Option<Starts> {
    let start = |unit: usize, name: &str| draft.units[unit].description.variable(name).and_then(number);
    let rate = (1..).map_while(|i| start(funnel, &format!("decay_rate[{i}]"))).reduce(f64::min)? * RATE;
    let mut values = Vec::new();
    for i in 1.. {
        let Some(given) = start(unit, &format!("smooth_start_rate[{i}]")) else { break };
        let steps: Vec<_> = (1..).map_while(|k| Some((k, start(unit, &format!("step_height[{i},{k}]"))?))).collect();
        let height: f64 = steps.iter().map(|(_, height)| height).sum();
        if given != 0.0 || steps.iter().all(|(_, height)| *height == 0.0) {
            continue;
        }
        let offset = start(unit, &format!("offset[{i}]")).unwrap_or(0.0);
        values.push((format!("offset[{i}]"), offset + height));
        values.push((format!("smooth_start_rate[{i}]"), rate));
        let taken = steps.iter().filter(|(_, height)| *height != 0.0);
        values.extend(taken.map(|(k, _)| (format!("step_height[{i},{k}]"), 0.0)));
    }
    let [name, funnel] = [unit, funnel].map(|unit| &draft.names[unit]);
    let why = format!(
        "{name} starts smoothly from 0 s on instead of stepping (offset and smooth_start_rate in place of step_height): a step would \
         leave the funnel of {funnel}"
    );
    (!values.is_empty()).then_some(Starts { unit, values, why })
}

fn number(variable: &Variable) -> Option<f64> {
    variable.start.as_ref()?.trim().parse().ok()
}
