//! The two formats, read: manifests and experiments of FMUs of anybody.

use roxmltree::Node;

use super::{EXPERIMENTS, PARAMETER_SET, TABLE};
use crate::model_description::{attribute, child, elements, xml};

/// Place that a `source` leads to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// To a file of the FMU, by its path in it.
    Inside(String),
    /// To what is read by a scheme, such as https.
    Elsewhere,
    /// Above the root of the FMU.
    Outside,
}

/// A file that a manifest or an experiment names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Its media type.
    pub kind: String,
    /// The text that names it.
    pub source: String,
    pub place: Place,
}

/// A related file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RelatedFile {
    pub file: Named,
    pub role: String,
}

/// An experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    pub name: String,
    pub start: Option<f64>,
    pub stop: Option<f64>,
    pub step: Option<f64>,
    pub tolerance: Option<f64>,
    pub parameters: Option<Named>,
    pub stimuli: Option<Named>,
    pub references: Option<Named>,
}

/// The related files of a manifest in a folder of the FMU.
///
/// # Errors
/// The fault in it.
pub fn manifest(text: &str, folder: &str) -> Result<Vec<RelatedFile>, String> {
    let document = xml::parse(text)?;
    let root = document.root_element();
    if root.tag_name().name() != "fmiReferences" {
        return Err(format!("its root is `{}`, and must be fmiReferences", root.tag_name().name()));
    }
    let related = |node: Node| {
        let role = node.attribute("role").ok_or("a Related has no role")?;
        Ok(RelatedFile { file: named(node, folder, "application/octet-stream")?, role: role.to_owned() })
    };
    elements(root, "Related").map(related).collect()
}

/// The experiments of a file in a folder of the FMU that are runs over time.
///
/// # Errors
/// The fault in it.
pub fn experiments(text: &str, folder: &str) -> Result<Vec<Experiment>, String> {
    let document = xml::parse(text)?;
    let root = document.root_element();
    if root.tag_name().name() != "Experiments" {
        return Err(format!("its root is `{}`, and must be Experiments", root.tag_name().name()));
    }
    let others = ["SteadyState", "ParameterOptimization", "SetPointOptimization", "SensitivityAnalysis"];
    let others = others.into_iter().chain(["TrajectoryOptimization", "Linearization"]);
    let is_run = |node: &Node| others.clone().all(|kind| child(*node, kind).is_none());
    elements(root, "Experiment").filter(is_run).map(|node| experiment(node, folder)).collect()
}

fn experiment(node: Node, folder: &str) -> Result<Experiment, String> {
    let name = attribute(node, "name").ok_or("an Experiment has no name")?;
    // A later draft has times in an element of their own.
    let times = child(node, "TransientSimulation");
    let number = |key: &str| {
        let text = attribute(node, key).or_else(|| times.and_then(|node| attribute(node, key)));
        let read = |text: String| match text.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!("{key} = {text} of the experiment `{name}` must be a finite number")),
        };
        text.map(read).transpose()
    };
    let file = |key: &'static str, kind| child(node, key).map(|node| named(node, folder, kind)).transpose();
    Ok(Experiment {
        start: number("startTime")?,
        stop: number("stopTime")?,
        step: number("stepSize")?,
        tolerance: number("tolerance")?,
        parameters: file("Parameters", PARAMETER_SET)?,
        stimuli: file("Stimuli", TABLE)?,
        references: file("References", TABLE)?,
        name,
    })
}

/// True if a media type is that of experiments: one example of the format has another word in it.
pub fn is_experiments(kind: &str) -> bool {
    [EXPERIMENTS, "application/x-ma-ls-experiments"].contains(&kind)
}

fn named(node: Node, folder: &str, usual: &str) -> Result<Named, String> {
    let source = node.attribute("source").ok_or_else(|| format!("a {} has no source", node.tag_name().name()))?;
    let kind = node.attribute("type").unwrap_or(usual).to_owned();
    Ok(Named { kind, source: source.to_owned(), place: resolved(folder, source) })
}

/// Place of a URI that is relative to a folder of the FMU.
fn resolved(folder: &str, source: &str) -> Place {
    let scheme = source.split_once(':').map(|(scheme, _)| scheme);
    let letter = |c: char| c.is_ascii_alphanumeric() || "+-.".contains(c);
    // A drive is no scheme.
    if scheme.is_some_and(|scheme| scheme.len() > 1 && scheme.chars().all(letter)) {
        return Place::Elsewhere;
    }
    let Some(path) = decoded(source.split(['?', '#']).next().unwrap_or_default()) else { return Place::Outside };
    if path.starts_with('/') || path.contains(['\\', ':', '\0']) {
        return Place::Outside;
    }
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                if parts.pop().is_none() {
                    return Place::Outside;
                }
            }
            part => parts.push(part),
        }
    }
    Place::Inside(parts.join("/"))
}

/// A path without its percent signs; none where these are broken.
fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let mut digit = || rest.next().and_then(|digit| char::from(digit).to_digit(16));
        let (high, low) = (digit()?, digit()?);
        bytes.push((16 * high + low) as u8);
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_resolved_from_its_folder_and_never_above_the_root() {
        let inside = |path: &str| Place::Inside(path.to_owned());
        for (source, place) in [
            ("a.csv", inside("extra/ref/a.csv")),
            ("./b/a%20b.csv", inside("extra/ref/b/a b.csv")),
            ("../../documentation/index.html#report", inside("documentation/index.html")),
            ("../../../a.csv", Place::Outside),
            ("x/../../../../a.csv", Place::Outside),
            ("%2e%2e/../../a.csv", Place::Outside),
            ("/etc/passwd", Place::Outside),
            ("..\\..\\a.csv", Place::Outside),
            ("C:/a.csv", Place::Outside),
            ("a%2", Place::Outside),
            ("https://example.org/a.csv", Place::Elsewhere),
            ("file:///etc/passwd", Place::Elsewhere),
        ] {
            assert_eq!(resolved("extra/ref", source), place, "{source}");
        }
    }

    #[test]
    fn both_drafts_of_the_experiments_format_are_read() {
        let first = "<Experiments name='e'><Experiment name='a' startTime='1' stopTime='2.5' tolerance='1e-3' stepSize='0.1'>\
                     <Stimuli source='in.csv'/><References source='out.csv'/></Experiment></Experiments>";
        let later = "<Experiments name='e'><Experiment name='a' tolerance='1e-3'><TransientSimulation startTime='1' stopTime='2.5' \
                     stepSize='0.1'/><Stimuli source='in.csv'/><References source='out.csv'/></Experiment>\
                     <Experiment name='b'><SteadyState/></Experiment></Experiments>";
        let [first, later] = [first, later].map(|text| experiments(text, "extra").unwrap());
        assert_eq!(first, later);
        let times = (first[0].start, first[0].stop, first[0].step, first[0].tolerance);
        assert_eq!(times, (Some(1.0), Some(2.5), Some(0.1), Some(1e-3)));
        assert_eq!(first[0].references.as_ref().unwrap().place, Place::Inside("extra/out.csv".to_owned()));
        assert!(experiments("<Experiments><Experiment name='a' stopTime='inf'/></Experiments>", "").is_err());
    }
}
