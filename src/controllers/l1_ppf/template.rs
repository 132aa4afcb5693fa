//! The text of a new L1 controller with prescribed performance.

use super::L1Ppf;
use crate::catalogue::Catalogued;
use crate::controllers::l1;
use crate::controllers::template::write_funnel;
use crate::error::Invalid;
use crate::template::{Begun, Plant, Request, all, counted, list, three_digits};

/// Stiffness of the barrier in the middle of the funnel, in parts of the bandwidth.
const STIFFNESS: f64 = 4.0;

/// The design of an L1 controller, in a funnel for its references.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (n, m, _) = plant.sizes();
    let degree = n / m;
    let missing = if n % m != 0 || !(1..=2).contains(&degree) {
        Some(format!("the plant has {} and {}", counted(n, "state"), counted(m, "input")))
    } else {
        unmeasured_rate(&plant).filter(|_| degree == 2).map(|j| format!("the rate of state {} is no state", j + 1))
    };
    if let Some(missing) = missing {
        return Err(Invalid::because(format!(
            "this controller needs an input for each state, or for each coordinate with its rate among the states: {missing}. `new l1` may \
             find a controller"
        )));
    }
    let mut started = l1::template::begin(request, &L1Ppf::PAGE, [1.0, 1.0], &[])?;
    let (bandwidth, text) = (started.bandwidth, &mut started.text);
    let references = request.references(m)?;
    write_funnel(text, &references, bandwidth);
    let gain = |size: &f64| three_digits(STIFFNESS * bandwidth * (0.1 * size).powi(2));
    text.set(
        "barrier_gain",
        list(&references.iter().map(gain).collect::<Vec<_>>()),
        "how hard the barrier pushes an error back",
    );
    if degree == 2 {
        text.set("error_weight", all(three_digits(bandwidth), m), "1/s, weight of the error relative to its rate");
    }
    Ok(started.finish(request))
}

/// A state that an output shows and whose rate isn't another state.
fn unmeasured_rate(plant: &Plant) -> Option<usize> {
    let is_rate = |j: usize| {
        let ones = plant.A.row(j).iter().filter(|entry| **entry == 1.0).count();
        let others = plant.A.row(j).iter().filter(|entry| **entry != 0.0).count();
        ones == 1 && others == 1 && plant.B.row(j).iter().all(|&entry| entry == 0.0)
    };
    let shown = (0..plant.A.nrows()).filter(|&j| plant.C.column(j).iter().any(|&entry| entry != 0.0));
    shown.into_iter().find(|&j| !is_rate(j))
}
