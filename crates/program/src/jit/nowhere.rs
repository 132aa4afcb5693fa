//! Where no code can be made while a program runs.

use crate::fmi2::kernel::Functions;
use crate::kernel::Kernel;

/// There is none.
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

    /// Of none.
    pub fn kernel(&self) -> &Kernel {
        match *self {}
    }
}

/// Why nothing can be compiled.
pub fn refused() -> Option<String> {
    Some(REASON.to_owned())
}
