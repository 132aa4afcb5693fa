//! Identifies models from CSV files, so that programs in other languages can compare: each argument is a JSON object
//! `{"files": […], "inputs": […], "states": […] or "outputs": […], "held_out": […], "options": {…}}`; each line of output
//! is the result, or `{"refusal": …, "cause": …}`.

use std::fs::File;
use std::io::BufReader;

use adaptive_fmu_identification::csv::Table;
use adaptive_fmu_identification::{LABEL, Options, Record, Signals, identify_outputs, identify_states};
use serde::Deserialize;
use serde_json::{Value, json};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    files: Vec<String>,
    #[serde(default)]
    held_out: Vec<String>,
    inputs: Vec<String>,
    #[serde(default)]
    states: Vec<String>,
    #[serde(default)]
    outputs: Vec<String>,
    #[serde(default)]
    options: Options,
}

fn read(files: &[String]) -> Result<Vec<Record>, String> {
    let mut records = Vec::new();
    for file in files {
        let reader = BufReader::new(File::open(file).map_err(|error| format!("{file}: {error}"))?);
        let table = Table::read(reader, &[LABEL]).map_err(|fault| format!("{file}: {fault}"))?;
        records.extend(Record::of_table(file, &table, None).map_err(|refusal| refusal.text)?);
    }
    Ok(records)
}

fn answer(argument: &str) -> Result<Value, String> {
    let request: Request = serde_json::from_str(argument).map_err(|error| error.to_string())?;
    let (records, held_out) = (read(&request.files)?, read(&request.held_out)?);
    let held_out = (!held_out.is_empty()).then_some(&held_out[..]);
    let found = if request.outputs.is_empty() {
        let signals = Signals { inputs: request.inputs, measured: request.states };
        identify_states(&records, held_out, &signals, &request.options)
    } else {
        let signals = Signals { inputs: request.inputs, measured: request.outputs };
        identify_outputs(&records, held_out, &signals, &request.options)
    };
    match found {
        Ok(identified) => serde_json::to_value(identified).map_err(|error| error.to_string()),
        Err(refusal) => Ok(json!({ "refusal": refusal.text, "cause": refusal.cause })),
    }
}

fn main() {
    for argument in std::env::args().skip(1) {
        match answer(&argument) {
            Ok(value) => println!("{value}"),
            Err(error) => {
                eprintln!("{error}");
                std::process::exit(1);
            }
        }
    }
}
