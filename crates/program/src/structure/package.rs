//! Packing a loop as an .ssp archive that other masters read too.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use roxmltree::Node;

use super::ssp::parse;
use super::ssp::{LoopFiles, is_inside};
use super::{Component, STRUCTURE, StartValue, Structure};
use crate::drawing::escaped;
use crate::error::Error;
use crate::exporter::{packed_entries, read_entry};
use crate::fmu::{Value, is_designed};
use crate::model_description::{ModelDescription, Variable, attribute, child, elements};
use crate::output;
use crate::structure::{AlgebraicLoops, Wiring, check};

/// Namespaces of the annotations below. They are declared in the root, since other masters compare prefixes
/// literally and some take an attribute for an element.
const NAMESPACES: [(&str, &str); 4] = [
    ("ssd", "http://ssp-standard.org/SSP1/SystemStructureDescription"),
    ("ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon"),
    ("oms", "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"),
    ("osp", "http://opensimulationplatform.com/SSP/OSPAnnotations"),
];

/// Writes `NAME.ssp` into a folder: the structure, the parameter files and the FMUs of another folder. Items of
/// enumerations become numbers there, and values that an FMU was designed with are left out. The same files always
/// give the same bytes. Returns its path, and what other masters will leave out.
///
/// # Errors
/// If the loop and its FMUs don't fit each other, or files are missing or can't be written.
pub fn pack(files: &LoopFiles, fmus: &Path, out: &Path) -> Result<(PathBuf, Vec<String>), Error> {
    let structure = files.structure()?;
    let descriptions = descriptions(&structure, fmus)?;
    let read = |(unit, file): (String, PathBuf)| Ok((unit, std::fs::read(&file).map_err(Error::file(&file))?));
    let archives = archives(&structure, fmus)?.into_iter().map(read).collect::<Result<Vec<_>, Error>>()?;
    let (bytes, warnings) = packed(files, &structure, &descriptions, &archives)?;
    output::make_folder(out, "")?;
    let file = out.join(format!("{}.ssp", structure.name));
    output::write(&file, bytes)?;
    Ok((file, warnings))
}

/// The same in memory: the descriptions of the components' FMUs, and the archives by the names of the FMUs. Returns the
/// bytes, and what other masters will leave out.
///
/// # Errors
/// If the loop and its FMUs don't fit each other.
pub fn packed(
    files: &LoopFiles,
    structure: &Structure,
    descriptions: &[ModelDescription],
    archives: &[(String, Vec<u8>)],
) -> Result<(Vec<u8>, Vec<String>), Error> {
    let wiring = check(structure, &descriptions.iter().collect::<Vec<_>>(), AlgebraicLoops::Exchanged)?;
    let choices = choices(structure, descriptions, &wiring);
    let given = given(structure, descriptions);
    let mut warnings = wiring.notes;
    warnings.extend(choices.iter().filter_map(Choice::left_out));
    warnings.extend(overlooked(files)?);
    let file = files.structure_file();
    let text = with_sources(&settable(&files.structure_text()?, &file, &choices, &given)?, &file, structure)?;
    let text = for_other_masters(&text, &file, structure)?;
    let mut entries = vec![(STRUCTURE.to_owned(), text.into_bytes())];
    let in_folder = files.parameter_files();
    for name in in_folder.iter().chain(&structure.parameter_files).collect::<BTreeSet<_>>() {
        let text = settable(&files.read(name)?, &files.path(name), &choices, &given)?;
        entries.push((name.clone(), text.into_bytes()));
    }
    let places: Vec<_> = archives.iter().map(|(unit, _)| format!("resources/{unit}.fmu")).collect();
    let own = entries.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
    let of_units = places.iter().zip(archives).map(|(place, (_, bytes))| (place.as_str(), bytes.as_slice()));
    let entries: Vec<(&str, &[u8])> = own.chain(of_units).collect();
    Ok((packed_entries(&file, &entries)?, warnings))
}

