//! Candidates: a controller of each kind for a plant, as fast as it should be, and the results of its loop.

use std::path::PathBuf;

use super::series::{Course, Followed};
use super::trial::{Noise, NotRun, Trial};
use super::written::Written;
use crate::controllers::l1::L1;
use crate::controllers::observer::Observer;
use crate::error::{Error, Invalid};
use crate::exporter::Source;
use crate::fmu::Ready;
use crate::library;
use crate::model::{Description, Model};
use crate::nominal::WorstPlant;
use crate::plants::reference::Reference;
use crate::plants::state_space::StateSpace;
use crate::report::{DesignReport, Value, number};
use crate::system::System;
use crate::template::{Needs, Plant, Request, Sizes, three_digits};

/// Names of the FMUs of plant and reference.
pub const PLANT: &str = "Plant";
/// See [`PLANT`].
pub const REFERENCE: &str = "Reference";
const OBSERVER: &str = "Observer";
/// Sections and name in a design report.
const NOMINAL: &str = "Nominal loop";
const UNCERTAIN: &str = "Uncertain plants";
const SETTLING: &str = "settling time";
/// Bandwidths for a settling time: the first is `FIRST`/T, each further one is larger by `FACTOR`.
const FIRST: f64 = 4.0;
const STEPS: i32 = 24;
/// Duration of a run in settling times, or in 1/W if none is known.
const LONGER: f64 = 3.0;
const USUAL: f64 = 15.0;
/// Change of an output over the last third of a run, in parts of its step, above which it drifts: a quarter of the band of settling.
const DRIFT: f64 = 0.005;
/// Longest run in the settling times that were asked for; a slower loop isn't run.
const MOST: f64 = 30.0;

/// A kind of controller, or of a controller with an observer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kind {
    /// The name of its kind, after `observer-` if it has one.
    pub name: String,
    controller: &'static str,
    observer: Option<&'static str>,
}

impl Kind {
    /// All kinds for a plant whose states are all measured, or not.
    pub fn all() -> Vec<Self> {
        let of = |needed: Needs| {
            let entries = library::begun().filter(move |entry| entry.template.and_then(|t| t.needs) == Some(needed));
            entries.map(|entry| Kind { name: entry.kind.name.to_owned(), controller: entry.kind.name, observer: None })
        };
        let (observer, controller) = (<Observer as System>::NAME, <L1 as System>::NAME);
        let observed = Kind { name: format!("{observer}-{controller}"), controller, observer: Some(observer) };
        let alone = [Needs::Outputs, Needs::Derivatives, Needs::States].into_iter().flat_map(of);
        alone.chain([observed]).collect()
    }

    /// The signals that it needs.
    fn needs(&self) -> Needs {
        match self.observer {
            Some(_) => Needs::Outputs,
            None => library::find(self.controller).and_then(|entry| entry.template?.needs).unwrap_or(Needs::States),
        }
    }

    /// The name of its FMU: `L1Limit`.
    fn unit(&self) -> String {
        let part = |part: &str| part[..1].to_uppercase() + &part[1..];
        self.name.split('-').map(part).collect()
    }
}

/// Plant and purpose of a controller.
#[derive(Debug, Clone)]
pub struct Task {
    /// The nominal plant; its outputs are the controlled ones.
    pub plant: Plant,
    /// True if all states are measured, otherwise only the outputs.
    pub measures_states: bool,
    /// Settling time of the nominal loop to 2 %, s.
    pub settling_time: Option<f64>,
    /// Bandwidth, rad/s [default: from the settling time].
    pub bandwidth: Option<f64>,
    /// Uncertainty of each entry of A and B, in parts of it; `None` is that of the plant's records.
    pub uncertainty: Option<f64>,
    /// Usual magnitude of the reference of each output.
    pub references: Vec<f64>,
    /// Noise of what is measured.
    pub noise: Vec<Noise>,
}

/// A controller, or the reason why there is none.
#[derive(Debug)]
pub struct Candidate {
    /// Its kind.
    pub kind: Kind,
    /// Its design, or the reason.
    pub outcome: Result<Design, String>,
}

