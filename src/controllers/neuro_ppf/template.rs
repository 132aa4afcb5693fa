//! The text of a new neuro-adaptive controller.

use super::NeuroPpf;
use crate::catalogue::Catalogued;
use crate::controllers::template::write_funnel;
use crate::error::Invalid;
use crate::template::{
    Begun, Plant, Request, Signals, all, counted, diagonal, named, three_digits, write_limits, write_names,
    write_quantities, write_units,
};

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
            "this law needs an input for each state, or for each coordinate with its rate among the states: {found}. Choose others \
             by --states and --inputs, or take `new l1`"
        ))
    };
    if n % m != 0 || !(1..=2).contains(&degree) {
        return Err(needed(format!("there are {} and {}", counted(n, "state"), counted(m, "input"))));
    }
    if let Some(i) = request.plant.as_ref().filter(|_| degree == 2).and_then(|plant| without_rate(plant, m)) {
        return Err(needed(format!("state {} isn't the rate of state {}", m + i + 1, i + 1)));
    }
    let mut text = request.begin(&NeuroPpf::PAGE, 10.0, 1e-4);
    text.table("structure");
    text.set("relative_degree", degree, "after how many derivatives of a tracked variable the control shows: 1 or 2");
    text.set("channels", m, "tracked variables, each with a control of its own");
    text.set("input_gain_network", "false", "true: the input gain is estimated, too");
    text.set("network", "{ rule = \"quasi_random\", neurons = 30 }", "sigmoid neurons over the state");
    let tracked = |list: &[String]| list.iter().take(m).cloned().collect::<Vec<_>>();
    let r = Signals { names: tracked(&x.names), units: tracked(&x.units), texts: tracked(&x.texts) };
    write_units(&mut text, &[("r", &r, m), ("u", &u, m)]);
    write_quantities(&mut text, &[("r", r.quantities()), ("u", u.quantities())]);
    write_names(&mut text, &[("r", named(&r, "_reference")), ("x", named(&x, "")), ("u", named(&u, ""))]);
    text.table("start");
    let bandwidth = request.bandwidth.unwrap_or(2.0);
    write_funnel(&mut text, request.reference, bandwidth, m);
    if degree == 1 {
        text.set("A_m", diagonal(-bandwidth, m), "1/s, reference model x_m' = A_m (x_m - r)");
    } else {
        text.set("lambda", all(three_digits(0.5 * bandwidth), m), "1/s, weight of the error beside its rate");
    }
    text.set("k", "1.0", "1/s, gain of the filtered error");
    text.set("n_f", "0.2", "gain of the robust term for the estimate of the dynamics");
    text.set("eta_Gb", "0.2", "gain of the robust term for the control");
    text.set("network_gain", "0.1", "adaptation gain of the networks");
    text.set("sigma", "7.5", "leakage of the networks' weights");
    write_limits(&mut text, request.plant.as_ref(), m);
    Ok(text.finish())
}

/// A coordinate of the first half of the states whose rate isn't the state of the second half at its place.
fn without_rate(plant: &Plant, m: usize) -> Option<usize> {
    let is_rate = |i: usize| {
        let row = plant.A.row(i).iter().enumerate().all(|(j, &entry)| entry == if j == m + i { 1.0 } else { 0.0 });
        row && plant.B.row(i).iter().all(|&entry| entry == 0.0)
    };
    (0..m).find(|&i| !is_rate(i))
}
