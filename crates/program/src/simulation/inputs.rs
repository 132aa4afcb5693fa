//! Inputs over time, from a file of comma-separated values.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use crate::error::Error;
use crate::fmu::{Instance, SHOWS_VARIABLES};
use crate::model_description::{ModelDescription, Variable};
use crate::{near, text_file};

/// Values of input variables at some times.
#[derive(Debug, Clone, PartialEq)]
pub struct Inputs {
    times: Vec<f64>,
    columns: Vec<Column>,
}

#[derive(Debug, Clone, PartialEq)]
struct Column {
    reference: u32,
    kind: Kind,
    values: Vec<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Linear between the times, unless two of them are the same: there it jumps.
    Continuous,
    /// As at the last time.
    Held,
    Integer,
    Boolean,
}

/// On which side of its jumps an input is taken.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Before,
    After,
}

/// The longest line of a file, in bytes.
const LONGEST_LINE: u64 = 1 << 22;

/// The lines of a file that aren't empty, one after the other: what was recorded may be longer than the memory is.
struct Lines<'a> {
    file: &'a Path,
    reader: BufReader<File>,
    number: usize,
    bytes: Vec<u8>,
}

impl<'a> Lines<'a> {
    fn open(file: &'a Path) -> Result<Self, Error> {
        let reader = BufReader::new(text_file::open(file).map_err(Error::file(file))?);
        Ok(Lines { file, reader, number: 0, bytes: Vec::new() })
    }

    /// The next one with its number; none at the end of the file.
    fn next(&mut self) -> Result<Option<(usize, &str)>, Error> {
        let failed = |number: usize, reason: String| Error::Description {
            file: self.file.to_owned(),
            reason: format!("line {number}: {reason}"),
        };
        loop {
            self.bytes.clear();
            self.number += 1;
            let read = self.reader.by_ref().take(LONGEST_LINE + 1).read_until(b'\n', &mut self.bytes);
            if read.map_err(Error::file(self.file))? == 0 {
                return Ok(None);
            }
            if self.bytes.len() as u64 > LONGEST_LINE {
                return Err(failed(self.number, format!("is longer than {LONGEST_LINE} bytes")));
            }
            if !self.bytes.trim_ascii().is_empty() {
                break;
            }
        }
        let text = str::from_utf8(&self.bytes).map_err(|_| failed(self.number, "is not UTF-8".to_owned()))?;
        // Spreadsheets begin a file with this mark.
        Ok(Some((self.number, text.strip_prefix('\u{feff}').unwrap_or(text).trim_end_matches(['\n', '\r']))))
    }
}

impl Inputs {
    /// Reads a file: a line of names, the first of which is `time`, then a line of numbers for each time, s.
    ///
    /// # Errors
    /// What is wrong, with its line; a name that is no input of the unit.
    pub fn read(file: &Path, description: &ModelDescription) -> Result<Self, Error> {
        let refuse = |line: usize, reason: String| {
            let reason = format!("line {line}: {reason}");
            Error::Description { file: file.to_owned(), reason }
        };
        let mut lines = Lines::open(file)?;
        let Some((_, head)) = lines.next()? else {
            return Err(refuse(1, "must be the names of the columns".to_owned()));
        };
        let names = text_file::csv_fields(head);
        if names.first().is_none_or(|name| name.trim() != "time") {
            return Err(refuse(1, "the first column must be `time`, in s".to_owned()));
        }
        if let Some((_, twice)) = names.iter().enumerate().find(|(k, name)| names[..*k].contains(name)) {
            return Err(refuse(1, format!("`{}` is named twice", twice.trim())));
        }
        let inputs = description.variables.iter().filter(|v| v.causality == "input" && v.kind != "String");
        let column = |name: &String| {
            let found = inputs.clone().find(|variable| variable.name == name.trim());
            found.map(Column::of).ok_or_else(|| {
                let known: Vec<_> = inputs.clone().map(|variable| variable.name.as_str()).collect();
                let choice = near::choice(name.trim(), &known, SHOWS_VARIABLES);
                refuse(1, format!("the FMU has no input `{}`; {choice}", name.trim()))
            })
        };
        let mut columns: Vec<Column> = names[1..].iter().map(column).collect::<Result<_, _>>()?;
        let mut times = Vec::new();
        while let Some((line, text)) = lines.next()? {
            let fields = text_file::csv_fields(text);
            if fields.len() != names.len() {
                return Err(refuse(
                    line,
                    format!("has {} values, but there are {} columns", fields.len(), names.len()),
                ));
            }
            let number = |field: &String, name: &String| {
                let number = field.trim().parse().ok().filter(|number: &f64| number.is_finite());
                number.ok_or_else(|| refuse(line, format!("{} = {field}: must be a finite number", name.trim())))
            };
            let time = number(&fields[0], &names[0])?;
            if times.last().is_some_and(|last| time < *last) {
                return Err(refuse(line, format!("time = {time}: must not be before the time of the line above")));
            }
            times.push(time);
            for ((column, field), name) in columns.iter_mut().zip(&fields[1..]).zip(&names[1..]) {
                let value = number(field, name)?;
                column.check(value).map_err(|allowed| refuse(line, format!("{} = {value}: {allowed}", name.trim())))?;
                column.values.push(value);
            }
        }
        if times.is_empty() {
            return Err(refuse(2, "the file must have at least one line of values".to_owned()));
        }
        Ok(Inputs { times, columns })
    }

