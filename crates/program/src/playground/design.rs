//! A design for the page: the description that `new` writes, the report that `check` prints, and its curves.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Deserialize;
use serde_json::{Value, json};

use crate::designs::{DesignLoop, add_runs, lines};
use crate::error::{Error, Invalid};
use crate::explore::{Rank, rank};
use crate::exporter::{Source, describe};
use crate::fmi2::model_description::xml;
use crate::fmu::Ready;
use crate::library::{self, REGISTRY};
use crate::model::{Description, Model};
use crate::model_description::{ModelDescription, Variable};
use crate::nominal::Uncertainty;
use crate::report::{DesignReport, Finding};
use crate::sealed::checksum;
use crate::template::{Plant, Request, Sizes};

/// Name of the plant's file in descriptions and commands.
pub const PLANT_FILE: &str = "plant.json";

/// A design that the page asks for: what `new` is given, and start values that were changed afterwards.
#[derive(Debug, Clone, Deserialize)]
pub struct Wanted {
    /// The plant, as `new --plant` reads it.
    pub plant: String,
    /// Kind of controller.
    pub kind: String,
    /// Name of its FMU.
    pub name: String,
    /// Bandwidth, rad/s.
    pub bandwidth: Option<f64>,
    /// Uncertainty of the entries of A and B, in parts of them.
    pub uncertainty: Option<f64>,
    /// Size of each reference, or of all.
    #[serde(default)]
    pub reference: Vec<f64>,
    /// Standard deviation of the noise of the measured signals.
    #[serde(default)]
    pub noise: Option<f64>,
    /// Start values of parameters, by their names.
    #[serde(default)]
    pub values: BTreeMap<String, f64>,
    /// True if only the loop with the nominal plant is looked at.
    #[serde(default)]
    pub quick: bool,
}

/// A design that was made.
pub struct Designed {
    /// The plant.
    pub plant: Plant,
    /// The description, with the start values that were asked for.
    pub source: Source,
    /// The description as `new` writes it.
    written: Source,
    notes: Vec<String>,
}

impl Wanted {
    /// The description.
    ///
    /// # Errors
    /// A plant that can't be read or has no such controller, and values that are refused.
    pub fn designed(&self) -> Result<Designed, Error> {
        let file = PathBuf::from(PLANT_FILE);
        let refuse = |invalid: Invalid| Error::Description { file: file.clone(), reason: invalid.to_string() };
        let mut plant = Plant::parse_for(&self.plant, [None, None]).map_err(refuse)?;
        if let Some(records) = &mut plant.records {
            records.model.file = PLANT_FILE.to_owned();
            records.model.sha256 = Some(checksum(&self.plant));
        }
        let reference = if self.reference.is_empty() { &[1.0] } else { self.reference.as_slice() };
        let request = Request {
            kind: &self.kind,
            name: &self.name,
            sizes: Sizes::default(),
            plant: Some(plant.clone()),
            bandwidth: self.bandwidth,
            reference,
            uncertainty: self.uncertainty,
            experiment: None,
        };
        let begun = library::begin(&request).map_err(Error::Argument)?;
        let written = Source::read(PathBuf::from(format!("{}.toml", self.name)), begun.text);
        let source = written.with_start(self.values.iter().map(|(name, value)| (name.as_str(), *value)))?;
        Ok(Designed { plant, source, written, notes: begun.notes })
    }

    /// The command that writes the description.
    fn command(&self) -> String {
        let mut command = format!("adaptive-fmu new {} --name {} --plant {PLANT_FILE}", self.kind, self.name);
        let given = [("bandwidth", self.bandwidth), ("uncertainty", self.uncertainty)];
        for (option, value) in given.iter().filter_map(|(option, value)| Some((option, (*value)?))) {
            command += &format!(" --{option} {value}");
        }
        if self.reference.iter().any(|size| *size != 1.0) {
            let sizes: Vec<_> = self.reference.iter().map(ToString::to_string).collect();
            command += &format!(" --reference {}", sizes.join(","));
        }
        command
    }
}

