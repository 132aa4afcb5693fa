//! A short run, as any master makes it: what a unit answers, and whether the numbers are some.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

use super::Interfaces;
use super::archive::Archive;
use super::findings::{At, Findings};
use crate::error::Error;
use crate::exporter::Platform;
use crate::fmi2::calls::Function;
use crate::fmu::{Fmu, Hosting, Instance};
use crate::model_description::Variable;

/// Communication steps of a trial, at most.
const STEPS: usize = 20;
/// How far a start value may be off that of the file, in parts of it: tools write few digits.
const ROUNDING: f64 = 1e-6;

/// How an FMU was run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Trial {
    /// So many communication steps, and an instance for model exchange where it is for that.
    Ran(usize),
    /// It was to be checked without being run.
    NotAskedFor,
    /// Something is wrong with it already.
    Unsound,
    /// Why it can't be run here.
    Impossible(String),
}

/// Runs an FMU with whose description and libraries nothing is wrong; the FMU, where it could be opened.
pub(super) fn run(
    file: &Path,
    hosting: &Hosting,
    archive: &Archive,
    interfaces: &Interfaces,
    findings: &mut Findings,
) -> (Trial, Option<Arc<Fmu>>) {
    let impossible = |reason: &str| (Trial::Impossible(reason.to_owned()), None);
    let Some(co_simulation) = &interfaces.co_simulation else {
        return impossible("it supports model exchange only; trial runs need co-simulation");
    };
    if co_simulation.is("needsExecutionTool") {
        return impossible("it needs the tool that exported it");
    }
    if !archive.has_library(&Platform::own(), findings.standard, &co_simulation.identifier) {
        return impossible("it has no library for this platform");
    }
    let fmu = match Fmu::open(file, hosting) {
        Ok(fmu) => Arc::new(fmu),
        Err(error) => {
            let advice = "pack a library without missing dependencies, or put its dependencies next to it";
            findings.error(At::line(co_simulation.line), error.to_string(), "2.3", advice);
            return impossible("it can't be loaded");
        }
    };
    let mut trial = Attempt { fmu: &fmu, interfaces, findings, seen: HashSet::new(), steps: 0 };
    let steps_vary = co_simulation.is("canHandleVariableCommunicationStepSize");
    let ended = trial.co_simulate(!co_simulation.is("canBeInstantiatedOnlyOncePerProcess"), steps_vary);
    let ended = ended.and_then(|()| {
        let same = interfaces.exchange.as_ref().filter(|exchange| exchange.identifier == co_simulation.identifier);
        same.map_or(Ok(()), |_| trial.exchange())
    });
    let steps = trial.steps;
    if let Err((section, error)) = ended {
        let advice = format!("a call that the standard allows here must return {}OK", findings.standard.prefix());
        findings.error(At::nowhere(), error.to_string(), section, advice);
    }
    (Trial::Ran(steps), Some(fmu))
}

/// The section about what failed, and what failed.
type Failed = (&'static str, Error);

struct Attempt<'a> {
    fmu: &'a Arc<Fmu>,
    interfaces: &'a Interfaces,
    findings: &'a mut Findings,
    /// The variables that something was found of: it would be found in each step.
    seen: HashSet<usize>,
    steps: usize,
}

