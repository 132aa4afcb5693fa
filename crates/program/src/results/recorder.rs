//! Recorders of a run's points. If a run is too long for the memory, its points are processed during the run: the
//! table is written, metrics are measured, and only points for diagrams are stored.

use std::path::Path;
use std::time::{Duration, Instant};

use super::drawn_points::DrawnPoints;
use super::measured::Measured;
use super::metrics::{Meter, measure};
use super::report::Thinned;
use super::table::{Table, TableMarks};
use crate::error::Error;
use crate::output::Files;
use crate::simulation::Recording;
use crate::structure::{Settings, Structure};

/// Largest number of values of a run in memory, including times: 64 MB. Every loop of this package has fewer.
const MOST_STORED: usize = 1 << 23;
/// Number of values after which the points of a longer run are processed: 16 MB.
const BLOCK: usize = 1 << 21;

/// Place and settings of the table of a long run.
#[derive(Debug, Clone, Copy)]
pub struct TablePlace<'a> {
    /// The folder that the user named.
    pub out: &'a Path,
    /// The one of the run, below it.
    pub below: &'a str,
    /// Interval of rows, s; none if all points are rows.
    pub every: Option<f64>,
    /// True if it is also written as Apache Parquet.
    pub parquet: bool,
}

/// Recorder of a run's points.
#[derive(Debug)]
pub struct Recorder<'a> {
    structure: &'a Structure,
    /// Place of the table of a long run; none if the run fits into memory.
    place: Option<TablePlace<'a>>,
    begun: Option<Begun>,
    failure: Option<Error>,
    took: Duration,
}

/// Results of a run in addition to its recording.
#[derive(Debug)]
pub struct Ended {
    /// Its metrics.
    pub measured: Vec<Measured>,
    /// Thinning of the recording; none if it has all points.
    pub thinned: Option<Thinned>,
    /// Its table, if the recording is thinned.
    pub table: Option<Tabled>,
}

/// A written table.
#[derive(Debug)]
pub struct Tabled {
    /// Its files, not yet in their places.
    pub files: Files,
    /// Their numbers of rows and checksums.
    pub marks: TableMarks,
}

#[derive(Debug)]
struct Begun {
    files: Files,
    table: Table,
    meter: Meter,
    drawn: DrawnPoints,
    points: usize,
}

impl<'a> Recorder<'a> {
    /// Returns a recorder for a run with a number of signals. Without a place for the table, it stores all points.
    pub fn new(structure: &'a Structure, settings: Settings, signals: usize, place: Option<TablePlace<'a>>) -> Self {
        let place = place.filter(|_| is_long(settings, signals));
        Recorder { structure, place, begun: None, failure: None, took: Duration::ZERO }
    }

    /// The number of values after which it takes them.
    pub fn block(&self) -> usize {
        self.place.map_or(usize::MAX, |_| BLOCK)
    }

    /// Takes all points of a recording. Returns false if that fails, so that the run can end.
    pub fn take(&mut self, block: &mut Recording) -> bool {
        let begun = Instant::now();
        if let Some(place) = self.place {
            self.failure = self.add(block, place, false).err();
        }
        self.took += begun.elapsed();
        self.failure.is_none()
    }

    /// Computing time of all calls of `take`.
    pub fn took(&self) -> Duration {
        self.took
    }

