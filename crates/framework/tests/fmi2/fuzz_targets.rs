//! The fuzz targets (tests/fuzz) without a fuzzer: over what is sound, and over changes of it.

use adaptive_fmu::exporter::write_entries;
use common::random::Random;
use common::{description, description_folder, description_names, fuzz};

/// The bytes with a few of them changed, cut out, doubled, or moved.
fn mutated(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut below = |n: usize| ((random.next() + 1.0) / 2.0 * n as f64) as usize % n.max(1);
    let mut changed = bytes.to_vec();
    for _ in 0..=below(3) {
        let (from, to) = (below(changed.len()), below(changed.len()));
        let piece = from..(from + below(40)).min(changed.len());
        match below(5) {
            0 => changed.truncate(from),
            1 => drop(changed.drain(piece)),
            2 => drop(changed.splice(to..to, changed[piece].to_vec())),
            _ if changed.is_empty() => {}
            3 => changed[from] ^= 1 << below(8),
            _ => changed[from] = below(256) as u8,
        }
    }
    changed
}

/// Runs a target over sound inputs and over changes of them.
fn run(target: fn(&[u8]), sound: &[Vec<u8>], changes: usize) {
    let mut random = Random::new(7);
    for bytes in sound {
        target(bytes);
        (0..changes).for_each(|_| target(&mutated(bytes, &mut random)));
    }
}

/// Bytes without any order, behind those that choose an FMU and an interface.
fn noise(length: usize) -> Vec<Vec<u8>> {
    let mut random = Random::new(11);
    let mut byte = || (random.next() * 1e6) as i64 as u8;
    (0..2 * description_names().len())
        .map(|k| [(k / 2) as u8, k as u8].into_iter().chain((0..length).map(|_| byte())).collect())
        .collect()
}

/// Structures of loops.
fn structures() -> Vec<Vec<u8>> {
    let files = adaptive_fmu::exporter::loops().iter().flat_map(|(_, files)| *files);
    files.filter(|(name, _)| name.ends_with(".ssd")).map(|(_, text)| text.as_bytes().to_vec()).collect()
}

#[test]
fn calls_out_of_any_bytes_do_no_harm() {
    run(fuzz::calls, &noise(16 * 40), 1);
}

#[test]
fn a_serialised_state_with_any_content_and_a_checksum_that_fits_does_no_harm() {
    run(fuzz::state, &noise(30), 10);
}

#[test]
fn a_description_of_any_bytes_does_no_harm() {
    let sound: Vec<_> = description_names().iter().map(|name| description(name).into_bytes()).collect();
    run(fuzz::description, &sound, 20);
}

#[test]
fn a_structure_or_a_model_description_of_any_bytes_does_no_harm() {
    run(fuzz::structure, &structures(), 40);
    let model_description = std::fs::read(description_folder().join("NonlinearSiso.xml")).unwrap();
    run(fuzz::structure, &[model_description], 400);
}

#[test]
fn an_archive_of_any_bytes_does_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("sound");
    let (xml, structure) = (std::fs::read(description_folder().join("NonlinearSiso.xml")).unwrap(), &structures()[0]);
    write_entries(&file, &[("modelDescription.xml", &xml), ("SystemStructure.ssd", structure)]).unwrap();
    run(fuzz::archive, &[std::fs::read(&file).unwrap()], 600);
}

#[test]
fn a_table_of_any_bytes_does_no_harm() {
    let files = std::fs::read_dir(common::at_top("tests/fuzz/tables")).unwrap();
    let sound: Vec<_> = files.map(|file| std::fs::read(file.unwrap().path()).unwrap()).collect();
    assert!(sound.len() >= 4);
    run(fuzz::table, &sound, 3000);
}
