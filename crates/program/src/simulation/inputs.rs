//! Inputs over time, from a table: CSV, Parquet or MATLAB.

use std::path::Path;

use adaptive_fmu_identification::seconds;

use crate::error::Error;
use crate::fmu::{Instance, SHOWS_VARIABLES};
use crate::model_description::{ModelDescription, UnitDefinition, Variable};
use crate::near;
use crate::tables::{self, Column as TableColumn, Table};

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
    /// Linear between the times; two equal times are a jump.
    Continuous,
    /// Value of the last time.
    Sampled,
    Integer,
    Boolean,
}

/// A column that can't be an input.
struct Wrong {
    /// The row of a single value.
    row: Option<usize>,
    reason: String,
}

/// Side of its jumps on which an input is evaluated.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Before,
    After,
}

/// Names of the column of times.
const TIMES: [&str; 3] = ["time", "Time", "t"];
/// Jumps that are listed.
const SHOWN_JUMPS: usize = 5;

/// A table over time with columns for inputs of an FMU.
#[derive(Debug)]
pub struct Read {
    /// The inputs.
    pub inputs: Inputs,
    /// Columns that are no inputs.
    pub others: Vec<TableColumn>,
    /// Assumptions while the file was read.
    pub assumed: Vec<String>,
    /// Parts of the file that aren't columns of numbers.
    pub left_out: Vec<String>,
    /// Place of the names in messages.
    head: &'static str,
}

impl Inputs {
    /// Reads a file of columns: `time` is the time, s, and the others are inputs. In CSV the time is the first.
    ///
    /// # Errors
    /// Wrong content, with its line; a name that isn't an input of the FMU.
    pub fn read(file: &Path, description: &ModelDescription) -> Result<Read, Error> {
        let read = Self::read_some(file, description)?;
        let Some(TableColumn { name, .. }) = read.others.first() else { return Ok(read) };
        let known: Vec<_> = of_unit(description).map(|variable| variable.name.as_str()).collect();
        let choice = near::choice(name, &known, SHOWS_VARIABLES);
        let reason = format!("{}the FMU has no input `{name}`; {choice}", read.head);
        Err(Error::Description { file: file.to_owned(), reason })
    }

    /// Reads a file that may have other columns, too.
    ///
    /// # Errors
    /// The wrong line, with the reason.
    pub fn read_some(file: &Path, description: &ModelDescription) -> Result<Read, Error> {
        let refuse = |reason: String| Error::Description { file: file.to_owned(), reason };
        let mut table = tables::read(file, &[])?;
        let head = table.head();
        let [factor, over] = time_in_s(&mut table).map_err(|reason| refuse(format!("{head}{reason}")))?;
        let refuse_at = |row: usize, reason: String| refuse(format!("{}: {reason}", table.place(row)));
        let mut columns = table.columns.iter();
        let Some(time) = columns.next() else { return Err(refuse("has no columns".to_owned())) };
        if let Some(row) = time.values.iter().position(|time| !time.is_finite()) {
            return Err(refuse_at(row, format!("{} must be a finite number", time.name)));
        }
        if let Some(row) = (1..table.rows()).find(|&row| time.values[row] < time.values[row - 1]) {
            let above = if head.is_empty() { "row before" } else { "line above" };
            let reason = format!("time = {}: must not be before the time of the {above}", time.values[row]);
            return Err(refuse_at(row, reason));
        }
        let times = time.values.iter().map(|time| time * factor / over).collect();
        let mut inputs = Inputs { times, columns: Vec::new() };
        let (mut others, mut converted) = (Vec::new(), Vec::new());
        for column in columns {
            let Some(variable) = of_unit(description).find(|variable| variable.name == column.name) else {
                others.push(column.clone());
                continue;
            };
            let wrong = |Wrong { row, reason }: Wrong| match row {
                Some(row) => refuse_at(row, reason),
                None => refuse(format!("{head}{reason}")),
            };
            inputs.columns.push(Column::read(column, variable).map_err(wrong)?);
            converted.extend(conversion(column, variable));
        }
        let mut assumed = table.assumed;
        let (name, unit) = (&time.name, time.unit.as_deref().unwrap_or("s"));
        assumed.push(format!("the time is the column `{name}`, in {unit}"));
        assumed.extend(converted);
        assumed.extend(inputs.assumed(description));
        Ok(Read { inputs, others, assumed, left_out: table.left_out, head })
    }

