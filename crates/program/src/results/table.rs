//! The table of a run, with all points or some, in files that are written during the run.

use std::collections::BTreeMap;
use std::io::{self, Write};

use serde::{Deserialize, Serialize};

use crate::decimal;
use crate::error::Error;
use crate::output::{Files, Part};
use crate::parquet;
use crate::sealed::Summed;
use crate::simulation::Recording;
use crate::text_file::csv_field;

/// Name of the table.
pub const TABLE: &str = "result.csv";
/// Name of the table as Apache Parquet, if requested.
pub const PARQUET: &str = "result.parquet";

/// Largest difference of equal times, relative to the interval of rows.
const SAME: f64 = 1e-6;
/// Number of bytes of text per write.
const AT_ONCE: usize = 1 << 16;

/// Mark of a table's file, to detect changes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableMark {
    /// Number of rows.
    pub rows: u64,
    /// SHA-256.
    pub checksum: String,
}

/// The files of a table by their names.
pub type TableMarks = BTreeMap<String, TableMark>;

/// The files of a table that is being written.
#[derive(Debug)]
pub struct Table {
    rows: Rows,
    /// Number of written rows.
    count: u64,
    csv: Summed<Part>,
    parquet: Option<Parquet>,
}

#[derive(Debug)]
struct Parquet {
    file: parquet::Writer<Summed<Part>>,
    /// Units of measurement by the keys `unit of NAME`.
    texts: Vec<(String, String)>,
}

impl Table {
    /// Begins the table of a recording's signals: comma-separated values after a line of names, and Apache Parquet if
    /// requested. Its rows are all points; or the first, the last, and for each multiple of `every` seconds after the
    /// first the point at that time, else the next one.
    ///
    /// # Errors
    /// If a file can't be written.
    pub fn begin(files: &Files, recording: &Recording, every: Option<f64>, parquet: bool) -> Result<Self, Error> {
        let mut csv = Summed::new(files.begin(TABLE)?);
        let names: Vec<_> = recording.names.iter().map(|name| csv_field(name)).collect();
        writeln!(csv, "time,{}", names.join(",")).map_err(Error::file(csv.out().file()))?;
        let parquet = parquet.then(|| Parquet::begin(files.begin(PARQUET)?, recording)).transpose()?;
        Ok(Table { rows: Rows::new(every), count: 0, csv, parquet })
    }

    /// Writes the rows among further points, including the last of them if none follow.
    ///
    /// # Errors
    /// If a file can't be written.
    pub fn add(&mut self, points: &Recording, ends: bool) -> Result<(), Error> {
        let rows = self.rows.among(&points.times, ends);
        self.count += rows.len() as u64;
        push_csv(&mut self.csv, points, &rows).map_err(Error::file(self.csv.out().file()))?;
        match &mut self.parquet {
            Some(parquet) => parquet.add(points, &rows),
            None => Ok(()),
        }
    }

    /// Adds the files to those that will be moved to their places. Returns their marks.
    ///
    /// # Errors
    /// If one can't be written.
    pub fn finish(self, files: &mut Files) -> Result<TableMarks, Error> {
        let mut marks = TableMarks::new();
        let mut add = |name: &str, file: Summed<Part>| {
            let (part, checksum) = file.end();
            marks.insert(name.to_owned(), TableMark { rows: self.count, checksum });
            files.finish(part)
        };
        add(TABLE, self.csv)?;
        if let Some(Parquet { file, texts }) = self.parquet {
            let name = file.out().out().file().to_owned();
            add(PARQUET, file.finish(&texts).map_err(Error::file(name))?)?;
        }
        Ok(marks)
    }
}

impl Parquet {
    fn begin(part: Part, Recording { names, measures, .. }: &Recording) -> Result<Self, Error> {
        let units = names.iter().zip(measures).filter(|(_, unit)| !unit.is_empty());
        let units = std::iter::once(("time", "s")).chain(units.map(|(name, unit)| (name.as_str(), unit.as_str())));
        let texts = units.map(|(name, unit)| (format!("unit of {name}"), unit.to_owned())).collect();
        let names = std::iter::once("time".to_owned()).chain(names.iter().cloned()).collect();
        let file = part.file().to_owned();
        Ok(Parquet { file: parquet::Writer::new(Summed::new(part), names).map_err(Error::file(file))?, texts })
    }

