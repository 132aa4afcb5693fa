//! This library in a page, as WebAssembly: it answers the questions of pages that have no server.

use std::cell::Cell;
use std::sync::{Mutex, PoisonError};

use serde::Deserialize;
use serde_json::{Value, json};

use crate::SOURCE;
use crate::error::Error;
use crate::explore::{Session, Wanted, begun};
use crate::exporter::Library;
use crate::fmu::Ready;
use crate::playground;

/// The loop of the page.
static SESSION: Mutex<Option<Session>> = Mutex::new(None);
/// FMUs of the page, which are the same in many questions.
static READY: Mutex<Option<Ready>> = Mutex::new(None);
/// Libraries for FMUs: the bytes of each.
static LIBRARIES: Mutex<Vec<Vec<u8>>> = Mutex::new(Vec::new());

/// Request of a page of `explore`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum OfLoop {
    /// Data that it shows of a loop before the first run.
    Loop(String),
    Run(Wanted),
    Set(Wanted),
}

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Takes a line of JSON: progress, or, last, the answer.
    fn take(text: *const u8, length: usize);
}

fn send(line: &Value) {
    let text = line.to_string();
    // SAFETY: the page reads no more bytes of the text before it returns.
    unsafe { take(text.as_ptr(), text.len()) };
}

/// Checksum of the sources: the program that writes a page looks for it within these bytes.
#[unsafe(no_mangle)]
extern "C" fn page_source() -> *const u8 {
    SOURCE.as_ptr()
}

/// Memory for the text of a question, or for the bytes of a library.
#[unsafe(no_mangle)]
extern "C" fn page_place(length: usize) -> *mut u8 {
    Box::into_raw(vec![0_u8; length].into_boxed_slice()).cast()
}

/// Answers a question, and frees its memory.
///
/// # Safety
/// The memory must be one of this size that [`page_place`] returned.
#[unsafe(no_mangle)]
unsafe extern "C" fn page_answer(place: *mut u8, length: usize) {
    // SAFETY: the caller of this function guarantees it.
    let question = unsafe { Box::from_raw(std::ptr::slice_from_raw_parts_mut(place, length)) };
    // Whatever becomes of the question, the next one has its own.
    let libraries = std::mem::take(&mut *LIBRARIES.lock().unwrap_or_else(PoisonError::into_inner));
    let answered = answer(&question, libraries);
    send(&answered.unwrap_or_else(|reason| json!({ "error": reason })));
}

/// Keeps a library for the FMUs of the page.
///
/// # Safety
/// As [`page_answer`].
#[unsafe(no_mangle)]
unsafe extern "C" fn page_library(place: *mut u8, length: usize) {
    // SAFETY: the caller of this function guarantees it.
    let bytes = unsafe { Box::from_raw(std::ptr::slice_from_raw_parts_mut(place, length)) };
    LIBRARIES.lock().unwrap_or_else(PoisonError::into_inner).push(bytes.into_vec());
}

fn answer(question: &[u8], libraries: Vec<Vec<u8>>) -> Result<Value, String> {
    let wrong = |error: serde_json::Error| error.to_string();
    let question: Value = serde_json::from_slice(question).map_err(wrong)?;
    if ["loop", "run", "set"].iter().any(|key| question.get(key).is_some()) {
        return of_loop(serde_json::from_value(question).map_err(wrong)?);
    }
    let question = serde_json::from_value(question).map_err(wrong)?;
    of_design(&question, libraries).map_err(|error| error.to_string())
}

/// Answers a question of the page from a plant to an FMU; FMUs contain the libraries.
fn of_design(question: &playground::Question, libraries: Vec<Vec<u8>>) -> Result<Value, Error> {
    let mut ready = READY.lock().unwrap_or_else(PoisonError::into_inner);
    let ready = match ready.take() {
        Some(known) => ready.insert(known),
        None => ready.insert(Ready::new()?),
    };
    let libraries = Cell::new(libraries);
    playground::answer(question, ready, &|| Library::holding(libraries.take()), &mut |line| send(&line))
}

fn of_loop(asked: OfLoop) -> Result<Value, String> {
    let mut session = SESSION.lock().unwrap_or_else(PoisonError::into_inner);
    if let OfLoop::Loop(name) = &asked {
        *session = Some(begun(name).map_err(|error| error.to_string())?);
    }
    let session = session.as_ref().ok_or("no loop was requested")?;
    match asked {
        OfLoop::Loop(_) => Ok(session.to_json()),
        OfLoop::Set(wanted) => Ok(json!({ "set": session.set(&wanted)? })),
        OfLoop::Run(wanted) => session.run(&wanted, &mut |line| {
            send(&line);
            true
        }),
    }
}
