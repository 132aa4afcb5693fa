//! `playground`: the page on which a plant becomes a controller and its FMU, without an installation.

use std::path::PathBuf;

use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::exporter::browser_library;
use adaptive_fmu::playground::write_playground;

use super::export::chosen;
use super::open::OpenOption;

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the files of the page; index.html is the page
    #[arg(long, value_name = "FOLDER", default_value = "playground")]
    out: PathBuf,
    /// Library of this package, built for wasm32-unknown-unknown [default: the one that comes with the program]
    #[arg(long, value_name = "LIBRARY.wasm")]
    wasm: Option<PathBuf>,
    /// Library for the FMUs of the page, by platform and file (repeatable) [default: those that come with the program]
    #[arg(long, value_name = "[PLATFORM=]FILE")]
    library: Vec<String>,
    #[command(flatten)]
    open: OpenOption,
}

/// Writes the page.
pub fn execute(arguments: &Arguments) -> Result<(), Error> {
    let missing = || {
        let reason = "there is no library for browsers with this program. Archives and wheels of a release contain it; in a source \
                      folder, `packaging/browser` builds it; --wasm names it";
        Error::Argument(Invalid::because(reason))
    };
    let wasm = arguments.wasm.clone().or_else(browser_library).ok_or_else(missing)?;
    let bytes = std::fs::read(&wasm).map_err(Error::file(&wasm))?;
    let page = write_playground((&wasm, &bytes), &chosen(&arguments.library)?, &arguments.out)?;
    print_line!("{}", page.display());
    arguments.open.show(&page);
    Ok(())
}
