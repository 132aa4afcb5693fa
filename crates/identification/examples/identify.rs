//! Identifies models from CSV files, so that programs in other languages can compare. Each argument is a JSON object; each line of
//! output is its result, or `{"refusal": …, "cause": …}`.
//!
//! * `{"files": […], "inputs": […], "states": […] or "outputs": […], "held_out": […], "options": {…}}`: a model;
//! * `{"A": [[…]], "B": [[…]], "step": …}`: that model sampled, with its derivatives.

use std::fs::File;
use std::io::BufReader;

use adaptive_fmu_identification::csv::Table;
use adaptive_fmu_identification::{LABEL, Options, Record, Signals, identify_outputs, identify_states, sampled};
use nalgebra::DMatrix;
use serde::Deserialize;
use serde_json::{Value, json};

#[derive(Deserialize)]
#[serde(untagged)]
enum Request {
    Identify(Box<Identify>),
    Sample(Sample),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Identify {
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sample {
    #[serde(rename = "A")]
    a: Vec<Vec<f64>>,
    #[serde(rename = "B")]
    b: Vec<Vec<f64>>,
    step: f64,
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

fn identify(request: Box<Identify>) -> Result<Value, String> {
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

fn sample(request: &Sample) -> Result<Value, String> {
    let matrix = |rows: &[Vec<f64>]| DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j]);
    let rows = |matrix: &DMatrix<f64>| -> Vec<Vec<f64>> {
        matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
    };
    let found = sampled(&matrix(&request.a), &matrix(&request.b), request.step).ok_or("isn't finite")?;
    let [f, g] = [0, 1].map(|part| found.derivatives.iter().map(|both| rows(&both[part])).collect::<Vec<_>>());
    Ok(json!({ "F": rows(&found.f), "G": rows(&found.g), "dF": f, "dG": g }))
}

fn main() {
    for argument in std::env::args().skip(1) {
        let request = serde_json::from_str(&argument).map_err(|error| error.to_string());
        let answer = request.and_then(|request| match request {
            Request::Identify(request) => identify(request),
            Request::Sample(request) => sample(&request),
        });
        match answer {
            Ok(value) => println!("{value}"),
            Err(error) => {
                eprintln!("{error}");
                std::process::exit(1);
            }
        }
    }
}
