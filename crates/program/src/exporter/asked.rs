//! Requirements of a shared library on the system that loads it, read from its bytes, which may be anybody's.

use std::collections::BTreeMap;
use std::fmt;
use std::io::Read;
use std::path::Path;

use object::elf::{FileHeader32, FileHeader64, VER_FLG_WEAK};
use object::read::elf::FileHeader;
use object::{Architecture, Endianness, FileKind, Object};
use serde::{Serialize, Serializer};

use super::archive;
use crate::error::Error;

/// Largest size of a library in an archive that is read.
const LARGEST: u64 = 1 << 28;
/// Largest number of versions that are read; ours need a dozen.
const MOST_VERSIONS: usize = 10_000;

/// A version of glibc.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Glibc {
    major: u32,
    minor: u32,
}

impl Glibc {
    /// The newest that a library of ours requires: the oldest that Rust supports.
    pub const PROMISED: Glibc = Glibc { major: 2, minor: 17 };

    /// The newest version that a library for Linux requires; none for other libraries, or if it can't be read.
    pub fn asked_by(library: &[u8]) -> Option<Self> {
        let newest = match FileKind::parse(library).ok()? {
            FileKind::Elf64 => newest::<FileHeader64<Endianness>>(library),
            FileKind::Elf32 => newest::<FileHeader32<Endianness>>(library),
            _ => return None,
        };
        newest.ok()?
    }

    /// Reads a version as the linker writes it.
    fn of_name(name: &[u8]) -> Option<Self> {
        let version = std::str::from_utf8(name).ok()?.strip_prefix("GLIBC_")?;
        if version == "ABI_DT_RELR" {
            // A compact form of relocations, which the loader supports since then.
            return Some(Glibc { major: 2, minor: 36 });
        }
        let mut parts = version.split('.').map(|part| part.parse().ok());
        Some(Glibc { major: parts.next()??, minor: parts.next()?? })
    }
}

impl fmt::Display for Glibc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

impl Serialize for Glibc {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

fn newest<Elf: FileHeader<Endian = Endianness>>(library: &[u8]) -> object::Result<Option<Glibc>> {
    let header = Elf::parse(library)?;
    let endian = header.endian()?;
    let sections = header.sections(endian, library)?;
    let Some((mut files, names)) = sections.gnu_verneed(endian, library)? else { return Ok(None) };
    let names = sections.strings(endian, library, names)?;
    let (mut newest, mut count) = (None, 0);
    while let Some((_, mut versions)) = files.next()? {
        while let Some(version) = versions.next()? {
            count += 1;
            if count > MOST_VERSIONS {
                return Ok(None);
            }
            // The loader doesn't require weak ones.
            if version.vna_flags.get(endian).0 & VER_FLG_WEAK.0 == 0 {
                newest = newest.max(Glibc::of_name(version.name(endian, names)?));
            }
        }
    }
    Ok(newest)
}

/// Requirements of a library in an FMU.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Asked {
    /// The processor that it is for.
    pub processor: String,
    /// The oldest glibc with which it can be loaded, if it requires one.
    pub glibc: Option<Glibc>,
}

impl Asked {
    /// Reads the bytes of a library; none if they aren't one.
    pub fn by(library: &[u8]) -> Option<Self> {
        let processor = match FileKind::parse(library).ok()? {
            FileKind::MachOFat32 | FileKind::MachOFat64 => "several processors".to_owned(),
            _ => match object::File::parse(library).ok()?.architecture() {
                Architecture::X86_64 => "x86-64".to_owned(),
                Architecture::I386 => "x86".to_owned(),
                Architecture::Aarch64 => "ARM, 64 bits".to_owned(),
                Architecture::Arm => "ARM, 32 bits".to_owned(),
                other => format!("{other:?}"),
            },
        };
        Some(Asked { processor, glibc: Glibc::asked_by(library) })
    }
}

impl fmt::Display for Asked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "for {}", self.processor)?;
        self.glibc.map_or(Ok(()), |glibc| write!(f, ", requires glibc {glibc} or newer"))
    }
}

