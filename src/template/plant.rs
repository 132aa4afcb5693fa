//! A nominal plant: integrators of some sizes, or what a user's own tool wrote as JSON.
#![allow(non_snake_case)] // matrices have the names of the field

mod sampled;
mod transfer;

use std::io::Read;
use std::path::Path;

use nalgebra::{Complex, DMatrix};
use serde_json::{Map, Value};

use super::{MOST, Records};
use crate::eigenvalues;
use crate::error::{Error, Invalid};
use crate::system::{of_outputs, quantities};

/// Largest file, bytes.
const LARGEST: u64 = 1 << 22;

/// Keys of a file; the last line is what `linearise --json` writes too.
const KEYS: [&str; 14] =
    ["A", "B", "C", "D", "num", "den", "dt", "delay", "states", "inputs", "outputs", "units", "u_min", "u_max"];
const IGNORED: [&str; 7] = ["fmu", "time", "method", "steady_state", "unique", "trim", "eigenvalues"];
/// Keys of identified models besides: records, and uncertainty.
const OF_RECORDS: [&str; 11] = [
    "sample_time",
    "offset",
    "free",
    "covariance",
    "kappa",
    "noise",
    "disturbance",
    "level",
    "fit",
    "whiteness",
    "records",
];

/// x' = A x + B u, y = C x + D u, with names and units where they are known.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    /// n × n.
    pub A: DMatrix<f64>,
    /// n × m.
    pub B: DMatrix<f64>,
    /// p × n.
    pub C: DMatrix<f64>,
    /// p × m, if there is feedthrough.
    pub D: Option<DMatrix<f64>>,
    /// The states.
    pub x: Signals,
    /// The inputs.
    pub u: Signals,
    /// The outputs.
    pub y: Signals,
    /// Limits of the inputs, where they are known.
    pub limits: Option<[Vec<f64>; 2]>,
    /// Dead time of each input, s; empty where there is none.
    pub delay: Vec<f64>,
    /// Records and their uncertainty, if the plant was identified.
    pub records: Option<Records>,
}

/// Names and units of signals; both are empty where they aren't known.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Signals {
    /// A name each.
    pub names: Vec<String>,
    /// A unit each.
    pub units: Vec<String>,
    /// Descriptions in words of the plant.
    pub texts: Vec<String>,
}

impl Plant {
    /// Chains of integrators, one an input, as equal in length as n allows; the outputs are their first states.
    ///
    /// # Errors
    /// More inputs or outputs than states.
    pub fn integrators(n: usize, m: usize, p: usize) -> Result<Self, Invalid> {
        for (name, size) in [("inputs", m), ("outputs", p)] {
            if size > n {
                return Err(Invalid::new(name, size, format!("must be at most {n}, the number of states")));
            }
        }
        let first = |chain: usize, chains: usize| chain * n / chains;
        let (mut A, mut B, mut C) = (DMatrix::zeros(n, n), DMatrix::zeros(n, m), DMatrix::zeros(p, n));
        for chain in 0..m {
            let (start, end) = (first(chain, m), first(chain + 1, m));
            (start + 1..end).for_each(|i| A[(i - 1, i)] = 1.0);
            B[(end - 1, chain)] = 1.0;
        }
        (0..p).for_each(|i| C[(i, first(i, p))] = 1.0);
        let (x, u, y) = (Signals::default(), Signals::default(), Signals::default());
        Ok(Plant { A, B, C, D: None, x, u, y, limits: None, delay: Vec::new(), records: None })
    }

    /// Reads a plant with some of its inputs and outputs only, or all, as [`Plant::parse_for`].
    ///
    /// # Errors
    /// A file that can't be read, or what is wrong in it.
    pub fn read(file: &Path, chosen: [Option<&[String]>; 2]) -> Result<Self, Error> {
        let mut text = String::new();
        let opened = std::fs::File::open(file).map_err(Error::file(file))?;
        opened.take(LARGEST + 1).read_to_string(&mut text).map_err(Error::file(file))?;
        let refuse = |reason: String| Error::Description { file: file.to_owned(), reason };
        if text.len() as u64 > LARGEST {
            return Err(refuse(format!("is longer than {LARGEST} bytes")));
        }
        Plant::parse_for(&text, chosen).map_err(|invalid| refuse(invalid.to_string()))
    }

    /// The plant of a JSON text: A, B, C and D, or num and den; with dt, it was sampled behind a zero-order hold. A matrix is a list
    /// of rows; where A leaves no doubt of what it is, a column or a row may be a plain list, and a single number a plain one.
    ///
    /// # Errors
    /// Errors in the text.
    pub fn parse(text: &str) -> Result<Self, Invalid> {
        Self::parse_for(text, [None, None])
    }

