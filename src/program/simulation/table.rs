//! A recording as a table, with all points or some.

use super::closed_loop::Recording;
use crate::decimal;
use crate::parquet;
use crate::text_file::csv_field;

/// Times this close to each other, in parts of the distance of rows, are the same.
const SAME: f64 = 1e-6;
/// Letters of a number, with the comma behind it.
const NUMBER: usize = 20;

/// Points of a recording as rows.
#[derive(Debug)]
pub struct Table<'a> {
    recording: &'a Recording,
    rows: Vec<usize>,
}

impl<'a> Table<'a> {
    /// All points; or the first, the last, and at each multiple of `every` seconds from the first on the point there, else
    /// the next one after it.
    pub fn new(recording: &'a Recording, every: Option<f64>) -> Self {
        let all = 0..recording.times.len();
        let rows = every.map_or_else(|| all.collect(), |every| rows(&recording.times, every));
        Table { recording, rows }
    }

    /// As comma-separated values, a line of names first.
    pub fn csv(&self) -> String {
        let names: Vec<_> = self.recording.names.iter().map(|name| csv_field(name)).collect();
        let mut csv = format!("time,{}\n", names.join(","));
        // What most numbers of a simulation take.
        csv.reserve(self.rows.len() * (names.len() + 1) * NUMBER);
        for &row in &self.rows {
            decimal::push(&mut csv, self.recording.times[row]);
            for column in &self.recording.columns {
                csv.push(',');
                decimal::push(&mut csv, column[row]);
            }
            csv.push('\n');
        }
        csv
    }

    /// As an Apache Parquet file. Units of measurement are texts by the keys `unit of NAME`.
    pub fn parquet(&self) -> Vec<u8> {
        let Recording { names, measures, times, columns, .. } = self.recording;
        let taken = |column: &[f64]| self.rows.iter().map(|&row| column[row]).collect::<Vec<f64>>();
        let signals = names.iter().zip(columns).map(|(name, column)| (name.as_str(), taken(column)));
        let table: Vec<_> = std::iter::once(("time", taken(times))).chain(signals).collect();
        let units = names.iter().zip(measures).filter(|(_, unit)| !unit.is_empty());
        let units = std::iter::once(("time", "s")).chain(units.map(|(name, unit)| (name.as_str(), unit.as_str())));
        let texts: Vec<_> = units.map(|(name, unit)| (format!("unit of {name}"), unit.to_owned())).collect();
        parquet::file(&table, &texts)
    }
}

fn rows(times: &[f64], every: f64) -> Vec<usize> {
    let (Some(&start), last) = (times.first(), times.len().saturating_sub(1)) else { return Vec::new() };
    let (mut rows, mut next) = (Vec::new(), 0.0);
    for (row, time) in times.iter().enumerate() {
        let multiples = (time - start) / every + SAME;
        if multiples >= next || row == last {
            rows.push(row);
            next = multiples.floor() + 1.0;
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn names_with_commas_are_one_column() {
        let names = vec!["a[1,2]".to_owned()];
        let recording = Recording { names, times: vec![0.5], columns: vec![vec![1.25]], ..Recording::default() };
        assert_eq!(Table::new(&recording, None).csv(), "time,\"a[1,2]\"\n0.5,1.25\n");
    }
}
