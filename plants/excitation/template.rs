//! The description of an experiment, for a plant that settles in some time.

use super::Excitation;
use crate::catalogue::Catalogued;
use crate::error::{Invalid, Number};
use crate::system::NO_LIMIT;
use crate::template::{
    Begun, Experiment, Plant, Request, Text, USUAL_BANDWIDTH, as_written, counted, list, named, number, quoted,
    references, round_down, three_digits, write_names,
};

use super::super::template::{channels, write_channels};

/// The longest level in parts of the settling time: 1.6/W for the bandwidth W = 4/settling time.
const LONGEST_LEVEL: f64 = 0.4;
/// Settling times that a record should have.
const SETTLING_TIMES: f64 = 10.0;
/// Numbers that a record should have for each unknown.
const NUMBERS: f64 = 40.0;
/// Steps of a settling time where no step is given.
const STEPS: f64 = 200.0;
/// States of a plant that is not known.
const USUAL_STATES: usize = 4;

/// Times of an experiment, s.
struct Times {
    settling: f64,
    step: f64,
    /// Advised length, a multiple of the step.
    length: f64,
    /// States that the length is for, and true if their number is assumed.
    states: usize,
    is_assumed: bool,
}

/// Signals for each input of a plant.
pub fn template(request: &Request) -> Result<Begun, Invalid> {
    request.only(&["inputs", "states"])?;
    let usual = Experiment::default();
    let asked = request.experiment.unwrap_or(&usual);
    let (m, mut signals) = channels(request, request.sizes.inputs, |plant| (plant.sizes().1, &plant.u));
    if request.plant.is_none() {
        // No unit fits each plant.
        (signals.names, signals.units) = (asked.names.to_vec(), vec![String::new(); m]);
    }
    let times = times(request, asked, m)?;
    let [amplitudes, points] = [("--amplitude", asked.amplitude), ("--operating-point", asked.operating_point)]
        .map(|(option, given)| numbers(option, given, m));
    let (amplitudes, points) = (amplitudes?, points?);
    if let Some(wrong) = amplitudes.iter().find(|amplitude| **amplitude <= 0.0) {
        return Err(Invalid::new("--amplitude", Number(*wrong), "must be above 0"));
    }
    let mut text = request.begin(&Excitation::PAGE, times.length, times.step);
    write_channels(&mut text, m, &signals);
    write_signal(&mut text, asked, &times, m)?;
    write_names(&mut text, &[("u", named(&signals, "")), ("command", named(&signals, "_command"))]);
    text.table("start");
    text.set("amplitude", list(&amplitudes), "largest deviation from command and offset");
    text.set("offset", list(&points), "operating point of the experiment");
    if asked.signal == "levels" {
        text.set("seed", asked.seed, "selects the levels");
    }
    write_advice(&mut text, request, &times, (m, &amplitudes, &points));
    Ok(text.finish())
}

/// One number for all inputs, or one for each.
fn numbers(option: &str, given: &[f64], m: usize) -> Result<Vec<f64>, Invalid> {
    references(given, m).map_err(|_| {
        let given = given.iter().copied().map(number).collect::<Vec<_>>().join(", ");
        Invalid::new(option, given, format!("must be one number, or {m}, one for each input"))
    })
}

fn times(request: &Request, asked: &Experiment, m: usize) -> Result<Times, Invalid> {
    let settling = settling_time(request, asked)?;
    if settling <= 0.0 {
        return Err(Invalid::new("--settling-time", Number(settling), "must be above 0, in s"));
    }
    let step = asked.step.unwrap_or_else(|| round_down(settling / STEPS * (1.0 + 1e-9)));
    let longest = settling * LONGEST_LEVEL / super::SHORTEST_LEVEL;
    if step > longest {
        let allowed = format!(
            "must be at most {} s: a level of 0.4 settling times has two steps at least",
            crate::report::at_most(longest)
        );
        return Err(Invalid::new("--step", Number(step), allowed));
    }
    let known = request.plant.as_ref().map(|plant| plant.sizes().0).or(request.sizes.states);
    let states = known.unwrap_or(USUAL_STATES);
    // p/n = n + m unknowns of A and B for each of the n numbers of a row.
    let counted = NUMBERS * (states + m) as f64 * step;
    let length = (SETTLING_TIMES * settling).max(counted);
    let steps = (length / step * (1.0 - 1e-9)).ceil();
    // A whole number of steps such as 0.01 has few digits, which a product in binary has not.
    let length = as_written(steps * step);
    Ok(Times { settling, step, length, states, is_assumed: known.is_none() })
}