    /// Writes the rows of further points as a row group, if there are some.
    fn add(&mut self, points: &Recording, rows: &[usize]) -> Result<(), Error> {
        if rows.is_empty() {
            return Ok(());
        }
        let columns = std::iter::once(&points.times).chain(&points.columns);
        let columns = columns.map(|column| rows.iter().map(|&row| column[row]));
        let written = self.file.group(rows.len(), columns);
        written.map_err(Error::file(self.file.out().out().file()))
    }
}

/// Rows of points as comma-separated values.
fn push_csv(csv: &mut impl Write, points: &Recording, rows: &[usize]) -> io::Result<()> {
    let mut text = String::new();
    for &row in rows {
        decimal::push(&mut text, points.times[row]);
        for column in &points.columns {
            text.push(',');
            decimal::push(&mut text, column[row]);
        }
        text.push('\n');
        if text.len() >= AT_ONCE {
            csv.write_all(text.as_bytes())?;
            text.clear();
        }
    }
    csv.write_all(text.as_bytes())
}

/// Choice of the points that are rows, for one part of a run after the other.
#[derive(Debug)]
struct Rows {
    every: Option<f64>,
    start: Option<f64>,
    /// The multiple of `every` at or after which the next row is.
    next: f64,
}

impl Rows {
    fn new(every: Option<f64>) -> Self {
        Rows { every, start: None, next: 0.0 }
    }

    /// The rows among further points, including the last of them if none follow.
    fn among(&mut self, times: &[f64], ends: bool) -> Vec<usize> {
        let (Some(every), Some(&first)) = (self.every, times.first()) else { return (0..times.len()).collect() };
        let (start, last) = (*self.start.get_or_insert(first), times.len() - 1);
        let mut rows = Vec::new();
        for (row, time) in times.iter().enumerate() {
            let multiples = (time - start) / every + SAME;
            if multiples >= self.next || ends && row == last {
                rows.push(row);
                self.next = multiples.floor() + 1.0;
            }
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(times: &[f64], every: f64) -> Vec<usize> {
        Rows::new(Some(every)).among(times, true)
    }

    fn times(step: f64, count: u32) -> Vec<f64> {
        (0..count).map(|k| f64::from(k) * step).collect()
    }

    #[test]
    fn every_multiple_of_the_step_is_one_row_and_both_ends_are_there() {
        assert_eq!(rows(&times(0.001, 32), 0.01), [0, 10, 20, 30, 31]);
        // Rounding moves no row: 600 points of 1 ms, a row each 3 ms.
        assert_eq!(rows(&times(0.001, 601), 0.003), (0..=200).map(|k| 3 * k).collect::<Vec<_>>());
    }

    #[test]
    fn where_no_point_is_the_next_one_is_taken() {
        assert_eq!(rows(&times(0.2, 8), 0.5), [0, 3, 5, 7]);
        assert_eq!(rows(&times(0.2, 4), 0.01), [0, 1, 2, 3]);
        assert_eq!(rows(&[], 1.0), [0; 0]);
    }

    #[test]
    fn points_that_come_in_parts_give_the_same_rows() {
        for (step, every) in [(0.001, 0.003), (0.2, 0.5), (0.2, 0.01), (0.013, 0.1), (0.1, 100.0)] {
            let times = times(step, 700);
            for size in [1, 2, 3, 64, 699, 700] {
                let (mut of_parts, mut state) = (Vec::new(), Rows::new(Some(every)));
                for (part, points) in times.chunks(size).enumerate() {
                    let ends = (part + 1) * size >= times.len();
                    of_parts.extend(state.among(points, ends).into_iter().map(|row| part * size + row));
                }
                assert_eq!(of_parts, rows(&times, every), "{step} s, each {every} s, parts of {size}");
            }
        }
    }

    #[test]
    fn names_with_commas_are_one_column() {
        let names = vec!["a[1,2]".to_owned()];
        let recording = Recording { names, times: vec![0.5], columns: vec![vec![1.25]], ..Recording::default() };
        let folder = tempfile::tempdir().unwrap();
        let mut files = Files::at(folder.path());
        let mut table = Table::begin(&files, &recording, None, false).unwrap();
        table.add(&recording, true).unwrap();
        table.finish(&mut files).unwrap();
        files.place().unwrap();
        let csv = std::fs::read_to_string(folder.path().join(TABLE)).unwrap();
        assert_eq!(csv, "time,\"a[1,2]\"\n0.5,1.25\n");
    }
}