    /// Inputs from memory, with a zero-order hold if asked for.
    ///
    /// # Errors
    /// A name that isn't an input of the FMU, times that don't increase, or values that an input can't have.
    pub fn of_columns(
        description: &ModelDescription,
        times: &[f64],
        columns: &[&TableColumn],
        is_sampled: bool,
    ) -> Result<Self, String> {
        if let Some(row) =
            (1..times.len()).find(|&row| times[row].total_cmp(&times[row - 1]).is_le() || times[row].is_nan())
        {
            return Err(format!("time = {} after {}: times must increase", times[row], times[row - 1]));
        }
        let column = |column: &&TableColumn| {
            let name = &column.name;
            let Some(variable) = of_unit(description).find(|variable| variable.name == *name) else {
                let known: Vec<_> = of_unit(description).map(|variable| variable.name.as_str()).collect();
                return Err(format!("the FMU has no input `{name}`; {}", near::choice(name, &known, SHOWS_VARIABLES)));
            };
            let at = |row: usize| format!(", at {} s", times[row]);
            let wrong = |Wrong { row, reason }: Wrong| format!("{reason}{}", row.map_or(String::new(), at));
            let read = Column::read(column, variable).map_err(wrong)?;
            let kind = if is_sampled && read.kind == Kind::Continuous { Kind::Sampled } else { read.kind };
            Ok(Column { kind, ..read })
        };
        let columns = columns.iter().map(column).collect::<Result<_, _>>()?;
        Ok(Inputs { times: times.to_vec(), columns })
    }

    /// True if an input has values here.
    pub fn has(&self, reference: u32) -> bool {
        self.columns.iter().any(|column| column.reference == reference)
    }

    /// The variables of an FMU that have values here.
    pub fn variables<'a>(&self, description: &'a ModelDescription) -> impl Iterator<Item = &'a Variable> {
        of_unit(description).filter(|variable| self.has(variable.reference))
    }

    /// Assumptions about them, in words.
    fn assumed(&self, description: &ModelDescription) -> Vec<String> {
        let joined = |which: &dyn Fn(&Column, &Variable) -> bool| {
            let name = |column: &Column| {
                let mut own = of_unit(description).filter(|variable| variable.reference == column.reference);
                own.find(|variable| which(column, variable)).map(|variable| variable.name.as_str())
            };
            let names: Vec<_> = self.columns.iter().filter_map(name).collect();
            names.join(", ")
        };
        let jumps = self.times.windows(2).filter(|pair| pair[0] == pair[1]);
        let jumps: Vec<_> = jumps.map(|pair| format!("{} s", pair[0])).collect();
        let more = jumps.len().saturating_sub(SHOWN_JUMPS);
        let jumps = jumps[..jumps.len() - more].join(", ");
        let jumps = if more > 0 { format!("{jumps} and {more} more") } else { jumps };
        let is_parameter = |variable: &Variable| variable.causality == "parameter";
        let lines = [
            ("jumps, since two rows have the same time: ", jumps),
            ("interpolated linearly: ", joined(&|column, _| column.kind == Kind::Continuous)),
            ("zero-order hold: ", joined(&|column, own| column.kind != Kind::Continuous && !is_parameter(own))),
            ("set parameters, from row to row: ", joined(&|_, own| is_parameter(own))),
        ];
        lines.iter().filter(|(_, names)| !names.is_empty()).map(|(words, names)| format!("{words}{names}")).collect()
    }

    /// The times, s.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Sets the inputs to their values at a time: the first ones before the first time, the last ones after the last.
    ///
    /// # Errors
    /// When the FMU refuses.
    pub(crate) fn set(&self, instance: &Instance, time: f64) -> Result<(), Error> {
        for column in &self.columns {
            let (reference, value) = ([column.reference], self.value(column, time));
            match column.kind {
                Kind::Continuous | Kind::Sampled => instance.set_real(&reference, &[value])?,
                Kind::Integer => instance.set_integer(&reference, &[value as i32])?,
                Kind::Boolean => instance.set_boolean(&reference, &[value as i32])?,
            }
        }
        Ok(())
    }

    /// Sets the continuous ones only, between events.
    pub(super) fn set_continuous(&self, instance: &Instance, time: f64, side: Side) -> Result<(), Error> {
        for column in self.columns.iter().filter(|column| column.kind == Kind::Continuous) {
            let value = if side == Side::Before { self.value_before(column, time) } else { self.value(column, time) };
            instance.set_real(&[column.reference], &[value])?;
        }
        Ok(())
    }

    /// The next time after this one at which an input may jump, or a slope changes.
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
    /// Value of a continuous input, before the jump where it has one.
    fn value_before(&self, column: &Column, time: f64) -> f64 {
        let place = self.times.partition_point(|&other| other < time);
        if self.times.get(place) == Some(&time) { column.values[place] } else { self.value(column, time) }
    }
}

