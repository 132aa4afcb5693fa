//! The text of a new PID controller.
#![allow(non_snake_case)] // matrices have the names of the field

use super::Pid;
use crate::catalogue::Catalogued;
use crate::controllers::template::{first, stop_time, write_nominal};
use crate::design::nominal::Nominal;
use crate::design::search::{Found, search};
use crate::design::step::Step;
use crate::design::{ladrc, pid};
use crate::error::Invalid;
use crate::template::{
    Begun, Request, Values, all, list, named, round_down, rows, write_limits, write_magnitudes, write_names,
    write_quantities, write_units,
};

/// Poles at 0 that a PID controller can stabilise.
const MOST_INTEGRATORS: usize = 2;
/// Weights of the reference, the largest of which is taken whose step overshoots by no more than this part.
const WEIGHTS: [f64; 4] = [1.0, 0.7, 0.4, 0.0];
const OVERSHOOT: f64 = 0.1;

/// PID control with stability margins.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let nominal = Nominal::new(&plant, request.speed(&plant)?)?;
    let found = find(&nominal)?;
    let (b, steps) = weights(&nominal, &found)?;
    // Without a derivative nothing is as fast as its filter.
    let rate = |gains: &pid::Gains| if gains.K_d > 0.0 { gains.N } else { 0.2 * gains.N };
    let fastest = found.gains.iter().map(rate).fold(0.0, f64::max);
    let step = first::step_within_margin(&plant, nominal.bandwidth, &found.controller, round_down(0.1 / fastest));
    let references = request.references(m)?;
    let mut text = request.begin(&Pid::PAGE, stop_time(found.speed * nominal.bandwidth), step);
    text.table("structure");
    text.set("channels", m, "outputs, each with a control of its own");
    write_units(&mut text, &[("y", &plant.y, m), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("y", plant.output_quantities()), ("u", plant.u.quantities())]);
    let (r, y, u) = (named(&plant.y, "_reference"), named(&plant.y, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("y", y), ("u", u)]);
    text.table("start");
    first::describe::<pid::Pid>(&mut text, (&plant, &nominal), &found, &steps, &references);
    let each = |gain: fn(&pid::Gains) -> f64| list(&found.gains.iter().map(gain).collect::<Vec<_>>());
    text.set("K_p", each(|gains| gains.K_p), "proportional gains");
    text.set("K_i", each(|gains| gains.K_i), "1/s, integral gains");
    text.set("K_d", each(|gains| gains.K_d), "s, derivative gains");
    text.set("b", list(&b), "weight of the reference in the proportional part; less overshoots less");
    text.set("c", all(0.0, m), "and in the derivative; 0 for a reference that steps");
    text.set("N", each(|gains| gains.N), "rad/s, filter of the derivative: lower is less noise in the control");
    text.set("S", rows(&found.S), "from the outputs of the channels to the controls: decoupling, and the sign of each");
    write_limits(&mut text, Some(&plant), m);
    text.set("tracking_time", all(-1.0, m), "s, time constant of anti-windup; -1: from the gains, 0: off");
    let W = nominal.bandwidth;
    write_magnitudes(&mut text, request.plant.as_ref(), (&references, W), |of| {
        let part = |(gains, y): (&pid::Gains, &f64)| (gains.K_p.abs() + gains.K_i.abs() / W) * y;
        let integral = Values::List(found.gains.iter().zip(&of.y).map(part).collect());
        vec![("I", integral), ("w", (&of.y).into()), ("u", (&of.u).into())]
    });
    write_nominal(&mut text, request, found.speed * nominal.bandwidth, &request.uncertainty());
    Ok(text.finish())
}

/// A design, or why there is none, and whether disturbance rejection has one.
fn find(nominal: &Nominal) -> Result<Found<pid::Gains>, Invalid> {
    first::find::<pid::Pid>(nominal, "PID controller", MOST_INTEGRATORS).map_err(|refusal| {
        let other = search::<ladrc::Ladrc>(nominal).map_or("", |_| ". `new ladrc` finds a controller for this plant");
        Invalid::because(format!("{refusal}{other}"))
    })
}

/// The weight of the reference in the proportional part of each channel, and the steps with them.
fn weights(nominal: &Nominal, found: &Found<pid::Gains>) -> Result<(Vec<f64>, Vec<Step>), Invalid> {
    let of_all = |b: f64| vec![[b, 0.0]; found.gains.len()];
    let entry = |b: f64| pid::entry(&found.gains, &of_all(b), &found.S, nominal.bandwidth);
    let tried = WEIGHTS.iter().map(|&weight| first::steps(nominal, found, &entry(weight)));
    let tried = tried.collect::<Result<Vec<_>, _>>()?;
    let chosen = (0..nominal.channels()).map(|i| {
        if found.gains[i].K_p == 0.0 {
            return 0;
        }
        let fits = |steps: &Vec<Step>| steps[i].overshoot <= OVERSHOOT;
        tried.iter().position(fits).unwrap_or(WEIGHTS.len() - 1)
    });
    let chosen: Vec<_> = chosen.collect();
    let steps = chosen.iter().enumerate().map(|(i, &weight)| tried[weight][i].clone()).collect();
    Ok((chosen.into_iter().map(|weight| WEIGHTS[weight]).collect(), steps))
}
