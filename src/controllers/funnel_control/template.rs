//! The text of a new funnel controller: a funnel for references of some size, and the gain that keeps the nominal plant in it.
#![allow(non_snake_case)] // matrices have the names of the field

use super::FunnelControl;
use crate::catalogue::Catalogued;
use crate::controllers::template::{first, stop_time, write_nominal};
use crate::design::funnel::{self, DECAY, Design, NARROW, WIDE};
use crate::design::funnel_loop::SMOOTH_START;
use crate::design::nominal::Nominal;
use crate::design::{digits, percent};
use crate::error::Invalid;
use crate::template::{
    Begun, Plant, Request, Text, all, list, named, one_or_each, round_down, rows, three_digits, write_limits,
    write_magnitudes, write_names, write_quantities, write_units,
};

/// A communication step that is so short, in 1/W, is worth a word.
const SHORT: f64 = 1e-3;

/// A funnel about each output.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let (bandwidth, references) = (request.speed(&plant)?, request.references(m)?);
    let nominal = Nominal::new(&plant, bandwidth)?;
    let design = funnel::design(&nominal, &references)?;
    let mut text = request.begin(&FunnelControl::PAGE, stop_time(bandwidth), round_down(design.step));
    text.table("structure");
    text.set("channels", m, "outputs, each with a control of its own");
    text.set("relative_degree", design.degree, "the control shows in this derivative of each output");
    write_units(&mut text, &[("y", &plant.y, m), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("y", plant.output_quantities()), ("u", plant.u.quantities())]);
    let (r, y, u) = (named(&plant.y, "_reference"), named(&plant.y, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("y", y), ("u", u)]);
    text.table("start");
    describe(&mut text, &plant, &nominal, &design, &references);
    let parts = |part: f64| list(&references.iter().map(|size| three_digits(part * size)).collect::<Vec<_>>());
    text.set("psi_0", parts(WIDE), "bound of the error at the start, which the error must not exceed");
    text.set("psi_inf", parts(NARROW), "bound of the error in the end");
    text.set("decay_rate", all(three_digits(DECAY * bandwidth), m), "1/s, rate at which the bound narrows");
    if design.degree > 1 {
        text.set("tau", all(design.tau, m), "s, time constant of the error's filter");
    }
    text.set("g", list(&design.g), "gain; larger keeps the error nearer to the middle");
    text.set("G", rows(&design.G), "from the outputs of the channels to the controls: the inverse of the input gain");
    text.set("on_funnel_exit", "\"reopen\"", "\"error\": a step in which an error leaves is refused");
    write_limits(&mut text, Some(&plant), m);
    write_magnitudes(&mut text, request.plant.as_ref(), (&references, bandwidth), |of| {
        vec![("u_b", (&of.u).into()), ("u", (&of.u).into())]
    });
    write_nominal(&mut text, request, bandwidth, &request.uncertainty());
    Ok(text.finish())
}

/// Writes for which references this is, and what the nominal loop needs.
fn describe(text: &mut Text, plant: &Plant, nominal: &Nominal, design: &Design, references: &[f64]) {
    let (W, sizes) = (nominal.bandwidth, one_or_each(references));
    let rate = digits(SMOOTH_START * W);
    let derivatives = if design.degree > 1 { ", with its derivatives as inputs" } else { "" };
    text.comment(&format!(
        "Nominal loop: the errors take up at most {} of their bounds, and {} % of the reference is left in the end, for a",
        digits(design.largest_part),
        percent(100.0 * design.left)
    ));
    text.comment(&format!("reference of {sizes} that starts smoothly, smooth_start_rate = {rate} 1/s{derivatives}."));
    text.comment("A reference that steps leaves the funnel: `new loop` lets it start smoothly.");
    if let Some(needed) = first::beyond_limits(plant, &design.control) {
        text.note(&format!(
            "Following a reference of {sizes} needs controls {needed}, beyond u_min and u_max, where the funnel isn't guaranteed. Give a \
             smaller --reference or a lower --bandwidth."
        ));
    }
    if !design.is_sampled {
        text.note(
            "No communication step was found that is short enough for this controller and plant. Run the loop as one continuous \
             system, with `run --composite`.",
        );
    }
    if W * design.step < SHORT {
        let fastest = nominal.poles.iter().chain(&nominal.zeros).map(|value| value.norm()).fold(0.0, f64::max) * W;
        text.note(&format!(
            "This controller needs a communication step of {} s for {} rad/s, for its gain and for the plant's dynamics, which go up to {} rad/s. \
             `new ladrc` allows longer steps, and `run --composite` needs none.",
            digits(round_down(design.step)),
            digits(W),
            digits(fastest)
        ));
    }
}
