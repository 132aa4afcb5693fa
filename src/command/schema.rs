//! `schema`: what an editor completes and checks descriptions by.

use std::process::ExitCode;

/// Prints it.
pub fn execute() -> ExitCode {
    print!("{}", adaptive_fmu::schema::text());
    ExitCode::SUCCESS
}
