//! MATLAB files of version 5 and 7, which is 5 with compressed variables: numeric variables over time as columns.
//!
//! Vectors as long as `time` are columns under their names. An array with as many rows is a column for each element,
//! `x[2]` or `K[1,2]`. Fields of a struct are variables too, `plant.x`. Units of measurement may be in a struct `units`
//! of the same form, or in a cell array for several elements. Names that MATLAB doesn't allow may be in a struct
//! `names`, as written by `Result.to_mat` of the Python package.

mod elements;

use adaptive_fmu_identification::csv::{Column, Table};

use self::elements::{Array, Content, variables};
use super::Budget;

/// The text at the beginning of a file.
pub const BEGIN: &[u8] = b"MATLAB ";
/// The same for version 7.3, where MATLAB writes no text in front.
pub const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";
/// Names of the time.
const TIMES: [&str; 3] = ["time", "Time", "t"];
/// Structs with the units and the names of the variables.
const UNITS: &str = "units";
const NAMES: &str = "names";

/// Reads a table. Variables with these names are read as text.
///
/// # Errors
/// The reason why it can't be read.
pub fn read(bytes: &[u8], texts: &[&str], budget: &mut Budget) -> Result<Table, String> {
    let (mut variables, mut found) = (variables(bytes, budget)?, Found::default());
    let [units, names] = [UNITS, NAMES].map(|name| {
        let is_about = |array: &Array| array.name == name && matches!(array.content, Content::Struct(_));
        variables.iter().position(is_about).map(|place| variables.remove(place))
    });
    // A single struct counts as its fields.
    let single = match &mut variables[..] {
        [Array { content: Content::Struct(fields), name, .. }] => Some((name.clone(), std::mem::take(fields))),
        _ => None,
    };
    if let Some((name, fields)) = single {
        found.assumed.push(format!("variables are the fields of {name}"));
        variables = fields;
    }
    let rows = rows(&variables);
    let labels = [units.as_ref(), names.as_ref()];
    for variable in variables {
        found.add(variable, "", labels, rows, texts);
    }
    let Found { columns, assumed, left_out } = found;
    let mut table = Table::of_columns(columns).map_err(|_| {
        let advice = "must have numeric vectors of equal length, of which `time` is the time";
        if left_out.is_empty() { advice.to_owned() } else { format!("{advice}. Left out: {}", left_out.join("; ")) }
    })?;
    (table.assumed, table.left_out) = (assumed, left_out);
    Ok(table)
}

/// The number of rows: the length of the time, or else of the longest vector.
fn rows(variables: &[Array]) -> usize {
    let is_vector = |array: &&Array| matches!(array.content, Content::Numbers(_)) && array.is_vector();
    let time = TIMES.iter().find_map(|name| variables.iter().filter(is_vector).find(|array| array.name == *name));
    let most = |variables: &[Array]| variables.iter().filter(is_vector).map(Array::count).max();
    time.map(Array::count).or_else(|| most(variables)).unwrap_or(0)
}

#[derive(Default)]
struct Found {
    columns: Vec<Column>,
    assumed: Vec<String>,
    left_out: Vec<String>,
}

impl Found {
    /// Adds the columns of a variable, with the entries of `units` and `names` at the same place.
    fn add(&mut self, variable: Array, before: &str, labels: [Option<&Array>; 2], rows: usize, texts: &[&str]) {
        let Array { name, dims, content } = variable;
        let [units, names] = labels.map(|label| label.and_then(|label| label.field(&name)));
        let name = format!("{before}{name}");
        let values = match content {
            Content::Struct(fields) => {
                let inner = format!("{name}.");
                fields.into_iter().for_each(|field| self.add(field, &inner, [units, names], rows, texts));
                return;
            }
            Content::Text(lines) | Content::Lines(lines) if texts.contains(&name.as_str()) && lines.len() == rows => {
                self.columns.push(Column { name, texts: lines, ..Column::default() });
                return;
            }
            Content::Text(_) => {
                self.assumed.push(format!("{name} is left out: it is text"));
                return;
            }
            Content::Lines(_) => {
                self.left_out.push(format!("{name} is a cell array: save its parts as numeric vectors"));
                return;
            }
            Content::Other(reason) => {
                self.left_out.push(format!("{name} is {reason}"));
                return;
            }
            Content::Numbers(values) => values,
        };
        let is_vector = dims.iter().filter(|size| **size != 1).count() <= 1;
        if rows == 0 || dims.first() != Some(&rows) && !(is_vector && values.len() == rows) {
            let sizes: Vec<_> = dims.iter().map(usize::to_string).collect();
            let reason = format!("{name} ({}) is left out: it has no {rows} rows", sizes.join("×"));
            self.assumed.push(reason);
            return;
        }
        if texts.contains(&name.as_str()) {
            let texts = values.iter().map(f64::to_string).collect();
            self.columns.push(Column { name, texts, ..Column::default() });
            return;
        }
        let unit = |k: usize| units.and_then(|units| units.label(k)).filter(|unit| !unit.is_empty());
        let given = names.and_then(Array::text);
        let name = given.clone().unwrap_or(name);
        let has_index = given.is_some() && name.ends_with(']');
        let sizes = if dims.first() == Some(&rows) { &dims[1..] } else { &[] };
        // Sizes of 1 at the end don't count, unless the name has an index for them.
        let count = if has_index {
            name.rsplit_once('[').map_or(1, |(_, index)| index.split(',').count())
        } else {
            sizes.iter().rposition(|size| *size != 1).map_or(0, |last| last + 1)
        };
        let base = if has_index { name.rsplit_once('[').map_or(&*name, |(base, _)| base) } else { &name };
        for (k, values) in values.chunks_exact(rows).enumerate() {
            let mut rest = k;
            let index = |place: usize| {
                let size = sizes.get(place).copied().unwrap_or(1).max(1);
                let own = rest % size + 1;
                rest /= size;
                own.to_string()
            };
            let indices: Vec<_> = (0..count).map(index).collect();
            let name = if count == 0 { name.clone() } else { format!("{base}[{}]", indices.join(",")) };
            // An element that was not recorded.
            if !(has_index && values.iter().all(|value| value.is_nan())) {
                let (unit, values) = (unit(k), values.to_vec());
                self.columns.push(Column { name, unit, values, texts: Vec::new() });
            }
        }
    }
}
