//! `info`: what an FMU is.

use std::path::PathBuf;

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter;
use adaptive_fmu::fmi2::describe::Build;
use adaptive_fmu::simulation::Description;
use serde_json::json;

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
    let description = Description::read(&xml).map_err(refuse)?;
    let own = exporter::read_entry(fmu, "resources/description.toml").ok();
    let Build { version, target, compiler, source, .. } = Build::own();
    let program = format!("{version}, {target}, {compiler}, source {source}");
    if arguments.json {
        let variables: Vec<_> = description.variables.iter().map(|v| {
            json!({ "name": v.name, "valueReference": v.reference, "causality": v.causality, "variability": v.variability,
                    "type": v.kind, "unit": v.unit, "start": v.start, "min": v.min, "max": v.max,
                    "description": v.description })
        }).collect();
        println!(
            "{}",
            json!({
            "name": description.name, "description": description.description, "guid": description.guid,
            "generationTool": description.generation_tool, "step": description.step, "stopTime": description.stop_time,
            "capabilities": description.capabilities, "logCategories": description.categories,
            "variables": variables, "source": own, "program": program })
        );
        return Ok(());
    }
    println!("{}: {}", description.name, description.description);
    println!("made by {}, GUID {}", description.generation_tool, description.guid);
    println!("this program: {program}");
    let capabilities: Vec<_> = description.capabilities.iter().map(|(name, value)| format!("{name} {value}")).collect();
    println!("co-simulation: {}", capabilities.join(", "));
    println!("log categories: {}", description.categories.join(", "));
    println!();
    println!("{:26} {:10} {:10} {:6} {:12} description", "variable", "causality", "changes", "unit", "start");
    for v in &description.variables {
        let (unit, start) = (v.unit.as_deref().unwrap_or(""), v.start.as_deref().unwrap_or(""));
        println!("{:26} {:10} {:10} {unit:6} {start:12} {}", v.name, v.causality, v.variability, v.description);
    }
    Ok(())
}