/// The archives of a loop, by the names that they have in a package.
fn archives(structure: &Structure, fmus: &Path) -> Result<BTreeMap<String, PathBuf>, Error> {
    let mut archives = BTreeMap::new();
    for component in &structure.components {
        let (name, path) = (&component.fmu, component.path_in(fmus));
        let refuse = |reason: String| Error::Loop { file: structure.file.clone(), reason };
        if !is_inside(&format!("{name}.fmu")) {
            return Err(refuse(format!("`{}`: an FMU in an SSP can't be named {name}", component.name)));
        }
        if let Some(other) = archives.insert(name.clone(), path.clone()).filter(|other| *other != path) {
            let (path, other) = (path.display(), other.display());
            return Err(refuse(format!("{path} and {other} have the same name. An SSP can contain only one of them")));
        }
    }
    Ok(archives)
}

/// The structure with sources as the package has them.
fn with_sources(text: &str, file: &Path, structure: &Structure) -> Result<String, Error> {
    let document = parse(text, file)?;
    let components = document.descendants().filter(|node| node.tag_name().name() == "Component");
    let mut moved = text.to_owned();
    for node in components.collect::<Vec<_>>().into_iter().rev() {
        let Some(source) = node.attribute_node("source") else { continue };
        let own = structure.components.iter().find(|component| component.source == source.value());
        let Some(component) = own.filter(|it| it.source != format!("resources/{}.fmu", it.fmu)) else { continue };
        moved.replace_range(
            source.range_value(),
            &escaped(&format!("resources/{}.fmu", component.fmu)).replace('\'', "&apos;"),
        );
    }
    Ok(moved)
}

/// The descriptions of the components' FMUs, one each, in their order.
fn descriptions(structure: &Structure, fmus: &Path) -> Result<Vec<ModelDescription>, Error> {
    let read = |component: &Component| {
        let file = component.path_in(fmus);
        let xml = read_entry(&file, "modelDescription.xml")?;
        let description = ModelDescription::read(&xml).and_then(ModelDescription::for_co_simulation);
        description.map_err(|reason| Error::Archive { file, reason })
    };
    structure.components.iter().map(read).collect()
}

/// A start value that is an item of an enumeration. Other masters know none: ecos and libcosim refuse a package that
/// names an item, and leave its number out with a warning; so does OMSimulator.
struct Choice<'a> {
    component: &'a str,
    value: &'a StartValue,
    /// Number of the item.
    number: i32,
    variable: &'a Variable,
}

/// The choices that a loop makes.
fn choices<'a>(structure: &'a Structure, descriptions: &'a [ModelDescription], wiring: &Wiring) -> Vec<Choice<'a>> {
    let mut choices = Vec::new();
    for ((component, description), values) in structure.components.iter().zip(descriptions).zip(&wiring.values) {
        for (place, value) in values {
            let variable = &description.variables[*place];
            let given = component.values.iter().find(|given| given.name == variable.name);
            if let ("Enumeration", Value::Integer(number), Some(value)) = (variable.kind.as_str(), value, given) {
                choices.push(Choice { component: &component.name, value, number: *number, variable });
            }
        }
    }
    choices
}

impl Choice<'_> {
    /// A warning, unless the FMU starts with it anyway.
    fn left_out(&self) -> Option<String> {
        let starts_so = self.variable.start.as_ref().is_some_and(|start| *start == self.number.to_string());
        let name = format!("{}.{}", self.component, self.variable.name);
        let warning =
            format!("`{name}` is an enumeration. ecos, libcosim and OMSimulator use the FMU's start value instead");
        (!starts_so).then_some(warning)
    }
}

/// A start value of a component.
struct Given<'a> {
    component: &'a str,
    value: &'a StartValue,
    /// True if an FMU with C sources was designed with it: a constant, which no master may set.
    is_fixed: bool,
}

/// The start values of all components.
fn given<'a>(structure: &'a Structure, descriptions: &[ModelDescription]) -> Vec<Given<'a>> {
    let of = |(component, description): (&'a Component, &ModelDescription)| {
        let is_fixed = |value: &StartValue| {
            description.place(&value.name).is_some_and(|place| is_designed(&description.variables[place]))
        };
        let given = |value| Given { component: &component.name, value, is_fixed: is_fixed(value) };
        component.values.iter().map(given).collect::<Vec<_>>()
    };
    structure.components.iter().zip(descriptions).flat_map(of).collect()
}

/// True if a component's value was given in this line of a file, under this name there: its own, with the component
/// in front, or without the prefix of a binding.
fn is_given(component: &str, value: &StartValue, file: &Path, line: u32, name: &str) -> bool {
    let own = &value.name;
    let is_named = || name == own || name == format!("{component}.{own}") || own.ends_with(&format!(".{name}"));
    value.origin.file == file && value.origin.line == Some(line) && is_named()
}

