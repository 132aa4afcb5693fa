//! Reads Apache Parquet: the columns of numbers of a flat table.
//!
//! Pages may be compressed by Snappy, gzip or Zstandard, the defaults of pandas, DuckDB, MATLAB and polars. Values may
//! be plain, in dictionaries, as differences or split into bytes. Columns of texts, and nested ones, are left out.

mod encodings;
mod thrift;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

use adaptive_fmu_identification::csv::{Column, Table};
use flate2::read::GzDecoder;
use ruzstd::decoding::StreamingDecoder;
use serde_json::Value as Json;

use self::encodings::{Cell, Physical, hybrid, plain, sized, values};
use self::thrift::Value;
use super::Budget;

/// The bytes at both ends of a file.
pub const MAGIC: &[u8] = b"PAR1";
/// The same for a file with an encrypted footer.
const ENCRYPTED: &[u8] = b"PARE";
/// Largest expansion of a byte by Snappy: a copy of 64 bytes takes three.
const MOST_OF_SNAPPY: usize = 32;
/// Name of an unnamed index of pandas.
const INDEX: &str = "__index_level_0__";

const DAMAGED: &str = "is damaged or truncated";

/// Reads a table. Columns with these names are read as text.
///
/// # Errors
/// The reason why it can't be read.
pub fn read(bytes: &[u8], texts: &[&str], budget: &mut Budget) -> Result<Table, String> {
    let footer = footer(bytes)?;
    let (file, _) = Value::read(&bytes[footer]).ok_or(DAMAGED)?;
    let about = About::of(&file);
    let (mut columns, mut left_out, mut assumed) = (Vec::new(), Vec::new(), Vec::new());
    for leaf in leaves(&file, &about, texts)? {
        match leaf.kind {
            Kind::LeftOut(reason) => left_out.push(format!("{}: {reason}", leaf.name)),
            _ => {
                if let Kind::Time { is_date, .. } = leaf.kind {
                    let from = if is_date { "from the first date, " } else { "" };
                    assumed.push(format!("{} counts {from}in s", leaf.name));
                }
                columns.push(about.column(&leaf, leaf.read(bytes, &file, budget)?));
            }
        }
    }
    // pandas writes the index of a table after its columns.
    let index = columns.iter().position(|column: &Column| about.index.as_ref() == Some(&column.name));
    let has_time = columns.iter().any(|column| column.name == "time");
    if let Some(place) = index.filter(|_| !has_time) {
        let index = columns.remove(place);
        let is_named = index.name != INDEX;
        assumed.push("the index of pandas is the first column".to_owned());
        columns.insert(0, Column { name: if is_named { index.name } else { "time".to_owned() }, ..index });
    }
    let mut table = Table::of_columns(columns).map_err(|reason| match &left_out[..] {
        [] => reason,
        left => format!("{reason}; left out: {}", left.join("; ")),
    })?;
    (table.assumed, table.left_out) = (assumed, left_out);
    Ok(table)
}

/// The place of the metadata.
fn footer(bytes: &[u8]) -> Result<Range<usize>, String> {
    let last = |count: usize| bytes.len().checked_sub(count).filter(|from| *from >= MAGIC.len());
    let (Some(sizes), Some(end)) = (last(8), bytes.len().checked_sub(4)) else { return Err(not_parquet()) };
    if bytes.ends_with(ENCRYPTED) {
        return Err("is encrypted: save it without encryption".to_owned());
    }
    if !bytes.starts_with(MAGIC) || &bytes[end..] != MAGIC {
        return Err(not_parquet());
    }
    let size = u32::from_le_bytes(bytes[sizes..end].try_into().map_err(|_| DAMAGED)?) as usize;
    let from = last(size.saturating_add(8)).ok_or(DAMAGED)?;
    Ok(from..sizes)
}

fn not_parquet() -> String {
    "is not a Parquet file, or is truncated: it must begin and end with PAR1".to_owned()
}

