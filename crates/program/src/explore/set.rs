//! The parameter set of the chosen values.

use std::collections::BTreeMap;

use super::parameters::written;
use super::session::{Session, Wanted};
use crate::fmu::Value;
use crate::tuning::typed_set;

/// The longest name of a set.
const LONGEST: usize = 60;

/// Checks that any system allows this file name: letters, digits, `_`, `-`, spaces and dots, none in front.
pub(super) fn plain(name: &str) -> Result<&str, String> {
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
    /// The parameter set of all differences from the loop of the files, for `run --case`.
    pub(crate) fn set(&self, wanted: &Wanted) -> Result<String, String> {
        let name = plain(&wanted.name)?;
        let (base, values) = self.find(wanted)?;
        let moved: BTreeMap<&str, &Value> = values.iter().map(|(it, value)| (it.name.as_str(), value)).collect();
        let mut entries = Vec::new();
        for (name, place, variable) in base.loaded.variables() {
            // Variables without a component belong to the composite only.
            if base.structure.unit_of(&name).is_none() {
                continue;
            }
            let value = moved.get(name.as_str()).copied().or_else(|| base.loaded.given(place));
            let Some(value) = value.filter(|value| self.plain.get(&name) != Some(value)) else { continue };
            let (kind, text) = written(value, &variable.items);
            entries.push((name, kind, text));
        }
        let entries: Vec<_> = entries.iter().map(|(name, kind, text)| (name.as_str(), *kind, text.clone())).collect();
        let remark = format!("Values of {} chosen on its page.", base.structure.name);
        typed_set(name, &remark, &entries).map_err(|error| error.to_string())
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
