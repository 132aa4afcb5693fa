//! Text files as users give them: regular files of UTF-8, of a size that fits into memory many times over.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// Largest text file, in bytes: many times the size of the largest loop.
const LARGEST: u64 = 1 << 22;

/// The text of a file.
///
/// # Errors
/// When it isn't there, is a folder or a pipe, is too long, isn't UTF-8, or contains a NUL character.
pub fn read(file: &Path) -> io::Result<String> {
    let mut bytes = Vec::new();
    open(file)?.take(LARGEST + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > LARGEST {
        return Err(refuse(format!("is longer than {LARGEST} bytes")));
    }
    let line = |before: &[u8]| before.iter().filter(|&&byte| byte == b'\n').count() + 1;
    let text = String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        refuse(format!("line {}: is not UTF-8", line(valid)))
    })?;
    // A file of zeros is what a crash may leave.
    match text.find('\0') {
        Some(place) => Err(refuse(format!("line {}: contains a NUL character", line(&text.as_bytes()[..place])))),
        None => Ok(text),
    }
}

/// A field of a file of comma-separated values (RFC 4180): names like `theta_hat[1,2]` hold commas.
pub fn csv_field(text: &str) -> Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\"")).into()
    } else {
        text.into()
    }
}

/// The fields of a line of such a file. Quotes must end in the line in which they begin.
pub fn csv_fields(line: &str) -> Vec<String> {
    let (mut fields, mut field, mut quoted) = (Vec::new(), String::new(), false);
    let mut rest = line.chars().peekable();
    while let Some(c) = rest.next() {
        match c {
            // Two quotes within quotes are one.
            '"' if quoted && rest.next_if_eq(&'"').is_some() => field.push('"'),
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(std::mem::take(&mut field)),
            _ => field.push(c),
        }
    }
    fields.push(field);
    fields
}

/// A file to read. What isn't a regular one is refused: a pipe would be waited for without end.
///
/// # Errors
/// When it isn't there, or is no regular file.
pub fn open(file: &Path) -> io::Result<File> {
    if !std::fs::metadata(file)?.is_file() {
        return Err(refuse("is not a regular file".to_owned()));
    }
    File::open(file)
}

fn refuse(reason: String) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, reason)
}
