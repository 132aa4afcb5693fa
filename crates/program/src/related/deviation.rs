//! Results against references.

use std::collections::HashMap;

use crate::simulation::Recording;
use crate::tables::{Column, Table};

/// Two times are the same if they differ by at most this part of a communication step.
const SAME: f64 = 1e-3;

/// The deviation of an output from its reference.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Deviation {
    /// Name of the output.
    pub output: String,
    /// The largest deviation, relative to the largest value of the reference; by itself where that is 0.
    pub largest: f64,
    /// The time of that, s.
    pub time: f64,
    /// The value there, and the reference.
    pub value: f64,
    /// The reference there.
    pub reference: f64,
}

/// A deviation in two digits.
pub fn short(deviation: f64) -> String {
    format!("{deviation:.*e}", 1)
}

/// A text of CSV in which the elements of an array, that share a cell, have a column each: `u` becomes `u[1]`, `u[2]`. Arrays of one
/// element are known by their names only.
pub fn with_elements(text: &str, is_array: impl Fn(&str) -> bool) -> String {
    let mut lines = text.lines();
    let Some(head) = lines.next() else { return String::new() };
    let Some(first) = lines.clone().find(|line| !line.trim().is_empty()) else { return text.to_owned() };
    let counts: Vec<usize> = first.split(',').map(|cell| cell.split_whitespace().count().max(1)).collect();
    let names: Vec<&str> = head.split(',').map(str::trim).collect();
    let is_scalar = |(name, count): (&&str, &usize)| *count == 1 && !is_array(name);
    if counts.len() != names.len() || names.iter().zip(&counts).all(is_scalar) {
        return text.to_owned();
    }
    let of_array = |name: &str, count: usize| (1..=count).map(|k| format!("{name}[{k}]")).collect::<Vec<_>>().join(",");
    let columns = names
        .iter()
        .zip(&counts)
        .map(|(name, count)| if is_scalar((name, count)) { (*name).to_owned() } else { of_array(name, *count) });
    let mut text = columns.collect::<Vec<_>>().join(",");
    for line in lines {
        let cells = line.split(',').flat_map(|cell| cell.split_whitespace());
        text.push('\n');
        text.push_str(&cells.collect::<Vec<_>>().join(","));
    }
    text + "\n"
}

/// The deviations of a recording from a table of references whose first column is the time. Rows between communication points are
/// compared with what lies on the line between these; of two rows of the same time, those before a jump count.
///
/// # Errors
/// A column that the recording lacks, or a table without rows within it.
pub fn deviations(recording: &Recording, table: &Table, step: f64) -> Result<Vec<Deviation>, String> {
    let [time, columns @ ..] = &table.columns[..] else { return Err("has no columns".to_owned()) };
    let rows: Vec<(usize, f64, usize)> = (0..time.values.len())
        .filter(|&row| row == 0 || time.values[row] != time.values[row - 1])
        .filter_map(|row| Some((row, time.values[row], place(&recording.times, time.values[row], step)?)))
        .collect();
    if rows.is_empty() || columns.is_empty() {
        return Err("has no values within the experiment's times".to_owned());
    }
    let places: HashMap<&str, &Vec<f64>> = recording.names.iter().map(String::as_str).zip(&recording.columns).collect();
    let of_column = |column: &Column| {
        let own =
            places.get(column.name.as_str()).ok_or_else(|| format!("the FMU has no variable `{}`", column.name))?;
        let largest = column.values.iter().map(|value| value.abs()).fold(0.0, f64::max);
        let scale = if largest > 0.0 { largest } else { 1.0 };
        let mut worst = Deviation { output: column.name.clone(), largest: 0.0, time: 0.0, value: 0.0, reference: 0.0 };
        for &(row, time, place) in &rows {
            let (value, reference) = (between(&recording.times, own, place, time), column.values[row]);
            let off = (value - reference).abs() / scale;
            if row == rows[0].0 || off > worst.largest || off.is_nan() {
                worst = Deviation { largest: off, time, value, reference, output: worst.output };
            }
            if off.is_nan() {
                break;
            }
        }
        Ok(worst)
    };
    columns.iter().map(of_column).collect()
}

/// The last communication point that isn't behind a time; none where that is outside of the recording.
fn place(times: &[f64], time: f64, step: f64) -> Option<usize> {
    let behind = times.partition_point(|point| *point <= time + SAME * step);
    let place = behind.checked_sub(1)?;
    (place + 1 < times.len() || time <= times[place] + SAME * step).then_some(place)
}

/// A value at a time, on the line from a communication point to the next.
fn between(times: &[f64], values: &[f64], place: usize, time: f64) -> f64 {
    let (from, value) = (times[place], values[place]);
    let Some(to) = times.get(place + 1).filter(|to| time > from && (time - from) > SAME * (*to - from)) else {
        return value;
    };
    value + (values[place + 1] - value) * (time - from) / (to - from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_that_share_a_cell_become_columns() {
        let is_array = |name: &str| ["u", "r"].contains(&name);
        let text = "time,u,enabled\n0,1 2,1\n0.5,-3 4e-5,0\n";
        assert_eq!(with_elements(text, is_array), "time,u[1],u[2],enabled\n0,1,2,1\n0.5,-3,4e-5,0\n");
        assert_eq!(with_elements("time, r,enabled\n0,1,1\n", is_array), "time,r[1],enabled\n0,1,1\n");
        for same in ["time,y\n0,1\n", "", "time,\"a b\"\n0,1\n"] {
            assert_eq!(with_elements(same, is_array), same);
        }
    }

    #[test]
    fn the_largest_deviation_is_relative_to_the_largest_value_and_has_its_time() {
        let recording = Recording {
            names: vec!["y".to_owned()],
            times: vec![0.0, 0.1, 0.2, 0.3],
            columns: vec![vec![0.0, 1.0, 2.0, 4.0]],
            ..Recording::default()
        };
        let column =
            |name: &str, values: &[f64]| Column { name: name.to_owned(), values: values.to_vec(), ..Column::default() };
        let table = |values: &[f64]| Table {
            columns: vec![column("time", &[0.1, 0.25, 0.3]), column("y", values)],
            ..Table::default()
        };
        assert_eq!(deviations(&recording, &table(&[1.0, 3.0, 4.0]), 0.1).unwrap()[0].largest, 0.0);
        let off = deviations(&recording, &table(&[1.0, 3.5, 4.0]), 0.1).unwrap().remove(0);
        assert!((off.largest - 0.125).abs() < 1e-12 && off.time == 0.25, "{off:?}");
        assert!(deviations(&recording, &table(&[1.0, f64::NAN, 4.0]), 0.1).unwrap()[0].largest.is_nan());
        let other = Table { columns: vec![column("time", &[0.1]), column("z", &[1.0])], ..Table::default() };
        assert!(deviations(&recording, &other, 0.1).is_err());
    }
}
