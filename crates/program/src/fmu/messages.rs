//! Log messages of FMUs, expanded and cleaned.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::unit::OK;
use crate::error::one_line;
use crate::fmi2::types::LoggerFunction;

/// Largest number of stored messages; of further ones, only their number and the last are stored.
const MOST: usize = 100;
/// Largest number of messages in an error.
const MOST_JOINED: usize = 10;
/// Largest length of a message, in bytes.
const LONGEST: usize = 4096;

/// Messages, in their order.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Messages {
    /// The first hundred messages.
    first: Vec<String>,
    /// Number of messages after them, and the last one.
    further: usize,
    last: Option<String>,
    /// Messages of successful calls, if they are stored.
    details: Vec<String>,
}

impl Messages {
    /// Adds a message, cleaned of control characters.
    pub(super) fn push(&mut self, text: &str) {
        let text = cleaned(text);
        if self.first.len() < MOST {
            self.first.push(text);
        } else {
            self.further += 1;
            self.last = Some(text);
        }
    }

    /// Adds a message of a successful call, unless there are too many.
    fn push_detail(&mut self, text: &str) {
        if self.details.len() < MOST {
            self.details.push(cleaned(text));
        }
    }

    /// Messages of successful calls, if they are stored.
    pub fn details(&self) -> &[String] {
        &self.details
    }

    /// Adds later messages.
    #[cfg(any(unix, test))]
    pub(super) fn append(&mut self, later: Messages) {
        later.details.iter().for_each(|text| self.push_detail(text));
        later.first.iter().for_each(|text| self.push(text));
        if let Some(last) = later.last {
            self.further += later.further.saturating_sub(1);
            self.push(&last);
        }
    }

    /// True if there is no message.
    pub fn is_empty(&self) -> bool {
        self.first.is_empty()
    }

    /// Number of messages, including those that were dropped.
    pub fn count(&self) -> usize {
        self.first.len() + self.further
    }

    /// The messages in order; in place of dropped ones, their number.
    pub fn iter(&self) -> impl Iterator<Item = String> + '_ {
        let uncounted = self.further.saturating_sub(1);
        let more = (uncounted > 0).then(|| format!("({uncounted} more messages)"));
        self.first.iter().cloned().chain(more).chain(self.last.clone())
    }

    /// The last of them in one line, which contain the reason of a failure.
    pub fn joined(&self) -> String {
        let all: Vec<_> = self.iter().collect();
        let first = all.len().saturating_sub(MOST_JOINED);
        let earlier = (first > 0).then(|| format!("({} earlier messages)", self.count() - (all.len() - first)));
        earlier.iter().chain(&all[first..]).cloned().collect::<Vec<_>>().join("; ")
    }
}

/// A text in one line, cut if it is too long.
fn cleaned(text: &str) -> String {
    let text = one_line(text.trim_end());
    let end = (0..=LONGEST.min(text.len())).rev().find(|&end| text.is_char_boundary(end)).unwrap_or_default();
    if end < text.len() { format!("{}…", &text[..end]) } else { text }
}

/// Messages of an FMU that may log from any thread.
#[derive(Debug, Default)]
pub(super) struct Log {
    messages: Mutex<Messages>,
    /// True if there may be messages. It makes the check after every step cheap.
    spoke: AtomicBool,
    /// True if messages of successful calls are stored too.
    keeps_details: bool,
}

impl Log {
    /// A log; with `details` it also stores messages of successful calls.
    pub fn keeping(details: bool) -> Self {
        Log { messages: Mutex::default(), spoke: AtomicBool::new(false), keeps_details: details }
    }

    pub fn push(&self, text: &str) {
        self.keep(|messages| messages.push(text));
    }

    fn push_detail(&self, text: &str) {
        self.keep(|messages| messages.push_detail(text));
    }

    fn keep(&self, push: impl FnOnce(&mut Messages)) {
        push(&mut self.messages.lock().unwrap_or_else(PoisonError::into_inner));
        self.spoke.store(true, Ordering::Release);
    }

