//! Records: columns of numbers over time.

use crate::csv::{Column, Table};
use crate::finding::{Cause, Refusal};

/// A record of an experiment.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Record {
    /// Its name in messages, as that of its file.
    pub name: String,
    /// Time of each row, s.
    pub time: Vec<f64>,
    /// The other columns.
    pub columns: Vec<Column>,
    /// Line in the file of each row; empty where it comes from memory.
    pub lines: Vec<usize>,
}

impl Record {
    /// A record in memory, of named columns.
    pub fn new(name: &str, time: Vec<f64>, columns: Vec<(String, Vec<f64>)>) -> Self {
        let columns = columns.into_iter().map(|(name, values)| Column { name, values, ..Column::default() });
        Record { name: name.to_owned(), time, columns: columns.collect(), lines: Vec::new() }
    }

    /// The records of a table: one, or one for each value of its column `record` (read as text). Time is the column of this
    /// name; without a name, the column `time`, or else the first of numbers. It is in s, or in the unit that the table has for it.
    ///
    /// # Errors
    /// A name that the table lacks or that labels records, a unit that isn't one of time.
    pub fn of_table(name: &str, table: &Table, time: Option<&str>) -> Result<Vec<Self>, Refusal> {
        let refuse = |text: String| Refusal::new(Cause::Request, text);
        let missing = || refuse(format!("{name} has no column `{}` for the time", time.unwrap_or("time")));
        let time = time_of(table, time).ok_or_else(missing)?;
        if !time.texts.is_empty() {
            return Err(refuse(format!("{name}: `{}` labels records, it can't be the time", time.name)));
        }
        let unit = time.unit.as_deref().unwrap_or("s");
        let [times, over] = seconds(unit)
            .ok_or_else(|| refuse(format!("{name}: {} is in {unit}: must be in s, ms, us, min or h", time.name)))?;
        let label = table.column(LABEL).filter(|column| !column.texts.is_empty());
        let mut labels: Vec<&String> = Vec::new();
        for text in label.iter().flat_map(|column| &column.texts) {
            if !labels.contains(&text) {
                labels.push(text);
            }
        }
        let part = |label_of_part: Option<&String>| {
            let belongs = |row: usize| label.is_none_or(|label| Some(&label.texts[row]) == label_of_part);
            let rows: Vec<usize> = (0..table.rows()).filter(|row| belongs(*row)).collect();
            let of = |column: &Column| rows.iter().map(|row| column.values[*row]).collect::<Vec<_>>();
            let others = table.columns.iter().filter(|column| column.name != time.name && column.texts.is_empty());
            let columns = others.map(|column| Column { values: of(column), ..column.clone() }).collect();
            let name = label_of_part.map_or(name.to_owned(), |label| format!("{name}, record {label}"));
            let time = of(time).into_iter().map(|time| time * times / over).collect();
            Record {
                name,
                time,
                columns,
                lines: rows.iter().filter_map(|row| table.lines.get(*row).copied()).collect(),
            }
        };
        Ok(if labels.is_empty() {
            vec![part(None)]
        } else {
            labels.into_iter().map(|label| part(Some(label))).collect()
        })
    }

    /// The number of rows.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// True if there is no row.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// The column of this name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }

    /// Number of a row in messages: its line in the file, or its place from 1.
    pub(crate) fn place(&self, row: usize) -> usize {
        self.lines.get(row).copied().unwrap_or(row + 1)
    }

    /// Word for such a number.
    pub(crate) fn row_word(&self) -> &'static str {
        if self.lines.is_empty() { "row" } else { "line" }
    }

    /// Refuses times that don't grow, and columns of other lengths than the time's.
    pub(crate) fn check(&self) -> Result<(), Refusal> {
        for column in &self.columns {
            if column.values.len() != self.time.len() {
                let [has, rows] = [column.values.len(), self.time.len()];
                let text = format!("{}: `{}` has {has} values for {rows} times", self.name, column.name);
                return Err(Refusal::new(Cause::Request, text));
            }
        }
        if self.is_empty() {
            return Err(Refusal::new(Cause::TooShort, format!("{} has no rows", self.name)));
        }
        for column in &self.columns {
            if let Some(row) = column.values.iter().position(|value| value.is_infinite()) {
                let place = format!("{}: {} {}", self.name, self.row_word(), self.place(row));
                let text = format!("{place}: {} = {}: must be finite or NaN", column.name, column.values[row]);
                return Err(Refusal::new(Cause::Request, text));
            }
        }
        let mut before = f64::NEG_INFINITY;
        for (row, &time) in self.time.iter().enumerate() {
            let place = format!("{}: {} {}", self.name, self.row_word(), self.place(row));
            if !time.is_finite() {
                return Err(Refusal::new(Cause::Time, format!("{place}: time = {time}: must be a finite number")));
            }
            if time <= before {
                return Err(Refusal::new(Cause::Time, format!("{place}: time = {time} after {before}: must grow")));
            }
            before = time;
        }
        Ok(())
    }
}

