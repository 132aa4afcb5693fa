//! The commands, one a file.

pub mod check;
pub mod compare;
pub mod completions;
pub mod dist;
pub mod export;
pub mod global;
mod hosting;
pub mod info;
pub mod linearise;
pub mod list;
mod loop_options;
pub mod manual;
mod names;
pub mod new;
mod open;
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
