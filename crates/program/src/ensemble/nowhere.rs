//! Platforms without OpenCL.

use super::{Columns, Grid};

const REASON: &str = "a browser has no OpenCL";

/// A device, of which there is none.
#[derive(Debug)]
pub struct Device {
    /// Its name.
    pub name: String,
    /// True for a graphics card.
    pub is_gpu: bool,
    /// Number of runs that it takes at a time.
    pub runs: usize,
}

/// A compiled program, of which there is none.
#[derive(Debug)]
pub enum Compiled {}

impl Device {
    /// None.
    ///
    /// # Errors
    /// Always.
    pub fn find() -> Result<Self, String> {
        Err(REASON.to_owned())
    }

    /// None.
    ///
    /// # Errors
    /// Always.
    pub fn chosen(_: Option<&str>) -> Result<Self, String> {
        Err(REASON.to_owned())
    }
}

impl Compiled {
    /// None.
    ///
    /// # Errors
    /// Always.
    pub fn new(_: &Device, _: &str, _: &str) -> Result<Self, String> {
        Err(REASON.to_owned())
    }

    /// Runs, of which there are none.
    pub fn batch(&self, _: usize, _: &Columns, _: (&[u32], &Columns), _: usize) -> Result<&Self, String> {
        match *self {}
    }

    /// Steps, which are never taken.
    pub fn advance(&self, _: usize, _: usize, _: &Grid, _: &mut [f64]) -> Result<(), String> {
        match *self {}
    }

    /// Nothing.
    pub fn status(&self) -> Result<Vec<i32>, String> {
        match *self {}
    }
}
