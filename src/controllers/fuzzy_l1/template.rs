//! The text of a new L1 controller with a fuzzy gain.

use super::FuzzyL1;
use super::structure::WEIGHTS;
use crate::catalogue::Catalogued;
use crate::controllers::l1;
use crate::error::Invalid;
use crate::template::{Begun, Request, all, list, number, three_digits};

/// A single channel with a rate has its numbers as the thesis has them; else each channel has its own.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let entered = l1::enters_rates(&plant.B, &plant.C);
    let of_one = m == 1 && entered == [false];
    let own = [WEIGHTS[0], "\"own\"", "\"shared\": one k_p, k_d and k_e for all channels"];
    let keys = if of_one { &[][..] } else { &[own] };
    let (mut text, bandwidth) = l1::template::begin(request, &FuzzyL1::PAGE, keys)?;
    let reference = request.reference;
    // As many as there are channels; of one, the number itself.
    let each = |value: f64| if m == 1 { number(value) } else { all(value, m) };
    text.set("k_e", each(three_digits(0.1 * reference)), "error above which the gain is fuzzy");
    text.set("k_p", each(three_digits(1.0 / reference)), "factor of |e| in the inference: 1 is `very large`");
    let k_d = three_digits(0.5 / (reference * bandwidth));
    let weights: Vec<_> = entered.iter().map(|&entered| if entered { 0.0 } else { k_d }).collect();
    if entered.contains(&false) {
        let k_d = if m == 1 { number(k_d) } else { list(&weights) };
        text.set("k_d", k_d, "s, factor of |e'| in the inference");
    }
    if !of_one {
        text.set("fuzzy_scale", each(1.0), "factor of the fuzzy gain, to suit a channel's K");
    }
    Ok(text.finish())
}
