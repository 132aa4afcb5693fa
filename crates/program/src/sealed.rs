//! Checksums of contents, and JSON files with one of their own, which reveals changes by hand.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;

use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::error::Error;
use crate::{begun, output, text_file};

/// Key of the checksum in a file.
const CHECKSUM: &str = "checksum";
/// The largest file that is read, in bytes: many times what the largest search leaves.
const LARGEST: u64 = 1 << 28;

/// The most differences in a message, and the most characters of each.
const MOST_NAMED: usize = 8;
const LONGEST_NAMED: usize = 300;

/// Number of bytes of a file that are read at a time.
const BUFFER: usize = 1 << 16;

/// The SHA-256 checksum of contents, in hexadecimal digits.
pub fn checksum(contents: impl AsRef<[u8]>) -> String {
    hexadecimal(&Sha256::digest(contents))
}

/// The SHA-256 checksum of a file.
///
/// # Errors
/// When it can't be read.
pub fn checksum_of_file(file: &Path) -> Result<String, Error> {
    text_file::open(&begun::path(file)).and_then(hash).map_err(Error::file(file))
}

fn hash(mut file: File) -> io::Result<String> {
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; BUFFER]);
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(hexadecimal(&hash.finalize())),
            length => hash.update(&buffer[..length]),
        }
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A writer that computes the checksum of its output.
#[derive(Debug)]
pub struct Summed<W> {
    out: W,
    hash: Sha256,
}

impl<W> Summed<W> {
    /// Nothing is written yet.
    pub fn new(out: W) -> Self {
        Summed { out, hash: Sha256::new() }
    }

    /// Its inner writer.
    pub fn out(&self) -> &W {
        &self.out
    }

    /// Returns the inner writer, and the SHA-256 checksum of all that was written, in hexadecimal digits.
    pub fn end(self) -> (W, String) {
        (self.out, hexadecimal(&self.hash.finalize()))
    }
}

impl<W: Write> Write for Summed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.out.write(bytes)?;
        self.hash.update(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// The content of a file, and the result of its checksum.
#[derive(Debug)]
pub struct Sealed {
    /// Content.
    pub content: Value,
    /// True if the checksum is that of the content; none if the file has no checksum.
    pub fits: Option<bool>,
}

/// Writes content, an object, with its checksum. An earlier file is replaced as a whole or not at all.
///
/// # Errors
/// When it can't be written.
pub fn write(file: &Path, mut content: Value) -> Result<(), Error> {
    content[CHECKSUM] = checksum(content.to_string()).into();
    output::write(file, content.to_string())
}

/// Reads such a file.
///
/// # Errors
/// When it can't be read or isn't JSON; `what` names its expected content.
pub fn read(file: &Path, what: &str) -> Result<Sealed, Error> {
    let mut text = String::new();
    let opened = text_file::open(&begun::path(file)).and_then(|opened| opened.take(LARGEST).read_to_string(&mut text));
    opened.map_err(Error::file(file))?;
    let mut content: Value = serde_json::from_str(&text)
        .map_err(|error| Error::Loop { file: file.to_owned(), reason: format!("is not a {what}: {error}") })?;
    let stated = content.as_object_mut().and_then(|content| content.remove(CHECKSUM));
    let fits = stated.map(|stated| stated.as_str() == Some(&checksum(content.to_string())));
    Ok(Sealed { content, fits })
}

/// Differences between two contents, by the ways to them: `units.plant.guid was 1, is 2`.
pub fn differences(was: &Value, is: &Value) -> Vec<String> {
    let mut found = Vec::new();
    compare(was, is, String::new(), &mut found);
    found
}

/// Differences between two contents as a text that lists the first ones; none if there are none.
pub fn differing(was: &Value, is: &Value) -> Option<String> {
    listed(&differences(was, is))
}

/// Differences as a text that fits into a message; none if there are none.
pub fn listed(differences: &[String]) -> Option<String> {
    let shortened = |text: &String| match text.char_indices().nth(LONGEST_NAMED) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.clone(),
    };
    let mut named: Vec<String> = differences.iter().take(MOST_NAMED).map(shortened).collect();
    if differences.len() > MOST_NAMED {
        named.push(format!("and {} more differences", differences.len() - MOST_NAMED));
    }
    (!named.is_empty()).then(|| named.join("; "))
}

fn compare(was: &Value, is: &Value, way: String, found: &mut Vec<String>) {
    if let (Value::Object(before), Value::Object(after)) = (was, is) {
        let further = after.keys().filter(|key| !before.contains_key(*key));
        for key in before.keys().chain(further) {
            let way = if way.is_empty() { key.clone() } else { format!("{way}.{key}") };
            compare(&was[key], &is[key], way, found);
        }
    } else if was != is {
        let text = |value: &Value| match value {
            Value::Null => "not there".to_owned(),
            // Of one that appears or goes, the members would fill the message.
            Value::Object(_) => "there".to_owned(),
            _ => value.to_string(),
        };
        found.push(format!("{way} was {}, is {}", text(was), text(is)));
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn what_differs_is_reported_by_its_path() {
        let was = json!({ "a": { "b": 1, "c": [1, 2] }, "d": "same" });
        let is = json!({ "a": { "b": 2, "c": [1, 2], "e": true }, "d": "same" });
        assert_eq!(differences(&was, &is), ["a.b was 1, is 2", "a.e was not there, is true"]);
        assert_eq!(differences(&was, &was), [""; 0]);
        assert_eq!(differing(&was, &is).unwrap(), "a.b was 1, is 2; a.e was not there, is true");
        assert_eq!(differing(&was, &was), None);
        assert_eq!(differences(&json!({}), &json!({ "run": { "step": 1 } })), ["run was not there, is there"]);
        let many: Value =
            (0..10).map(|k| (format!("k{k}"), json!("x".repeat(400)))).collect::<serde_json::Map<_, _>>().into();
        let text = differing(&json!({}), &many).unwrap();
        assert!(text.ends_with("…; and 2 more differences") && text.len() < 3000, "{text}");
    }

    #[test]
    fn a_change_by_hand_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("content.json");
        write(&file, json!({ "value": 0.1 })).unwrap();
        let Sealed { content, fits } = read(&file, "record").unwrap();
        assert_eq!((content, fits), (json!({ "value": 0.1 }), Some(true)));
        let text = std::fs::read_to_string(&file).unwrap().replace("0.1", "0.2");
        std::fs::write(&file, text).unwrap();
        assert_eq!(read(&file, "record").unwrap().fits, Some(false));
        std::fs::write(&file, "{").unwrap();
        assert!(read(&file, "record").unwrap_err().to_string().contains("is not a record"));
    }
}
