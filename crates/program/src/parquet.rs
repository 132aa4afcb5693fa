//! Writes tables of numbers as Apache Parquet, for pandas, polars and DuckDB, with names and types.
//!
//! It is written here after the format's specification, as the file needs a page of code: row groups in sequence, each
//! with a column chunk of one page for each column, plain doubles, without compression and missing values. The metadata
//! are Thrift's compact protocol. The crate `parquet` without its default features would add 8 packages to this
//! program's, and 29 s of processor time to an unoptimised build (`cargo tree`, `time cargo build`, version 60.1).

use std::io::{self, Write};

/// The bytes at both ends of a file.
const MAGIC: &[u8] = b"PAR1";
/// Numbers of Parquet's enumerations.
const DOUBLE: i64 = 5;
const REQUIRED: i64 = 0;
const PLAIN: i64 = 0;
const RLE: i64 = 3;
const UNCOMPRESSED: i64 = 0;
const DATA_PAGE: i64 = 0;

/// A file that is written row group by row group.
#[derive(Debug)]
pub struct Writer<W> {
    out: W,
    names: Vec<String>,
    /// Bytes that are written.
    size: i64,
    groups: Vec<Group>,
}

/// A written group of rows: their number, and the offset and the size of each column.
#[derive(Debug)]
struct Group {
    rows: i64,
    chunks: Vec<(i64, i64)>,
}

impl<W: Write> Writer<W> {
    /// Begins a file of columns with these names.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn new(mut out: W, names: Vec<String>) -> io::Result<Self> {
        out.write_all(MAGIC)?;
        Ok(Writer { out, names, size: MAGIC.len() as i64, groups: Vec::new() })
    }

    /// Writer of the file.
    pub fn out(&self) -> &W {
        &self.out
    }

    /// Adds a group of rows, by their columns in the order of their names.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn group<C: Iterator<Item = f64>>(&mut self, rows: usize, columns: impl Iterator<Item = C>) -> io::Result<()> {
        let rows = rows as i64;
        let mut chunks = Vec::new();
        for column in columns {
            let data = rows * size_of::<f64>() as i64;
            let header = page_header(rows, data);
            self.out.write_all(&header)?;
            for value in column {
                self.out.write_all(&value.to_le_bytes())?;
            }
            let size = header.len() as i64 + data;
            chunks.push((self.size, size));
            self.size += size;
        }
        self.groups.push(Group { rows, chunks });
        Ok(())
    }

    /// Ends the file, with texts by keys.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn finish(mut self, texts: &[(String, String)]) -> io::Result<W> {
        let footer = footer(&self.names, &self.groups, texts);
        self.out.write_all(&footer)?;
        self.out.write_all(&(footer.len() as u32).to_le_bytes())?;
        self.out.write_all(MAGIC)?;
        Ok(self.out)
    }
}

/// The header of a page. Its columns have no levels, since no value is missing or repeated.
fn page_header(values: i64, size: i64) -> Vec<u8> {
    let mut page = Struct::default();
    page.i32(1, values).i32(2, PLAIN).i32(3, RLE).i32(4, RLE);
    let mut header = Struct::default();
    header.i32(1, DATA_PAGE).i32(2, size).i32(3, size).inner(5, page);
    header.end()
}

/// Footer of the file: schema, places of the columns, texts.
fn footer(names: &[String], groups: &[Group], texts: &[(String, String)]) -> Vec<u8> {
    let mut root = Struct::default();
    root.text(4, "result").i32(5, names.len() as i64);
    let leaf = |name: &String| {
        let mut leaf = Struct::default();
        leaf.i32(1, DOUBLE).i32(3, REQUIRED).text(4, name);
        leaf
    };
    let text = |(key, value): &(String, String)| {
        let mut entry = Struct::default();
        entry.text(1, key).text(2, value);
        entry
    };
    let rows = groups.iter().map(|group| group.rows).sum();
    let mut file = Struct::default();
    file.i32(1, 1).structs(2, std::iter::once(root).chain(names.iter().map(leaf))).i64(3, rows);
    file.structs(4, groups.iter().map(|group| group.metadata(names)))
        .structs(5, texts.iter().map(text))
        .text(6, concat!("adaptive-fmu ", env!("CARGO_PKG_VERSION")));
    file.end()
}

impl Group {
    /// Places of its columns.
    fn metadata(&self, names: &[String]) -> Struct {
        let Group { rows, chunks } = self;
        let chunk = |(name, (offset, size)): (&String, &(i64, i64))| {
            let mut about = Struct::default();
            about.i32(1, DOUBLE).numbers(2, &[PLAIN]).texts(3, &[name]).i32(4, UNCOMPRESSED);
            about.i64(5, *rows).i64(6, *size).i64(7, *size).i64(9, *offset);
            let mut chunk = Struct::default();
            chunk.i64(2, *offset).inner(3, about);
            chunk
        };
        let mut group = Struct::default();
        let size = chunks.iter().map(|(_, size)| size).sum();
        group.structs(1, names.iter().zip(chunks).map(chunk)).i64(2, size).i64(3, *rows);
        group
    }
}

/// A struct of Thrift's compact protocol for writing, with its fields in the order of their numbers.
#[derive(Default)]
struct Struct {
    bytes: Vec<u8>,
    last: u8,
}