/// The column of a table that is the time: the one of this name; without a name, `time`, or else the first of numbers.
pub fn time_of<'a>(table: &'a Table, name: Option<&str>) -> Option<&'a Column> {
    let first = || table.columns.iter().find(|column| column.texts.is_empty());
    name.map_or_else(|| table.column("time").or_else(first), |name| table.column(name))
}

/// Numerator and denominator of a unit of time in s, `None` of another unit: 1/1000 isn't exact.
pub fn seconds(unit: &str) -> Option<[f64; 2]> {
    match unit {
        "s" => Some([1.0, 1.0]),
        "ms" => Some([1.0, 1e3]),
        "us" | "µs" | "μs" => Some([1.0, 1e6]),
        "min" => Some([60.0, 1.0]),
        "h" => Some([3600.0, 1.0]),
        _ => None,
    }
}

/// Name of the column that labels the record of each row.
pub const LABEL: &str = "record";

/// The signals that a model is about.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Signals {
    /// Names of the inputs.
    pub inputs: Vec<String>,
    /// Names of the states, or of the outputs where only these are measured.
    pub measured: Vec<String>,
}

impl Signals {
    /// Signals by their names.
    pub fn new(inputs: &[&str], measured: &[&str]) -> Self {
        let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Signals { inputs: owned(inputs), measured: owned(measured) }
    }

    /// Refuses names that a record lacks or that are given twice.
    pub(crate) fn check(&self, records: &[Record]) -> Result<(), Refusal> {
        let refuse = |text: String| Err(Refusal::new(Cause::Request, text));
        if self.inputs.is_empty() || self.measured.is_empty() {
            return refuse("a model needs at least one input and one state or output".to_owned());
        }
        let all: Vec<&String> = self.inputs.iter().chain(&self.measured).collect();
        if let Some((_, twice)) = all.iter().enumerate().find(|(k, name)| all[..*k].contains(name)) {
            return refuse(format!("`{twice}` is given twice"));
        }
        for record in records {
            for name in &all {
                if record.column(name).is_none() {
                    let known: Vec<_> = record.columns.iter().map(|column| column.name.as_str()).collect();
                    return refuse(format!("{} has no column `{name}`; there are: {}", record.name, known.join(", ")));
                }
            }
        }
        if records.is_empty() {
            return refuse("there is no record".to_owned());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Table {
        Table::read(text.as_bytes(), &[LABEL]).unwrap()
    }

    #[test]
    fn a_table_is_one_record_or_one_for_each_label() {
        let one = Record::of_table("file", &table("time,u\n0,1\n1,2\n"), None).unwrap();
        assert_eq!((one.len(), one[0].len(), one[0].place(1), one[0].row_word()), (1, 2, 3, "line"));
        let several = table("record,u,t\nfirst,1,0\nfirst,2,1\nsecond,3,0\n");
        let several = Record::of_table("file", &several, Some("t")).unwrap();
        assert_eq!(
            several.iter().map(|record| record.name.as_str()).collect::<Vec<_>>(),
            ["file, record first", "file, record second"]
        );
        assert_eq!(several[1].column("u").unwrap().values, [3.0]);
        assert_eq!((several[1].time[0], several[1].place(0)), (0.0, 4));
    }

    #[test]
    fn a_time_that_is_not_there_is_refused() {
        let refusal = Record::of_table("file", &table("time,u\n0,1\n"), Some("t")).unwrap_err();
        assert_eq!(refusal.text, "file has no column `t` for the time");
        let labelled = table("record,t,u\nfirst,0,1\nfirst,1,2\n");
        assert_eq!(Record::of_table("file", &labelled, None).unwrap()[0].time, [0.0, 1.0]);
        let refusal = Record::of_table("file", &labelled, Some("record")).unwrap_err();
        assert_eq!(refusal.text, "file: `record` labels records, it can't be the time");
    }

    #[test]
    fn times_in_other_units_are_converted() {
        let time = |text: &str| Record::of_table("file", &table(text), None).map(|records| records[0].time.clone());
        assert_eq!(time("time [ms],u\n0,1\n20,2\n").unwrap(), [0.0, 0.02]);
        assert_eq!(time("t,u\nmin,V\n0,1\n0.5,2\n").unwrap(), [0.0, 30.0]);
        let refusal = time("time [d],u\n0,1\n1,2\n").unwrap_err();
        assert_eq!(refusal.text, "file: time is in d: must be in s, ms, us, min or h");
    }
}
