//! A loop with the linear controller that its adaptive one tends to.

use crate::error::Error;
use crate::exporter::Source;
use crate::library::{self, REGISTRY};
use crate::model::{Description, Model};
use crate::simulation::Structure;
use crate::system::Variables;

/// The loop with the linear controllers that its adaptive ones tend to as their adaptation gets fast, each of the same
/// description; none where no controller of it has such a limit. What is set or measured of a controller and isn't there in
/// its limit, as an estimate, is left out, and so are the loop's figures.
///
/// # Errors
/// When a unit has no description, or its limit is refused.
pub fn linear_limit(structure: &Structure) -> Result<Option<Structure>, Error> {
    let mut limit = structure.clone();
    let mut replaced = Vec::new();
    for component in limit.components.iter_mut().filter(|component| component.is_exported()) {
        let source = structure.description_of(&component.fmu)?;
        let wrong = |reason: String| Error::Loop { file: source.file.clone(), reason };
        let description = Description::read(&source.text).map_err(|error| wrong(error.to_string()))?;
        let Some(kind) = library::limit_of(&description.model) else { continue };
        let (text, variables) = of_kind(&source.text, kind.kind.name).map_err(wrong)?;
        component.values.retain(|value| is_there(&variables, &value.name));
        component.fmu.push_str("Linear");
        limit.descriptions.insert(component.fmu.clone(), Source { file: source.file, text, as_written: false });
        replaced.push((format!("{}.", component.name), variables));
    }
    if replaced.is_empty() {
        return Ok(None);
    }
    let remains = |signal: &str| {
        let of = replaced.iter().find_map(|(prefix, variables)| Some((signal.strip_prefix(prefix)?, variables)));
        of.is_none_or(|(name, variables)| is_there(variables, name))
    };
    limit
        .metrics
        .retain(|metric| [Some(&metric.of), metric.minus.as_ref()].into_iter().flatten().all(|it| remains(it)));
    limit.plots.clear();
    limit.expected_failure = None;
    Ok(Some(limit))
}

/// A description as one of another kind, with its variables.
fn of_kind(text: &str, kind: &str) -> Result<(String, Variables), String> {
    let mut table: toml::Table = text.parse().map_err(|error: toml::de::Error| error.to_string())?;
    table.insert("model".to_owned(), kind.into());
    if let Some(name) = table.get_mut("name") {
        *name = format!("{}Linear", name.as_str().unwrap_or_default()).into();
    }
    let text = table.to_string();
    let description = Description::read(&text).map_err(|error| error.to_string())?;
    let variables = Model::variables_of(&description, REGISTRY).map_err(|error| error.to_string())?;
    Ok((text, variables))
}

fn is_there(variables: &Variables, name: &str) -> bool {
    variables.find(name).is_some() || variables.iter().any(|variable| variable.name == name)
}