/// Facts about columns from texts in the file.
#[derive(Debug, Default)]
struct About {
    /// Units of measurement by names.
    units: BTreeMap<String, String>,
    /// Columns with time spans of pandas, and their counts per second.
    spans: BTreeMap<String, f64>,
    /// Column that pandas had as index.
    index: Option<String>,
}

impl About {
    fn of(file: &Value) -> Self {
        let mut about = About::default();
        for entry in file.list(5) {
            let (Some(key), Some(text)) = (entry.text(1), entry.text(2)) else { continue };
            if let Some(name) = key.strip_prefix("unit of ") {
                about.units.insert(name.to_owned(), text.to_owned());
            } else if key == "pandas" {
                about.read_pandas(&serde_json::from_str(text).unwrap_or_default());
            }
        }
        about
    }

    fn read_pandas(&mut self, pandas: &Json) {
        let index = pandas["index_columns"].as_array().map_or(&[][..], Vec::as_slice);
        if let [Json::String(name)] = index {
            self.index = Some(name.clone());
        }
        for column in pandas["columns"].as_array().into_iter().flatten() {
            let (Some(name), Some(kind)) = (column["field_name"].as_str(), column["numpy_type"].as_str()) else {
                continue;
            };
            let unit = kind.strip_prefix("timedelta64[").and_then(|rest| rest.strip_suffix(']'));
            let of_second = match unit {
                Some("s") => 1.0,
                Some("ms") => 1e3,
                Some("us") => 1e6,
                Some("ns") => 1e9,
                _ => continue,
            };
            self.spans.insert(name.to_owned(), of_second);
        }
    }

    fn column(&self, leaf: &Leaf, read: Read) -> Column {
        let column = Column::named(leaf.name);
        let unit = self.units.get(&column.name).cloned();
        let is_time = matches!(leaf.kind, Kind::Time { .. });
        let unit = column.unit.or(unit).filter(|unit| !is_time && !unit.is_empty());
        Column { name: column.name, unit, values: read.numbers, texts: read.texts }
    }
}

/// A column of the file.
#[derive(Debug)]
struct Leaf<'a> {
    /// Its place among all columns.
    place: usize,
    name: &'a str,
    physical: Physical,
    kind: Kind,
    /// True if values may be missing.
    is_optional: bool,
}

/// Meaning of the values of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Signed,
    Unsigned,
    /// Integers, with their number in one unit.
    Decimal(f64),
    /// Integers, with their number in a second.
    Time {
        of_second: f64,
        is_date: bool,
    },
    Text,
    LeftOut(&'static str),
}

/// The columns that aren't within others.
fn leaves<'a>(file: &Value<'a>, about: &About, texts: &[&str]) -> Result<Vec<Leaf<'a>>, String> {
    let elements = file.list(2);
    let mut leaves = Vec::new();
    // How many elements each that is open still has within it, the root first.
    let mut open = vec![elements.first().and_then(|root| root.size(5)).ok_or(DAMAGED)?];
    let mut place = 0;
    let mut outer: Option<&'a str> = None;
    for element in elements.iter().skip(1) {
        while open.last() == Some(&0) {
            open.pop();
        }
        *open.last_mut().ok_or(DAMAGED)? -= 1;
        let name = element.text(4).ok_or(DAMAGED)?;
        let is_inner = open.len() > 1;
        if let Some(children) = element.size(5).filter(|children| *children > 0) {
            if !is_inner {
                outer = Some(name);
            }
            open.push(children);
            continue;
        }
        let physical = element.number(1).and_then(Physical::numbered);
        let kind = match physical {
            _ if is_inner || element.number(3) == Some(2) => Kind::LeftOut("has lists or parts, not numbers"),
            Some(physical) => kind(element, physical, about, texts),
            None => Kind::LeftOut("has a type that is not supported; save it as DOUBLE"),
        };
        let name = if is_inner { outer.unwrap_or(name) } else { name };
        let has_name = is_inner && leaves.last().is_some_and(|last: &Leaf| last.name == name);
        if !has_name {
            let physical = physical.unwrap_or(Physical::Bytes);
            leaves.push(Leaf { place, name, physical, kind, is_optional: element.number(3) == Some(1) });
        }
        place += 1;
    }
    Ok(leaves)
}