    pub fn take(&self) -> Messages {
        if !self.spoke.load(Ordering::Acquire) {
            return Messages::default();
        }
        // A message that arrives meanwhile is either taken with the others, or sets the flag again.
        self.spoke.store(false, Ordering::Release);
        std::mem::take(&mut self.messages.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The function with which FMUs log; its environment is a [`Log`].
pub(super) fn logger() -> LoggerFunction {
    #[cfg(not(target_family = "wasm"))]
    type Fixed = unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char);
    #[cfg(target_family = "wasm")]
    type Fixed = unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char, *mut c_void);
    // SAFETY: the caller passes arguments of the standard's types; `keep_message` takes them as its platform passes
    // them to a variadic function.
    unsafe { std::mem::transmute::<Fixed, LoggerFunction>(keep_message) }
}

/// The function with which FMUs of FMI 3.0 log expanded messages. Its environment is a [`Log`].
pub(super) unsafe extern "C-unwind" fn log_message(
    environment: *mut c_void,
    status: c_int,
    _category: *const c_char,
    message: *const c_char,
) {
    // SAFETY: the environment is the instance's log, which outlives it, and the message is a C string.
    unsafe {
        if !message.is_null() && is_stored(environment, status) {
            keep(environment, status, &CStr::from_ptr(message).to_string_lossy());
        }
    }
}

/// Stores an expanded message with its status.
///
/// # Safety
/// The environment must be a [`Log`] that is alive.
unsafe fn keep(environment: *mut c_void, status: c_int, message: &str) {
    // SAFETY: as this function asks of its caller.
    let log = unsafe { &*environment.cast::<Log>() };
    if status == OK { log.push_detail(message) } else { log.push(message) }
}

/// True if messages of a status are stored.
///
/// # Safety
/// As of [`keep`].
unsafe fn is_stored(environment: *mut c_void, status: c_int) -> bool {
    // SAFETY: as this function asks of its caller.
    status != OK || unsafe { &*environment.cast::<Log>() }.keeps_details
}

#[cfg(all(target_arch = "x86_64", unix))]
use expanding::keep_message;

/// Expansion of messages. Rust can't define a variadic function; on a platform with a known calling convention, a few
/// instructions pass the variadic arguments to C's vsnprintf.
#[cfg(all(target_arch = "x86_64", unix))]
mod expanding {
    use super::{CStr, LONGEST, c_char, c_int, c_void, is_stored, keep};

    unsafe extern "C" {
        fn vsnprintf(text: *mut c_char, size: usize, format: *const c_char, arguments: *mut c_void) -> c_int;
    }

    /// Builds the `va_list` of its arguments as a C compiler does (System V ABI, AMD64, section 3.5.7): the argument
    /// registers and the address of the others on the stack. Then passes it on as a sixth argument.
    #[unsafe(naked)]
    pub unsafe extern "C" fn keep_message(
        _environment: *mut c_void,
        _instance: *const c_char,
        _status: c_int,
        _category: *const c_char,
        _format: *const c_char,
    ) {
        std::arch::naked_asm!(
            // 176 bytes of registers, 24 of the va_list, 8 that keep the stack aligned.
            "sub rsp, 216",
            // The sixth argument's register; the five before contain the named ones.
            "mov [rsp + 40], r9",
            // Vector registers are used where al isn't 0.
            "test al, al",
            "je 2f",
            "movaps [rsp + 48], xmm0",
            "movaps [rsp + 64], xmm1",
            "movaps [rsp + 80], xmm2",
            "movaps [rsp + 96], xmm3",
            "movaps [rsp + 112], xmm4",
            "movaps [rsp + 128], xmm5",
            "movaps [rsp + 144], xmm6",
            "movaps [rsp + 160], xmm7",
            "2:",
            // Five of the general registers and none of the vector registers are used up.
            "mov dword ptr [rsp + 176], 40",
            "mov dword ptr [rsp + 180], 48",
            // Further arguments lie behind the return address.
            "lea rax, [rsp + 224]",
            "mov [rsp + 184], rax",
            "mov [rsp + 192], rsp",
            "lea r9, [rsp + 176]",
            "call {expand}",
            "add rsp, 216",
            "ret",
            expand = sym expand,
        )
    }

