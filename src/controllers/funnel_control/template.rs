//! The text of a new funnel controller: the direction of the nominal plant, and a funnel for its references.
#![allow(non_snake_case)] // matrices have the names of the field

use super::{FunnelControl, MOST_DEGREE};
use crate::catalogue::Catalogued;
use crate::controllers::template::{design, input_gain, stop_time};
use crate::error::Invalid;
use crate::mathematics::matrices;
use crate::template::{
    Request, all, named, round_down, rows, three_digits, write_limits, write_names, write_quantities, write_units,
};

/// How much more than the reference alone needs the gain gives in the middle of the funnel.
const GAIN: f64 = 10.0;
/// The least singular value of an input gain, in parts of the largest one.
const LEAST_DIRECTION: f64 = 1e-12;

/// A funnel about each output.
pub fn write(request: &Request) -> Result<String, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let (degree, gain) = input_gain(&plant, MOST_DEGREE)?;
    let text = "A, B, C: the controls must move the outputs, or their derivatives, independently of each other";
    let G = matrices::inverse(&gain, LEAST_DIRECTION).map_err(|_| Invalid::because(text))?.map(three_digits);
    let (bandwidth, reference) = (design::bandwidth(&plant, request.bandwidth)?, request.reference);
    let g = three_digits(GAIN * reference * bandwidth.powi(degree as i32));
    if !(g > 0.0 && g.is_finite()) {
        return Err(Invalid::because("the plant, the bandwidth and the reference differ by too many powers of ten"));
    }
    let step = round_down((0.01 / bandwidth).min(1e-3));
    let mut text = request.begin(&FunnelControl::PAGE, stop_time(bandwidth), step);
    text.table("structure");
    text.set("channels", m, "outputs, each with a control of its own");
    text.set("relative_degree", degree, "after how many derivatives of an output the control shows");
    write_units(&mut text, &[("y", &plant.y, m), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("y", plant.output_quantities()), ("u", plant.u.quantities())]);
    let (r, y, u) = (named(&plant.y, "_reference"), named(&plant.y, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("y", y), ("u", u)]);
    text.table("start");
    text.set("psi_0", all(2.0 * reference, m), "bound of the error at the start: it must begin inside");
    text.set("psi_inf", all(three_digits(0.1 * reference), m), "and in the end");
    text.set("decay_rate", all(three_digits(0.5 * bandwidth), m), "1/s, how fast the bound narrows");
    if degree > 1 {
        text.set("tau", all(three_digits(0.5 / bandwidth), m), "s, in which the error comes back to the middle");
    }
    text.set("g", all(g, m), "gain; larger keeps the error nearer to the middle");
    text.set("G", rows(&G), "from what the channels ask for to the controls: the inverse of how the plant answers");
    write_limits(&mut text, Some(&plant), m);
    Ok(text.finish())
}
