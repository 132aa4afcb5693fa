//! Messages to the master.

use std::ffi::{CStr, CString, c_void};
use std::sync::Arc;

use super::floating_point;
use super::types::{LogMessage, LoggerFunction, Status};
use crate::error::one_line;
use crate::model::Model;

/// Category of errors.
pub const ERROR: &str = "logStatusError";
/// Log category of what could not be done, but may be tried otherwise.
pub const DISCARDED: &str = "logStatusDiscard";
/// Log category of what works, but may not be meant.
pub const WARNING: &str = "logStatusWarning";
/// Debug messages about accepted parameters and events.
pub const EVENTS: &str = "logEvents";

/// The log categories of a model, with their descriptions.
pub fn categories(model: &Model) -> impl Iterator<Item = (&'static str, &'static str)> {
    let standard = [
        (ERROR, "a call was refused or failed: what, why, and what to do"),
        (DISCARDED, "a step could not be finished or a value not be computed; a smaller step may help"),
        (WARNING, "allowed, but possibly not intended"),
        (EVENTS, "tunable parameters that were taken over, and integration methods"),
    ];
    // Parts of a system may share a category.
    let mut categories = standard.to_vec();
    for &(name, text) in model.variables().warnings() {
        if categories.iter().all(|(known, _)| *known != name) {
            categories.push((name, text));
        }
    }
    categories.into_iter()
}

/// The master's function for messages.
#[derive(Debug, Clone, Copy)]
pub enum Callback {
    /// FMI 2.0: the text is a format of printf.
    Fmi2(LoggerFunction),
    /// FMI 3.0
    Fmi3(LogMessage),
}

/// Destination of an instance's messages. Errors and warnings are always logged; a master that asked for no logging
/// would else see a bare status.
///
/// A call collects its messages and sends them at its very end. So the master's function may call the instance again,
/// and may throw an exception, without finding anything half done.
#[derive(Debug)]
pub struct Logger {
    function: Option<Callback>,
    environment: *mut c_void,
    instance: Arc<CStr>,
    /// Categories in which debug messages are wanted.
    enabled: Vec<String>,
    waiting: Vec<Message>,
}

#[derive(Debug)]
struct Message {
    status: Status,
    category: CString,
    text: CString,
}

// SAFETY: the environment pointer is only passed back to the master's own function, from the thread that called in; the
// standard lets a master move an instance between threads.
#[allow(unsafe_code)]
unsafe impl Send for Logger {}

impl Logger {
    /// The logger of an instance.
    pub fn new(function: Option<Callback>, environment: *mut c_void, instance: &CStr) -> Self {
        Logger { function, environment, instance: instance.into(), enabled: Vec::new(), waiting: Vec::new() }
    }

    /// Chooses the categories in which debug messages are wanted.
    pub fn enable(&mut self, categories: Vec<String>) {
        self.enabled = categories;
    }

    /// Turns categories on or off; others stay as they are.
    pub fn switch(&mut self, categories: &[&str], on: bool) {
        self.enabled.retain(|enabled| !categories.contains(&enabled.as_str()));
        if on {
            self.enabled.extend(categories.iter().map(|category| (*category).to_owned()));
        }
    }

    /// True if debug messages of a category are wanted.
    pub fn is_enabled(&self, category: &str) -> bool {
        self.enabled.iter().any(|enabled| enabled == category)
    }

    /// Leaves one message to be sent.
    pub fn log(&mut self, status: Status, category: &str, text: &str) {
        // One line, whatever a text of the master's holds that it repeats.
        let text = match self.function {
            None => return,
            // By the standard the text is a format of printf, so a percent sign is written as two.
            Some(Callback::Fmi2(_)) => one_line(text).replace('%', "%%"),
            // Only errors are sent to a master that asked for no messages.
            Some(Callback::Fmi3(_)) if status != Status::Error && !self.is_enabled(category) => return,
            Some(Callback::Fmi3(_)) => one_line(text),
        };
        self.waiting.push(Message { status, category: c_string(category), text: c_string(&text) });
    }

    /// Takes out what waits to be sent, if anything.
    pub fn outbox(&mut self) -> Option<Outbox> {
        if self.waiting.is_empty() {
            return None;
        }
        Some(Outbox {
            function: self.function?,
            environment: self.environment,
            instance: Arc::clone(&self.instance),
            messages: std::mem::take(&mut self.waiting),
        })
    }
}

/// The messages of one call, apart from the instance: its master may do with that what it likes while they are sent.
#[derive(Debug)]
pub struct Outbox {
    function: Callback,
    environment: *mut c_void,
    instance: Arc<CStr>,
    messages: Vec<Message>,
}

impl Outbox {
    /// Sends the messages. An exception of the master's function goes through: never send where a panic is contained,
    /// since Rust can't catch what isn't its own.
    #[allow(unsafe_code)]
    pub fn send(self) {
        for Message { status, category, text } in &self.messages {
            let (name, category, text) = (self.instance.as_ptr(), category.as_ptr(), text.as_ptr());
            floating_point::as_the_host(|| match self.function {
                // SAFETY: the function pointer came from the master in fmi2CallbackFunctions and has the standard's
                // signature; all strings live until it returns; the text holds no conversion but `%%`, so no variadic
                // argument is read.
                Callback::Fmi2(function) => unsafe { function(self.environment, name, *status, category, text) },
                // SAFETY: likewise, from fmi3InstantiateModelExchange or fmi3InstantiateCoSimulation.
                Callback::Fmi3(function) => unsafe { function(self.environment, *status, category, text) },
            });
        }
    }
}

/// A text as C takes it.
fn c_string(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}