    unsafe extern "C" fn expand(
        environment: *mut c_void,
        _instance: *const c_char,
        status: c_int,
        _category: *const c_char,
        format: *const c_char,
        arguments: *mut c_void,
    ) {
        // SAFETY: the environment is the instance's log, which outlives it.
        if format.is_null() || !unsafe { is_stored(environment, status) } {
            return;
        }
        // One byte more than is stored shows that a text is longer.
        let mut text = [0; LONGEST + 2];
        // SAFETY: the FMU passes a format and matching arguments, as for any printf; the buffer has that size, and
        // vsnprintf ends its text with a NUL.
        unsafe {
            if vsnprintf(text.as_mut_ptr(), text.len(), format, arguments) < 0 {
                keep(environment, status, &CStr::from_ptr(format).to_string_lossy());
            } else {
                keep(environment, status, &CStr::from_ptr(text.as_ptr()).to_string_lossy());
            }
        }
    }
}

/// Stores the format itself as the message: on other platforms the variadic arguments aren't read. The named ones come
/// as in any function, on WebAssembly followed by a pointer to the others.
#[cfg(not(all(target_arch = "x86_64", unix)))]
unsafe extern "C" fn keep_message(
    environment: *mut c_void,
    _instance: *const c_char,
    status: c_int,
    _category: *const c_char,
    format: *const c_char,
    #[cfg(target_family = "wasm")] _arguments: *mut c_void,
) {
    // SAFETY: the environment is the instance's log, which outlives it.
    if !format.is_null() && unsafe { is_stored(environment, status) } {
        // SAFETY: the message is a C string.
        let format = unsafe { CStr::from_ptr(format) };
        let text = format.to_string_lossy().replace("%%", "%");
        // SAFETY: see above.
        unsafe { keep(environment, status, &text) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fmi2::types::Status;

    #[test]
    #[cfg(all(target_arch = "x86_64", unix))]
    fn a_message_is_expanded_as_printf_does() {
        let log = Log::default();
        let environment = std::ptr::from_ref(&log).cast_mut().cast();
        let (name, logger) = (c"unit".as_ptr(), logger());
        // SAFETY: the arguments match their formats.
        unsafe {
            logger(environment, name, Status::Warning, name, c"100 %% of %s".as_ptr(), c"it".as_ptr());
            logger(environment, name, Status::Error, name, c"%d %.3f %s %g %i".as_ptr(), 7, 1.5, name, 1e-9, -2);
            let format = c"%d %d %d %d %.1f %.1f %.1f %.1f %.1f %.1f %.1f %.1f %.1f %d";
            let (a, b, c, d, e) = (1.0, 2.0, 3.0, 4.0, 5.0);
            logger(environment, name, Status::Warning, name, format.as_ptr(), 1, 2, 3, 4, a, b, c, d, e, a, b, c, d, 9);
            logger(environment, name, Status::Error, name, c"\x1b[31mred\r\nnext".as_ptr());
            logger(environment, name, Status::Ok, name, c"all is well".as_ptr());
        }
        let texts: Vec<_> = log.take().iter().collect();
        assert_eq!(texts[0], "100 % of it");
        assert_eq!(texts[1], "7 1.500 unit 1e-09 -2");
        assert_eq!(texts[2], "1 2 3 4 1.0 2.0 3.0 4.0 5.0 1.0 2.0 3.0 4.0 9");
        assert_eq!(texts[3], "\\u{1b}[31mred\\r\\nnext");
        assert_eq!(texts.len(), 4, "what is logged of a call that went well is no warning");
    }

    #[test]
    #[cfg(all(target_arch = "x86_64", unix))]
    fn messages_of_a_call_that_succeeded_are_stored_where_that_is_asked_for() {
        let log = Log::keeping(true);
        let environment = std::ptr::from_ref(&log).cast_mut().cast();
        // SAFETY: the argument matches the format.
        unsafe { logger()(environment, c"unit".as_ptr(), Status::Ok, c"logEvents".as_ptr(), c"%d steps".as_ptr(), 3) };
        let mut messages = log.take();
        assert_eq!((messages.is_empty(), messages.details()), (true, ["3 steps".to_owned()].as_slice()));
        messages.append(Messages { details: vec!["later".to_owned()], ..Messages::default() });
        assert_eq!((messages.count(), messages.details().len()), (0, 2));
    }

    #[test]
    fn after_the_hundredth_messages_are_counted_and_the_last_is_stored() {
        let mut messages = Messages::default();
        (0..250).for_each(|k| messages.push(&k.to_string()));
        let texts: Vec<_> = messages.iter().collect();
        assert_eq!((texts.len(), messages.count()), (102, 250));
        assert_eq!(texts[99..], ["99", "(149 more messages)", "249"]);
        let mut all = Messages::default();
        (0..60).for_each(|_| all.push("before"));
        all.append(messages);
        assert_eq!((all.count(), all.iter().count(), all.iter().last().unwrap().as_str()), (310, 102, "249"));
    }

    #[test]
    fn a_long_message_is_cut() {
        let mut messages = Messages::default();
        messages.push(&"ä".repeat(LONGEST));
        let text = messages.iter().next().unwrap();
        assert!(text.len() <= LONGEST + '…'.len_utf8() && text.ends_with('…'));
    }
}
