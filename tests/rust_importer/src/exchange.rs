//! Model exchange, by the simplest of all solvers: Euler's steps, each between two events at which inputs are set.

use fmi::EventFlags;
use fmi::fmi2::import::Fmi2Import;
use fmi::fmi2::instance::{Common, InstanceME, ModelExchange};
use fmi::fmi2::schema::Causality;
use fmi::traits::FmiImport;

use crate::table::{Points, Variables};
use crate::{Answer, initialise};

/// All steps, in model exchange.
pub fn run(import: &Fmi2Import, start: &[(String, f64)], points: &Points) -> Answer<()> {
    let mut unit = import.instantiate_me("unit", false, false)?;
    let inputs = Variables::named(import, &points.inputs)?;
    let outputs = Variables::of(import, Causality::Output)?;
    let states = import.model_description().num_states();
    let (mut x, mut rate) = (vec![0.0; states], vec![0.0; states]);
    initialise(&mut unit, import, start, points)?;
    settle(&mut unit)?;
    outputs.print_names();
    outputs.print(&mut unit)?;
    for row in &points.rows {
        ModelExchange::enter_event_mode(&mut unit)?;
        inputs.set(&mut unit, &row.inputs)?;
        settle(&mut unit)?;
        ModelExchange::get_continuous_states(&mut unit, &mut x)?;
        unit.get_derivatives(&mut rate)?;
        for (x, rate) in x.iter_mut().zip(&rate) {
            *x += row.step * rate;
        }
        ModelExchange::set_time(&mut unit, row.time + row.step)?;
        ModelExchange::set_continuous_states(&mut unit, &x)?;
        let (mut event, mut end) = (false, false);
        ModelExchange::completed_integrator_step(&mut unit, true, &mut event, &mut end)?;
        outputs.print(&mut unit)?;
    }
    Common::terminate(&mut unit)?;
    Ok(())
}

/// Updates discrete states until none changes, and goes on to Continuous-Time Mode.
fn settle(unit: &mut InstanceME) -> Answer<()> {
    let mut flags = EventFlags { discrete_states_need_update: true, ..EventFlags::default() };
    while flags.discrete_states_need_update {
        unit.new_discrete_states(&mut flags)?;
        if flags.terminate_simulation {
            return Err("the unit asks to end the simulation".into());
        }
    }
    ModelExchange::enter_continuous_time_mode(unit)?;
    Ok(())
}
