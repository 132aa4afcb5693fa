//! Messages to the master.

use std::ffi::{CString, c_void};

use super::types::{LoggerFunction, Status};
use crate::error::one_line;

/// Category of errors.
pub const ERROR: &str = "logStatusError";

/// Where an instance's messages go. Errors and warnings are always logged; a master that asked for no logging
/// would else see a bare status.
#[derive(Debug)]
pub struct Logger {
    function: Option<LoggerFunction>,
    environment: *mut c_void,
    instance: CString,
    /// Categories in which debug messages are wanted.
    enabled: Vec<String>,
}

// SAFETY: the environment pointer is only handed back to the master's own function, from the thread that called in;
// the standard lets a master move an instance between threads.
#[allow(unsafe_code)]
unsafe impl Send for Logger {}

impl Logger {
    /// The logger of an instance.
    pub fn new(function: Option<LoggerFunction>, environment: *mut c_void, instance: &str) -> Self {
        Logger { function, environment, instance: c_string(instance), enabled: Vec::new() }
    }

    /// Chooses the categories in which debug messages are wanted.
    pub fn enable(&mut self, categories: Vec<String>) {
        self.enabled = categories;
    }

    /// Whether debug messages of a category are wanted.
    pub fn is_enabled(&self, category: &str) -> bool {
        self.enabled.iter().any(|enabled| enabled == category)
    }

    /// Sends one message.
    #[allow(unsafe_code)]
    pub fn log(&self, status: Status, category: &str, text: &str) {
        let Some(function) = self.function else { return };
        // The message is a format to some masters, so it holds no percent sign; and it is one line, whatever a text of
        // the master's holds that it repeats.
        let (category, text) = (c_string(category), c_string(&one_line(&text.replace('%', " percent"))));
        // SAFETY: the function pointer came from the master in fmi2CallbackFunctions and has the standard's
        // signature; all strings live until it returns; the text holds no conversion, so no variadic argument is read.
        unsafe { function(self.environment, self.instance.as_ptr(), status, category.as_ptr(), text.as_ptr()) }
    }
}

/// A text as C takes it.
fn c_string(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}
