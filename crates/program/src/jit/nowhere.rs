//! Platforms on which a running program can't generate code.

use crate::fmi2::kernel::Functions;
use crate::kernel::Kernel;

/// Compiled functions, of which there are none.
#[derive(Debug)]
pub enum Compiled {}

const REASON: &str = "a browser lets no program make code";

impl Compiled {
    /// None.
    ///
    /// # Errors
    /// Always.
    pub fn of(_: &Functions) -> Result<Self, String> {
        Err(REASON.to_owned())
    }

    /// None.
    ///
    /// # Errors
    /// Always.
    pub fn evaluation(_: &Functions) -> Result<Self, String> {
        Err(REASON.to_owned())
    }

    /// Kernel, which never exists.
    pub fn kernel(&self) -> &Kernel {
        match *self {}
    }
}

/// Reason why nothing can be compiled.
pub fn refused() -> Option<String> {
    Some(REASON.to_owned())
}
