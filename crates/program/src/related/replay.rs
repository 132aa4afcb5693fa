//! The experiments of an FMU, of any tool, run and compared with their references.

use std::path::Path;
use std::sync::Arc;

use super::deviation::{Deviation, deviations, short, with_elements};
use super::reading::{Experiment, Named, Place, RelatedFile, experiments, is_experiments, manifest};
use super::{EXPERIMENT, FOLDER, MANIFEST, PARAMETER_SET, TABLE, USUAL_STEPS};
use crate::error::Error;
use crate::exporter::{entries, read_entry};
use crate::fmi2::calls::Interface;
use crate::fmu::Fmu;
use crate::output;
use crate::scratch::Scratch;
use crate::simulation::{Alone, Inputs};
use crate::structure::{Component, Settings};
use crate::tables;

/// Communication steps of an experiment, at most.
const MOST_STEPS: f64 = 1e6;

/// Something wrong with related files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// True if the formats forbid it; else it is left out.
    pub is_error: bool,
    /// Description of the fault.
    pub what: String,
    /// Advice on what to do.
    pub advice: &'static str,
}

impl Fault {
    fn error(what: String, advice: &'static str) -> Self {
        Fault { is_error: true, what, advice }
    }

    fn left_out(what: String) -> Self {
        Fault { is_error: false, what, advice: "this experiment is left out" }
    }
}

/// An experiment that was run.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Replayed {
    /// Its name.
    pub experiment: String,
    /// The deviation that it allows, where it names one.
    pub tolerance: Option<f64>,
    /// The largest deviation of each output.
    pub outputs: Vec<Deviation>,
}

impl Replayed {
    /// The outputs that deviate more than is allowed.
    pub fn faults(&self) -> impl Iterator<Item = Fault> {
        let allowed = self.tolerance.unwrap_or(f64::INFINITY);
        let off = self.outputs.iter().filter(move |output| output.largest > allowed || output.largest.is_nan());
        off.map(move |Deviation { output, largest, time, value, reference }| {
            let [allowed, largest] = [allowed, *largest].map(short);
            let what = format!(
                "the experiment `{}`: `{output}` is {value} at {time} s, its reference {reference}. It deviates by {largest} of the \
                 largest reference, more than the tolerance {allowed}",
                self.experiment
            );
            Fault::error(what, "find out which of both is wrong")
        })
    }
}

/// The experiments of an FMU that are ready to be run, and what is wrong with its related files.
#[derive(Debug, Default)]
pub struct Replay {
    experiments: Vec<Experiment>,
    /// Faults that were found.
    pub faults: Vec<Fault>,
}

impl Replay {
    /// Reads those of an FMU; none if it has no manifest.
    ///
    /// # Errors
    /// When the archive can't be read.
    pub fn of(file: &Path) -> Result<Self, Error> {
        let names: Vec<String> = entries(file)?.into_iter().map(|entry| entry.name).collect();
        let mut replay = Replay::default();
        let place = format!("{FOLDER}/{MANIFEST}");
        if !names.contains(&place) {
            return Ok(replay);
        }
        let related = read_entry(file, &place).map_err(|error| error.to_string());
        match related.and_then(|text| manifest(&text, FOLDER)) {
            Ok(related) => replay.take(file, &names, related),
            Err(reason) => {
                replay.faults.push(Fault::error(format!("{place}: {reason}"), "write it as FMI-LS-REF has it"))
            }
        }
        Ok(replay)
    }

    /// Takes over the experiments of the related files.
    fn take(&mut self, file: &Path, names: &[String], related: Vec<RelatedFile>) {
        for RelatedFile { file: named, role } in related {
            let Some(path) = self.path(&named, MANIFEST, names) else { continue };
            let is_experiment =
                role == EXPERIMENT || role.strip_prefix(EXPERIMENT).is_some_and(|sub| sub.starts_with('/'));
            if !is_experiment || !is_experiments(&named.kind) {
                continue;
            }
            let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
            let read = read_entry(file, &path).map_err(|error| error.to_string());
            match read.and_then(|text| experiments(&text, folder)) {
                Ok(found) => {
                    let found =
                        found.into_iter().filter(|it| it.references.is_some() && self.has_files(it, &path, names));
                    let found: Vec<_> = found.collect();
                    self.experiments.extend(found);
                }
                Err(reason) => self
                    .faults
                    .push(Fault::error(format!("{path}: {reason}"), "write it as the experiments format has it")),
            }
        }
    }

    /// True if all files of an experiment can be read; what is wrong is noted.
    fn has_files(&mut self, experiment: &Experiment, by: &str, names: &[String]) -> bool {
        let Experiment { name, parameters, stimuli, references, .. } = experiment;
        let mut has = true;
        for (file, kind) in [(parameters, PARAMETER_SET), (stimuli, TABLE), (references, TABLE)] {
            let Some(file) = file else { continue };
            if file.kind != kind {
                let what = format!(
                    "{by}: the experiment `{name}` has `{}` of type {}, and only {kind} is read",
                    file.source, file.kind
                );
                self.faults.push(Fault::left_out(what));
                has = false;
            } else {
                has &= self.path(file, by, names).is_some();
            }
        }
        has
    }

