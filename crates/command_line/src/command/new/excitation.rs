//! Options of experiments, and their signals as a table.

use std::fmt::Write;

use adaptive_fmu::catalogue::{Entry, Role};
use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::execution::Execution;
use adaptive_fmu::library;
use adaptive_fmu::model::Model;
use adaptive_fmu::system::Causality;
use adaptive_fmu::template::{Experiment, MOST, Sizes, as_written};
use adaptive_fmu::text_file::csv_field;
use clap::builder::PossibleValuesParser;

use super::UnitArguments;
use crate::command::names::{Names, Which};
use crate::command::number::{finite, positive};

/// Names of the signals.
const SIGNALS: [&str; 3] = ["levels", "multisine", "chirp"];
/// Heading of these options in the help.
const HEADING: &str = "Experiment (excitation)";
/// Most numbers of a table.
const MOST_NUMBERS: f64 = 1e7;

#[derive(clap::Args, Debug, Clone)]
pub struct ExperimentOptions {
    /// Signal that is added to the inputs of the plant [default: levels]
    ///
    /// Levels have random heights and lengths, and show most. A multisine contains all multiples of one frequency, a chirp sweeps
    /// through all frequencies; both need --up-to or --plant.
    #[arg(long, value_parser = PossibleValuesParser::new(SIGNALS), help_heading = HEADING)]
    signal: Option<String>,
    /// Largest deviation from the operating point, of all inputs or of each [default: 1]
    #[arg(long, value_name = "NUMBER,…", value_delimiter = ',', value_parser = positive, help_heading = HEADING)]
    amplitude: Vec<f64>,
    /// Operating point of all inputs or of each [default: 0]
    #[arg(long, value_name = "NUMBER,…", value_delimiter = ',', value_parser = finite, allow_hyphen_values = true, help_heading = HEADING)]
    operating_point: Vec<f64>,
    /// Settling time of the plant, s, roughly [default: 4/bandwidth, or that of the slowest pole of --plant]
    #[arg(long, value_name = "TIME", value_parser = positive, help_heading = HEADING)]
    settling_time: Option<f64>,
    /// Highest frequency of a multisine or chirp, rad/s: about three times the fastest pole to be shown [default: that of --plant]
    #[arg(long, value_name = "FREQUENCY", value_parser = positive, help_heading = HEADING)]
    up_to: Option<f64>,
    /// Seed of the levels [default: 1]
    #[arg(long, help_heading = HEADING)]
    seed: Option<i32>,
    /// Write a CSV file, as `simulate --input` reads it, instead of the description of an FMU
    #[arg(long, help_heading = HEADING)]
    pub csv: bool,
}

/// The requested experiment.
pub struct Asked {
    signal: String,
    amplitude: Vec<f64>,
    operating_point: Vec<f64>,
    names: Vec<String>,
}

/// True if a kind makes experiments.
pub fn is_experiment(kind: &str) -> bool {
    library::find(kind).is_some_and(|entry| entry.role == Role::Excitation)
}