impl Attempt<'_> {
    fn co_simulate(&mut self, twice: bool, steps_vary: bool) -> Result<(), Failed> {
        let Interfaces { start, stop, .. } = *self.interfaces;
        let mut first = self.fmu.instantiate("first").map_err(in_section("2.1.5"))?;
        let second = twice.then(|| self.fmu.instantiate("second")).transpose().map_err(in_section("2.1.5"))?;
        first.enter_initialization(start, stop).map_err(in_section("2.1.6"))?;
        first.exit_initialization().map_err(in_section("2.1.6"))?;
        // Before, only outputs, states and derivatives may be read.
        self.check_starts(&first)?;
        self.check_values(&first, start)?;
        self.make_steps(&mut first, steps_vary)?;
        first.terminate().map_err(in_section("2.1.6"))?;
        let Some(mut second) = second else { return Ok(()) };
        // The end of one instance is not that of another.
        drop(first);
        second.enter_initialization(start, stop).map_err(in_section("2.1.6"))?;
        second.exit_initialization().map_err(in_section("2.1.6"))?;
        self.check_values(&second, start)?;
        second.terminate().map_err(in_section("2.1.6"))
    }

    /// Steps of the default experiment. The last one is shorter where it must be and the unit can make it.
    fn make_steps(&mut self, instance: &mut Instance, steps_vary: bool) -> Result<(), Failed> {
        let Interfaces { start, stop, step, .. } = *self.interfaces;
        let mut time = start;
        while self.steps < STEPS && time < stop - 1e-9 * step {
            let whole = start + (self.steps + 1) as f64 * step;
            let next = if steps_vary { whole.min(stop) } else { whole };
            // A step may also be lost in the rounding of a large time.
            if next > stop + 1e-9 * step || next <= time {
                break;
            }
            let length = if steps_vary { next - time } else { step };
            instance.do_step(time, length).map_err(in_section("4.2.2"))?;
            self.check_values(instance, next)?;
            time = next;
            self.steps += 1;
        }
        Ok(())
    }

    fn exchange(&mut self) -> Result<(), Failed> {
        let Interfaces { start, stop, states, .. } = *self.interfaces;
        let mut instance = self.fmu.instantiate_for_exchange("exchange").map_err(in_section("2.1.5"))?;
        instance.enter_initialization(start, stop).map_err(in_section("2.1.6"))?;
        instance.exit_initialization().map_err(in_section("2.1.6"))?;
        instance.finish_event().map_err(in_section("3.2.2"))?;
        self.check_values(&instance, start)?;
        if states > 0 {
            let values = instance.states(states).map_err(in_section("3.2.2"))?;
            let rates = instance.state_derivatives(states).map_err(in_section("3.2.2"))?;
            let names = [Function::GetContinuousStates, Function::GetDerivatives];
            let fmi = self.findings.standard.prefix();
            let names = names.map(|function| function.name_in(self.findings.standard));
            for (name, numbers) in names.into_iter().zip([values, rates]) {
                if let Some(place) = numbers.iter().position(|number| !number.is_finite()) {
                    let what = format!("{name} returned {} for state {}", numbers[place], place + 1);
                    self.findings.error(
                        At::nowhere(),
                        what,
                        "3.2.2",
                        format!("return finite numbers, or a status other than {fmi}OK"),
                    );
                }
            }
        }
        instance.terminate().map_err(in_section("2.1.6"))
    }

    /// When Initialization Mode is left, values that a master sets have the start value in the file.
    fn check_starts(&mut self, instance: &Instance) -> Result<(), Failed> {
        let values = self.values(instance)?;
        for (place, value) in values {
            let variable = &self.fmu.description.variables[place];
            if !matches!(variable.causality.as_str(), "parameter" | "input") {
                continue;
            }
            let Some(start) = variable.start.as_deref().and_then(|text| number(variable, text)) else { continue };
            let near = value.is_finite() && start.is_finite() && (value - start).abs() <= ROUNDING * start.abs();
            let same = near || value == start || (value.is_nan() && start.is_nan());
            if !same {
                let what = format!("it starts at {value}, but modelDescription.xml has start = {start}");
                self.error(place, what, "2.2.7", "use the same value in both");
            }
        }
        Ok(())
    }

    fn check_values(&mut self, instance: &Instance, time: f64) -> Result<(), Failed> {
        let (values, fmi) = (self.values(instance)?, self.findings.standard.prefix());
        for (place, value) in values {
            let variable = &self.fmu.description.variables[place];
            if !value.is_finite() {
                let what = format!("its value is {value} at t = {time} s, returned with {fmi}OK");
                let advice = format!("return a finite number, or a status other than {fmi}OK");
                if variable.causality == "output" || self.interfaces.state_places.contains(&place) {
                    self.error(place, what, "2.1.7", &advice);
                } else if self.seen.insert(place) {
                    self.findings.warning(At::named(None, &variable.name), what, "2.1.7", advice);
                }
                continue;
            }
            if variable.kind == "Boolean" && value != 0.0 && value != 1.0 {
                let what = format!("its value is {value} at t = {time} s");
                self.error(place, what, "2.1.2", &format!("a Boolean must be {fmi}True (1) or {fmi}False (0)"));
                continue;
            }
            let limit = |text: &Option<String>| text.as_deref().and_then(|text| text.trim().parse::<f64>().ok());
            let (least, most) = (limit(&variable.min), limit(&variable.max));
            let outside = least.is_some_and(|least| value < least) || most.is_some_and(|most| value > most);
            if outside && self.seen.insert(place) {
                let (least, most) = (least.unwrap_or(f64::NEG_INFINITY), most.unwrap_or(f64::INFINITY));
                let what = format!("its value is {value} at t = {time} s, outside its limits {least} … {most}");
                self.findings.warning(
                    At::named(None, &variable.name),
                    what,
                    "2.2.7",
                    "stay within the limits, or declare the actual ones",
                );
            }
        }
        Ok(())
    }

    fn error(&mut self, place: usize, what: String, section: &'static str, advice: &str) {
        if self.seen.insert(place) {
            let name = &self.fmu.description.variables[place].name;
            self.findings.error(At::named(None, name), what, section, advice);
        }
    }

    /// All values but texts, by the places of their variables.
    fn values(&self, instance: &Instance) -> Result<Vec<(usize, f64)>, Failed> {
        let variables = self.fmu.description.variables.iter().enumerate();
        let of = |kinds: &[&str]| -> (Vec<usize>, Vec<u32>) {
            let found = variables.clone().filter(|(_, variable)| kinds.contains(&variable.kind.as_str()));
            found.map(|(place, variable)| (place, variable.reference)).unzip()
        };
        let failed = in_section("2.1.7");
        let (places, references) = of(&["Real"]);
        let mut reals = vec![0.0; references.len()];
        if !references.is_empty() {
            instance.get_any_real(&references, &mut reals).map_err(failed)?;
        }
        let mut values: Vec<_> = places.into_iter().zip(reals).collect();
        for (kinds, boolean) in [(&["Integer", "Enumeration"][..], false), (&["Boolean"], true)] {
            let (places, references) = of(kinds);
            let mut whole = vec![0; references.len()];
            if references.is_empty() {
                continue;
            }
            let got = if boolean {
                instance.get_boolean(&references, &mut whole)
            } else {
                instance.get_integer(&references, &mut whole)
            };
            got.map_err(in_section("2.1.7"))?;
            values.extend(places.into_iter().zip(whole.into_iter().map(f64::from)));
        }
        Ok(values)
    }
}

/// A start value as a number.
fn number(variable: &Variable, text: &str) -> Option<f64> {
    match (variable.kind.as_str(), text.trim()) {
        ("String", _) => None,
        ("Boolean", "true") => Some(1.0),
        ("Boolean", "false") => Some(0.0),
        (_, text) => text.parse().ok(),
    }
}

fn in_section(section: &'static str) -> impl Fn(Error) -> Failed {
    move |error| (section, error)
}
