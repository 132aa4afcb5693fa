//! Tables of comma-separated values as measuring tools and spreadsheets write them.
//!
//! The separator is a comma, a semicolon or a tab, whichever the line of names has; a separator at the end of lines is
//! ignored. Numbers may have a decimal comma where that can't be a separator. Names may be quoted and may be followed by a
//! unit of measurement in brackets, `speed [rpm]`, or units have a row of their own below the names. `true` and `false`
//! are 1 and 0; an empty cell or `NaN` is NaN.

use std::collections::BTreeSet;
use std::fmt;
use std::io::{BufRead, Read};

/// The longest line, in bytes.
const LONGEST_LINE: u64 = 1 << 22;

/// A table of numbers, and columns of text where these were asked for.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// The columns, in their order.
    pub columns: Vec<Column>,
    /// The line in the file of each row; empty where the file has no lines.
    pub lines: Vec<usize>,
    /// Assumptions while it was read, such as the separator and the decimal mark.
    pub assumed: Vec<String>,
    /// Parts of the file that are no columns of numbers, with the reason.
    pub left_out: Vec<String>,
}

/// A column of a table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Its unit of measurement as the file has it.
    pub unit: Option<String>,
    /// A number for each row; NaN where there is none.
    pub values: Vec<f64>,
    /// The unchanged cells of a column that was requested as text.
    pub texts: Vec<String>,
}

/// Reason for which a table can't be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// The line of the file, from 1.
    pub line: usize,
    /// The fault there, and what is allowed.
    pub reason: String,
}

impl Fault {
    fn new(line: usize, reason: impl Into<String>) -> Self {
        Fault { line, reason: reason.into() }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.reason)
    }
}

impl std::error::Error for Fault {}

impl Table {
    /// Reads a table. Columns with these names are read as text.
    ///
    /// # Errors
    /// A fault with its line.
    pub fn read(reader: impl BufRead, texts: &[&str]) -> Result<Self, Fault> {
        let mut lines = Lines { reader, number: 0, bytes: Vec::new() };
        let Some((line, head)) = lines.next()? else { return Err(Fault::new(1, "must be the names of the columns")) };
        let separator = separator(head);
        let mut names = fields(head, separator).map_err(|reason| Fault::new(line, reason))?;
        let is_open = names.len() > 1 && names.last().is_some_and(|name| name.trim().is_empty());
        if is_open {
            names.pop();
        }
        let mut table = Table { columns: names.iter().map(|name| Column::named(name)).collect(), ..Table::default() };
        table.check_names().map_err(|reason| Fault::new(line, reason))?;
        let mut cells = Cells { separator, ..Cells::default() };
        while let Some((line, text)) = lines.next()? {
            let mut row = fields(text, separator).map_err(|reason| Fault::new(line, reason))?;
            // A separator at the end: in all lines, or only in those of values.
            if row.len() == names.len() + 1 && row.last().is_some_and(|field| field.trim().is_empty()) {
                row.pop();
            }
            if table.lines.is_empty() && table.columns.iter().all(|column| column.unit.is_none()) && is_units(&row) {
                table.set_units(line, &row)?;
                table.assumed.push(format!("line {line} has the units of measurement"));
                continue;
            }
            table.check_count(line, row.len(), separator)?;
            for (column, field) in table.columns.iter_mut().zip(&row) {
                if texts.contains(&column.name.as_str()) {
                    column.texts.push(field.trim().to_owned());
                } else {
                    let value = cells.number(field.trim());
                    let value = value.map_err(|allowed| {
                        Fault::new(line, format!("{} = {}: {allowed}", column.name, shown(field)))
                    })?;
                    column.values.push(value);
                }
            }
            table.lines.push(line);
        }
        if table.lines.is_empty() {
            return Err(Fault::new(lines.number.max(2), "the table must have at least one line of values"));
        }
        table.assumed.splice(0..0, cells.assumed());
        Ok(table)
    }

    /// A table of columns that have no lines in a file.
    ///
    /// # Errors
    /// A name that is missing or given twice, or no rows.
    pub fn of_columns(columns: Vec<Column>) -> Result<Self, String> {
        let table = Table { columns, ..Table::default() };
        table.check_names()?;
        if table.rows() == 0 {
            return Err("the table must have at least one row of values".to_owned());
        }
        Ok(table)
    }

