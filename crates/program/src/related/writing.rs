//! The two formats, written.

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};

use super::{DESCRIPTION, NAME, NAMESPACE, VERSION};
use crate::error::Number;
use crate::reference::{ReferenceExperiment, Table};

/// Files of a reference experiment.
pub const EXPERIMENT_FILE: &str = "reference.exp";
pub const PARAMETERS: &str = "reference.ssv";
pub const STIMULI: &str = "stimuli.csv";
pub const REFERENCES: &str = "references.csv";

/// A file that a manifest lists.
pub struct Listed {
    /// Its media type.
    pub kind: &'static str,
    /// Its path from the manifest.
    pub source: String,
    pub role: &'static str,
    pub description: String,
}

type Written = std::io::Result<String>;

fn document(write: impl FnOnce(&mut Writer<Vec<u8>>) -> std::io::Result<()>) -> Written {
    let mut writer = Writer::new_with_indent(Vec::new(), b' ', 2);
    writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    write(&mut writer)?;
    Ok(String::from_utf8_lossy(&writer.into_inner()).into_owned() + "\n")
}

/// The manifest of some files.
pub fn manifest(listed: &[Listed]) -> Written {
    let root = [
        ("xmlns:fmi-ls", NAMESPACE),
        ("fmi-ls:fmi-ls-name", NAME),
        ("fmi-ls:fmi-ls-version", VERSION),
        ("fmi-ls:fmi-ls-description", DESCRIPTION),
    ];
    document(|writer| {
        let root = writer.create_element("fmiReferences").with_attributes(root);
        root.write_inner_content(|writer| {
            for Listed { kind, source, role, description } in listed {
                let attributes = [
                    ("type", *kind),
                    ("source", source.as_str()),
                    ("role", *role),
                    ("description", description.as_str()),
                ];
                writer.create_element("Related").with_attributes(attributes).write_empty()?;
            }
            Ok(())
        })?;
        Ok(())
    })
}

/// The experiments file of one reference experiment.
pub fn experiments(unit: &str, experiment: &ReferenceExperiment) -> Written {
    let [stop, step] = [experiment.stop, experiment.step].map(|time| Number(time).to_string());
    let tolerance = Number(experiment.tolerance).to_string();
    let about = "Inputs at rest with jumps. An output may deviate by `tolerance` of the largest value of its reference, which is of an \
                 integration of the equations by extrapolation to 1e-11. Rows that an event is near are left out.";
    document(|writer| {
        writer.create_element("Experiments").with_attribute(("name", unit)).write_inner_content(|writer| {
            let attributes = [
                ("name", "reference"),
                ("description", about),
                ("startTime", "0"),
                ("stopTime", &stop),
                ("tolerance", &tolerance),
                ("stepSize", &step),
            ];
            writer.create_element("Experiment").with_attributes(attributes).write_inner_content(|writer| {
                if !experiment.chosen.is_empty() {
                    writer.create_element("Parameters").with_attribute(("source", PARAMETERS)).write_empty()?;
                }
                if experiment.stimuli.is_some() {
                    writer.create_element("Stimuli").with_attribute(("source", STIMULI)).write_empty()?;
                }
                writer.create_element("References").with_attribute(("source", REFERENCES)).write_empty()?;
                Ok(())
            })?;
            Ok(())
        })?;
        Ok(())
    })
}

/// The array that an element is of, if it is one of these.
pub fn array<'a>(name: &'a str, arrays: &[String]) -> Option<&'a str> {
    let (array, _) = name.split_once('[')?;
    arrays.iter().any(|known| known == array).then_some(array)
}

/// A table as CSV, in which the elements of these arrays, by name, share a cell.
pub fn csv(table: &Table, arrays: &[String]) -> String {
    // Columns that go into one cell.
    let mut cells: Vec<(&str, Vec<usize>)> = Vec::new();
    for (column, name) in table.names.iter().enumerate() {
        let shown = array(name, arrays).unwrap_or(name);
        match cells.last_mut() {
            Some((last, columns)) if *last == shown => columns.push(column),
            _ => cells.push((shown, vec![column])),
        }
    }
    let head = std::iter::once("time").chain(cells.iter().map(|(name, _)| *name)).collect::<Vec<_>>().join(",");
    let row = |row: &Vec<f64>| {
        let cell = |(_, columns): &(&str, Vec<usize>)| {
            columns.iter().map(|column| Number(row[column + 1]).to_string()).collect::<Vec<_>>().join(" ")
        };
        std::iter::once(Number(row[0]).to_string()).chain(cells.iter().map(cell)).collect::<Vec<_>>().join(",")
    };
    std::iter::once(head).chain(table.rows.iter().map(row)).map(|line| line + "\n").collect()
}
