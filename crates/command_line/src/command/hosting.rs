//! Processes for FMUs of other tools.

use std::time::Duration;

use adaptive_fmu::error::Error;
use adaptive_fmu::fmu::Hosting;

use super::number::positive;

/// Default time limit of a call, s.
const PATIENCE: f64 = 60.0;
/// The shortest and the longest patience, s: a millisecond, and a year.
const SHORTEST: f64 = 1e-3;
const LONGEST: f64 = 3.2e7;

#[derive(Debug, clap::Args, Clone)]
pub struct HostingOptions {
    /// Run FMUs of other tools in this process [default: one process per instance]
    ///
    /// This is faster, but a crash of such an FMU also ends this program. On Windows they always run in this process.
    #[arg(long)]
    pub in_process: bool,
    /// Time limit for one call to an FMU of another tool, s
    #[arg(long, default_value_t = PATIENCE, value_parser = positive)]
    pub patience: f64,
}

impl Default for HostingOptions {
    fn default() -> Self {
        HostingOptions { in_process: false, patience: PATIENCE }
    }
}

impl HostingOptions {
    /// The processes that they run in.
    pub fn hosting(&self) -> Result<Hosting, Error> {
        if self.in_process || !Hosting::HAS_PROCESSES {
            return Ok(Hosting::InProcess);
        }
        let program = std::env::current_exe().map_err(Error::file("this program"))?;
        Ok(Hosting::OwnProcess { program, patience: Duration::from_secs_f64(self.patience.clamp(SHORTEST, LONGEST)) })
    }
}
