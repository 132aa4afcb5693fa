//! What the texts of new controllers share.

pub mod design;

use nalgebra::DMatrix;

use crate::error::Invalid;
use crate::template::{Plant, Text, all, list, round_up, rows, three_digits};

/// How long a master simulates by default: until what is that slow is over, s.
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

/// After how many derivatives of each output the controls show, the same for all, and how they do.
///
/// # Errors
/// Outputs that differ in it, or in which the controls show later.
#[allow(non_snake_case)] // matrices have the names of the field
pub fn input_gain(plant: &Plant, most: usize) -> Result<(usize, DMatrix<f64>), Invalid> {
    let Plant { A, B, C, .. } = plant;
    let degree = |i: usize| {
        let mut row = C.row(i).into_owned();
        for degree in 1..=most {
            let shown = &row * B;
            if shown.amax() > 1e-9 * row.amax() * B.amax() {
                return Ok((degree, shown));
            }
            row = &row * A;
        }
        let allowed = format!(
            "must be within 1 … {most}: the control must appear in one of the first {most} derivatives of the output"
        );
        Err(Invalid::new(format!("relative degree of output {}", i + 1), "more", allowed))
    };
    let rows = (0..C.nrows()).map(degree).collect::<Result<Vec<_>, _>>()?;
    let first = rows[0].0;
    if let Some(i) = rows.iter().position(|(degree, _)| *degree != first) {
        let name = format!("relative degree of output {}", i + 1);
        return Err(Invalid::new(name, rows[i].0, format!("must be {first}, the relative degree of output 1")));
    }
    let gain = DMatrix::from_fn(rows.len(), B.ncols(), |i, j| rows[i].1[j]);
    if !gain.norm_squared().is_finite() {
        return Err(Invalid::because("the entries of A, B and C differ by too many powers of ten"));
    }
    Ok((first, gain))
}

/// Poles in the two vectors that units have.
pub fn write_poles(text: &mut Text, prefix: &str, poles: &[nalgebra::Complex<f64>], what: &str) {
    let part = |of: fn(&nalgebra::Complex<f64>) -> f64| list(&poles.iter().map(of).collect::<Vec<_>>());
    text.set(&format!("{prefix}pole_real"), part(|pole| pole.re), what);
    text.set(&format!("{prefix}pole_imag"), part(|pole| pole.im), "rad/s, conjugates side by side");
}

/// The funnel of a law with prescribed performance.
pub fn write_funnel(text: &mut Text, reference: f64, bandwidth: f64, channels: usize) {
    text.set("rho_0", all(2.0 * reference, channels), "bound of the error at the start: it must begin inside");
    text.set("rho_inf", all(three_digits(0.1 * reference), channels), "and in the end");
    text.set("decay_rate", all(three_digits(0.5 * bandwidth), channels), "1/s, how fast the bound narrows");
    text.set("on_funnel_exit", "\"reopen\"", "\"error\": a step in which the error leaves is refused");
}