/// Verdict of a design, from its report and its runs, in the order of recommendation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Judged {
    /// It is sound, and all its loops settle.
    Sound,
    /// Its report finds it sound, and not all its loops were simulated.
    NotCompared,
    /// It isn't sound, or a loop fails or doesn't settle.
    NotSound,
}

impl Judged {
    /// The words for it.
    pub fn words(self) -> &'static str {
        match self {
            Judged::Sound => "sound",
            Judged::NotCompared => "not compared",
            Judged::NotSound => "not sound",
        }
    }
}

/// The results of runs of a loop, or the reason why there are none.
pub type Ran = Result<(Followed, Course), NotRun>;

/// A controller for the plant of a task.
#[derive(Debug)]
pub struct Design {
    /// Descriptions of its FMUs, by their names.
    pub texts: Vec<(String, String)>,
    /// Bandwidth that was asked for, rad/s.
    pub bandwidth: f64,
    /// Communication step, s.
    pub step: f64,
    /// Its design report.
    pub report: DesignReport,
    /// Notes of its template.
    pub notes: Vec<String>,
    /// Operations of an evaluation of its equations.
    pub operations: usize,
    /// Result with the nominal plant.
    pub nominal: Ran,
    /// Results with the plants within the uncertainty that are worst for it.
    pub corners: Vec<(WorstPlant, Ran)>,
    /// Standard deviation of each control at rest, if measurements have noise.
    pub noise: Option<Vec<f64>>,
}

/// A description with what is known of it.
struct Begun {
    text: String,
    notes: Vec<String>,
    report: DesignReport,
    operations: usize,
}

/// A controller that was tried, with its observer if it has one.
struct Attempt {
    controller: Begun,
    observer: Option<Begun>,
    /// rad/s.
    bandwidth: f64,
}

impl Task {
    /// The task with signal names that all FMUs of its loop can have, and a note if some differ from the plant's.
    #[must_use]
    pub fn with_names(self) -> (Self, Option<String>) {
        let request = Request {
            kind: <StateSpace as System>::NAME,
            name: PLANT,
            sizes: Sizes::NONE,
            plant: Some(self.plant.clone()),
            bandwidth: None,
            reference: &self.references,
            uncertainty: None,
            experiment: None,
        };
        let renamed = library::named_for_plants(&request).and_then(|(renamed, note)| Some((renamed.plant?, note)));
        match renamed {
            Some((plant, note)) => (Task { plant, ..self }, Some(note)),
            None => (self, None),
        }
    }

    /// The candidate of a kind.
    pub fn candidate(&self, kind: &Kind, units: &Ready) -> Candidate {
        let outcome = self.check(kind).and_then(|()| self.design(kind, units));
        Candidate { kind: kind.clone(), outcome: outcome.map_err(|reason| reason.to_string()) }
    }

    fn check(&self, kind: &Kind) -> Result<(), Error> {
        let refuse = |what: &str| Err(Error::Argument(Invalid::because(format!("needs {what}, which isn't measured"))));
        match kind.needs() {
            Needs::States if !self.measures_states => refuse("every state of the plant"),
            // CB is regular if no derivative is needed.
            Needs::Derivatives if !self.measures_states && !self.is_of_degree_1() => {
                refuse("derivatives of the outputs, or every state of the plant")
            }
            _ => Ok(()),
        }
    }

    fn is_of_degree_1(&self) -> bool {
        let rows = &self.plant.C * &self.plant.B;
        rows.row_iter().all(|row| row.iter().any(|&entry| entry != 0.0))
    }

    fn begin(&self, kind: &str, name: &str, bandwidth: Option<f64>) -> Result<Begun, Error> {
        let is_uncertain = library::find(kind).and_then(|entry| entry.template).is_some_and(|t| t.is_uncertain);
        let request = Request {
            kind,
            name,
            sizes: Sizes::NONE,
            plant: Some(self.plant.clone()),
            bandwidth,
            reference: &self.references,
            uncertainty: self.uncertainty.filter(|_| is_uncertain),
            experiment: None,
        };
        let begun = library::begin(&request).map_err(Error::Argument)?;
        let model = Description::read(&begun.text).and_then(|own| Model::from_description(own, library::REGISTRY));
        let model = model.map_err(Error::Argument)?;
        Ok(Begun { text: begun.text, notes: begun.notes, report: model.report(), operations: model.operations() })
    }

