//! New references, sensors, actuators and linear plants.
#![allow(non_snake_case)] // matrices have the names of the field

use super::plant::Signals;
use super::text::{all, list, rows, texts};
use super::{Request, Text, named, write_names, write_units};
use crate::error::Invalid;

/// Number of channels, and their signals where a plant has them.
fn channels(request: &Request, size: Option<usize>, of: fn(&super::Plant) -> &Signals) -> (usize, Signals) {
    let own = request.plant.as_ref().map(|plant| (plant.sizes(), of(plant).clone()));
    let Some(((n, m, p), signals)) = own else { return (size.unwrap_or(1), Signals::default()) };
    let len = match request.kind {
        "sensor" => n,
        "actuator" => m,
        _ => p,
    };
    (len, signals)
}

fn write_channels(text: &mut Text, m: usize, signals: &Signals) {
    text.table("structure");
    text.set("channels", m, "how many");
    if signals.units.is_empty() {
        text.suggest("units", texts(&vec!["rad/s".to_owned(); m]), "of the channels; 1 where none are given");
    } else {
        text.set("units", texts(&signals.units), "of the channels");
    }
}

/// Each channel steps to the usual magnitude at 1 s.
pub fn reference(request: &Request) -> Result<String, Invalid> {
    request.only(&["outputs"])?;
    let (m, signals) = channels(request, request.sizes.outputs, |plant| &plant.y);
    let mut text = request.begin("Reference signal", "plants/reference", 10.0, 1e-3);
    write_channels(&mut text, m, &signals);
    write_names(&mut text, &[("r", named(&signals, "_reference"))]);
    text.table("start");
    text.comment("r = s(t) (offset + slope t + cosine + sine + square) + steps; what isn't set is 0.");
    let height = request.reference;
    for i in 1..=m {
        text.set(&format!("\"step_time[{i},1]\""), "1.0", "s, when the first of four steps is taken");
        text.set(&format!("\"step_height[{i},1]\""), super::number(height), "its height");
    }
    text.suggest("offset", all(0.0, m), "constant part");
    text.suggest("sine_amplitude", all(height, m), "with sine_frequency (rad/s) and sine_phase (rad)");
    text.suggest("square_amplitude", all(height, m), "with square_frequency (Hz) and square_phase (rad)");
    text.suggest("smooth_start_rate", all(1.0, m), "1/s, rate of the smooth start s(t); 0 is none");
    Ok(text.finish())
}

/// A sensor without any effect, until it is set.
pub fn sensor(request: &Request) -> Result<String, Invalid> {
    request.only(&["outputs"])?;
    let (m, signals) = channels(request, request.sizes.outputs, |plant| &plant.x);
    let mut text = request.begin("Sensor", "plants/sensor", 10.0, 1e-3);
    write_channels(&mut text, m, &signals);
    write_names(&mut text, &[("y", named(&signals, "_measured")), ("u", named(&signals, ""))]);
    text.table("start");
    text.set("time_constant", all(0.0, m), "s, lag; 0 is none");
    text.set("noise_deviation", all(0.0, m), "standard deviation of the noise; 0 is none");
    text.set("resolution", all(0.0, m), "step between values that can be told apart; 0 is none");
    text.set("bias", all(0.0, m), "constant error");
    text.set("delay", all(0.0, m), "s, a multiple of sample_time");
    text.set("sample_time", "0.001", "s, of noise, delay and resolution");
    text.set("seed", "1", "which noise it is");
    Ok(text.finish())
}

/// An actuator with the plant's limits, or without any.
pub fn actuator(request: &Request) -> Result<String, Invalid> {
    request.only(&["inputs"])?;
    let (m, signals) = channels(request, request.sizes.inputs, |plant| &plant.u);
    let mut text = request.begin("Actuator", "plants/actuator", 10.0, 1e-3);
    write_channels(&mut text, m, &signals);
    write_names(&mut text, &[("u", named(&signals, "_command")), ("y", named(&signals, ""))]);
    text.table("start");
    write_limits(&mut text, request.plant.as_ref(), m);
    text.set("rate_limit", all(1e15, m), "fastest change of the output, its unit a second; 1e15 is no limit");
    text.set("time_constant", all(0.0, m), "s, lag; 0 is none");
    text.set("dead_zone", all(0.0, m), "commands up to this magnitude do nothing");
    text.set("delay", all(0.0, m), "s, a multiple of sample_time");
    text.set("sample_time", "0.001", "s, of the delay");
    Ok(text.finish())
}

/// Limits of a control, those of the plant where it has any.
pub fn write_limits(text: &mut Text, plant: Option<&super::Plant>, m: usize) {
    let own = plant.and_then(|plant| plant.limits.clone());
    let [min, max] = own.unwrap_or_else(|| [vec![-1e15; m], vec![1e15; m]]);
    text.set("u_min", list(&min), "smallest control that acts; -1e15 is no limit");
    text.set("u_max", list(&max), "largest control that acts; 1e15 is no limit");
}

/// A linear plant.
pub fn state_space(request: &Request) -> Result<String, Invalid> {
    let plant = request.plant(false)?;
    let (n, m, p) = plant.sizes();
    let mut text = request.begin("Linear plant", "plants/state_space", 10.0, 1e-3);
    text.table("structure");
    text.comment("x' = A x + B (u + d), y = C x + D u: rows of numbers. A model with other numbers is set at [start].");
    text.set("A", rows(&plant.A), "");
    text.set("B", rows(&plant.B), "");
    text.set("C", rows(&plant.C), "");
    match &plant.D {
        Some(D) => text.set("D", rows(D), ""),
        None => text.suggest("D", rows(&nalgebra::DMatrix::zeros(p, m)), "only where the input shows in y at once"),
    }
    write_units(&mut text, &[("x", &plant.x, n), ("u", &plant.u, m), ("y", &plant.y, p)]);
    // An output that is a state can't have its name.
    let clash = plant.y.names.iter().any(|name| plant.x.names.contains(name));
    let outputs = named(&plant.y, if clash { "_output" } else { "" });
    write_names(&mut text, &[("x", named(&plant.x, "")), ("u", named(&plant.u, "")), ("y", outputs)]);
    text.table("start");
    text.set("x0", all(0.0, n), "state at the start");
    write_limits(&mut text, Some(&plant), m);
    text.suggest("x_op", all(0.0, n), "operating point about which A, B, C, D hold; also u_op, y_op");
    Ok(text.finish())
}
