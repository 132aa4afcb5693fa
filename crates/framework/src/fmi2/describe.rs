//! A library's description of itself for the exporter: the XML comes from the very library that is packed, so a stale
//! library can't meet a new description.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::error::Invalid;
use crate::execution::Execution;
use crate::model::{Description, Model, Standard};
use crate::reference::{EXPORT_WORK, ReferenceExperiment};
use crate::report::DesignReport;
use crate::system::{Element, Variable};

use super::build::{Build, Library};
use super::kernel::Functions;
use super::{firmware, fmi3, logger, model_description, panics};

/// The reply to a description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Described {
    /// How the library was built.
    pub build: Build,
    /// The systems that it knows.
    pub models: Vec<String>,
    /// The unit, where a description was given.
    pub unit: Option<DescribedUnit>,
}

/// A unit as its library describes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DescribedUnit {
    /// Name, and model identifier.
    pub name: String,
    /// modelDescription.xml of FMI 2.0.
    pub model_description: String,
    /// modelDescription.xml of FMI 3.0, where the description asks for that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model_description_3: Option<String>,
    /// Purpose and equations, in Markdown.
    pub documentation: String,
    /// Design report of its start values.
    pub report: DesignReport,
    /// The model's own name of each variable of the XML, in its order. A user's names replace them.
    #[serde(default)]
    pub declared: Vec<String>,
    /// Its warnings: log categories, and when they are used.
    #[serde(default)]
    pub warnings: Vec<(String, String)>,
}

/// A unit as C source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SourceUnit {
    /// The unit, in which parameters of its design are constants.
    pub unit: DescribedUnit,
    /// The names of these.
    pub designed: Vec<String>,
    /// Its own files: names and texts.
    pub files: Vec<(String, String)>,
}

/// A law that is asked for as C for a target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FirmwareRequest {
    /// The description's text.
    pub description: String,
    /// Options of the export.
    pub options: firmware::Options,
}

#[derive(Debug, Serialize, Deserialize)]
enum Reply {
    #[serde(rename = "described")]
    Described(Box<Described>),
    #[serde(rename = "source")]
    Source(Box<SourceUnit>),
    #[serde(rename = "firmware")]
    Firmware(firmware::Firmware),
    #[serde(rename = "reference")]
    Reference(Box<ReferenceExperiment>),
    #[serde(rename = "kernel")]
    Kernel(Box<Functions>),
    #[serde(rename = "failure")]
    Failure(String),
}

/// Answers a question about a description, for a library.
pub type Answer = fn(Option<&str>, Library) -> String;

/// The answer to a question; a panic on the way is a failure.
pub fn answered(answer: Answer, description: Option<&str>, library: Library) -> String {
    panics::contain(|| answer(description, library))
        .unwrap_or_else(|fault| failure(&format!("internal fault, please report it: {fault}")))
}

/// The reply, as JSON, to a description's text; without one, what the library is.
pub fn reply(description: Option<&str>, library: Library) -> String {
    let describe = |text| unit(Model::from_description(Description::read(text)?, library.registry)?);
    match description.map(describe).transpose() {
        Ok(unit) => {
            let models = library.registry.iter().map(|kind| kind.name.to_owned()).collect();
            let build = Build::within(library.build).unwrap_or_default();
            write(&Reply::Described(Box::new(Described { build, models, unit })))
        }
        Err(invalid) => failure(&invalid.to_string()),
    }
}

/// A model's unit.
fn unit(model: Model) -> Result<DescribedUnit, Invalid> {
    model.check_recorded()?;
    let xml = model_description::xml(&model);
    let is_3 = model.description().standard() == Standard::Fmi3;
    let model_description_3 = is_3.then(|| fmi3::model_description::xml(&model));
    let (name, documentation) = (model.description().name.clone(), model.documentation().to_owned());
    let report = model.report();
    let declared = model.variables().visible().map(declared_name).collect();
    let warnings = logger::categories(&model).map(|(name, text)| (name.to_owned(), text.to_owned()));
    let warnings = warnings.collect();
    // A unit that can't start from its own start values is not worth packing.
    Execution::new(model).initialise().map_err(Invalid::because)?;
    Ok(DescribedUnit { name, model_description: xml, model_description_3, documentation, report, declared, warnings })
}

/// The name that a variable has where no user gives it another.
fn declared_name(element: Element<'_>) -> String {
    if element.variable.given.is_empty() {
        return element.name();
    }
    Variable { given: Vec::new(), ..element.variable.clone() }.element(element.offset).name()
}