    fn attempt(&self, kind: &Kind, bandwidth: Option<f64>) -> Result<Attempt, Error> {
        let controller = self.begin(kind.controller, &kind.unit(), bandwidth)?;
        let of_design = controller.report.nominal().and_then(|nominal| nominal.bandwidth);
        let bandwidth = bandwidth.or(of_design).unwrap_or(1.0);
        let observer = |observer| self.begin(observer, OBSERVER, Some(bandwidth));
        let observer = kind.observer.map(observer).transpose()?;
        Ok(Attempt { controller, observer, bandwidth })
    }

    /// The first controller whose nominal loop settles in the time that is asked for, otherwise the fastest.
    fn fast_enough(
        &self,
        kind: &Kind,
        time: f64,
        settling: impl Fn(&Attempt) -> Result<f64, Error>,
    ) -> Result<Attempt, Error> {
        let mut fastest: Option<(f64, Attempt)> = None;
        let mut last = f64::INFINITY;
        for k in 0..=STEPS {
            let attempt = self.attempt(kind, Some(three_digits(FIRST / time * 10_f64.powf(f64::from(k) / 8.0))));
            let attempt = match (attempt, &fastest) {
                (Ok(attempt), _) => attempt,
                (Err(reason), None) => return Err(reason),
                (Err(_), Some(_)) => break,
            };
            let settles = settling(&attempt)?;
            if settles <= time {
                return Ok(attempt);
            }
            let is_faster = fastest.as_ref().is_none_or(|(best, _)| settles < *best);
            if is_faster {
                fastest = Some((settles, attempt));
            }
            // If margins limit the speed of a controller, any larger bandwidth gives the same design.
            if settles == last {
                break;
            }
            last = settles;
        }
        let (settles, mut attempt) = fastest.ok_or_else(|| Error::Argument(Invalid::because("none was tried")))?;
        let note = if settles.is_finite() {
            format!("settles in {} s", number(three_digits(settles)))
        } else {
            "doesn't settle".to_owned()
        };
        attempt
            .controller
            .notes
            .insert(0, format!("{} s was asked for; the fastest design found {note}.", number(time)));
        Ok(attempt)
    }

    /// The descriptions of a loop of a controller.
    fn written(&self, kind: &Kind, attempt: &Attempt) -> Result<Written, Error> {
        let own = surroundings(&self.plant, &self.references, attempt.bandwidth, attempt.step())?;
        Ok(Written::new(own.into_iter().chain(attempt.texts(kind))))
    }

    /// The loop of a controller, for so many steps of all references, each of this duration, s.
    fn trial(
        &self,
        kind: &Kind,
        attempt: &Attempt,
        units: &Ready,
        (runs, duration): (usize, f64),
    ) -> Result<Trial, Error> {
        let written = self.written(kind, attempt)?;
        let trial = Trial::new(&written, attempt.step(), &self.plant, &self.references, units)?;
        // An adaptation a thousand times faster than its loop takes minutes.
        Ok(trial.within((runs * self.references.len()) as f64 * duration))
    }

    /// Standard deviations of the controls at rest, if there is noise.
    fn noise(&self, kind: &Kind, attempt: &Attempt, units: &Ready) -> Result<Option<Vec<f64>>, Error> {
        if self.noise.is_empty() {
            return Ok(None);
        }
        let written = (&self.written(kind, attempt)?, attempt.step());
        let trial = Trial::with_noise(written, &self.plant, &self.references, units, &self.noise)?;
        // No reference moves.
        Ok(Some(trial.at_rest(USUAL / attempt.bandwidth).map_err(|reason| reason.error())?.deviations()))
    }

