//! Options of a loop, its FMUs and its stepping, common to `run` and `tune`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use adaptive_fmu::error::Error;
use adaptive_fmu::fmu::{Fmu, Hosting, Ready, Value};
use adaptive_fmu::reproduction::linear_limit;
use adaptive_fmu::results::{Asked, Mark, Provenance, UnitMark, Versions};
use adaptive_fmu::sealed::checksum;
use adaptive_fmu::simulation::LoadedLoop;
use adaptive_fmu::structure::{LoopFiles, Order, Settings, Structure, Whole, check_values, within_run};

use super::export::warn_of;
use super::hosting::HostingOptions;
use super::number::positive;
use super::parameters::Parameters;
use crate::console;

/// A part of a communication step below this is rounding.
const LEAST_STEP: f64 = 1e-6;
/// The most communication points of a run.
const MOST_POINTS: f64 = 1e7;

#[derive(clap::Args, Default, Clone)]
pub struct LoopOptions {
    /// Simulate the loop as one continuous system, with --step as the output interval.
    ///
    /// No signal is sampled between components. Results of `run` and `compare` go to LOOP-composite, those of `sweep`
    /// to LOOP-composite-sweep.
    #[arg(long, conflicts_with_all = ["order", "fmus", "accept_algebraic_loops"])]
    pub composite: bool,
    /// Folder with FMUs to use as they are [default: those that the loop names, or new exports]
    ///
    /// By default, FMUs come from where the loop names them, in its resources/ or elsewhere. An FMU that is not there
    /// is generated from its description, either next to the loop or of this package, and exported anew for the run.
    #[arg(long)]
    pub fmus: Option<PathBuf>,
    /// Communication step, s [default: the loop's own]
    #[arg(long, value_parser = positive)]
    pub step: Option<f64>,
    /// Stop time, s [default: the loop's own]
    #[arg(long, value_parser = positive)]
    pub until: Option<f64>,
    /// Order of stepping: gauss-seidel, jacobi or event-mode [default: the loop's own]
    ///
    /// With gauss-seidel, components are stepped one after the other and use the latest outputs. With jacobi, all of
    /// them use the outputs of the last communication point. With event-mode, they exchange values at each communication
    /// point until nothing changes, as far as they are FMUs of FMI 3.0 with Event Mode; it is the default in place of
    /// gauss-seidel where all components have it whose outputs may depend directly on inputs.
    #[arg(long)]
    pub order: Option<Order>,
    /// Allow algebraic loops; each component uses the outputs of the previous exchange
    #[arg(long)]
    pub accept_algebraic_loops: bool,
    /// Add terminalsAndIcons.xml to the FMUs that `explore` stores, as `export --terminals` does
    #[arg(long)]
    pub terminals: bool,
    #[command(flatten)]
    pub parameters: Parameters,
    #[command(flatten)]
    pub hosting: HostingOptions,
    /// True if linear controllers replace the adaptive ones that tend to them.
    #[arg(skip)]
    pub linear: bool,
}

/// Refuses a run that has no points, or too many; it is of a file.
pub fn check_points(Settings { start_time, stop_time, step, .. }: Settings, file: &Path) -> Result<(), Error> {
    let refuse = |reason: String| Error::Loop { file: file.to_owned(), reason };
    if ![start_time, stop_time, step].into_iter().all(f64::is_finite) || step <= 0.0 {
        return Err(refuse(format!(
            "start time {start_time}, stop time {stop_time} and step {step}: must be finite, and the step above 0"
        )));
    }
    if stop_time <= start_time {
        return Err(refuse(format!("stop time {stop_time}: must be after the start time, {start_time}")));
    }
    let points = (stop_time - start_time) / step;
    if (points - LEAST_STEP).ceil() < 1.0 {
        let reason =
            format!("the run from {start_time} s to {stop_time} s is shorter than one communication step of {step} s");
        return Err(refuse(reason));
    }
    if points > MOST_POINTS {
        return Err(refuse(format!(
            "the run would have {points:e} communication points; at most {MOST_POINTS} are allowed"
        )));
    }
    Ok(())
}

/// Source of a loop's FMUs.
pub enum Units {
    /// FMUs in a folder, one each.
    Separate(PathBuf),
    /// Made ready for a program that is served, but for FMUs that come with the loop.
    Ready(Arc<Ready>),
    /// One FMU that takes the values of the loop.
    Whole { fmu: Arc<Fmu>, values: Vec<(String, Value)>, notes: Vec<String> },
}

