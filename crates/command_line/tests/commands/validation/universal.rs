//! Universal libraries of macOS: one file for several processors.

use super::*;

/// A library of macOS that holds nothing but the names of what it exports.
fn of_one_processor(names: &[String]) -> Vec<u8> {
    const HEADER: u32 = 32;
    const TABLE: u32 = 24;
    let (mut symbols, mut strings) = (Vec::new(), vec![0_u8]);
    for name in names {
        symbols.extend(u32::try_from(strings.len()).unwrap().to_le_bytes());
        // External and absolute, in no section, without flags, at 0.
        symbols.extend([3, 0, 0, 0]);
        symbols.extend([0; 8]);
        strings.extend(format!("_{name}\0").bytes());
    }
    let [count, size, length] = [names.len(), symbols.len(), strings.len()].map(|n| u32::try_from(n).unwrap());
    // Magic number, x86-64, a dynamic library, one load command: the table of symbols.
    let header = [0xfeed_facf, 0x0100_0007, 3, 6, 1, TABLE, 0, 0];
    let table = [2, TABLE, HEADER + TABLE, count, HEADER + TABLE + size, length];
    let mut bytes: Vec<u8> = header.into_iter().chain(table).flat_map(u32::to_le_bytes).collect();
    bytes.extend(symbols);
    bytes.extend(strings);
    bytes
}

/// Libraries in one file, whose places have 32 or 64 bits.
fn universal(slices: &[Vec<u8>], wide: bool) -> Vec<u8> {
    const ALIGNED: usize = 4096;
    let magic: u32 = if wide { 0xcafe_babf } else { 0xcafe_babe };
    let mut header: Vec<u8> =
        [magic, u32::try_from(slices.len()).unwrap()].into_iter().flat_map(u32::to_be_bytes).collect();
    let mut content = Vec::new();
    for slice in slices {
        let (place, size) = (ALIGNED + content.len(), slice.len());
        header.extend([0x0100_0007_u32, 3].into_iter().flat_map(u32::to_be_bytes));
        if wide {
            header.extend([place, size].into_iter().flat_map(|n| (n as u64).to_be_bytes()));
            header.extend([12_u32, 0].into_iter().flat_map(u32::to_be_bytes));
        } else {
            header.extend([place, size, 12].into_iter().flat_map(|n| u32::try_from(n).unwrap().to_be_bytes()));
        }
        content.extend(slice);
        content.resize(content.len().next_multiple_of(ALIGNED), 0);
    }
    header.resize(ALIGNED, 0);
    [header, content].concat()
}

/// Findings for a library of macOS.
fn found_of(library: Vec<u8>) -> Vec<String> {
    let (_folder, file) = packed(&[
        ("modelDescription.xml".to_owned(), description("").into_bytes()),
        ("binaries/darwin64/unit.dylib".to_owned(), library),
    ]);
    found_in(&file).into_iter().filter(|finding| finding.contains("dylib")).collect()
}

#[test]
fn a_universal_library_exports_what_all_of_its_parts_export() {
    // The unit in C has all functions.
    let source = fs::read_to_string(at_top("tests/validation/unit.c")).unwrap();
    let words = source.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| word.starts_with("fmi2"));
    let all: Vec<String> = words.map(str::to_owned).collect();
    let without: Vec<String> = all.iter().filter(|name| *name != "fmi2DoStep").cloned().collect();
    let (whole, lacking) = (of_one_processor(&all), of_one_processor(&without));
    assert_eq!(found_of(whole.clone()), Vec::<String>::new());
    for wide in [false, true] {
        assert_eq!(found_of(universal(&[whole.clone(), whole.clone()], wide)), Vec::<String>::new());
        for slices in [[whole.clone(), lacking.clone()], [lacking.clone(), whole.clone()]] {
            let found = found_of(universal(&slices, wide));
            assert!(found.len() == 1 && found[0].contains("unit.dylib does not export fmi2DoStep, which"), "{found:?}");
        }
        let mut cut = universal(&[whole.clone(), whole.clone()], wide);
        cut.truncate(6000);
        for broken in [universal(&[], wide), universal(&vec![whole.clone(); 17], wide), cut] {
            let found = found_of(broken);
            assert!(found.len() == 1 && found[0].contains("unit.dylib is not a shared library: "), "{found:?}");
        }
    }
}
