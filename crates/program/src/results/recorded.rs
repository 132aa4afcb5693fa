//! Results of an earlier run, read from its folder, for comparisons and to repeat the run.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::measured::Measured;
use super::provenance::{FORMAT, Provenance};
use super::report::{Ending, Report, Thinned};
use super::table::{PARQUET, TABLE, TableMarks};
use crate::begun;
use crate::error::Error;
use crate::sealed::{self, checksum_of_file};
use crate::simulation::Recording;
use crate::structure::{Metric, PerformanceFunction, Settings, Statistic, Structure};
use crate::text_file::{self, csv_fields};

/// File name of a run's metrics and provenance.
pub const METRICS: &str = "metrics.json";
/// Key below `written` in the metrics: the files of the table.
pub const FILES: &str = "files";

/// Subject of a metric.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct About {
    label: String,
    of: String,
    minus: Option<String>,
    funnel: Option<[f64; 3]>,
}

/// The content of `metrics.json`.
pub fn metrics_json(report: &Report, provenance: Option<&Provenance>, written: &Value) -> Value {
    let Report { structure, recording, measured, ending, thinned, .. } = report;
    let mut content = json!({ "loop": structure.name, "ended": ending.word(), "metrics": measured });
    let Some(provenance) = provenance else { return content };
    let about = structure.metrics.iter().map(|metric| {
        let Metric { label, of, minus, funnel, .. } = metric.clone();
        About { label, of, minus, funnel: funnel.map(|PerformanceFunction { start, end, rate }| [start, end, rate]) }
    });
    content["description"] = json!(structure.description);
    content["about"] = json!(about.collect::<Vec<_>>());
    content["signals"] = json!(recording.names.iter().zip(&recording.measures).collect::<Vec<_>>());
    content["written"] = written.clone();
    if let Some(Thinned { of, .. }) = thinned {
        content["drawn"] = json!({ "points": recording.times.len(), "of": of });
    }
    if let Ok(Value::Object(provenance)) = serde_json::to_value(provenance) {
        provenance.into_iter().for_each(|(key, value)| content[key] = value);
    }
    content
}

/// Results of an earlier run.
#[derive(Debug)]
pub struct Recorded {
    /// Their folder.
    pub folder: PathBuf,
    /// Provenance of the results; none of `simulate`, and in version 0.1.0.
    pub provenance: Option<Provenance>,
    /// Settings of its tables.
    pub written: Value,
    /// Its ending.
    pub ended: String,
    metrics: Value,
}

impl Recorded {
    /// True if a path is a folder of results.
    pub fn is_at(folder: &Path) -> bool {
        begun::path(&folder.join(METRICS)).is_file()
    }