/// The settling time: that of the request, or that of its bandwidth, or of the plant's slowest pole.
fn settling_time(request: &Request, asked: &Experiment) -> Result<f64, Invalid> {
    let of_plant = |plant: &Plant| request.speed(plant).map(|speed| 8.0 / speed);
    match (asked.settling_time, request.bandwidth, &request.plant) {
        (Some(settling), ..) => Ok(settling),
        (None, Some(bandwidth), _) => Ok(4.0 / bandwidth),
        (None, None, Some(plant)) => of_plant(plant).map(three_digits),
        (None, None, None) => Ok(4.0 / USUAL_BANDWIDTH),
    }
}

fn write_signal(text: &mut Text, asked: &Experiment, times: &Times, m: usize) -> Result<(), Invalid> {
    text.set("signal", quoted(asked.signal), "levels, multisine or chirp");
    text.set("sample_time", number(times.step), "s, step of the signal, which is constant in between");
    if asked.signal == "levels" {
        if let Some(up_to) = asked.up_to {
            return Err(Invalid::new(
                "--up-to",
                Number(up_to),
                "is for multisine and chirp; levels contain all frequencies",
            ));
        }
        let longest = three_digits(times.settling * LONGEST_LEVEL);
        text.set("longest_level", number(longest), "s, 0.4 settling times; the shortest is two steps");
        return Ok(());
    }
    let least = if asked.signal == "chirp" { 1 } else { m };
    let (lowest, highest) = (std::f64::consts::TAU * least as f64 / times.length, std::f64::consts::PI / times.step);
    let [low, high] = [crate::report::at_least(lowest), crate::report::at_most(highest)];
    let allowed = format!("{low} … {high} rad/s");
    let Some(up_to) = asked.up_to else {
        return Err(Invalid::because(format!(
            "--up-to is missing: give the highest frequency of the signal within {allowed}, about three times the fastest pole \
             that the record is to show"
        )));
    };
    if !(up_to > lowest && up_to <= highest) {
        let allowed = format!("must be within {allowed}: from 1/length to half a turn a step");
        return Err(Invalid::new("--up-to", Number(up_to), allowed));
    }
    text.set("period", number(times.length), "s, after which the signal repeats");
    text.set("highest_frequency", number(up_to), "rad/s; the lowest is 1/period");
    Ok(())
}

/// How long the experiment should be, and whether it goes beyond what the plant takes.
fn write_advice(text: &mut Text, request: &Request, times: &Times, (m, amplitudes, points): (usize, &[f64], &[f64])) {
    let [settling, step, length] = [times.settling, times.step, times.length].map(crate::report::number);
    let is_slow = times.length <= SETTLING_TIMES * times.settling * (1.0 + 1e-9);
    let why = if is_slow {
        format!("10 settling times of {settling} s")
    } else {
        let assumed = if times.is_assumed { " (assumed: give --states)" } else { "" };
        let (n, unknowns) = (counted(times.states, "state"), times.states * (times.states + m));
        format!("40 numbers for each of {unknowns} unknowns of a plant with {n}{assumed}, at steps of {step} s")
    };
    text.note(&format!("Advised length of the experiment: {length} s ({why}). After that the signal goes on."));
    let Some([min, max]) = request.plant.as_ref().and_then(|plant| plant.limits.as_ref()) else { return };
    for i in 0..m {
        let (low, high) = (points[i] - amplitudes[i], points[i] + amplitudes[i]);
        let is_beyond = low < min[i] && min[i] > -NO_LIMIT || high > max[i] && max[i] < NO_LIMIT;
        if is_beyond {
            let of = request.plant.as_ref().and_then(|plant| plant.u.names.get(i).cloned());
            text.note(&format!(
                "{} goes from {} to {}, beyond the plant's limits {} … {}: the record would show what was asked for, not what acted.",
                of.unwrap_or_else(|| format!("u[{}]", i + 1)),
                crate::report::number(low),
                crate::report::number(high),
                crate::report::number(min[i]),
                crate::report::number(max[i])
            ));
        }
    }
}
