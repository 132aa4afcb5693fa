//! Tables of numbers as Apache Parquet: what pandas, polars and DuckDB read with names and types.
//!
//! The crate `parquet` without its default features adds 8 packages to this program's, and takes 29 s of processor time to
//! build unoptimised, with what it needs (`cargo tree`, `time cargo build`, version 60.1), for a file that needs a page of
//! code: one row group, a column chunk of one page a column, plain doubles, nothing compressed, nothing missing. So it is
//! written here, after the format's specification; the metadata are Thrift's compact protocol.

/// The bytes at both ends of a file.
const MAGIC: &[u8] = b"PAR1";
/// Numbers of Parquet's enumerations.
const DOUBLE: i64 = 5;
const REQUIRED: i64 = 0;
const PLAIN: i64 = 0;
const RLE: i64 = 3;
const UNCOMPRESSED: i64 = 0;
const DATA_PAGE: i64 = 0;

/// A file of columns of one length, by their names, with a few texts by keys.
pub fn file(columns: &[(&str, Vec<f64>)], texts: &[(String, String)]) -> Vec<u8> {
    let rows = columns.first().map_or(0, |(_, values)| values.len()) as i64;
    let mut bytes = MAGIC.to_vec();
    let mut chunks = Vec::new();
    for (name, values) in columns {
        let offset = bytes.len() as i64;
        let data: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        bytes.extend(page_header(values.len() as i64, data.len() as i64));
        bytes.extend(data);
        chunks.push((*name, offset, bytes.len() as i64 - offset));
    }
    let footer = footer(rows, &chunks, texts);
    bytes.extend(&footer);
    bytes.extend((footer.len() as u32).to_le_bytes());
    bytes.extend(MAGIC);
    bytes
}

/// The header of a page: none of its columns has levels, since no value is missing or repeated.
fn page_header(values: i64, size: i64) -> Vec<u8> {
    let mut page = Struct::default();
    page.i32(1, values).i32(2, PLAIN).i32(3, RLE).i32(4, RLE);
    let mut header = Struct::default();
    header.i32(1, DATA_PAGE).i32(2, size).i32(3, size).inner(5, page);
    header.end()
}

/// What the file holds: schema, the places of the columns, texts.
fn footer(rows: i64, chunks: &[(&str, i64, i64)], texts: &[(String, String)]) -> Vec<u8> {
    let mut root = Struct::default();
    root.text(4, "result").i32(5, chunks.len() as i64);
    let leaf = |(name, ..): &(&str, i64, i64)| {
        let mut leaf = Struct::default();
        leaf.i32(1, DOUBLE).i32(3, REQUIRED).text(4, name);
        leaf
    };
    let chunk = |(name, offset, size): &(&str, i64, i64)| {
        let mut about = Struct::default();
        about.i32(1, DOUBLE).numbers(2, &[PLAIN]).texts(3, &[name]).i32(4, UNCOMPRESSED);
        about.i64(5, rows).i64(6, *size).i64(7, *size).i64(9, *offset);
        let mut chunk = Struct::default();
        chunk.i64(2, *offset).inner(3, about);
        chunk
    };
    let mut group = Struct::default();
    group.structs(1, chunks.iter().map(chunk)).i64(2, chunks.iter().map(|(_, _, size)| size).sum()).i64(3, rows);
    let text = |(key, value): &(String, String)| {
        let mut entry = Struct::default();
        entry.text(1, key).text(2, value);
        entry
    };
    let mut file = Struct::default();
    file.i32(1, 1).structs(2, std::iter::once(root).chain(chunks.iter().map(leaf))).i64(3, rows);
    file.structs(4, [group])
        .structs(5, texts.iter().map(text))
        .text(6, concat!("adaptive-fmu ", env!("CARGO_PKG_VERSION")));
    file.end()
}

/// A struct of Thrift's compact protocol, as it is being written: fields in the order of their numbers.
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
    /// The header of a field: its distance from the last, and its type.
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

    /// The header of a list: short ones have their length beside the type.
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

    /// A signed number with its sign in the last bit.
    fn signed(&mut self, value: i64) -> &mut Self {
        self.varint((value << 1 ^ value >> 63) as u64);
        self
    }

    /// Seven bits a byte, the least first; the eighth says that there are more.
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
        let written = file(&[("time", vec![0.0, 0.5]), ("x", vec![1.0, -2.5])], &[("unit of x".into(), "m".into())]);
        assert!(written.starts_with(MAGIC) && written.ends_with(MAGIC));
        let footer = u32::from_le_bytes(written[written.len() - 8..written.len() - 4].try_into().unwrap()) as usize;
        assert!(footer < written.len());
        let numbers: Vec<u8> = [1.0_f64, -2.5].iter().flat_map(|value| value.to_le_bytes()).collect();
        assert!(written.windows(numbers.len()).any(|part| part == numbers));
    }
}
