//! Descriptions that become a loop.

use std::path::PathBuf;

use crate::error::Error;
use crate::exporter::{Library, Source};
use crate::structure::{Draft, DraftUnit, LoopFiles, STRUCTURE, Structure, Wishes};

/// Descriptions of the FMUs of a loop, with their files as its structure names them.
#[derive(Debug, Clone, Default)]
pub struct Written(Vec<(String, Source)>);

impl Written {
    /// Descriptions in the loop's folder, by the names of their FMUs.
    pub fn new(texts: impl IntoIterator<Item = (String, String)>) -> Self {
        Written::default().with("", texts)
    }

    /// Adds descriptions from the folder above.
    #[must_use]
    pub fn with_shared(self, texts: impl IntoIterator<Item = (String, String)>) -> Self {
        self.with("../", texts)
    }

    fn with(mut self, folder: &str, texts: impl IntoIterator<Item = (String, String)>) -> Self {
        self.0.extend(texts.into_iter().map(|(name, text)| {
            let file = format!("{name}.toml");
            (format!("{folder}{file}"), Source::read(PathBuf::from(file), text))
        }));
        self
    }

    /// The loop that results from the names of their signals, and its text.
    ///
    /// # Errors
    /// When they can't be connected.
    pub fn structure(&self, library: &Library, wishes: Wishes) -> Result<(Structure, String), Error> {
        let unit = |(place, source): &(String, Source)| DraftUnit::of_description(source, place.clone(), library);
        let draft = Draft::new(self.0.iter().map(unit).collect::<Result<_, _>>()?, wishes)?;
        if let Some(open) = draft.open().first() {
            return Err(Error::Loop { file: PathBuf::from(STRUCTURE), reason: open.clone() });
        }
        let text = draft.text();
        Ok((Structure::parse(&text, &self.files(None))?, text))
    }

    /// The files of the loop, with the text of its structure if there is one.
    pub fn files(&self, structure: Option<String>) -> LoopFiles {
        LoopFiles::in_memory(structure, self.sources().cloned())
    }

    /// Its descriptions.
    pub fn sources(&self) -> impl Iterator<Item = &Source> {
        self.0.iter().map(|(_, source)| source)
    }
}
