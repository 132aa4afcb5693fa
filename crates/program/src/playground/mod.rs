//! A page on which a plant becomes a controller, its FMU and its C: designs, their reports, and files, in memory. The
//! library of this package answers the page, as WebAssembly; the same functions answer tests.

mod about;
mod design;
mod files;
#[cfg(not(target_family = "wasm"))]
mod page;
mod records;

use serde::Deserialize;
use serde_json::Value;

use crate::error::Error;
use crate::exporter::Library;
use crate::fmu::Ready;

#[cfg(not(target_family = "wasm"))]
pub use page::write_playground;

/// Question of the page.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Question {
    /// Kinds and plants.
    About(()),
    /// A design with its report and curves.
    Design(design::Wanted),
    /// A file of a design.
    File(files::Wanted),
    /// The columns of a record.
    Columns(records::Table),
    /// A model of a record.
    Identify(records::Wanted),
}

/// The answer to a question, as the page reads it; `library` gives the libraries of FMUs, the last function receives progress.
///
/// # Errors
/// Why there is none: a plant or a value that is refused, a plant that has no such controller.
pub fn answer(
    question: &Question,
    ready: &Ready,
    library: &dyn Fn() -> Result<Library, Error>,
    progress: &mut dyn FnMut(Value),
) -> Result<Value, Error> {
    match question {
        Question::About(()) => about::about(),
        Question::Design(wanted) => design::answer(wanted, ready),
        Question::File(wanted) => files::answer(wanted, ready, library, progress),
        Question::Columns(table) => records::columns(table),
        Question::Identify(wanted) => records::identified(wanted),
    }
}