    /// Reads the metrics and the provenance of a run.
    ///
    /// # Errors
    /// If the folder has no results, or those of a version that this one can't read.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let file = folder.join(METRICS);
        let refuse = |reason: String| Error::Loop { file: file.clone(), reason };
        let metrics = sealed::read(&file, "file of metrics")?.content;
        let format = metrics["versions"]["format"].as_u64();
        if format.is_none() && !(metrics["versions"].is_null() && metrics["metrics"].is_array()) {
            return Err(refuse("has no metrics of a run".to_owned()));
        }
        if format > Some(FORMAT.into()) {
            return Err(refuse(format!(
                "was written by a later version of this program. This version reads results up to format {FORMAT}"
            )));
        }
        let provenance = format.map(|_| Provenance::deserialize(&metrics)).transpose();
        let provenance = provenance.map_err(|error| refuse(format!("can't be read: {error}")))?;
        let text = |name: &str| metrics[name].as_str().unwrap_or_default().to_owned();
        let (ended, written) = (text("ended"), metrics["written"].clone());
        Ok(Recorded { folder: folder.to_owned(), provenance, written, ended, metrics })
    }

    /// Checks the files of its table against the marks that the run noted. Returns false if there are none, as from
    /// version 0.1: then changes can't be detected.
    ///
    /// # Errors
    /// If one was changed after the run.
    pub fn check(&self) -> Result<bool, Error> {
        let file = self.folder.join(METRICS);
        let marks = Option::<TableMarks>::deserialize(&self.written[FILES]);
        let wrong = |error| Error::Loop { file, reason: format!("can't be read: {error}") };
        let Some(marks) = marks.map_err(wrong)? else { return Ok(false) };
        for (name, mark) in [TABLE, PARQUET].into_iter().filter_map(|name| Some((name, marks.get(name)?))) {
            let file = self.folder.join(name);
            // The Parquet table may be missing, since nothing is read from it.
            if name == PARQUET && !begun::path(&file).exists() {
                continue;
            }
            let rows = if name == TABLE { rows(&file)? } else { mark.rows };
            if rows != mark.rows || checksum_of_file(&file)? != mark.checksum {
                let counted =
                    if rows == mark.rows { String::new() } else { format!(": it has {rows} of {} rows", mark.rows) };
                let reason = format!("was changed after its run{counted}. Run the loop again by its name");
                return Err(Error::Loop { file, reason });
            }
        }
        Ok(true)
    }

    /// The run for a comparison, with the points of its table.
    ///
    /// # Errors
    /// If the table can't be read, or doesn't fit the metrics.
    pub fn run(&self) -> Result<RecordedRun, Error> {
        let file = self.folder.join(METRICS);
        let wrong =
            |error: serde_json::Error| Error::Loop { file: file.clone(), reason: format!("can't be read: {error}") };
        // Version 0.1.0 stored neither what metrics are about nor units of measurement.
        let about = Option::<Vec<About>>::deserialize(&self.metrics["about"]).map_err(wrong)?.unwrap_or_default();
        let measured = Vec::<Measured>::deserialize(&self.metrics["metrics"]).map_err(wrong)?;
        let signals = Option::<Vec<(String, String)>>::deserialize(&self.metrics["signals"]).map_err(wrong)?;
        let recording = self.table(signals)?;
        let asked = self.provenance.as_ref().map(|provenance| &provenance.settings);
        let times = &recording.times;
        let settings = asked.map_or_else(
            || Settings {
                start_time: times[0],
                stop_time: times[times.len() - 1],
                step: times.get(1).map_or(1.0, |next| next - times[0]),
            },
            |asked| Settings { start_time: asked.start_time, stop_time: asked.stop_time, step: asked.step },
        );
        let metric = |About { label, of, minus, funnel }| {
            let funnel = funnel.map(|[start, end, rate]| PerformanceFunction { start, end, rate });
            Metric { label, statistic: Statistic::Max, of, minus, funnel, from: settings.start_time, limit: None }
        };
        let text = |name: &str| self.metrics[name].as_str().unwrap_or_default().to_owned();
        let description = if asked.is_some() { text("description") } else { "metrics of an earlier run".to_owned() };
        let mut structure = Structure::bare(file, self.folder.display().to_string(), description, settings);
        structure.order = asked.and_then(|asked| asked.order.as_deref()?.parse().ok()).unwrap_or(structure.order);
        structure.metrics = about.into_iter().map(metric).collect();
        let ending = match self.ended.as_str() {
            "complete" => Ending::Complete,
            "interrupted" => Ending::Interrupted,
            _ => Ending::Failed("see its page".to_owned()),
        };
        Ok(RecordedRun {
            structure,
            settings,
            whole: asked.is_some_and(|asked| asked.composite),
            recording,
            measured,
            ending,
        })
    }

    /// Reads the table. Files of other programs are refused at the first line that doesn't fit.
    fn table(&self, signals: Option<Vec<(String, String)>>) -> Result<Recording, Error> {
        let file = self.folder.join(TABLE);
        let refuse =
            |line: usize, reason: &str| Error::Loop { file: file.clone(), reason: format!("line {line}: {reason}") };
        // The size isn't limited, since a long run has a long table.
        let text = std::fs::read_to_string(begun::path(&file)).map_err(Error::file(&file))?;
        let mut lines = text.lines();
        let head = csv_fields(lines.next().unwrap_or_default());
        let without_units = || head.iter().skip(1).map(|name| (name.clone(), String::new())).collect();
        let (names, measures): (Vec<_>, Vec<_>) = signals.unwrap_or_else(without_units).into_iter().unzip();
        if head.first().is_none_or(|time| time != "time") || head[1..] != names[..] {
            return Err(refuse(1, "must contain `time` and the signals in metrics.json"));
        }
        let columns = vec![Vec::new(); names.len()];
        let mut recording = Recording { names, measures, columns, ..Recording::default() };
        for (k, line) in lines.enumerate() {
            let numbers = line.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>();
            let numbers = numbers.map_err(|_| refuse(k + 2, "must be numbers"))?;
            match numbers.split_first() {
                Some((time, row)) if row.len() == recording.names.len() => recording.push(*time, row),
                _ => return Err(refuse(k + 2, "must have as many values as the first line has names")),
            }
        }
        if recording.times.is_empty() {
            Err(refuse(2, "the file must have at least one line of values"))
        } else {
            Ok(recording)
        }
    }
}

/// Number of complete rows of a table after its line of names.
fn rows(file: &Path) -> Result<u64, Error> {
    let mut opened = BufReader::new(text_file::open(&begun::path(file)).map_err(Error::file(file))?);
    let mut lines = 0;
    loop {
        let bytes = opened.fill_buf().map_err(Error::file(file))?;
        if bytes.is_empty() {
            return Ok(u64::saturating_sub(lines, 1));
        }
        lines += bytes.iter().filter(|&&byte| byte == b'\n').count() as u64;
        let count = bytes.len();
        opened.consume(count);
    }
}

/// An earlier run, for a report on it.
#[derive(Debug)]
pub struct RecordedRun {
    structure: Structure,
    settings: Settings,
    whole: bool,
    recording: Recording,
    measured: Vec<Measured>,
    ending: Ending,
}

impl RecordedRun {
    /// The report on it.
    pub fn report(&self) -> Report<'_> {
        let RecordedRun { structure, settings, whole, recording, measured, ending } = self;
        Report { structure, settings: *settings, whole: *whole, recording, measured, ending, thinned: None }
    }
}
