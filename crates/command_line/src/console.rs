//! Standard output and error stream: level of detail, and colours. `println!` panics if nobody reads or the disk is
//! full. These macros note that, the command goes on to its end (files are whole, temporary ones gone), and [`ended`]
//! reports it once.
//!
//! When this program serves another, everything printed goes to that one, as messages: JSON texts, each a line with a
//! record separator in front (RFC 7464). Other output of an FMU to standard output has none.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use anstyle::{AnsiColor, Style};
use serde_json::{Value, json};

/// Error that prevented writing to standard output.
static FAILURE: Mutex<Option<io::Error>> = Mutex::new(None);

/// Level of detail, apart from results and errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Detail {
    /// Nothing.
    Quiet,
    /// Notes for the user.
    Usual,
    /// Also what is decided on the way.
    Verbose,
}

static DETAIL: AtomicU8 = AtomicU8::new(Detail::Usual as u8);

/// Labels of lines on the error stream, with their colours.
const LABELS: [(&str, Style); 2] =
    [(ERROR, AnsiColor::Red.on_default().bold()), (WARNING, AnsiColor::Yellow.on_default().bold())];
const ERROR: &str = "error:";
const WARNING: &str = "warning:";

/// True if another program is served.
static SERVES: AtomicBool = AtomicBool::new(false);
const RECORD_SEPARATOR: u8 = 0x1e;

/// Prints a line on standard output.
macro_rules! print_line {
    () => { $crate::console::line(format_args!("")) };
    ($($text:tt)*) => { $crate::console::line(format_args!($($text)*)) };
}

/// Prints a line on the error stream.
macro_rules! error_line {
    ($($text:tt)*) => { $crate::console::error_line(format_args!($($text)*)) };
}

/// Prints a line on standard output that is no result, unless `--quiet` is given: places of files, warnings of a run.
macro_rules! aside {
    ($($text:tt)*) => { if $crate::console::shows($crate::console::Detail::Usual) { print_line!($($text)*) } };
}

/// Prints a line on the error stream that is neither result nor error: a note of what a user should know.
macro_rules! remark {
    ($($text:tt)*) => { $crate::console::note_line($crate::console::Detail::Usual, format_args!($($text)*)) };
}

/// Prints a line on the error stream where `--verbose` asks for it: what was decided on the way.
macro_rules! detail {
    ($($text:tt)*) => { $crate::console::note_line($crate::console::Detail::Verbose, format_args!($($text)*)) };
}

/// Sets the level of detail.
pub fn set_detail(detail: Detail) {
    DETAIL.store(detail as u8, Ordering::Relaxed);
}

/// True if this level of detail is printed.
pub fn shows(detail: Detail) -> bool {
    detail as u8 <= DETAIL.load(Ordering::Relaxed)
}

/// True if a person sees standard output as it is printed, and wants more than results there: else no sketch is drawn.
pub fn is_seen() -> bool {
    shows(Detail::Usual) && !serves() && io::stdout().is_terminal()
}

/// Sends everything printed to the program that is served from now on.
pub fn serve() {
    SERVES.store(true, Ordering::Relaxed);
}

/// True if another program is served: it takes what is recorded from a message, and files only where it names a folder.
pub fn serves() -> bool {
    SERVES.load(Ordering::Relaxed)
}

/// Sends a message to the program that is served, with bytes behind it.
pub fn send(kind: &str, value: &Value, bytes: &[u8]) {
    print(|out| {
        out.write_all(&[RECORD_SEPARATOR])?;
        writeln!(out, "{}", json!({ kind: value }))?;
        out.write_all(bytes)?;
        out.flush()
    });
}

/// A path in JSON. JSON is Unicode, so characters of a name that aren't are replaced.
pub fn path(path: &Path) -> Value {
    json!(path.to_string_lossy())
}

/// Prints a text on standard output as it is.
pub fn text(text: &str) {
    if serves() {
        return send("text", &json!(text), &[]);
    }
    print(|out| out.write_all(text.as_bytes()));
}

/// Prints a line on standard output, for the macro above.
pub fn line(text: Arguments) {
    if serves() {
        return send("text", &json!(format!("{text}\n")), &[]);
    }
    print(|out| writeln!(out, "{text}"));
}

/// Prints a line on the error stream, for the macro above. Warnings are notes. An error in writing is ignored: there is
/// nowhere to report it.
pub fn error_line(text: Arguments) {
    let text = text.to_string();
    if text.starts_with(WARNING) && !shows(Detail::Usual) {
        return;
    }
    if serves() {
        return send("note", &json!(text), &[]);
    }
    // Shows colours if the terminal does, unless the user decides otherwise (NO_COLOR, CLICOLOR_FORCE).
    let mut out = anstream::stderr().lock();
    let label = LABELS.iter().find_map(|(label, style)| Some((label, style, text.strip_prefix(label)?)));
    let _ = match label {
        Some((label, style, rest)) => writeln!(out, "{style}{label}{style:#}{rest}"),
        None => writeln!(out, "{text}"),
    };
}

/// Prints a note on the error stream, if this level of detail is printed; see [`remark`] and [`detail`].
pub fn note_line(detail: Detail, text: Arguments) {
    if shows(detail) {
        error_line(text);
    }
}

fn print(write: impl FnOnce(&mut dyn Write) -> io::Result<()>) {
    let mut failure = FAILURE.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    // After a failure nothing more is printed: a text with a gap is worse than one that ends.
    if failure.is_none() {
        *failure = write(&mut io::stdout().lock()).err();
    }
}

/// Notes the error that prevented another from printing.
pub fn note(printed: io::Result<()>) {
    print(|_| printed);
}

/// Returns the exit code of a finished command. If the reader closed its end, that is no error. A full disk or any
/// other failure is reported, and makes the exit code that of a failure.
pub fn ended(code: ExitCode) -> ExitCode {
    print(|out| out.flush());
    let failure = FAILURE.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    match &*failure {
        Some(error) if error.kind() != ErrorKind::BrokenPipe => {
            error_line(format_args!("error: standard output: {error}"));
            ExitCode::FAILURE
        }
        _ => code,
    }
}