    /// The number of rows.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |column| column.values.len().max(column.texts.len()))
    }

    /// The place of a row in messages: its line in the file, or its number from 1.
    pub fn place(&self, row: usize) -> String {
        self.lines.get(row).map_or_else(|| format!("row {}", row + 1), |line| format!("line {line}"))
    }

    /// The place of the names of the columns in messages, if they have one.
    pub fn head(&self) -> &'static str {
        if self.lines.is_empty() { "" } else { "line 1: " }
    }

    /// The column of this name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }

    fn check_names(&self) -> Result<(), String> {
        let mut names = BTreeSet::new();
        for (k, column) in self.columns.iter().enumerate() {
            if column.name.is_empty() {
                return Err(format!("column {} has no name", k + 1));
            }
            if !names.insert(&column.name) {
                return Err(format!("`{}` is the name of two columns", column.name));
            }
        }
        if self.columns.iter().all(|column| column.name.parse::<f64>().is_ok()) {
            return Err("must be the names of the columns, not numbers".to_owned());
        }
        Ok(())
    }

    fn check_count(&self, line: usize, given: usize, separator: char) -> Result<(), Fault> {
        let count = self.columns.len();
        if given == count {
            return Ok(());
        }
        let mut reason = format!("has {given} values, but there are {count} columns");
        if separator == ',' && given > count {
            reason += "; with decimal commas the separator must be ; or a tab";
        }
        Err(Fault::new(line, reason))
    }

    fn set_units(&mut self, line: usize, row: &[String]) -> Result<(), Fault> {
        if row.len() != self.columns.len() {
            let reason = format!("has {} units, but there are {} columns", row.len(), self.columns.len());
            return Err(Fault::new(line, reason));
        }
        for (column, field) in self.columns.iter_mut().zip(row) {
            let unit = field.trim();
            let unit = unit.strip_prefix('[').and_then(|unit| unit.strip_suffix(']')).unwrap_or(unit).trim();
            column.unit = Some(unit.to_owned()).filter(|unit| !unit.is_empty());
        }
        Ok(())
    }
}

impl Column {
    /// Name and unit of a text such as `speed [rpm]`. An index isn't taken for a unit: `x[1]`, `K[1,2]`.
    pub fn named(field: &str) -> Self {
        let field = field.trim();
        let split = field.strip_suffix(']').and_then(|rest| rest.rsplit_once('['));
        let is_index = |name: &str, unit: &str| {
            let digits =
                unit.split(',').all(|part| !part.is_empty() && part.trim().bytes().all(|b| b.is_ascii_digit()));
            digits && !name.ends_with(char::is_whitespace)
        };
        match split.filter(|(name, unit)| !name.trim().is_empty() && !is_index(name, unit)) {
            Some((name, unit)) => {
                let unit = Some(unit.trim().to_owned()).filter(|unit| !unit.is_empty());
                Column { name: name.trim().to_owned(), unit, ..Column::default() }
            }
            None => Column { name: field.to_owned(), ..Column::default() },
        }
    }
}

/// The lines that aren't empty, one after the other: a record may be longer than the memory is.
struct Lines<R> {
    reader: R,
    number: usize,
    bytes: Vec<u8>,
}

impl<R: BufRead> Lines<R> {
    /// The next one with its number; none at the end.
    fn next(&mut self) -> Result<Option<(usize, &str)>, Fault> {
        loop {
            self.bytes.clear();
            let read = self.reader.by_ref().take(LONGEST_LINE + 1).read_until(b'\n', &mut self.bytes);
            if read.map_err(|error| Fault::new(self.number + 1, error.to_string()))? == 0 {
                return Ok(None);
            }
            self.number += 1;
            if self.bytes.len() as u64 > LONGEST_LINE {
                return Err(Fault::new(self.number, format!("is longer than {LONGEST_LINE} bytes")));
            }
            if !self.bytes.trim_ascii().is_empty() {
                break;
            }
        }
        let text = str::from_utf8(&self.bytes)
            .map_err(|_| Fault::new(self.number, "is not UTF-8: save the file as CSV UTF-8"))?;
        // Spreadsheets begin a file with a byte order mark.
        Ok(Some((self.number, text.strip_prefix('\u{feff}').unwrap_or(text).trim_end_matches(['\n', '\r']))))
    }
}

