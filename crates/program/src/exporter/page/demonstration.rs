//! Response of a standalone FMU to a step or a sine: the plot on the page of an FMU that is in no loop of this package.
//! It is computed from the FMU's own description while its page is written.

use std::fmt::Write;

use super::response::{Curve, Plot};
use super::{Handed, escaped};
use crate::catalogue::{Demonstration, Scale, Stimulus};
use crate::execution::Execution;
use crate::library::REGISTRY;
use crate::model::{Description, Model};
use crate::report::number;
use crate::system::{Causality, Variable};

/// Number of communication steps of the experiment, and the fewest with which it is shown.
const STEPS: usize = 400;
const FEWEST: usize = 20;
/// Times relative to the experiment: of a step; of the step down, and of the end of steps.
const BEFORE: f64 = 0.05;
const DOWN: f64 = 0.4;
const OVER: f64 = 0.75;
/// Periods of a sine.
const PERIODS: f64 = 1.5;
/// Work limit of a communication step, so that the plot doesn't delay a large plant's export.
const MOST_WORK: f64 = 1e6;
/// Largest number of outputs in one plot.
const MOST_OUTPUTS: usize = 4;

/// The plot, and its description as HTML.
pub struct Shown {
    pub how: String,
    pub plot: Plot,
}

/// The demonstration of an FMU; none if its kind has no standalone one, or its outputs don't change.
pub fn shown(handed: &Handed) -> Option<Shown> {
    let demonstration = handed.entry?.demonstration?;
    let own = Experiment::of(handed.description, &demonstration).and_then(Experiment::run);
    if let Some(recorded) = own.filter(Recorded::moves) {
        return Some(recorded.shown(""));
    }
    let example: toml::Table = demonstration.example.parse().ok()?;
    let mut description = handed.description.clone();
    description.start.extend(with_elements(&description, &example));
    let recorded = Experiment::of(&description, &demonstration)?.run().filter(Recorded::moves)?;
    Some(recorded.shown(demonstration.example))
}

/// Expands numbers for vectors to start values of all their elements.
fn with_elements(description: &Description, values: &toml::Table) -> toml::Table {
    let Ok(variables) = Model::variables_of(description, REGISTRY) else { return values.clone() };
    let whole = |name: &str, value: &toml::Value| {
        let length = variables.iter().find(|variable| variable.name == name).map_or(1, Variable::len);
        let is_vector = variables.find(name).is_none();
        if is_vector { toml::Value::Array(vec![value.clone(); length]) } else { value.clone() }
    };
    values.iter().map(|(name, value)| (name.clone(), whole(name, value))).collect()
}

/// An experiment that is ready to be run.
struct Experiment {
    execution: Execution,
    demonstration: Demonstration,
    scale: Scale,
    /// Name and place of the input with the stimulus, and of the outputs that are shown, with their units.
    input: Option<(String, usize)>,
    outputs: Vec<(String, usize)>,
    units: Vec<&'static str>,
}

/// Recorded experiment.
struct Recorded {
    demonstration: Demonstration,
    scale: Scale,
    input: String,
    plot: Plot,
}

impl Experiment {
    fn of(description: &Description, demonstration: &Demonstration) -> Option<Self> {
        let model = Model::from_description(description.clone(), REGISTRY).ok()?;
        let variables = model.variables();
        let find = |name: &str| variables.iter().find(|variable| variable.name == name && variable.is_real());
        let place = |variable: &Variable, k: usize| variables.index(variable.element(k));
        let number = |value: &toml::Value| value.as_float().or(value.as_integer().map(|whole| whole as f64));
        let given = |key: &str| description.structure.get(key);
        let of_structure = |name: &str| match name.split_once(" = ") {
            Some((key, text)) => f64::from(given(key).and_then(toml::Value::as_str) == Some(text)),
            None => given(name).and_then(number).unwrap_or_default(),
        };
        let first = |name: &str| {
            find(name).map_or_else(|| of_structure(name), |variable| model.start().reals[place(variable, 0)])
        };
        let scale = (demonstration.scale)(&first, description.experiment.stop_time)?;
        let named = |variable: &Variable, k: usize| (variable.element(k).name(), place(variable, k));
        let input = find(demonstration.input).map(|variable| named(variable, 0));
        let output = find(demonstration.output).filter(|variable| variable.causality == Causality::Output)?;
        let count = if demonstration.shows_all { output.len().min(MOST_OUTPUTS) } else { 1 };
        let outputs: Vec<_> = (0..count).map(|k| named(output, k)).collect();
        let of_input = find(demonstration.input).map(|variable| variable.element(0).unit());
        let units = of_input.into_iter().chain((0..count).map(|k| output.element(k).unit())).collect();
        let constant = demonstration.constant_inputs.iter().filter_map(|name| find(name));
        let constant: Vec<usize> =
            constant.flat_map(|variable| (0..variable.len()).map(|k| place(variable, k))).collect();
        let of_work = find("work_limit").map(|variable| place(variable, 0));
        let mut execution = Execution::new(model);
        of_work.into_iter().for_each(|place| execution.set_real(place, MOST_WORK));
        constant.into_iter().for_each(|place| execution.set_real(place, 0.0));
        Some(Experiment { execution, demonstration: *demonstration, scale, input, outputs, units })
    }