    /// Takes the last points of a recording, and leaves those for diagrams. If no points were taken before, the
    /// recording stays complete and nothing is written.
    ///
    /// # Errors
    /// If the table can't be written, or a metric, a model or a diagram names a signal that isn't there.
    pub fn end(mut self, recording: &mut Recording) -> Result<Ended, Error> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        if let Some(place) = self.place.filter(|_| self.begun.is_some()) {
            self.add(recording, place, true)?;
        }
        let Some(Begun { mut files, table, meter, drawn, points }) = self.begun else {
            let measured = measure(self.structure, recording).map_err(self.wrong())?;
            return Ok(Ended { measured, thinned: None, table: None });
        };
        let marks = table.finish(&mut files)?;
        let Recording { times, columns, .. } = drawn.into_points();
        (recording.times, recording.columns) = (times, columns);
        let thinned = Thinned { of: points, every: self.place.and_then(|place| place.every) };
        Ok(Ended { measured: meter.measured(), thinned: Some(thinned), table: Some(Tabled { files, marks }) })
    }

    fn add(&mut self, block: &mut Recording, place: TablePlace, ends: bool) -> Result<(), Error> {
        let mut begun = match self.begun.take() {
            Some(begun) => begun,
            None => self.begin(block, place)?,
        };
        begun.meter.add(block);
        begun.table.add(block, ends)?;
        begun.drawn.add(block);
        begun.points += block.times.len();
        block.times.clear();
        block.columns.iter_mut().for_each(Vec::clear);
        self.begun = Some(begun);
        Ok(())
    }

    fn begin(&self, block: &mut Recording, place: TablePlace) -> Result<Begun, Error> {
        let TablePlace { out, below, every, parquet } = place;
        let meter = Meter::new(self.structure, block).map_err(self.wrong())?;
        let wrong = |reason| Error::Loop { file: out.join(below), reason };
        let drawn = DrawnPoints::new(self.structure, block).map_err(wrong)?;
        let files = Files::within(out, below)?;
        let table = Table::begin(&files, block, every, parquet)?;
        Ok(Begun { files, table, meter, drawn, points: 0 })
    }

    /// Converts a reason to an error that names the loop.
    fn wrong(&self) -> impl FnOnce(String) -> Error + use<> {
        let file = self.structure.file.clone();
        move |reason| Error::Loop { file, reason }
    }
}