fn kind(element: &Value, physical: Physical, about: &About, texts: &[&str]) -> Kind {
    let name = element.text(4).unwrap_or_default();
    let wants_text = texts.contains(&name);
    let logical = element.field(10);
    let logical_of = |number: i64| logical.and_then(|logical| logical.field(number));
    let is_logical = |number: i64| logical_of(number).is_some();
    let converted = element.number(6);
    let ten = |scale: i64| 10_f64.powi(scale.clamp(0, 300) as i32);
    match physical {
        Physical::Bytes if wants_text => Kind::Text,
        Physical::Bytes => Kind::LeftOut("has texts, not numbers"),
        Physical::Boolean | Physical::Float | Physical::Double if wants_text => {
            Kind::LeftOut("labels records: save it as text or whole numbers")
        }
        Physical::Boolean | Physical::Float | Physical::Double => Kind::Signed,
        Physical::Int32 | Physical::Int64 if wants_text => Kind::Text,
        Physical::Int32 | Physical::Int64 => {
            if let Some(of_second) = about.spans.get(name) {
                return Kind::Time { of_second: *of_second, is_date: false };
            }
            let stamp = logical_of(8).and_then(|stamp| stamp.field(2));
            let of_unit =
                |unit: &Value| [(1, 1e3), (2, 1e6), (3, 1e9)].into_iter().find(|(k, _)| unit.field(*k).is_some());
            let of_second = match converted {
                Some(9) => Some(1e3),
                Some(10) => Some(1e6),
                _ => stamp.and_then(of_unit).map(|(_, of_second)| of_second),
            };
            if let Some(of_second) = of_second {
                return Kind::Time { of_second, is_date: true };
            }
            match converted {
                Some(6..=8) => Kind::LeftOut("has dates or times of day: save seconds"),
                Some(5) => Kind::Decimal(ten(element.number(7).unwrap_or(0))),
                Some(11..=14) => Kind::Unsigned,
                _ if is_logical(6) || is_logical(7) => Kind::LeftOut("has dates or times of day: save seconds"),
                _ if logical_of(10).is_some_and(|integer| integer.number(2) == Some(0)) => Kind::Unsigned,
                _ if is_logical(5) => Kind::Decimal(ten(logical_of(5).and_then(|of| of.number(1)).unwrap_or(0))),
                _ => Kind::Signed,
            }
        }
    }
}

/// Values of a column.
#[derive(Debug, Default)]
struct Read {
    numbers: Vec<f64>,
    texts: Vec<String>,
    /// The first time.
    base: Option<i64>,
}

