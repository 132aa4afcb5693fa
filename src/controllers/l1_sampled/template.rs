//! The text of a new sampled L1 controller.

use super::L1Sampled;
use crate::catalogue::Catalogued;
use crate::controllers::template::{design, stop_time, write_plant, write_poles};
use crate::error::Invalid;
use crate::template::{
    Begun, Request, all, diagonal, named, number, round_down, write_limits, write_names, write_quantities, write_units,
};

/// Samples in the time constant of the fastest pole, or of the filter.
const SAMPLES: f64 = 5.0;

/// The design of an L1 controller for the plant, at a sample time that suits it, for a master that steps all at once.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (n, m, _) = plant.sizes();
    let bandwidth = design::bandwidth(&plant, request)?;
    let design = design::design(&plant, bandwidth, request.reference)?;
    let fastest = design.poles.iter().map(|pole| pole.norm()).fold(design.feedback_gain, f64::max);
    let sample_time = round_down(1.0 / (SAMPLES * fastest));
    let mut text = request.begin(&L1Sampled::PAGE, stop_time(bandwidth), sample_time);
    text.table("structure");
    write_plant(&mut text, &plant, "what is to follow the reference");
    text.set("baseline", "\"outside\"", "the poles of A are put where pole_real, pole_imag say");
    text.set("estimate", "\"exact\"", "of what is unknown; \"published\": by a predictor, weaker at long samples");
    write_units(&mut text, &[("r", &plant.y, m), ("x", &plant.x, n), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("x", plant.x.quantities()), ("u", plant.u.quantities())]);
    let (r, x, u) = (named(&plant.y, "_reference"), named(&plant.x, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("x", x), ("u", u)]);
    text.table("start");
    text.set("sample_time", number(sample_time), "s, how often it acts; a master's step, or a multiple of it");
    text.set("delay_steps", 1, "0: the plant is stepped before the controller; 1: both at once");
    text.set("nominal_input_gain", diagonal(1.0, m), "W_0: what the controls do, in columns of B");
    write_poles(&mut text, "", &design.poles, "1/s, poles of A_m, how the controlled plant is to move");
    text.set("feedback_gain", all(design.feedback_gain, m), "1/s, bandwidth with which uncertainty is cancelled");
    write_limits(&mut text, Some(&plant), m);
    Ok(text.finish())
}
