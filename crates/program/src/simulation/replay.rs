//! Comparison of an FMU with a record before a loop is closed: the controls that a controller would have given.

use super::inputs::values_of;
use super::recording::Recording;
use crate::error::{Error, Invalid};
use crate::model_description::ModelDescription;
use crate::near;
use crate::tables::Column;

/// Delays of the record that are tried, in communication steps.
const DELAYS: usize = 4;
/// Factor by which a delay must reduce the difference to count.
const NEARER: f64 = 0.5;
/// Suffix of the names of recorded signals.
const RECORDED: &str = "_recorded";
/// Variables that count limits and bounds, with words for a value above 0.
const COUNTED: [(&str, &str); 2] =
    [("time_at_limit", "a control is at its limit"), ("projection_active", "an estimate is at its bound")];

/// Outputs of an FMU, and the columns of a record that they are compared with.
#[derive(Debug)]
pub struct Replay {
    times: Vec<f64>,
    /// Names, and recorded values in the units of the outputs.
    compared: Vec<(String, Vec<f64>)>,
    /// Variables to record besides.
    pub further: Vec<String>,
    /// Columns of the record that are not used.
    pub unused: Vec<String>,
}

/// An output against its record.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// Its name.
    pub name: String,
    /// Its unit of measurement.
    pub unit: String,
    /// The difference.
    pub difference: Difference,
}

/// Difference of an output from its record, at a delay if that is clear.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// The part of the recorded motion that the output follows, %; none for a constant record.
    pub fit: Option<f64>,
    /// Its root mean square.
    pub rms: f64,
    /// Its largest size.
    pub largest: f64,
    /// The time of that, s.
    pub time: f64,
    /// Delay of the record, in communication steps.
    pub delay: usize,
}

/// Part of the time in which a control was at its limit, or an estimate at its bound.
#[derive(Debug, Clone, PartialEq)]
pub struct Share {
    /// Name of the variable.
    pub name: &'static str,
    /// Words for it.
    pub words: &'static str,
    /// Part of the communication points, %.
    pub part: f64,
    /// The largest value.
    pub most: f64,
}

impl Replay {
    /// A replay of a record with these times and columns; the outputs with these names are compared.
    ///
    /// # Errors
    /// A name that isn't both an output of the FMU and a column of the record.
    pub fn new(
        description: &ModelDescription,
        names: &[String],
        times: &[f64],
        columns: Vec<Column>,
    ) -> Result<Self, Error> {
        let outputs = || description.variables.iter().filter(|v| v.causality == "output" && v.kind != "String");
        let refuse = |name: &String, allowed: String| Error::Argument(Invalid::new("--compare", name, allowed));
        let mut compared = Vec::new();
        for name in names {
            let known: Vec<_> = outputs().map(|variable| variable.name.as_str()).collect();
            let Some(variable) = outputs().find(|variable| variable.name == *name) else {
                return Err(refuse(name, format!("is not an output of the FMU; {}", near::choice(name, &known, ""))));
            };
            let Some(column) = columns.iter().find(|column| column.name == *name) else {
                let known: Vec<_> = columns.iter().map(|column| column.name.as_str()).collect();
                return Err(refuse(name, format!("is not a column of the record; {}", near::choice(name, &known, ""))));
            };
            let values = values_of(column, variable).map_err(|reason| Error::Argument(Invalid::because(reason)))?;
            compared.push((name.clone(), values));
        }
        let unused = columns.into_iter().map(|column| column.name).filter(|name| !names.contains(name)).collect();
        let known = |name: &&str| description.place(name).is_some();
        let further = COUNTED.iter().map(|(name, _)| *name).filter(known).map(str::to_owned).collect();
        Ok(Replay { times: times.to_vec(), compared, further, unused })
    }

