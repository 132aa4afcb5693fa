//! Packing a loop as an .ssp archive that other masters read too.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use roxmltree::{Document, Node};

use super::files::LoopFiles;
use super::reader::parse;
use super::{STRUCTURE, Structure};
use crate::error::Error;
use crate::exporter::write_entries;
use crate::simulation::description::{child, elements};

/// Writes `NAME.ssp` into a folder: the structure, the parameter files and the FMUs of another folder; its path. The
/// same files always give the same bytes.
///
/// # Errors
/// When files are missing or can't be written.
pub fn pack(files: &LoopFiles, fmus: &Path, out: &Path) -> Result<PathBuf, Error> {
    let structure = files.structure()?;
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
    Ok(file)
}

/// The structure with what masters want that know the communication step by annotations of their own only:
/// OMSimulator reads no system without one, libcosim has no step.
fn for_other_masters(files: &LoopFiles, structure: &Structure) -> Result<String, Error> {
    let (text, file, step) = (files.structure_text()?, files.structure_file(), structure.step);
    let open_modelica = format!(
        "<oms:Annotations xmlns:oms=\"https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd\">\
         <oms:SimulationInformation><oms:FixedStepMaster description=\"oms-ma\" stepSize=\"{step}\" \
         absoluteTolerance=\"0.0001\" relativeTolerance=\"0.0001\"/></oms:SimulationInformation></oms:Annotations>"
    );
    let open_simulation = format!(
        "<osp:Algorithm xmlns:osp=\"http://opensimulationplatform.com/SSP/OSPAnnotations\">\
         <osp:FixedStepAlgorithm baseStepSize=\"{step}\"/></osp:Algorithm>"
    );
    let text = annotated(&text, &file, "System", "org.openmodelica", &open_modelica)?;
    annotated(&text, &file, "DefaultExperiment", "com.opensimulationplatform", &open_simulation)
}

/// The text with an annotation in a child of the root, unless it has one of that type.
fn annotated(text: &str, file: &Path, element: &'static str, kind: &str, content: &str) -> Result<String, Error> {
    let document = parse(text, file)?;
    let Some(parent) = child(document.root_element(), element) else { return Ok(text.to_owned()) };
    let annotations = child(parent, "Annotations");
    let mut present = annotations.into_iter().flat_map(|node| elements(node, "Annotation"));
    if present.any(|node| node.attribute("type") == Some(kind)) {
        return Ok(text.to_owned());
    }
    // These masters read the prefixes ssd: and ssc: as they stand.
    let annotation = format!(
        "<ssc:Annotation xmlns:ssc=\"http://ssp-standard.org/SSP1/SystemStructureCommon\" type=\"{kind}\">{content}\
         </ssc:Annotation>"
    );
    let annotation = match annotations {
        Some(_) => annotation,
        None => format!(
            "<ssd:Annotations xmlns:ssd=\"http://ssp-standard.org/SSP1/SystemStructureDescription\">{annotation}\
             </ssd:Annotations>"
        ),
    };
    let (range, inserted) = insertion(&document, annotations.unwrap_or(parent), &annotation);
    let mut text = text.to_owned();
    text.replace_range(range, &inserted);
    Ok(text)
}

/// What to put where so that an element ends with some text.
fn insertion(document: &Document, node: Node, text: &str) -> (std::ops::Range<usize>, String) {
    let range = node.range();
    let written = &document.input_text()[range.clone()];
    if written.ends_with("/>") {
        let name = written[1..].split(|c: char| c.is_whitespace() || c == '/').next().unwrap_or_default();
        return (range.end - 2..range.end, format!(">{text}</{name}>"));
    }
    let end = range.start + written.rfind("</").unwrap_or(written.len());
    (end..end, text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_annotation_goes_where_the_schema_wants_it_once() {
        for (xml, expected) in [
            ("<a:R><a:E x='1'/></a:R>", "<a:R><a:E x='1'><ssd:Annotations"),
            ("<a:R><a:E><b/></a:E></a:R>", "<a:R><a:E><b/><ssd:Annotations"),
            ("<a:R><a:E><Annotations><c/></Annotations></a:E></a:R>", "<a:R><a:E><Annotations><c/><ssc:Annotation "),
        ] {
            let xml = xml.replacen("<a:R>", "<a:R xmlns:a='x'>", 1);
            let once = annotated(&xml, Path::new("x"), "E", "kind", "<k/>").unwrap();
            assert!(once.starts_with(&expected.replacen("<a:R>", "<a:R xmlns:a='x'>", 1)), "{once}");
            assert!(Document::parse(&once).unwrap().descendants().any(|node| node.has_tag_name("k")), "{once}");
            assert_eq!(annotated(&once, Path::new("x"), "E", "kind", "<k/>").unwrap(), once);
        }
    }
}