    /// Runs it, as far as the FMU gets; none if that is too short.
    fn run(mut self) -> Option<Recorded> {
        let step = self.scale.duration / STEPS as f64;
        let mut rows: Vec<(f64, Vec<f64>)> = Vec::with_capacity(STEPS + 1);
        for k in 0..=STEPS {
            let time = k as f64 * step;
            let given = self.scale.about + self.scale.size * along(self.demonstration.stimulus, k);
            if let Some((_, place)) = self.input {
                self.execution.set_real(place, given);
            }
            if k == 0 {
                self.execution.initialise().ok()?;
            }
            let outputs = self.outputs.iter().map(|(_, place)| self.execution.block().reals[*place]);
            rows.push((time, self.input.iter().map(|_| given).chain(outputs).collect()));
            if k < STEPS && self.execution.step(time, step).is_err() {
                break;
            }
        }
        let names = self.input.iter().chain(&self.outputs).map(|(name, _)| name.clone());
        let curves = names.zip(&self.units).enumerate().map(|(column, (name, unit))| Curve {
            name,
            unit: (*unit).to_owned(),
            is_reference: self.input.is_some() && column == 0,
            points: rows.iter().map(|(time, row)| (*time, row[column])).collect(),
        });
        // A step is described in the text; its curve is left out, since it may be small compared with the outputs.
        let tells_alone = self.demonstration.stimulus == Stimulus::Step;
        let curves = curves.filter(|curve| !(curve.is_reference && tells_alone));
        let plot = Plot { title: self.title(), curves: curves.collect() };
        let Experiment { demonstration, scale, input, .. } = self;
        let input = input.map_or(String::new(), |(name, _)| name);
        (rows.len() >= FEWEST).then_some(Recorded { demonstration, scale, input, plot })
    }

    fn title(&self) -> String {
        let outputs = self.outputs.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
        match (&self.input, self.demonstration.stimulus) {
            (Some((input, _)), Stimulus::Step) => format!("{outputs} after a step of {input}"),
            (Some((input, _)), _) => format!("{input} and {outputs}"),
            (None, _) => outputs,
        }
    }
}

/// Value of a stimulus at a communication point, relative to its size.
fn along(stimulus: Stimulus, point: usize) -> f64 {
    let part = point as f64 / STEPS as f64;
    match stimulus {
        Stimulus::Nothing => 0.0,
        Stimulus::Step => f64::from(part >= BEFORE),
        Stimulus::Steps if (BEFORE..DOWN).contains(&part) => 1.0,
        Stimulus::Steps if (DOWN..OVER).contains(&part) => -0.5,
        Stimulus::Steps => 0.0,
        Stimulus::Sine => (std::f64::consts::TAU * PERIODS * part).sin(),
        Stimulus::Turns => 1.0 - 2.0 * (0.5 - PERIODS * part).rem_euclid(1.0),
    }
}

impl Recorded {
    /// True if anything but the input moves.
    fn moves(&self) -> bool {
        let outputs = self.plot.curves.iter().filter(|curve| !curve.is_reference);
        outputs.flat_map(|curve| curve.points.windows(2)).any(|ends| ends[0].1 != ends[1].1)
    }

