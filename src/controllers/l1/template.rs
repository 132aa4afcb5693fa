//! The text of a new L1 controller.

use crate::controllers::template::{design, stop_time, write_plant, write_poles};
use crate::error::Invalid;
use crate::pages::Page;
use crate::template::{
    Request, Text, all, diagonal, list, named, number, write_limits, write_names, write_quantities, write_units,
};

/// The text of a law with this page, to which more can be added, and its bandwidth, rad/s; with these further
/// keys of its structure, their values and what these are.
///
/// # Errors
/// Why there is no design for the plant.
pub fn begin(request: &Request, page: &Page, keys: &[[&str; 3]]) -> Result<(Text, f64), Invalid> {
    let plant = request.plant(true)?;
    let (n, m, _) = plant.sizes();
    let bandwidth = design::bandwidth(&plant, request)?;
    let design = design::design(&plant, bandwidth, request.reference)?;
    let mut text = request.begin(page, stop_time(bandwidth), design.step);
    text.table("structure");
    write_plant(&mut text, &plant, "what is to follow the reference");
    text.set("baseline", "\"outside\"", "-K_m x puts the poles of A where pole_real, pole_imag say");
    text.set("regressor", "\"state\"", "theta multiplies x; \"infinity_norm\": its largest element, fewer estimates");
    text.set("input_gain", "\"diagonal\"", "omega; \"full\" where inputs act on each other's channels");
    keys.iter().for_each(|[key, value, what]| text.set(key, value, what));
    write_units(&mut text, &[("r", &plant.y, m), ("x", &plant.x, n), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("x", plant.x.quantities()), ("u", plant.u.quantities())]);
    let (r, x, u) = (named(&plant.y, "_reference"), named(&plant.x, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("x", x), ("u", u)]);
    text.table("start");
    write_poles(&mut text, "", &design.poles, "1/s, poles of A_m, how the controlled plant is to move");
    text.set("feedback_gain", diagonal(design.feedback_gain, m), "1/s, K: bandwidth of the adaptive control");
    text.set("adaptation_gain", number(design.adaptation_gain), "Gamma: larger is faster, and needs shorter steps");
    text.set("omega_min", all(design::OMEGA[0], m), "input gain, in parts of B, at least");
    text.set("omega_max", all(design::OMEGA[1], m), "and at most");
    text.set("theta_bound", list(&design.theta_bound), "of each element of theta, which multiplies x");
    text.set("sigma_bound", list(&design.sigma_bound), "of the disturbance, in the unit of u");
    write_limits(&mut text, Some(&plant), m);
    text.set("tracking_time", all(-1.0, m), "s, u_ad follows what the limits leave; -1: 1/K, 0: off, it winds up");
    Ok((text, bandwidth))
}
