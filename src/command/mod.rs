//! The commands, one a file.

mod again;
pub mod check;
pub mod compare;
pub mod dist;
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
mod results;
pub mod run;
mod run_all;
pub mod schema;
pub mod serve;
pub mod simulate;
mod specification;
pub mod sweep;
pub mod tune;
mod tuned;
pub mod validate;