/// The reply, as JSON, to a description's text: the unit as C source.
pub fn source(description: Option<&str>, library: Library) -> String {
    let made = || -> Result<SourceUnit, Invalid> {
        let text = description.ok_or_else(|| Invalid::because("a unit's source needs its description"))?;
        let mut description = Description::read(text)?;
        let designed = Model::from_description(description.clone(), library.registry)?.designed_names();
        description.designed = Some(designed.clone());
        let model = Model::from_description(description, library.registry)?;
        let files = super::source::files(&model)?;
        Ok(SourceUnit { unit: unit(model)?, designed, files })
    };
    made().map_or_else(|invalid| failure(&invalid.to_string()), |made| write(&Reply::Source(Box::new(made))))
}

/// The reply, as JSON, to a [`FirmwareRequest`]: the controller as C for a target.
pub fn firmware(request: Option<&str>, library: Library) -> String {
    let made = || -> Result<firmware::Firmware, Invalid> {
        let request: FirmwareRequest = serde_json::from_str(request.unwrap_or_default()).map_err(Invalid::because)?;
        let model = Model::from_description(Description::read(&request.description)?, library.registry)?;
        firmware::files(&Arc::new(model), &request.options)
    };
    made().map_or_else(|invalid| failure(&invalid.to_string()), |made| write(&Reply::Firmware(made)))
}

/// The reply, as JSON, to a description's text: a reference experiment of the unit.
pub fn reference(description: Option<&str>, library: Library) -> String {
    let made = || -> Result<ReferenceExperiment, Invalid> {
        let description = Description::read(description.unwrap_or_default())?;
        let model = Model::from_description(description, library.registry)?;
        ReferenceExperiment::of(&Arc::new(model), EXPORT_WORK).map_err(Invalid::because)
    };
    made().map_or_else(|invalid| failure(&invalid.to_string()), |made| write(&Reply::Reference(Box::new(made))))
}

/// The reply, as JSON, of an instance: what its kernel is compiled from.
pub fn kernel(made: Result<Functions, Invalid>) -> String {
    made.map_or_else(|invalid| failure(&invalid.to_string()), |functions| write(&Reply::Kernel(Box::new(functions))))
}

/// A reply for a failure.
pub fn failure(reason: &str) -> String {
    write(&Reply::Failure(reason.to_owned()))
}

fn write(reply: &Reply) -> String {
    serde_json::to_string(reply).unwrap_or_default()
}

/// Reads a reply: a description, or why there is none.
///
/// # Errors
/// That it is no reply of this version.
pub fn read(reply: &str) -> Result<Result<Described, String>, String> {
    match serde_json::from_str(reply) {
        Ok(Reply::Described(described)) => Ok(Ok(*described)),
        Ok(Reply::Failure(reason)) => Ok(Err(reason)),
        Ok(_) => Err("another reply than a description".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

/// Reads a reply: a unit as C source, or why there is none.
///
/// # Errors
/// As [`read`].
pub fn read_source(reply: &str) -> Result<Result<SourceUnit, String>, String> {
    match serde_json::from_str(reply) {
        Ok(Reply::Source(source)) => Ok(Ok(*source)),
        Ok(Reply::Failure(reason)) => Ok(Err(reason)),
        Ok(_) => Err("another reply than a source".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

/// Reads a reply: a law as C for a target, or why there is none.
///
/// # Errors
/// As [`read`].
pub fn read_firmware(reply: &str) -> Result<Result<firmware::Firmware, String>, String> {
    match serde_json::from_str(reply) {
        Ok(Reply::Firmware(made)) => Ok(Ok(made)),
        Ok(Reply::Failure(reason)) => Ok(Err(reason)),
        Ok(_) => Err("another reply than a law".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

/// Reads a reply: a reference experiment, or why there is none.
///
/// # Errors
/// As [`read`].
pub fn read_reference(reply: &str) -> Result<Result<ReferenceExperiment, String>, String> {
    match serde_json::from_str(reply) {
        Ok(Reply::Reference(experiment)) => Ok(Ok(*experiment)),
        Ok(Reply::Failure(reason)) => Ok(Err(reason)),
        Ok(_) => Err("another reply than a reference experiment".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

/// Reads a reply: what a kernel is compiled from, or why there is none.
///
/// # Errors
/// As [`read`].
pub fn read_kernel(reply: &str) -> Result<Result<Functions, String>, String> {
    match serde_json::from_str(reply) {
        Ok(Reply::Kernel(functions)) if functions.is_known() => Ok(Ok(*functions)),
        Ok(Reply::Kernel(_)) => Err("a kernel of another version".to_owned()),
        Ok(Reply::Failure(reason)) => Ok(Err(reason)),
        Ok(_) => Err("another reply than a kernel".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}
