//! States whose derivatives are zero while time and inputs are held: Newton's method with the exact Jacobian.

use nalgebra::{DMatrix, DVector};

use super::plan::Plan;
use crate::error::Error;
use crate::fmu::Instance;

const STEPS: usize = 100;
/// Of a derivative, relative to what the states contribute to it.
const TOLERANCE: f64 = 1e-10;
/// Singular values below this part of the largest are taken for zero.
const RANK: f64 = 1e-9;
/// A Newton step is never shortened below this part.
const SHORTEST: f64 = 1e-6;

/// The derivatives at the present states, and what they depend on.
struct Balance {
    derivatives: DVector<f64>,
    jacobian: DMatrix<f64>,
    /// Size of what each derivative is made of: rates may be of very different sizes.
    sizes: DVector<f64>,
}

/// Moves an instance for model exchange, just initialised, to a steady state; whether that is the only one near.
///
/// Where the Jacobian is singular (a controller with an integrator, estimates that nothing excites), each step is the
/// shortest one of those that solve for zero: of many steady states, one near the start values is found.
///
/// # Errors
/// When there is none near the start values, with the derivative that remains.
pub(super) fn find(instance: &Instance, plan: &Plan, time: f64) -> Result<bool, Error> {
    instance.finish_event()?;
    let count = plan.states.len();
    if count == 0 {
        return Ok(true);
    }
    let refuse = |message: String| {
        let (unit, function) = (instance.name().to_owned(), "the search for a steady state");
        Error::Unit { unit, function, time, message }
    };
    let mut states = DVector::from_vec(instance.states(count)?);
    let mut step = 0;
    loop {
        let balance = Balance::of(instance, plan, &states)?;
        let remaining = balance.scaled(&balance.derivatives);
        if !remaining.iter().chain(&balance.jacobian).all(|value| value.is_finite()) {
            return Err(refuse("a derivative is not finite".to_owned()));
        }
        let singular = balance.scaled_jacobian().svd(true, true);
        let smallest = RANK * singular.singular_values.max();
        let rank = singular.rank(smallest);
        if remaining.amax() <= TOLERANCE {
            return Ok(rank == count);
        }
        // Never an error: both matrices were asked for, and the threshold is not negative.
        let newton = singular.solve(&-&remaining, smallest).map_err(|message| refuse(message.to_owned()))?;
        match shortened(instance, &balance, &states, &newton)? {
            Some(next) if step < STEPS => (states, step) = (next, step + 1),
            _ => return Err(refuse(none_near(plan, &balance, step, rank))),
        }
    }
}

/// States along a Newton step that lessen what remains: all of the step where that does, else a part of it.
fn shortened(
    instance: &Instance,
    balance: &Balance,
    states: &DVector<f64>,
    newton: &DVector<f64>,
) -> Result<Option<DVector<f64>>, Error> {
    let before = balance.scaled(&balance.derivatives).norm();
    let mut part = 1.0;
    while part >= SHORTEST {
        let next = states + newton * part;
        let derivatives = settled(instance, &next)?;
        let after = balance.scaled(&derivatives).norm();
        if after <= (1.0 - 1e-4 * part) * before {
            return Ok(Some(DVector::from_vec(instance.states(states.len())?)));
        }
        part *= 0.5;
    }
    Ok(None)
}

/// The derivatives at some states. What switches there switches: an event may even set the states anew.
fn settled(instance: &Instance, states: &DVector<f64>) -> Result<DVector<f64>, Error> {
    instance.set_states(states.as_slice())?;
    instance.begin_event()?;
    instance.finish_event()?;
    Ok(DVector::from_vec(instance.state_derivatives(states.len())?))
}

impl Balance {
    fn of(instance: &Instance, plan: &Plan, states: &DVector<f64>) -> Result<Self, Error> {
        let derivatives = settled(instance, states)?;
        let jacobian = plan.by_states(instance)?.derivatives;
        let sizes = DVector::from_fn(states.len(), |row, _| {
            let size: f64 = jacobian.row(row).iter().zip(states).map(|(j, x)| j.abs() * x.abs().max(1.0)).sum();
            if size > 0.0 { size } else { 1.0 }
        });
        Ok(Balance { derivatives, jacobian, sizes })
    }

    fn scaled(&self, derivatives: &DVector<f64>) -> DVector<f64> {
        derivatives.component_div(&self.sizes)
    }

    fn scaled_jacobian(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.sizes.len(), self.sizes.len(), |row, column| {
            self.jacobian[(row, column)] / self.sizes[row]
        })
    }
}

fn none_near(plan: &Plan, balance: &Balance, step: usize, rank: usize) -> String {
    let largest = balance.scaled(&balance.derivatives).iamax();
    let (variable, value) = (plan.derivatives[largest], balance.derivatives[largest]);
    let unit = variable.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
    let count = plan.states.len();
    let singular = if rank < count { format!("; A is singular there (rank {rank} of {count})") } else { String::new() };
    format!(
        "no steady state was found near the start values. After {step} Newton steps, {} = {value:.6e}{unit} \
         remains{singular}",
        variable.name
    )
}
