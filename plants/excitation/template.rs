//! The description of an experiment, for a plant that settles in some time.

use std::f64::consts::{PI, TAU};

use super::Excitation;
use super::signal::{MOST_SAMPLES, MOST_TERMS, SAMPLE_TIMES, of_level};
use crate::catalogue::Catalogued;
use crate::error::{Invalid, Number};
use crate::report::{at_least, at_most, no_more};
use crate::system::NO_LIMIT;
use crate::template::{
    Begun, Experiment, Request, Text, USUAL_BANDWIDTH, as_written, counted, list, named, number, quoted, references,
    round_down, three_digits, write_names,
};

use super::super::template::{channels, write_channels};

/// The longest level in parts of the settling time: 1.6/W for the bandwidth W = 4/settling time.
const LONGEST_LEVEL: f64 = 0.4;
/// Settling times that a record should have.
const SETTLING_TIMES: f64 = 10.0;
/// Numbers that a record should have for each unknown.
const NUMBERS: f64 = 40.0;
/// Steps of a settling time where no step is given, and of the time 1/|p| of the plant's fastest pole p.
const STEPS: f64 = 200.0;
const STEPS_OF_FASTEST: f64 = 5.0;
/// The highest frequency in parts of the fastest pole, where none is given.
const BEYOND_FASTEST: f64 = 3.0;
/// Poles are at 0, or on the imaginary axis, up to this part of the fastest.
const ROUNDING: f64 = 1e-6;
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
    /// True if the step is too long for the plant's fastest pole.
    is_coarse: bool,
    poles: Poles,
}

/// Poles of the plant, where one is known.
struct Poles {
    /// The largest magnitude, rad/s.
    fastest: f64,
    /// The largest real part, 1/s, where it is beyond rounding.
    unstable: Option<f64>,
    /// True if one of them is at 0, within rounding.
    integrates: bool,
}

impl Poles {
    fn of(request: &Request) -> Self {
        // The settling time needs them, and reports if they can't be found.
        let poles = request.plant.as_ref().and_then(|plant| plant.poles().ok()).unwrap_or_default();
        let fastest = poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
        let real = poles.iter().map(|pole| pole.re).fold(0.0, f64::max);
        let integrates = poles.iter().any(|pole| pole.norm() <= ROUNDING * fastest);
        Poles { fastest, unstable: Some(real).filter(|real| *real > ROUNDING * fastest), integrates }
    }

    /// The longest step that shows all of them, s.
    fn step(&self) -> f64 {
        (STEPS_OF_FASTEST * self.fastest).recip()
    }
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
    let poles = Poles::of(request);
    let settling = settling_time(request, asked, &poles)?;
    if settling <= 0.0 {
        return Err(Invalid::new("--settling-time", Number(settling), "must be above 0, in s"));
    }
    let known = request.plant.as_ref().map(|plant| plant.sizes().0).or(request.sizes.states);
    let states = known.unwrap_or(USUAL_STATES);
    // A whole number of steps such as 0.01 has few digits, which a product in binary has not.
    let length = |step: f64| {
        // p/n = n + m unknowns of A and B for each of the n numbers of a row.
        let counted = NUMBERS * (states + m) as f64 * step;
        as_written(((SETTLING_TIMES * settling).max(counted) / step * (1.0 - 1e-9)).ceil() * step)
    };
    let usual = settling / STEPS;
    // What is faster than records show isn't known.
    let recorded = request.plant.as_ref().and_then(|plant| plant.sample_time()).unwrap_or_default();
    let [usual, fine] = [usual, usual.min(poles.step().max(recorded))].map(|step| round_down(step * (1.0 + 1e-9)));
    let is_coarse = asked.step.is_none() && length(fine) / fine > MOST_SAMPLES;
    let step = asked.step.unwrap_or(if is_coarse { usual } else { fine });
    check_step(asked, settling, step)?;
    Ok(Times { settling, step, length: length(step), states, is_assumed: known.is_none(), is_coarse, poles })
}

/// Refuses a step that is too long or too short for the signal.
fn check_step(asked: &Experiment, settling: f64, step: f64) -> Result<(), Invalid> {
    let refuse = |allowed: String| Err(Invalid::new("--step", Number(step), allowed));
    if !SAMPLE_TIMES.contains(&step) {
        let [least, most] = [SAMPLE_TIMES.start(), SAMPLE_TIMES.end()].map(|step| Number(*step));
        let range = format!("must be within {least} … {most} s");
        let usual = Number(step);
        return match asked.step {
            Some(_) => refuse(range),
            None => Err(Invalid::because(format!("the step of {usual} s {range}: give another --settling-time"))),
        };
    }
    let longest = longest_level(settling);
    let samples = of_level(longest, step);
    if asked.signal == "levels" && samples < super::SHORTEST_LEVEL {
        let most = at_most(longest / super::SHORTEST_LEVEL);
        return refuse(format!("must be at most {most} s: a level of 0.4 settling times has two steps at least"));
    }
    if asked.signal == "levels" && samples > MOST_SAMPLES {
        let (least, most) = (at_least(longest / MOST_SAMPLES), Number(MOST_SAMPLES));
        return refuse(format!("must be at least {least} s: a level of 0.4 settling times has at most {most} steps"));
    }
    Ok(())
}

