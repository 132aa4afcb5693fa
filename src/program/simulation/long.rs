//! Runs that are too long for the memory: their tables are written and their metrics measured while they go on, and of their
//! points only those are kept that are drawn.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::closed_loop::{Recording, Settings};
use super::kept::Kept;
use super::metrics::{Measured, Meter};
use super::ssp::Structure;
use super::table::Table;
use crate::error::Error;
use crate::output::Files;

/// The most values of a run that is kept in memory, times included: 64 MB. Every loop of this package has fewer.
const KEPT: usize = 1 << 23;
/// The points of a longer one are handed on whenever there are so many values: 16 MB.
pub const BLOCK: usize = 1 << 21;

/// A run whose points are handed on block by block.
#[derive(Debug)]
pub struct Long<'a> {
    structure: &'a Structure,
    place: (PathBuf, String),
    every: Option<f64>,
    parquet: bool,
    begun: Option<Begun>,
    failure: Option<Error>,
    took: Duration,
}

/// What is left of a long run: its table is written, and a recording has the points that are drawn.
#[derive(Debug)]
pub struct Handed {
    /// The files of its table, not yet in their places.
    pub files: Files,
    /// Its metrics.
    pub measured: Vec<Measured>,
    /// Number of its points.
    pub points: usize,
}

#[derive(Debug)]
struct Begun {
    files: Files,
    table: Table,
    meter: Meter,
    kept: Kept,
    points: usize,
}

/// Whether a run with so many signals, if it comes to its end, is too long to be kept in memory.
pub fn is_long(settings: Settings, signals: usize) -> bool {
    (settings.steps() + 1).saturating_mul(signals + 1) > KEPT
}

impl<'a> Long<'a> {
    /// For a loop whose results go into a folder below another. Of its table, `every` and `parquet` tell what
    /// [`Table::begin`] takes.
    pub fn new(structure: &'a Structure, out: &Path, below: &str, every: Option<f64>, parquet: bool) -> Self {
        let place = (out.to_owned(), below.to_owned());
        Long { structure, place, every, parquet, begun: None, failure: None, took: Duration::ZERO }
    }

    /// Takes the points of a recording, and leaves none. Where that can't be done it answers false, and the run may end.
    pub fn take(&mut self, block: &mut Recording) -> bool {
        let begun = Instant::now();
        self.failure = self.add(block, false).err();
        self.took += begun.elapsed();
        self.failure.is_none()
    }

    /// How long what was taken has taken.
    pub fn took(&self) -> Duration {
        self.took
    }