/// The text of a file with values that other masters can set: numbers of chosen items instead of their names, and
/// no value that is fixed for all components that take it from there.
fn settable(text: &str, file: &Path, choices: &[Choice], given: &[Given]) -> Result<String, Error> {
    let document = parse(text, file)?;
    let parameters = document.descendants().filter(|node| node.tag_name().name() == "Parameter");
    let mut changed = text.to_owned();
    // From the end on, so that the ranges still to be replaced stay valid.
    for parameter in parameters.collect::<Vec<_>>().into_iter().rev() {
        let line = document.text_pos_at(parameter.range().start).row;
        let name = attribute(parameter, "name").unwrap_or_default();
        let is_here = |component: &str, value: &StartValue| is_given(component, value, file, line, &name);
        let mut takers = given.iter().filter(|given| is_here(given.component, given.value)).peekable();
        if takers.peek().is_some() && takers.all(|given| given.is_fixed) {
            let before = text[..parameter.range().start].trim_end().len();
            changed.replace_range(before..parameter.range().end, "");
            continue;
        }
        let Some(node) = child(parameter, "Enumeration") else { continue };
        if let Some(choice) = choices.iter().find(|choice| is_here(choice.component, choice.value)) {
            let tag = text[node.range().start + 1..].split("Enumeration").next().unwrap_or_default();
            changed.replace_range(node.range(), &format!("<{tag}Integer value=\"{}\"/>", choice.number));
        }
    }
    Ok(changed)
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
        warnings.push("the system has parameters. ecos and libcosim read only those of components".to_owned());
    }
    let components = system.and_then(|system| child(system, "Elements")).into_iter();
    for component in components.flat_map(|node| elements(node, "Component")).filter(|node| sets(*node) > 1) {
        let name = component.attribute("name").unwrap_or_default();
        warnings.push(format!("`{name}` has several parameter sets. libcosim uses only the first"));
    }
    Ok(warnings)
}

/// The structure with the annotations from which other masters take the communication step: OMSimulator reads no
/// system without one, and only if it is the first; libcosim has no step without one.
fn for_other_masters(text: &str, file: &Path, structure: &Structure) -> Result<String, Error> {
    let step = structure.step;
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
    let text = annotated(&declared(text, file)?, file, "System", &master)?;
    let text = annotated(&text, file, "DefaultExperiment", &("com.opensimulationplatform", algorithm))?;
    annotated(&text, file, "DefaultExperiment", &results)
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

/// Range to replace, and its new text, so that an element ends with some text.
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

    use super::super::Origin;
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

    #[test]
    fn only_what_is_fixed_for_all_who_take_it_is_left_out() {
        let file = Path::new("x");
        let parameter = |name: &str| format!("<Parameter name=\"{name}\"><Real value=\"1\"/></Parameter>");
        let text = |names: &[&str]| format!("<S>{}</S>", names.iter().map(|name| parameter(name)).collect::<String>());
        let value = |name: &str| {
            let origin = Origin { file: file.to_owned(), line: Some(1) };
            StartValue { name: name.to_owned(), data_type: None, text: "1".to_owned(), unit: None, origin }
        };
        let [gain, other, inner] = ["gain", "adaptation_gain", "law.gain"].map(value);
        let given = |component, value, is_fixed| Given { component, value, is_fixed };
        let left = |names: &[&str], given: &[Given]| settable(&text(names), file, &[], given).unwrap();
        let both = ["gain", "adaptation_gain"];
        assert_eq!(left(&both, &[given("a", &gain, true), given("a", &other, false)]), text(&both[1..]));
        assert_eq!(left(&both[..1], &[given("a", &gain, true), given("b", &gain, false)]), text(&both[..1]));
        assert_eq!(left(&both[..1], &[given("a", &gain, true), given("b", &gain, true)]), text(&[]));
        let apart = ["a.gain", "b.gain"];
        assert_eq!(left(&apart, &[given("a", &gain, true), given("b", &gain, false)]), text(&apart[1..]));
        // A binding has a prefix.
        assert_eq!(left(&both[..1], &[given("a", &inner, true)]), text(&[]));
    }
}
