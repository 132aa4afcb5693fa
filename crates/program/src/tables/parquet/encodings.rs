//! Encodings of values in the pages of a Parquet file.

use super::thrift::{varint, zigzag};

/// A value as it is stored.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell<'a> {
    Integer(i64),
    Real(f64),
    Text(&'a [u8]),
}

/// Types of stored values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Physical {
    Boolean,
    Int32,
    Int64,
    Float,
    Double,
    Bytes,
}

impl Physical {
    /// The type of this number; none for a type without numbers or texts.
    pub fn numbered(number: i64) -> Option<Self> {
        use Physical::{Boolean, Bytes, Double, Float, Int32, Int64};
        // 3 are times of Hive, 7 are arrays of bytes of one length.
        [Some(Boolean), Some(Int32), Some(Int64), None, Some(Float), Some(Double), Some(Bytes)]
            .get(usize::try_from(number).ok()?)
            .copied()?
    }

    /// Bytes of a value.
    fn size(self) -> usize {
        match self {
            Physical::Int32 | Physical::Float => 4,
            Physical::Int64 | Physical::Double => 8,
            Physical::Boolean | Physical::Bytes => 1,
        }
    }

    fn cell<'a>(self, bytes: &[u8]) -> Option<Cell<'a>> {
        Some(match self {
            Physical::Int32 => Cell::Integer(i64::from(i32::from_le_bytes(bytes.try_into().ok()?))),
            Physical::Int64 => Cell::Integer(i64::from_le_bytes(bytes.try_into().ok()?)),
            Physical::Float => Cell::Real(f64::from(f32::from_le_bytes(bytes.try_into().ok()?))),
            Physical::Double => Cell::Real(f64::from_le_bytes(bytes.try_into().ok()?)),
            Physical::Boolean | Physical::Bytes => return None,
        })
    }
}

/// Reads `count` values of a page in one of the encodings; none if the bytes aren't such values.
///
/// # Errors
/// When the encoding isn't supported.
pub fn values<'a>(
    encoding: i64,
    physical: Physical,
    bytes: &'a [u8],
    count: usize,
    dictionary: &[Cell<'a>],
) -> Result<Option<Vec<Cell<'a>>>, String> {
    let integers = |numbers: Vec<u64>| numbers.into_iter().map(|number| Cell::Integer(number as i64)).collect();
    Ok(match (encoding, physical) {
        (0, _) => plain(physical, bytes, count),
        (2 | 8, _) => bytes.split_first().and_then(|(&width, rest)| {
            let places = hybrid(rest, u32::from(width), count)?;
            places.into_iter().map(|place| dictionary.get(usize::try_from(place).ok()?).cloned()).collect()
        }),
        (3, Physical::Boolean) => sized(bytes).and_then(|(own, _)| hybrid(own, 1, count)).map(integers),
        (5, Physical::Int32 | Physical::Int64) => differences(bytes, count).map(|numbers| {
            let narrow = |number: i64| if physical == Physical::Int32 { i64::from(number as i32) } else { number };
            numbers.into_iter().map(|number| Cell::Integer(narrow(number))).collect()
        }),
        (9, Physical::Int32 | Physical::Int64 | Physical::Float | Physical::Double) => split(physical, bytes, count),
        _ => return Err(format!("has values in encoding {encoding}, which is not supported; save it with PLAIN")),
    })
}

/// Values one after the other.
pub fn plain<'a>(physical: Physical, bytes: &'a [u8], count: usize) -> Option<Vec<Cell<'a>>> {
    match physical {
        Physical::Boolean => {
            (0..count).map(|k| Some(Cell::Integer(i64::from(*bytes.get(k / 8)? >> (k % 8) & 1)))).collect()
        }
        Physical::Bytes => {
            let mut rest = bytes;
            let mut next = || {
                let (own, behind) = sized(rest)?;
                rest = behind;
                Some(Cell::Text(own))
            };
            (0..count).map(|_| next()).collect()
        }
        _ => {
            let bytes = bytes.get(..count.checked_mul(physical.size())?)?;
            bytes.chunks_exact(physical.size()).map(|own| physical.cell(own)).collect()
        }
    }
}