    /// Takes the last points of a recording, and leaves those that are drawn. One of which nothing was taken stays as it is,
    /// and nothing is written.
    ///
    /// # Errors
    /// When the table can't be written, or a metric, a model or a diagram names a signal that isn't there.
    pub fn end(mut self, recording: &mut Recording) -> Result<Option<Handed>, Error> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        if self.begun.is_none() {
            return Ok(None);
        }
        self.add(recording, true)?;
        let Some(Begun { mut files, table, meter, kept, points }) = self.begun else { return Ok(None) };
        table.finish(&mut files)?;
        let Recording { times, columns, .. } = kept.into_points();
        (recording.times, recording.columns) = (times, columns);
        Ok(Some(Handed { files, measured: meter.measured(), points }))
    }

    fn add(&mut self, block: &mut Recording, ends: bool) -> Result<(), Error> {
        let mut begun = match self.begun.take() {
            Some(begun) => begun,
            None => self.begin(block)?,
        };
        begun.meter.add(block);
        begun.table.add(block, ends)?;
        begun.kept.add(block);
        begun.points += block.times.len();
        block.times.clear();
        block.columns.iter_mut().for_each(Vec::clear);
        self.begun = Some(begun);
        Ok(())
    }

    fn begin(&self, block: &mut Recording) -> Result<Begun, Error> {
        let (out, below) = &self.place;
        let wrong = |reason| Error::Loop { file: self.structure.file.clone(), reason };
        let meter = Meter::new(self.structure, block).map_err(wrong)?;
        let wrong = |reason| Error::Loop { file: out.join(below), reason };
        let kept = Kept::new(self.structure, block).map_err(wrong)?;
        let files = Files::within(out, below)?;
        let table = Table::begin(&files, block, self.every, self.parquet)?;
        Ok(Begun { files, table, meter, kept, points: 0 })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::closed_loop::Order;
    use super::super::recorded::TABLE;
    use super::super::ssp::{IdealModel, Metric, PerformanceFunction, Plot, Statistic};
    use super::super::{Thinned, measure};
    use super::*;

    fn structure() -> Structure {
        let settings = Settings { start_time: 1.0, stop_time: 3.0, step: 1e-3, order: Order::Jacobi };
        let mut structure = Structure::bare("loop.ssd".into(), "loop".into(), String::new(), settings);
        let model = |name: &str, input: &str, initial: &[f64]| IdealModel {
            name: name.into(),
            input: input.into(),
            numerator: vec![3.0],
            denominator: vec![1.0, 2.5, 4.0],
            initial: initial.to_vec(),
        };
        // Two parts of one model, and a model of their sum.
        structure.models = vec![model("y_m", "r.r", &[0.5, 1.0]), model("y_m", "p.y", &[]), model("z_m", "y_m", &[])];
        let funnel = Some(PerformanceFunction { start: 2.0, end: 0.1, rate: 0.7 });
        let metric = |statistic, of: &str, minus: Option<&str>, funnel, from| Metric {
            label: of.into(),
            statistic,
            of: of.into(),
            minus: minus.map(str::to_owned),
            funnel,
            from,
            limit: None,
        };
        structure.metrics = vec![
            metric(Statistic::Max, "p.y", Some("y_m"), funnel, 0.0),
            metric(Statistic::Rms, "p.y", Some("z_m"), funnel, 1.4),
            metric(Statistic::Rms, "r.r", None, None, 1.05),
            metric(Statistic::Max, "z_m", None, None, 99.0),
        ];
        structure.plots = vec![Plot { signals: vec!["p.y".into(), "y_m".into()], ..Plot::default() }];
        structure
    }

    /// A recording of so many points, the last step shorter than the others.
    fn recording(count: u32) -> Recording {
        let time = |k| 1.0 + (f64::from(k) - if k + 1 == count { 0.3 } else { 0.0 }) * 1e-3;
        let times: Vec<f64> = (0..count).map(time).collect();
        let of = |f: fn(f64) -> f64| times.iter().map(|t| f(*t)).collect::<Vec<f64>>();
        let columns = vec![of(|t| (3.0 * t).sin() / t), of(|t| (70.0 * t).cos())];
        let (names, measures) = (vec!["p.y".into(), "r.r".into()], vec!["m".into(), String::new()]);
        Recording { names, measures, times, columns, ..Recording::default() }
    }

    /// What comes of a recording whose points are taken whenever it has so many values.
    fn in_blocks(of: &Recording, out: &Path, every: Option<f64>, values: usize) -> (Recording, Option<Handed>) {
        let structure = structure();
        let mut long = Long::new(&structure, out, "loop", every, true);
        let mut block = Recording { times: Vec::new(), columns: vec![Vec::new(); 2], ..of.clone() };
        for (row, time) in of.times.iter().enumerate() {
            assert!(block.values() < values || long.take(&mut block));
            block.push(*time, &[of.columns[0][row], of.columns[1][row]]);
        }
        let handed = long.end(&mut block).unwrap();
        (block, handed)
    }

    fn bits(measured: &[Measured]) -> Vec<Option<u64>> {
        measured.iter().map(|metric| metric.value.map(f64::to_bits)).collect()
    }

    #[test]
    fn a_run_taken_in_blocks_has_the_table_and_the_metrics_of_one_that_is_kept() {
        // Also of runs that end early.
        for count in [2, 3, 1000, 1701] {
            let mut whole = recording(count);
            let measured = measure(&structure(), &mut whole).unwrap();
            assert_eq!((measured[0].value.is_some(), measured[3].value), (true, None));
            for every in [None, Some(1e-3), Some(0.0037), Some(0.1), Some(100.0)] {
                let folder = tempfile::tempdir().unwrap();
                let mut files = Files::within(folder.path(), "whole").unwrap();
                let mut table = Table::begin(&files, &whole, every, false).unwrap();
                table.add(&whole, true).unwrap();
                table.finish(&mut files).unwrap();
                files.place().unwrap();
                for values in [1, 10, 333, 3000] {
                    let (kept, handed) = in_blocks(&recording(count), folder.path(), every, values);
                    let Some(handed) = handed else {
                        assert!(count as usize * 3 <= values + 2, "{count} points have been kept");
                        continue;
                    };
                    assert_eq!((handed.points, bits(&handed.measured)), (count as usize, bits(&measured)));
                    handed.files.place().unwrap();
                    let csv = |name: &str| fs::read_to_string(folder.path().join(name).join(TABLE)).unwrap();
                    assert_eq!(csv("loop"), csv("whole"), "{count} points, every {every:?}, blocks of {values}");
                    assert_eq!((&kept.names, &kept.measures), (&whole.names, &whole.measures));
                    assert_eq!((kept.times[0], kept.times.last()), (1.0, whole.times.last()));
                }
            }
        }
    }

    #[test]
    fn a_run_is_long_by_its_points_and_its_signals() {
        let settings =
            |points: f64| Settings { start_time: -5.0, stop_time: points - 6.0, step: 1.0, order: Order::Jacobi };
        assert!(!is_long(settings(KEPT as f64 / 4.0), 3) && is_long(settings(KEPT as f64 / 4.0 + 1.0), 3));
        assert!(is_long(settings(1e7), 1) && !is_long(settings(1e5), 50));
    }

    #[test]
    fn a_run_that_fits_stays_as_it_is_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let of = recording(1000);
        let (kept, handed) = in_blocks(&of, folder.path(), None, 3000);
        assert!(handed.is_none() && kept == of && fs::read_dir(folder.path()).unwrap().next().is_none());
        assert!(in_blocks(&of, folder.path(), None, 2997).1.is_some());
        // What isn't put into its place leaves nothing but the folder for it.
        assert!(fs::read_dir(folder.path().join("loop")).unwrap().next().is_none());
    }

    #[test]
    fn what_can_not_be_written_or_measured_ends_the_run_at_the_first_block() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("loop").join(TABLE)).unwrap();
        let mut structure = structure();
        let failed = |structure: &Structure| {
            let mut long = Long::new(structure, folder.path(), "loop", None, false);
            let mut block = recording(10);
            assert!(!long.take(&mut block));
            long.end(&mut block).unwrap_err().to_string()
        };
        let told = failed(&structure);
        assert!(told.contains(TABLE) && told.contains("is a folder"), "{told}");
        structure.metrics[0].of = "p.z".into();
        let told = failed(&structure);
        assert!(told.contains("loop.ssd") && told.contains("no signal `p.z`"), "{told}");
    }

    #[test]
    fn a_page_tells_that_points_are_left_out_where_some_are() {
        let (structure, recording) = (structure(), recording(10));
        let settings = Settings { start_time: 1.0, stop_time: 3.0, step: 1e-3, order: Order::Jacobi };
        let page = |thinned| {
            let ending = &super::super::Ending::Complete;
            let (structure, recording) = (&structure, &recording);
            super::super::Report { structure, settings, whole: false, recording, measured: &[], ending, thinned }
                .html(&[])
        };
        assert!(!page(None).contains("points are drawn"));
        let told = page(Some(Thinned { of: 5000, every: None }));
        assert!(told.contains("10 of 5000 points are drawn") && told.contains("result.csv has all"), "{told}");
        let told = page(Some(Thinned { of: 5000, every: Some(0.5) }));
        assert!(told.contains("result.csv has a row each 0.5 s"), "{told}");
    }
}
