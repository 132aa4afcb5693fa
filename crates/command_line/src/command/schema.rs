//! `schema`: what an editor completes and checks descriptions by.

use std::process::ExitCode;

use crate::console;

/// Prints it.
pub fn execute() -> ExitCode {
    console::text(&adaptive_fmu::schema::text());
    ExitCode::SUCCESS
}