/// The numeric variables of an FMU that may have values over time: inputs, and tunable parameters, which have a
/// zero-order hold.
fn of_unit(description: &ModelDescription) -> impl Iterator<Item = &Variable> {
    let may_move = |v: &&Variable| v.causality == "input" || v.causality == "parameter" && v.variability == "tunable";
    description.variables.iter().filter(may_move).filter(|v| v.kind != "String")
}

/// Moves the column of times to the front; returns numerator and denominator of its unit in s.
fn time_in_s(table: &mut Table) -> Result<[f64; 2], String> {
    let is_time = |column: &TableColumn| TIMES.contains(&column.name.as_str());
    let named = |name: &&str| table.columns.iter().position(|column| column.name == **name);
    let place = if is_time(&table.columns[0]) { 0 } else { TIMES.iter().find_map(named).unwrap_or(0) };
    table.columns[..=place].rotate_right(1);
    let time = &table.columns[0];
    let given = time.unit.as_ref().map_or_else(String::new, |unit| format!(" in {unit}"));
    seconds(time.unit.as_deref().unwrap_or("s")).filter(|_| is_time(time)).ok_or_else(|| {
        let first = if is_time(time) { "the time" } else { "the first column" };
        format!("{first} is `{}`{given}: must be `time`, in s, ms, us, min or h", time.name)
    })
}

/// The conversion of a column to the unit of its variable, in words; none if they are the same.
pub fn conversion(column: &TableColumn, variable: &Variable) -> Option<String> {
    let (given, own) = (column.unit.as_ref()?, variable.measure.as_ref()?);
    (*given != own.name).then(|| format!("{} was converted from {given} to {}", column.name, own.name))
}

/// The values of a column in the unit of a variable.
///
/// # Errors
/// A unit of another quantity.
pub fn values_of(column: &TableColumn, variable: &Variable) -> Result<Vec<f64>, String> {
    let (Some(given), Some(own)) = (&column.unit, &variable.measure) else { return Ok(column.values.clone()) };
    let given = UnitDefinition::named(given);
    let allowed = format!("must be in {}, or a unit of that quantity", own.name);
    let refuse = || format!("{} is in {}: {allowed}", column.name, given.name);
    // Unknown units count as the same only if their names are.
    let is_unknown = given.dimension.is_none() || own.dimension.is_none();
    let conversion = given.to(own).filter(|_| !is_unknown || given.name == own.name).ok_or_else(refuse)?;
    Ok(column.values.iter().map(|value| conversion.of(*value)).collect())
}

fn shown(value: f64) -> String {
    if value.is_nan() { "NaN".to_owned() } else { value.to_string() }
}

impl Column {
    /// A column of a table in the unit of its variable.
    fn read(column: &TableColumn, variable: &Variable) -> Result<Self, Wrong> {
        let values = values_of(column, variable).map_err(|reason| Wrong { row: None, reason })?;
        let own = Column { values, ..Column::of(variable) };
        for (row, &value) in own.values.iter().enumerate() {
            let reason = |allowed: &str| format!("{} = {}: {allowed}", column.name, shown(value));
            own.check(value).map_err(|allowed| Wrong { row: Some(row), reason: reason(allowed) })?;
        }
        Ok(own)
    }

    fn of(variable: &Variable) -> Self {
        let kind = match (variable.kind.as_str(), variable.variability.as_str()) {
            ("Real", "continuous") => Kind::Continuous,
            ("Real", _) => Kind::Sampled,
            ("Boolean", _) => Kind::Boolean,
            _ => Kind::Integer,
        };
        Column { reference: variable.reference, kind, values: Vec::new() }
    }

    /// Checks a value. The error names allowed ones.
    fn check(&self, value: f64) -> Result<(), &'static str> {
        match self.kind {
            _ if !value.is_finite() => Err("must be a finite number"),
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
    fn a_discrete_input_is_constant_between_its_rows() {
        let inputs = inputs(Kind::Sampled);
        assert_eq!([0.5, 1.0, 1.9].map(|time| inputs.value(&inputs.columns[0], time)), [1.0, 5.0, 5.0]);
    }
}