fn longest_level(settling: f64) -> f64 {
    three_digits(settling * LONGEST_LEVEL)
}

/// The settling time: that of the request, or that of its bandwidth, or of the plant's slowest pole.
fn settling_time(request: &Request, asked: &Experiment, poles: &Poles) -> Result<f64, Invalid> {
    let unsettled = |why: String| {
        Err(Invalid::because(format!("{why}: give --settling-time or --bandwidth of the loop with its controller")))
    };
    match (asked.settling_time, request.bandwidth, &request.plant) {
        (Some(settling), ..) => Ok(settling),
        (None, Some(bandwidth), _) => Ok(4.0 / bandwidth),
        (None, None, Some(plant)) => match poles.unstable {
            Some(real) => unsettled(format!("{}, so that it doesn't settle", unstable(real))),
            None if poles.fastest == 0.0 && plant.poles().is_ok() => {
                unsettled("all poles of the plant are at 0, so that it doesn't settle".to_owned())
            }
            None => request.speed(plant).map(|speed| three_digits(8.0 / speed)),
        },
        (None, None, None) => Ok(4.0 / USUAL_BANDWIDTH),
    }
}

fn unstable(real: f64) -> String {
    format!("the plant has an unstable pole, with the real part {} 1/s", crate::report::number(real))
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
        let longest = longest_level(times.settling);
        text.set("longest_level", number(longest), "s, 0.4 settling times; the shortest is two steps");
        return Ok(());
    }
    let up_to = highest_frequency(asked, times, m)?;
    text.set("period", number(times.length), "s, after which the signal repeats");
    text.set("highest_frequency", number(up_to), "rad/s; the lowest is 2 pi/period");
    Ok(())
}

/// The highest frequency that was asked for, or one beyond the plant's fastest pole.
fn highest_frequency(asked: &Experiment, times: &Times, m: usize) -> Result<f64, Invalid> {
    let &Times { settling, step, length, .. } = times;
    let is_chirp = asked.signal == "chirp";
    let (least, terms) = if is_chirp { (1, f64::INFINITY) } else { (m, MOST_TERMS) };
    let most = MOST_SAMPLES.min(terms / (least + 1) as f64).floor();
    let samples = (length / step).round();
    if samples > most {
        let (fewest, most) = (at_least(SETTLING_TIMES * settling / most), Number(most));
        let allowed =
            format!("must be at least {fewest} s: 10 settling times are a period, which has at most {most} steps");
        return Err(Invalid::new("--step", Number(step), allowed));
    }
    let lowest = TAU * least as f64 / length;
    let of_terms = TAU / length * terms / samples;
    let highest = of_terms.min(PI / step);
    let allowed = format!("{} … {} rad/s", at_least(lowest), at_most(highest));
    let usual = no_more(as_written(BEYOND_FASTEST * times.poles.fastest).min(highest), 3);
    let Some(up_to) = asked.up_to.or(Some(usual).filter(|usual| *usual > lowest)) else {
        return Err(Invalid::because(format!(
            "--up-to is missing: give the highest frequency of the signal within {allowed}, about three times the fastest pole \
             that the record is to show"
        )));
    };
    if up_to > lowest && up_to <= highest {
        return Ok(up_to);
    }
    let turns = 2 * least;
    let upper = if highest < PI / step {
        format!("a sum of {} terms in all samples of a period; a longer --step allows more", Number(terms))
    } else {
        "pi/step".to_owned()
    };
    let allowed = format!("must be within {allowed}: from {turns} pi/length to {upper}");
    Err(Invalid::new("--up-to", Number(up_to), allowed))
}

/// The advised length of the experiment, and faults that its record would have.
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
    if let Some(real) = times.poles.unstable {
        text.note(&format!(
            "warning: {}. Without a controller nothing settles: connect one to `command` and run the experiment in that loop.",
            unstable(real)
        ));
    } else if times.poles.integrates {
        text.note(
            "warning: the plant has a pole at 0, so that it drifts. Where it may not, connect a controller to `command` and run the \
             experiment in that loop.",
        );
    }
    if times.is_coarse {
        let (fastest, fine) = (times.poles.fastest, round_down(times.poles.step()));
        text.note(&format!(
            "warning: at this step the record does not show the plant's fastest pole, {} rad/s: that takes about --step {}, and too many \
             samples for this settling time.",
            crate::report::number(fastest),
            crate::report::number(fine)
        ));
    }
    let Some([min, max]) = request.plant.as_ref().and_then(|plant| plant.limits.as_ref()) else { return };
    for i in 0..m {
        let (low, high) = (points[i] - amplitudes[i], points[i] + amplitudes[i]);
        let is_beyond = low < min[i] && min[i] > -NO_LIMIT || high > max[i] && max[i] < NO_LIMIT;
        if is_beyond {
            let of = request.plant.as_ref().and_then(|plant| plant.u.names.get(i).cloned());
            text.note(&format!(
                "warning: {} goes from {} to {}, beyond the plant's limits {} … {}: the record would show what was asked for, not what acted.",
                of.unwrap_or_else(|| format!("u[{}]", i + 1)),
                crate::report::number(low),
                crate::report::number(high),
                crate::report::number(min[i]),
                crate::report::number(max[i])
            ));
        }
    }
}
