//! A page that a command wrote, in the user's browser.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use adaptive_fmu::begun;

/// Command that opens a file with the user's program for its kind.
#[cfg(target_os = "windows")]
const OPENER: &[&str] = &["cmd", "/C", "start", ""];
#[cfg(target_os = "macos")]
const OPENER: &[&str] = &["open"];
#[cfg(not(any(target_os = "windows", target_os = "macos")))]
const OPENER: &[&str] = &["xdg-open"];

/// Time to wait for an opener to fail; one that runs on has a browser open.
const PATIENCE: Duration = Duration::from_secs(2);
const LOOK: Duration = Duration::from_millis(20);

#[derive(clap::Args, Default, Clone, Copy)]
pub struct OpenOption {
    /// Open the page in the browser when it is written
    #[arg(long)]
    open: bool,
}

impl OpenOption {
    /// Opens the page, if asked for. If that fails, a warning gives the reason; the page is there nevertheless.
    pub fn show(self, page: &Path) {
        if self.open {
            show(page.as_os_str());
        }
    }
}

/// Opens a page or an address in the user's browser; a warning gives the reason if that fails.
pub fn show(page: &OsStr) {
    if let Err(reason) = opened(page) {
        error_line!("warning: could not open {} in a browser: {}: {reason}", page.display(), OPENER[0]);
    }
}

fn opened(page: &OsStr) -> Result<(), String> {
    let mut opener = Command::new(OPENER[0]);
    // A page is named from the folder where the command began.
    opener.current_dir(begun::path(Path::new(".")));
    opener.args(&OPENER[1..]).arg(page).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut running = opener.spawn().map_err(|error| error.to_string())?;
    let begun = Instant::now();
    while begun.elapsed() < PATIENCE {
        match running.try_wait().map_err(|error| error.to_string())? {
            Some(status) if status.success() => return Ok(()),
            Some(status) => return Err(status.to_string()),
            None => thread::sleep(LOOK),
        }
    }
    Ok(())
}
