//! The text of a new active disturbance rejection controller.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use super::Ladrc;
use crate::catalogue::Catalogued;
use crate::controllers::template::{first, stop_time, write_nominal};
use crate::design::nominal::Nominal;
use crate::design::search::{Found, modulus_of};

use crate::design::{four_digits, ladrc};
use crate::error::Invalid;
use crate::mathematics::matrices;
use crate::template::{
    Begun, Request, Values, list, named, round_down, rows, write_limits, write_magnitudes, write_names,
    write_quantities, write_units,
};

/// Poles at 0 that it can stabilise.
const MOST_INTEGRATORS: usize = 3;

/// Disturbance rejection that takes each output for a chain of integrators of its own.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let nominal = Nominal::new(&plant, request.speed(&plant)?)?;
    let found = first::find::<ladrc::Ladrc>(&nominal, "active disturbance rejection controller", MOST_INTEGRATORS)?;
    let steps = first::steps(&nominal, &found, &ladrc::entry(&found.gains, &found.S, nominal.bandwidth))?;
    let fastest = found.gains.iter().map(|gains| gains.omega_o).fold(0.0, f64::max);
    let step = first::step_within_margin(&plant, nominal.bandwidth, &found.controller, round_down(0.1 / fastest));
    let references = request.references(m)?;
    let mut text = request.begin(&Ladrc::PAGE, stop_time(found.speed * nominal.bandwidth), step);
    text.table("structure");
    text.set("channels", m, "outputs, each with a control of its own");
    text.set("order", found.gains[0].order, "each output is taken for a chain of this many integrators");
    text.set("feedforward", "\"none\"", "\"given\": the reference's derivatives are inputs, for faster tracking");
    write_units(&mut text, &[("y", &plant.y, m), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("y", plant.output_quantities()), ("u", plant.u.quantities())]);
    let (r, y, u) = (named(&plant.y, "_reference"), named(&plant.y, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("y", y), ("u", u)]);
    text.table("start");
    first::describe::<ladrc::Ladrc>(&mut text, (&plant, &nominal), &found, &steps, &references);
    let each = |gain: fn(&ladrc::Gains) -> f64| list(&found.gains.iter().map(gain).collect::<Vec<_>>());
    text.set("omega_c", each(|gains| gains.omega_c), "rad/s, poles of the loop; larger is faster, with more control");
    text.set(
        "omega_o",
        each(|gains| gains.omega_o),
        "rad/s, poles of the observer; lower is less noise in the control",
    );
    text.set(
        "B_0",
        rows(&input_gain(&nominal, &found)?),
        "input gain: from the controls to the highest derivatives of the outputs",
    );
    write_limits(&mut text, Some(&plant), m);
    write_magnitudes(&mut text, request.plant.as_ref(), (&references, nominal.bandwidth), |of| {
        let order = found.gains[0].order;
        let state = |i: usize, k: usize| of.y[i] * found.gains[i].omega_c.powi(k as i32);
        let states = DMatrix::from_fn(m, order + 1, state);
        vec![("z", Values::Rows(states)), ("u_b", (&of.u).into()), ("u", (&of.u).into())]
    });
    write_nominal(&mut text, request, found.speed * nominal.bandwidth, &request.uncertainty());
    Ok(text.finish())
}

/// B_0 = diag(b) S⁻¹.
fn input_gain(nominal: &Nominal, found: &Found<ladrc::Gains>) -> Result<DMatrix<f64>, Invalid> {
    let dependent = |_| Invalid::because("A, B, C: the controls must move the outputs independently of each other");
    let S_inverse = matrices::inverse(&found.S, 0.0).map_err(dependent)?;
    let b = DVector::from_iterator(found.gains.len(), found.gains.iter().map(|gains| gains.b_0));
    let exact = DMatrix::from_diagonal(&b) * S_inverse;
    let rounded = exact.map(four_digits);
    // Four digits of a matrix that is hardly regular may be another loop.
    let S = matrices::inverse(&rounded, 0.0).map_err(dependent)? * DMatrix::from_diagonal(&b);
    let modulus = modulus_of::<ladrc::Ladrc>(nominal, &found.gains, &S);
    let is_same = modulus.is_some_and(|modulus| modulus <= 1.005 * found.has.modulus);
    Ok(if is_same { rounded } else { exact })
}
