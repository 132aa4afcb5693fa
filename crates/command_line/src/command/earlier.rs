//! Results of an earlier call of the same command in the same folder: continued, replaced, or stored next to new ones.

use std::path::Path;

use adaptive_fmu::begun;
use adaptive_fmu::error::Error;

use super::results::tag;
use crate::console;

#[derive(clap::Args)]
pub struct EarlierOptions {
    /// Start anew and replace the results of an earlier call in the same folder.
    ///
    /// By default a call with the same options continues the earlier one, and a call with other options is refused.
    #[arg(long)]
    pub force: bool,
    /// Store the results in a folder whose name ends with @NAME, next to those of other calls
    #[arg(long, value_name = "NAME", value_parser = tag)]
    tag: Option<String>,
    /// Do nothing (accepted for compatibility with earlier versions).
    ///
    /// A call with the same options continues the earlier one in any case.
    #[arg(long, conflicts_with = "force")]
    resume: bool,
}

impl EarlierOptions {
    /// End of the name of the folder.
    pub fn suffix(&self) -> String {
        self.tag.as_ref().map_or_else(String::new, |tag| format!("@{tag}"))
    }

    /// Reads what an earlier call left in a file; `None` if there is none, or it is to be replaced.
    ///
    /// # Errors
    /// When it answers another question or can't be read, with what to do.
    pub fn left<T>(&self, file: &Path, read: impl FnOnce(&Path) -> Result<T, Error>) -> Result<Option<T>, Error> {
        if self.force || !begun::path(file).exists() {
            return Ok(None);
        }
        read(file).map(Some).map_err(|error| match error {
            Error::Loop { file, reason } => Error::Loop { file, reason: format!("{reason}; {}", advice()) },
            other => other,
        })
    }
}

/// Advice on an earlier result, in the vocabulary of the interface that was used.
fn advice() -> &'static str {
    if console::serves() {
        "force=True replaces it, tag=\"NAME\" stores the new results next to it"
    } else {
        "--force replaces it, --tag NAME stores the new results next to it"
    }
}
