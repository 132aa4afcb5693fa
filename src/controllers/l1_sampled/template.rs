//! The text of a new sampled L1 controller.

use super::L1Sampled;
use crate::catalogue::Catalogued;
use crate::controllers::l1::template::{describe, found, write_dynamics, write_structure};
use crate::controllers::template::{stop_time, write_nominal};
use crate::error::Invalid;
use crate::template::{Begun, Request, all, diagonal, number, write_limits};

/// The design of an L1 controller for the plant, at its step, for a master that steps all FMUs simultaneously.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let (design, bandwidth) = found(request, &plant, false, [1.0, 1.0])?;
    let mut text = request.begin(&L1Sampled::PAGE, stop_time(bandwidth), design.step);
    write_structure(&mut text, &plant, &design.desired, |text| {
        text.set("estimate", "\"exact\"", "of the uncertainty; \"published\": by a predictor, weaker at long samples");
    });
    text.table("start");
    describe(&mut text, (&plant, bandwidth), &design, request);
    text.set("sample_time", number(design.step), "s, how often it acts; a master's step, or a multiple of it");
    text.set("delay_steps", 1, "0: the plant is stepped before the controller; 1: both simultaneously");
    text.set("nominal_input_gain", diagonal(1.0, m), "W_0: effect of the controls, in columns of B");
    write_dynamics(&mut text, &design);
    text.set("feedback_gain", all(design.feedback_gain, m), "1/s, bandwidth with which uncertainty is cancelled");
    write_limits(&mut text, Some(&plant), m);
    write_nominal(&mut text, request, bandwidth, &request.uncertainty_or_usual());
    Ok(text.finish())
}
