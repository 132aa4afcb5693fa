//! Standard output and error stream. `println!` panics where nobody reads or the disk is full; these macros note it, the
//! command goes on to its end (files are whole, temporary ones gone), and [`ended`] tells of it once.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;
use std::sync::Mutex;

/// What kept standard output from being written.
static FAILURE: Mutex<Option<io::Error>> = Mutex::new(None);

/// Prints a line on standard output.
macro_rules! say {
    () => { $crate::console::line(format_args!("")) };
    ($($text:tt)*) => { $crate::console::line(format_args!($($text)*)) };
}

/// Prints a line on the error stream.
macro_rules! tell {
    ($($text:tt)*) => { $crate::console::error_line(format_args!($($text)*)) };
}

/// Prints a text on standard output as it is.
pub fn text(text: &str) {
    print(|out| out.write_all(text.as_bytes()));
}

/// Prints a line on standard output; see [`say`].
pub fn line(text: Arguments) {
    print(|out| writeln!(out, "{text}"));
}

/// Prints a line on the error stream; see [`tell`]. Where that can't be written, nobody can be told.
pub fn error_line(text: Arguments) {
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
