//! `info`: what an FMU is.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use adaptive_fmu::error::{Error, one_line};
use adaptive_fmu::exporter::{self, Asked};
use adaptive_fmu::fmi2::build::Build;
use adaptive_fmu::model_description::{ModelDescription, Variable};
use serde_json::{Value, json};

#[derive(clap::Args)]
pub struct Arguments {
    /// The archive
    fmu: PathBuf,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// Prints what an FMU says of itself.
pub fn execute(arguments: &Arguments) -> Result<(), Error> {
    let fmu = &arguments.fmu;
    let xml = exporter::read_entry(fmu, "modelDescription.xml")?;
    let refuse = |reason| Error::Archive { file: fmu.to_owned(), reason };
    let description = ModelDescription::read(&xml).map_err(refuse)?;
    let contents = Contents::read(fmu)?;
    if arguments.json {
        say!("{}", as_json(&description, &contents));
    } else {
        print(&description, &contents);
    }
    Ok(())
}

/// What lies in the archive beside the modelDescription.xml.
struct Contents {
    /// The description that it was made from, and how its library was built; FMUs of other tools hold neither.
    source: Option<String>,
    build: Option<Build>,
    /// Platforms that it has binaries for, and whether it has source code.
    platforms: BTreeSet<String>,
    source_code: bool,
    /// What the binaries ask for, by their paths.
    asked: BTreeMap<String, Asked>,
    /// Files with values of parameters.
    parameter_sets: Vec<String>,
    /// Bytes, and bytes unpacked.
    size: u64,
    unpacked: u64,
}

impl Contents {
    fn read(fmu: &Path) -> Result<Self, Error> {
        let entries = exporter::entries(fmu)?;
        let text = |name: &str| entries.iter().any(|entry| entry.name == name).then(|| exporter::read_entry(fmu, name));
        let names = || entries.iter().map(|entry| entry.name.as_str());
        let platform = |name: &str| Some(name.strip_prefix("binaries/")?.split_once('/')?.0.to_owned());
        Ok(Contents {
            source: text("resources/description.toml").transpose()?,
            build: text(exporter::BUILD).transpose()?.and_then(|text| serde_json::from_str(&text).ok()),
            platforms: names().filter_map(platform).collect(),
            source_code: names().any(|name| name.starts_with("sources/")),
            asked: exporter::asked_within(fmu)?,
            parameter_sets: names().filter(|name| name.ends_with(".ssv")).map(str::to_owned).collect(),
            size: std::fs::metadata(fmu).map_err(Error::file(fmu))?.len(),
            unpacked: entries.iter().map(|entry| entry.size).sum(),
        })
    }
}

fn as_json(description: &ModelDescription, contents: &Contents) -> Value {
    let variable = |v: &Variable| {
        json!({ "name": v.name, "valueReference": v.reference, "causality": v.causality, "variability": v.variability,
                "type": v.kind, "unit": v.unit, "start": v.start, "min": v.min, "max": v.max,
                "description": v.description })
    };
    json!({
        "name": description.name, "description": description.description, "guid": description.guid,
        "generationTool": description.generation_tool,
        "about": BTreeMap::from_iter(description.about.iter().map(|(key, text)| (*key, text))), "step": description.step, "stopTime": description.stop_time,
        "interfaces": interfaces(description), "capabilities": description.capabilities,
        "logCategories": description.categories,
        "variables": description.variables.iter().map(variable).collect::<Vec<_>>(),
        "source": contents.source, "build": contents.build, "platforms": contents.platforms,
        "sourceCode": contents.source_code, "binaries": contents.asked, "parameterSets": contents.parameter_sets,
        "size": contents.size, "unpackedSize": contents.unpacked,
    })
}

fn interfaces(description: &ModelDescription) -> Vec<&'static str> {
    let known = [(description.co_simulation, "co-simulation"), (description.model_exchange, "model exchange")];
    known.into_iter().filter_map(|(has, name)| has.then_some(name)).collect()
}

fn print(description: &ModelDescription, contents: &Contents) {
    // What others wrote may hold line ends and control characters.
    let line = |text: String| say!("{}", one_line(&text));
    let or = |list: String, none: &str| if list.is_empty() { none.to_owned() } else { list };
    line(format!("{}: {}", description.name, description.description));
    let tool = or(description.generation_tool.clone(), "a tool that it doesn't name");
    line(format!("made by {tool}, GUID {}", description.guid));
    let about = description.about.iter().map(|(key, text)| format!("{key}: {text}")).collect::<Vec<_>>().join("; ");
    line(or(about, "author, version, license and copyright: it doesn't say"));
    line(contents.build.as_ref().map_or("library: it doesn't tell how it was built".to_owned(), |build| {
        let Build { package, version, target, compiler, source, .. } = build;
        let slow = if build.optimised { "" } else { ", not optimised" };
        format!("library: {package}, of adaptive-fmu {version} (source {source}), {target}, {compiler}{slow}")
    }));
    let platforms = Vec::from_iter(contents.platforms.iter().map(String::as_str));
    let code = if contents.source_code { ", and source code" } else { "" };
    line(format!("platforms: {}{code}", or(platforms.join(", "), "none")));
    contents.asked.iter().for_each(|(name, asked)| line(format!("{name}: {asked}")));
    let known = if contents.source.is_some() { "resources/description.toml" } else { "not in it" };
    line(format!("description that it was made from: {known}"));
    line(format!("parameter sets: {}", or(contents.parameter_sets.join(", "), "none")));
    line(format!("size: {} bytes, unpacked {}", contents.size, contents.unpacked));
    line(format!("for: {}", interfaces(description).join(", ")));
    let capabilities: Vec<_> = description.capabilities.iter().map(|(name, value)| format!("{name} {value}")).collect();
    line(format!("capabilities: {}", capabilities.join(", ")));
    line(format!("log categories: {}", or(description.categories.join(", "), "none")));
    say!();
    say!("{:26} {:10} {:10} {:6} {:12} description", "variable", "causality", "changes", "unit", "start");
    for v in &description.variables {
        let (unit, start) =
            (v.unit.as_deref().unwrap_or(""), v.start.as_deref().map_or(String::new(), |start| v.shown(start)));
        line(format!("{:26} {:10} {:10} {unit:6} {start:12} {}", v.name, v.causality, v.variability, v.description));
    }
}
