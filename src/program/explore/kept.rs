//! What is written of a session: a parameter set, and FMUs that start with its values.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::session::{Session, Wanted};
use super::set::plain;
use crate::error::Error;
use crate::exporter::{self, Library};
use crate::output;
use crate::simulation::{Component, started};

/// FMUs that were exported.
#[derive(Debug, serde::Serialize)]
pub(super) struct Exported {
    folder: PathBuf,
    fmus: Vec<PathBuf>,
    /// Units whose FMUs come from elsewhere: they keep their start values.
    left_out: Vec<String>,
}

impl Session {
    /// The folder below the one that the user named.
    fn below(&self) -> String {
        format!("{}-explored", self.name())
    }

    /// Writes that set; its file.
    pub(super) fn save(&self, wanted: &Wanted) -> Result<PathBuf, String> {
        let text = self.set(wanted)?;
        let told = |error: Error| error.to_string();
        let folder = output::make_folder(&self.out, &self.below()).map_err(told)?;
        let file = folder.join(format!("{}.ssv", wanted.name));
        output::write(&file, text).map_err(told)?;
        Ok(file)
    }

    /// Writes the FMUs of the loop's units, which start with these values. Where several units are of one FMU, each has a
    /// folder of its own.
    pub(super) fn export(&self, wanted: &Wanted) -> Result<Exported, String> {
        let name = plain(&wanted.name)?;
        let (base, values) = self.find(wanted)?;
        let told = |error: Error| error.to_string();
        let mut structure = base.structure.clone();
        for (parameter, value) in values {
            structure.set(&format!("{}={}", parameter.name, parameter.text(&value))).map_err(told)?;
        }
        let library = Library::beside_program().and_then(Library::with_other_platforms).map_err(told)?;
        let (exported, left): (Vec<&Component>, Vec<_>) = structure.components.iter().partition(|it| it.is_exported());
        let sources = exported.iter().map(|unit| started(&structure, unit, &library)).collect::<Result<Vec<_>, _>>();
        let sources = sources.map_err(told)?;
        let names: BTreeSet<&str> = exported.iter().map(|unit| unit.fmu.as_str()).collect();
        let apart = names.len() < exported.len();
        let folder = output::make_folder(&self.out, &self.below()).map_err(told)?;
        let folder = output::make_folder(&folder, name).map_err(told)?;
        let mut fmus = Vec::new();
        for (unit, source) in exported.iter().zip(&sources) {
            let own =
                if apart { output::make_folder(&folder, plain(&unit.name)?).map_err(told)? } else { folder.clone() };
            fmus.push(exporter::export(source, &library, &own).map_err(told)?);
        }
        Ok(Exported { folder, fmus, left_out: left.iter().map(|unit| unit.name.clone()).collect() })
    }
}
