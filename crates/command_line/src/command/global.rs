//! Options of every command: how much is told, and how much is done at a time.

use std::num::NonZeroUsize;

use adaptive_fmu::fmu::keep_details;
use adaptive_fmu::parallel;

use crate::console::{self, Detail};

const HEADING: &str = "Options of every command";

#[derive(clap::Args)]
pub struct GlobalOptions {
    /// Prints results and errors alone: no warnings, notes, progress or sketches
    #[arg(long, short, global = true, conflicts_with = "verbose", help_heading = HEADING)]
    quiet: bool,
    /// Tells on stderr what is decided on the way: where units come from, how they run, and by which method they are
    /// integrated, with the eigenvalue that decided it
    #[arg(long, short, global = true, help_heading = HEADING)]
    verbose: bool,
    /// So many runs or exports at a time; without it, as many as there are cores
    #[arg(long, global = true, value_name = "N", help_heading = HEADING)]
    jobs: Option<NonZeroUsize>,
}

impl GlobalOptions {
    /// From now on they count.
    pub fn apply(&self) {
        console::set_detail(match (self.quiet, self.verbose) {
            (true, _) => Detail::Quiet,
            (false, true) => Detail::Verbose,
            (false, false) => Detail::Usual,
        });
        if self.verbose {
            keep_details();
        }
        parallel::limit(self.jobs);
    }
}