    /// The same with some of its inputs and outputs only, by their names and in that order.
    ///
    /// # Errors
    /// Errors in the text, or an unknown name.
    pub fn parse_for(text: &str, [inputs, outputs]: [Option<&[String]>; 2]) -> Result<Self, Invalid> {
        let mut plant = Self::whole(text)?.of_signals(inputs, outputs)?;
        for signals in [&mut plant.x, &mut plant.u, &mut plant.y] {
            // Names that tools give to signals that nobody has named are none.
            if signals.names.iter().any(|name| name.is_empty() || name.contains('[')) {
                signals.names.clear();
            }
        }
        Ok(plant)
    }

    fn whole(text: &str) -> Result<Self, Invalid> {
        let value: Value =
            serde_json::from_str(text).map_err(|error| Invalid::because(format!("not valid JSON: {error}")))?;
        let needed = "must be an object with the matrices A, B, C, or with num and den";
        let table = value.as_object().ok_or_else(|| Invalid::because(needed))?;
        let known = |key: &&String| KEYS.iter().chain(&IGNORED).chain(&OF_RECORDS).all(|known| known != key);
        if let Some(key) = table.keys().find(known) {
            let shown: String = key.escape_debug().take(40).collect();
            return Err(Invalid::because(format!("unknown key `{shown}`; allowed keys are {}", KEYS.join(", "))));
        }
        let is_transfer = ["num", "den"].iter().any(|key| table.get(*key).is_some_and(|value| !value.is_null()));
        let dt = sampled::sample_time(table.get("dt"))?;
        let [mut A, mut B, C, D] = if is_transfer { transfer::read(table, dt)? } else { matrices(table)? };
        let mut delay = delays(table, B.ncols())?;
        if let Some(dt) = dt {
            [A, B] = sampled::continuous(&A, &B, dt)?;
            delay.resize(B.ncols(), 0.0);
            // The hold is late by half a step in the mean.
            delay.iter_mut().for_each(|delay| *delay += 0.5 * dt);
        }
        let (n, m, p) = (A.nrows(), B.ncols(), C.nrows());
        let signals = |key: &str, unit: &str, len: usize| Signals::read(table, key, unit, len);
        let (x, u, y) = (signals("states", "x", n)?, signals("inputs", "u", m)?, signals("outputs", "y", p)?);
        let D = Some(D).filter(|D| D.iter().any(|&entry| entry != 0.0));
        // Those of a sampled model would be of its own matrices.
        let records = if is_transfer || dt.is_some() { None } else { Records::read(table, (n, m))? };
        Ok(Plant { A, B, C, D, x, u, y, limits: limits(table, m)?, delay, records })
    }

    fn of_signals(mut self, inputs: Option<&[String]>, outputs: Option<&[String]>) -> Result<Self, Invalid> {
        if let Some(names) = inputs {
            let places = self.u.places("--inputs", names)?;
            self.B = self.B.select_columns(&places);
            self.D = self.D.map(|D| D.select_columns(&places));
            self.u = self.u.of(&places);
            self.limits =
                self.limits.map(|limits| limits.map(|limit| places.iter().map(|&place| limit[place]).collect()));
            let n = self.A.nrows();
            self.records = self.records.map(|records| records.of_inputs(&places, n));
            self.delay = places.iter().filter_map(|&place| self.delay.get(place).copied()).collect();
        }
        if let Some(names) = outputs {
            let places = self.y.places("--outputs", names)?;
            self.C = self.C.select_rows(&places);
            self.D = self.D.map(|D| D.select_rows(&places));
            self.y = self.y.of(&places);
        }
        self.D = self.D.filter(|D| D.iter().any(|&entry| entry != 0.0));
        Ok(self)
    }

    /// Words for the outputs: those of the states that they show, else their names.
    pub fn output_quantities(&self) -> Vec<String> {
        let shown = of_outputs(&self.C, &self.x.quantities());
        if shown.is_empty() { self.y.quantities() } else { shown }
    }

    /// Its poles.
    ///
    /// # Errors
    /// Poles that can't be found.
    pub fn poles(&self) -> Result<Vec<Complex<f64>>, Invalid> {
        let badly_scaled = || Invalid::because("A is too badly scaled: its eigenvalues can't be found");
        eigenvalues::complex(&self.A).ok_or_else(badly_scaled)
    }

    /// Step of the records that it was identified from, s.
    pub fn sample_time(&self) -> Option<f64> {
        self.records.as_ref()?.sample_time
    }

    /// Dead time of each input, s.
    pub fn delays(&self) -> Vec<f64> {
        if self.delay.is_empty() { vec![0.0; self.B.ncols()] } else { self.delay.clone() }
    }

    /// Numbers of states, inputs and outputs.
    pub fn sizes(&self) -> (usize, usize, usize) {
        (self.A.nrows(), self.B.ncols(), self.C.nrows())
    }
}

