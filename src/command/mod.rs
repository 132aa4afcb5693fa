//! The commands, one a file.

pub mod check;
pub mod compare;
pub mod dist;
pub mod explore;
pub mod export;
mod hosting;
pub mod info;
pub mod linearise;
pub mod list;
mod loop_options;
mod names;
pub mod new;
pub mod parameters;
mod progress;
mod ready;
pub mod report;
pub mod run;
mod run_all;
pub mod schema;
pub mod serve;
pub mod simulate;
pub mod tune;
mod tuned;
pub mod validate;
