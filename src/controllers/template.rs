//! Texts that new controllers share.
#![allow(non_snake_case)] // matrices have the names of the field

pub mod design;
pub mod first;

use nalgebra::DMatrix;

use crate::error::Invalid;
use crate::nominal::{Covariance, Identified, Uncertainty};
use crate::template::{Plant, Request, Text, all, list, number, quoted, round_up, rows, three_digits};

/// Refuses a plant with dead times, for a law with funnels.
///
/// # Errors
/// A dead time.
pub fn require_no_delay(plant: &Plant) -> Result<(), Invalid> {
    if plant.delay.iter().all(|&delay| delay == 0.0) {
        return Ok(());
    }
    Err(Invalid::because(
        "delay: a controller with funnels takes no dead time. `new pid` or `new ladrc` may find a controller",
    ))
}

/// Default stop time of a simulation: a multiple of the slowest time constant, s.
pub fn stop_time(bandwidth: f64) -> f64 {
    round_up(20.0 / bandwidth)
}

/// The nominal plant, with what its outputs are.
pub fn write_plant(text: &mut Text, plant: &Plant, outputs: &str) {
    text.comment("Nominal plant x' = A x + B u, y = C x: rows of numbers, n x n, n x m, m x n.");
    text.set("A", rows(&plant.A), "");
    text.set("B", rows(&plant.B), "");
    text.set("C", rows(&plant.C), outputs);
}

/// The user's plant that a design of this speed, rad/s, is for, with what was asked for; nothing where no plant was given.
pub fn write_nominal(text: &mut Text, request: &Request, speed: f64, uncertainty: &Uncertainty) {
    let C = request.plant.as_ref().map(|plant| plant.C.clone());
    C.iter().for_each(|C| write_nominal_with(text, C, request, speed, uncertainty));
}

/// The same where other combinations of the states, by the rows of C, follow the references.
pub fn write_nominal_with(text: &mut Text, C: &DMatrix<f64>, request: &Request, speed: f64, uncertainty: &Uncertainty) {
    let Some(plant) = &request.plant else { return };
    text.table("nominal");
    text.comment(
        "Plant that the gains were designed for, x' = A x + B u, y = C x: for the page and the design report.",
    );
    text.set("A", rows(&plant.A), "");
    text.set("B", rows(&plant.B), "");
    text.set("C", rows(C), "");
    if let [first, rest @ ..] = &plant.delay[..] {
        let is_one = rest.iter().all(|delay| delay == first);
        let delay = if is_one { number(*first) } else { list(&plant.delay) };
        text.set("delay", delay, "s, dead time of the inputs");
    }
    text.set("bandwidth", number(speed), "rad/s, speed that the design is for");
    let reference = if let [one] = request.reference { number(*one) } else { list(request.reference) };
    text.set("reference", reference, "usual magnitude of the reference");
    match uncertainty {
        Uncertainty::Part(part) => {
            text.set("uncertainty", number(*part), "of each entry of A and B, as a part of it: 0.2 is 20 %");
        }
        Uncertainty::Model(model) => write_region(text, model, C.ncols()),
        Uncertainty::Unknown | Uncertainty::Elements { .. } => {}
    }
}

/// The model that a plant is from, with what its records leave uncertain of n states.
fn write_region(text: &mut Text, Identified { file, sha256, level, margin, region }: &Identified, n: usize) {
    text.set("model", quoted(file), "file of the model that was identified from records");
    sha256.iter().for_each(|sum| text.set("sha256", quoted(sum), ""));
    level.iter().for_each(|level| text.set("level", number(*level), "confidence level of its region"));
    margin.iter().for_each(|margin| text.set("margin", number(*margin), "factor of the region: wear, other loads"));
    let Some(Covariance { entries, matrix }) = region else { return };
    let free = entries.iter().map(|&entry| match entry.checked_sub(n * n) {
        None => format!("[\"A\", {}, {}]", entry % n + 1, entry / n + 1),
        Some(of_B) => format!("[\"B\", {}, {}]", of_B % n + 1, of_B / n + 1),
    });
    text.set("free", format!("[{}]", free.collect::<Vec<_>>().join(", ")), "entries that were estimated");
    let rows = (0..entries.len()).map(|i| list(&matrix.row(i).columns(0, i + 1).iter().copied().collect::<Vec<_>>()));
    let rows = rows.collect::<Vec<_>>().join(",\n    ");
    text.set("covariance", format!("[\n    {rows},\n]"), "their covariance, up to the diagonal");
}

/// Poles in the two vectors that units have.
pub fn write_poles(text: &mut Text, prefix: &str, poles: &[nalgebra::Complex<f64>], what: &str) {
    let part = |of: fn(&nalgebra::Complex<f64>) -> f64| list(&poles.iter().map(of).collect::<Vec<_>>());
    text.set(&format!("{prefix}pole_real"), part(|pole| pole.re), what);
    text.set(&format!("{prefix}pole_imag"), part(|pole| pole.im), "rad/s, conjugates side by side");
}

/// The funnel of a law with prescribed performance.
pub fn write_funnel(text: &mut Text, references: &[f64], bandwidth: f64) {
    let parts = |part: f64| list(&references.iter().map(|size| three_digits(part * size)).collect::<Vec<_>>());
    text.set("rho_0", parts(2.0), "bound of the error at the start: it must begin inside");
    text.set("rho_inf", parts(0.1), "and in the end");
    text.set("decay_rate", all(three_digits(0.5 * bandwidth), references.len()), "1/s, how fast the bound narrows");
    text.set("on_funnel_exit", "\"reopen\"", "\"error\": a step in which the error leaves is refused");
}
