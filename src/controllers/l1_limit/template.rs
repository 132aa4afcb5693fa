//! The text of a new limit controller.

use super::L1Limit;
use crate::catalogue::Catalogued;
use crate::controllers::template::{design, stop_time, write_plant, write_poles};
use crate::error::Invalid;
use crate::template::{Begun, Request, all, diagonal, named, write_limits, write_names, write_quantities, write_units};

/// The design of an L1 controller for the plant, of which adaptation is left out.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (n, m, _) = plant.sizes();
    let bandwidth = design::bandwidth(&plant, request)?;
    let design = design::design(&plant, bandwidth, request.reference)?;
    let mut text = request.begin(&L1Limit::PAGE, stop_time(bandwidth), design.step);
    text.table("structure");
    write_plant(&mut text, &plant, "what is to follow the reference");
    text.set("baseline", "\"outside\"", "-K_m x puts the poles of A where pole_real, pole_imag say");
    write_units(&mut text, &[("r", &plant.y, m), ("x", &plant.x, n), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("x", plant.x.quantities()), ("u", plant.u.quantities())]);
    let (r, x, u) = (named(&plant.y, "_reference"), named(&plant.x, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("x", x), ("u", u)]);
    text.table("start");
    write_poles(&mut text, "", &design.poles, "1/s, poles of A_m, how the controlled plant is to move");
    text.set(
        "feedback_gain",
        diagonal(design.feedback_gain, m),
        "1/s, K: bandwidth with which uncertainty is cancelled",
    );
    write_limits(&mut text, Some(&plant), m);
    text.set("tracking_time", all(-1.0, m), "s, u_ad follows what the limits leave; -1: 1/K, 0: off, it winds up");
    Ok(text.finish())
}
