//! The related files of an FMU that is exported.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use super::cases::{Case, cases};
use super::writing::{EXPERIMENT_FILE, Listed, PARAMETERS, REFERENCES, STIMULI, array, csv, experiments, manifest};
use super::{EXPERIMENTS, FOLDER, MANIFEST, PARAMETER_SET, VALIDATION};
use crate::error::Error;
use crate::exporter::{self, Content, DESCRIBED, Further, Library, Source};
use crate::fmi2::describe::DescribedUnit;
use crate::model::{Description, Standard};
use crate::model_description::ModelDescription;
use crate::model_description::{elements, xml};
use crate::output;
use crate::reference::ReferenceExperiment;
use crate::texts;
use crate::tuning::typed_set;

/// Bytes that an experiment may take.
const LARGEST: usize = 100_000;

/// An FMU that was exported.
#[derive(Debug)]
pub struct Exported {
    /// Its archive.
    pub file: PathBuf,
    /// The reason why it has no reference results, though they were asked for.
    pub without: Option<String>,
}

/// Writes the FMU of a description into a folder, with its related files, and with reference results if they are asked for.
///
/// # Errors
/// As [`exporter::export_as`], and when a loop of this package can't be read.
pub fn export(
    source: &Source,
    library: &Library,
    out: &Path,
    content: &Content,
    with_results: bool,
) -> Result<Exported, Error> {
    let (name, bytes, without) = packed(source, library, content, with_results)?;
    output::make_folder(out, "")?;
    let file = out.join(name);
    output::write(&file, bytes)?;
    Ok(Exported { file, without })
}

/// The FMU in memory: the name of its file, its bytes, and the reason why it has no reference results, though they were
/// asked for.
///
/// # Errors
/// As [`export`], but for those of files.
pub fn packed(
    source: &Source,
    library: &Library,
    content: &Content,
    with_results: bool,
) -> Result<(String, Vec<u8>, Option<String>), Error> {
    let without = RefCell::new(None);
    let further = |source: &Source, unit: &DescribedUnit| {
        let (files, missing) = related(source, unit, library, with_results)?;
        *without.borrow_mut() = missing;
        Ok(files)
    };
    let (name, bytes) = exporter::packed(source, library, content, &further)?;
    Ok((name, bytes, without.into_inner()))
}

/// The related files of an FMU, and the reason why there is no reference experiment among them though it was asked for.
fn related(
    source: &Source,
    unit: &DescribedUnit,
    library: &Library,
    with_results: bool,
) -> Result<(Further, Option<String>), Error> {
    let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
    let failed = |error: std::io::Error| refuse(error.to_string());
    let described = ModelDescription::read(&unit.model_description).map_err(refuse)?;
    let above = |place: &str| format!("../../{place}");
    let mut listed = vec![
        item("application/toml", above(DESCRIBED), "model", "Description that the FMU is generated from"),
        item(
            "text/html",
            above("documentation/index.html"),
            "report",
            "Page of the FMU, with the report on its design",
        ),
    ];
    let mut files = Further::new();
    let arrays = unit.model_description_3.as_deref().map(arrays).unwrap_or_default();
    // Elements of an array are no variables in FMI 3.0, and a parameter set of SSP 1.0 has no arrays.
    let applies = |case: &Case| case.names.iter().all(|name| array(name, &arrays).is_none());
    for case in cases(source, &described)?.into_iter().filter(applies) {
        listed.push(item(PARAMETER_SET, case.file.clone(), "parameter", &case.about));
        files.push((case.file, case.text.into_bytes()));
    }
    let mut without = None;
    if with_results {
        match results(source, unit, library, &arrays).map_err(failed)? {
            Ok(of_experiment) => {
                let about = "Experiment with reference results";
                listed.push(item(EXPERIMENTS, EXPERIMENT_FILE.to_owned(), VALIDATION, about));
                files.extend(of_experiment);
            }
            Err(reason) => without = Some(reason),
        }
    }
    files.push((MANIFEST.to_owned(), manifest(&listed).map_err(failed)?.into_bytes()));
    let files = files.into_iter().map(|(name, bytes)| (format!("{FOLDER}/{name}"), bytes)).collect();
    Ok((files, without))
}

fn item(kind: &'static str, source: String, role: &'static str, description: &str) -> Listed {
    Listed { kind, source, role, description: description.to_owned() }
}

/// The files of a reference experiment; the reason where there is none.
fn results(
    source: &Source,
    unit: &DescribedUnit,
    library: &Library,
    arrays: &[String],
) -> std::io::Result<Result<Further, String>> {
    // The equations are the same in both versions of the standard.
    let anew = || source.of_standard(Standard::Fmi2).and_then(|source| library.reference(&source));
    let known = stored(source, &unit.name).filter(|_| library.is_own());
    let asked = known.map_or_else(anew, |experiment| Ok(Ok(experiment)));
    let experiment = match asked {
        Ok(Ok(experiment)) => experiment,
        Ok(Err(reason)) => return Ok(Err(reason)),
        Err(error) => return Ok(Err(error.to_string())),
    };
    let mut files = vec![(EXPERIMENT_FILE.to_owned(), experiments(&unit.name, &experiment)?.into_bytes())];
    if !experiment.chosen.is_empty() {
        let values: Vec<_> =
            experiment.chosen.iter().map(|(name, item)| (name.as_str(), "Enumeration", item.clone())).collect();
        files.push((PARAMETERS.to_owned(), typed_set("reference", "Values of the experiment", &values)?.into_bytes()));
    }
    files.extend(experiment.stimuli.iter().map(|table| (STIMULI.to_owned(), csv(table, arrays).into_bytes())));
    files.push((REFERENCES.to_owned(), csv(&experiment.references, arrays).into_bytes()));
    let size: usize = files.iter().map(|(_, bytes)| bytes.len()).sum();
    if size > LARGEST {
        return Ok(Err(format!("they would take {size} bytes, more than {LARGEST}")));
    }
    Ok(Ok(files))
}

/// The reference experiment that comes with an FMU of this package; none if its description was changed.
fn stored(source: &Source, name: &str) -> Option<ReferenceExperiment> {
    let read = |text: &str| Description::read(text).ok().map(|it| Description { fmi: None, designed: None, ..it });
    let (_, text) = exporter::descriptions().iter().find(|(known, _)| *known == name)?;
    (read(&source.text)? == read(text)?).then(|| serde_json::from_str(texts::reference(name)?).ok())?
}

/// The names of the arrays in a modelDescription.xml of FMI 3.0.
fn arrays(text: &str) -> Vec<String> {
    let Ok(document) = xml::parse(text) else { return Vec::new() };
    let is_array = |node: &roxmltree::Node| elements(*node, "Dimension").next().is_some();
    let arrays = document.descendants().filter(is_array);
    arrays.filter_map(|node| node.attribute("name").map(str::to_owned)).collect()
}
