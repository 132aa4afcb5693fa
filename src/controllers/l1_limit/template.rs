//! The text of a new limit controller.

use super::L1Limit;
use crate::catalogue::Catalogued;
use crate::controllers::l1::template::{describe, found, write_dynamics, write_structure};
use crate::controllers::template::{stop_time, write_nominal};
use crate::error::Invalid;
use crate::template::{Begun, Request, all, diagonal, write_limits, write_magnitudes};

/// The design of an L1 controller for the plant, of which adaptation is left out.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let (design, bandwidth) = found(request, &plant, false, [1.0, 1.0])?;
    let mut text = request.begin(&L1Limit::PAGE, stop_time(bandwidth), design.step);
    write_structure(&mut text, &plant, &design.desired, |_| {});
    text.table("start");
    describe(&mut text, (&plant, bandwidth), &design, request);
    write_dynamics(&mut text, &design);
    let gain = diagonal(design.feedback_gain, m);
    text.set("feedback_gain", gain, "1/s, K: bandwidth with which uncertainty is cancelled");
    write_limits(&mut text, Some(&plant), m);
    text.set("tracking_time", all(-1.0, m), "s, u_ad tracks the limited control; -1: 1/K, 0: off, it winds up");
    write_magnitudes(&mut text, request.plant.as_ref(), (&design.references, bandwidth), |of| {
        vec![("w", (&of.u).into()), ("u", (&of.u).into())]
    });
    write_nominal(&mut text, request, bandwidth, &request.uncertainty_or_usual());
    Ok(text.finish())
}
