//! The text of a new neuro-adaptive controller.
#![allow(non_snake_case)] // W and R have the names of the field

use nalgebra::DMatrix;

use super::NeuroPpf;
use crate::catalogue::Catalogued;
use crate::controllers::template::{require_no_delay, stop_time, write_funnel, write_nominal_with};
use crate::error::Invalid;
use crate::template::{
    Begun, Plant, Request, Signals, USUAL_BANDWIDTH, Values, all, counted, diagonal, named, number, round_down,
    three_digits, write_limits, write_magnitudes, write_names, write_quantities, write_units,
};

/// Communication step, in 1/W.
const STEP: f64 = 2e-4;
/// Number of neurons.
const NEURONS: usize = 30;

/// Neuro-adaptive control with prescribed performance: it needs sizes, and no model.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    request.only(&["states", "inputs"])?;
    let (m, n, u, x) = match &request.plant {
        Some(plant) => (plant.sizes().1, plant.sizes().0, plant.u.clone(), plant.x.clone()),
        None => {
            let m = request.sizes.inputs.unwrap_or(1);
            (m, request.sizes.states.unwrap_or(2 * m), Signals::default(), Signals::default())
        }
    };
    let degree = n / m;
    let needed = |found: String| {
        Invalid::because(format!(
            "this controller needs an input for each state, or for each coordinate with its rate among the states: {found}. Choose others \
             by --states and --inputs, or take `new l1`"
        ))
    };
    if n % m != 0 || !(1..=2).contains(&degree) {
        return Err(needed(format!("there are {} and {}", counted(n, "state"), counted(m, "input"))));
    }
    if let Some(i) = request.plant.as_ref().filter(|_| degree == 2).and_then(|plant| without_rate(plant, m)) {
        return Err(needed(format!("state {} isn't the rate of state {}", m + i + 1, i + 1)));
    }
    let (W, gain) = match &request.plant {
        Some(plant) => {
            require_no_delay(plant)?;
            (request.speed(plant)?, input_gain(plant, m, degree)?)
        }
        None => (request.bandwidth.unwrap_or(USUAL_BANDWIDTH), 1.0),
    };
    let references = request.references(m)?;
    let mut text = request.begin(&NeuroPpf::PAGE, stop_time(W), round_down(STEP / W));
    text.table("structure");
    text.set("relative_degree", degree, "after how many derivatives of a tracked variable the control shows: 1 or 2");
    text.set("channels", m, "tracked variables, each with a control of its own");
    text.set("input_gain_network", "false", "true: the input gain is estimated, too");
    text.set(
        "network",
        format!("{{ rule = \"quasi_random\", neurons = {NEURONS} }}"),
        "sigmoid neurons over the state",
    );
    let tracked = |list: &[String]| list.iter().take(m).cloned().collect::<Vec<_>>();
    let r = Signals { names: tracked(&x.names), units: tracked(&x.units), texts: tracked(&x.texts) };
    write_units(&mut text, &[("r", &r, m), ("u", &u, m)]);
    write_quantities(&mut text, &[("r", r.quantities()), ("u", u.quantities())]);
    write_names(&mut text, &[("r", named(&r, "_reference")), ("x", named(&x, "")), ("u", named(&u, ""))]);
    text.table("start");
    write_funnel(&mut text, &references, W);
    if degree == 1 {
        text.set("A_m", diagonal(-W, m), "1/s, reference model x_m' = A_m (x_m - r)");
    } else {
        text.set("lambda", all(three_digits(0.5 * W), m), "1/s, weight of the error relative to its rate");
    }
    // Numbers that do the same in any unit and at any speed.
    let size = references.iter().copied().fold(f64::INFINITY, f64::min);
    let robust = 0.2 * (USUAL_BANDWIDTH / W).powi(2 * degree as i32 - 1) / gain;
    let learning = 0.025 * (size * W).powi(2);
    let of = |value: f64| number(three_digits(value));
    text.set("k", of(0.5 * W), "1/s, gain of the filtered error");
    text.set("n_f", of(0.1 * size * size * W), "gain of the robust term for the estimate of the dynamics");
    text.set("eta_Gb", of(robust), "gain of the robust term for the control");
    text.set("network_gain", of(learning), "adaptation gain of the networks");
    text.set("sigma", of(0.375 * W / learning), "leakage of the networks' weights");
    write_limits(&mut text, request.plant.as_ref(), m);
    let tracked = DMatrix::identity(m, n);
    let of_tracked = request.plant.as_ref().map(|plant| Plant { C: tracked.clone(), ..plant.clone() });
    write_magnitudes(&mut text, of_tracked.as_ref(), (&references, W), |of| {
        let weights = DMatrix::from_fn(NEURONS, m, |_, j| W.powi(degree as i32) * references[j]);
        let known = [("theta_f", Values::Rows(weights)), ("u", (&of.u).into())];
        // The reference itself is the model of a second-order variable.
        known.into_iter().chain((degree == 1).then(|| ("x_m", (&of.x).into()))).collect()
    });
    write_nominal_with(&mut text, &tracked, request, W, &request.uncertainty());
    Ok(text.finish())
}

/// The least input gain in any direction: the control has its sign from the error only.
fn input_gain(plant: &Plant, m: usize, degree: usize) -> Result<f64, Invalid> {
    let gain = plant.B.rows(m * (degree - 1), m);
    let least = ((gain + gain.transpose()) * 0.5).symmetric_eigenvalues().min();
    if least > 1e-6 * gain.amax() {
        return Ok(least);
    }
    Err(Invalid::because(
        "B: this controller needs an input gain B_2 with B_2 + B_2ᵀ positive definite, where B_2 are the rows of B that the controls enter: \
         each control must move its own state most, and upwards. Choose the order and the sign of the inputs so, or take `new l1`",
    ))
}

/// A coordinate of the first half of the states whose rate isn't the state of the second half at its place.
fn without_rate(plant: &Plant, m: usize) -> Option<usize> {
    let is_rate = |i: usize| {
        let row = plant.A.row(i).iter().enumerate().all(|(j, &entry)| entry == if j == m + i { 1.0 } else { 0.0 });
        row && plant.B.row(i).iter().all(|&entry| entry == 0.0)
    };
    (0..m).find(|&i| !is_rate(i))
}