impl ExperimentOptions {
    /// The options that were given, by their names.
    fn given(&self) -> impl Iterator<Item = &'static str> + use<> {
        let ExperimentOptions { signal, amplitude, operating_point, settling_time, up_to, seed, csv } = self;
        let given = [
            ("--signal", signal.is_some()),
            ("--amplitude", !amplitude.is_empty()),
            ("--operating-point", !operating_point.is_empty()),
            ("--settling-time", settling_time.is_some()),
            ("--up-to", up_to.is_some()),
            ("--seed", seed.is_some()),
            ("--csv", *csv),
        ];
        given.into_iter().filter(|(_, is_given)| *is_given).map(|(name, _)| name)
    }

    /// Refuses options that nothing would use, for experiments and for kinds that make none.
    pub fn check(&self, kind: &str, arguments: &UnitArguments) -> Result<(), Error> {
        let refuse = |reason: String| Err(Error::Argument(Invalid::because(reason)));
        if !is_experiment(kind) {
            let kinds = library::begun().filter(|entry| is_experiment(entry.kind.name));
            let kinds = kinds.map(|entry: &Entry| entry.kind.name).collect::<Vec<_>>().join(", ");
            if let Some(option) = self.given().next() {
                return refuse(format!("{option} is for an experiment, which {kind} is not. Use {kinds}"));
            }
            if arguments.step.is_some() && arguments.plant.is_none() {
                return refuse("--step is for an FMU as the plant: give it with --plant FILE.fmu".to_owned());
            }
            return Ok(());
        }
        let has_plant = arguments.plant.is_some() || !arguments.data.is_empty();
        let has_levels = self.signal.as_deref().is_none_or(|signal| signal == SIGNALS[0]);
        let reason = match (self.settling_time, arguments.bandwidth) {
            (None, None) if !has_plant => {
                "--settling-time is missing: give roughly how long the plant takes to settle after a step, in s"
            }
            (Some(_), Some(_)) => "--settling-time is 4/bandwidth: give --settling-time or --bandwidth, not both",
            _ if self.seed.is_some() && !has_levels => {
                "--seed selects levels, which a multisine and a chirp don't have: leave it out"
            }
            _ if !arguments.reference.is_empty() => {
                "--reference is for controllers: give --amplitude, the range of the inputs"
            }
            _ => return Ok(()),
        };
        refuse(reason.to_owned())
    }

    /// Numbers and names of an experiment, with defaults.
    pub fn asked(&self, arguments: &UnitArguments) -> Asked {
        let or = |given: &[f64], usual: f64| if given.is_empty() { vec![usual] } else { given.to_vec() };
        let names = match &arguments.inputs {
            Some(Which::Named(Names(names))) if arguments.plant.is_none() => names.clone(),
            _ => Vec::new(),
        };
        Asked {
            signal: self.signal.clone().unwrap_or_else(|| SIGNALS[0].to_owned()),
            amplitude: or(&self.amplitude, 1.0),
            operating_point: or(&self.operating_point, 0.0),
            names,
        }
    }

    /// The same as a description is begun with.
    pub fn experiment<'a>(&self, asked: &'a Asked, step: Option<f64>) -> Experiment<'a> {
        let Asked { signal, amplitude, operating_point, names } = asked;
        let (settling_time, up_to, seed) = (self.settling_time, self.up_to, self.seed.unwrap_or(1));
        Experiment { signal, amplitude, operating_point, names, settling_time, step, up_to, seed }
    }
}

/// Sizes of an experiment without a plant, whose inputs may have names.
pub fn sizes(arguments: &UnitArguments) -> Result<Sizes, Error> {
    match &arguments.inputs {
        Some(Which::Named(Names(names))) if names.len() <= MOST as usize => {
            let Sizes { states, outputs, .. } =
                super::plant::sizes(&UnitArguments { inputs: None, ..arguments.clone() })?;
            Ok(Sizes { states, inputs: Some(names.len()), outputs })
        }
        _ => super::plant::sizes(arguments),
    }
}

/// The outputs of a unit over its default experiment, at each of its steps: a line of names, then one of numbers a step.
pub fn table(model: Model) -> Result<String, Error> {
    let (step, length) = (model.description().experiment.step, model.description().experiment.stop_time);
    let failed = |reason: String| Error::Argument(Invalid::because(reason));
    let steps = (length / step).round();
    let variables = model.variables();
    let outputs = variables.iter().filter(|variable| variable.causality == Causality::Output && variable.is_real());
    let elements: Vec<_> = outputs.flat_map(|variable| (0..variable.len()).map(|k| variable.element(k))).collect();
    let (rows, columns) = (steps + 1.0, elements.len() + 1);
    if rows * columns as f64 > MOST_NUMBERS {
        let reason =
            format!("{rows} rows of {columns} numbers are too many for a file of at most {MOST_NUMBERS} numbers");
        return Err(failed(format!("{reason}: give a longer --step")));
    }
    let mut text = String::from("time");
    elements.iter().for_each(|element| text.push_str(&format!(",{}", csv_field(&element.name()))));
    text.push('\n');
    let places: Vec<usize> = elements.iter().map(|element| variables.index(*element)).collect();
    let mut execution = Execution::new(model);
    execution.initialise().map_err(|error| failed(error.to_string()))?;
    for k in 0..=steps as usize {
        let time = k as f64 * step;
        let _ = write!(text, "{}", as_written(time));
        places.iter().for_each(|place| _ = write!(text, ",{}", execution.block().reals[*place]));
        text.push('\n');
        execution.step(time, step).map_err(|error| failed(error.to_string()))?;
    }
    Ok(text)
}
