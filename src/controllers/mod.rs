//! The adaptive controllers: one file each, in the notation of the thesis.

mod at_limit;
mod clock;
mod funnel;
pub mod funnel_control;
mod fuzzy_gain;
pub mod fuzzy_l1;
mod in_command;
mod inverse;
pub mod l1;
pub mod l1_limit;
pub mod l1_ppf;
pub mod l1_quadrotor;
pub mod l1_sampled;
pub mod ladrc;
mod moves;
pub mod mrac;
pub mod mrac_ppf;
pub mod mrac_ppf_unmatched;
pub mod neuro_ppf;
pub mod observer;
pub mod pid;
mod position_loop;
mod sampling;
mod supervised;
mod template;
mod units;
pub mod watched;