/// Requirements of the libraries in an FMU, by their paths in it. Other files, and broken ones, are left out.
///
/// # Errors
/// If the archive is broken or hostile.
pub fn asked_within(fmu: &Path) -> Result<BTreeMap<String, Asked>, Error> {
    let mut archive = archive::open(fmu)?;
    let ends = |name: &str| [".so", ".dll", ".dylib"].iter().any(|end| name.ends_with(end));
    let mut found = BTreeMap::new();
    for index in 0..archive.len() {
        let Ok(entry) = archive.by_index(index) else { continue };
        let Ok(name) = entry.name().map(std::borrow::Cow::into_owned) else { continue };
        if !name.starts_with("binaries/") || !ends(&name) || entry.size() > LARGEST {
            continue;
        }
        let mut library = Vec::new();
        if entry.take(LARGEST + 1).read_to_end(&mut library).is_ok() {
            found.extend(Asked::by(&library).map(|asked| (name, asked)));
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Puts a number into bytes.
    fn put<const N: usize>(bytes: &mut [u8], place: usize, value: [u8; N]) {
        bytes[place..place + N].copy_from_slice(&value);
    }

    /// A minimal library that requires some versions of one file, and states their number.
    fn library(versions: &[(&str, u16)], version_count: u16) -> Vec<u8> {
        const HEADERS: usize = 64;
        let needs = HEADERS + 3 * 64;
        let names = needs + 16 + 16 * versions.len();
        let mut bytes = vec![0; names + 1];
        put(&mut bytes, 0, *b"\x7fELF\x02\x01\x01");
        put(&mut bytes, 16, 3_u16.to_le_bytes());
        put(&mut bytes, 18, 183_u16.to_le_bytes());
        put(&mut bytes, 40, (HEADERS as u64).to_le_bytes());
        for (place, value) in [(52, 64_u16), (58, 64), (60, 3), (62, 2)] {
            put(&mut bytes, place, value.to_le_bytes());
        }
        put(&mut bytes, needs, 1_u16.to_le_bytes());
        put(&mut bytes, needs + 2, version_count.to_le_bytes());
        put(&mut bytes, needs + 8, 16_u32.to_le_bytes());
        for (k, (name, flags)) in versions.iter().enumerate() {
            let (place, text) = (needs + 16 + 16 * k, (bytes.len() - names) as u32);
            put(&mut bytes, place + 4, flags.to_le_bytes());
            put(&mut bytes, place + 8, text.to_le_bytes());
            let next = if k + 1 < usize::from(version_count) { 16_u32 } else { 0 };
            put(&mut bytes, place + 12, next.to_le_bytes());
            bytes.extend([name.as_bytes(), b"\0"].concat());
        }
        let sections = [(0x6fff_fffe_u32, needs, names - needs, 2_u32), (3, names, bytes.len() - names, 0)];
        for (k, (kind, place, size, link)) in sections.into_iter().enumerate() {
            let header = HEADERS + 64 * (k + 1);
            put(&mut bytes, header + 4, kind.to_le_bytes());
            put(&mut bytes, header + 24, (place as u64).to_le_bytes());
            put(&mut bytes, header + 32, (size as u64).to_le_bytes());
            put(&mut bytes, header + 40, link.to_le_bytes());
        }
        bytes
    }

    #[test]
    fn the_newest_version_that_a_library_cannot_do_without_counts() {
        let of = |versions: &[(&str, u16)]| {
            Glibc::asked_by(&library(versions, versions.len() as u16)).map(|glibc| glibc.to_string())
        };
        assert_eq!(of(&[("GLIBC_2.2.5", 0), ("GLIBC_2.35", 0), ("GLIBC_2.4", 0)]).as_deref(), Some("2.35"));
        assert_eq!(of(&[("GLIBC_2.17", 0), ("GLIBC_2.30", 2)]).as_deref(), Some("2.17"));
        assert_eq!(of(&[("GLIBC_2.17", 0), ("GLIBC_ABI_DT_RELR", 0)]).as_deref(), Some("2.36"));
        assert_eq!(of(&[("GCC_3.0", 0), ("GLIBC_PRIVATE", 0)]), None);
        let asked = Asked::by(&library(&[("GLIBC_2.17", 0)], 1)).unwrap();
        assert_eq!(asked.to_string(), "for ARM, 64 bits, requires glibc 2.17 or newer");
        assert!(Glibc::of_name(b"GLIBC_2.9") < Some(Glibc::PROMISED));
    }

    #[test]
    fn what_is_broken_or_no_library_is_not_reported() {
        let whole = library(&[("GLIBC_2.2.5", 0), ("GLIBC_2.35", 0)], 2);
        assert!(Asked::by(b"").is_none() && Asked::by(b"MZ\0 of somebody else's").is_none());
        for length in 0..whole.len() {
            assert_eq!(Glibc::asked_by(&whole[..length]), None, "{length} bytes");
        }
        // It states more versions than its bytes contain.
        assert_eq!(Glibc::asked_by(&library(&[("GLIBC_2.2.5", 0)], 9)), None);
        let mut broken = whole.clone();
        for place in 0..whole.len() {
            for value in [0, 1, 0x7f, 0xff] {
                broken[place] = value;
                // Anything but a panic, or a search without end.
                let _ = Asked::by(&broken);
            }
            broken[place] = whole[place];
        }
    }
}
