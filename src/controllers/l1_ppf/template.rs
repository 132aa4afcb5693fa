//! The text of a new L1 controller with prescribed performance.

use super::L1Ppf;
use crate::catalogue::Catalogued;
use crate::controllers::l1;
use crate::controllers::template::{input_gain, write_funnel};
use crate::error::Invalid;
use crate::template::{Request, all, three_digits};

/// Stiffness of the barrier in the middle of the funnel, in parts of the bandwidth.
const STIFFNESS: f64 = 4.0;

/// The design of an L1 controller, in a funnel for its references.
pub fn write(request: &Request) -> Result<String, Invalid> {
    let plant = request.plant(true)?;
    let (n, m, _) = plant.sizes();
    let degree = if n == m { 1 } else { input_gain(&plant, 2)?.0 };
    if n != degree * m {
        let allowed =
            format!("must be {m} (one control per state) or {} (one control per coordinate with its rate)", 2 * m);
        return Err(Invalid::new("states", n, allowed));
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
