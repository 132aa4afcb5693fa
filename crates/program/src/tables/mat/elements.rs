//! Variables of a MATLAB file, from its elements.

use flate2::read::ZlibDecoder;

use super::super::Budget;
use super::{BEGIN, HDF5};

const DAMAGED: &str = "is damaged or truncated";
const HEADER: usize = 128;
/// Deepest nesting of structs and cells.
const DEEPEST: usize = 16;
/// Approximate memory of a variable, in bytes.
const OVERHEAD: usize = 128;

/// Types of elements.
const INT8: u32 = 1;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
const UTF16: u32 = 17;

/// A variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    pub name: String,
    pub dims: Vec<usize>,
    pub content: Content,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Numbers by columns.
    Numbers(Vec<f64>),
    /// The rows of an array of characters.
    Text(Vec<String>),
    /// A cell array of texts.
    Lines(Vec<String>),
    /// The fields of a single struct.
    Struct(Vec<Array>),
    /// The reason why it isn't read, with advice.
    Other(String),
}

impl Array {
    fn other(name: String, reason: impl Into<String>) -> Self {
        Array { name, dims: Vec::new(), content: Content::Other(reason.into()) }
    }

    /// The number of elements.
    pub fn count(&self) -> usize {
        self.dims.iter().product()
    }

    /// True if all dimensions are 1 except one.
    pub fn is_vector(&self) -> bool {
        self.dims.iter().filter(|size| **size != 1).count() <= 1
    }

    /// A field of a struct.
    pub fn field(&self, name: &str) -> Option<&Array> {
        let Content::Struct(fields) = &self.content else { return None };
        fields.iter().find(|field| field.name == name)
    }

    /// The text of an element, from a text for all or a cell array with one for each.
    pub fn label(&self, k: usize) -> Option<String> {
        if let Content::Lines(lines) = &self.content { lines.get(k).cloned() } else { self.text() }
    }

    /// A text of one row.
    pub fn text(&self) -> Option<String> {
        let Content::Text(lines) = &self.content else { return None };
        lines.first().cloned()
    }
}

/// The variables of a file.
///
/// # Errors
/// The reason why they can't be read.
pub fn variables(bytes: &[u8], budget: &mut Budget) -> Result<Vec<Array>, String> {
    let version_7_3 = "has version 7.3, which is not supported: in MATLAB save it with save(…, '-v7')";
    if bytes.starts_with(HDF5) || bytes.starts_with(b"MATLAB 7.3") {
        return Err(version_7_3.to_owned());
    }
    let (header, rest) = bytes.split_at(bytes.len().min(HEADER));
    let is_big = match header.get(126..) {
        Some(b"IM") => false,
        Some(b"MI") => true,
        _ if bytes.starts_with(BEGIN) => return Err(DAMAGED.to_owned()),
        _ => {
            let advice = "is not a MATLAB file of version 5 or 7. Files of version 4, such as results of Dymola and OpenModelica, \
                          are not supported: save it as CSV, or in MATLAB with save(…, '-v7')";
            return Err(advice.to_owned());
        }
    };
    let mut elements = Elements { rest, is_big };
    let mut variables = Vec::new();
    while let Some((kind, own)) = elements.next()? {
        let read = match kind {
            MATRIX => array(own, is_big, 0, budget)?,
            COMPRESSED => {
                let inflated = budget.inflate(ZlibDecoder::new(own), None)?;
                match (Elements { rest: &inflated, is_big }).next()? {
                    Some((MATRIX, own)) => array(own, is_big, 0, budget)?,
                    _ => continue,
                }
            }
            _ => continue,
        };
        // Objects refer to elements without a name.
        if !read.name.is_empty() {
            variables.push(read);
        }
    }
    Ok(variables)
}

/// Elements one after the other.
struct Elements<'a> {
    rest: &'a [u8],
    is_big: bool,
}

