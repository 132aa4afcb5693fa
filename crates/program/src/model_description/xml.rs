//! Reads XML of others within limits: no document type (so no entities), and sizes that fit into memory.

use quick_xml::Reader;
use quick_xml::events::Event;
use roxmltree::{Document, ParsingOptions};

/// The most elements and texts of a document.
const MOST_NODES: u32 = 2_000_000;
/// The most attributes of an element: each is compared with all others.
const MOST_ATTRIBUTES: usize = 100;

/// The document of a text.
///
/// # Errors
/// The error, with its place.
pub(crate) fn parse(text: &str) -> Result<Document<'_>, String> {
    check_attributes(text)?;
    let options = ParsingOptions { nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).map_err(|error| match error {
        roxmltree::Error::DtdDetected => "a document type (DTD) can't be read".to_owned(),
        other => other.to_string(),
    })
}

fn check_attributes(text: &str) -> Result<(), String> {
    let mut reader = Reader::from_str(text);
    loop {
        match reader.read_event() {
            Ok(Event::Start(tag) | Event::Empty(tag)) => {
                if tag.attributes().with_checks(false).nth(MOST_ATTRIBUTES).is_some() {
                    return Err(format!("an element has more than {MOST_ATTRIBUTES} attributes"));
                }
            }
            // The other reader reports errors, with their places.
            Ok(Event::Eof) | Err(_) => return Ok(()),
            Ok(_) => {}
        }
    }
}
