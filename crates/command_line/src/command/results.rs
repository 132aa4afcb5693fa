//! The files of a run.

use std::io::ErrorKind;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use adaptive_fmu::error::Error;
use adaptive_fmu::figures::svg;
use adaptive_fmu::output::Files;
use adaptive_fmu::results::{
    FILES, METRICS, PARQUET, Provenance, Recorded, Report, TABLE, Table, TableMarks, Tabled, metrics_json,
};
use adaptive_fmu::{begun, parallel};
use serde_json::json;

use super::number::positive;

pub const PLOT: &str = "plot.svg";
pub const PAGE: &str = "index.html";
/// The files of a run.
pub const NAMES: [&str; 5] = [TABLE, METRICS, PLOT, PAGE, PARQUET];
/// The longest tag of results, in characters.
const LONGEST_TAG: usize = 80;

#[derive(clap::Args, Clone, Default)]
pub struct TableOptions {
    /// Write one row of result.csv every DT seconds [default: one per communication point]
    ///
    /// If DT is not a multiple of the communication step, the row is that of the next communication point. The last
    /// point is always written. Metrics use all points.
    #[arg(long, value_name = "DT", value_parser = positive)]
    pub every: Option<f64>,
    /// Also write result.parquet
    #[arg(long)]
    pub parquet: bool,
}

impl TableOptions {
    /// Options by which an earlier run wrote its tables.
    pub fn of(earlier: &Recorded) -> Self {
        let parquet = earlier.written["parquet"].as_bool().unwrap_or_default();
        TableOptions { every: earlier.written["every"].as_f64(), parquet }
    }
}

/// A tag of results, by which they differ from those of other runs of the same loop.
pub fn tag(text: &str) -> Result<String, String> {
    let plain = text.chars().all(|c| c.is_alphanumeric() || "_-.,=+".contains(c)) && !text.starts_with('.');
    if text.is_empty() || !plain || text.chars().count() > LONGEST_TAG {
        let signs = "letters, digits and the signs _ - . , = +, no dot first";
        return Err(format!("must be 1 to {LONGEST_TAG} {signs}"));
    }
    Ok(text.to_owned())
}

/// Reads results of an earlier run and checks that they are as the run wrote them.
pub fn earlier(folder: &Path) -> Result<Recorded, Error> {
    let earlier = Recorded::read(folder)?;
    check(&earlier)?;
    Ok(earlier)
}

/// Checks that results are as their run wrote them. A note reports results without checksums.
pub fn check(earlier: &Recorded) -> Result<(), Error> {
    if !earlier.check()? {
        let folder = earlier.folder.display();
        remark!("{folder}: results of `simulate` and of version 0.1 have no checksums, so damage can't be detected");
    }
    Ok(())
}

/// Writes the files of a run; those of its table may be written already.
pub fn write_results(
    report: &Report,
    provenance: Option<&Provenance>,
    tables: &TableOptions,
    out: &Path,
    tabled: Option<Tabled>,
) -> Result<(), Error> {
    let Report { structure, recording, .. } = report;
    let wrong = |reason| Error::Loop { file: out.join(&structure.name), reason };
    let diagrams = report.diagrams().map_err(wrong)?;
    let (mut files, mut marks, table) = match tabled {
        Some(Tabled { files, marks }) => (files, marks, None),
        None => {
            let files = Files::within(out, &structure.name)?;
            let table = Table::begin(&files, recording, tables.every, tables.parquet)?;
            (files, TableMarks::new(), Some(table))
        }
    };
    let table = Mutex::new(table);
    // Each takes about as long as the others.
    let made = parallel::each(&vec![(); parallel::cores()], 3, |(), piece| match piece {
        0 => {
            let mut table = table.lock().unwrap_or_else(PoisonError::into_inner);
            table.as_mut().map_or(Ok(()), |table| table.add(recording, true)).map(|()| String::new())
        }
        1 => Ok(report.html(&diagrams)),
        _ => Ok(svg(&structure.description, &diagrams)),
    });
    let made = made.into_iter().collect::<Result<Vec<String>, Error>>()?;
    let [_, page, plot] = &made[..] else { unreachable!("a table and two texts were asked for") };
    if let Some(table) = table.into_inner().unwrap_or_else(PoisonError::into_inner) {
        marks = table.finish(&mut files)?;
    }
    let written = json!({ "every": tables.every, "parquet": tables.parquet, FILES: marks });
    files.add(METRICS, metrics_json(report, provenance, &written).to_string())?;
    files.add(PLOT, plot)?;
    files.add(PAGE, page)?;
    files.place()?;
    if tables.parquet {
        return Ok(());
    }
    // That of an earlier run would be of other numbers.
    let earlier = begun::path(&out.join(&structure.name).join(PARQUET));
    match std::fs::remove_file(&earlier) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(Error::file(&earlier)(error)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::tag;

    #[test]
    fn a_tag_is_a_plain_name() {
        for good in ["fast", "gain=1e5,omega=2", "v1.2-β"] {
            assert_eq!(tag(good), Ok(good.to_owned()));
        }
        for bad in ["", ".", "..", "../x", "a/b", "a\\b", "a@b", "a b", &"x".repeat(81)] {
            assert!(tag(bad).unwrap_err().contains("letters"), "{bad}");
        }
    }
}