/// A, B, C and D of a file.
fn matrices(table: &Map<String, Value>) -> Result<[DMatrix<f64>; 4], Invalid> {
    let list = |key: &str| table.get(key).filter(|value| !value.is_null()).map(|value| shape(key, value)).transpose();
    let needed = |key: &str| list(key)?.ok_or_else(|| Invalid::because(format!("{key} is missing")));
    let A = needed("A")?;
    let n = match &A {
        Given::Rows(rows) => rows.len(),
        Given::List(list) => list.len(),
    };
    if n == 0 || n > MOST as usize {
        return Err(Invalid::new("rows of A", n, format!("must be within 1 … {MOST}")));
    }
    let A = A.matrix("A", Some(n), Some(n))?;
    let B = needed("B")?.matrix("B", Some(n), None)?;
    let C = needed("C")?.matrix("C", None, Some(n))?;
    let (m, p) = (B.ncols(), C.nrows());
    if m > MOST as usize || p > MOST as usize {
        let allowed = format!("must be within 1 … {MOST}");
        return Err(Invalid::new("inputs and outputs", format!("{m} and {p}"), allowed));
    }
    let D = list("D")?.map(|D| D.matrix("D", Some(p), Some(m))).transpose()?;
    Ok([A, B, C, D.unwrap_or_else(|| DMatrix::zeros(p, m))])
}

/// A matrix as it was written.
enum Given {
    Rows(Vec<Vec<f64>>),
    /// A row, a column, or one number.
    List(Vec<f64>),
}

fn shape(key: &str, value: &Value) -> Result<Given, Invalid> {
    let refuse = || Invalid::because(format!("{key}: must be rows of numbers, as in [[0, 1], [-2, -3]]"));
    let numbers = |list: &Vec<Value>| list.iter().map(Value::as_f64).collect::<Option<Vec<_>>>();
    match value {
        Value::Number(_) => Ok(Given::List(vec![value.as_f64().ok_or_else(refuse)?])),
        Value::Array(list) if list.iter().all(Value::is_number) => Ok(Given::List(numbers(list).ok_or_else(refuse)?)),
        Value::Array(rows) => {
            let rows = rows.iter().map(|row| row.as_array().and_then(numbers)).collect::<Option<Vec<_>>>();
            Ok(Given::Rows(rows.ok_or_else(refuse)?))
        }
        _ => Err(refuse()),
    }
}

impl Given {
    /// The matrix, of as many rows and columns as are known. A plain list lies along what isn't known, or isn't one.
    fn matrix(self, key: &str, rows: Option<usize>, columns: Option<usize>) -> Result<DMatrix<f64>, Invalid> {
        let size = |given: Option<usize>| given.map_or("any number".to_owned(), |size| size.to_string());
        let refuse = |given: String| {
            let allowed = format!("must be {} x {} to fit A and the other matrices", size(rows), size(columns));
            Invalid::new(key, given, allowed)
        };
        let matrix = match self {
            Given::Rows(given) => {
                let width = given.first().map_or(0, Vec::len);
                if given.is_empty() || width == 0 || given.iter().any(|row| row.len() != width) {
                    return Err(Invalid::because(format!(
                        "{key}: must be rows of equal length, with at least one number"
                    )));
                }
                DMatrix::from_fn(given.len(), width, |i, j| given[i][j])
            }
            Given::List(list) if list.is_empty() => return Err(refuse("empty".to_owned())),
            Given::List(list) => match (rows, columns) {
                // Of one row there is no telling from one column, and none is needed: the other size is known.
                (Some(1), _) => DMatrix::from_row_slice(1, list.len(), &list),
                (_, Some(1)) => DMatrix::from_column_slice(list.len(), 1, &list),
                (Some(rows), None) if list.len() == rows => DMatrix::from_column_slice(rows, 1, &list),
                (None, Some(columns)) if list.len() == columns => DMatrix::from_row_slice(1, columns, &list),
                _ => return Err(refuse(format!("a list of {} numbers", list.len()))),
            },
        };
        let fits = |given: usize, known: Option<usize>| known.is_none_or(|known| known == given);
        if !fits(matrix.nrows(), rows) || !fits(matrix.ncols(), columns) {
            return Err(refuse(format!("{} x {}", matrix.nrows(), matrix.ncols())));
        }
        Ok(matrix)
    }
}

impl Signals {
    /// Words for each, for descriptions: the plant's own texts, else its names; none if neither are distinct.
    pub fn quantities(&self) -> Vec<String> {
        let are_units = |texts: &[String]| !texts.is_empty() && quantities("", texts, texts.len()).is_ok();
        [&self.texts, &self.names].into_iter().find(|texts| are_units(texts)).cloned().unwrap_or_default()
    }