/// Types of the protocol.
const I32: u8 = 5;
const I64: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

impl Struct {
    /// The header of a field: the difference of its number from the last, and its type.
    fn field(&mut self, number: u8, kind: u8) {
        self.bytes.push((number - self.last) << 4 | kind);
        self.last = number;
    }

    fn i32(&mut self, number: u8, value: i64) -> &mut Self {
        self.field(number, I32);
        self.signed(value)
    }

    fn i64(&mut self, number: u8, value: i64) -> &mut Self {
        self.field(number, I64);
        self.signed(value)
    }

    fn text(&mut self, number: u8, text: &str) -> &mut Self {
        self.field(number, BINARY);
        self.binary(text)
    }

    fn inner(&mut self, number: u8, inner: Struct) -> &mut Self {
        self.field(number, STRUCT);
        self.bytes.extend(inner.end());
        self
    }

    fn numbers(&mut self, number: u8, values: &[i64]) -> &mut Self {
        self.list(number, I32, values.len());
        values.iter().for_each(|value| _ = self.signed(*value));
        self
    }

    fn texts(&mut self, number: u8, texts: &[&str]) -> &mut Self {
        self.list(number, BINARY, texts.len());
        texts.iter().for_each(|text| _ = self.binary(text));
        self
    }

    fn structs(&mut self, number: u8, structs: impl IntoIterator<Item = Struct>) -> &mut Self {
        let structs: Vec<Struct> = structs.into_iter().collect();
        self.list(number, STRUCT, structs.len());
        structs.into_iter().for_each(|inner| self.bytes.extend(inner.end()));
        self
    }

    /// The header of a list; that of a short one includes its length.
    fn list(&mut self, number: u8, kind: u8, length: usize) {
        self.field(number, LIST);
        if length < 15 {
            self.bytes.push((length as u8) << 4 | kind);
        } else {
            self.bytes.push(0xf0 | kind);
            self.varint(length as u64);
        }
    }

    fn binary(&mut self, text: &str) -> &mut Self {
        self.varint(text.len() as u64);
        self.bytes.extend(text.as_bytes());
        self
    }

    /// Writes a signed number with its sign in the last bit.
    fn signed(&mut self, value: i64) -> &mut Self {
        self.varint((value << 1 ^ value >> 63) as u64);
        self
    }

    /// Writes a number with seven bits a byte, the lowest first; the eighth bit marks that more follow.
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.bytes.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.bytes.push(value as u8);
    }

    /// All of it: no further field.
    fn end(mut self) -> Vec<u8> {
        self.bytes.push(0);
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_the_protocol_has_them() {
        let mut written = Struct::default();
        written.i32(1, -1).i64(3, 300).text(4, "ab");
        assert_eq!(written.end(), [0x15, 0x01, 0x26, 0xd8, 0x04, 0x18, 0x02, b'a', b'b', 0]);
        let mut long = Struct::default();
        long.numbers(2, &[0; 20]);
        assert_eq!(long.end()[..3], [0x29, 0xf5, 20]);
    }

    #[test]
    fn a_file_has_its_numbers_as_they_are_between_its_marks() {
        let mut file = Writer::new(Vec::new(), vec!["time".into(), "x".into()]).unwrap();
        file.group(2, [[0.0, 0.5], [1.0, -2.5]].into_iter().map(<[f64; 2]>::into_iter)).unwrap();
        let written = file.finish(&[("unit of x".into(), "m".into())]).unwrap();
        assert!(written.starts_with(MAGIC) && written.ends_with(MAGIC));
        let footer = u32::from_le_bytes(written[written.len() - 8..written.len() - 4].try_into().unwrap()) as usize;
        assert!(footer < written.len());
        let numbers: Vec<u8> = [1.0_f64, -2.5].iter().flat_map(|value| value.to_le_bytes()).collect();
        assert!(written.windows(numbers.len()).any(|part| part == numbers));
    }
    #[test]
    fn each_group_has_its_numbers_where_the_footer_points() {
        let mut file = Writer::new(Vec::new(), vec!["time".into(), "x".into()]).unwrap();
        let groups = [vec![vec![0.0, 0.5, 1.0], vec![1.0, -2.5, 3.5]], vec![vec![1.5], vec![f64::MAX]]];
        for group in &groups {
            file.group(group[0].len(), group.iter().map(|column| column.iter().copied())).unwrap();
        }
        for (stored, group) in file.groups.iter().zip(&groups) {
            assert_eq!(stored.rows, group[0].len() as i64);
            for ((offset, size), column) in stored.chunks.iter().zip(group) {
                let numbers: Vec<u8> = column.iter().flat_map(|value| value.to_le_bytes()).collect();
                let chunk = &file.out()[*offset as usize..(offset + size) as usize];
                assert!(
                    chunk.ends_with(&numbers) && chunk.starts_with(&page_header(stored.rows, numbers.len() as i64))
                );
            }
        }
        let (first, last) = (file.groups[0].chunks[0], file.groups[1].chunks[1]);
        let written = file.finish(&[]).unwrap();
        assert_eq!((first.0, written[(last.0 + last.1) as usize] >> 4), (4, 1));
    }
}
