//! A loop with the linear controller that is the limit of its adaptive one.

use crate::error::Error;
use crate::exporter::Source;
use crate::library::{self, REGISTRY};
use crate::model::{Description, Model};
use crate::structure::Structure;
use crate::system::Variables;

/// The loop with the linear controllers that its adaptive ones tend to as adaptation gets fast, each of the same
/// description. None if no controller has such a limit, or a limit refuses the description. Values and metrics of
/// variables that the limit lacks, such as estimates, are left out, and so are the loop's figures.
///
/// # Errors
/// When a component has no description, or one that can't be read.
pub fn linear_limit(structure: &Structure) -> Result<Option<Structure>, Error> {
    let mut limit = structure.clone();
    let mut replaced = Vec::new();
    for component in limit.components.iter_mut().filter(|component| component.is_exported()) {
        let source = structure.description_of(&component.fmu)?;
        let wrong = |reason: String| Error::Loop { file: source.file.clone(), reason };
        let description = Description::read(&source.text).map_err(|error| wrong(error.to_string()))?;
        let Some(kind) = library::limit_of(&description.model) else { continue };
        let Ok((text, variables)) = of_kind(&source.text, kind.kind.name) else { return Ok(None) };
        component.values.retain(|value| is_there(&variables, &value.name));
        // The FMU keeps its name, so all components of this description are replaced.
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

/// The description for another kind, with its variables.
///
/// # Errors
/// When that kind refuses it.
fn of_kind(text: &str, kind: &str) -> Result<(String, Variables), String> {
    let mut table: toml::Table = text.parse().map_err(|error: toml::de::Error| error.to_string())?;
    table.insert("model".to_owned(), kind.into());
    let text = table.to_string();
    let description = Description::read(&text).map_err(|error| error.to_string())?;
    let model = Model::from_description(description, REGISTRY).map_err(|error| error.to_string())?;
    Ok((text, model.variables().clone()))
}

fn is_there(variables: &Variables, name: &str) -> bool {
    variables.find(name).is_some() || variables.iter().any(|variable| variable.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::structure::LoopFiles;

    fn of(name: &str) -> Structure {
        LoopFiles::find(name).unwrap().structure().unwrap()
    }

    #[test]
    fn a_loop_without_such_a_controller_has_no_limit() {
        for name in ["3.3.2-case1", "4-case1-fuzzy", "6.5.1-mrac"] {
            assert_eq!(linear_limit(&of(name)).unwrap(), None, "{name}");
        }
    }

    #[test]
    fn what_the_limit_has_not_is_neither_set_nor_measured_and_all_else_stays() {
        let mut structure = of("3.3.1-case2");
        let own = linear_limit(&structure).unwrap().unwrap();
        let estimate = structure.metrics[0].clone();
        structure.metrics.push(crate::structure::Metric { of: "controller.sigma_hat[1]".to_owned(), ..estimate });
        let controller = structure.components.iter_mut().find(|component| component.name == "controller").unwrap();
        let gain = controller.values[0].clone();
        controller.values.push(crate::structure::StartValue { name: "adaptation_gain".to_owned(), ..gain });
        let limit = linear_limit(&structure).unwrap().unwrap();
        assert_eq!((&limit.metrics, &limit.components), (&own.metrics, &own.components));
        assert_eq!(limit.metrics, of("3.3.1-case2").metrics);
        let described = Description::read(&limit.description_of("L1TwoLinkRobot").unwrap().text).unwrap();
        assert_eq!((described.name.as_str(), described.model.as_str()), ("L1TwoLinkRobot", "l1-limit"));
    }

    #[test]
    fn a_description_that_the_limit_refuses_has_none() {
        let mut structure = of("3.3.1-case2");
        let mut source = structure.description_of("L1TwoLinkRobot").unwrap();
        source.text = source.text.replace("[start]", "[start]\nfeedback_gain_of_another = 1.0");
        structure.descriptions.insert("L1TwoLinkRobot".to_owned(), source);
        assert_eq!(linear_limit(&structure).unwrap(), None);
    }
}
