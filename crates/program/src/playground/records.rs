//! From a record to a plant, for the page.

use adaptive_fmu_identification::{LABEL, Options, Record, Signals, identify_outputs, identify_states, time_of};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::error::{Error, Invalid};
use crate::identified::{convert, lines, text_of};
use crate::tables;

/// Name of the record, for messages.
const NAME: &str = "record.csv";

/// A record as text.
#[derive(Debug, Clone, Deserialize)]
pub struct Table {
    /// CSV.
    pub csv: String,
}

/// A record and its signals.
#[derive(Debug, Clone, Deserialize)]
pub struct Wanted {
    /// The record.
    #[serde(flatten)]
    pub table: Table,
    /// Columns that are inputs of the plant.
    pub inputs: Vec<String>,
    /// Columns that are its states, where all of them are measured.
    #[serde(default)]
    pub states: Option<Vec<String>>,
    /// Columns that are its outputs, otherwise.
    #[serde(default)]
    pub outputs: Option<Vec<String>>,
}

fn refused(reason: impl std::fmt::Display) -> Error {
    Error::Argument(Invalid::because(reason))
}

fn read(Table { csv }: &Table) -> Result<tables::Table, Error> {
    tables::Table::read(csv.as_bytes(), &[LABEL]).map_err(|fault| refused(format!("{NAME}: {fault}")))
}

/// The columns of a record, and which of them is the time.
///
/// # Errors
/// A record that can't be read.
pub fn columns(table: &Table) -> Result<Value, Error> {
    let table = read(table)?;
    let time = time_of(&table, None).map(|column| column.name.clone());
    let names = table.columns.iter().map(|column| column.name.clone());
    let others: Vec<_> = names.filter(|name| Some(name) != time.as_ref()).collect();
    Ok(json!({ "columns": others, "time": time }))
}

/// The plant of a record, and what was found, as `identify` prints it.
///
/// # Errors
/// A record that can't be read, or in which there is no model.
pub fn identified(wanted: &Wanted) -> Result<Value, Error> {
    let Wanted { table, inputs, states, outputs } = wanted;
    let mut records = Record::of_table(NAME, &read(table)?, None).map_err(refused)?;
    let mut remarks = Vec::new();
    for record in &mut records {
        remarks = convert(record, &[])?;
    }
    let signals = |measured: &Vec<String>| Signals { inputs: inputs.clone(), measured: measured.clone() };
    let options = Options::default();
    let found = match (states, outputs) {
        (Some(states), _) => identify_states(&records, None, &signals(states), &options),
        (None, Some(outputs)) => identify_outputs(&records, None, &signals(outputs), &options),
        (None, None) => return Err(refused("choose the measured columns: all states, or outputs")),
    };
    let found = found.map_err(refused)?;
    let text: Vec<_> = remarks.into_iter().chain(lines(&found, false)).collect();
    Ok(json!({ "plant": text_of(&found.model)?, "text": text.join("\n"), "sound": found.is_sound() }))
}
