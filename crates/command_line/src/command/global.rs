//! Options of every command: level of detail, and number of parallel jobs.

use std::num::NonZeroUsize;

use adaptive_fmu::fmu::keep_details;
use adaptive_fmu::parallel;

use crate::console::{self, Detail};

const HEADING: &str = "Global options";

#[derive(clap::Args)]
pub struct GlobalOptions {
    /// Print only results and errors (no warnings, notes, progress or terminal plots)
    #[arg(long, short, global = true, hide_short_help = true, conflicts_with = "verbose", help_heading = HEADING)]
    quiet: bool,
    /// Log to stderr how each FMU was found, run and integrated, with the eigenvalue that selected its integration
    /// method, and what was assumed of files of records
    #[arg(long, short, global = true, hide_short_help = true, help_heading = HEADING)]
    verbose: bool,
    /// Number of parallel runs or exports [default: number of cores]
    #[arg(long, global = true, hide_short_help = true, value_name = "N", help_heading = HEADING)]
    jobs: Option<NonZeroUsize>,
}

impl GlobalOptions {
    /// Puts the options into force.
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
