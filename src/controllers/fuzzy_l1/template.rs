//! The text of a new L1 controller with a fuzzy gain.

use super::FuzzyL1;
use super::structure::WEIGHTS;
use crate::catalogue::Catalogued;
use crate::controllers::l1;
use crate::error::Invalid;
use crate::template::{Begun, Request, list, number, three_digits};

/// The fuzzy gain of a channel with sets in the middle of their bounds and an inference of 0.5, 0.5, and the parts of it between
/// which the gain moves.
const MIDDLE: f64 = 4.310;
const VARIES: [f64; 2] = [0.17, 2.03];

/// Each channel has its own numbers, which move its gain about the K of an L1 controller.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let entered = l1::enters_rates(&plant.B, &plant.C);
    let own = [WEIGHTS[0], "\"own\"", "\"shared\": one k_p, k_d and k_e for all channels"];
    let mut started = l1::template::begin(request, &FuzzyL1::PAGE, VARIES, &[own])?;
    let (bandwidth, gain, text) = (started.bandwidth, started.design.feedback_gain, &mut started.text);
    let references = request.references(m)?;
    // As many as there are channels; of one, the number itself.
    let each = |values: &[f64]| if let [value] = values { number(*value) } else { list(values) };
    let all = |value: f64| each(&vec![value; m]);
    let of = |value: &dyn Fn(f64) -> f64| references.iter().map(|&size| three_digits(value(size))).collect::<Vec<_>>();
    text.set("k_e", each(&of(&|size| 0.1 * size)), "error above which the gain is fuzzy");
    text.set("k_p", each(&of(&|size| 1.0 / size)), "factor of |e| in the inference: 1 is `very large`");
    let k_d = of(&|size| 0.5 / (size * bandwidth));
    let weights: Vec<_> = entered.iter().zip(&k_d).map(|(&entered, &k_d)| if entered { 0.0 } else { k_d }).collect();
    if entered.contains(&false) {
        text.set("k_d", each(&weights), "s, factor of |e'| in the inference");
    }
    let scale = three_digits(gain / MIDDLE);
    text.set("fuzzy_scale", all(scale), "factor of the fuzzy gain: K in the middle of its range");
    Ok(started.finish(request))
}