    /// The path of a file in the archive, where it is there; what is wrong is noted.
    fn path(&mut self, named: &Named, by: &str, names: &[String]) -> Option<String> {
        let source = &named.source;
        match &named.place {
            Place::Inside(path) if names.contains(path) => return Some(path.clone()),
            Place::Inside(_) => {
                self.faults.push(Fault {
                    is_error: false,
                    what: format!("{by}: there is no `{source}`"),
                    advice: "add the file",
                });
            }
            Place::Elsewhere => {}
            Place::Outside => {
                let what = format!("{by}: the source `{source}` leads outside the FMU");
                self.faults.push(Fault::error(what, "name a file within the FMU, relative to the file that names it"));
            }
        }
        None
    }

    /// Number of experiments.
    pub fn count(&self) -> usize {
        self.experiments.len()
    }

    /// Runs the experiments of an FMU. What can't be run is a fault.
    pub fn run(&mut self, fmu: &Arc<Fmu>) -> Vec<Replayed> {
        let mut replayed = Vec::new();
        for experiment in std::mem::take(&mut self.experiments) {
            match run(&experiment, fmu) {
                Ok(run) => replayed.push(run),
                Err(reason) => {
                    let what = format!("the experiment `{}`: {reason}", experiment.name);
                    self.faults.push(Fault::error(what, "an importer must be able to run it with what is in the FMU"));
                }
            }
        }
        replayed
    }
}

/// Runs one experiment.
fn run(experiment: &Experiment, fmu: &Arc<Fmu>) -> Result<Replayed, String> {
    let words = |error: Error| error.to_string();
    let (folder, description) = (Scratch::new().map_err(words)?, &fmu.description);
    let is_array =
        |name: &str| description.variable(name).is_none() && description.arrays.iter().any(|array| array.name == name);
    let file = |named: &Named, name: &str| {
        let Place::Inside(path) = &named.place else { return Err(format!("`{}` is not in the FMU", named.source)) };
        let text = read_entry(fmu.file(), path).map_err(words)?;
        let text = if named.kind == TABLE { with_elements(&text, is_array) } else { text };
        let file = folder.path().join(name);
        output::write(&file, text.into_bytes()).map(|()| file).map_err(words)
    };
    let inputs = experiment.stimuli.as_ref().map(|named| {
        let read = Inputs::read(&file(named, "stimuli.csv")?, description).map_err(words)?;
        Ok::<_, String>(read.inputs)
    });
    let inputs = inputs.transpose()?;
    let values = experiment.parameters.as_ref().map(|named| {
        let component = Component::alone(&description.name, &file(named, "parameters.ssv")?).map_err(words)?;
        Ok::<_, String>(component.values.into_iter().map(|value| (value.name, value.text)).collect::<Vec<_>>())
    });
    let start = values.transpose()?.unwrap_or_default();
    let references = experiment.references.as_ref().ok_or("it has no references")?;
    let table = tables::read(&file(references, "references.csv")?, &[]).map_err(words)?;
    let settings = settings(experiment, fmu, table.columns.first().map_or(&[], |time| &time.values[..]))?;
    let further: Vec<String> = table.columns.iter().skip(1).map(|column| column.name.clone()).collect();
    let interface = if description.co_simulation { Interface::CoSimulation } else { Interface::ModelExchange };
    // Of a tolerance of the solver there is no word: one that hardly adds to the deviation.
    let tolerance = 1e-8;
    let run =
        Alone { fmu, interface, tolerance, start: &start, inputs: inputs.as_ref(), further: &further, events: &[] };
    let recording = run.run(settings, |_| true).map_err(|(error, _)| words(error))?;
    let outputs =
        deviations(&recording, &table, settings.step).map_err(|reason| format!("`{}` {reason}", references.source))?;
    Ok(Replayed { experiment: experiment.name.clone(), tolerance: experiment.tolerance, outputs })
}

/// Times and step of an experiment; what it doesn't name is the FMU's own, or that of the references.
fn settings(experiment: &Experiment, fmu: &Arc<Fmu>, times: &[f64]) -> Result<Settings, String> {
    let description = &fmu.description;
    let start_time = experiment.start.or(description.start_time).unwrap_or(0.0);
    let stop = experiment.stop.or(description.stop_time).or(times.last().copied());
    let stop_time = stop.ok_or("it has no stopTime")?;
    let own = description.step.filter(|step| *step > 0.0);
    let step = experiment.step.or(own).unwrap_or((stop_time - start_time) / USUAL_STEPS);
    if !(stop_time > start_time && step > 0.0) {
        return Err(format!(
            "startTime {start_time}, stopTime {stop_time}, stepSize {step}: must grow, by steps above 0"
        ));
    }
    let steps = (stop_time - start_time) / step;
    if steps > MOST_STEPS {
        return Err(format!("it has {} communication steps; at most {MOST_STEPS} are run", steps.ceil()));
    }
    Ok(Settings { start_time, stop_time, step })
}