impl Leaf<'_> {
    fn read(&self, bytes: &[u8], file: &Value, budget: &mut Budget) -> Result<Read, String> {
        let mut read = Read::default();
        for group in file.list(4) {
            let rows = group.size(3).ok_or(DAMAGED)?;
            let about = group.list(1).get(self.place).and_then(|chunk| chunk.field(3)).ok_or(DAMAGED)?;
            budget.take(rows.saturating_mul(size_of::<f64>()))?;
            let result = self.read_chunk(bytes, about, rows, &mut read, budget);
            result.map_err(|reason| format!("{}: {reason}", self.name))?;
        }
        // Dates count from the first.
        if let Kind::Time { is_date: true, .. } = self.kind {
            let first = read.numbers.iter().copied().fold(f64::INFINITY, f64::min);
            read.numbers.iter_mut().for_each(|number| *number -= first);
        }
        Ok(read)
    }

    /// Reads the pages of a column in a group of rows.
    fn read_chunk(
        &self,
        bytes: &[u8],
        about: &Value,
        rows: usize,
        read: &mut Read,
        budget: &mut Budget,
    ) -> Result<(), String> {
        let codec = about.number(4).ok_or(DAMAGED)?;
        let (data, size) = (about.size(9).ok_or(DAMAGED)?, about.size(7).ok_or(DAMAGED)?);
        let from = about.size(11).filter(|place| *place > 0).map_or(data, |place| place.min(data));
        let mut chunk = from.checked_add(size).and_then(|end| bytes.get(from..end)).ok_or(DAMAGED)?;
        let mut missing = rows;
        // A dictionary is the first page.
        let mut page = Page::next(&mut chunk).filter(|_| rows > 0);
        let words;
        let mut dictionary = Vec::new();
        if let Some(first) = page.as_ref().filter(|page| page.head.number(1) == Some(2)) {
            words = unpacked(codec, first.own, first.full, budget)?;
            let count = first.head.field(7).and_then(|about| about.size(1)).ok_or(DAMAGED)?;
            budget.take(count.saturating_mul(size_of::<f64>()))?;
            dictionary = plain(self.physical, &words, count).ok_or(DAMAGED)?;
            page = Page::next(&mut chunk);
        }
        while missing > 0 {
            let page = page.take().or_else(|| Page::next(&mut chunk)).ok_or(DAMAGED)?;
            page.check()?;
            let is_first_kind = match page.head.number(1) {
                Some(0) => true,
                Some(3) => false,
                // Indices and the like.
                _ => continue,
            };
            let about = page.head.field(if is_first_kind { 5 } else { 8 }).ok_or(DAMAGED)?;
            let count = about.size(1).ok_or(DAMAGED)?;
            missing = missing.checked_sub(count).ok_or(DAMAGED)?;
            let (levels, own) = self.parts(codec, &page, about, budget)?;
            let known = match levels {
                Some(levels) => hybrid(&levels, 1, count).ok_or(DAMAGED)?,
                None => vec![1; count],
            };
            let encoding = about.number(if is_first_kind { 2 } else { 4 }).ok_or(DAMAGED)?;
            let given = known.iter().filter(|level| **level == 1).count();
            let cells = values(encoding, self.physical, &own, given, &dictionary)?.ok_or(DAMAGED)?;
            let mut cells = cells.iter();
            known.iter().for_each(|level| self.push(if *level == 1 { cells.next() } else { None }, read));
        }
        Ok(())
    }

    /// The levels of a page, which show where values are missing, and the values.
    fn parts<'a>(
        &self,
        codec: i64,
        page: &Page<'a>,
        about: &Value,
        budget: &mut Budget,
    ) -> Result<(Option<Bytes<'a>>, Bytes<'a>), String> {
        let Page { own, full, .. } = *page;
        if page.head.number(1) == Some(3) {
            let [known, repeated] = [5, 6].map(|field| about.size(field).unwrap_or(0));
            let length = known.saturating_add(repeated);
            let (levels, own) = own.split_at_checked(length).ok_or(DAMAGED)?;
            let full = full.checked_sub(length).ok_or(DAMAGED)?;
            let codec = if about.number(7) == Some(0) { 0 } else { codec };
            let levels = self.is_optional.then_some(Cow::Borrowed(&levels[repeated..]));
            return Ok((levels, unpacked(codec, own, full, budget)?));
        }
        let whole = unpacked(codec, own, full, budget)?;
        if !self.is_optional {
            return Ok((None, whole));
        }
        // Levels of one bit each, packed by hand, in an encoding that is no longer written.
        if about.number(3) != Some(3) {
            return Err("has missing values in an encoding that is not supported; save the file anew".to_owned());
        }
        let (levels, rest) = sized(&whole).ok_or(DAMAGED)?;
        Ok((Some(Cow::Owned(levels.to_vec())), Cow::Owned(rest.to_vec())))
    }

    fn push(&self, cell: Option<&Cell>, read: &mut Read) {
        if self.kind == Kind::Text {
            read.texts.push(match cell {
                Some(Cell::Text(text)) => String::from_utf8_lossy(text).into_owned(),
                Some(Cell::Integer(number)) => number.to_string(),
                _ => String::new(),
            });
            return;
        }
        read.numbers.push(match (cell, self.kind) {
            (Some(Cell::Real(number)), _) => *number,
            (Some(Cell::Integer(number)), Kind::Time { of_second, is_date }) => {
                // pandas writes its smallest number for a missing time.
                let base = if is_date { *read.base.get_or_insert(*number) } else { 0 };
                number
                    .checked_sub(base)
                    .filter(|_| *number != i64::MIN)
                    .map_or(f64::NAN, |ticks| ticks as f64 / of_second)
            }
            (Some(Cell::Integer(number)), Kind::Decimal(of_one)) => *number as f64 / of_one,
            (Some(Cell::Integer(number)), Kind::Unsigned) if self.physical == Physical::Int32 => {
                f64::from(*number as u32)
            }
            (Some(Cell::Integer(number)), Kind::Unsigned) => *number as u64 as f64,
            (Some(Cell::Integer(number)), _) => *number as f64,
            (Some(Cell::Text(_)) | None, _) => f64::NAN,
        });
    }
}