impl<'a> Elements<'a> {
    fn word(&self, bytes: &[u8]) -> Result<u32, String> {
        let bytes = bytes.first_chunk().ok_or(DAMAGED)?;
        Ok(if self.is_big { u32::from_be_bytes(*bytes) } else { u32::from_le_bytes(*bytes) })
    }

    /// Type and bytes of the next one; none at the end.
    fn next(&mut self) -> Result<Option<(u32, &'a [u8])>, String> {
        if self.rest.is_empty() {
            return Ok(None);
        }
        let first = self.word(self.rest)?;
        // The length of up to four bytes is next to the type.
        if first >> 16 != 0 {
            let (own, rest) = self.rest.split_at_checked(8).ok_or(DAMAGED)?;
            self.rest = rest;
            return Ok(Some((first & 0xffff, own[4..].get(..(first >> 16) as usize).ok_or(DAMAGED)?)));
        }
        let (tag, rest) = self.rest.split_at_checked(8).ok_or(DAMAGED)?;
        let length = self.word(&tag[4..])? as usize;
        let (own, behind) = rest.split_at_checked(length).ok_or(DAMAGED)?;
        let padding = if first == COMPRESSED { 0 } else { (8 - length % 8) % 8 };
        self.rest = &behind[padding.min(behind.len())..];
        Ok(Some((first, own)))
    }

    fn of_kind(&mut self, kinds: &[u32]) -> Result<&'a [u8], String> {
        let (kind, own) = self.next()?.ok_or(DAMAGED)?;
        if kinds.contains(&kind) { Ok(own) } else { Err(DAMAGED.to_owned()) }
    }

    fn words(&mut self) -> Result<Vec<u32>, String> {
        let own = self.of_kind(&[INT32, UINT32])?;
        own.chunks_exact(4).map(|bytes| self.word(bytes)).collect()
    }

    fn name(&mut self) -> Result<String, String> {
        Ok(latin(self.of_kind(&[INT8, 2, 16])?))
    }

    fn array(&mut self, depth: usize, budget: &mut Budget) -> Result<Array, String> {
        let is_big = self.is_big;
        array(self.of_kind(&[MATRIX])?, is_big, depth + 1, budget)
    }

    /// Numbers of an element, converted from their storage type.
    fn numbers(&mut self, budget: &mut Budget) -> Result<Vec<f64>, String> {
        let (kind, own) = self.next()?.ok_or(DAMAGED)?;
        macro_rules! of {
            ($type:ty) => {{
                budget.take(own.len() / size_of::<$type>() * size_of::<f64>())?;
                let one = |bytes: &[u8]| {
                    let bytes = bytes.try_into().unwrap_or_default();
                    (if self.is_big { <$type>::from_be_bytes(bytes) } else { <$type>::from_le_bytes(bytes) }) as f64
                };
                own.chunks_exact(size_of::<$type>()).map(one).collect()
            }};
        }
        Ok(match kind {
            1 => of!(i8),
            2 => of!(u8),
            3 => of!(i16),
            4 => of!(u16),
            5 => of!(i32),
            6 => of!(u32),
            7 => of!(f32),
            9 => of!(f64),
            12 => of!(i64),
            13 => of!(u64),
            _ => return Err(DAMAGED.to_owned()),
        })
    }

    /// The rows of an array of characters, which are stored by columns.
    fn lines(&mut self, dims: &[usize], budget: &mut Budget) -> Result<Vec<String>, String> {
        let (kind, own) = self.next()?.ok_or(DAMAGED)?;
        budget.take(own.len().saturating_mul(size_of::<String>()))?;
        let pair = |bytes: &[u8]| {
            let bytes = bytes.try_into().unwrap_or_default();
            if self.is_big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
        };
        let text = match kind {
            UINT16 | UTF16 => String::from_utf16_lossy(&own.chunks_exact(2).map(pair).collect::<Vec<_>>()),
            16 => String::from_utf8_lossy(own).into_owned(),
            _ => latin(own),
        };
        let rows = dims.first().copied().unwrap_or(0);
        if rows <= 1 {
            return Ok(vec![text]);
        }
        let characters: Vec<char> = text.chars().collect();
        let row = |row: usize| {
            let line: String = characters[row..].iter().step_by(rows).collect();
            line.trim_end().to_owned()
        };
        Ok((0..rows.min(characters.len())).map(row).collect())
    }
}