    /// A controller of a kind that is fast enough, with the results of its loop.
    fn design(&self, kind: &Kind, units: &Ready) -> Result<Design, Error> {
        let settling = |attempt: &Attempt| {
            if let Some(time) = found(&attempt.controller.report, NOMINAL, SETTLING) {
                return Ok(time);
            }
            let duration = USUAL / attempt.bandwidth;
            let (followed, _) = self
                .trial(kind, attempt, units, (1, duration))?
                .steps(None, duration)
                .map_err(|reason| reason.error())?;
            Ok(followed.settling.unwrap_or(f64::INFINITY))
        };
        let attempt = match (self.bandwidth, self.settling_time) {
            (None, Some(time)) => self.fast_enough(kind, time, settling)?,
            (bandwidth, _) => self.attempt(kind, bandwidth)?,
        };
        let report = &attempt.controller.report;
        let settles = found(report, UNCERTAIN, SETTLING).or_else(|| found(report, NOMINAL, SETTLING));
        let longest = settles.map_or(USUAL / attempt.bandwidth, |time| LONGER * time);
        let asked = self.settling_time.unwrap_or(FIRST / attempt.bandwidth);
        let duration = longest.min(MOST * asked);
        // A loop that is cut off would seem to be at rest there.
        let too_slow =
            settles.filter(|&time| time > duration).map(|time| format!("settles in {} s", number(three_digits(time))));
        let trial = self.trial(kind, &attempt, units, (1 + report.worst.len(), duration))?;
        let ran = |other: Option<&WorstPlant>| match &too_slow {
            Some(reason) => Err(NotRun::Failed(format!("{reason}, more than {MOST} times the time asked for"))),
            None => trial.steps(other, duration),
        };
        let (nominal, texts) = (ran(None), attempt.texts(kind));
        let corners = report.worst.iter().map(|other| (other.clone(), ran(Some(other)))).collect();
        let noise = if nominal.is_ok() { self.noise(kind, &attempt, units)? } else { None };
        let Attempt { controller, observer, bandwidth } = attempt;
        let operations = controller.operations + observer.map_or(0, |observer| observer.operations);
        let (report, notes) = (controller.report, controller.notes);
        let mut design =
            Design { texts, bandwidth, step: trial.step, report, notes, operations, nominal, corners, noise };
        design.notes.extend(design.drifts());
        Ok(design)
    }
}

/// Descriptions of a plant and of references that step to these sizes at a time, s.
///
/// # Errors
/// When the plant isn't one that an FMU can have.
pub(super) fn surroundings(
    plant: &Plant,
    sizes: &[f64],
    bandwidth: f64,
    step_time: f64,
) -> Result<[(String, String); 2], Error> {
    let plain = |unit: &str, name: &str| {
        let request = Request {
            kind: unit,
            name,
            sizes: Sizes::NONE,
            plant: Some(plant.clone()),
            bandwidth: Some(bandwidth),
            reference: sizes,
            uncertainty: None,
            experiment: None,
        };
        library::begin(&request).map(|begun| begun.text).map_err(Error::Argument)
    };
    let plant = plain(<StateSpace as System>::NAME, PLANT)?;
    let reference = Source::read(PathBuf::from(REFERENCE), plain(<Reference as System>::NAME, REFERENCE)?);
    let of = |(i, size): (usize, &f64)| {
        [(format!("step_time[{},1]", i + 1), step_time), (format!("step_height[{},1]", i + 1), *size)]
    };
    let values: Vec<_> = sizes.iter().enumerate().flat_map(of).collect();
    let reference = reference.with_start(values.iter().map(|(name, value)| (name.as_str(), *value)))?;
    Ok([(PLANT.to_owned(), plant), (REFERENCE.to_owned(), reference.text)])
}

impl Design {
    /// Its loops: with the plants within the uncertainty, then with the nominal one.
    fn loops(&self) -> impl Iterator<Item = &Ran> {
        self.corners.iter().map(|(_, ran)| ran).chain([&self.nominal])
    }

    /// The verdict: sound if its report finds it sound, and all its loops settle.
    pub fn verdict(&self) -> Judged {
        let fails = |ran: &Ran| match ran {
            Ok((followed, _)) => followed.settling.is_none(),
            Err(reason) => matches!(reason, NotRun::Failed(_)),
        };
        if !self.report.is_sound() || self.loops().any(fails) {
            Judged::NotSound
        } else if self.loops().any(Result::is_err) {
            Judged::NotCompared
        } else {
            Judged::Sound
        }
    }

