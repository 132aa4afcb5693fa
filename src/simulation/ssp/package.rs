//! Packing a loop as an .ssp archive that other masters read too.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use roxmltree::Node;

use super::files::LoopFiles;
use super::reader::parse;
use super::{STRUCTURE, Structure};
use crate::error::Error;
use crate::exporter::{read_entry, write_entries};
use crate::simulation::check::check;
use crate::simulation::description::{Description, child, elements};

/// Namespaces that the annotations below stand in. Other masters read prefixes as they stand, and some take an
/// attribute for an element: so they are declared in the root.
const NAMESPACES: [(&str, &str); 4] = [
    ("ssd", "http://ssp-standard.org/SSP1/SystemStructureDescription"),
    ("ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon"),
    ("oms", "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"),
    ("osp", "http://opensimulationplatform.com/SSP/OSPAnnotations"),
];

/// Writes `NAME.ssp` into a folder: the structure, the parameter files and the FMUs of another folder. The same files
/// always give the same bytes. Answers its path, and what other masters will leave out.
///
/// # Errors
/// When the loop and its FMUs don't fit each other, or files are missing or can't be written.
pub fn pack(files: &LoopFiles, fmus: &Path, out: &Path) -> Result<(PathBuf, Vec<String>), Error> {
    let structure = files.structure()?;
    let mut warnings = left_out(&structure, fmus)?;
    warnings.extend(overlooked(files)?);
    let mut entries = vec![(STRUCTURE.to_owned(), for_other_masters(files, &structure)?.into_bytes())];
    let sets: BTreeSet<String> = files.parameter_files().into_iter().chain(structure.parameter_files).collect();
    for name in sets {
        let text = files.read(&name)?;
        entries.push((name, text.into_bytes()));
    }
    let units: BTreeSet<&String> = structure.components.iter().map(|component| &component.fmu).collect();
    for unit in units {
        let file = fmus.join(format!("{unit}.fmu"));
        entries.push((format!("resources/{unit}.fmu"), std::fs::read(&file).map_err(Error::file(&file))?));
    }
    let entries: Vec<(&str, &[u8])> = entries.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    std::fs::create_dir_all(out).map_err(Error::file(out))?;
    let file = out.join(format!("{}.ssp", structure.name));
    write_entries(&file, &entries)?;
    Ok((file, warnings))
}

/// Checks the loop; start values of enumerations, which ecos, libcosim and OMSimulator don't set.
fn left_out(structure: &Structure, fmus: &Path) -> Result<Vec<String>, Error> {
    let mut descriptions = Vec::new();
    for component in &structure.components {
        let file = fmus.join(format!("{}.fmu", component.fmu));
        let refuse = |reason| Error::Archive { file: file.clone(), reason };
        descriptions.push(Description::read(&read_entry(&file, "modelDescription.xml")?).map_err(refuse)?);
    }
    let descriptions: Vec<&Description> = descriptions.iter().collect();
    let wiring = check(structure, &descriptions)?;
    let mut warnings = wiring.notes;
    for ((component, description), values) in structure.components.iter().zip(descriptions).zip(wiring.values) {
        let variables = values.iter().map(|(place, _)| &description.variables[*place]);
        let enumerations = variables.filter(|variable| variable.kind == "Enumeration");
        warnings.extend(enumerations.map(|variable| {
            let name = format!("{}.{}", component.name, variable.name);
            format!("`{name}` is an enumeration: ecos, libcosim and OMSimulator keep the FMU's start value")
        }));
    }
    Ok(warnings)
}

/// Parameter sets that other masters don't look for.
fn overlooked(files: &LoopFiles) -> Result<Vec<String>, Error> {
    let (text, file) = (files.structure_text()?, files.structure_file());
    let document = parse(&text, &file)?;
    let system = child(document.root_element(), "System");
    let sets =
        |node: Node| child(node, "ParameterBindings").map_or(0, |node| elements(node, "ParameterBinding").count());
    let mut warnings = Vec::new();
    if system.is_some_and(|system| sets(system) > 0) {
        warnings.push("the system has parameters: ecos and libcosim read those of components only".to_owned());
    }
    let components = system.and_then(|system| child(system, "Elements")).into_iter();
    for component in components.flat_map(|node| elements(node, "Component")).filter(|node| sets(*node) > 1) {
        let name = component.attribute("name").unwrap_or_default();
        warnings.push(format!("`{name}` has several parameter sets: libcosim takes the first only"));
    }
    Ok(warnings)
}

