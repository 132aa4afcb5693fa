//! A loop in the browser without a server: this library, as WebAssembly, answers its page itself.

use std::sync::{Mutex, PoisonError};

use serde::Deserialize;
use serde_json::{Value, json};

use super::cases::{cases, coarse};
use super::session::{Session, Wanted};
use crate::SOURCE;
use crate::error::Error;
use crate::fmu::Ready;
use crate::simulation::LoadedLoop;
use crate::structure::{LoopFiles, Settings, Structure, Whole};

/// The loop of the page.
static SESSION: Mutex<Option<Session>> = Mutex::new(None);

/// Request of a page.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Asked {
    /// Data that it shows of a loop before the first run.
    Loop(String),
    Run(Wanted),
    Set(Wanted),
}

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Takes a line of JSON: the progress of a run, or, last, the answer.
    fn take(text: *const u8, length: usize);
}

fn tell(line: &Value) {
    let text = line.to_string();
    // SAFETY: the page reads no more bytes of the text before it returns.
    unsafe { take(text.as_ptr(), text.len()) };
}

/// Checksum of the sources: the program that writes a page looks for it within these bytes.
#[unsafe(no_mangle)]
extern "C" fn explore_source() -> *const u8 {
    SOURCE.as_ptr()
}

/// Memory for the text of a question.
#[unsafe(no_mangle)]
extern "C" fn explore_place(length: usize) -> *mut u8 {
    Box::into_raw(vec![0_u8; length].into_boxed_slice()).cast()
}

/// Answers a question, and frees its memory.
///
/// # Safety
/// The memory must be one of this size that [`explore_place`] returned.
#[unsafe(no_mangle)]
unsafe extern "C" fn explore_answer(place: *mut u8, length: usize) {
    // SAFETY: the caller of this function guarantees it.
    let question = unsafe { Box::from_raw(std::ptr::slice_from_raw_parts_mut(place, length)) };
    let answered = serde_json::from_slice(&question).map_err(|error| error.to_string()).and_then(answer);
    tell(&answered.unwrap_or_else(|reason| json!({ "error": reason })));
}

fn answer(asked: Asked) -> Result<Value, String> {
    let mut session = SESSION.lock().unwrap_or_else(PoisonError::into_inner);
    if let Asked::Loop(name) = &asked {
        *session = Some(begun(name).map_err(|error| error.to_string())?);
    }
    let session = session.as_ref().ok_or("no loop was requested")?;
    match asked {
        Asked::Loop(_) => Ok(session.told()),
        Asked::Set(wanted) => Ok(json!({ "set": session.set(&wanted)? })),
        Asked::Run(wanted) => session.run(&wanted, &mut |line| {
            tell(&line);
            true
        }),
    }
}

/// A session with one of this package's loops as a composite, and its cases.
fn begun(name: &str) -> Result<Session, Error> {
    let files = LoopFiles::find(name)?;
    let mut structure = files.structure()?;
    structure.expected_failure = structure.expected_failure.filter(|it| !it.separate_only);
    let Structure { start_time, stop_time, step, .. } = structure;
    let fine = Settings { start_time, stop_time, step };
    let ready = Ready::new()?;
    let load = |structure: &Structure| {
        let Whole { source, values, notes } = Whole::new(structure, ready.library())?;
        Ok(LoadedLoop::whole(&structure.name, ready.fmu(&source)?, &values, notes)?
            .recording(structure.signals())
            .with_events(&structure.events)?)
    };
    let plain = load(&structure)?;
    let (bases, notes) = cases(structure, &files, load)?;
    Ok(Session::new(bases, &plain, (coarse(fine), fine), true, notes, "".into()))
}
