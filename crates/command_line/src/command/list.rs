//! `list`: the FMUs, the closed loops, and the kinds of systems that descriptions ask for.

use adaptive_fmu::catalogue::{Entry, Trial};
use adaptive_fmu::error::Error;
use adaptive_fmu::exporter;
use adaptive_fmu::library::CATALOGUE;
use adaptive_fmu::model::{Description, Standard};
use adaptive_fmu::structure::LoopFiles;
use serde_json::{Value, json};

#[derive(clap::Args)]
pub struct Arguments {
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Prints them with what they are.
pub fn execute(arguments: &Arguments) -> Result<(), Error> {
    let mut fmus = Vec::new();
    for (name, _) in exporter::descriptions() {
        let source = exporter::find_description(name)?;
        let description = Description::read(&source.text)
            .map_err(|invalid| Error::Description { file: source.file, reason: invalid.to_string() })?;
        fmus.push((name, description.description));
    }
    let mut loops = Vec::new();
    for (name, _) in exporter::loops() {
        loops.push((name, LoopFiles::find(name)?.structure()?.description));
    }
    let kinds = CATALOGUE.iter().map(|entry| (entry.kind.name, entry.title));
    if arguments.json {
        let versions = Standard::ALL.map(Standard::version);
        let fmus = fmus.iter().map(|(name, text)| json!({ "name": name, "description": text, "versions": versions }));
        let loops = loops.iter().map(|(name, text)| json!({ "name": name, "description": text }));
        let value = json!({ "fmus": Vec::from_iter(fmus), "loops": Vec::from_iter(loops),
                            "kinds": CATALOGUE.iter().map(kind).collect::<Vec<_>>() });
        print_line!("{value}");
    } else {
        print_line!("FMUs, in FMI 2.0, or in FMI 3.0 with `export --fmi 3`");
        fmus.iter().for_each(|(name, text)| print_line!("  {name:24} {text}"));
        print_line!("Loops");
        loops.iter().for_each(|(name, text)| print_line!("  {name:24} {text}"));
        print_line!("Kinds");
        kinds.for_each(|(name, text)| print_line!("  {name:24} {text}"));
    }
    Ok(())
}

/// A kind, with the start values by which a unit of it can be tried.
fn kind(entry: &Entry) -> Value {
    let Trial { alone, smooth, steady, moving } = entry.trial;
    let values = |text: &str| text.parse::<toml::Table>().unwrap_or_default();
    json!({ "name": entry.kind.name, "description": entry.title, "new": entry.template.is_some(),
            "trial": { "alone": values(alone), "smooth": values(smooth), "steady": values(steady),
                       "moving": values(moving) } })
}
