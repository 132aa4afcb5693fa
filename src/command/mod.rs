//! The commands, one a file.

pub mod export;
pub mod info;
pub mod linearise;
pub mod list;
pub mod parameters;
mod progress;
pub mod run;
mod run_all;