/// The structure with what masters want that know the communication step by annotations of their own only:
/// OMSimulator reads no system without one, and only where it is the first; libcosim has no step without one.
fn for_other_masters(files: &LoopFiles, structure: &Structure) -> Result<String, Error> {
    let (text, file, step) = (files.structure_text()?, files.structure_file(), structure.step);
    let oms = |content: String| ("org.openmodelica", format!("<oms:Annotations>{content}</oms:Annotations>"));
    let master = oms(format!(
        "<oms:SimulationInformation><oms:FixedStepMaster description=\"oms-ma\" stepSize=\"{step}\" \
         relativeTolerance=\"0.0001\"/></oms:SimulationInformation>"
    ));
    let results = oms(format!(
        "<oms:SimulationInformation resultFile=\"{}_res.csv\" loggingInterval=\"{step}\" bufferSize=\"10\"/>",
        structure.name
    ));
    let algorithm = format!("<osp:Algorithm><osp:FixedStepAlgorithm baseStepSize=\"{step}\"/></osp:Algorithm>");
    let text = annotated(&declared(&text, &file)?, &file, "System", &master)?;
    let text = annotated(&text, &file, "DefaultExperiment", &("com.opensimulationplatform", algorithm))?;
    annotated(&text, &file, "DefaultExperiment", &results)
}

/// The text with an annotation before the others of a child of the root, unless it has one of that type.
fn annotated(text: &str, file: &Path, element: &'static str, annotation: &(&str, String)) -> Result<String, Error> {
    let document = parse(text, file)?;
    let Some(parent) = child(document.root_element(), element) else { return Ok(text.to_owned()) };
    let annotations = child(parent, "Annotations");
    let mut present = annotations.into_iter().flat_map(|node| elements(node, "Annotation"));
    let (kind, content) = annotation;
    if present.any(|node| node.attribute("type") == Some(kind)) {
        return Ok(text.to_owned());
    }
    let annotation = format!("<ssc:Annotation type=\"{kind}\">{content}</ssc:Annotation>");
    let first = annotations.and_then(|node| elements(node, "Annotation").next());
    let (range, inserted) = match first {
        Some(first) => (first.range().start..first.range().start, annotation),
        None => at_the_end(text, parent, &format!("<ssd:Annotations>{annotation}</ssd:Annotations>")),
    };
    let mut text = text.to_owned();
    text.replace_range(range, &inserted);
    Ok(text)
}

/// The text with the namespaces of the annotations declared in its root.
fn declared(text: &str, file: &Path) -> Result<String, Error> {
    let document = parse(text, file)?;
    let root = document.root_element();
    let known = |prefix: &str| root.namespaces().any(|namespace| namespace.name() == Some(prefix));
    let missing = NAMESPACES.iter().filter(|(prefix, _)| !known(prefix));
    let missing: String = missing.map(|(prefix, uri)| format!(" xmlns:{prefix}=\"{uri}\"")).collect();
    let start = root.range().start;
    let name = text[start..].find(|c: char| c.is_whitespace() || c == '>' || c == '/').unwrap_or_default();
    let mut text = text.to_owned();
    text.insert_str(start + name, &missing);
    Ok(text)
}

/// What to put where so that an element ends with some text.
fn at_the_end(text: &str, node: Node, inserted: &str) -> (std::ops::Range<usize>, String) {
    let range = node.range();
    let written = &text[range.clone()];
    if written.ends_with("/>") {
        let name = written[1..].split(|c: char| c.is_whitespace() || c == '/').next().unwrap_or_default();
        return (range.end - 2..range.end, format!(">{inserted}</{name}>"));
    }
    let end = range.start + written.rfind("</").unwrap_or(written.len());
    (end..end, inserted.to_owned())
}

#[cfg(test)]
mod tests {
    use roxmltree::Document;

    use super::*;

    #[test]
    fn an_annotation_comes_first_and_once_wherever_it_is_put() {
        for element in
            ["<a:E x='1'/>", "<a:E><b/></a:E>", "<a:E><Annotations><Annotation type='other'/></Annotations></a:E>"]
        {
            let xml = declared(&format!("<a:R xmlns:a='x'>{element}<c/></a:R>"), Path::new("x")).unwrap();
            let put = |xml: &str| annotated(xml, Path::new("x"), "E", &("kind", "<oms:k/>".to_owned())).unwrap();
            let once = put(&xml);
            let document = Document::parse(&once).unwrap();
            let first = document.descendants().find(|node| node.tag_name().name() == "Annotation").unwrap();
            assert_eq!(first.attribute("type"), Some("kind"), "{once}");
            assert_eq!(first.parent().and_then(|node| node.parent()).unwrap().tag_name().name(), "E", "{once}");
            assert_eq!(put(&once), once);
        }
    }
}
