//! Files of a search: a record to go on from, and parameter sets.

use std::collections::BTreeMap;
use std::path::Path;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};
use serde::{Deserialize, Serialize};

use super::check::check;
use super::{Motion, Objective, Range, Swarm};
use crate::error::Error;
use crate::results::Provenance;
use crate::sealed::{self, Sealed, differing};

/// Problem of a search. A search goes on from a file only if the file has the same problem.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// Name of the loop.
    pub name: String,
    /// True if it is run as a single FMU.
    pub composite: bool,
    /// Communication step, s.
    pub step: f64,
    /// Start and stop time, s.
    pub times: (f64, f64),
    /// Order of the units.
    pub order: String,
    /// Start values that differ from those of the FMUs.
    pub values: BTreeMap<String, String>,
    /// Objective that is minimised.
    pub objective: Objective,
    /// Parameters that are varied.
    pub parameters: Vec<Range>,
    /// Number of particles.
    pub particles: usize,
    /// Motion of the swarm.
    pub motion: Motion,
    /// Seed of its random numbers.
    pub seed: u64,
    /// Parameter sets with which the objective counts, too.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub worst_of: Vec<String>,
    /// Origins of its runs: versions, the loop's files, its FMUs; none in files of an earlier version.
    pub run: Option<Provenance>,
}

/// A search after a whole generation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Its problem.
    pub question: Question,
    /// Progress of the search.
    pub swarm: Swarm,
}

impl Record {
    /// Writes the file; one of an earlier generation is replaced as a whole or not at all.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        sealed::write(file, serde_json::to_value(self).map_err(|error| Error::file(file)(error.into()))?)
    }

    /// Reads the swarm of a file, to go on from it.
    ///
    /// # Errors
    /// When it can't be read, is for another problem, or isn't the state of a search.
    pub fn resume(file: &Path, question: &Question) -> Result<Swarm, Error> {
        let refuse = |reason: String| Error::Loop { file: file.to_owned(), reason };
        let no_search = |error: serde_json::Error| refuse(format!("is not a search that can be continued: {error}"));
        let Sealed { content: record, fits } = sealed::read(file, "search that can be continued")?;
        let asked = serde_json::to_value(question).map_err(no_search)?;
        if let Some(differing) = differing(&record["question"], &asked) {
            return Err(refuse(format!("belongs to another search: {differing}")));
        }
        let changed = |reason| format!("can't be continued: {reason}. The file was changed");
        check(&record["swarm"], question).map_err(changed).map_err(refuse)?;
        // A file of an earlier version has none; each of its values has been checked.
        if fits == Some(false) {
            return Err(refuse(changed("its content doesn't match its checksum".to_owned())));
        }
        let Record { swarm, .. } = serde_json::from_value(record).map_err(no_search)?;
        Ok(swarm)
    }
}

/// Writes a parameter set in the format of SSP (.ssv) with values of Real parameters, and a remark.
///
/// # Errors
/// When it can't be written.
pub fn parameter_set(name: &str, remark: &str, values: &[(&str, f64)]) -> std::io::Result<String> {
    let values: Vec<_> = values.iter().map(|(name, value)| (*name, "Real", value.to_string())).collect();
    typed_set(name, remark, &values)
}

/// Writes a parameter set with values of several types: name, type as SSP names it, and text of each.
///
/// # Errors
/// When it can't be written.
pub fn typed_set(name: &str, remark: &str, values: &[(&str, &str, String)]) -> std::io::Result<String> {
    let mut writer = Writer::new_with_indent(Vec::new(), b' ', 2);
    writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let spaces = [
        ("xmlns:ssv", "http://ssp-standard.org/SSP1/SystemStructureParameterValues"),
        ("name", name),
        ("version", "1.0"),
    ];
    writer.create_element("ssv:ParameterSet").with_attributes(spaces).write_inner_content(|writer| {
        // Two hyphens would end it.
        writer.write_event(Event::Comment(BytesText::from_escaped(format!(" {} ", remark.replace("--", "- -")))))?;
        writer.create_element("ssv:Parameters").write_inner_content(|writer| {
            for (name, kind, text) in values {
                writer.create_element("ssv:Parameter").with_attribute(("name", *name)).write_inner_content(
                    |writer| {
                        let value = writer.create_element(format!("ssv:{kind}"));
                        let value = value.with_attribute(("value", text.as_str()));
                        value.write_empty().map(|_| ())
                    },
                )?;
            }
            Ok(())
        })?;
        Ok(())
    })?;
    Ok(String::from_utf8_lossy(&writer.into_inner()).into_owned() + "\n")
}
