//! The text of a new active disturbance rejection controller: the nominal plant's input gain, and bandwidths that make it
//! stable.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use super::{FASTER, Ladrc, MOST_ORDER, binomial, inverse};
use crate::catalogue::Catalogued;
use crate::controllers::template::{design, input_gain, stop_time};
use crate::eigenvalues;
use crate::error::Invalid;
use crate::template::{
    Plant, Request, all, named, round_down, rows, three_digits, write_limits, write_names, write_quantities,
    write_units,
};

/// How many times the bandwidth is tried, until the nominal loop is stable.
const FACTORS: [f64; 6] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0];

/// Disturbance rejection that takes each output for a chain of integrators of its own.
pub fn write(request: &Request) -> Result<String, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let (n, gain) = input_gain(&plant, MOST_ORDER)?;
    let B_0 = gain.map(three_digits);
    let text = "A, B, C: the controls must move the outputs, or their derivatives, independently of each other";
    let B_0_inverse = inverse::inverse(&B_0).map_err(|_| Invalid::because(text))?;
    let least = design::bandwidth(&plant, request.bandwidth)?;
    let tried = FACTORS.map(|factor| three_digits(factor * least));
    let Some(omega_c) = tried.into_iter().find(|&omega_c| is_stable(&plant, n, [&B_0, &B_0_inverse], omega_c)) else {
        let [.., most] = tried;
        let reason = format!(
            "A, B, C: no such controller of {least} … {most} rad/s makes the nominal plant stable: what doesn't show in the \
             outputs must be stable by itself"
        );
        return Err(Invalid::because(reason));
    };
    let step = round_down((0.1 / (FASTER * omega_c)).min(1e-3));
    let mut text = request.begin(&Ladrc::PAGE, stop_time(omega_c), step);
    text.table("structure");
    text.set("channels", m, "outputs, each with a control of its own");
    text.set("order", n, "after how many derivatives of an output the control shows");
    text.set("feedforward", "\"none\"", "\"given\": the reference's derivatives are inputs, and it is followed closer");
    write_units(&mut text, &[("y", &plant.y, m), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("y", plant.output_quantities()), ("u", plant.u.quantities())]);
    let (r, y, u) = (named(&plant.y, "_reference"), named(&plant.y, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("y", y), ("u", u)]);
    text.table("start");
    text.set("omega_c", all(omega_c, m), "rad/s, poles of the loop; larger is faster, and moves the control more");
    text.set("omega_o", all(-1.0, m), "rad/s, poles of the observer; -1: ten times omega_c. Lower is less noise");
    text.set("B_0", rows(&B_0), "how the controls show in those derivatives of the outputs");
    write_limits(&mut text, Some(&plant), m);
    Ok(text.finish())
}

/// True if the loop with the nominal plant is.
fn is_stable(plant: &Plant, n: usize, [B_0, inverse]: [&DMatrix<f64>; 2], omega_c: f64) -> bool {
    let (states, m, _) = plant.sizes();
    let (size, omega_o) = (n + 1, FASTER * omega_c);
    let order = states + m * size;
    // u = −B_0⁻¹ (k z) of all channels.
    let mut of_z = DMatrix::zeros(m, order);
    for ch in 0..m {
        for i in 0..size {
            let k = if i < n { binomial(n, i) * omega_c.powi((n - i) as i32) } else { 1.0 };
            of_z[(ch, states + ch * size + i)] = -k;
        }
    }
    let u = inverse * &of_z;
    let mut M = DMatrix::zeros(order, order);
    M.view_mut((0, 0), (states, states)).copy_from(&plant.A);
    let driven = &plant.B * &u;
    let mut rows = M.rows_mut(0, states);
    rows += driven;
    let shown = B_0 * &u;
    for ch in 0..m {
        let first = states + ch * size;
        for i in 0..size {
            let gain = binomial(size, i + 1) * omega_o.powi(i as i32 + 1);
            M.view_mut((first + i, 0), (1, states)).copy_from(&(plant.C.row(ch) * gain));
            M[(first + i, first)] -= gain;
            if i + 1 < size {
                M[(first + i, first + i + 1)] += 1.0;
            }
        }
        let mut row = M.row_mut(first + n - 1);
        row += shown.row(ch);
    }
    let poles = eigenvalues::complex(&M);
    poles.is_some_and(|poles| poles.iter().all(|pole| pole.re < -1e-9 * pole.norm()))
}
