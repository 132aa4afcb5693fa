//! The text of a new MRAC.
#![allow(non_snake_case)] // W and R have the names of the field

use nalgebra::DMatrix;

use super::MracPpf;
use crate::catalogue::Catalogued;
use crate::controllers::template::{require_no_delay, stop_time, write_funnel, write_nominal_with};
use crate::error::Invalid;
use crate::report::no_less;
use crate::template::{
    Begun, Plant, Request, Values, all, counted, diagonal, list, named, round_down, rows, three_digits, write_limits,
    write_magnitudes, write_names, write_quantities, write_units,
};

/// Communication step, in 1/W.
const STEP: f64 = 1e-3;

/// Robust MRAC with prescribed performance: each state follows a reference of its own.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let Some(plant) = &request.plant else {
        request.only(&["states", "inputs"])?;
        let n = request.sizes.states.or(request.sizes.inputs).unwrap_or(2);
        let m = request.sizes.inputs.unwrap_or(n);
        if m != n {
            return Err(Invalid::new(
                "--inputs",
                m,
                format!("must be {n}, the number of states: each state needs its own control"),
            ));
        }
        let plant = Plant::integrators(n, n, n)?;
        return write_for(request, &plant);
    };
    write_for(request, plant)
}

/// Leakage of θ̂.
const LEAKAGE: f64 = 0.05;
/// Bound of θ̂: at least so many times W, and so many times the largest entry of A − A_m in a row.
const LEAST_BOUND: f64 = 2.0;
const OF_DIFFERENCE: f64 = 2.0;

/// The bounds of θ̂, rounded up to two digits, for A_m = −bandwidth I.
fn bounds(plant: &Plant, bandwidth: f64) -> Vec<f64> {
    let entry = |i: usize, j: usize| (plant.A[(i, j)] + if i == j { bandwidth } else { 0.0 }).abs();
    let n = plant.A.nrows();
    let largest = |i: usize| (0..n).map(|j| entry(i, j)).fold(0.0, f64::max);
    (0..n).map(|i| no_less((LEAST_BOUND * bandwidth).max(OF_DIFFERENCE * largest(i)), 2)).collect()
}

fn write_for(request: &Request, plant: &Plant) -> Result<Begun, Invalid> {
    let (n, m, _) = plant.sizes();
    if n != m {
        return Err(Invalid::because(format!(
            "this controller needs an input for each state: the plant has {} and {}. `new mrac-ppf-unmatched` or `new l1` may find a \
             controller",
            counted(n, "state"),
            counted(m, "input")
        )));
    }
    require_no_delay(plant)?;
    let bandwidth = request.speed(plant)?;
    let (references, W) = (request.references(n)?, bandwidth);
    let step = round_down(STEP / W);
    let mut text = request.begin(&MracPpf::PAGE, stop_time(bandwidth), step);
    text.table("structure");
    text.comment(
        "Nominal plant x' = A x + B u: rows of numbers; B has the rank of its rows, so that each state is controlled.",
    );
    text.set("A", rows(&plant.A), "");
    text.set("B", rows(&plant.B), "");
    write_units(&mut text, &[("x", &plant.x, n), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("x", plant.x.quantities()), ("u", plant.u.quantities())]);
    let (r, x, u) = (named(&plant.x, "_reference"), named(&plant.x, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("x", x), ("u", u)]);
    text.table("start");
    text.set("A_m", diagonal(-bandwidth, n), "1/s, reference model x_m' = A_m (x_m - r)");
    text.set("x_m0", all(0.0, n), "its state at the start; best where the plant is");
    write_funnel(&mut text, &references, bandwidth);
    // The thesis' numbers are for a plant and errors of about 1, in s: these do the same in any unit and at any speed.
    let largest = references.iter().copied().fold(0.0, f64::max);
    let each =
        |value: &dyn Fn(f64) -> f64| list(&references.iter().map(|&R| three_digits(value(R))).collect::<Vec<_>>());
    text.set("gamma_1", each(&|R| 5e4 * (W * R / largest).powi(2)), "adaptation gain of theta_hat");
    text.set("theta_bound", list(&bounds(plant, W)), "bound of theta_hat: how far the plant may be from A");
    text.set(
        "theta_leakage",
        each(&|R| LEAKAGE * largest * largest / (W * R)),
        "so that noise doesn't drive theta_hat",
    );
    text.set("gamma_2", each(&|R| 5e4 * (W * R).powi(2)), "adaptation gain of sigma_hat");
    text.set("beta", each(&|R| 2.0 / (W * R)), "its proportional part");
    text.set("upsilon", each(&|R| 0.05 / (W * R)), "its leakage");
    text.set("K_epsilon", each(&|R| 0.1 * W * R), "gain of the transformed error");
    text.set("alpha_bar", each(&|R| 10.0 * W * R), "gain of its smoothed sign");
    write_limits(&mut text, Some(plant), m);
    let states = DMatrix::identity(n, n);
    let of_states = request.plant.as_ref().map(|plant| Plant { C: states.clone(), ..plant.clone() });
    write_magnitudes(&mut text, of_states.as_ref(), (&references, W), |of| {
        let theta = Values::Rows(DMatrix::from_element(n, n, W));
        let sigma = Values::Rows(DMatrix::from_fn(n, n, |i, _| W * references[i]));
        vec![("x_m", (&of.x).into()), ("theta_hat", theta), ("sigma_integral", sigma), ("u", (&of.u).into())]
    });
    write_nominal_with(&mut text, &states, request, bandwidth, &request.uncertainty());
    Ok(text.finish())
}
