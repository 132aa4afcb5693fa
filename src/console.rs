//! Standard output and error stream. `println!` panics where nobody reads or the disk is full; these macros note it, the
//! command goes on to its end (files are whole, temporary ones gone), and [`ended`] tells of it once.
//!
//! Where this program serves another, all that is printed goes to that one, as messages: JSON texts, each a line with a record
//! separator in front (RFC 7464). What a unit writes to standard output beside them has none.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::{Value, json};

/// What kept standard output from being written.
static FAILURE: Mutex<Option<io::Error>> = Mutex::new(None);

/// Whether another program is served.
static SERVES: AtomicBool = AtomicBool::new(false);
const RECORD_SEPARATOR: u8 = 0x1e;

/// Prints a line on standard output.
macro_rules! say {
    () => { $crate::console::line(format_args!("")) };
    ($($text:tt)*) => { $crate::console::line(format_args!($($text)*)) };
}

/// Prints a line on the error stream.
macro_rules! tell {
    ($($text:tt)*) => { $crate::console::error_line(format_args!($($text)*)) };
}

/// From now on, what is printed goes to the program that is served.
pub fn serve() {
    SERVES.store(true, Ordering::Relaxed);
}

/// Whether another program is served: it takes what is recorded from a message, and files only where it names a folder.
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

/// Prints a text on standard output as it is.
pub fn text(text: &str) {
    if serves() {
        return send("text", &json!(text), &[]);
    }
    print(|out| out.write_all(text.as_bytes()));
}

/// Prints a line on standard output; see [`say`].
pub fn line(text: Arguments) {
    if serves() {
        return send("text", &json!(format!("{text}\n")), &[]);
    }
    print(|out| writeln!(out, "{text}"));
}

/// Prints a line on the error stream; see [`tell`]. Where that can't be written, nobody can be told.
pub fn error_line(text: Arguments) {
    if serves() {
        return send("note", &json!(text.to_string()), &[]);
    }
    let _ = writeln!(io::stderr().lock(), "{text}");
}

fn print(write: impl FnOnce(&mut dyn Write) -> io::Result<()>) {
    let mut failure = FAILURE.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    // After a failure nothing more is printed: a text with a gap is worse than one that ends.
    if failure.is_none() {
        *failure = write(&mut io::stdout().lock()).err();
    }
}

/// Notes what kept another from printing.
pub fn note(printed: io::Result<()>) {
    print(|_| printed);
}

/// The exit code of a command that ended with one. A reader who has seen enough changes nothing; a disk that is full, or
/// any other failure, is told, and a command that was done counts as one that couldn't be.
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