impl LoopOptions {
    /// The loop with the values that are asked for.
    pub fn structure(&self, files: &LoopFiles) -> Result<Structure, Error> {
        let mut structure = files.structure()?;
        self.parameters.apply(&mut structure, files)?;
        if self.linear {
            structure = linear_limit(&structure)?.unwrap_or(structure);
        }
        if self.fmus.is_some() {
            structure.take_from_folder();
        }
        structure.asked_order = self.order;
        structure.accepts_algebraic_loops |= self.accept_algebraic_loops;
        structure.expected_failure = structure.expected_failure.filter(|it| !(self.composite && it.separate_only));
        Ok(structure)
    }

    /// Refuses a loop, its values or its stepping if they have errors that show without its FMUs; FMUs that are
    /// generated from descriptions are described for it.
    pub fn check(&self, name: &str) -> Result<(), Error> {
        let structure = self.structure(&LoopFiles::find(name)?)?;
        self.settings(&structure)?;
        if self.fmus.is_some() {
            return Ok(());
        }
        check_values(&structure, super::ready::units()?.library())
    }

    /// Start, end and step of a run.
    pub fn settings(&self, structure: &Structure) -> Result<Settings, Error> {
        let settings = Settings {
            start_time: structure.start_time,
            stop_time: self.until.unwrap_or(structure.stop_time),
            step: self.step.unwrap_or(structure.step),
        };
        check_points(settings, &structure.file)?;
        within_run(&structure.events, settings)?;
        Ok(settings)
    }

    /// Relative duration of a run: by its communication points and by how much is exchanged at each. A loop that is
    /// integrated as one system is controlled by a tolerance instead, and counts as longest.
    pub fn effort(&self, structure: &Structure) -> f64 {
        let Ok(Settings { start_time, stop_time, step, .. }) = self.settings(structure) else { return 0.0 };
        let handed = structure.connections.len() as f64 + 1.0;
        let time = stop_time - start_time;
        handed * if self.composite { time * MOST_POINTS } else { time / step }
    }

    /// Origin of a run's numbers.
    pub fn provenance(
        &self,
        name: &str,
        files: &LoopFiles,
        structure: &Structure,
        settings: Settings,
        loaded: &LoadedLoop,
    ) -> Result<Provenance, Error> {
        let case = |name: &PathBuf| {
            let (text, _) = files.case(name)?;
            Ok(Mark { name: name.clone(), checksum: checksum(text) })
        };
        let asked = Asked {
            start_time: settings.start_time,
            stop_time: settings.stop_time,
            step: settings.step,
            order: (!self.composite).then(|| loaded.order().to_string()),
            composite: self.composite,
            accept_algebraic_loops: self.accept_algebraic_loops,
            cases: self.parameters.case.iter().map(case).collect::<Result<_, Error>>()?,
            set: self.parameters.set.clone(),
            events: self.parameters.event.clone(),
            fmus: self.fmus.clone(),
            in_process: self.hosting.in_process,
            patience: self.hosting.patience,
        };
        let elsewhere = |unit: &str| {
            let component = structure.components.iter().find(|component| component.name == unit);
            component.is_some_and(|component| self.fmus.is_some() || !component.is_exported())
        };
        let source = Mark { name: name.into(), checksum: files.checksum(structure)? };
        Ok(Provenance { versions: Versions::own(), source, settings: asked, units: UnitMark::all(loaded, elsewhere)? })
    }

    /// The units of a loop, exported where they don't come with it.
    pub fn units(&self, structure: &Structure) -> Result<Units, Error> {
        if self.composite {
            let ready = super::ready::units()?;
            warn_of(ready.library())?;
            let Whole { source, values, notes } = Whole::new(structure, ready.library())?;
            return Ok(Units::Whole { fmu: ready.fmu(&source)?, values, notes });
        }
        if let Some(fmus) = self.fmus.clone() {
            return Ok(Units::Separate(fmus));
        }
        let ready = super::ready::units()?;
        if !console::serves() {
            warn_of(ready.library())?;
        }
        Ok(Units::Ready(ready))
    }
}

impl Units {
    /// Loads a loop of these FMUs; the signals that it names are recorded in addition to the outputs.
    pub fn load(&self, structure: &Structure, hosting: &Hosting) -> Result<LoadedLoop, Error> {
        let loaded = match self {
            Units::Separate(fmus) => LoadedLoop::new(structure, fmus, hosting)?,
            Units::Ready(ready) => LoadedLoop::of(structure, |component| match component.is_exported() {
                true => ready.fmu(&structure.description_of(&component.fmu)?),
                false => Ok(Arc::new(Fmu::open(&component.path_in(Path::new("")), hosting)?)),
            })?,
            Units::Whole { fmu, values, notes } => {
                LoadedLoop::whole(&structure.name, Arc::clone(fmu), values, notes.clone())?
            }
        };
        loaded.recording(structure.signals()).with_events(&structure.events)
    }
}
