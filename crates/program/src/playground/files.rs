//! Files of a design for the page, in memory.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Value, json};

use super::design::{self, Designed};
use crate::analysis::{in_loop, period};
use crate::base64;
use crate::designs::{DesignLoop, report_page, settling_time};
use crate::error::{Error, Invalid};
use crate::exporter::{Content, Library, Source, describe, firmware, packed_entries};
use crate::fmi2::firmware::Options;
use crate::fmu::Ready;
use crate::model_description::ModelDescription;
use crate::related;
use crate::structure::packed;

/// Sorts of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum What {
    /// The FMU.
    Fmu,
    /// Its description.
    Toml,
    /// The controller as C, with its test.
    C,
    /// The loop with the nominal plant (SSP).
    Loop,
    /// The design report as a page.
    Report,
}

/// A file that the page asks for.
#[derive(Debug, Clone, Deserialize)]
pub struct Wanted {
    /// Sort of file.
    pub what: What,
    /// The design.
    #[serde(flatten)]
    pub design: design::Wanted,
}

/// A file: its name, its media type, its bytes.
type Written = (String, &'static str, Vec<u8>);

const ZIP: &str = "application/zip";

/// The file, as base64; progress before it.
///
/// # Errors
/// As a design's, and where the file can't be made.
pub fn answer(
    wanted: &Wanted,
    ready: &Ready,
    library: &dyn Fn() -> Result<Library, Error>,
    progress: &mut dyn FnMut(Value),
) -> Result<Value, Error> {
    let designed = wanted.design.designed()?;
    let name = &wanted.design.name;
    let (file, media, bytes) = match wanted.what {
        What::Toml => (format!("{name}.toml"), "application/toml", designed.source.text.into_bytes()),
        What::Report => report(&designed, name, ready)?,
        What::Fmu => {
            progress(json!({ "progress": 0.1, "text": "the FMU and its reference experiment" }));
            let (file, bytes) = fmu(&designed.source, &library()?)?;
            (file, ZIP, bytes)
        }
        What::C => c(&designed, name, ready, progress)?,
        What::Loop => composite(&designed, name, &library()?, progress)?,
    };
    Ok(json!({ "name": file, "type": media, "base64": base64::padded(&bytes) }))
}

/// An FMU as `export` writes it.
fn fmu(source: &Source, library: &Library) -> Result<(String, Vec<u8>), Error> {
    let (file, bytes, _) = related::packed(source, library, &Content::default(), true)?;
    Ok((file, bytes))
}

fn report(Designed { source, .. }: &Designed, name: &str, ready: &Ready) -> Result<Written, Error> {
    let report = design::report(source, ready)?;
    Ok((format!("{name}.html"), "text/html", report_page(name, &report).into_bytes()))
}

/// The settling time of a loop for its duration, s: by its report, or as usual for its bandwidth.
fn settling(source: &Source, design: &DesignLoop, library: &Library) -> Result<f64, Error> {
    let (unit, _) = describe(source, library)?;
    Ok(settling_time(&unit.report).unwrap_or(4.0 / design.bandwidth))
}

/// The controller as C for a target, with a number of Runge-Kutta steps that its loop needs.
fn c(
    Designed { source, .. }: &Designed,
    name: &str,
    ready: &Ready,
    progress: &mut dyn FnMut(Value),
) -> Result<Written, Error> {
    let design = DesignLoop::new(source, ready.library())?;
    progress(json!({ "progress": 0.1, "text": "the loop, for the number of Runge-Kutta steps" }));
    let (_, structure, _) = design.structure(name, settling(source, &design, ready.library())?, ready.library())?;
    let own = structure.components.iter().find(|component| component.fmu == *name);
    let component = own.ok_or_else(|| Error::Argument(Invalid::because("the controller isn't in its loop")))?;
    let (unit, _) = describe(source, ready.library())?;
    let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
    let xml = ModelDescription::read(&unit.model_description).map_err(refuse)?;
    let found = in_loop(&structure, component, (period(&xml, structure.step), None), ready)?;
    progress(json!({ "progress": 0.6, "text": "C and test vectors" }));
    let signals = (!found.signals.is_empty()).then_some(found.signals);
    let options = Options { substeps: found.substeps, signals, ..Options::default() };
    let (files, _) = firmware(source, ready.library(), &options)?;
    let entries: Vec<(&str, &[u8])> = files.iter().map(|(name, text)| (name.as_str(), text.as_bytes())).collect();
    let file = format!("{name}_c.zip");
    let bytes = packed_entries(Path::new(&file), &entries)?;
    Ok((file, ZIP, bytes))
}

/// The loop as an archive that other masters read, too.
fn composite(
    Designed { source, .. }: &Designed,
    name: &str,
    library: &Library,
    progress: &mut dyn FnMut(Value),
) -> Result<Written, Error> {
    let design = DesignLoop::new(source, library)?;
    let (written, structure, text) =
        design.structure(&format!("{name}_loop"), settling(source, &design, library)?, library)?;
    let count = structure.components.len() as f64;
    let (mut archives, mut descriptions) = (Vec::new(), Vec::new());
    for (k, component) in structure.components.iter().enumerate() {
        progress(json!({ "progress": k as f64 / count, "text": format!("the FMU {}", component.fmu) }));
        let own = structure.description_of(&component.fmu)?;
        let (unit, _) = describe(&own, library)?;
        let refuse = |reason: String| Error::Description { file: own.file.clone(), reason };
        descriptions.push(ModelDescription::read(&unit.model_description).map_err(refuse)?);
        archives.push((component.fmu.clone(), fmu(&own, library)?.1));
    }
    let (bytes, _) = packed(&written.files(Some(text)), &structure, &descriptions, &archives)?;
    let file = PathBuf::from(format!("{}.ssp", structure.name));
    Ok((file.display().to_string(), ZIP, bytes))
}