    /// Sets the inputs of a unit to their values at a time: before the first the first, after the last the last.
    ///
    /// # Errors
    /// When the unit refuses.
    pub(super) fn set(&self, instance: &Instance, time: f64) -> Result<(), Error> {
        for column in &self.columns {
            let (reference, value) = ([column.reference], self.value(column, time));
            match column.kind {
                Kind::Continuous | Kind::Held => instance.set_real(&reference, &[value])?,
                Kind::Integer => instance.set_integer(&reference, &[value as i32])?,
                Kind::Boolean => instance.set_boolean(&reference, &[value as i32])?,
            }
        }
        Ok(())
    }

    /// The continuous ones alone, between events.
    pub(super) fn set_continuous(&self, instance: &Instance, time: f64, side: Side) -> Result<(), Error> {
        for column in self.columns.iter().filter(|column| column.kind == Kind::Continuous) {
            let value = if side == Side::Before { self.value_before(column, time) } else { self.value(column, time) };
            instance.set_real(&[column.reference], &[value])?;
        }
        Ok(())
    }

    /// The next time after one at which something may jump, or a slope changes.
    pub(super) fn next_time(&self, time: f64) -> Option<f64> {
        self.times.get(self.times.partition_point(|&other| other <= time)).copied()
    }

    fn value(&self, column: &Column, time: f64) -> f64 {
        let after = self.times.partition_point(|&other| other <= time);
        let Some(before) = after.checked_sub(1) else { return column.values[0] };
        if column.kind != Kind::Continuous || after == self.times.len() {
            return column.values[before];
        }
        let part = (time - self.times[before]) / (self.times[after] - self.times[before]);
        column.values[before] + part * (column.values[after] - column.values[before])
    }
}

impl Inputs {
    /// Where a continuous input jumps, its value before that.
    fn value_before(&self, column: &Column, time: f64) -> f64 {
        let place = self.times.partition_point(|&other| other < time);
        if self.times.get(place) == Some(&time) { column.values[place] } else { self.value(column, time) }
    }
}

impl Column {
    fn of(variable: &Variable) -> Self {
        let kind = match (variable.kind.as_str(), variable.variability.as_str()) {
            ("Real", "continuous") => Kind::Continuous,
            ("Real", _) => Kind::Held,
            ("Boolean", _) => Kind::Boolean,
            _ => Kind::Integer,
        };
        Column { reference: variable.reference, kind, values: Vec::new() }
    }

    /// True if it may have a value; what is allowed.
    fn check(&self, value: f64) -> Result<(), &'static str> {
        match self.kind {
            Kind::Integer if value != value.trunc() || value.abs() > f64::from(i32::MAX) => {
                Err("must be a whole number")
            }
            Kind::Boolean if value != 0.0 && value != 1.0 => Err("must be 0 or 1"),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inputs(kind: Kind) -> Inputs {
        let column = Column { reference: 0, kind, values: vec![1.0, 2.0, 5.0, 6.0] };
        Inputs { times: vec![0.0, 1.0, 1.0, 2.0], columns: vec![column] }
    }

    #[test]
    fn a_continuous_input_is_linear_between_its_times_and_jumps_where_two_are_the_same() {
        let inputs = inputs(Kind::Continuous);
        let value = |time| inputs.value(&inputs.columns[0], time);
        assert_eq!([-1.0, 0.0, 0.5, 1.0, 1.5, 2.0, 9.0].map(value), [1.0, 1.0, 1.5, 5.0, 5.5, 6.0, 6.0]);
        assert_eq!(
            [0.0, 0.5, 1.0, 2.0].map(|time| inputs.value_before(&inputs.columns[0], time)),
            [1.0, 1.5, 2.0, 6.0]
        );
        assert_eq!([-1.0, 0.0, 1.0, 2.0].map(|time| inputs.next_time(time)), [Some(0.0), Some(1.0), Some(2.0), None]);
    }

    #[test]
    fn a_discrete_input_is_held() {
        let inputs = inputs(Kind::Held);
        assert_eq!([0.5, 1.0, 1.9].map(|time| inputs.value(&inputs.columns[0], time)), [1.0, 5.0, 5.0]);
    }
}
