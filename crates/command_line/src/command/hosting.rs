//! Where units of other tools run.

use std::time::Duration;

use adaptive_fmu::error::Error;
use adaptive_fmu::fmu::Hosting;

use super::number::positive;

/// How long a call may take unless asked otherwise, s.
const PATIENCE: f64 = 60.0;
/// The shortest and the longest patience, s: a millisecond, and a year.
const SHORTEST: f64 = 1e-3;
const LONGEST: f64 = 3.2e7;

#[derive(clap::Args, Clone)]
pub struct HostingOptions {
    /// Runs units of other tools in this process: faster, but when one crashes, so does this program
    #[arg(long)]
    pub in_process: bool,
    /// Longest time in s that one call of another tool's unit may take
    #[arg(long, default_value_t = PATIENCE, value_parser = positive)]
    pub patience: f64,
}

impl Default for HostingOptions {
    fn default() -> Self {
        HostingOptions { in_process: false, patience: PATIENCE }
    }
}

impl HostingOptions {
    /// Where they run.
    pub fn hosting(&self) -> Result<Hosting, Error> {
        if self.in_process || !Hosting::HAS_PROCESSES {
            return Ok(Hosting::InProcess);
        }
        let program = std::env::current_exe().map_err(Error::file("this program"))?;
        Ok(Hosting::OwnProcess { program, patience: Duration::from_secs_f64(self.patience.clamp(SHORTEST, LONGEST)) })
    }
}