    /// The nominal loop.
    pub fn followed(&self) -> Option<&Followed> {
        self.nominal.as_ref().ok().map(|(followed, _)| followed)
    }

    /// Duration of the nominal loop's run from the step on, s; settling and overshoot relate to its end.
    pub fn duration(&self) -> Option<f64> {
        self.nominal.as_ref().ok()?.1.times.last().copied()
    }

    /// A note if outputs that settle still drift at the end of the runs, so that figures of longer runs differ.
    fn drifts(&self) -> Option<String> {
        let worst = self.worst().or_else(|| self.followed().cloned())?;
        if worst.settling.is_none() || worst.drift <= DRIFT {
            return None;
        }
        let [part, duration] = [100.0 * worst.drift, self.duration()?].map(|value| number(three_digits(value)));
        Some(format!(
            "An output still drifts when the runs end, by up to {part} % of its step in the last third of {duration} s: settling \
             times, ends and peaks of controls differ in longer runs (`run LOOP --until TIME`)."
        ))
    }

    /// The worst of its loops in each respect; `None` where one failed.
    pub fn worst(&self) -> Option<Followed> {
        let followed = |ran: &Ran| ran.as_ref().ok().map(|(followed, _)| followed.clone());
        let nominal = followed(&self.nominal)?;
        self.corners.iter().try_fold(nominal, |worst, (_, ran)| Some(worst.or_worse(&followed(ran)?)))
    }

    /// Reason why it isn't sound, or wasn't compared; none if it is sound.
    pub fn reason(&self) -> Option<String> {
        let mut failed = self.loops().filter_map(|ran| ran.as_ref().err());
        match self.verdict() {
            Judged::Sound => None,
            Judged::NotCompared => {
                let advice = "`check` judges its design, and `run` simulates its loop";
                failed.next().map(|reason| format!("{reason}. {advice}"))
            }
            Judged::NotSound => {
                let of_runs = || failed.find(|reason| matches!(reason, NotRun::Failed(_))).map(NotRun::to_string);
                let reason = self.report.reason().or_else(of_runs);
                Some(reason.unwrap_or_else(|| "a loop within the uncertainty does not settle".to_owned()))
            }
        }
    }

    /// Its margins in words, as far as its report has them.
    pub fn margins(&self) -> String {
        let margin = |name: &str| {
            let found = self.report.findings.iter().find(|finding| finding.name == name)?;
            let Value::Number(value) = found.value else { return None };
            Some(format!("{} {}", number(three_digits(value)), found.unit).trim_end().to_owned())
        };
        let named = [
            ("maximum sensitivity M_s", "M_s"),
            ("phase margin", "phase"),
            ("delay margin", "delay"),
            ("lambda*", "λ*"),
            ("largest error", "funnel"),
        ];
        let all = named.iter().filter_map(|(name, short)| Some(format!("{short} {}", margin(name)?)));
        all.collect::<Vec<_>>().join(", ")
    }
}

impl Attempt {
    /// Communication step, s.
    fn step(&self) -> f64 {
        self.observer.iter().map(|observer| observer.report.step).fold(self.controller.report.step, f64::min)
    }

    fn texts(&self, kind: &Kind) -> Vec<(String, String)> {
        let observer = self.observer.iter().map(|observer| (OBSERVER.to_owned(), observer.text.clone()));
        [(kind.unit(), self.controller.text.clone())].into_iter().chain(observer).collect()
    }
}

/// The settling time of the nominal loop in a design report, s.
pub fn settling_time(report: &DesignReport) -> Option<f64> {
    found(report, NOMINAL, SETTLING)
}

/// A number of a design report.
fn found(report: &DesignReport, section: &str, name: &str) -> Option<f64> {
    let found = report.findings.iter().find(|finding| finding.section == section && finding.name == name)?;
    if let Value::Number(number) = found.value { Some(number) } else { None }
}
