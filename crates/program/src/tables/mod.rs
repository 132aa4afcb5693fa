//! Tables of numbers from files: CSV, Apache Parquet, and MATLAB's files of version 5 to 7.
//!
//! The first bytes of a file show its format. Files of other tools may be damaged or hostile, so the sizes that they
//! name are compared with their length, and a budget limits their contents.

mod mat;
mod parquet;

use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use adaptive_fmu_identification::csv;
pub use adaptive_fmu_identification::csv::{Column, Table};

use crate::error::Error;
use crate::{begun, text_file};

/// Suffixes of files with tables.
pub const ENDINGS: [&str; 3] = ["csv", "parquet", "mat"];

/// True if a file's name has the suffix of a table.
pub fn is_table(file: &Path) -> bool {
    ENDINGS.iter().any(|ending| has_ending(file, ending))
}

fn has_ending(file: &Path, ending: &str) -> bool {
    file.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending))
}

/// Reads the table of a file. Columns with these names are read as text.
///
/// # Errors
/// When the file can't be read, or has no such table.
pub fn read(file: &Path, texts: &[&str]) -> Result<Table, Error> {
    let refuse = |reason: String| Error::Description { file: file.to_owned(), reason };
    let mut reader = BufReader::new(text_file::open(&begun::path(file)).map_err(Error::file(file))?);
    let begin = reader.fill_buf().map_err(Error::file(file))?;
    let is_parquet = begin.starts_with(parquet::MAGIC) || has_ending(file, "parquet");
    if !is_parquet && !begin.starts_with(mat::BEGIN) && !begin.starts_with(mat::HDF5) && !has_ending(file, "mat") {
        return Table::read(reader, texts).map_err(|fault: csv::Fault| refuse(fault.to_string()));
    }
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes).map_err(Error::file(file))?;
    of_bytes(&bytes, is_parquet, texts).map_err(refuse)
}

/// The table of a Parquet or MATLAB file.
///
/// # Errors
/// The reason why there is none.
pub fn of_bytes(bytes: &[u8], is_parquet: bool, texts: &[&str]) -> Result<Table, String> {
    let mut budget = Budget::of(bytes);
    if is_parquet { parquet::read(bytes, texts, &mut budget) } else { mat::read(bytes, texts, &mut budget) }
}

/// Memory left for the contents of a file, in bytes.
#[derive(Debug)]
struct Budget(usize);

impl Budget {
    /// Bytes for any file, and for each byte of one: nearly constant tables compress well.
    const LEAST: usize = 1 << 25;
    const EACH: usize = 256;

    fn of(bytes: &[u8]) -> Self {
        Budget(bytes.len().saturating_mul(Self::EACH).saturating_add(Self::LEAST))
    }

    /// Takes so many bytes.
    fn take(&mut self, bytes: usize) -> Result<(), String> {
        self.0 = self.0.checked_sub(bytes).ok_or("holds far more values than its size allows: it may be damaged")?;
        Ok(())
    }

    /// Reads the output of a decompressor, of this size if it is known.
    fn inflate(&mut self, reader: impl Read, size: Option<usize>) -> Result<Vec<u8>, String> {
        let most = size.unwrap_or(self.0).min(self.0);
        let mut bytes = Vec::new();
        let read = reader.take(most as u64 + 1).read_to_end(&mut bytes);
        read.map_err(|error| format!("a compressed part is damaged: {error}"))?;
        self.take(bytes.len())?;
        match size {
            Some(size) if size != bytes.len() => Err("a compressed part has another size than its header".to_owned()),
            _ => Ok(bytes),
        }
    }
}

#[cfg(test)]
mod tests;
