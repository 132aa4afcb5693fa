//! The text of a new L1 controller with prescribed performance.

use super::L1Ppf;
use crate::catalogue::Catalogued;
use crate::controllers::l1;
use crate::controllers::template::write_funnel;
use crate::error::Invalid;
use crate::template::{Begun, Request, all, three_digits};

/// Stiffness of the barrier in the middle of the funnel, in parts of the bandwidth.
const STIFFNESS: f64 = 4.0;

/// C B below this part of the largest entries counts as 0.
const NEGLIGIBLE: f64 = 1e-9;

/// The design of an L1 controller, in a funnel for its references.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (n, m, _) = plant.sizes();
    let degree = n / m;
    let shows_at_once = (&plant.C * &plant.B).amax() > NEGLIGIBLE * plant.C.amax() * plant.B.amax();
    if n % m != 0 || !(degree == 1 || degree == 2 && !shows_at_once) {
        return Err(Invalid::because(format!(
            "this law needs an input for each state, or for each coordinate with its rate as the next state: the plant has {n} \
             states and {m} inputs{}",
            if degree == 2 { ", and an input acts on the rate of an output directly" } else { "" }
        )));
    }
    let (mut text, bandwidth) = l1::template::begin(request, &L1Ppf::PAGE, &[])?;
    write_funnel(&mut text, request.reference, bandwidth, m);
    let rho_inf = 0.1 * request.reference;
    let gain = three_digits(STIFFNESS * bandwidth * rho_inf * rho_inf);
    text.set("barrier_gain", all(gain, m), "how hard the barrier pushes an error back");
    if degree == 2 {
        text.set("error_weight", all(three_digits(bandwidth), m), "1/s, weight of the error beside its rate");
    }
    Ok(text.finish())
}
