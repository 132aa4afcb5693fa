//! What is kept of a session: a parameter set, and FMUs that start with its values.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use super::parameters::written;
use super::session::{Session, Wanted};
use crate::error::Error;
use crate::exporter::{self, Library};
use crate::output;
use crate::simulation::{Component, Value, started};
use crate::tuning::typed_set;

/// The longest name of a set.
const LONGEST: usize = 60;

/// FMUs that were exported.
#[derive(Debug, serde::Serialize)]
pub(super) struct Exported {
    folder: PathBuf,
    fmus: Vec<PathBuf>,
    /// Units whose FMUs come from elsewhere: they keep their start values.
    left_out: Vec<String>,
}

/// A name that a file may have on any system: letters, digits, `_`, `-`, spaces and dots, none in front.
fn plain(name: &str) -> Result<&str, String> {
    let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || "_-. ".contains(c));
    if name.is_empty()
        || name.len() > LONGEST
        || !is_plain
        || name.starts_with(['.', ' '])
        || name.ends_with(['.', ' '])
    {
        return Err(format!(
            "`{name}` must be 1 to {LONGEST} letters, digits, _, -, spaces and dots, with no dot at either end"
        ));
    }
    Ok(name)
}

impl Session {
    /// The folder below the one that the user named.
    fn below(&self) -> String {
        format!("{}-explored", self.name())
    }

    /// The parameter set of what differs from the loop as its files have it, with which `run --case` runs it.
    pub(super) fn set(&self, wanted: &Wanted) -> Result<String, String> {
        let name = plain(&wanted.name)?;
        let (base, values) = self.find(wanted)?;
        let moved: BTreeMap<&str, &Value> = values.iter().map(|(it, value)| (it.name.as_str(), value)).collect();
        let mut kept = Vec::new();
        for (name, place, variable) in base.loaded.variables() {
            // What has no unit is of the loop as one unit alone.
            if base.structure.unit_of(&name).is_none() {
                continue;
            }
            let value = moved.get(name.as_str()).copied().or_else(|| base.loaded.given(place));
            let Some(value) = value.filter(|value| self.plain.get(&name) != Some(value)) else { continue };
            let (kind, text) = written(value, &variable.items);
            kept.push((name, kind, text));
        }
        let kept: Vec<_> = kept.iter().map(|(name, kind, text)| (name.as_str(), *kind, text.clone())).collect();
        let remark = format!("Values of {} that were chosen in its page.", base.structure.name);
        typed_set(name, &remark, &kept).map_err(|error| error.to_string())
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

#[cfg(test)]
mod tests {
    use super::plain;

    #[test]
    fn a_name_leads_to_no_other_folder() {
        for name in ["", ".", "..", "../x", "a/b", "a\\b", "/etc/x", ".hidden", "a.", "c:x", "ä", "a\nb", " a"] {
            assert!(plain(name).is_err(), "{name}");
        }
        assert!(plain(&"a".repeat(61)).is_err());
        assert!(plain("fast 2.5").is_ok() && plain("a").is_ok());
    }
}