    /// Places of the signals with these names.
    fn places(&self, option: &str, names: &[String]) -> Result<Vec<usize>, Invalid> {
        let place = |name: &String| {
            let known = self.names.iter().position(|known| known == name);
            let allowed = if self.names.is_empty() {
                "can't be chosen by name, because the plant's signals have no names".to_owned()
            } else {
                format!("must be one of {}", self.names.join(", "))
            };
            known.ok_or_else(|| Invalid::new(option, name, allowed))
        };
        names.iter().map(place).collect()
    }

    /// Some of them.
    fn of(&self, places: &[usize]) -> Self {
        let some = |texts: &[String]| places.iter().filter_map(|&place| texts.get(place).cloned()).collect();
        Signals { names: some(&self.names), units: some(&self.units), texts: some(&self.texts) }
    }

    fn read(table: &Map<String, Value>, key: &str, unit: &str, len: usize) -> Result<Self, Invalid> {
        let list = table.get(key).filter(|value| !value.is_null()).map(|value| texts(key, "name", value, len));
        let names = list.transpose()?.unwrap_or_default();
        let written = table.get(key).and_then(|value| texts(key, "description", value, len).ok());
        let written = written.filter(|_| table[key].as_array().is_some_and(|list| list.iter().all(Value::is_object)));
        let words = written.unwrap_or_default();
        let units = match table.get("units") {
            None => None,
            Some(Value::Object(units)) => units.get(unit).map(|units| texts(&format!("units.{unit}"), "", units, len)),
            Some(_) => return Err(Invalid::because("units: must be an object with lists x, u, y")),
        };
        // Signals that are objects contain their units.
        let declared =
            || table.get(key).and_then(|value| texts(key, "unit", value, len).ok().filter(|_| !value[0].is_string()));
        let units = units.transpose()?.or_else(declared).unwrap_or_default();
        Ok(Signals { names, units, texts: words })
    }
}

/// One text each. A single one may be given without a list, and a text as an entry of an object.
fn texts(key: &str, entry: &str, value: &Value, len: usize) -> Result<Vec<String>, Invalid> {
    let text = |value: &Value| value.as_str().or_else(|| value.get(entry)?.as_str()).map(str::to_owned);
    let given: Option<Vec<_>> = match value {
        Value::Array(list) => list.iter().map(text).collect(),
        one => text(one).map(|text| vec![text]),
    };
    let fits = given.filter(|texts| texts.len() == len);
    fits.ok_or_else(|| Invalid::because(format!("{key}: must be a list of {len} strings")))
}

/// One dead time for all inputs, or one an input; none where all are 0.
fn delays(table: &Map<String, Value>, m: usize) -> Result<Vec<f64>, Invalid> {
    let Some(value) = table.get("delay").filter(|value| !value.is_null()) else { return Ok(Vec::new()) };
    let given: Option<Vec<_>> = match value {
        Value::Array(list) => list.iter().map(Value::as_f64).collect(),
        one => one.as_f64().map(|one| vec![one; m]),
    };
    let fits = given.filter(|delays| delays.len() == m);
    let allowed = || Invalid::because(format!("delay: must be a number or a list of {m} numbers, in s"));
    let delays = fits.ok_or_else(allowed)?;
    if let Some(wrong) = delays.iter().find(|delay| !(**delay >= 0.0 && delay.is_finite())) {
        return Err(Invalid::new("delay", wrong, "must be at least 0 s"));
    }
    let longest = delays.iter().copied().fold(0.0, f64::max);
    if let Some(short) = delays.iter().find(|delay| **delay > 0.0 && **delay < 0.01 * longest) {
        return Err(Invalid::new("delay", short, format!("must be 0, or at least 1/100 of the longest, {longest} s")));
    }
    Ok(if delays.iter().all(|&delay| delay == 0.0) { Vec::new() } else { delays })
}

fn limits(table: &Map<String, Value>, m: usize) -> Result<Option<[Vec<f64>; 2]>, Invalid> {
    let read = |key: &str| -> Result<Option<Vec<f64>>, Invalid> {
        let Some(value) = table.get(key).filter(|value| !value.is_null()) else { return Ok(None) };
        let given: Option<Vec<_>> = match value {
            Value::Array(list) => list.iter().map(Value::as_f64).collect(),
            one => one.as_f64().map(|one| vec![one]),
        };
        let fits = given.filter(|numbers| numbers.len() == m);
        fits.map(Some).ok_or_else(|| Invalid::because(format!("{key}: must be a list of {m} numbers")))
    };
    match (read("u_min")?, read("u_max")?) {
        (Some(min), Some(max)) => Ok(Some([min, max])),
        (None, None) => Ok(None),
        _ => Err(Invalid::because("u_min, u_max: must be given together")),
    }
}
