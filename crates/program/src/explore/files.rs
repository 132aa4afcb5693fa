//! Files of a session: a parameter set, and FMUs that start with its values.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use super::session::{Session, Wanted};
use super::set::plain;
use crate::begun;
use crate::error::Error;
use crate::exporter::{Content, Library};
use crate::output::{self, Files};
use crate::related;
use crate::structure::{Component, started};

/// FMUs that were exported.
#[derive(Debug, serde::Serialize)]
struct Exported {
    folder: String,
    fmus: Vec<String>,
    /// Units whose FMUs come from elsewhere: they keep their start values.
    left_out: Vec<String>,
}

fn wrong(error: Error) -> String {
    error.to_string()
}

/// Reply to a page if a file to be written is there already: the file stays, unless the user wants to replace it.
fn there(place: &Path, wanted: &Wanted) -> Option<Value> {
    let is_there = !wanted.replace && fs::symlink_metadata(begun::path(place)).is_ok();
    is_there.then(|| json!({ "error": format!("{} already exists", place.display()), "isThere": true }))
}

impl Session {
    /// The folder below the one that the user named.
    fn below(&self) -> String {
        format!("{}-explored", self.name())
    }

    /// Writes that set; its file.
    pub(super) fn save(&self, wanted: &Wanted) -> Result<Value, String> {
        let text = self.set(wanted)?;
        let folder = output::make_folder(&self.out, &self.below()).map_err(wrong)?;
        let name = format!("{}.ssv", wanted.name);
        let file = folder.join(&name);
        if let Some(there) = there(&file, wanted) {
            return Ok(there);
        }
        let mut files = Files::at(&folder);
        // Another page may save it at the same time.
        let added = if wanted.replace { files.add(name, text) } else { files.add_new(name, text) };
        added.and_then(|()| files.place()).map_err(wrong)?;
        Ok(json!({ "file": file.to_string_lossy() }))
    }

    /// Writes the FMUs of the loop's units, which start with these values. Where several units are of one FMU, each has a
    /// folder of its own.
    pub(super) fn export(&self, wanted: &Wanted) -> Result<Value, String> {
        let name = plain(&wanted.name)?;
        let (base, values) = self.find(wanted)?;
        let folder = output::make_folder(&self.out, &self.below()).map_err(wrong)?;
        if let Some(there) = there(&folder.join(name), wanted) {
            return Ok(there);
        }
        let mut structure = base.structure.clone();
        for (parameter, value) in values {
            structure.set(&format!("{}={}", parameter.name, parameter.text(&value))).map_err(wrong)?;
        }
        let library = Library::next_to_program().and_then(Library::with_other_platforms).map_err(wrong)?;
        let (exported, left): (Vec<&Component>, Vec<_>) = structure.components.iter().partition(|it| it.is_exported());
        let sources = exported.iter().map(|unit| started(&structure, unit, &library)).collect::<Result<Vec<_>, _>>();
        let sources = sources.map_err(wrong)?;
        let names: BTreeSet<&str> = exported.iter().map(|unit| unit.fmu.as_str()).collect();
        let apart = names.len() < exported.len();
        let folder = output::make_folder(&folder, name).map_err(wrong)?;
        let content = Content { terminals: self.terminals, ..Content::default() };
        let mut fmus = Vec::new();
        for (unit, source) in exported.iter().zip(&sources) {
            let own =
                if apart { output::make_folder(&folder, plain(&unit.name)?).map_err(wrong)? } else { folder.clone() };
            let exported = related::export(source, &library, &own, &content, true).map_err(wrong)?;
            fmus.push(exported.file.to_string_lossy().into_owned());
        }
        let left_out = left.iter().map(|unit| unit.name.clone()).collect();
        Ok(json!(Exported { folder: folder.to_string_lossy().into_owned(), fmus, left_out }))
    }
}