/// The separator of a line of names: a tab or a semicolon where there is one outside of quotes, else a comma.
fn separator(head: &str) -> char {
    let has = |separator: char| {
        let mut quoted = false;
        head.chars().any(|c| {
            quoted ^= c == '"';
            c == separator && !quoted
        })
    };
    ['\t', ';'].into_iter().find(|separator| has(*separator)).unwrap_or(',')
}

/// The fields of a line. Quotes must end in the line in which they begin.
fn fields(line: &str, separator: char) -> Result<Vec<String>, &'static str> {
    let (mut fields, mut field, mut quoted) = (Vec::new(), String::new(), false);
    let mut depth = 0_usize;
    let mut rest = line.chars().peekable();
    while let Some(c) = rest.next() {
        match c {
            // Two quotes within quotes are one.
            '"' if quoted && rest.next_if_eq(&'"').is_some() => field.push('"'),
            '"' => quoted = !quoted,
            c if c == separator && !quoted && depth == 0 => fields.push(std::mem::take(&mut field)),
            _ => {
                // Names like K[1,2] hold commas.
                depth = match c {
                    '[' if !quoted => depth + 1,
                    ']' if !quoted => depth.saturating_sub(1),
                    _ => depth,
                };
                field.push(c);
            }
        }
    }
    fields.push(field);
    if quoted { Err("a quote does not end") } else { Ok(fields) }
}

/// True for a row of units: no cell of it is a value, and not all are empty.
fn is_units(row: &[String]) -> bool {
    let is_value = |field: &str| {
        let numeric = field.starts_with(|c: char| c.is_ascii_digit() || "+-.,".contains(c)) && field != "-";
        numeric || boolean(field).is_some() || field.eq_ignore_ascii_case("nan")
    };
    row.iter().all(|field| !is_value(field.trim())) && row.iter().any(|field| !field.trim().is_empty())
}

fn boolean(field: &str) -> Option<f64> {
    let is = |text: &str| field.eq_ignore_ascii_case(text);
    if is("true") {
        Some(1.0)
    } else if is("false") {
        Some(0.0)
    } else {
        None
    }
}

/// A cell in a message.
fn shown(field: &str) -> String {
    field.trim().escape_debug().take(40).collect()
}

/// Numbers of the cells of a file, all with the same decimal mark.
#[derive(Default)]
struct Cells {
    separator: char,
    decimal: Option<char>,
    missing: usize,
    booleans: bool,
}

impl Cells {
    /// The number of a cell; what is allowed, where it is none.
    fn number(&mut self, field: &str) -> Result<f64, String> {
        if field.is_empty() || field.trim_start_matches(['+', '-']).eq_ignore_ascii_case("nan") {
            self.missing += 1;
            return Ok(f64::NAN);
        }
        if let Some(value) = boolean(field) {
            self.booleans = true;
            return Ok(value);
        }
        for mark in [',', '.'].into_iter().filter(|mark| field.contains(*mark)) {
            if mark == ',' && self.separator == ',' {
                return Err("a decimal comma needs ; or a tab as the separator".to_owned());
            }
            let decimal = *self.decimal.get_or_insert(mark);
            if decimal != mark {
                return Err(format!(
                    "numbers above have `{decimal}` as the decimal mark, without separators of thousands"
                ));
            }
        }
        let number = field.replace(',', ".").parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| "must be a finite number, true, false, NaN or empty".to_owned())
    }

    /// Assumptions about the cells.
    fn assumed(&self) -> Vec<String> {
        let separator = if self.separator == '\t' { "a tab".to_owned() } else { format!("`{}`", self.separator) };
        let decimal = self.decimal.map_or_else(String::new, |mark| format!(", the decimal mark is `{mark}`"));
        let mut assumed = vec![format!("the separator is {separator}{decimal}")];
        assumed.extend(self.booleans.then(|| "true is 1, false is 0".to_owned()));
        assumed.extend((self.missing > 0).then(|| format!("missing values (empty cells or NaN): {}", self.missing)));
        assumed
    }
}

#[cfg(test)]
mod tests;