    fn shown(self, example: &str) -> Shown {
        let Recorded { demonstration, scale: Scale { about, size, duration }, input, plot } = self;
        let input = format!("<code>{}</code>", escaped(&input));
        let short = |value: f64| number(format!("{value:.3e}").parse().unwrap_or(value));
        let mut how = "This FMU without a loop, computed at export".to_owned();
        let _ = match demonstration.stimulus {
            Stimulus::Nothing => Ok(()),
            Stimulus::Step => {
                let at = short(BEFORE * duration);
                write!(how, ": {input} steps from {} to {} at {at} s", short(about), short(about + size))
            }
            Stimulus::Steps => {
                write!(how, ": {input} steps to {} and to {}", short(about + size), short(about - 0.5 * size))
            }
            Stimulus::Sine => write!(how, ": {input} is a sine of amplitude {}", short(size)),
            Stimulus::Turns => write!(how, ": {input} turns at a constant rate and wraps at {}", short(size)),
        };
        if !example.is_empty() {
            let values: Vec<_> = example.lines().map(|line| format!("<code>{}</code>", escaped(line))).collect();
            let _ = write!(how, ". With its start values it has no effect, so here it has {}", values.join(", "));
        }
        how.push('.');
        Shown { how, plot }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exporter::find_description;
    use crate::library;

    /// The recorded experiment of an FMU of this package, with some lines of `[start]`.
    fn recorded(name: &str, start: &str) -> Recorded {
        let mut description = Description::read(&find_description(name).unwrap().text).unwrap();
        description.start.extend(with_elements(&description, &start.parse().unwrap()));
        let demonstration = library::find(&description.model).unwrap().demonstration.unwrap();
        Experiment::of(&description, &demonstration).unwrap().run().unwrap()
    }

    /// The values of the last curve.
    fn last(recorded: &Recorded) -> Vec<(f64, f64)> {
        recorded.plot.curves.last().unwrap().points.clone()
    }

    #[test]
    fn a_mass_on_wheels_answers_a_force_by_a_parabola() {
        let recorded = recorded("StateSpace", "");
        for (time, position) in last(&recorded) {
            assert!((position - 0.5 * f64::max(time - 0.5, 0.0).powi(2)).abs() < 1e-6, "{position} m at {time} s");
        }
        assert!(recorded.shown("").how.ends_with("<code>u[1]</code> steps from 0 to 1 at 0.5 s."));
    }

    #[test]
    #[allow(non_snake_case)]
    fn a_large_plant_that_nobody_controls_is_shown_as_far_as_a_little_work_gets() {
        // Modes that oscillate at up to 100 000 rad/s and grow: the whole experiment would take minutes.
        let modes = 50;
        let mut A = vec![vec![0.0; 2 * modes]; 2 * modes];
        for mode in 0..modes {
            let (k, frequency) = (2 * mode, 2e3 * (mode + 1) as f64);
            (A[k][k], A[k][k + 1], A[k + 1][k], A[k + 1][k + 1]) = (1.0, frequency, -frequency, 1.0);
        }
        let text = format!(
            "name = \"Large\"\nmodel = \"state-space\"\ndescription = \"\"\n[experiment]\nstop_time = 100.0\n[structure]\n\
             A = {A:?}\nB = {:?}\nC = {:?}\n",
            vec![[1.0]; 2 * modes],
            [vec![1.0; 2 * modes]]
        );
        let description = Description::read(&text).unwrap();
        let demonstration = library::find(&description.model).unwrap().demonstration.unwrap();
        let recorded = Experiment::of(&description, &demonstration).unwrap().run();
        assert!(recorded.is_none_or(|recorded| recorded.plot.curves[0].points.len() <= STEPS));
    }

    #[test]
    fn an_actuator_is_shown_at_its_limits_and_no_faster_than_it_can() {
        let limits = "u_min = -2.0\nu_max = 2.0\nrate_limit = 4.0";
        let points = last(&recorded("Actuator", limits));
        let (low, high) = points.iter().fold((0.0, 0.0), |(low, high), (_, y)| (f64::min(low, *y), f64::max(high, *y)));
        assert!((high - 2.0).abs() < 1e-3 && (low + 1.5).abs() < 1e-3, "{low} … {high}");
        let steepest = points.windows(2).map(|ends| (ends[1].1 - ends[0].1).abs() / (ends[1].0 - ends[0].0));
        let steepest = steepest.fold(0.0, f64::max);
        assert!((3.9..4.001).contains(&steepest), "{steepest}");
    }

    #[test]
    fn a_sensor_is_shown_as_it_is_set_and_by_an_example_where_nothing_is() {
        let of = |name: &str| Description::read(&find_description(name).unwrap().text).unwrap();
        let sensor = library::find("sensor").unwrap().demonstration.unwrap();
        assert!(Experiment::of(&of("Sensor"), &sensor).is_none(), "it changes nothing");
        let points = last(&recorded("Sensor", sensor.example));
        assert!(points.iter().all(|(_, y)| (y / 0.1 - (y / 0.1).round()).abs() < 1e-9), "in steps of 0.1");
        let own = Experiment::of(&of("SensorTwoLinkRobot"), &sensor).unwrap().run().unwrap();
        assert_eq!(own.scale.size, 15.0 * 1e-4, "fine enough for its resolution");
    }

    #[test]
    fn every_example_moves_a_unit_that_nothing_else_moves() {
        for entry in library::CATALOGUE {
            let Some(demonstration) = entry.demonstration else { continue };
            let mut texts = crate::exporter::descriptions().iter().map(|(_, text)| Description::read(text).unwrap());
            let description = texts.find(|description| description.model == entry.kind.name).unwrap();
            let (mut set, name) = (description.clone(), entry.kind.name);
            set.start.extend(with_elements(&description, &demonstration.example.parse().unwrap()));
            assert!(Experiment::of(&set, &demonstration).unwrap().run().unwrap().moves(), "{name}");
        }
    }
}