/// The design of a request with its report and curves, and the start values that can be changed.
///
/// # Errors
/// As [`Wanted::designed`].
pub fn answer(wanted: &Wanted, ready: &Ready) -> Result<Value, Error> {
    let designed = wanted.designed()?;
    let model = model(&designed.source)?;
    let report = if wanted.quick { model.report() } else { report(&designed.source, ready)? };
    let bandwidth = Description::read(&designed.source.text).ok().and_then(|own| own.nominal?.bandwidth);
    let noise = match wanted.noise.filter(|deviation| *deviation > 0.0 && !wanted.quick) {
        Some(deviation) => Some(DesignLoop::new(&designed.source, ready.library())?.noise(deviation, ready)?),
        None => None,
    };
    let text = lines(&wanted.name, &report);
    let finding = |it: &Finding| {
        json!({ "section": it.section, "name": it.name, "lines": it.value.lines(), "unit": it.unit,
                "verdict": it.verdict, "note": it.note })
    };
    let Plant { x, u, y, .. } = &designed.plant;
    Ok(json!({
        "kind": wanted.kind, "name": wanted.name, "quick": wanted.quick, "verdict": report.verdict(),
        "sentence": text.lines().next(), "text": text, "findings": report.findings.iter().map(finding).collect::<Vec<_>>(),
        "pictures": report.pictures, "notes": designed.notes, "description": designed.source.text,
        "bandwidth": bandwidth, "step": report.step, "command": wanted.command(),
        "signals": { "states": x.names, "controls": u.names, "outputs": y.names, "control_units": u.units,
                     "output_units": y.units },
        "noise": noise.map(|controls| json!({ "controls": controls })),
        "parameters": parameters(&model, &designed.written)?,
    }))
}

/// The model of a description, whose report is on the nominal plant only.
fn model(source: &Source) -> Result<Model, Error> {
    let refuse = |invalid: Invalid| Error::Description { file: source.file.clone(), reason: invalid.to_string() };
    let mut own = Description::read(&source.text).map_err(refuse)?;
    if let Some(nominal) = own.nominal.as_mut() {
        nominal.uncertainty = Uncertainty::Unknown;
    }
    Model::from_description(own, REGISTRY).map_err(refuse)
}

/// The report that `check` prints.
///
/// # Errors
/// For a description that is refused.
pub(super) fn report(source: &Source, ready: &Ready) -> Result<DesignReport, Error> {
    let (mut unit, _) = describe(source, ready.library())?;
    add_runs(source, &mut unit.report, || Ok(ready));
    Ok(unit.report)
}

/// The real parameters of a model, with the values that `new` gave them.
fn parameters(model: &Model, written: &Source) -> Result<Vec<Value>, Error> {
    let refuse = |reason: String| Error::Description { file: written.file.clone(), reason };
    let described = |model: &Model| ModelDescription::read(&xml(model)).map_err(refuse);
    let (now, before) = (described(model)?, described(&self::model(written)?)?);
    let start = |variable: &Variable| variable.start.as_ref()?.parse::<f64>().ok();
    let is_shown = |variable: &&Variable| variable.causality == "parameter" && variable.kind == "Real";
    let parameter = |variable: &Variable| {
        let limit = |text: &Option<String>| text.as_ref().and_then(|text| text.parse::<f64>().ok());
        json!({
            "name": variable.name, "description": variable.description, "unit": variable.unit,
            "value": start(variable), "default": before.variable(&variable.name).and_then(start),
            "min": limit(&variable.min), "max": limit(&variable.max), "group": group(&variable.name),
        })
    };
    Ok(now.variables.iter().filter(is_shown).map(parameter).collect())
}

/// The group of a parameter on the page.
fn group(name: &str) -> &'static str {
    match (name.starts_with("pole") || name.starts_with("A_m"), rank(name)) {
        (true, _) => "poles",
        (false, Rank::Gain) => "gains",
        _ => "other",
    }
}
