//! The outcomes of a study in a file, from which an interrupted study goes on.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use serde_json::Value;

use super::outcome::Outcome;
use crate::error::Error;
use crate::sealed::{checksum, differing};
use crate::{begun, output, text_file};

/// Beginning of such a file.
const BEGINNING: &[u8] = b"adaptive-fmu verify 1\n";
/// Member of the question: fixed steps of a device, which may change while a study goes on.
const SUBSTEPS: &str = "substeps";
/// Length of a checksum in hexadecimal digits.
const CHECKSUM: usize = 64;

/// Written outcomes of a study: each is added once.
#[derive(Debug)]
pub struct Record {
    bytes: Vec<u8>,
    outcomes: usize,
}

impl Record {
    /// A record of a study for this question, whose runs on a device have so many fixed steps in a communication step.
    pub fn new(question: &Value, substeps: Option<usize>) -> Self {
        let mut bytes = BEGINNING.to_vec();
        let mut question = question.clone();
        question[SUBSTEPS] = substeps.into();
        bytes.extend(question.to_string().into_bytes());
        bytes.push(b'\n');
        Record { bytes, outcomes: 0 }
    }

    /// Adds the outcomes that it lacks.
    ///
    /// # Errors
    /// When one can't be written.
    pub fn add(&mut self, outcomes: &[Outcome]) -> Result<(), String> {
        for outcome in outcomes.iter().skip(self.outcomes) {
            self.bytes.extend(postcard::to_stdvec(outcome).map_err(|error| error.to_string())?);
        }
        self.outcomes = self.outcomes.max(outcomes.len());
        Ok(())
    }

    /// Writes the file; an earlier one is replaced as a whole or not at all.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        output::write(file, [&self.bytes, checksum(&self.bytes).as_bytes()].concat())
    }

    /// The outcomes of an earlier study for this question, and the fixed steps of its device.
    ///
    /// # Errors
    /// When the file can't be read, belongs to another study, or was changed.
    pub fn read(file: &Path, question: &Value) -> Result<(Vec<Outcome>, Option<usize>), Error> {
        let refuse = |reason: String| Error::Loop { file: file.to_owned(), reason };
        let changed = || refuse("its content does not match its checksum, so it was changed".to_owned());
        let mut bytes = Vec::new();
        let read = |mut opened: File| opened.read_to_end(&mut bytes);
        text_file::open(&begun::path(file)).and_then(read).map_err(Error::file(file))?;
        if !bytes.starts_with(BEGINNING) {
            return Err(refuse("is not a study to continue".to_owned()));
        }
        let (whole, seal) = bytes.split_last_chunk::<CHECKSUM>().ok_or_else(changed)?;
        let content = whole.strip_prefix(BEGINNING).filter(|_| checksum(whole).as_bytes() == seal);
        let content = content.ok_or_else(changed)?;
        let end = content.iter().position(|byte| *byte == b'\n').ok_or_else(changed)?;
        let mut asked: Value = serde_json::from_slice(&content[..end]).map_err(|_| changed())?;
        let substeps = asked.as_object_mut().and_then(|asked| asked.remove(SUBSTEPS)).and_then(|it| it.as_u64());
        if let Some(differing) = differing(&asked, question) {
            return Err(refuse(format!("belongs to another study: {differing}")));
        }
        let (mut rest, mut outcomes) = (&content[end + 1..], Vec::new());
        while !rest.is_empty() {
            let (outcome, further) = postcard::take_from_bytes(rest).map_err(|_| changed())?;
            outcomes.push(outcome);
            rest = further;
        }
        Ok((outcomes, substeps.and_then(|it| usize::try_from(it).ok())))
    }

    /// The device that made an earlier study's runs; none if there is no such study, none within if a processor made them.
    pub fn device(file: &Path) -> Option<Option<String>> {
        let mut line = Vec::new();
        let mut opened = BufReader::new(text_file::open(&begun::path(file)).ok()?);
        for _ in 0..2 {
            line.clear();
            opened.read_until(b'\n', &mut line).ok()?;
        }
        let asked: Value = serde_json::from_slice(&line).ok()?;
        Some(asked.get("device")?.as_str().map(str::to_owned))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn outcomes_are_read_as_they_were_written_and_a_change_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let (file, question) = (folder.path().join("runs.bin"), json!({ "seed": 1 }));
        let outcomes = vec![
            Outcome::Ended(vec![Some(1.5), None, Some(0.1 + 0.2)]),
            Outcome::NotEnded("diverged".into()),
            Outcome::Refused("m".into()),
        ];
        let mut record = Record::new(&question, Some(4));
        record.add(&outcomes[..1]).unwrap();
        record.add(&outcomes).unwrap();
        record.write(&file).unwrap();
        assert_eq!(Record::read(&file, &question).unwrap(), (outcomes, Some(4)));
        let other = Record::read(&file, &json!({ "seed": 2 })).unwrap_err().to_string();
        assert!(other.contains("seed was 1, is 2"), "{other}");
        let mut bytes = std::fs::read(&file).unwrap();
        let place = bytes.len() - 80;
        bytes[place] ^= 1;
        std::fs::write(&file, bytes).unwrap();
        assert!(Record::read(&file, &question).unwrap_err().to_string().contains("checksum"));
        std::fs::write(&file, "{}").unwrap();
        assert!(Record::read(&file, &question).unwrap_err().to_string().contains("not a study"));
    }
}