fn latin(bytes: &[u8]) -> String {
    str::from_utf8(bytes).map_or_else(|_| bytes.iter().map(|byte| char::from(*byte)).collect(), str::to_owned)
}

/// A variable from the bytes of its element.
fn array(bytes: &[u8], is_big: bool, depth: usize, budget: &mut Budget) -> Result<Array, String> {
    budget.take(OVERHEAD)?;
    if depth > DEEPEST {
        return Err("has structs or cells that are nested too deeply".to_owned());
    }
    let mut elements = Elements { rest: bytes, is_big };
    // Empty parts of structs may lack all of it.
    if bytes.is_empty() {
        return Ok(Array { name: String::new(), dims: vec![0, 0], content: Content::Numbers(Vec::new()) });
    }
    let flags = *elements.words()?.first().ok_or(DAMAGED)?;
    let class = flags & 0xff;
    if class == 17 {
        let (name, _system, class) = (elements.name()?, elements.name()?, elements.name()?);
        let reason = match class.as_str() {
            "timeseries" => "a timeseries object: save its Time and Data as numeric vectors".to_owned(),
            "timetable" | "table" => format!("a {class}: save its variables as numeric vectors"),
            _ => format!("an object ({class}): save its numbers as numeric vectors"),
        };
        return Ok(Array::other(name, reason));
    }
    let dims: Vec<usize> = elements.words()?.into_iter().map(|size| size as usize).collect();
    let name = elements.name()?;
    let count = dims.iter().try_fold(1_usize, |count, size| count.checked_mul(*size)).ok_or(DAMAGED)?;
    let content = match class {
        1 => cells(&mut elements, count, depth, budget)?,
        2 if count == 1 => fields(&mut elements, depth, budget)?,
        2 => Content::Other(format!("an array of {count} structs: save their fields as numeric vectors")),
        3 => Content::Other("an object: save its numbers as numeric vectors".to_owned()),
        4 => Content::Text(elements.lines(&dims, budget)?),
        5 => Content::Other("a sparse matrix: save full(…)".to_owned()),
        6..=15 if flags & 0x800 != 0 => Content::Other("complex: save its real and imaginary parts".to_owned()),
        6..=15 => {
            let numbers = elements.numbers(budget)?;
            if numbers.len() != count {
                return Err(format!("{name} {DAMAGED}"));
            }
            Content::Numbers(numbers)
        }
        16 => Content::Other("a function".to_owned()),
        _ => return Err(format!("{name} {DAMAGED}")),
    };
    Ok(Array { name, dims, content })
}

fn cells(elements: &mut Elements, count: usize, depth: usize, budget: &mut Budget) -> Result<Content, String> {
    let mut lines = Vec::new();
    for _ in 0..count {
        match elements.array(depth, budget)?.text() {
            Some(line) => lines.push(line),
            None => return Ok(Content::Other("a cell array: save its parts as numeric vectors".to_owned())),
        }
    }
    Ok(Content::Lines(lines))
}

fn fields(elements: &mut Elements, depth: usize, budget: &mut Budget) -> Result<Content, String> {
    let length =
        elements.words()?.first().map(|length| *length as usize).filter(|length| *length > 0).ok_or(DAMAGED)?;
    let names = elements.of_kind(&[INT8, 2])?;
    let mut fields = Vec::new();
    for name in names.chunks_exact(length) {
        let end = name.iter().position(|byte| *byte == 0).unwrap_or(length);
        fields.push(Array { name: latin(&name[..end]), ..elements.array(depth, budget)? });
    }
    Ok(Content::Struct(fields))
}