/// True if a complete run with a number of signals is too long for the memory.
fn is_long(settings: Settings, signals: usize) -> bool {
    (settings.steps() + 1).saturating_mul(signals + 1) > MOST_STORED
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::table::{TABLE, TableMark};
    use super::*;
    use crate::sealed::checksum_of_file;
    use crate::structure::{IdealModel, Metric, PerformanceFunction, Plot, Statistic};

    fn structure() -> Structure {
        let settings = Settings { start_time: 1.0, stop_time: 3.0, step: 1e-3 };
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

    /// A recording of `count` points, the last step shorter than the others.
    fn recording(count: u32) -> Recording {
        let time = |k| 1.0 + (f64::from(k) - if k + 1 == count { 0.3 } else { 0.0 }) * 1e-3;
        let times: Vec<f64> = (0..count).map(time).collect();
        let of = |f: fn(f64) -> f64| times.iter().map(|t| f(*t)).collect::<Vec<f64>>();
        let columns = vec![of(|t| (3.0 * t).sin() / t), of(|t| (70.0 * t).cos())];
        let (names, measures) = (vec!["p.y".into(), "r.r".into()], vec!["m".into(), String::new()]);
        Recording { names, measures, times, columns, ..Recording::default() }
    }

    fn recorder<'a>(structure: &'a Structure, place: TablePlace<'a>) -> Recorder<'a> {
        let settings = Settings { start_time: 0.0, stop_time: 1e7, step: 1.0 };
        Recorder::new(structure, settings, 2, Some(place))
    }

    /// Results of a recording whose points are taken whenever it has a number of values.
    fn in_blocks(of: &Recording, out: &Path, every: Option<f64>, values: usize) -> (Recording, Ended) {
        let structure = structure();
        let mut recorder = recorder(&structure, TablePlace { out, below: "loop", every, parquet: true });
        let mut block = Recording { times: Vec::new(), columns: vec![Vec::new(); 2], ..of.clone() };
        for (row, time) in of.times.iter().enumerate() {
            assert!(block.values() < values || recorder.take(&mut block));
            block.push(*time, &[of.columns[0][row], of.columns[1][row]]);
        }
        let ended = recorder.end(&mut block).unwrap();
        (block, ended)
    }

    fn bits(measured: &[Measured]) -> Vec<Option<u64>> {
        measured.iter().map(|metric| metric.value.map(f64::to_bits)).collect()
    }

    #[test]
    fn a_run_taken_in_blocks_has_the_table_and_the_metrics_of_one_in_memory() {
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
                    let (drawn, ended) = in_blocks(&recording(count), folder.path(), every, values);
                    assert_eq!(bits(&ended.measured), bits(&measured));
                    let Some(Tabled { files, marks }) = ended.table else {
                        assert!(count as usize * 3 <= values + 2, "{count} points have been stored");
                        continue;
                    };
                    assert_eq!(ended.thinned, Some(Thinned { of: count as usize, every }));
                    files.place().unwrap();
                    for (name, TableMark { checksum, .. }) in marks {
                        let file = folder.path().join("loop").join(name);
                        assert_eq!(checksum_of_file(&file).unwrap(), checksum);
                    }
                    let csv = |name: &str| fs::read_to_string(folder.path().join(name).join(TABLE)).unwrap();
                    assert_eq!(csv("loop"), csv("whole"), "{count} points, every {every:?}, blocks of {values}");
                    assert_eq!((&drawn.names, &drawn.measures), (&whole.names, &whole.measures));
                    assert_eq!((drawn.times[0], drawn.times.last()), (1.0, whole.times.last()));
                }
            }
        }
    }

    #[test]
    fn a_run_is_long_by_its_points_and_its_signals() {
        let settings = |points: f64| Settings { start_time: -5.0, stop_time: points - 6.0, step: 1.0 };
        assert!(
            !is_long(settings(MOST_STORED as f64 / 4.0), 3) && is_long(settings(MOST_STORED as f64 / 4.0 + 1.0), 3)
        );
        assert!(is_long(settings(1e7), 1) && !is_long(settings(1e5), 50));
        let (structure, place) =
            (structure(), TablePlace { out: Path::new(""), below: "", every: None, parquet: false });
        let block = |points, place| Recorder::new(&structure, settings(points), 1, place).block();
        assert_eq!((block(1e7, Some(place)), block(1e5, Some(place))), (BLOCK, usize::MAX));
        assert_eq!(block(1e7, None), usize::MAX, "without a place");
    }

    #[test]
    fn a_run_that_fits_stays_as_it_is_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let of = recording(1000);
        let (drawn, ended) = in_blocks(&of, folder.path(), None, 3000);
        assert!(ended.table.is_none() && ended.thinned.is_none());
        assert!(drawn.times == of.times && drawn.columns[..2] == of.columns && drawn.names.len() == 4);
        assert!(fs::read_dir(folder.path()).unwrap().next().is_none());
        assert!(in_blocks(&of, folder.path(), None, 2997).1.table.is_some());
        // Files that are not moved to their places leave only the folder for them.
        assert!(fs::read_dir(folder.path().join("loop")).unwrap().next().is_none());
    }

    #[test]
    fn what_can_not_be_written_or_measured_ends_the_run_at_the_first_block() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("loop").join(TABLE)).unwrap();
        let mut structure = structure();
        let failed = |structure: &Structure| {
            let place = TablePlace { out: folder.path(), below: "loop", every: None, parquet: false };
            let mut recorder = recorder(structure, place);
            let mut block = recording(10);
            assert!(!recorder.take(&mut block));
            recorder.end(&mut block).unwrap_err().to_string()
        };
        let error = failed(&structure);
        assert!(error.contains(TABLE) && error.contains("is a folder"), "{error}");
        structure.metrics[0].of = "p.z".into();
        let error = failed(&structure);
        assert!(error.contains("loop.ssd") && error.contains("no signal `p.z`"), "{error}");
    }

    #[test]
    fn a_page_notes_that_points_are_left_out_where_some_are() {
        let (structure, recording) = (structure(), recording(10));
        let settings = Settings { start_time: 1.0, stop_time: 3.0, step: 1e-3 };
        let page = |thinned| {
            let ending = &super::super::Ending::Complete;
            let (structure, recording) = (&structure, &recording);
            super::super::Report { structure, settings, whole: false, recording, measured: &[], ending, thinned }
                .html(&[])
        };
        assert!(!page(None).contains("points are drawn"));
        let shown = page(Some(Thinned { of: 5000, every: None }));
        assert!(shown.contains("10 of 5000 points are drawn") && shown.contains("result.csv has all"), "{shown}");
        let shown = page(Some(Thinned { of: 5000, every: Some(0.5) }));
        assert!(shown.contains("result.csv has one row every 0.5 s"), "{shown}");
    }
}