    /// Compares a run with the record, and adds the recorded signals to it.
    pub fn compare(&self, recording: &mut Recording) -> (Vec<Compared>, Vec<Share>) {
        let mut compared = Vec::new();
        for (name, recorded) in &self.compared {
            let Some(own) = recording.column(name).map(<[f64]>::to_vec) else { continue };
            let at: Vec<_> = recording.times.iter().map(|&time| self.sampled(recorded, time)).collect();
            let unit = recording.measure(name).unwrap_or_default().to_owned();
            let difference = Difference::least(&own, &at, &recording.times);
            let of = |difference| Compared { name: name.clone(), unit: unit.clone(), difference };
            compared.extend(difference.map(of));
            recording.names.push(format!("{name}{RECORDED}"));
            recording.measures.push(unit);
            recording.columns.push(at);
        }
        let share = |&(name, words): &(&'static str, &'static str)| {
            let values = recording.column(name)?;
            let above = values.iter().filter(|value| **value > 0.0).count();
            let most = values.iter().copied().fold(0.0, f64::max);
            Some(Share { name, words, part: 100.0 * above as f64 / values.len().max(1) as f64, most })
        };
        let shares = COUNTED.iter().filter_map(share).collect();
        (compared, shares)
    }

    /// A column at a time, with a zero-order hold.
    fn sampled(&self, values: &[f64], time: f64) -> f64 {
        // Times of a grid and of a record may differ by rounding.
        let after = self.times.partition_point(|&row| row <= time + 1e-9 * time.abs().max(1e-9));
        values[after.saturating_sub(1)]
    }
}

impl Difference {
    /// The difference from a record that may be late. The output at the end of a step depends on the record at its
    /// beginning. `None` if nothing was recorded.
    fn least(own: &[f64], record: &[f64], times: &[f64]) -> Option<Self> {
        let delayed = (0..DELAYS).filter_map(|delay| Self::at(delay, own, record, times));
        delayed.reduce(|least, one| if one.rms < NEARER * least.rms { one } else { least })
    }

    fn at(delay: usize, own: &[f64], record: &[f64], times: &[f64]) -> Option<Self> {
        // Output k + 1 is that of the step that begins at k.
        let pairs = (1..own.len()).filter_map(|k| Some((times[k], own[k], *record.get(k + delay - 1)?)));
        let pairs: Vec<_> = pairs.filter(|(.., recorded)| recorded.is_finite()).collect();
        let count = pairs.len() as f64;
        let mean = pairs.iter().map(|(.., recorded)| recorded).sum::<f64>() / count;
        let motion: f64 = pairs.iter().map(|(.., recorded)| (recorded - mean).powi(2)).sum();
        let off: f64 = pairs.iter().map(|(_, own, recorded)| (own - recorded).powi(2)).sum();
        let sizes = pairs.iter().map(|(time, own, recorded)| ((own - recorded).abs(), *time));
        let (largest, time) = sizes.reduce(|most, one| if one.0 > most.0 { one } else { most })?;
        let fit = (motion > 0.0).then(|| 100.0 * (1.0 - (off / motion).sqrt()));
        Some(Difference { fit, rms: (off / count).sqrt(), largest, time, delay })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_that_is_later_is_compared_at_its_delay() {
        let times: Vec<f64> = (0..50).map(|k| 0.1 * f64::from(k)).collect();
        let signal = |k: i32| (0.3 * f64::from(k)).sin();
        let own: Vec<_> = (0..50).map(signal).collect();
        for delay in 0..4 {
            // The output at k + 1 depends on the record at k, which is `delay` steps late.
            let record: Vec<_> = (0..50).map(|k| signal(k + 1 - delay)).collect();
            let found = Difference::least(&own, &record, &times).unwrap();
            assert_eq!(found.delay, delay as usize);
            assert!(found.rms < 1e-12 && found.fit.unwrap() > 99.999_999);
        }
        let off: Vec<_> = own.iter().enumerate().map(|(k, value)| value + if k == 20 { 0.5 } else { 0.0 }).collect();
        let record: Vec<_> = (0..50).map(|k| signal(k + 1)).collect();
        let found = Difference::least(&off, &record, &times).unwrap();
        assert!((found.largest - 0.5).abs() < 1e-12 && (found.time - 2.0).abs() < 1e-12);
        assert_eq!(Difference::least(&own, &[f64::NAN; 50], &times), None);
    }
}
