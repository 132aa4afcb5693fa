//! Thrift's compact protocol for the metadata of Parquet: structs as trees.

/// Deepest nesting of structs and lists.
const DEEPEST: usize = 16;

/// A value. `Other` is one that no reader of tables needs.
#[derive(Debug, Clone, PartialEq)]
pub enum Value<'a> {
    Number(i64),
    Bytes(&'a [u8]),
    List(Vec<Value<'a>>),
    Struct(Vec<(i64, Value<'a>)>),
    Other,
}

impl<'a> Value<'a> {
    /// The struct at the beginning of some bytes, and its length; none if they are invalid.
    pub fn read(bytes: &'a [u8]) -> Option<(Self, usize)> {
        let mut compact = Compact { bytes, at: 0 };
        let value = compact.structure(0)?;
        Some((value, compact.at))
    }

    /// A field of a struct.
    pub fn field(&self, number: i64) -> Option<&Value<'a>> {
        let Value::Struct(fields) = self else { return None };
        fields.iter().find(|(own, _)| *own == number).map(|(_, value)| value)
    }

    /// A number as a field of a struct.
    pub fn number(&self, number: i64) -> Option<i64> {
        if let Some(Value::Number(value)) = self.field(number) { Some(*value) } else { None }
    }

    /// A size or an offset, which isn't negative, as a field of a struct.
    pub fn size(&self, number: i64) -> Option<usize> {
        self.number(number)?.try_into().ok()
    }

    /// A text as a field of a struct.
    pub fn text(&self, number: i64) -> Option<&'a str> {
        let Some(Value::Bytes(bytes)) = self.field(number) else { return None };
        str::from_utf8(bytes).ok()
    }

    /// The items of a list as a field of a struct.
    pub fn list(&self, number: i64) -> &[Value<'a>] {
        if let Some(Value::List(items)) = self.field(number) { items } else { &[] }
    }
}

struct Compact<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Compact<'a> {
    fn byte(&mut self) -> Option<u8> {
        self.take(1).map(|bytes| bytes[0])
    }

    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let taken = self.bytes.get(self.at..self.at.checked_add(count)?)?;
        self.at += count;
        Some(taken)
    }

    fn varint(&mut self) -> Option<u64> {
        let (value, length) = varint(self.bytes.get(self.at..)?)?;
        self.at += length;
        Some(value)
    }

    fn signed(&mut self) -> Option<i64> {
        self.varint().map(zigzag)
    }

    fn structure(&mut self, depth: usize) -> Option<Value<'a>> {
        let (mut fields, mut number) = (Vec::new(), 0_i64);
        loop {
            let head = self.byte()?;
            if head == 0 {
                return Some(Value::Struct(fields));
            }
            let distance = i64::from(head >> 4);
            number = if distance == 0 { self.signed()? } else { number.checked_add(distance)? };
            // A truth value is in the header.
            let value = match head & 0xf {
                1 => Value::Number(1),
                2 => Value::Number(0),
                kind => self.value(kind, depth + 1)?,
            };
            fields.push((number, value));
        }
    }

    fn value(&mut self, kind: u8, depth: usize) -> Option<Value<'a>> {
        if depth > DEEPEST {
            return None;
        }
        Some(match kind {
            1..=3 => Value::Number(i64::from(self.byte()?)),
            4..=6 => Value::Number(self.signed()?),
            7 => self.take(8).map(|_| Value::Other)?,
            8 => {
                let length = self.varint()?;
                Value::Bytes(self.take(length.try_into().ok()?)?)
            }
            9 | 10 => {
                let head = self.byte()?;
                let count = if head >> 4 == 15 { self.varint()? } else { u64::from(head >> 4) };
                // A count that is too large ends with the bytes.
                Value::List((0..count).map(|_| self.value(head & 0xf, depth + 1)).collect::<Option<_>>()?)
            }
            11 => {
                let count = self.varint()?;
                let kinds = if count > 0 { self.byte()? } else { 0 };
                for _ in 0..count {
                    self.value(kinds >> 4, depth + 1)?;
                    self.value(kinds & 0xf, depth + 1)?;
                }
                Value::Other
            }
            12 => self.structure(depth + 1)?,
            13 => self.take(16).map(|_| Value::Other)?,
            _ => return None,
        })
    }
}

/// A number of seven bits a byte at the beginning of some bytes, and its length.
pub fn varint(bytes: &[u8]) -> Option<(u64, usize)> {
    let mut value = 0_u64;
    for (k, &byte) in bytes.iter().take(10).enumerate() {
        value |= u64::from(byte & 0x7f) << (7 * k);
        if byte < 0x80 {
            return Some((value, k + 1));
        }
    }
    None
}

/// A number with its sign in the last bit.
pub fn zigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}
