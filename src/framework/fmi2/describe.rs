//! What a library says of itself to the exporter: the XML comes from the very library that is packed, so a stale
//! library can't meet a new description.

use serde::{Deserialize, Serialize};

use crate::error::Invalid;
use crate::execution::Execution;
use crate::model::{Description, Model};
use crate::report::DesignReport;

use super::build::{Build, Library};
use super::model_description;

/// The reply to a description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Described {
    /// How the library was built.
    pub build: Build,
    /// The systems that it knows.
    pub models: Vec<String>,
    /// The unit, where a description was given.
    pub unit: Option<Unit>,
}

/// A unit as its library describes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// Name, and model identifier.
    pub name: String,
    /// modelDescription.xml
    pub model_description: String,
    /// What it is and its equations, in Markdown.
    pub documentation: String,
    /// What its designer should know of its start values.
    pub report: DesignReport,
}

#[derive(Debug, Serialize, Deserialize)]
enum Reply {
    #[serde(rename = "described")]
    Described(Box<Described>),
    #[serde(rename = "failure")]
    Failure(String),
}

/// The reply, as JSON, to a description's text; without one, what the library is.
pub fn reply(description: Option<&str>, library: Library) -> String {
    let describe = |text| -> Result<Unit, Invalid> {
        let model = Model::from_description(Description::read(text)?, library.registry)?;
        model.check_recorded()?;
        let xml = model_description::xml(&model);
        let (name, documentation) = (model.description().name.clone(), model.documentation().to_owned());
        let report = model.report();
        // A unit that can't start from its own start values is not worth packing.
        Execution::new(model).initialise().map_err(Invalid::because)?;
        Ok(Unit { name, model_description: xml, documentation, report })
    };
    match description.map(describe).transpose() {
        Ok(unit) => {
            let models = library.registry.iter().map(|kind| kind.name.to_owned()).collect();
            let build = Build::within(library.build).unwrap_or_default();
            write(&Reply::Described(Box::new(Described { build, models, unit })))
        }
        Err(invalid) => failure(&invalid.to_string()),
    }
}

/// A reply that tells of a failure.
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
        Err(error) => Err(error.to_string()),
    }
}
