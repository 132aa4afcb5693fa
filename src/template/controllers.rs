//! New controllers and observers.
#![allow(non_snake_case)] // matrices have the names of the field

use super::design::{self, OMEGA};
use super::plant::{Plant, Signals};
use super::signals::write_limits;
use super::text::{all, diagonal, list, number, round_down, round_up, rows, three_digits};
use super::{Request, Text, named, write_names, write_units};
use crate::error::Invalid;

/// How long a master simulates by default: until what is that slow is over, s.
fn stop_time(bandwidth: f64) -> f64 {
    round_up(20.0 / bandwidth)
}

fn write_plant(text: &mut Text, plant: &Plant, outputs: &str) {
    text.comment("Nominal plant x' = A x + B u, y = C x: rows of numbers, n x n, n x m, m x n.");
    text.set("A", rows(&plant.A), "");
    text.set("B", rows(&plant.B), "");
    text.set("C", rows(&plant.C), outputs);
}

/// Poles in the two vectors that units have.
fn write_poles(text: &mut Text, prefix: &str, poles: &[nalgebra::Complex<f64>], what: &str) {
    let part = |of: fn(&nalgebra::Complex<f64>) -> f64| list(&poles.iter().map(of).collect::<Vec<_>>());
    text.set(&format!("{prefix}pole_real"), part(|pole| pole.re), what);
    text.set(&format!("{prefix}pole_imag"), part(|pole| pole.im), "rad/s, conjugates side by side");
}

/// L1 adaptive control, also with a fuzzy feedback gain.
pub fn l1(request: &Request) -> Result<String, Invalid> {
    let plant = request.plant(true)?;
    let (n, m, _) = plant.sizes();
    let bandwidth = design::bandwidth(&plant, request.bandwidth)?;
    let design = design::design(&plant, bandwidth, request.reference)?;
    let fuzzy = request.kind == "fuzzy-l1";
    let (what, page) = if fuzzy {
        ("L1 adaptive controller with a fuzzy feedback gain", "controllers/fuzzy_l1")
    } else {
        ("L1 adaptive controller", "controllers/l1")
    };
    let mut text = request.begin(what, page, stop_time(bandwidth), design.step);
    text.table("structure");
    write_plant(&mut text, &plant, "what is to follow the reference");
    text.set("baseline", "\"outside\"", "-K_m x puts the poles of A where pole_real, pole_imag say");
    text.set("regressor", "\"state\"", "theta multiplies x; \"infinity_norm\": its largest element, fewer estimates");
    text.set("input_gain", "\"diagonal\"", "omega; \"full\" where inputs act on each other's channels");
    write_units(&mut text, &[("r", &plant.y, m), ("x", &plant.x, n), ("u", &plant.u, m)]);
    let (r, x, u) = (named(&plant.y, "_reference"), named(&plant.x, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("x", x), ("u", u)]);
    text.table("start");
    write_poles(&mut text, "", &design.poles, "1/s, poles of A_m, how the controlled plant is to move");
    text.set("feedback_gain", diagonal(design.feedback_gain, m), "1/s, K: bandwidth of the adaptive control");
    text.set("adaptation_gain", number(design.adaptation_gain), "Gamma: larger is faster, until step_too_long warns");
    text.set("omega_min", bound(OMEGA[0], m), "input gain, in parts of B, at least");
    text.set("omega_max", bound(OMEGA[1], m), "and at most");
    text.set("theta_bound", list(&design.theta_bound), "of each element of theta, which multiplies x");
    text.set("sigma_bound", list(&design.sigma_bound), "of the disturbance, in the unit of u");
    write_limits(&mut text, Some(&plant), m);
    text.set("tracking_time", all(-1.0, m), "s, u_ad follows what the limits leave; -1: 1/K, 0: off, it winds up");
    if fuzzy {
        write_fuzzy(&mut text, request.reference, bandwidth);
    }
    Ok(text.finish())
}

fn bound(value: f64, m: usize) -> String {
    all(value, m)
}

fn write_fuzzy(text: &mut Text, reference: f64, bandwidth: f64) {
    text.set("k_e", number(three_digits(0.1 * reference)), "error above which the gain is fuzzy");
    text.set("k_p", number(three_digits(1.0 / reference)), "factor of |e| in the inference: 1 is `very large`");
    text.set("k_d", number(three_digits(0.5 / (reference * bandwidth))), "s, factor of |e'| in the inference");
}

/// Robust MRAC with prescribed performance: each state follows a reference of its own.
pub fn mrac_ppf(request: &Request) -> Result<String, Invalid> {
    let Some(plant) = &request.plant else {
        request.only(&["states", "inputs"])?;
        let n = request.sizes.states.or(request.sizes.inputs).unwrap_or(2);
        let m = request.sizes.inputs.unwrap_or(n);
        if m != n {
            return Err(Invalid::new("--inputs", m, format!("must be {n}: each state needs a control of its own")));
        }
        let plant = Plant::integrators(n, n, n)?;
        return write_mrac(request, &plant);
    };
    write_mrac(request, plant)
}