/// Bytes after their length, and the rest.
pub fn sized(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}

/// All first bytes of the values, then all second ones, and so on.
fn split<'a>(physical: Physical, bytes: &[u8], count: usize) -> Option<Vec<Cell<'a>>> {
    let size = physical.size();
    let bytes = bytes.get(..count.checked_mul(size)?)?;
    let one = |k: usize| {
        let mut own = [0; 8];
        (0..size).for_each(|place| own[place] = bytes[place * count + k]);
        physical.cell(&own[..size])
    };
    (0..count).map(one).collect()
}

/// A number of up to 64 bits from a bit position. Bits after the end are zero.
fn bits(bytes: &[u8], at: usize, width: u32) -> u64 {
    let rest = bytes.get(at / 8..).unwrap_or(&[]);
    let mut own = [0; 16];
    let length = rest.len().min(9);
    own[..length].copy_from_slice(&rest[..length]);
    let mask = (1_u128 << width) - 1;
    (u128::from_le_bytes(own) >> (at % 8) & mask) as u64
}

/// Numbers of so many bits, in runs of one value and in groups of eight.
pub fn hybrid(bytes: &[u8], width: u32, count: usize) -> Option<Vec<u64>> {
    if width > 32 {
        return None;
    }
    let (mut numbers, mut rest) = (Vec::new(), bytes);
    // All of them are 0, and need no bytes.
    if width == 0 {
        return Some(vec![0; count]);
    }
    while numbers.len() < count {
        let (head, length) = varint(rest)?;
        rest = &rest[length..];
        let missing = count - numbers.len();
        let many = usize::try_from(head >> 1).ok()?;
        if many == 0 {
            continue;
        }
        if head & 1 == 0 {
            let (value, behind) = rest.split_at_checked(width.div_ceil(8) as usize)?;
            numbers.resize(numbers.len() + many.min(missing), bits(value, 0, width));
            rest = behind;
        } else {
            // The last group may end after its last value.
            let taken = many.saturating_mul(8).min(missing);
            let needed = (taken * width as usize).div_ceil(8);
            let own = rest.get(..needed)?;
            numbers.extend((0..taken).map(|k| bits(own, k * width as usize, width)));
            rest = &rest[many.saturating_mul(width as usize).min(rest.len())..];
        }
    }
    Some(numbers)
}

/// Integers by their differences, in blocks of miniblocks of as few bits as possible.
fn differences(bytes: &[u8], count: usize) -> Option<Vec<i64>> {
    let mut rest = bytes;
    let mut next = || {
        let (value, length) = varint(rest)?;
        rest = &rest[length..];
        Some(value)
    };
    let [block, parts, total] = [next()?, next()?, next()?].map(|size| usize::try_from(size).unwrap_or(usize::MAX));
    let mut last = zigzag(next()?);
    if total < count || parts == 0 || parts > block || block % parts != 0 {
        return None;
    }
    let each = block / parts;
    let mut numbers: Vec<i64> = (0..count.min(1)).map(|_| last).collect();
    while numbers.len() < count {
        let (least, length) = varint(rest)?;
        let least = zigzag(least);
        let (widths, mut behind) = rest.get(length..)?.split_at_checked(parts)?;
        for &width in widths {
            let taken = each.min(count - numbers.len());
            if taken == 0 {
                break;
            }
            let width = Some(u32::from(width)).filter(|width| *width <= 64)?;
            let size = each.checked_mul(width as usize)?.div_ceil(8);
            let own = behind.get(..taken.checked_mul(width as usize)?.div_ceil(8))?;
            for k in 0..taken {
                last = last.wrapping_add(least).wrapping_add(bits(own, k * width as usize, width) as i64);
                numbers.push(last);
            }
            behind = &behind[size.min(behind.len())..];
        }
        rest = behind;
    }
    Some(numbers)
}
