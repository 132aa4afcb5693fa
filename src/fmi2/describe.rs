//! What a library says of itself to the exporter: the XML comes from the very library that is packed, so a stale
//! library can't meet a new description.

use serde::{Deserialize, Serialize};

use crate::error::Invalid;
use crate::execution::Execution;
use crate::model::{Description, Model};
use crate::report::DesignReport;
use crate::system::Registry;

use super::model_description;

/// How a library was built.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Build {
    /// Name and version of the package that holds the models.
    pub package: String,
    /// Version of this crate.
    pub version: String,
    /// Target platform.
    pub target: String,
    /// Compiler.
    pub compiler: String,
    /// Checksum of this crate's sources.
    pub source: String,
    /// Whether it was optimised.
    pub optimised: bool,
}

impl Build {
    /// Of this very library, with the models of a package.
    fn own(package: &str) -> Self {
        Build {
            package: package.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            target: env!("ADAPTIVE_FMU_TARGET").to_owned(),
            compiler: env!("ADAPTIVE_FMU_COMPILER").to_owned(),
            source: env!("ADAPTIVE_FMU_SOURCE").to_owned(),
            optimised: !cfg!(debug_assertions),
        }
    }
}

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

/// The reply, as JSON, to a description's text; without one, what the library is: that of a package.
pub fn reply(description: Option<&str>, registry: Registry, package: &str) -> String {
    let describe = |text| -> Result<Unit, Invalid> {
        let model = Model::from_description(Description::read(text)?, registry)?;
        let xml = model_description::xml(&model);
        let (name, documentation) = (model.description().name.clone(), model.documentation().to_owned());
        let report = model.report();
        // A unit that can't start from its own start values is not worth packing.
        Execution::new(model).initialise().map_err(Invalid::because)?;
        Ok(Unit { name, model_description: xml, documentation, report })
    };
    match description.map(describe).transpose() {
        Ok(unit) => {
            let models = registry.iter().map(|kind| kind.name.to_owned()).collect();
            write(&Reply::Described(Box::new(Described { build: Build::own(package), models, unit })))
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
