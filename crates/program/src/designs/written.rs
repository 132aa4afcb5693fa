//! Descriptions of a loop in a folder.

use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::structure::{Draft, Found, LoopFiles, STRUCTURE, Structure, Wishes};

/// Files of a loop: descriptions of its FMUs.
#[derive(Debug, Clone)]
pub(super) struct Written {
    folder: PathBuf,
    files: Vec<String>,
}

impl Written {
    /// Writes descriptions, by the names of their FMUs, into a new folder.
    ///
    /// # Errors
    /// When the files can't be written.
    pub fn new(folder: &Path, texts: impl IntoIterator<Item = (String, String)>) -> Result<Self, Error> {
        std::fs::create_dir_all(folder).map_err(Error::file(folder))?;
        let write = |(name, text): (String, String)| {
            let name = format!("{name}.toml");
            let file = folder.join(&name);
            std::fs::write(&file, text).map_err(Error::file(&file))?;
            Ok(name)
        };
        let files = texts.into_iter().map(write).collect::<Result<_, Error>>()?;
        Ok(Written { folder: folder.to_owned(), files })
    }

    /// Adds descriptions from the folder above, by the names of their FMUs.
    #[must_use]
    pub fn beside<'a>(mut self, names: impl IntoIterator<Item = &'a str>) -> Self {
        self.files.extend(names.into_iter().map(|name| format!("../{name}.toml")));
        self
    }

    /// The loop that results from the names of their signals, and its text.
    ///
    /// # Errors
    /// When they can't be connected.
    pub fn structure(&self, wishes: Wishes) -> Result<(Structure, String), Error> {
        let mut found = Found::new(&self.folder);
        let unit = |file: &String| found.unit(&self.folder.join(file).to_string_lossy());
        let draft = Draft::new(self.files.iter().map(unit).collect::<Result<_, _>>()?, wishes)?;
        if let Some(open) = draft.open().first() {
            return Err(Error::Loop { file: self.folder.join(STRUCTURE), reason: open.clone() });
        }
        let text = draft.text();
        Ok((Structure::parse(&text, &LoopFiles::within(&self.folder))?, text))
    }
}