fn write_mrac(request: &Request, plant: &Plant) -> Result<String, Invalid> {
    let (n, m, _) = plant.sizes();
    let bandwidth = design::bandwidth(plant, request.bandwidth)?;
    let what = "Robust MRAC with prescribed performance";
    let step = round_down((0.01 / bandwidth).min(1e-3));
    let mut text = request.begin(what, "controllers/mrac_ppf", stop_time(bandwidth), step);
    text.table("structure");
    text.comment(
        "Nominal plant x' = A x + B u: rows of numbers; B has the rank of its rows, so that each state is controlled.",
    );
    text.set("A", rows(&plant.A), "");
    text.set("B", rows(&plant.B), "");
    write_units(&mut text, &[("x", &plant.x, n), ("u", &plant.u, m)]);
    let (r, x, u) = (named(&plant.x, "_reference"), named(&plant.x, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("x", x), ("u", u)]);
    text.table("start");
    text.set("A_m", diagonal(-bandwidth, n), "1/s, reference model x_m' = A_m (x_m - r)");
    text.set("x_m0", all(0.0, n), "its state at the start; best where the plant is");
    write_funnel(&mut text, request.reference, bandwidth, n);
    text.set("gamma_1", all(5e4, n), "adaptation gain of theta_hat");
    text.set("gamma_2", all(5e4, n), "adaptation gain of sigma_hat");
    text.set("K_epsilon", all(0.1, n), "gain of the transformed error");
    text.set("alpha_bar", all(10.0, n), "gain of its smoothed sign");
    write_limits(&mut text, Some(plant), m);
    Ok(text.finish())
}

fn write_funnel(text: &mut Text, reference: f64, bandwidth: f64, channels: usize) {
    text.set("rho_0", all(2.0 * reference, channels), "bound of the error at the start: it must begin inside");
    text.set("rho_inf", all(three_digits(0.1 * reference), channels), "and in the end");
    text.set("decay_rate", all(three_digits(0.5 * bandwidth), channels), "1/s, how fast the bound narrows");
    text.set("on_funnel_exit", "\"reopen\"", "\"error\": a step in which the error leaves is refused");
}

/// Neuro-adaptive control with prescribed performance: it needs sizes, and no model.
pub fn neuro_ppf(request: &Request) -> Result<String, Invalid> {
    request.only(&["states", "inputs"])?;
    let (m, n, u, x) = match &request.plant {
        Some(plant) => (plant.sizes().1, plant.sizes().0, plant.u.clone(), plant.x.clone()),
        None => {
            let m = request.sizes.inputs.unwrap_or(1);
            (m, request.sizes.states.unwrap_or(2 * m), Signals::default(), Signals::default())
        }
    };
    let degree = n / m;
    if n % m != 0 || !(1..=2).contains(&degree) {
        let allowed = format!("must be {m} or {}: the tracked variables, or they and their rates", 2 * m);
        return Err(Invalid::new("states", n, allowed));
    }
    let what = "Neuro-adaptive controller with prescribed performance";
    let mut text = request.begin(what, "controllers/neuro_ppf", 10.0, 1e-4);
    text.table("structure");
    text.set("relative_degree", degree, "after how many derivatives of a tracked variable the control shows: 1 or 2");
    text.set("channels", m, "tracked variables, each with a control of its own");
    text.set("input_gain_network", "false", "true: the input gain is estimated, too");
    text.set("network", "{ rule = \"quasi_random\", neurons = 30 }", "sigmoid neurons over the state");
    let tracked = |list: &[String]| list.iter().take(m).cloned().collect::<Vec<_>>();
    let r = Signals { names: tracked(&x.names), units: tracked(&x.units) };
    write_units(&mut text, &[("r", &r, m), ("u", &u, m)]);
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

/// A robust adaptive observer, at first with its nominal part alone.
pub fn observer(request: &Request) -> Result<String, Invalid> {
    let plant = request.plant(true)?;
    let (n, m, _) = plant.sizes();
    let bandwidth = design::bandwidth(&plant, request.bandwidth)?;
    // Four times as fast as a controller of that bandwidth.
    let poles = design::poles(&plant.A.transpose(), &plant.C.transpose(), 4.0 * bandwidth).map_err(|_| {
        Invalid::because("A, C: every state must show in the output (A, C observable), through rows of C that differ")
    })?;
    let fastest = poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    let step = round_down((0.1 / fastest).min(1e-3));
    let mut text = request.begin("Robust adaptive observer", "controllers/observer", stop_time(bandwidth), step);
    text.table("structure");
    write_plant(&mut text, &plant, "what is measured");
    text.set("observer_dynamics", "\"poles\"", "\"gain\": observer_gain is given in place of poles");
    write_units(&mut text, &[("x", &plant.x, n), ("y", &plant.y, m), ("u", &plant.u, m)]);
    let (x, y, u) = (named(&plant.x, "_estimate"), named(&plant.y, ""), named(&plant.u, ""));
    write_names(&mut text, &[("x_obs", x), ("y", y), ("u", u)]);
    text.table("start");
    write_poles(&mut text, "observer_", &poles, "1/s, poles of A - k_l C: faster than the controller's");
    text.set("known_input", "true", "whether it makes use of the plant's input u");
    text.comment("The adaptive part is off (0): it is made for signals about 1, and grows with the fourth power of y.");
    text.set("beta0", "0.0", "initial gain of the robust term");
    text.set("Gamma_l", "0.0", "1/s, its adaptation gain, as 10.0");
    text.set("sigma_l", "1e-4", "its leakage");
    text.set("unmodeled_gain", "0.0", "1/s, from |y|^4 to the bound on unmodeled dynamics, as 1.0");
    text.set("x_obs0", all(0.0, n), "estimate at the start");
    Ok(text.finish())
}