/// Bytes of the file, or decompressed ones.
type Bytes<'a> = Cow<'a, [u8]>;

/// A part of a column.
struct Page<'a> {
    head: Value<'a>,
    /// Its bytes as stored.
    own: &'a [u8],
    /// Their number when unpacked.
    full: usize,
}

impl<'a> Page<'a> {
    /// Takes the page at the beginning of some bytes, which then begin after it.
    fn next(bytes: &mut &'a [u8]) -> Option<Self> {
        let whole = *bytes;
        let (head, length) = Value::read(whole)?;
        let (full, stored) = (head.size(2)?, head.size(3)?);
        let (own, behind) = whole[length..].split_at_checked(stored)?;
        *bytes = behind;
        Some(Page { head, own, full })
    }

    fn check(&self) -> Result<(), String> {
        let is_wrong = self.head.number(4).is_some_and(|sum| sum as u32 != crc32fast::hash(self.own));
        if is_wrong { Err("has another checksum than its header: it is damaged".to_owned()) } else { Ok(()) }
    }
}

/// The bytes of a page, with this size.
fn unpacked<'a>(codec: i64, own: &'a [u8], full: usize, budget: &mut Budget) -> Result<Cow<'a, [u8]>, String> {
    let other = |name: &str| {
        Err(format!("is compressed by {name}, which is not supported: save it with Snappy, gzip, Zstandard or none"))
    };
    let unpacked = match codec {
        0 if own.len() == full => return Ok(Cow::Borrowed(own)),
        // Some compressors write nothing for no bytes.
        _ if own.is_empty() && full == 0 => Vec::new(),
        0 => return Err(DAMAGED.to_owned()),
        1 => {
            let size = snap::raw::decompress_len(own).map_err(|error| error.to_string())?;
            if size != full || size > own.len().saturating_mul(MOST_OF_SNAPPY) {
                return Err(DAMAGED.to_owned());
            }
            budget.take(size)?;
            snap::raw::Decoder::new().decompress_vec(own).map_err(|error| error.to_string())?
        }
        2 => budget.inflate(GzDecoder::new(own), Some(full))?,
        6 => {
            let decoder = StreamingDecoder::new(own).map_err(|error| error.to_string())?;
            budget.inflate(decoder, Some(full))?
        }
        3 => return other("LZO"),
        4 => return other("Brotli"),
        5 | 7 => return other("LZ4"),
        _ => return other("an unknown method"),
    };
    Ok(Cow::Owned(unpacked))
}
