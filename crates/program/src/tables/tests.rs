use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::*;
use crate::parquet::Writer;

fn parquet() -> Vec<u8> {
    let mut file = Writer::new(Vec::new(), ["time", "x[1]", "odd, \"name\""].map(str::to_owned).to_vec()).unwrap();
    for rows in [3, 1, 200] {
        let column = |k: usize| (0..rows).map(move |row| (row as f64 + 0.1).powi(7) / (k as f64 - 1.5));
        file.group(rows, (0..3).map(column)).unwrap();
    }
    file.finish(&[("unit of x[1]".to_owned(), "rad/s".to_owned())]).unwrap()
}

/// An element of a MATLAB file.
fn element(kind: u32, own: &[u8]) -> Vec<u8> {
    let mut bytes = [kind.to_le_bytes(), (own.len() as u32).to_le_bytes()].concat();
    bytes.extend(own);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// A variable of doubles.
fn matrix(name: &str, dims: [i32; 2], values: &[f64]) -> Vec<u8> {
    let numbers: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let dims: Vec<u8> = dims.iter().flat_map(|size| size.to_le_bytes()).collect();
    let parts =
        [element(6, &[6, 0, 0, 0, 0, 0, 0, 0]), element(5, &dims), element(1, name.as_bytes()), element(9, &numbers)];
    element(14, &parts.concat())
}

fn mat(elements: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = b"MATLAB 5.0 MAT-file".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    bytes.extend(elements.concat());
    bytes
}

fn compressed(own: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(own).unwrap();
    let own = encoder.finish().unwrap();
    [15_u32.to_le_bytes().to_vec(), (own.len() as u32).to_le_bytes().to_vec(), own].concat()
}

fn refusal(bytes: &[u8]) -> String {
    of_bytes(bytes, bytes.starts_with(parquet::MAGIC), &[]).unwrap_err()
}

#[test]
fn parquet_of_runs_is_read_to_the_bit() {
    let table = of_bytes(&parquet(), true, &[]).unwrap();
    let names: Vec<_> = table.columns.iter().map(|column| (column.name.as_str(), column.unit.as_deref())).collect();
    assert_eq!(names, [("time", None), ("x[1]", Some("rad/s")), ("odd, \"name\"", None)]);
    let rows: Vec<f64> = [3, 1, 200].into_iter().flat_map(|rows| (0..rows).map(|row| f64::from(row) + 0.1)).collect();
    for (k, column) in table.columns.iter().enumerate() {
        let expected: Vec<u64> = rows.iter().map(|row| (row.powi(7) / (k as f64 - 1.5)).to_bits()).collect();
        assert_eq!(column.values.iter().map(|value| value.to_bits()).collect::<Vec<_>>(), expected);
    }
    assert_eq!((table.rows(), table.place(4)), (204, "row 5".to_owned()));
}

#[test]
fn vectors_as_long_as_the_time_are_columns_of_a_matlab_file() {
    let table = mat(&[
        matrix("x", [2, 3], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        compressed(&matrix("time", [1, 2], &[0.0, 0.5])),
        matrix("Ts", [1, 1], &[0.5]),
    ]);
    let table = of_bytes(&table, false, &[]).unwrap();
    let columns: Vec<_> = table.columns.iter().map(|column| (column.name.as_str(), &column.values[..])).collect();
    let expected: [(&str, &[f64]); 4] =
        [("x[1]", &[1.0, 2.0]), ("x[2]", &[3.0, 4.0]), ("x[3]", &[5.0, 6.0]), ("time", &[0.0, 0.5])];
    assert_eq!(columns, expected);
    assert_eq!(table.assumed, ["Ts (1×1) is left out: it has no 2 rows"]);
}

#[test]
fn other_files_are_refused_with_what_to_do() {
    assert!(refusal(b"MATLAB 7.3 MAT-file, Platform").contains("save(…, '-v7')"));
    assert!(refusal(HDF5_FILE).contains("save(…, '-v7')"));
    assert!(refusal(&[0; 300]).contains("version 4"));
    assert!(refusal(b"PAR1PARE").contains("PAR1") && refusal(b"PAR1........PARE").contains("encrypted"));
    assert!(refusal(&mat(&[])).contains("numeric vectors of equal length"));
    assert!(refusal(&mat(&[matrix("x", [2, 2], &[1.0])])).contains("damaged"));
    assert!(refusal(&mat(&[matrix("x", [-1, -1], &[1.0])])).contains("damaged"));
}

const HDF5_FILE: &[u8] = b"\x89HDF\r\n\x1a\n and more";

#[test]
fn files_that_claim_more_than_they_hold_are_refused() {
    let bomb = mat(&[compressed(&matrix("x", [1, 10_000_000], &vec![0.0; 10_000_000]))]);
    assert!(bomb.len() < 200_000);
    assert_eq!(refusal(&bomb), "holds far more values than its size allows: it may be damaged");
    // 2⁶⁰ rows in the group, and in the pages.
    let whole = parquet();
    let rows = [0x16, 6, 0];
    let mut found = 0;
    for place in 0..whole.len() - rows.len() {
        if whole[place..].starts_with(&rows) {
            let more = [0x16, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x20, 0];
            let mut file = [&whole[..place], &more, &whole[place + rows.len()..]].concat();
            let sizes = file.len() - 8;
            let size = u32::from_le_bytes(whole[whole.len() - 8..whole.len() - 4].try_into().unwrap()) + 8;
            file[sizes..sizes + 4].copy_from_slice(&size.to_le_bytes());
            assert!(refusal(&file).contains("damaged"), "{}", refusal(&file));
            found += 1;
        }
    }
    assert!(found > 0);
}

#[test]
fn damaged_files_are_refused_or_read() {
    let mut random = fastrand::Rng::with_seed(7);
    let vectors = [matrix("time", [50, 1], &[0.5; 50]), compressed(&matrix("x", [50, 2], &[1.5; 100]))];
    for whole in [parquet(), mat(&vectors)] {
        let is_parquet = whole.starts_with(parquet::MAGIC);
        for length in 0..whole.len().min(4000) {
            // A truncated file is damaged, except between variables.
            let result = of_bytes(&whole[..length], is_parquet, &[]);
            assert!(!is_parquet || result.is_err());
        }
        for _ in 0..20_000 {
            let mut bytes = whole.clone();
            for _ in 0..random.usize(1..6) {
                let place = random.usize(..bytes.len());
                bytes[place] = random.u8(..);
            }
            // Parquet has its metadata at the end.
            if is_parquet && random.bool() {
                let place = bytes.len() - 1 - random.usize(..bytes.len().min(500));
                bytes[place] = random.u8(..);
            }
            let _ = of_bytes(&bytes, is_parquet, &["record"]);
        }
    }
}
