//! Bytes from outside: none causes a fault, or unlimited time.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;

use adaptive_fmu::execution::Execution;
use adaptive_fmu::exporter::{entries, read_entry};
use adaptive_fmu::fmi2::types::{CO_SIMULATION, MODEL_EXCHANGE};
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::Model;
use adaptive_fmu::model_description::ModelDescription;
use adaptive_fmu::structure::LoopFiles;
use adaptive_fmu::tables;

use super::sequences::{Subject, Tally};
use super::{OK, Unit};

thread_local! {
    static SUBJECTS: RefCell<HashMap<(usize, i32), Rc<Subject>>> = RefCell::default();
}

/// An FMU and an interface by the first two bytes, and the rest.
fn unit_of(bytes: &[u8]) -> Option<(usize, i32, &[u8])> {
    let ([unit, kind], rest) = bytes.split_first_chunk()?;
    Some((usize::from(*unit), if kind % 2 == 0 { CO_SIMULATION } else { MODEL_EXCHANGE }, rest))
}

fn text_of(unit: usize) -> String {
    let names = super::description_names();
    super::description(&names[unit % names.len()])
}

/// An FMU, and calls of 16 bytes each.
pub fn calls(bytes: &[u8]) {
    let Some((unit, kind, rest)) = unit_of(bytes) else { return };
    let made = || Rc::new(Subject::new(&text_of(unit), kind));
    let subject = SUBJECTS.with_borrow_mut(|subjects| subjects.entry((unit, kind)).or_insert_with(made).clone());
    let (calls, _) = rest.as_chunks();
    let calls: Vec<u128> = calls.iter().map(|call| u128::from_le_bytes(*call)).collect();
    subject.calls(&calls, &mut Tally::default());
}

/// An FMU, and changes of a serialised state of it, each place and value; its checksum is made to fit. What forges a
/// checksum may make the instance unusable, as a fault of the library itself does, but no more than that.
pub fn state(bytes: &[u8]) {
    const CHECKSUM: std::ops::Range<usize> = 12..16;
    let Some((unit, kind, rest)) = unit_of(bytes) else { return };
    let unit = Unit::made(REGISTRY, &text_of(unit), kind);
    unit.enter(0.0);
    // Some laws start only with inputs that they can follow.
    unit.exit();
    let mut state = unit.fingerprint();
    for [high, low, value] in rest.as_chunks().0 {
        let place = (usize::from(*high) << 8 | usize::from(*low)) % state.len();
        state[place] = *value;
    }
    let checksum = crc32fast::hash(&state[CHECKSUM.end..]).to_le_bytes();
    state[CHECKSUM].copy_from_slice(&checksum);
    let (status, saved) = unit.deserialise(&state);
    if status == OK {
        assert_eq!(unit.restore(saved), OK);
        let taken = unit.fingerprint();
        let (status, again) = unit.deserialise(&taken);
        assert_eq!((status, unit.restore(again), unit.fingerprint()), (OK, OK, taken));
        unit.step(0.0, 1e-6);
        let _ = unit.try_new_discrete_states();
        unit.try_completed_step(&mut 0);
    }
    unit.messages().iter().for_each(|(_, _, message)| one_line(message));
}

/// A description (TOML) of a unit.
pub fn description(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let made = adaptive_fmu::model::Description::read(text);
    match made.and_then(|description| Model::from_description(description, REGISTRY)) {
        Ok(model) => drop(Execution::new(model).initialise()),
        Err(invalid) => one_line(&invalid.to_string()),
    }
}

/// A structure of a loop (.ssd), and a modelDescription.xml.
pub fn structure(bytes: &[u8]) {
    in_a_file("SystemStructure.ssd", bytes, |file| {
        let folder = file.parent().unwrap_or(file).display().to_string();
        let read = LoopFiles::find(&folder).and_then(|files| files.structure());
        read.err().into_iter().for_each(|error| one_line(&error.to_string()));
    });
    if let Ok(text) = std::str::from_utf8(bytes) {
        ModelDescription::read(text).err().into_iter().for_each(|reason| one_line(&reason));
    }
}

/// An archive: of an FMU, and of a loop.
pub fn archive(bytes: &[u8]) {
    in_a_file("its.fmu", bytes, |file| {
        let read = entries(file).and_then(|_| read_entry(file, "modelDescription.xml"));
        read.err().into_iter().for_each(|error| one_line(&error.to_string()));
    });
    in_a_file("its.ssp", bytes, |file| {
        let read = LoopFiles::find(&file.display().to_string()).and_then(|files| files.structure());
        read.err().into_iter().for_each(|error| one_line(&error.to_string()));
    });
}

/// A table as Parquet, MATLAB file or CSV, by its first bytes.
pub fn table(bytes: &[u8]) {
    in_a_file("table", bytes, |file| {
        tables::read(file, &["record"]).err().into_iter().for_each(|error| one_line(&error.to_string()));
    });
}

fn in_a_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path)) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(name);
    std::fs::write(&file, bytes).unwrap();
    read(&file);
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "reading leaves nothing behind");
}

fn one_line(message: &str) {
    assert!(!message.contains('\n') && !message.is_empty(), "a line: {message}");
}
